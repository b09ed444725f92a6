//! Priors of a body: proportions, place and size, and the tilt of upright ones (docs/method.md).

use nalgebra::{Matrix2, Vector2, Vector3};

use super::solid::{Family, Solid, Step};
use crate::body_model::ellipsoid::log_slope;
use crate::geometry::rotation::horizontal_basis;
use crate::solve::estimate::Matrix9;

/// Standard deviation of the tilt of upright bodies, radians.
pub(super) const TILT_SD: f64 = 0.05;

/// Difference of the logarithms of two axes below which neither shows. Recipe: of .05 and .1 both keep ellipsoids of any rotation from being
/// called upright (.1 to .2 of them in 20 views, .4 without); .05 loses some of those that are (.73 to .78 of them in six views, .73 to .88).
const ROUND: f64 = 0.1;

/// Precision of the center, and of the mean logarithm of the half extents, in units of the first sphere: 30 radii, a factor of e^2.
/// They keep the normal equations positive definite where the boxes leave something open.
const CENTER_PRECISION: f64 = 1.0 / 900.0;
const SIZE_PRECISION: f64 = 0.25;

/// Squared residuals, normal equations and gradient of the priors.
pub(super) struct PriorTerms {
    pub cost: f64,
    pub hessian: Matrix9,
    pub gradient: Step,
}

impl PriorTerms {
    fn add(&mut self, row: &Step, residual: f64, precision: f64) {
        self.cost += precision * residual * residual;
        self.gradient += row * (precision * residual);
        self.hessian += row * row.transpose() * precision;
    }
}

/// The priors at the body; `shape_sd` is the standard deviation of the logarithms of half extents about their mean.
pub(super) fn prior(body: &Solid, shape_sd: f64) -> PriorTerms {
    let mut terms = PriorTerms { cost: 0.0, hessian: Matrix9::zeros(), gradient: Step::zeros() };
    for k in 0..3 {
        terms.hessian[(k, k)] = CENTER_PRECISION;
        terms.gradient[k] = CENTER_PRECISION * body.center[k];
    }
    terms.cost = CENTER_PRECISION * body.center.norm_squared();
    let logs = body.half_extents.map(f64::ln);
    let mean = logs.mean();
    let by_mean = match body.family {
        Family::Cylinder => [2.0 / 3.0, 0.0, 1.0 / 3.0],
        Family::Ellipsoid => [1.0 / 6.0; 3],
        Family::Rounded | Family::Cuboid => [1.0 / 3.0; 3],
    };
    terms.add(&row(6, &by_mean), mean, SIZE_PRECISION);
    let precision = 1.0 / (shape_sd * shape_sd);
    match body.family {
        Family::Cylinder => {
            terms.add(&row(6, &[1.0, 0.0, -1.0]), logs[0] - logs[2], 2.0 / 3.0 * precision);
            // No rotation about the axis, one radius.
            terms.hessian[(5, 5)] += 1.0;
            terms.hessian[(7, 7)] += 1.0;
        }
        Family::Ellipsoid => add_ellipsoid_shape(&mut terms, &logs, mean, precision),
        Family::Rounded | Family::Cuboid => add_shape(&mut terms, &logs, mean, precision, 1.0),
    }
    if let (Some(up), Some(in_body)) = (body.up, body.up_in_body()) {
        if body.family == Family::Ellipsoid {
            add_ellipsoid_tilt(body, &mut terms, &up, &in_body, &logs);
        } else {
            add_tilt(body, &mut terms, &in_body);
        }
    }
    terms
}

/// An entry of D off the diagonal turns two axes: the shape changes by it the less the more they differ.
fn add_ellipsoid_shape(terms: &mut PriorTerms, logs: &Vector3<f64>, mean: f64, precision: f64) {
    add_shape(terms, logs, mean, precision, 0.5);
    for (k, kappa) in kappas(logs).into_iter().enumerate() {
        terms.hessian[(3 + k, 3 + k)] += 0.5 * kappa * kappa * precision;
    }
}

