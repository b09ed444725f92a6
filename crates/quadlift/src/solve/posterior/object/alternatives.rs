//! Alternatives: other bodies of the same kind that fit the measurements of an object about as well (docs/method.md, section 12.5).
//!
//! Boxes seen over a quarter of a circle or less often fit a cuboid in two orientations, and noise decides which one
//! fits better. The starts of the first fit are refined again under the final noise levels; other minima that are not
//! much less probable are reported.

use crate::tuning::MIN_LOG_ODDS;
use nalgebra::{Matrix3, Rotation3, Vector3};

use super::agreement::Reference;
use super::covariance::log_determinant_of;
use super::first_fit::TURNED_STARTS;
use super::fit::{FINAL_TERMINATION, Fit};
use super::model::Model;
use crate::body_model::BodyModel;
use crate::geometry::{Body, ConvexBody, rotation_vector};
use crate::optimize::minimize::minimize;
use crate::optimize::normal_equations::NormalEquations;
use crate::solve::estimate::{Alternative, Covariance, CovarianceCoordinates, Estimate, Warning};
use crate::solve::posterior::context::PosteriorContext;
use crate::solve::posterior::noise::levels::NoiseLevels;
use crate::solve::posterior::shared::SharedErrors;
use crate::sorting::StableSort;

/// Maximum number of alternatives that are refined and reported.
pub(crate) const MAX_ALTERNATIVES: usize = 3;

/// Two bodies are different alternatives if their surfaces differ by this fraction of the mean semi-axis somewhere: a
/// few per cent of noise change a single body by less.
const MIN_SURFACE_DIFFERENCE: f64 = 0.2;

/// A start whose cost is higher by this after its first steps is not refined: the remaining steps rarely reduce it by
/// as much.
const MAX_COST_GAP: f64 = 20.0;

/// Log odds above which an alternative replaces the fit: 150 to 1. Between that and even odds the fit is kept, so that
/// similar scenes have the same result.
const MIN_SWAP_LOG_ODDS: f64 = 5.0;

/// How often an alternative may replace the fit.
const MAX_SWAPS: usize = 8;

/// The minimum of another answer, in the object's frame.
struct Other {
    model: Model,
    equations: NormalEquations,
}

impl Fit {
    /// Adds the other answers to the estimate of this fit: bodies, a warning, and the spread between the answers to the
    /// covariance.
    pub(crate) fn with_alternatives(
        &self,
        mut estimate: Estimate,
        noise: &NoiseLevels,
        reference: Reference,
        shared: SharedErrors,
        swaps: usize,
        context: &PosteriorContext,
    ) -> Estimate {
        let Some(body) = estimate.body.filter(|_| self.problem.has_several_starts()) else { return estimate };
        let found = self.alternatives(&body, noise);
        if let Some((_, Other { model, equations })) =
            found.first().filter(|(found, _)| found.log_odds > MIN_SWAP_LOG_ODDS && swaps < MAX_SWAPS)
        {
            // The rounds ended in a worse minimum. The odds grow with each step, but for priors with kinks (learned sizes), whose
            // determinant does not tell them.
            let better = Self { body: model.clone(), equations: *equations, converged: true, ..self.clone() };
            return better.estimate_after(noise, reference, shared, swaps + 1, context);
        }
        let found: Vec<Alternative> = found.into_iter().map(|(found, _)| found).collect();
        let Some(most_probable) = found.first() else { return estimate };
        estimate.warnings.push(Warning::Ambiguous { log_odds: most_probable.log_odds });
        if let Some(covariance) = &mut estimate.covariance {
            add_spread(covariance, &body, &found);
        }
        estimate.alternatives = found;
        estimate
    }

    /// Other minima that are not much less probable than the fit, the most probable first.
    fn alternatives(&self, body: &Body, noise: &NoiseLevels) -> Vec<(Alternative, Other)> {
        let objective = self.objective(noise, self.outlier_scale);
        let descend = |start: Model, stop| minimize(start, stop, |body| objective.linearize(body), BodyModel::retract);
        let Some((_, best)) = descend(self.body.clone(), FINAL_TERMINATION) else { return Vec::new() };
        let frame = &self.problem.measurements.frame;
        let evidence = |end: &NormalEquations| Some(-0.5 * (end.cost + log_determinant_of(end)?));
        let Some(own) = evidence(&best) else { return Vec::new() };
        let mut found: Vec<(Alternative, Other)> = Vec::new();
        for (start, screened) in self.problem.screened(&self.ellipsoid, noise, self.outlier_scale, 0, TURNED_STARTS) {
            if found.len() == MAX_ALTERNATIVES || screened.cost > best.cost + MAX_COST_GAP {
                break;
            }
            let known: Vec<Body> = std::iter::once(*body).chain(found.iter().map(|(other, _)| other.body)).collect();
            let axes = frame.axes;
            let is_new = |model: &Model| {
                let other = model.body_in_world(frame);
                known.iter().all(|one| are_different(one, &other, &axes)).then_some(other)
            };
            if is_new(&start).is_none() {
                continue;
            }
            let Some((model, equations)) = descend(start, FINAL_TERMINATION) else { continue };
            let Some(log_odds) = evidence(&equations).map(|other| other - own) else { continue };
            if let Some(body) = is_new(&model).filter(|_| log_odds > MIN_LOG_ODDS.get()) {
                found.push((Alternative { body, log_odds }, Other { model, equations }));
            }
        }
        found.stable_sort_by(|(a, _), (b, _)| b.log_odds.total_cmp(&a.log_odds));
        found
    }
}

