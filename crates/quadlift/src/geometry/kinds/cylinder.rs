//! Cylinders about the third axis, whose base is an ellipse.

use nalgebra::Vector3;

use super::mesh::Mesh;
use super::shape::{Primitive, Shape};

/// Of the base of a cylinder, half of volume over projected area: `4 / pi`.
const BASE: f64 = 4.0 * std::f64::consts::FRAC_1_PI;

/// Corners of the polygon that approximates the base in a mesh.
const ROUND: u32 = 48;

/// `h(u) = sqrt((a_1 u_1)^2 + (a_2 u_2)^2) + |a_3 u_3|`.
pub(super) struct Cylinder;

impl Shape for Cylinder {
    fn name(&self) -> &'static str {
        "cylinder"
    }

    fn has_axis(&self) -> bool {
        true
    }

    fn support(&self, v: &Vector3<f64>) -> f64 {
        v.x.hypot(v.y) + v.z.abs()
    }

    fn contains(&self, point: &Vector3<f64>, half: &Vector3<f64>) -> bool {
        point.z.abs() <= half.z && (point.x / half.x).hypot(point.y / half.y) <= 1.0
    }

    fn volume(&self, half: &Vector3<f64>) -> f64 {
        2.0 * std::f64::consts::PI * half.x * half.y * half.z
    }

    /// Within the base, and between bottom and top.
    fn crossing(&self, from: &Vector3<f64>, along: &Vector3<f64>, half: &Vector3<f64>) -> Option<[f64; 2]> {
        const NOWHERE: [f64; 2] = [f64::INFINITY, f64::NEG_INFINITY];
        let (o, v) = (from.xy().component_div(&half.xy()), along.xy().component_div(&half.xy()));
        let (a, b, c) = (v.norm_squared(), o.dot(&v), o.norm_squared() - 1.0);
        let (mut enter, mut leave) = (f64::NEG_INFINITY, f64::INFINITY);
        if a > 0.0 {
            let root = (b * b - a * c).sqrt();
            if root.is_nan() {
                return Some(NOWHERE);
            }
            (enter, leave) = ((-b - root) / a, (-b + root) / a);
        } else if c > 0.0 {
            return Some(NOWHERE);
        }
        if along.z != 0.0 {
            let (bottom, top) = ((-half.z - from.z) / along.z, (half.z - from.z) / along.z);
            (enter, leave) = (enter.max(bottom.min(top)), leave.min(bottom.max(top)));
        } else if from.z.abs() > half.z {
            return Some(NOWHERE);
        }
        Some([enter, leave])
    }

    /// Bottom and top rim, then the middle of bottom and top. Without normals, as a cuboid's, its faces may be shaded flat.
    fn mesh(&self) -> Mesh {
        let rim = |z: f64| {
            (0..ROUND).map(move |k| {
                let (sin, cos) = (std::f64::consts::TAU * f64::from(k) / f64::from(ROUND)).sin_cos();
                Vector3::new(cos, sin, z)
            })
        };
        let middles = [Vector3::new(0.0, 0.0, -1.0), Vector3::new(0.0, 0.0, 1.0)];
        let triangles = (0..ROUND).flat_map(|k| {
            let next = (k + 1) % ROUND;
            let [a, b, c, d] = [k, next, next + ROUND, k + ROUND];
            [[a, b, c], [a, c, d], [2 * ROUND, b, a], [2 * ROUND + 1, d, c]]
        });
        let vertices = rim(-1.0).chain(rim(1.0)).chain(middles).collect();
        Mesh { vertices, triangles: triangles.collect(), normals: Vec::new() }
    }

    fn primitive(&self) -> Primitive {
        Primitive::Cylinder
    }

    fn relative_size(&self) -> f64 {
        0.8
    }

    fn kinks(&self) -> [bool; 3] {
        [false, false, true]
    }

    fn support_gradient(&self, reach: &Vector3<f64>) -> (f64, Vector3<f64>) {
        let across = reach.xy().norm();
        let share = if across > 0.0 { reach.xy() / across } else { reach.xy() };
        (across + reach.z, Vector3::new(share.x, share.y, 1.0))
    }

    fn inverse_depth(&self, x: &Vector3<f64>) -> (f64, Vector3<f64>) {
        let across = x.xy().norm();
        let g = if across > 0.0 { x.xy() / across * BASE } else { x.xy() };
        (BASE * across + x.z, Vector3::new(g.x, g.y, 1.0))
    }
}