/// The tilt of an axis from the vertical, as an ellipsoid shows it: with the entries m of `L = ln B` between `up` and the horizontal, and
/// M the difference of `L` along `up` and its horizontal block, a small tilt t makes `m = M t`. Its estimate `(M^2 + x^2)^(-1/2) m` is the
/// tilt where axes differ by more than x, and vanishes with their difference, so that round bodies are upright at no cost.
fn add_ellipsoid_tilt(
    body: &Solid,
    terms: &mut PriorTerms,
    up: &Vector3<f64>,
    in_body: &Vector3<f64>,
    logs: &Vector3<f64>,
) {
    let level = horizontal_basis(up).map(|horizontal| body.axes.tr_mul(&horizontal));
    let kappas = kappas(logs);
    let entry = |a: &Vector3<f64>, b: &Vector3<f64>| logs.component_mul(a).dot(b);
    let slopes = |a: &Vector3<f64>, b: &Vector3<f64>| {
        let mut slopes = Step::zeros();
        for k in 0..3 {
            let (i, j) = ((k + 1) % 3, (k + 2) % 3);
            slopes[3 + k] = 0.5 * kappas[k] * (a[i] * b[j] + a[j] * b[i]);
            slopes[6 + k] = 0.5 * a[k] * b[k];
        }
        slopes
    };
    let [x, y] = &level;
    let across = Matrix2::new(entry(x, x), entry(x, y), entry(x, y), entry(y, y));
    let difference = Matrix2::identity() * entry(in_body, in_body) - across;
    let squared = difference * difference + Matrix2::identity() * (ROUND * ROUND);
    let Some(inverse) = squared.try_inverse() else { return };
    let off_axis = Vector2::new(entry(in_body, x), entry(in_body, y));
    let off_slopes = [slopes(in_body, x), slopes(in_body, y)];
    let precision = 1.0 / (TILT_SD * TILT_SD);
    let through = inverse * off_axis;
    terms.cost += precision * off_axis.dot(&through);
    for a in 0..2 {
        terms.gradient += off_slopes[a] * (precision * through[a]);
        for b in 0..2 {
            terms.hessian += off_slopes[a] * off_slopes[b].transpose() * (precision * inverse[(a, b)]);
        }
    }
    // The scale of the tilt changes with the axes.
    let by_difference = difference * through;
    terms.gradient -= slopes(in_body, in_body) * (precision * by_difference.dot(&through));
    for a in 0..2 {
        for b in 0..2 {
            terms.gradient += slopes(&level[a], &level[b]) * (precision * by_difference[a] * through[b]);
        }
    }
}

/// Components of `up` along the axes that are level: r_i' = r_i + w x r_i.
fn add_tilt(body: &Solid, terms: &mut PriorTerms, u: &Vector3<f64>) {
    let by_x = row(3, &[0.0, -u.z, u.y]);
    let by_y = row(3, &[u.z, 0.0, -u.x]);
    let by_z = row(3, &[-u.y, u.x, 0.0]);
    let precision = 1.0 / (TILT_SD * TILT_SD);
    if body.is_level_cylinder() {
        terms.add(&by_z, u.z, precision);
    } else {
        terms.add(&by_x, u.x, precision);
        terms.add(&by_y, u.y, precision);
    }
}

/// A row with three entries from `first` on.
fn row(first: usize, entries: &[f64; 3]) -> Step {
    let mut row = Step::zeros();
    (0..3).for_each(|k| row[first + k] = entries[k]);
    row
}

/// `sum (ln a_i - mean)^2`, where a step changes each logarithm by `slope` times its entry.
fn add_shape(terms: &mut PriorTerms, logs: &Vector3<f64>, mean: f64, precision: f64, slope: f64) {
    for i in 0..3 {
        terms.cost += precision * (logs[i] - mean).powi(2);
        terms.gradient[6 + i] += slope * precision * (logs[i] - mean);
        for j in 0..3 {
            let centered = if i == j { 2.0 / 3.0 } else { -1.0 / 3.0 };
            terms.hessian[(6 + i, 6 + j)] += slope * slope * precision * centered;
        }
    }
}

/// x / sinh x of the difference of the other two logarithms, for each axis.
fn kappas(logs: &Vector3<f64>) -> [f64; 3] {
    std::array::from_fn(|k| log_slope(logs[(k + 1) % 3] - logs[(k + 2) % 3]))
}

#[cfg(test)]
mod tests {
    use nalgebra::{Matrix3, Rotation3};

    use super::*;
    use crate::optimize::normal_equations::PARAMETERS;

    #[test]
    fn gradients_of_priors_are_those_of_differences() {
        let up = Vector3::new(0.3, -0.5, 0.8).normalize();
        let turned: Matrix3<f64> = *Rotation3::from_euler_angles(0.4, -0.6, 0.5).matrix();
        let [x, y] = horizontal_basis(&up);
        let level = Matrix3::from_columns(&[y.cross(&x), up, x]);
        let level = level * Rotation3::new(Vector3::new(0.1, 0.05, 0.2)).matrix();
        for (family, axes) in Family::ALL.into_iter().map(|f| (f, turned)).chain([(Family::Cylinder, level)]) {
            for up in [None, Some(up)] {
                let half_extents =
                    if family == Family::Cylinder { Vector3::new(1.1, 1.1, 0.7) } else { Vector3::new(1.3, 0.8, 0.6) };
                let center = Vector3::new(0.1, 0.2, -0.3);
                let body = Solid { family, center, axes, half_extents, cuboid_share: 0.4, up };
                let gradient = prior(&body, 0.4).gradient;
                for k in (0..PARAMETERS).filter(|&k| family != Family::Cylinder || k != 7) {
                    let mut step = Step::zeros();
                    step[k] = 1e-5;
                    let cost = |step: &Step| prior(&body.moved(step), 0.4).cost;
                    let difference = (cost(&step) - cost(&-step)) / 4e-5;
                    let error = (difference - gradient[k]).abs();
                    assert!(error < 1e-3 * (1.0 + difference.abs()), "{family:?} {k}: {difference} {}", gradient[k]);
                }
            }
        }
    }
}