/// Whether the surfaces of two bodies differ by more than [`MIN_SURFACE_DIFFERENCE`], seen from 26 directions between these axes. Where the symmetry of a
/// cuboid gives the same body other axes the surfaces are the same.
pub(crate) fn are_different(a: &Body, b: &Body, axes: &Matrix3<f64>) -> bool {
    let size = a.half_extents.product().cbrt();
    let shift = b.center() - a.center();
    (0..27).any(|k| {
        let direction = Vector3::new(k % 3, k / 3 % 3, k / 9).map(|x| f64::from(x - 1));
        (axes * direction)
            .try_normalize(0.0)
            .is_some_and(|n| (n.dot(&shift) + b.support(&n) - a.support(&n)).abs() > MIN_SURFACE_DIFFERENCE * size)
    })
}

/// The covariance of the mixture about the reported body: its own, and the squared distances of the alternatives, each
/// with its probability. All are assumed to have the same covariance.
fn add_spread(covariance: &mut Covariance, body: &Body, others: &[Alternative]) {
    if covariance.coordinates != CovarianceCoordinates::CenterRotationLogAxes {
        return;
    }
    let total = 1.0 + others.iter().map(|other| other.log_odds.exp()).sum::<f64>();
    for other in others {
        let difference = difference(body, &other.body);
        covariance.matrix += difference * difference.transpose() * (other.log_odds.exp() / total);
    }
}

/// From one body to another in the coordinates of the covariance: center, rotation vector, logarithms of the semi-axes.
/// Of the 24 ways to name the axes of the other body the one with the smallest rotation.
fn difference(from: &Body, to: &Body) -> nalgebra::SVector<f64, 9> {
    let (from_axes, from_sizes) = axes_of(from);
    let (to_axes, to_sizes) = axes_of(to);
    let turn = from_axes.transpose() * to_axes;
    let best = symmetries().into_iter().max_by(|a, b| (turn * a).trace().total_cmp(&(turn * b).trace()));
    let symmetry = best.unwrap_or_else(Matrix3::identity);
    let angles = rotation_vector(&Rotation3::from_matrix_unchecked(turn * symmetry));
    let sizes = symmetry.map(f64::abs).transpose() * to_sizes;
    let mut difference = nalgebra::SVector::<f64, 9>::zeros();
    difference.fixed_rows_mut::<3>(0).copy_from(&(to.center() - from.center()));
    difference.fixed_rows_mut::<3>(3).copy_from(&angles);
    difference.fixed_rows_mut::<3>(6).copy_from(&sizes.zip_map(&from_sizes, |a, b| (a / b).ln()));
    difference
}

fn axes_of(body: &Body) -> (Matrix3<f64>, Vector3<f64>) {
    (*body.rotation.matrix(), body.half_extents)
}

/// The 24 rotations of a cube: which axis of the body gets which name and direction.
pub(crate) fn symmetries() -> Vec<Matrix3<f64>> {
    let signs = [1.0, -1.0];
    let axis = |k: usize, sign: f64| Vector3::from_fn(|i, _| if i == k { sign } else { 0.0 });
    let mut all = Vec::with_capacity(24);
    for (i, j) in [(0, 1), (0, 2), (1, 0), (1, 2), (2, 0), (2, 1)] {
        for (a, b) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
            let (x, y) = (axis(i, signs[a]), axis(j, signs[b]));
            all.push(Matrix3::from_columns(&[x, y, x.cross(&y)]));
        }
    }
    all
}

#[cfg(test)]
mod tests {
    use nalgebra::Point3;

    use super::*;
    use crate::geometry::{Body, BodyKind};

    fn cuboid(yaw: f64, half_extents: [f64; 3]) -> Body {
        let rotation = Rotation3::from_axis_angle(&Vector3::z_axis(), yaw);
        Body { kind: BodyKind::Cuboid, center: Point3::new(1.0, 2.0, 3.0), half_extents: half_extents.into(), rotation }
    }

    #[test]
    fn the_same_cuboid_with_other_axes_is_no_other_answer() {
        let quarter = std::f64::consts::FRAC_PI_2;
        let (one, same) = (cuboid(0.3, [2.0, 1.0, 0.5]), cuboid(0.3 + quarter, [1.0, 2.0, 0.5]));
        assert!(!are_different(&one, &same, &Matrix3::identity()));
        assert!(difference(&one, &same).amax() < 1e-12);
        let other = cuboid(0.3 + quarter + 0.4, [1.0, 2.5, 0.5]);
        assert!(are_different(&one, &other, &Matrix3::identity()));
        let difference = difference(&one, &other);
        assert!((difference[5] - 0.4).abs() < 1e-12 && (difference[6] - 1.25f64.ln()).abs() < 1e-12, "{difference}");
    }

    #[test]
    fn the_names_of_axes_form_a_group_of_24_rotations() {
        let all = symmetries();
        assert_eq!(all.len(), 24);
        for (k, a) in all.iter().enumerate() {
            assert!((a.determinant() - 1.0).abs() < 1e-12);
            assert!(all[..k].iter().all(|b| (a - b).amax() > 0.5));
        }
    }

    #[test]
    fn the_spread_between_two_equal_answers_is_half_their_squared_distance() {
        let (one, other) = (cuboid(0.0, [2.0, 1.0, 0.5]), cuboid(0.6, [2.0, 1.0, 0.5]));
        let mut covariance = Covariance {
            coordinates: CovarianceCoordinates::CenterRotationLogAxes,
            matrix: crate::solve::Matrix9::identity() * 0.01,
        };
        add_spread(&mut covariance, &one, &[Alternative { body: other, log_odds: 0.0 }]);
        assert!((covariance.matrix[(5, 5)] - (0.01 + 0.5 * 0.36)).abs() < 1e-12);
        assert!((covariance.matrix[(4, 4)] - 0.01).abs() < 1e-12);
    }
}
