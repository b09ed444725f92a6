//! Gross outliers: found by hypotheses from three views each, kept out by a redescending loss (E5, ours).

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::super::planes::{FEWEST_PLANES, quadric_tangent_to, tangency_row};
use super::body_model::{BodyModel, EllipsoidModel};
use super::levenberg_marquardt::{Stop, minimise};
use super::measurements::Measurements;
use super::noise::NoiseLevels;
use super::objective::{ObjectPrior, Objective};
use super::starts::{ellipsoid_from_quadric, unit_sphere};

/// Fewest views of which one can be told to be an outlier.
pub(super) const FEWEST_VIEWS: usize = 5;

/// A view whose squared residual is this many times the median view's makes the object suspect. Clean Gaussian
/// residuals of four edges reach 10 in one of 100,000 views.
const SUSPICIOUS_RATIO: f64 = 10.0;

/// Hypotheses drawn.
const HYPOTHESES: usize = 60;

/// Hypotheses that are refined.
const REFINED: usize = 3;

/// Median of the chi-square distribution with four degrees of freedom.
const CHI2_MEDIAN: f64 = 3.357;

/// Whether the residuals of a fit show gross outliers, from the squared residual of each view.
pub(super) fn shows_outliers(view_costs: &[f64]) -> bool {
    if view_costs.len() < FEWEST_VIEWS {
        return false;
    }
    let mut sorted = view_costs.to_vec();
    sorted.sort_by(f64::total_cmp);
    let median = sorted[sorted.len() / 2];
    sorted[sorted.len() - 1] > SUSPICIOUS_RATIO * median.max(1e-8)
}

/// A fit that most of the views agree with, and how much larger or smaller their noise is than `noise`.
///
/// `tangents` holds the tangent planes of the same views (for boxes it is `measurements` itself).
pub(super) fn robust_fit(
    measurements: &Measurements,
    tangents: &Measurements,
    prior: &ObjectPrior,
    noise: &NoiseLevels,
    seed: u64,
) -> Option<EllipsoidModel> {
    let views = measurements.views.len();
    let objective = Objective { measurements, prior, noise, robust: false, smooth: true };
    // With h of the views consistent, the h-th smallest residual is the figure of merit (least median of squares).
    let rank = (views / 2 + 2).min(views) - 1;
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut hypotheses: Vec<(f64, EllipsoidModel)> = Vec::with_capacity(2 * HYPOTHESES);
    for _ in 0..HYPOTHESES {
        let triple = draw_three(views, &mut rng);
        for body in hypothesis(tangents, &triple).into_iter().flatten() {
            let mut costs = objective.view_costs(&body);
            costs.sort_by(f64::total_cmp);
            if costs[rank].is_finite() {
                hypotheses.push((costs[rank], body));
            }
        }
    }
    hypotheses.sort_by(|a, b| a.0.total_cmp(&b.0));
    hypotheses.truncate(REFINED);
    let best = hypotheses.first()?.0;
    // The usual small-sample factor of the least median of squares.
    let factor = (best / CHI2_MEDIAN).sqrt() * (1.0 + 5.0 / (views as f64 - 3.0).max(1.0));
    let scaled = noise.scaled(factor.clamp(0.01, 10.0));
    let objective = Objective { measurements, prior, noise: &scaled, robust: true, smooth: true };
    let stop = Stop { evaluations: 30, promised_decrease: 1e-3 };
    hypotheses
        .into_iter()
        .filter_map(|(_, start)| minimise(start, stop, |body| objective.linearise(body), BodyModel::retract))
        .min_by(|a, b| a.1.cost.total_cmp(&b.1.cost))
        .map(|(body, _)| body)
}

/// Three different indices below `n`.
fn draw_three(n: usize, rng: &mut ChaCha8Rng) -> [usize; 3] {
    let mut triple = [0; 3];
    for k in 0..3 {
        // The k-th draw is from the indices not yet taken.
        let mut index = rng.random_range(0..n - k);
        let mut taken = triple[..k].to_vec();
        taken.sort_unstable();
        for t in taken {
            if index >= t {
                index += 1;
            }
        }
        triple[k] = index;
    }
    triple
}

/// The quadric tangent to the planes of three views, and the sphere that they suggest.
fn hypothesis(tangents: &Measurements, triple: &[usize; 3]) -> [Option<EllipsoidModel>; 2] {
    let mut rows = Vec::with_capacity(48);
    let mut center_rows = [[0.0; 4]; 24];
    let mut centers = 0;
    for &index in triple {
        let view = &tangents.views[index];
        let pairs = tangents.pairs[view.pairs.clone()].iter().flatten();
        let singles = tangents.singles[view.singles.clone()].iter().filter(|s| !s.one_sided).map(|s| &s.plane);
        for plane in pairs.chain(singles) {
            let p = nalgebra::Vector4::new(plane.n.x, plane.n.y, plane.n.z, plane.d);
            rows.push(tangency_row(&(p / view.offset.abs().max(0.1))));
        }
        for [a, b] in &tangents.pairs[view.pairs.clone()] {
            // The plane halfway between the two passes near the centre.
            if centers < center_rows.len() {
                let n = a.n - b.n;
                center_rows[centers] = [n.x, n.y, n.z, a.d - b.d].map(|x| x / view.offset.abs().max(0.1));
                centers += 1;
            }
        }
    }
    let sphere = sphere_from_middle_planes(&center_rows[..centers]);
    let quadric = (rows.len() >= FEWEST_PLANES)
        .then(|| quadric_tangent_to(&mut rows))
        .flatten()
        .and_then(|quadric| ellipsoid_from_quadric(&quadric));
    [sphere, quadric]
}

/// The unit sphere about the point where the middle planes meet.
fn sphere_from_middle_planes(rows: &[[f64; 4]]) -> Option<EllipsoidModel> {
    let mut normal = nalgebra::Matrix3::zeros();
    let mut right = nalgebra::Vector3::zeros();
    for row in rows {
        let n = nalgebra::Vector3::new(row[0], row[1], row[2]);
        normal += n * n.transpose();
        right -= n * row[3];
    }
    let center = crate::geometry::linalg::solve_spd(&normal, &right)?;
    Some(unit_sphere(center))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn draws_are_different_and_cover_all() {
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let mut seen = [false; 6];
        for _ in 0..200 {
            let [a, b, c] = draw_three(6, &mut rng);
            assert!(a != b && b != c && a != c && a.max(b).max(c) < 6);
            (seen[a], seen[b], seen[c]) = (true, true, true);
        }
        assert!(seen.iter().all(|s| *s));
    }

    #[test]
    fn one_bad_view_among_many_is_suspicious() {
        let mut costs = vec![3.0; 20];
        assert!(!shows_outliers(&costs));
        costs[7] = 100.0;
        assert!(shows_outliers(&costs));
        assert!(!shows_outliers(&costs[5..9]), "four views are too few to tell");
    }
}
