//! Ellipsoids and their dual quadrics.

use nalgebra::{Matrix3, Matrix4, Point3, Rotation3, SVector, Vector3};

use super::convex_body::ConvexBody;
use super::linalg::symmetric_eigen3;
use super::vech::unvech4;

/// Why a matrix is no ellipsoid.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum EllipsoidError {
    /// A number is NaN or infinite, or the quadric has no finite center.
    #[error("the quadric holds a number that is not finite, or it has no finite center")]
    NotFinite,
    /// The quadric has a center but is no ellipsoid (its shape matrix is not positive definite).
    #[error(
        "the quadric is not an ellipsoid (its shape matrix has eigenvalues {:.3e}, {:.3e}, {:.3e}; all must be positive)",
        .shape_eigenvalues[0], .shape_eigenvalues[1], .shape_eigenvalues[2]
    )]
    NotAnEllipsoid {
        /// The center of the quadric, which exists nevertheless.
        center: Point3<f64>,
        /// Eigenvalues of the shape matrix, descending, squared world units.
        shape_eigenvalues: Vector3<f64>,
    },
}

/// An ellipsoid: center, semi-axes and the rotation whose columns are the axes, in the world.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ellipsoid {
    /// Center in the world.
    pub center: Point3<f64>,
    /// Semi-axes in world units, in the order of the columns of `rotation`.
    pub semi_axes: Vector3<f64>,
    /// Rotation `world_from_object`: its columns are the axes.
    pub rotation: Rotation3<f64>,
}

impl Ellipsoid {
    /// The ellipsoid `(x - t)^T A^-1 (x - t) <= 1` with the semi-axes in descending order.
    ///
    /// # Errors
    /// [`EllipsoidError`] when `A` is not finite or not positive definite.
    pub fn from_shape(center: Point3<f64>, shape: &Matrix3<f64>) -> Result<Self, EllipsoidError> {
        if !center.iter().all(|x| x.is_finite()) {
            return Err(EllipsoidError::NotFinite);
        }
        let (values, vectors) = symmetric_eigen3(shape).ok_or(EllipsoidError::NotFinite)?;
        if values[2] <= 0.0 || values[0] <= 0.0 {
            return Err(EllipsoidError::NotAnEllipsoid { center, shape_eigenvalues: values });
        }
        let semi_axes = values.map(f64::sqrt);
        Ok(Self { center, semi_axes, rotation: Rotation3::from_matrix_unchecked(vectors) })
    }

    /// The shape matrix `A = R diag(a, b, c)^2 R^T` (3x3, squared world units).
    pub fn shape(&self) -> Matrix3<f64> {
        let r = self.rotation.matrix();
        r * Matrix3::from_diagonal(&self.semi_axes.component_mul(&self.semi_axes)) * r.transpose()
    }

    /// The dual quadric `Q* = [[A - t t^T, -t], [-t^T, -1]]`.
    #[cfg(test)]
    pub(crate) fn dual_quadric(&self) -> DualQuadric {
        DualQuadric::from_center_and_shape(&self.center, &self.shape())
    }

    /// The same ellipsoid, `factor` times as large about its center.
    #[cfg(test)]
    pub(crate) fn scaled(&self, factor: f64) -> Self {
        Self { semi_axes: self.semi_axes * factor, ..*self }
    }
}

impl ConvexBody for Ellipsoid {
    fn center(&self) -> Point3<f64> {
        self.center
    }

    fn support(&self, n: &Vector3<f64>) -> f64 {
        (self.rotation.inverse() * n).component_mul(&self.semi_axes).norm()
    }

    fn volume(&self) -> f64 {
        4.0 / 3.0 * std::f64::consts::PI * self.semi_axes.product()
    }

    fn contains(&self, point: &Point3<f64>) -> bool {
        (self.rotation.inverse() * (point - self.center)).component_div(&self.semi_axes).norm() <= 1.0
    }
}

/// A dual quadric `Q*` (symmetric 4x4, up to scale): the envelope of its tangent planes, `pi^T Q* pi = 0`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DualQuadric {
    matrix: Matrix4<f64>,
}

impl DualQuadric {
    /// A dual quadric from its `vech` (10 numbers, lower triangle by columns, any scale).
    pub(crate) fn from_vech(v: &SVector<f64, 10>) -> Self {
        Self { matrix: unvech4(v) }
    }

