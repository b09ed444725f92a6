//! The parametrization of an ellipsoid (docs/method.md, section 3).

use nalgebra::{Matrix3, Matrix6, SVector, Vector3};

use super::{BodyModel, MAX_ASPECT, MeasuredShape, ShapeDifference, by_length, size_differences};
use crate::geometry::linalg::symmetric_eigen3;
use crate::geometry::rotation::horizontal_basis;
use crate::geometry::{VECH3, vech3};
use crate::optimize::normal_equations::{NormalEquations, Row};

/// An ellipsoid: `A <- B exp(D) B^T` with `A = B B^T`, D symmetric (section 3): no singularity at spheres, no order of axes.
///
/// B is kept as `V diag(a)` with the eigenvectors V of A, so that the matrix logarithm of the prior is diagonal.
#[derive(Debug, Clone)]
pub(crate) struct EllipsoidModel {
    center: Vector3<f64>,
    axes: Matrix3<f64>,
    semi_axes: Vector3<f64>,
    /// `B^T`, rows `a_i v_i^T`.
    root_transposed: Matrix3<f64>,
}

/// Difference of log semi-axes below which the rotation between two axes means little.
const ROUND: f64 = 0.1;

/// Entry of the parameter vector for each entry (i, j), i >= j, of the symmetric step D.
const STEP_INDEX: [[usize; 3]; 3] = [[3, 4, 5], [4, 6, 7], [5, 7, 8]];

/// Derivative of `vech(A)` (6) by the six entries of D, at D = 0, for `A = B exp(D) B^T` with this root B.
pub(crate) fn shape_jacobian(root: &Matrix3<f64>) -> Matrix6<f64> {
    let mut jacobian = Matrix6::zeros();
    for (k, &(i, j)) in VECH3.iter().enumerate() {
        let (b, c) = (root.column(i), root.column(j));
        let change = if i == j { b * b.transpose() } else { b * c.transpose() + c * b.transpose() };
        jacobian.set_column(k, &vech3(&change));
    }
    jacobian
}

impl EllipsoidModel {
    /// From center and shape matrix; `None` when the shape is not positive definite.
    pub(crate) fn new(center: Vector3<f64>, shape: &Matrix3<f64>) -> Option<Self> {
        let (values, axes) = symmetric_eigen3(shape)?;
        if values[2] <= 0.0 || values[0] > values[2] * MAX_ASPECT * MAX_ASPECT {
            return None;
        }
        Some(Self::from_axes(center, axes, values.map(f64::sqrt)))
    }

    /// From center, orthonormal axes (columns) and semi-axes.
    pub(crate) fn from_axes(center: Vector3<f64>, axes: Matrix3<f64>, semi_axes: Vector3<f64>) -> Self {
        let root_transposed = Matrix3::from_diagonal(&semi_axes) * axes.transpose();
        Self { center, axes, semi_axes, root_transposed }
    }

    /// `B` with `A = B B^T`.
    pub(crate) fn root(&self) -> Matrix3<f64> {
        self.root_transposed.transpose()
    }

    /// The entry of 1/2 log A between two directions, given along the body's axes, and its derivatives times a weight.
    fn log_shape(&self, a: &Vector3<f64>, b: &Vector3<f64>, weight: f64) -> (f64, Row) {
        let log = self.semi_axes.map(f64::ln);
        let mut row = [0.0; 9];
        let mut value = 0.0;
        for i in 0..3 {
            value += a[i] * b[i] * log[i];
            row[STEP_INDEX[i][i]] = 0.5 * weight * a[i] * b[i];
            for j in 0..i {
                row[STEP_INDEX[i][j]] = 0.5 * weight * log_slope(log[i] - log[j]) * (a[i] * b[j] + a[j] * b[i]);
            }
        }
        (value, row)
    }
}

