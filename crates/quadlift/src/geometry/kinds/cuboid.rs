//! Cuboids.

use nalgebra::Vector3;

use super::mesh::{Mesh, pushed_cube};
use super::shape::{Primitive, Shape};

/// `h(u) = sum |a_i u_i|`.
pub(super) struct Cuboid;

impl Shape for Cuboid {
    fn name(&self) -> &'static str {
        "cuboid"
    }

    fn support(&self, v: &Vector3<f64>) -> f64 {
        v.abs().sum()
    }

    fn contains(&self, point: &Vector3<f64>, half: &Vector3<f64>) -> bool {
        (0..3).all(|i| point[i].abs() <= half[i])
    }

    fn volume(&self, half: &Vector3<f64>) -> f64 {
        8.0 * half.product()
    }

    fn crossing(&self, from: &Vector3<f64>, along: &Vector3<f64>, half: &Vector3<f64>) -> Option<[f64; 2]> {
        let (mut enter, mut leave) = (f64::NEG_INFINITY, f64::INFINITY);
        for axis in 0..3 {
            if along[axis] == 0.0 {
                if from[axis].abs() > half[axis] {
                    return Some([f64::INFINITY, f64::NEG_INFINITY]);
                }
                continue;
            }
            let (a, b) = ((-half[axis] - from[axis]) / along[axis], (half[axis] - from[axis]) / along[axis]);
            (enter, leave) = (enter.max(a.min(b)), leave.min(a.max(b)));
        }
        Some([enter, leave])
    }

    fn mesh(&self) -> Mesh {
        pushed_cube(1, Vector3::amax)
    }

    fn primitive(&self) -> Primitive {
        Primitive::Cube
    }

    fn relative_size(&self) -> f64 {
        1.0 / 1.4
    }

    fn kinks(&self) -> [bool; 3] {
        [true; 3]
    }

    fn support_gradient(&self, reach: &Vector3<f64>) -> (f64, Vector3<f64>) {
        (reach.sum(), Vector3::repeat(1.0))
    }

    fn inverse_depth(&self, x: &Vector3<f64>) -> (f64, Vector3<f64>) {
        (x.sum(), Vector3::repeat(1.0))
    }
}
