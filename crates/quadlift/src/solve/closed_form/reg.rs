//! The regularized estimator of *3D Pose from Detections* (PfD section 4.1): the closed form's cost plus the distance
//! of the dual quadric from a sphere that is estimated with it.
//!
//! `min |M w|^2 + lambda |v - vech S*(t, a, b)|^2` over `v` with `v_10 = -1`, the betas and the sphere
//! `S* = T diag(a, a, a, -b) T^T`, `a, b > 0`, in pixel coordinates. With v free, the best betas make their equations
//! vanish, so that the first term is `|R v|^2` with the factor R of the module `arrowhead`. For a given sphere v is
//! the solution of a linear problem and can be eliminated as well (ours: the same minimum in a tenth of the
//! iterations). What is left has the five unknowns of the sphere, for Levenberg-Marquardt; logarithms keep `a` and
//! `b` positive.

use nalgebra::{Const, Point3, QR, SMatrix, SVector};

use super::arrowhead::{Arrowhead, PIXEL_ROUNDING};
use super::pfd::{ClosedFormError, pixel_system};
use crate::geometry::{DualQuadric, Ellipse, Projection, VECH4};
use crate::optimize::levenberg_marquardt::{self, Damping, Quadratic, minimize};
use crate::solve::options::RegOptions;
use crate::solve::triangulate::{object_radius, triangulate};

/// Two views suffice: the sphere determines the remaining parameters.
const MIN_VIEWS: usize = 2;

/// Maximum number of steps.
const MAX_STEPS: usize = 400;

/// Relative decrease of the cost below which the iteration has converged.
const MIN_DECREASE: f64 = 1e-11;

/// `(t_1, t_2, t_3, log a, log b)`.
type Sphere = SVector<f64, 5>;
type Residuals = SVector<f64, 11>;
type Jacobian = SMatrix<f64, 11, 5>;

/// A solution of the regularized problem.
#[derive(Debug, Clone, PartialEq)]
pub struct RegSolution {
    /// The dual quadric with `Q*_44 = -1`; it need not be an ellipsoid.
    pub dual_quadric: DualQuadric,
    /// `beta_f` of every view, in the order of the views.
    pub betas: Vec<f64>,
    /// The cost at the solution, `|M w|^2 + lambda |v - vech S*|^2`.
    pub cost: f64,
}

/// The paper's regularized estimator (PfD section 4.1), from two views upwards.
///
/// Starts, as the paper does, from the sphere with the center and the volume of the closed form's quadric. Where
/// the views do not determine that (two views: the best quadric is the pair of camera centers, and the iteration
/// would end near it), it starts from the triangulated sphere.
///
/// Projections map world points to pixels, ellipses are in pixels. The result depends on the world's unit and
/// origin, and lambda on all units: this is the paper's estimator, for comparison.
///
/// # Errors
/// [`ClosedFormError`]; `Degenerate` when no start exists (all views from one point) or a number is not finite.
pub fn reg(observations: &[(Projection, Ellipse)], options: &RegOptions) -> Result<RegSolution, ClosedFormError> {
    if observations.len() < MIN_VIEWS {
        return Err(ClosedFormError::TooFewViews { found: observations.len(), needed: MIN_VIEWS });
    }
    let system = pixel_system(observations);
    let problem = Problem::new(&system, options.lambda);
    let (center, squared_radius) =
        closed_form_sphere(&system).or_else(|| triangulated_sphere(observations)).ok_or(ClosedFormError::Degenerate)?;
    let start = center.coords.push(squared_radius.ln()).push(0.0);
    let found = minimize(&problem, start, MAX_STEPS).ok_or(ClosedFormError::Degenerate)?;
    let v = problem.quadric(&found.state).ok_or(ClosedFormError::Degenerate)?;
    let cost = found.equations.cost;
    Ok(RegSolution { dual_quadric: DualQuadric::from_vech(&v), betas: system.best_betas(&v.into()), cost })
}

