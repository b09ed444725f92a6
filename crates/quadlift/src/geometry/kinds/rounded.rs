//! Rounded bodies: the Minkowski sum of a cuboid and an ellipsoid with the same axes and proportions.

use nalgebra::Vector3;

use super::cuboid::Cuboid;
use super::mesh::{Mesh, pushed_cube};
use super::shape::{Primitive, Shape};

/// Cells along an edge of the cube from which the mesh is made; even, so that the ends of the axes are vertices.
const DIVISIONS: i32 = 12;

/// `h(u) = (1 - r) sum |a_i u_i| + r sqrt(sum a_i^2 u_i^2)` with the roundness r: a cuboid for 0, an ellipsoid for 1. With half extents
/// one it is a cube of half edge 1 - r about which a ball of radius r rolls.
pub(super) struct Rounded(pub f64);

impl Rounded {
    /// Half the edge of the cube.
    fn core(&self) -> f64 {
        1.0 - self.0
    }

    /// The factor by which the body of half extents one must grow to reach a point: the cube below the face, the edge or the corner that
    /// the ball rounds. With k components x beyond the cube: `sum (x - t core)^2 = (t r)^2`.
    fn gauge(&self, point: &Vector3<f64>) -> f64 {
        let mut x = [point.x.abs(), point.y.abs(), point.z.abs()];
        x.sort_by(|a, b| b.total_cmp(a));
        let core = self.core();
        let mut factor = x[0];
        let (mut sum, mut squares) = (x[0], x[0] * x[0]);
        for (k, next) in x.into_iter().enumerate().skip(1) {
            if next <= factor * core {
                break;
            }
            (sum, squares) = (sum + next, squares + next * next);
            let (a, b) = ((k + 1) as f64 * core * core - self.0 * self.0, core * sum);
            factor = squares / (b + (b * b - a * squares).max(0.0).sqrt());
        }
        factor
    }
}

impl Shape for Rounded {
    fn name(&self) -> &'static str {
        "rounded"
    }

    fn parameter(&self) -> Option<f64> {
        Some(self.0)
    }

    /// That of the superellipsoid that is about as round.
    fn exponent(&self) -> f64 {
        1.0 + self.0
    }

    fn support(&self, v: &Vector3<f64>) -> f64 {
        self.core() * v.abs().sum() + self.0 * v.norm()
    }

    fn contains(&self, point: &Vector3<f64>, half: &Vector3<f64>) -> bool {
        let beyond = point.component_div(half).map(|x| (x.abs() - self.core()).max(0.0));
        beyond.norm() <= self.0
    }

    /// Steiner's formula for the cube.
    fn volume(&self, half: &Vector3<f64>) -> f64 {
        let (edge, r) = (2.0 * self.core(), self.0);
        let pi = std::f64::consts::PI;
        half.product() * (edge.powi(3) + 6.0 * edge * edge * r + 3.0 * pi * edge * r * r + 4.0 / 3.0 * pi * r.powi(3))
    }

    fn mesh(&self) -> Mesh {
        if self.0 <= 0.0 {
            return Cuboid.mesh();
        }
        let mut mesh = pushed_cube(DIVISIONS, |point| self.gauge(point));
        let normal = |point: &Vector3<f64>| {
            let beyond = point.map(|x| x.signum() * (x.abs() - self.core()).max(0.0));
            beyond.try_normalize(0.0).unwrap_or_else(|| point.normalize())
        };
        mesh.normals = mesh.vertices.iter().map(normal).collect();
        mesh
    }

    fn primitive(&self) -> Primitive {
        if self.0 > 0.5 { Primitive::Ball } else { Primitive::Cube }
    }

    fn relative_size(&self) -> f64 {
        1.0 / (1.4 * self.core() + self.0)
    }

    fn kinks(&self) -> [bool; 3] {
        [self.0 != 1.0; 3]
    }

    fn support_gradient(&self, reach: &Vector3<f64>) -> (f64, Vector3<f64>) {
        let norm = reach.norm();
        let round = if norm > 0.0 { reach / norm } else { Vector3::zeros() };
        (self.core() * reach.sum() + self.0 * norm, Vector3::repeat(self.core()) + round * self.0)
    }

    /// Between cuboid and ellipsoid, whose distances are inverse to these.
    fn inverse_depth(&self, x: &Vector3<f64>) -> (f64, Vector3<f64>) {
        let (cuboid, by_cuboid) = Cuboid.inverse_depth(x);
        let (round, by_round) = super::ellipsoid::Ellipsoid.inverse_depth(x);
        (self.core() * cuboid + self.0 * round, by_cuboid * self.core() + by_round * self.0)
    }
}