    /// The dual quadric with center `t` and shape `A`, scaled so that its last entry is -1.
    #[cfg(test)]
    pub(crate) fn from_center_and_shape(center: &Point3<f64>, shape: &Matrix3<f64>) -> Self {
        let t = center.coords;
        let mut matrix = Matrix4::zeros();
        matrix.fixed_view_mut::<3, 3>(0, 0).copy_from(&(shape - t * t.transpose()));
        matrix.fixed_view_mut::<3, 1>(0, 3).copy_from(&-t);
        matrix.fixed_view_mut::<1, 3>(3, 0).copy_from(&-t.transpose());
        matrix[(3, 3)] = -1.0;
        Self { matrix }
    }

    /// The 4x4 matrix.
    pub fn matrix(&self) -> &Matrix4<f64> {
        &self.matrix
    }

    /// Center and shape matrix `A`; the shape is not checked to be positive definite. `None` when there is no
    /// finite center (a paraboloid, or NaN).
    pub(crate) fn center_and_shape(&self) -> Option<(Point3<f64>, Matrix3<f64>)> {
        let w = self.matrix[(3, 3)];
        let t = self.matrix.fixed_view::<3, 1>(0, 3) / w;
        let shape = t * t.transpose() - self.matrix.fixed_view::<3, 3>(0, 0) / w;
        let finite = t.iter().chain(shape.iter()).all(|x| x.is_finite());
        finite.then(|| (Point3::from(t), shape))
    }

    /// The ellipsoid, if the quadric is one; nothing is repaired.
    ///
    /// # Errors
    /// [`EllipsoidError::NotAnEllipsoid`] carries the center, [`EllipsoidError::NotFinite`] when there is none.
    pub fn to_ellipsoid(&self) -> Result<Ellipsoid, EllipsoidError> {
        let (center, shape) = self.center_and_shape().ok_or(EllipsoidError::NotFinite)?;
        Ellipsoid::from_shape(center, &shape)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn ellipsoid(angles: [f64; 3]) -> Ellipsoid {
        Ellipsoid {
            center: Point3::new(1.0, -2.0, 3.0),
            semi_axes: Vector3::new(3.0, 2.0, 0.5),
            rotation: Rotation3::from_euler_angles(angles[0], angles[1], angles[2]),
        }
    }

    proptest! {
        #[test]
        fn dual_quadrics_round_trip(a in -3.0..3.0f64, b in -1.5..1.5f64, c in -3.0..3.0f64,
                                    scale in prop_oneof![-5.0..-0.1f64, 0.1..5.0f64]) {
            let e = ellipsoid([a, b, c]);
            let back = DualQuadric { matrix: e.dual_quadric().matrix * scale }.to_ellipsoid().unwrap();
            prop_assert!((back.center - e.center).norm() < 1e-10);
            prop_assert!((back.semi_axes - e.semi_axes).norm() < 1e-9);
            prop_assert!((back.shape() - e.shape()).norm() < 1e-9);
        }

        #[test]
        fn tangent_planes_satisfy_the_dual_equation(a in -3.0..3.0f64, x in -1.0..1.0f64, y in -1.0..1.0f64) {
            let e = ellipsoid([a, 0.3, -0.4]);
            let n = Vector3::new(x, y, 0.6);
            let d = -n.dot(&e.center.coords) - e.support(&n);
            let plane = nalgebra::Vector4::new(n.x, n.y, n.z, d);
            prop_assert!((plane.transpose() * e.dual_quadric().matrix() * plane)[0].abs() < 1e-9);
        }
    }

    #[test]
    fn a_hyperboloid_keeps_its_center() {
        let shape = Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, -1.0));
        let q = DualQuadric::from_center_and_shape(&Point3::new(1.0, 2.0, 3.0), &shape);
        match q.to_ellipsoid() {
            Err(EllipsoidError::NotAnEllipsoid { center, shape_eigenvalues }) => {
                assert!((center - Point3::new(1.0, 2.0, 3.0)).norm() < 1e-12);
                assert!(shape_eigenvalues[2] < 0.0);
            }
            other => panic!("{other:?}"),
        }
        let q = DualQuadric::from_vech(&SVector::repeat(f64::NAN));
        assert_eq!(q.to_ellipsoid(), Err(EllipsoidError::NotFinite));
    }
}