/// Center and squared radius of the sphere with the center and the volume of the closed form's quadric.
///
/// The paper's `a = |e1 e2 e3|^(-1/3)` with the eigenvalues `e_i = -det(Q_33)/det(Q) eig(Q_33)` of the scaled primal
/// quadric (section 4.5 corrects the fraction) is `|det A|^(1/3)`, because those are the eigenvalues of `A^-1`. The modulus
/// gives a start even where the quadric is no ellipsoid.
fn closed_form_sphere(system: &Arrowhead) -> Option<(Point3<f64>, f64)> {
    if system.is_degenerate(PIXEL_ROUNDING) {
        return None;
    }
    let v = SVector::from(system.minimize_unit_w()?.v);
    let (center, shape) = DualQuadric::from_vech(&v).center_and_shape()?;
    Some((center, shape.determinant().abs().cbrt())).filter(|(_, a)| a.is_finite() && *a > 0.0)
}

/// Center and squared radius of the triangulated sphere.
fn triangulated_sphere(observations: &[(Projection, Ellipse)]) -> Option<(Point3<f64>, f64)> {
    let centers: Vec<_> = observations.iter().map(|(projection, ellipse)| (*projection, ellipse.center)).collect();
    let center = triangulate(&centers)?;
    let radius = object_radius(observations, &center)?;
    Some((center, radius * radius))
}

/// `vech S*(t, a, b)`.
fn vech_sphere(x: &Sphere) -> SVector<f64, 10> {
    let (t, a, b) = (x.fixed_rows::<3>(0).push(1.0), x[3].exp(), x[4].exp());
    SVector::from_fn(|k, _| {
        let (i, j) = VECH4[k];
        (if i == j && i < 3 { a } else { 0.0 }) - b * t[i] * t[j]
    })
}

/// The derivatives of [`vech_sphere`].
fn vech_sphere_derivatives(x: &Sphere) -> SMatrix<f64, 10, 5> {
    let (t, a, b) = (x.fixed_rows::<3>(0).push(1.0), x[3].exp(), x[4].exp());
    let mut d = SMatrix::zeros();
    for (k, &(i, j)) in VECH4.iter().enumerate() {
        if i < 3 {
            d[(k, i)] -= b * t[j];
        }
        if j < 3 {
            d[(k, j)] -= b * t[i];
        }
        d[(k, 3)] = if i == j && i < 3 { a } else { 0.0 };
        d[(k, 4)] = -b * t[i] * t[j];
    }
    d
}

/// The problem after the elimination of v: for a given sphere, the nine free entries of v solve the linear
/// least-squares problem `[R_9; sqrt(lambda) I] v = [r_10; sqrt(lambda) s_9]`. What its solution leaves over is linear
/// in the vech of the sphere, and 5 unknowns remain.
struct Problem {
    qr: QR<f64, Const<19>, Const<9>>,
    /// The tenth column of R: what `v_10 = -1` contributes.
    last_column: SVector<f64, 10>,
    /// Square root of lambda.
    weight: f64,
}

impl Problem {
    fn new(system: &Arrowhead, lambda: f64) -> Self {
        let r = system.r();
        let weight = lambda.sqrt();
        let mut stacked = SMatrix::<f64, 19, 9>::from_fn(|i, j| if i < 10 { r[i][j] } else { 0.0 });
        stacked.fixed_rows_mut::<9>(10).fill_diagonal(weight);
        Self { qr: stacked.qr(), last_column: SVector::from_fn(|i, _| r[i][9]), weight }
    }

    /// `Q^T [data; sqrt(lambda) s]`: nine entries that v takes up, ten that are left.
    fn split(&self, data: &SVector<f64, 10>, s: &SVector<f64, 10>) -> SVector<f64, 19> {
        let mut right = SVector::<f64, 19>::zeros();
        right.fixed_rows_mut::<10>(0).copy_from(data);
        right.fixed_rows_mut::<9>(10).copy_from(&(s.fixed_rows::<9>(0) * self.weight));
        self.qr.q_tr_mul(&mut right);
        right
    }

    /// The best v for a sphere, with its tenth entry.
    fn quadric(&self, x: &Sphere) -> Option<SVector<f64, 10>> {
        let right = self.split(&self.last_column, &vech_sphere(x)).fixed_rows::<9>(0).into_owned();
        Some(self.qr.r().solve_upper_triangular(&right)?.push(-1.0))
    }

    fn residuals(&self, x: &Sphere) -> Residuals {
        let s = vech_sphere(x);
        self.split(&self.last_column, &s).fixed_rows::<10>(9).push(self.weight * (-1.0 - s[9]))
    }

