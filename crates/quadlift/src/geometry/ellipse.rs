//! Ellipses in the image and their dual conics.

use nalgebra::{Matrix2, Matrix3, Vector2};

use super::bounding_box::BoundingBox;

/// Why a matrix or a set of numbers is no ellipse.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum EllipseError {
    /// A number is NaN or infinite.
    #[error("the ellipse holds a number that is not finite")]
    NotFinite,
    /// A semi-axis is zero or negative, or the conic is a parabola, a hyperbola or empty.
    #[error("the conic is not an ellipse with positive semi-axes")]
    NotAnEllipse,
}

/// An ellipse in pixels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ellipse {
    pub(crate) center: Vector2<f64>,
    pub(crate) semi_axes: Vector2<f64>,
    pub(crate) angle: f64,
}

impl Ellipse {
    /// A checked ellipse.
    ///
    /// # Errors
    /// [`EllipseError`] when a number is not finite or a semi-axis not positive.
    pub fn new(center: Vector2<f64>, semi_axes: Vector2<f64>, angle: f64) -> Result<Self, EllipseError> {
        if !center.iter().chain(semi_axes.iter()).all(|x| x.is_finite()) || !angle.is_finite() {
            return Err(EllipseError::NotFinite);
        }
        if semi_axes.min() <= 0.0 {
            return Err(EllipseError::NotAnEllipse);
        }
        Ok(Self { center, semi_axes, angle })
    }

    /// Center in pixels.
    pub fn center(&self) -> Vector2<f64> {
        self.center
    }

    /// Semi-axes in pixels; the first one has the direction of [`Ellipse::angle`].
    pub fn semi_axes(&self) -> Vector2<f64> {
        self.semi_axes
    }

    /// Direction of the first semi-axis in radians, from x towards y (clockwise on the screen).
    pub fn angle(&self) -> f64 {
        self.angle
    }

    /// The ellipse with center `c` and shape `S`, that is `(x - c)^T S^-1 (x - c) = 1`.
    ///
    /// The first semi-axis is the longer one, its angle in (-pi/2, pi/2].
    ///
    /// # Errors
    /// [`EllipseError::NotAnEllipse`] when `S` is not positive definite.
    pub fn from_shape(center: Vector2<f64>, shape: &Matrix2<f64>) -> Result<Self, EllipseError> {
        let (mean, difference) = (0.5 * (shape.m11 + shape.m22), 0.5 * (shape.m11 - shape.m22));
        let off = 0.5 * (shape.m12 + shape.m21);
        let radius = difference.hypot(off);
        let major = mean + radius;
        let determinant = shape.m11 * shape.m22 - off * off;
        if !center.iter().all(|x| x.is_finite()) || !major.is_finite() || !determinant.is_finite() {
            return Err(EllipseError::NotFinite);
        }
        if major <= 0.0 || determinant <= 0.0 {
            return Err(EllipseError::NotAnEllipse);
        }
        // det / major is the stable form of the smaller eigenvalue.
        let semi_axes = Vector2::new(major.sqrt(), (determinant / major).sqrt());
        Self::new(center, semi_axes, 0.5 * off.atan2(difference))
    }

    /// The ellipse of a dual conic `C*` (3x3, any scale): `C* ~ [[S - c c^T, -c], [-c^T, -1]]`.
    ///
    /// # Errors
    /// [`EllipseError`] when the conic is not a real ellipse.
    pub(crate) fn from_dual_conic(dual_conic: &Matrix3<f64>) -> Result<Self, EllipseError> {
        let w = dual_conic[(2, 2)];
        if !dual_conic.iter().all(|x| x.is_finite()) {
            return Err(EllipseError::NotFinite);
        }
        if w == 0.0 {
            return Err(EllipseError::NotAnEllipse);
        }
        let c = Vector2::new(dual_conic[(0, 2)] / w, dual_conic[(1, 2)] / w);
        let shape = c * c.transpose() - dual_conic.fixed_view::<2, 2>(0, 0) / w;
        Self::from_shape(c, &shape)
    }

