//! Gross outliers: hypotheses from three views each, then a redescending loss (docs/method.md, section 8.1).

use nalgebra::Vector3;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::consensus::Consensus;
use super::objective::{MIN_VIEWS, OUTLIER_SCALE, Objective, usual_cost};
use super::starts::{ellipsoid_from_quadric, unit_sphere};
use crate::body_model::BodyModel;
use crate::body_model::ellipsoid::EllipsoidModel;
use crate::optimize::minimize::{Stop, minimize};
use crate::scene::View;
use crate::solve::closed_form::planes::{MIN_PLANES, quadric_tangent_to, tangency_row};
use crate::solve::posterior::noise::groups::NoiseGroup;
use crate::solve::posterior::noise::levels::NoiseLevels;
use crate::solve::posterior::residuals::measurements::Measurements;
use crate::solve::posterior::residuals::row::MIN_DEPTH;
use crate::sorting::StableSort;

/// A view whose squared residual is this many times the median view's makes a plain fit suspect. Gaussian residuals of
/// four edges and 20 views exceed it now and then, so it only asks for a closer look.
const SUSPECT_RATIO: f64 = 4.0;

/// With this ratio the view is an outlier: Gaussian residuals of four edges reach it once in 100,000 views.
const OUTLIER: f64 = 10.0;

/// Number of hypotheses of the second search.
const FIRST_HYPOTHESES: usize = 12;

/// Squared residuals below this are exact data: their ratios say nothing.
const MIN_MEDIAN: f64 = 1e-3;

/// Number of hypotheses.
const HYPOTHESES: usize = 60;

/// Number of refined hypotheses.
const REFINED: usize = 3;

/// Ratio of the maximum to the median squared residual of the views; one with too few views.
fn largest_to_median(view_costs: &[f64]) -> f64 {
    if view_costs.len() < MIN_VIEWS {
        return 1.0;
    }
    let mut sorted = view_costs.to_vec();
    sorted.sort_by(f64::total_cmp);
    sorted[sorted.len() - 1] / sorted[sorted.len() / 2].max(MIN_MEDIAN)
}

/// Searches for gross outliers after a plain fit to all views; returns the fit that the largest number of views agree with
/// best if there are some.
///
/// A plain fit hides outliers, because it follows them. It is suspect when its residuals are uneven, and wrong when a
/// fit to only three views explains the views better than it does, with all the others as wrong boxes ([`Consensus`]).
pub(crate) fn fit_without_outliers(
    objective: &Objective,
    plain: &impl BodyModel,
    views: &[View],
    seed: u64,
) -> Option<EllipsoidModel> {
    if largest_to_median(&objective.view_costs(plain)) < SUSPECT_RATIO {
        return None;
    }
    // Hypotheses are judged by tangent planes, ellipses too: many of them are tried, and planes are quick.
    let tangents = objective.measurements.with_ellipses_as_planes(views);
    let costs = plane_costs(&tangents, plain, objective.noise);
    let (count, ratio) = (costs.len(), largest_to_median(&costs));
    let of_plain = Consensus::of(costs, objective.noise);
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let order = order_of_cameras(&tangents);
    let mut hypotheses = Vec::with_capacity(2 * HYPOTHESES);
    let mut draw = |number: usize, hypotheses: &mut Vec<(Consensus, EllipsoidModel)>| {
        for _ in 0..number {
            let triple = draw_three(count, &mut rng).map(|k| order[k]);
            for body in hypothesis(&tangents, &triple).into_iter().flatten() {
                let costs = plane_costs(&tangents, &body, objective.noise);
                hypotheses.push((Consensus::of(costs, objective.noise), body));
            }
        }
        hypotheses.retain(|(consensus, _)| consensus.score.is_finite());
        hypotheses.stable_sort_by(|a, b| a.0.order(&b.0));
        hypotheses.truncate(REFINED);
    };
    draw(FIRST_HYPOTHESES, &mut hypotheses);
    if ratio < OUTLIER && hypotheses.first().is_none_or(|(consensus, _)| of_plain.order(consensus).is_le()) {
        return None;
    }
    draw(HYPOTHESES - FIRST_HYPOTHESES, &mut hypotheses);
    let noise = objective.noise.scaled(hypotheses.first()?.0.variance.sqrt().clamp(0.01, 10.0));
    let distrustful = Objective { noise: &noise, outlier_scale: Some(OUTLIER_SCALE), ..*objective };
    let stop = Stop { evaluations: 30, min_predicted_decrease: 1e-3 };
    hypotheses
        .into_iter()
        .filter_map(|(_, start)| minimize(start, stop, |body| distrustful.linearize(body), BodyModel::retract))
        .min_by(|a, b| a.1.cost.total_cmp(&b.1.cost))
        .map(|(body, _)| body)
}