    fn jacobian(&self, x: &Sphere) -> Jacobian {
        let d = vech_sphere_derivatives(x);
        let mut jacobian = Jacobian::zeros();
        for k in 0..5 {
            let column = d.column(k).into_owned();
            let left = self.split(&SVector::zeros(), &column).fixed_rows::<10>(9).push(-self.weight * column[9]);
            jacobian.set_column(k, &left);
        }
        jacobian
    }
}

/// Residuals with their derivatives by unknowns in units of their own, so that all columns have unit length.
struct Linearized {
    residuals: Residuals,
    jacobian: Jacobian,
    units: Sphere,
    cost: f64,
}

impl Quadratic for Linearized {
    type Step = Sphere;

    fn cost(&self) -> f64 {
        self.cost
    }

    fn step(&self, damping: f64) -> Option<Sphere> {
        Some(damped_step(&self.jacobian, &self.residuals, damping)?.component_mul(&self.units))
    }
}

impl levenberg_marquardt::Problem for Problem {
    type State = Sphere;
    type Equations = Linearized;
    const DAMPING: Damping = Damping { first: 1e-3, taken: 0.2, failed: 6.0, max: 1e12 };

    fn linearize(&self, x: &Sphere) -> Option<Linearized> {
        let residuals = self.residuals(x);
        let mut jacobian = self.jacobian(x);
        let units = Sphere::from_fn(|k, _| 1.0 / jacobian.column(k).norm());
        for k in 0..5 {
            jacobian.column_mut(k).scale_mut(units[k]);
        }
        Some(Linearized { residuals, jacobian, units, cost: residuals.norm_squared() })
    }

    fn retract(&self, x: &Sphere, step: &Sphere) -> Option<Sphere> {
        Some(x + step)
    }

    fn is_last(&self, _: &Sphere, _: &Sphere, before: f64, cost: f64) -> bool {
        before - cost < MIN_DECREASE * before
    }
}

/// The minimizer of `|J s + r|^2 + damping |s|^2`, by QR.
fn damped_step(jacobian: &Jacobian, residuals: &Residuals, damping: f64) -> Option<Sphere> {
    let mut stacked = SMatrix::<f64, 16, 5>::zeros();
    stacked.fixed_rows_mut::<11>(0).copy_from(jacobian);
    stacked.fixed_rows_mut::<5>(11).fill_diagonal(damping.sqrt());
    let mut right = SVector::<f64, 16>::zeros();
    right.fixed_rows_mut::<11>(0).copy_from(&-residuals);
    let qr = stacked.qr();
    qr.q_tr_mul(&mut right);
    qr.r().solve_upper_triangular(&right.fixed_rows::<5>(0).into_owned())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Ellipsoid;
    use nalgebra::{Matrix4, Rotation3, Vector3};

    #[test]
    fn the_start_is_the_papers_with_the_fraction_of_e5() {
        let ellipsoid = Ellipsoid {
            center: Point3::new(1.0, -2.0, 0.5),
            semi_axes: Vector3::new(3.0, 2.0, 0.7),
            rotation: Rotation3::from_euler_angles(0.3, -0.4, 1.0),
        };
        let dual: Matrix4<f64> = ellipsoid.dual_quadric().matrix() * -7.0;
        let primal = dual.try_inverse().unwrap() * 0.3;
        let leading = primal.fixed_view::<3, 3>(0, 0).into_owned();
        let e = leading.symmetric_eigenvalues() * (-leading.determinant() / primal.determinant());
        let paper = e.product().abs().powf(-1.0 / 3.0);
        let (_, shape) = DualQuadric::from_vech(&SVector::from_fn(|k, _| dual[VECH4[k]])).center_and_shape().unwrap();
        assert!((shape.determinant().abs().cbrt() - paper).abs() < 1e-9 * paper);
    }

    #[test]
    fn derivatives_agree_with_differences() {
        let x = Sphere::new(0.7, -1.2, 3.0, 0.9, -0.3);
        let h = 1e-6;
        for k in 0..5 {
            let step = Sphere::ith(k, h);
            let difference = (vech_sphere(&(x + step)) - vech_sphere(&(x - step))) / (2.0 * h);
            assert!((vech_sphere_derivatives(&x).column(k) - difference).amax() < 1e-8);
        }
    }
}
