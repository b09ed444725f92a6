//! Bodies as nine numbers that can be moved a little: position, and what the support function needs.
//!
//! Everything is in the object's frame (see [`super::super::conditioning`]): lengths are about one.

use nalgebra::{Matrix3, Rotation3, SVector, Vector3};

use super::normal_equations::{NormalEquations, Row};
use crate::geometry::{linalg::symmetric_eigen3, skew};

/// Largest ratio of the longest to the shortest semi-axis that a step may reach.
const LARGEST_ASPECT: f64 = 1e6;

/// A body that the solver can fit.
pub(crate) trait BodyModel: Clone + Send + Sync {
    /// Centre.
    fn center(&self) -> &Vector3<f64>;
    /// Semi-axes, in the model's own order.
    fn semi_axes(&self) -> Vector3<f64>;
    /// The axes as columns.
    fn axes(&self) -> &Matrix3<f64>;
    /// Support function and its derivatives by the six shape parameters (3 to 8).
    fn support_gradient(&self, n: &Vector3<f64>) -> (f64, [f64; 6]);
    /// `B^T` with the shape matrix `A = B B^T`, for bodies whose outline is an ellipse.
    fn root_transposed(&self) -> Option<&Matrix3<f64>>;
    /// The body after a step: three of position, six of shape; `None` when it is not a sensible body any more.
    fn retract(&self, step: &SVector<f64, 9>) -> Option<Self>;
    /// Adds the prior on the deviation of the log semi-axes from their mean, weight 1/sd.
    fn add_shape_prior(&self, weight: f64, equations: &mut NormalEquations);
    /// Derivatives of the logarithms of the three semi-axes by the parameters.
    fn log_axes_gradient(&self) -> [Row; 3];
    /// Adds the prior that an axis of the body stands along `up` (unit vector), weight 1/sd (radians).
    fn add_upright_prior(&self, up: &Vector3<f64>, weight: f64, equations: &mut NormalEquations);
}

/// An ellipsoid: `A <- B exp(D) B^T` with `A = B B^T`, D symmetric (E5): no singularity at spheres, no order of axes.
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

/// Entry of the parameter vector for each entry (i, j), i >= j, of the symmetric step D.
const STEP_INDEX: [[usize; 3]; 3] = [[3, 4, 5], [4, 6, 7], [5, 7, 8]];

impl EllipsoidModel {
    /// From centre and shape matrix; `None` when the shape is not positive definite.
    pub(crate) fn new(center: Vector3<f64>, shape: &Matrix3<f64>) -> Option<Self> {
        let (values, axes) = symmetric_eigen3(shape)?;
        if values[2] <= 0.0 || values[0] > values[2] * LARGEST_ASPECT * LARGEST_ASPECT {
            return None;
        }
        Some(Self::from_axes(center, axes, values.map(f64::sqrt)))
    }

    /// From centre, orthonormal axes (columns) and semi-axes.
    pub(super) fn from_axes(center: Vector3<f64>, axes: Matrix3<f64>, semi_axes: Vector3<f64>) -> Self {
        let root_transposed = Matrix3::from_diagonal(&semi_axes) * axes.transpose();
        Self { center, axes, semi_axes, root_transposed }
    }

    /// `B` with `A = B B^T`.
    pub(crate) fn root(&self) -> Matrix3<f64> {
        self.root_transposed.transpose()
    }

    /// Derivative of `vech(A)` (6) by the six entries of D, at D = 0.
    pub(super) fn shape_jacobian(&self) -> nalgebra::SMatrix<f64, 6, 6> {
        let root = self.root();
        let mut jacobian = nalgebra::SMatrix::<f64, 6, 6>::zeros();
        for (k, &(i, j)) in crate::geometry::VECH3.iter().enumerate() {
            let (b, c) = (root.column(i), root.column(j));
            let change = if i == j { b * b.transpose() } else { b * c.transpose() + c * b.transpose() };
            jacobian.set_column(k, &crate::geometry::vech3(&change));
        }
        jacobian
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

    fn log_axes_gradient(&self) -> [Row; 3] {
        std::array::from_fn(|i| {
            let mut row = [0.0; 9];
            row[STEP_INDEX[i][i]] = 0.5;
            row
        })
    }

    fn add_upright_prior(&self, up: &Vector3<f64>, weight: f64, equations: &mut NormalEquations) {
        // The two entries of 1/2 log A between `up` and the horizontal: zero when `up` is an axis, and smooth where
        // axes are equal. For a small tilt they are the tilt times the difference of the log semi-axes.
        let log = self.semi_axes.map(f64::ln);
        let vertical = self.axes.transpose() * up;
        for horizontal in horizontal_basis(up) {
            let h = self.axes.transpose() * horizontal;
            let mut row = [0.0; 9];
            let mut residual = 0.0;
            for i in 0..3 {
                residual += vertical[i] * h[i] * log[i];
                row[STEP_INDEX[i][i]] = 0.5 * weight * vertical[i] * h[i];
                for j in 0..i {
                    row[STEP_INDEX[i][j]] =
                        0.5 * weight * log_slope(log[i] - log[j]) * (vertical[i] * h[j] + vertical[j] * h[i]);
                }
            }
            equations.add_quadratic(weight * residual, &row);
        }
    }
}

/// `sqrt(p q) (ln p - ln q) / (p - q)` for p / q = exp(2 difference): the slope of the matrix logarithm between two
/// eigenvalues, relative to their geometric mean.
fn log_slope(difference: f64) -> f64 {
    if difference.abs() < 1e-4 { 1.0 - difference * difference / 6.0 } else { difference / difference.sinh() }
}

/// Two unit vectors that span the plane orthogonal to `up`.
pub(super) fn horizontal_basis(up: &Vector3<f64>) -> [Vector3<f64>; 2] {
    let away = if up.z.abs() < 0.9 { Vector3::z() } else { Vector3::x() };
    let first = up.cross(&away).normalize();
    [first, up.cross(&first)]
}

/// `exp(S)` of a symmetric 3x3 matrix of moderate size, by scaling and squaring of the Taylor series.
fn exp_symmetric(s: &Matrix3<f64>) -> Matrix3<f64> {
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

/// The support function of an oriented body, of `u` in the frame of its axes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Form {
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
pub(super) struct OrientedModel {
    center: Vector3<f64>,
    axes: Matrix3<f64>,
    semi_axes: Vector3<f64>,
    form: Form,
}

impl OrientedModel {
    pub(super) fn new(center: Vector3<f64>, axes: Matrix3<f64>, semi_axes: Vector3<f64>, form: Form) -> Self {
        Self { center, axes, semi_axes, form }
    }

    /// Form of the support function.
    pub(super) fn form(&self) -> Form {
        self.form
    }
}

impl Form {
    /// Semi-axes of a body relative to those of the ellipsoid that touches about the same planes: 1 / 1.4 for a cuboid, 1
    /// for the ellipsoid itself, in between for a cylinder.
    pub(super) fn relative_size(self) -> f64 {
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