impl BodyModel for EllipsoidModel {
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
        // h^2 = |u|^2 with u = B^T n; dh = u^T D u / (2 h).
        let u = self.root_transposed * n;
        let h = u.norm();
        let v = u / h;
        let w = 0.5 * u;
        (h, [w.x * v.x, u.x * v.y, u.x * v.z, w.y * v.y, u.y * v.z, w.z * v.z])
    }

    fn root_transposed(&self) -> Option<&Matrix3<f64>> {
        Some(&self.root_transposed)
    }

    fn retract(&self, step: &SVector<f64, 9>) -> Option<Self> {
        let half = Matrix3::from_fn(|i, j| 0.5 * step[STEP_INDEX[i][j]]);
        let root = exp_symmetric(&half) * self.root_transposed;
        Self::new(self.center + step.fixed_rows::<3>(0), &(root.transpose() * root))
    }

    fn add_shape_prior(&self, weight: f64, equations: &mut NormalEquations) {
        // W = 1/2 log A without its trace; in the eigenbasis dW_ij = 1/2 kappa_ij D_ij.
        let log = self.semi_axes.map(f64::ln);
        let mean = log.sum() / 3.0;
        for i in 0..3 {
            let mut row = [0.0; 9];
            for k in 0..3 {
                row[STEP_INDEX[k][k]] = 0.5 * weight * (f64::from(i == k) - 1.0 / 3.0);
            }
            equations.add_quadratic(weight * (log[i] - mean), &row);
            for j in 0..i {
                let mut row = [0.0; 9];
                row[STEP_INDEX[i][j]] = std::f64::consts::FRAC_1_SQRT_2 * weight * log_slope(log[i] - log[j]);
                equations.add_quadratic(0.0, &row);
            }
        }
    }

    fn log_shape_along(&self, axes: &Matrix3<f64>) -> Option<[(f64, Row); 6]> {
        let local = self.axes.tr_mul(axes);
        Some([(0, 0), (1, 1), (2, 2), (1, 0), (2, 0), (2, 1)].map(|(i, j)| {
            let factor = if i == j { 1.0 } else { std::f64::consts::SQRT_2 };
            let (value, row) = self.log_shape(&local.column(i).into(), &local.column(j).into(), factor);
            (factor * value, row)
        }))
    }

    fn add_spin_prior(&self, _: &mut NormalEquations) {}

    fn log_axes_gradient(&self) -> [Row; 3] {
        std::array::from_fn(|i| {
            let mut row = [0.0; 9];
            row[STEP_INDEX[i][i]] = 0.5;
            row
        })
    }

    fn near_side(&self, ray: &Vector3<f64>) -> (f64, [f64; 6]) {
        // Half the chord along the ray is (u^T u)^(-1/2) with u = B^-1 ray; the median over the outline is 1 / sqrt(2) of it,
        // where an ellipsoid has half of its outline inside.
        let u = (self.axes.transpose() * ray).component_div(&self.semi_axes);
        let near = std::f64::consts::FRAC_1_SQRT_2 / u.norm();
        let u = u.normalize();
        let [a, b, c] = [u.x, u.y, u.z].map(|x| near * x);
        (near, [0.5 * a * u.x, a * u.y, a * u.z, 0.5 * b * u.y, b * u.z, 0.5 * c * u.z])
    }

    fn compare(&self, measured: &MeasuredShape) -> ShapeDifference {
        let Some(axes) = &measured.axes else {
            let size = |log: Vector3<f64>| size_differences(self, &log, by_length(&self.semi_axes, &log));
            return ShapeDifference { size: measured.log_half_extents.map(size), rotation: None };
        };
        let rows: [Vector3<f64>; 3] = std::array::from_fn(|k| self.axes.transpose() * axes.column(k));
        let size = measured.log_half_extents.map(|log| {
            std::array::from_fn(|k| {
                let (value, row) = self.log_shape(&rows[k], &rows[k], -1.0);
                (log[k] - value, row)
            })
        });
        // Twice the angle by which the box would have to turn about axis i: its tangent is that of twice the entry of 1/2 log A
        // over the difference of those on the diagonal. About half of the sine is taken, which is smooth where axes are equal and
        // the angle means nothing.
        let rotation = std::array::from_fn(|i| {
            let (j, k) = ((i + 1) % 3, (i + 2) % 3);
            let (a, da) = self.log_shape(&rows[j], &rows[k], 1.0);
            let ((first, dfirst), (second, dsecond)) =
                (self.log_shape(&rows[j], &rows[j], 1.0), self.log_shape(&rows[k], &rows[k], 1.0));
            let b = first - second;
            let scale = 1.0 / (4.0 * a * a + b * b + ROUND * ROUND).sqrt();
            let row = std::array::from_fn(|p| {
                let shrinks = a * (4.0 * a * da[p] + b * (dfirst[p] - dsecond[p])) * scale * scale;
                -(da[p] - shrinks) * scale
            });
            (-a * scale, row)
        });
        ShapeDifference { size, rotation: Some(rotation) }
    }

    fn add_upright_prior(&self, up: &Vector3<f64>, weight: f64, equations: &mut NormalEquations) {
        // The two entries of 1/2 log A between `up` and the horizontal: zero when `up` is an axis, and smooth where
        // axes are equal. For a small tilt they are the tilt times the difference of the log semi-axes.
        let vertical = self.axes.transpose() * up;
        for horizontal in horizontal_basis(up) {
            let (residual, row) = self.log_shape(&vertical, &(self.axes.transpose() * horizontal), weight);
            equations.add_quadratic(weight * residual, &row);
        }
    }
}

/// `sqrt(p q) (ln p - ln q) / (p - q)` for p / q = exp(2 difference): the slope of the matrix logarithm between two
/// eigenvalues, relative to their geometric mean.
pub(crate) fn log_slope(difference: f64) -> f64 {
    if difference.abs() < 1e-4 { 1.0 - difference * difference / 6.0 } else { difference / difference.sinh() }
}

/// `exp(S)` of a symmetric 3x3 matrix of moderate size, by scaling and squaring of the Taylor series.
pub(crate) fn exp_symmetric(s: &Matrix3<f64>) -> Matrix3<f64> {
    let scaled = s / 8.0;
    let mut term = scaled;
    let mut sum = Matrix3::identity() + scaled;
    for k in 2..9 {
        term = term * scaled / k as f64;
        sum += term;
    }
    for _ in 0..3 {
        sum = sum * sum;
    }
    sum
}
