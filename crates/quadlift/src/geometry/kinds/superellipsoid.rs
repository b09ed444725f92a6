//! Superellipsoids, described by the exponent q of their support function.

use nalgebra::Vector3;

use super::cuboid::Cuboid;
use super::mesh::{Mesh, pushed_cube};
use super::shape::{Primitive, Shape};
use crate::geometry::gamma::ln_gamma;

/// Cells along an edge of the cube from which rounded bodies are made; even, so that the ends of the axes are vertices.
const DIVISIONS: i32 = 12;

/// `h(u) = (sum |a_i u_i|^q)^(1/q)`: a cuboid for q = 1, an ellipsoid for q = 2. The body itself is
/// `sum |x_i / a_i|^p <= 1` with `p = q / (q - 1)`.
pub(super) struct Superellipsoid(pub f64);

impl Superellipsoid {
    /// The exponent p of the body; infinite for a cuboid.
    fn dual_exponent(&self) -> f64 {
        self.0 / (self.0 - 1.0)
    }
}

/// `(sum |v_i|^q)^(1/q)`, exact for q = 1 and q = 2.
fn q_norm(v: &Vector3<f64>, q: f64) -> f64 {
    if q == 1.0 {
        return v.abs().sum();
    }
    if q == 2.0 {
        return v.norm();
    }
    let largest = v.amax();
    if largest == 0.0 {
        return 0.0;
    }
    largest * v.map(|x| (x.abs() / largest).powf(q)).sum().powf(1.0 / q)
}

impl Shape for Superellipsoid {
    fn name(&self) -> &'static str {
        "superellipsoid"
    }

    fn parameter(&self) -> Option<f64> {
        Some(self.0)
    }

    fn exponent(&self) -> f64 {
        self.0
    }

    fn support(&self, v: &Vector3<f64>) -> f64 {
        q_norm(v, self.0)
    }

    fn contains(&self, point: &Vector3<f64>, half: &Vector3<f64>) -> bool {
        let local = point.component_div(half);
        if self.0 <= 1.0 {
            return local.amax() <= 1.0;
        }
        q_norm(&local, self.dual_exponent()) <= 1.0
    }

    fn volume(&self, half: &Vector3<f64>) -> f64 {
        if self.0 <= 1.0 {
            return Cuboid.volume(half);
        }
        let p = self.dual_exponent();
        8.0 * half.product() * (3.0 * ln_gamma(1.0 + 1.0 / p) - ln_gamma(1.0 + 3.0 / p)).exp()
    }

    fn mesh(&self) -> Mesh {
        if self.0 <= 1.0 {
            return Cuboid.mesh();
        }
        let p = self.dual_exponent();
        let mut mesh = pushed_cube(DIVISIONS, |point| {
            let largest = point.amax();
            largest * point.map(|x| (x.abs() / largest).powf(p)).sum().powf(1.0 / p)
        });
        let power = 1.0 / (self.0 - 1.0);
        let normal = |point: &Vector3<f64>| {
            let largest = point.amax();
            point.map(|x| x.signum() * (x.abs() / largest).powf(power)).normalize()
        };
        mesh.normals = mesh.vertices.iter().map(normal).collect();
        mesh
    }

    fn primitive(&self) -> Primitive {
        if self.0 > 1.5 { Primitive::Ball } else { Primitive::Cube }
    }

    fn relative_size(&self) -> f64 {
        1.4f64.powf(1.0 - 2.0 / self.0)
    }

    fn kinks(&self) -> [bool; 3] {
        [self.0 != 2.0; 3]
    }

    fn support_gradient(&self, reach: &Vector3<f64>) -> (f64, Vector3<f64>) {
        let exponent = self.0;
        if exponent == 1.0 {
            return Cuboid.support_gradient(reach);
        }
        let largest = reach.max();
        if largest == 0.0 {
            return (0.0, Vector3::zeros());
        }
        let relative = reach / largest;
        let powers = relative.map(|x| x.powf(exponent - 1.0));
        let sum = powers.dot(&relative);
        let norm = sum.powf(1.0 / exponent);
        (largest * norm, powers * (norm / sum))
    }

    fn inverse_depth(&self, x: &Vector3<f64>) -> (f64, Vector3<f64>) {
        let q = self.0;
        if q == 1.0 {
            return Cuboid.inverse_depth(x);
        }
        // Between cuboid and ellipsoid.
        let factor = 2f64.powf(1.0 - 1.0 / q);
        let n = x.map(|x| x.powf(q)).sum().powf(1.0 / q);
        (factor * n, x.map(|x| factor * (x / n).powf(q - 1.0)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn limits_are_cuboid_and_ellipsoid() {
        let v = Vector3::new(1.0, -2.0, 0.5);
        assert_eq!(q_norm(&v, 1.0), 3.5);
        assert!((q_norm(&v, 1.5) - (1.0 + 2.0f64.powf(1.5) + 0.5f64.powf(1.5)).powf(2.0 / 3.0)).abs() < 1e-12);
        assert_eq!(q_norm(&Vector3::zeros(), 1.5), 0.0);
    }
}