    /// The ellipse inscribed in a box: what PfD fits to a detection (and what biases it, see [`crate::solve`]).
    pub fn inscribed_in(bounding_box: &BoundingBox) -> Self {
        let half = bounding_box.size() * 0.5;
        let center = bounding_box.center();
        if half.x >= half.y {
            Self { center, semi_axes: half, angle: 0.0 }
        } else {
            Self { center, semi_axes: half.yx(), angle: std::f64::consts::FRAC_PI_2 }
        }
    }

    /// The shape matrix `S = R diag(l1, l2)^2 R^T`.
    pub fn shape(&self) -> Matrix2<f64> {
        let (sin, cos) = self.angle.sin_cos();
        let (p, q) = (self.semi_axes.x * self.semi_axes.x, self.semi_axes.y * self.semi_axes.y);
        let off = (p - q) * cos * sin;
        Matrix2::new(p * cos * cos + q * sin * sin, off, off, p * sin * sin + q * cos * cos)
    }

    /// The dual conic, scaled so that its last entry is -1 (PfD equation 3).
    pub(crate) fn dual_conic(&self) -> Matrix3<f64> {
        let (s, c) = (self.shape(), self.center);
        Matrix3::new(
            s.m11 - c.x * c.x,
            s.m12 - c.x * c.y,
            -c.x,
            s.m21 - c.y * c.x,
            s.m22 - c.y * c.y,
            -c.y,
            -c.x,
            -c.y,
            -1.0,
        )
    }

    /// The tight axis-aligned box: `c_x +- sqrt(S11)`, `c_y +- sqrt(S22)`.
    pub fn bounding_box(&self) -> BoundingBox {
        let shape = self.shape();
        let (w, h) = (shape.m11.sqrt(), shape.m22.sqrt());
        let c = self.center;
        BoundingBox { x0: c.x - w, y0: c.y - h, x1: c.x + w, y1: c.y + h }
    }

    /// The tangent line with the given unit normal on the far side: `(n, d)` with `n.x + d = 0` on the line and
    /// `n.x + d <= 0` inside, as a homogeneous line `[n_x, n_y, d]`.
    pub fn tangent_line(&self, normal: &Vector2<f64>) -> [f64; 3] {
        let reach = (normal.transpose() * self.shape() * normal)[0].sqrt();
        [normal.x, normal.y, -(normal.dot(&self.center) + reach)]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn dual_conics_round_trip_at_any_scale(
            x in -500.0..500.0f64, y in -500.0..500.0f64, a in 5.0..200.0f64, ratio in 0.1..0.95f64,
            angle in -1.5..1.5f64, scale in prop_oneof![-10.0..-0.1f64, 0.1..10.0f64],
        ) {
            let e = Ellipse::new(Vector2::new(x, y), Vector2::new(a, a * ratio), angle).unwrap();
            let back = Ellipse::from_dual_conic(&(e.dual_conic() * scale)).unwrap();
            prop_assert!((back.center - e.center).norm() < 1e-6);
            prop_assert!((back.semi_axes - e.semi_axes).norm() < 1e-5 * a);
            prop_assert!((back.angle - e.angle).sin().abs() < 1e-4);
        }

        #[test]
        fn tangent_lines_touch(angle in -3.0..3.0f64, direction in 0.0..6.3f64) {
            let e = Ellipse::new(Vector2::new(3.0, -2.0), Vector2::new(5.0, 2.0), angle).unwrap();
            let line = nalgebra::Vector3::from(e.tangent_line(&Vector2::new(direction.cos(), direction.sin())));
            prop_assert!((line.transpose() * e.dual_conic() * line)[0].abs() < 1e-9);
        }
    }

    #[test]
    fn the_box_of_the_inscribed_ellipse_is_the_box() {
        let b = BoundingBox::new([10.0, 20.0, 40.0, 100.0]).unwrap();
        let e = Ellipse::inscribed_in(&b);
        assert_eq!(e.semi_axes, Vector2::new(40.0, 15.0));
        for (p, q) in e.bounding_box().edges().iter().zip(b.edges()) {
            assert!((p - q).abs() < 1e-12);
        }
    }

    #[test]
    fn hyperbolas_are_refused() {
        let c = Matrix3::new(1.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0, -1.0);
        assert_eq!(Ellipse::from_dual_conic(&c), Err(EllipseError::NotAnEllipse));
        assert_eq!(Ellipse::from_dual_conic(&(c * f64::NAN)), Err(EllipseError::NotFinite));
    }
}