/// Squared residuals of each view's tangent planes, as if there were four of them: for boxes the same as
/// [`Objective::view_costs`], without derivatives.
fn plane_costs(tangents: &Measurements, body: &impl BodyModel, noise: &NoiseLevels) -> Vec<f64> {
    let costs = tangents.views.iter().map(|view| {
        let depth = (view.axis.dot(body.center()) + view.offset).max(MIN_DEPTH);
        let inverse = 1.0 / (depth * noise.of(NoiseGroup::Edge) * noise.size_factor(view.half_size));
        let edges = &tangents.edges[view.edges.clone()];
        let squares = edges.iter().map(|edge| {
            let residual = edge.plane.n.dot(body.center()) + edge.plane.d - body.support_gradient(&edge.plane.n).0;
            if edge.one_sided && residual < 0.0 { 0.0 } else { residual * residual }
        });
        usual_cost(squares.sum::<f64>() * inverse * inverse, edges.len())
    });
    costs.collect()
}

/// The views in an order that is the cameras' own, so that draws do not depend on the order of the frames: by where the
/// cameras look, and of those that look the same way by where they are, along a direction in which no rig is built.
fn order_of_cameras(tangents: &Measurements) -> Vec<usize> {
    let direction = Vector3::new(0.618_034, 0.414_214, 0.732_051);
    let places: Vec<(f64, f64)> = tangents.views.iter().map(|view| (view.axis.dot(&direction), view.offset)).collect();
    let mut order: Vec<usize> = (0..places.len()).collect();
    order.stable_sort_by(|&a, &b| places[a].0.total_cmp(&places[b].0).then(places[a].1.total_cmp(&places[b].1)));
    order
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
        let scale = 1.0 / view.offset.abs().max(0.1);
        for pair in tangents.edges[view.edges.clone()].chunks(2) {
            for edge in pair.iter().filter(|edge| !edge.one_sided) {
                let n = edge.plane.n * scale;
                rows.push(tangency_row(&nalgebra::Vector4::new(n.x, n.y, n.z, edge.plane.d * scale)));
            }
            if let [a, b] = pair
                && !a.one_sided
                && !b.one_sided
                && centers < center_rows.len()
            {
                // The plane halfway between the two passes near the center.
                let n = a.plane.n - b.plane.n;
                center_rows[centers] = [n.x, n.y, n.z, a.plane.d - b.plane.d].map(|x| x * scale);
                centers += 1;
            }
        }
    }
    let sphere = sphere_from_middle_planes(&center_rows[..centers]);
    let quadric = (rows.len() >= MIN_PLANES)
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
    fn one_bad_view_among_many_stands_out() {
        let mut costs = vec![3.0; 20];
        assert!(largest_to_median(&costs) < SUSPECT_RATIO);
        costs[7] = 100.0;
        assert!(largest_to_median(&costs) > OUTLIER);
        assert_eq!(largest_to_median(&costs[5..9]), 1.0, "four views are too few to tell");
        assert!(largest_to_median(&[0.0; 8]) < SUSPECT_RATIO, "exact data hold no outliers");
    }
}
