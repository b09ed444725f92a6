//! Ellipsoids. As parameters of the optimizer they have a model of their own; where they do not, they are superellipsoids.

use nalgebra::Vector3;

use super::mesh::Mesh;
use super::shape::{Primitive, Shape};
use super::superellipsoid::Superellipsoid;

/// `h(u) = sqrt(sum (a_i u_i)^2)`.
pub(super) struct Ellipsoid;

const ROUND: Superellipsoid = Superellipsoid(2.0);

impl Shape for Ellipsoid {
    fn name(&self) -> &'static str {
        "ellipsoid"
    }

    fn exponent(&self) -> f64 {
        2.0
    }

    fn support(&self, v: &Vector3<f64>) -> f64 {
        v.norm()
    }

    fn contains(&self, point: &Vector3<f64>, half: &Vector3<f64>) -> bool {
        point.component_div(half).norm() <= 1.0
    }

    fn volume(&self, half: &Vector3<f64>) -> f64 {
        4.0 / 3.0 * std::f64::consts::PI * half.product()
    }

    fn crossing(&self, from: &Vector3<f64>, along: &Vector3<f64>, half: &Vector3<f64>) -> Option<[f64; 2]> {
        let (from, along) = (from.component_div(half), along.component_div(half));
        let (a, b, c) = (along.norm_squared(), from.dot(&along), from.norm_squared() - 1.0);
        let discriminant = b * b - a * c;
        let meets = discriminant >= 0.0;
        let root = discriminant.sqrt();
        Some(if meets { [(-b - root) / a, (-b + root) / a] } else { [f64::INFINITY, f64::NEG_INFINITY] })
    }

    fn mesh(&self) -> Mesh {
        ROUND.mesh()
    }

    fn primitive(&self) -> Primitive {
        Primitive::Ball
    }

    fn relative_size(&self) -> f64 {
        1.0
    }

    fn kinks(&self) -> [bool; 3] {
        [false; 3]
    }

    fn support_gradient(&self, reach: &Vector3<f64>) -> (f64, Vector3<f64>) {
        ROUND.support_gradient(reach)
    }

    fn inverse_depth(&self, x: &Vector3<f64>) -> (f64, Vector3<f64>) {
        ROUND.inverse_depth(x)
    }
}
