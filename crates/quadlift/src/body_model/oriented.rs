//! The parametrisation of cuboids, cylinders and superellipsoids (docs/method.md, section 3).

use nalgebra::{Matrix3, Rotation3, SVector, Vector3};

use super::{BodyModel, LARGEST_ASPECT};
use crate::geometry::skew;
use crate::optimize::normal_equations::{NormalEquations, Row};

/// The support function of an oriented body, of `u` in the frame of its axes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Form {
    /// `sum |a_i u_i|`: a cuboid.
    Cuboid,
    /// `(sum |a_i u_i|^q)^(1/q)`: a superellipsoid.
    Exponent(f64),
    /// `sqrt((a_1 u_1)^2 + (a_2 u_2)^2) + a_3 |u_3|`: a cylinder.
    Cylinder,
}

/// A cuboid, cylinder or superellipsoid: rotation, log semi-axes, and the form of the support function. The shape matrix
/// does not determine the rotation when axes are equal (a cube).
#[derive(Debug, Clone)]
pub(crate) struct OrientedModel {
    center: Vector3<f64>,
    axes: Matrix3<f64>,
    semi_axes: Vector3<f64>,
    form: Form,
}

impl OrientedModel {
    pub(crate) fn new(center: Vector3<f64>, axes: Matrix3<f64>, semi_axes: Vector3<f64>, form: Form) -> Self {
        Self { center, axes, semi_axes, form }
    }

    /// Form of the support function.
    pub(crate) fn form(&self) -> Form {
        self.form
    }
}

impl Form {
    /// Semi-axes of a body relative to those of the ellipsoid that touches about the same planes: 1 / 1.4 for a cuboid, 1
    /// for the ellipsoid itself, in between for a cylinder.
    pub(crate) fn relative_size(self) -> f64 {
        match self {
            Self::Cuboid => 1.0 / 1.4,
            Self::Exponent(exponent) => 1.4f64.powf(1.0 - 2.0 / exponent),
            Self::Cylinder => 0.8,
        }
    }
}

/// Precision of the rotation of a cylinder about its own axis before anything is known: angles over half a circle have the
/// variance `pi^2 / 12`. A round base tells nothing more.
const SPIN_PRECISION: f64 = 1.2;

impl BodyModel for OrientedModel {
    fn center(&self) -> &Vector3<f64> {
        &self.center
    }

    fn semi_axes(&self) -> Vector3<f64> {
        self.semi_axes
    }

    fn axes(&self) -> &Matrix3<f64> {
        &self.axes
    }

    #[inline]
    fn support_gradient(&self, n: &Vector3<f64>) -> (f64, [f64; 6]) {
        let u = self.axes.tr_mul(n);
        // reach_i = |a_i u_i|; g_i = dh/du_i = share_i a_i sign(u_i); dh/dlog a_i = g_i u_i; dh/dw = g x u for R <- R exp[w]x.
        let reach = self.semi_axes.component_mul(&u.abs());
        let (h, share) = match self.form {
            Form::Cuboid | Form::Exponent(1.0) => (reach.sum(), Vector3::repeat(1.0)),
            Form::Exponent(exponent) => {
                let largest = reach.max();
                if largest == 0.0 {
                    return (0.0, [0.0; 6]);
                }
                let relative = reach / largest;
                let powers = relative.map(|x| x.powf(exponent - 1.0));
                let sum = powers.dot(&relative);
                let norm = sum.powf(1.0 / exponent);
                (largest * norm, powers * (norm / sum))
            }
            Form::Cylinder => {
                let across = reach.xy().norm();
                let share = if across > 0.0 { reach.xy() / across } else { reach.xy() };
                (across + reach.z, Vector3::new(share.x, share.y, 1.0))
            }
        };
        let g = Vector3::from_fn(|i, _| share[i] * self.semi_axes[i] * u[i].signum());
        let w = g.cross(&u);
        (h, [w.x, w.y, w.z, g.x * u.x, g.y * u.y, g.z * u.z])
    }

    fn root_transposed(&self) -> Option<&Matrix3<f64>> {
        None
    }

    fn retract(&self, step: &SVector<f64, 9>) -> Option<Self> {
        let turn = Rotation3::new(Vector3::new(step[3], step[4], step[5]));
        let axes = self.axes * turn.matrix();
        let semi_axes = Vector3::from_fn(|i, _| self.semi_axes[i] * step[6 + i].exp());
        let sensible = semi_axes.min() > 0.0 && semi_axes.max() < semi_axes.min() * LARGEST_ASPECT;
        sensible.then(|| Self { center: self.center + step.fixed_rows::<3>(0), axes, semi_axes, form: self.form })
    }

    fn add_shape_prior(&self, weight: f64, equations: &mut NormalEquations) {
        let log = self.semi_axes.map(f64::ln);
        let mean = log.sum() / 3.0;
        for i in 0..3 {
            let mut row = [0.0; 9];
            for k in 0..3 {
                row[6 + k] = weight * (f64::from(i == k) - 1.0 / 3.0);
            }
            equations.add_quadratic(weight * (log[i] - mean), &row);
        }
        if self.form == Form::Cylinder {
            let mut row = [0.0; 9];
            row[5] = 1.0;
            equations.add_row(0.0, &row, SPIN_PRECISION);
        }
    }

    fn log_axes_gradient(&self) -> [Row; 3] {
        std::array::from_fn(|i| {
            let mut row = [0.0; 9];
            row[6 + i] = 1.0;
            row
        })
    }

    fn add_upright_prior(&self, up: &Vector3<f64>, weight: f64, equations: &mut NormalEquations) {
        // The components of `up` along the two axes that are not the vertical one; d(R^T up) = (R^T up) x w.
        let local = self.axes.transpose() * up;
        let vertical = local.iamax();
        let turn = skew(&local);
        for i in (0..3).filter(|&i| i != vertical) {
            let mut row = [0.0; 9];
            for k in 0..3 {
                row[3 + k] = weight * turn[(i, k)];
            }
            equations.add_quadratic(weight * local[i], &row);
        }
    }
}
