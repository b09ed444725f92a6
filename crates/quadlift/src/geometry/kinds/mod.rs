//! The kinds of bodies, one file for each. No other file of the library matches all of them.

mod mesh;
mod shape;
mod cuboid;
mod superellipsoid;
mod ellipsoid;
mod rounded;
mod cylinder;

pub use mesh::Mesh;
pub use shape::Primitive;

use nalgebra::Vector3;

use shape::Shape;

/// A kind of body.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum BodyKind {
    /// An ellipsoid.
    #[default]
    Ellipsoid,
    /// A cuboid.
    Cuboid,
    /// A cylinder about its third axis, with an elliptic base.
    Cylinder,
    /// A superellipsoid with this exponent of its support function, in [1, 2] (1 cuboid, 2 ellipsoid).
    Superellipsoid(f64),
    /// The Minkowski sum of a cuboid and an ellipsoid with the same axes and proportions, weighted by this roundness of the ellipsoid, in
    /// [0, 1] (0 cuboid, 1 ellipsoid).
    Rounded(f64),
}

/// Methods of a kind that are those of its [`Shape`].
macro_rules! of_shape {
    ($($(#[$doc:meta])+ $visibility:vis fn $name:ident($($argument:ident: $of:ty),*) -> $result:ty;)+) => {
        impl BodyKind {$(
            $(#[$doc])+
            #[inline]
            $visibility fn $name(self, $($argument: $of),*) -> $result {
                match self {
                    Self::Ellipsoid => ellipsoid::Ellipsoid.$name($($argument),*),
                    Self::Cuboid => cuboid::Cuboid.$name($($argument),*),
                    Self::Cylinder => cylinder::Cylinder.$name($($argument),*),
                    Self::Superellipsoid(q) => superellipsoid::Superellipsoid(q).$name($($argument),*),
                    Self::Rounded(roundness) => rounded::Rounded(roundness).$name($($argument),*),
                }
            }
        )+}
    };
}

of_shape! {
    /// Its name in files; the one on the command line has the parameter behind it.
    pub fn name() -> &'static str;
    /// The number that belongs to the kind: the exponent of a superellipsoid, the roundness of a rounded body.
    pub fn parameter() -> Option<f64>;
    /// Exponent q of the support function, in [1, 2]; 1 where it has none.
    pub fn exponent() -> f64;
    /// The body of half extents one about the origin.
    pub fn mesh() -> Mesh;
    /// The nearest simple body.
    pub fn primitive() -> Primitive;
    /// See [`Shape::has_axis`].
    pub(crate) fn has_axis() -> bool;
    /// See [`Shape::support`].
    pub(crate) fn support(v: &Vector3<f64>) -> f64;
    /// See [`Shape::contains`].
    pub(crate) fn contains(point: &Vector3<f64>, half: &Vector3<f64>) -> bool;
    /// See [`Shape::volume`].
    pub(crate) fn volume(half: &Vector3<f64>) -> f64;
    /// See [`Shape::crossing`].
    pub(crate) fn crossing(from: &Vector3<f64>, along: &Vector3<f64>, half: &Vector3<f64>) -> Option<[f64; 2]>;
    /// See [`Shape::relative_size`].
    pub(crate) fn relative_size() -> f64;
    /// See [`Shape::kinks`].
    pub(crate) fn kinks() -> [bool; 3];
    /// See [`Shape::support_gradient`].
    pub(crate) fn support_gradient(reach: &Vector3<f64>) -> (f64, Vector3<f64>);
    /// See [`Shape::inverse_depth`].
    pub(crate) fn inverse_depth(x: &Vector3<f64>) -> (f64, Vector3<f64>);
}

impl BodyKind {
    /// One of each kind, with any parameter.
    pub const ALL: [Self; 5] =
        [Self::Ellipsoid, Self::Cuboid, Self::Cylinder, Self::Superellipsoid(1.5), Self::Rounded(0.5)];

    /// The kinds that estimators fit, as options name them: the roundness of a rounded body is fitted, whatever is given.
    pub const FITTED: [Self; 4] = [Self::Ellipsoid, Self::Cuboid, Self::Cylinder, Self::Rounded(0.65)];

    /// The names of all kinds on the command line, where Q stands for an exponent and R for a roundness.
    pub(crate) const NAMES: [&str; 5] = [
        "ellipsoid",
        "cuboid",
        "cylinder",
        "superellipsoid:Q with Q from 1 (cuboid) to 2 (ellipsoid)",
        "rounded:R with R from 0 (cuboid) to 1 (ellipsoid)",
    ];

    /// The kind with a name, if it has a parameter with this one.
    pub fn named(name: &str, parameter: f64) -> Option<Self> {
        let kind = Self::ALL.into_iter().find(|kind| kind.name() == name)?;
        Some(match kind {
            Self::Superellipsoid(_) => Self::Superellipsoid(parameter),
            Self::Rounded(_) => Self::Rounded(parameter),
            _ => kind,
        })
    }

    /// The kind itself, or the simpler one that it is at an end of its parameter.
    pub fn simplest(self) -> Self {
        match self {
            Self::Superellipsoid(q) if q <= 1.0 => Self::Cuboid,
            Self::Superellipsoid(q) if q >= 2.0 => Self::Ellipsoid,
            Self::Rounded(r) if r <= 0.0 => Self::Cuboid,
            Self::Rounded(r) if r >= 1.0 => Self::Ellipsoid,
            _ => self,
        }
    }
}

#[cfg(test)]
mod tests {
    use std::collections::HashMap;

    use super::*;

    /// Volume by the theorem of Gauss; it is negative where triangles are turned inside out.
    fn volume(mesh: &Mesh) -> f64 {
        let v = |i: u32| mesh.vertices[i as usize];
        mesh.triangles.iter().map(|&[a, b, c]| v(a).dot(&v(b).cross(&v(c))) / 6.0).sum()
    }

    #[test]
    fn meshes_have_the_volume_of_the_body_and_no_holes() {
        for kind in BodyKind::ALL.into_iter().chain([1.0, 1.1, 2.0].map(BodyKind::Superellipsoid)) {
            let mesh = kind.mesh();
            let (found, expected) = (volume(&mesh), kind.volume(&Vector3::repeat(1.0)));
            assert!(found <= expected + 1e-12 && found > 0.97 * expected, "{kind:?}: {found} {expected}");
            // Euler's formula for a closed surface without handles.
            assert_eq!(mesh.vertices.len(), mesh.triangles.len() / 2 + 2, "{kind:?}");
            let mut edges = HashMap::new();
            for t in &mesh.triangles {
                for k in 0..3 {
                    *edges.entry((t[k], t[(k + 1) % 3])).or_insert(0) += 1;
                }
            }
            assert!(edges.iter().all(|((a, b), n)| *n == 1 && edges.get(&(*b, *a)) == Some(&1)), "{kind:?}");
        }
        assert_eq!(BodyKind::Cuboid.mesh().vertices.len(), 8);
    }

    #[test]
    fn vertices_lie_on_the_body_and_normals_are_those_of_its_tangent_planes() {
        for q in [1.3, 2.0] {
            let mesh = BodyKind::Superellipsoid(q).mesh();
            for (point, n) in mesh.vertices.iter().zip(&mesh.normals) {
                // The tangent plane at the point: n . x = support(n), by the definition of the support function.
                let support = n.map(|x| x.abs().powf(q)).sum().powf(1.0 / q);
                assert!((n.dot(point) - support).abs() < 1e-12, "{q} {point}");
            }
            assert!(mesh.vertices.iter().any(|p| (p - Vector3::y()).norm() < 1e-12), "the end of an axis");
        }
    }
}
