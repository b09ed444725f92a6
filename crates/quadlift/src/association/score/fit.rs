//! The most probable ellipsoid for a set of boxes: fast, for many candidate sets.
//!
//! It shares with the estimator ([`crate::solve::posterior`]) what is the same mathematics: bodies and their distance to a tangent
//! plane, Student's t, the shape prior, normal equations and Levenberg-Marquardt. The sum over the boxes is its own, because the
//! two differ in every term:
//!
//! - The estimator has groups of noise levels, weights for the correlation of an object's views, a loss over whole views, and
//!   ellipses. Here there is one level and independent views: whether a box belongs to the object is decided outside of the fit.
//! - Here depth is held while derivatives are taken, and a body behind a camera ends the fit, which only ranks sets of boxes. The
//!   estimator differentiates by depth, and clamps it to get away from behind a camera.
//! - The prior on size is one of the mean log semi-axis here, because it is learned from the scene. The estimator's has length,
//!   width and height of a category.
//! - The constants are wider here (`STUDENT_T_DOF` 5 and not 9, [`SHAPE_SD`] 0.5 and not 0.4): sets of boxes hold wrong ones,
//!   and few boxes say little about shapes.
//!
//! An objective for both would branch on all of these for every edge, in the innermost loop of association.

use nalgebra::{Matrix3, SMatrix, Vector3};

use super::object::{Object, edge_planes};
use super::scene_statistics::SceneStatistics;
use crate::association::input::observations::Observations;
use crate::association::statistics::EDGE_LIKELIHOOD;
use crate::body_model::BodyModel;
use crate::body_model::ellipsoid::EllipsoidModel;
use crate::geometry::linalg::{cholesky, invert_spd};
use crate::optimize::minimize::{Stop, minimize};
use crate::optimize::normal_equations::NormalEquations;

/// Standard deviation of the deviation of log semi-axes from their mean. Wider than that of the estimators (0.4):
/// bodies are compared here by few boxes. Not swept.
pub(crate) const SHAPE_SD: f64 = 0.5;

const STOP: Stop = Stop { evaluations: 40, min_predicted_decrease: 1e-3 };

/// The start of a fit.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Start {
    /// Center.
    pub center: Vector3<f64>,
    /// `B` with the shape matrix `A = B B^T`.
    pub root: Matrix3<f64>,
}

impl Start {
    /// A sphere.
    pub(crate) fn sphere(center: Vector3<f64>, radius: f64) -> Self {
        Self { center, root: Matrix3::identity() * radius }
    }

    /// The body of an object.
    pub(crate) fn body(object: &Object) -> Self {
        Self { center: object.center, root: object.root }
    }
}

/// One edge in the frame of the fit.
struct Edge {
    normal: Vector3<f64>,
    offset: f64,
    one_sided: bool,
}

/// A box in the frame of the fit.
struct Measured {
    edges: [Edge; 4],
    /// Depth is `depth_normal . x + depth_offset`.
    depth_normal: Vector3<f64>,
    depth_offset: f64,
    inverse_sd: f64,
}

/// Fits an ellipsoid to boxes (ascending indices, one per frame) from the best of some starts; `visible` and the
/// trusted id of the object are left to the caller. `None` when no start can be followed.
pub(crate) fn fit(
    observations: &Observations,
    statistics: &SceneStatistics,
    boxes: Vec<u32>,
    starts: &[Start],
) -> Option<Object> {
    let category = majority_category(observations, &boxes);
    let best = starts
        .iter()
        .filter_map(|start| follow(observations, statistics, &boxes, category, start))
        .min_by(|a, b| a.cost.total_cmp(&b.cost))?;
    Some(Object { visible: boxes.len(), boxes, ..best })
}

/// The most frequent category of the boxes, the first one of ties.
fn majority_category(observations: &Observations, boxes: &[u32]) -> usize {
    let categories = observations.categories.len();
    if categories <= 1 {
        return 0;
    }
    let mut counts = vec![0usize; categories];
    for &index in boxes {
        counts[observations.boxes[index as usize].category] += 1;
    }
    let most = counts.iter().copied().max();
    counts.iter().position(|&n| Some(n) == most).unwrap_or(0)
}

/// Follows one start to its minimum, in coordinates in which the start is about a unit sphere at the origin.
fn follow(
    observations: &Observations,
    statistics: &SceneStatistics,
    boxes: &[u32],
    category: usize,
    start: &Start,
) -> Option<Object> {
    let unit = start.root.determinant().abs().cbrt();
    if !(unit.is_finite() && unit > 0.0) {
        return None;
    }
    let measured: Vec<Measured> =
        boxes.iter().map(|&index| measure(observations, statistics, index as usize, start, unit)).collect();
    let log_size = statistics.log_sizes[category].map(|size| (size.mean - unit.ln(), 1.0 / size.sd));
    let root = start.root / unit;
    let body = EllipsoidModel::new(Vector3::zeros(), &(root * root.transpose()))?;
    let (body, equations) =
        minimize(body, STOP, |body| linearize(&measured, log_size, body), |body, step| body.retract(step))?;
    let semi_axes = body.semi_axes();
    let relative_radius = semi_axes.product().cbrt();
    // From the center in units of the start to the center in units of the body's own radius.
    let mut hessian: SMatrix<f64, 9, 9> = equations.hessian();
    for i in 0..3 {
        for j in 0..9 {
            hessian[(i, j)] *= relative_radius;
            hessian[(j, i)] *= relative_radius;
        }
    }
    for i in 0..9 {
        hessian[(i, i)] += 1e-6;
    }
    let covariance = invert_spd(&hessian)?;
    let log_det_hessian = 2.0 * cholesky(&hessian)?.diagonal().map(f64::ln).sum();
    Some(Object {
        boxes: Vec::new(),
        center: start.center + body.center() * unit,
        root: body.root() * unit,
        radius: relative_radius * unit,
        cost: 0.5 * equations.cost,
        log_det_hessian,
        covariance,
        category,
        forgotten: 0,
        visible: 0,
        trusted_id: None,
    })
}

fn measure(
    observations: &Observations,
    statistics: &SceneStatistics,
    index: usize,
    start: &Start,
    unit: f64,
) -> Measured {
    let observation = &observations.boxes[index];
    let camera = &observations.cameras[observation.frame];
    let one_sided = statistics.one_sided(index, observation);
    let mut edge = 0;
    let edges = edge_planes(camera, observation).map(|(n, d)| {
        let planes = Edge { normal: n * unit, offset: n.dot(&start.center) + d, one_sided: one_sided[edge] };
        edge += 1;
        planes
    });
    let third = camera.matrix.row(2);
    Measured {
        edges,
        depth_normal: camera.axis * unit,
        depth_offset: camera.axis.dot(&start.center) + third[3],
        inverse_sd: 1.0 / statistics.sd(observation),
    }
}

/// Cost (twice the negative log posterior) and derivatives; `None` if the center is behind the camera of a box.
fn linearize(measured: &[Measured], log_size: Option<(f64, f64)>, body: &EllipsoidModel) -> Option<NormalEquations> {
    let mut equations = NormalEquations::zero();
    let center = body.center();
    let semi_axes = body.semi_axes();
    for view in measured {
        let depth = view.depth_normal.dot(center) + view.depth_offset;
        if depth.is_nan() || depth <= 1e-6 * view.depth_normal.norm() * semi_axes.max() {
            return None;
        }
        let scale = view.inverse_sd / depth;
        // One logarithm for the four edges.
        let mut tails = 1.0;
        for edge in &view.edges {
            let (distance, row) = body.distance_to_plane(&edge.normal, edge.offset);
            let residual = distance * scale;
            if edge.one_sided && residual < 0.0 {
                continue;
            }
            let tail = EDGE_LIKELIHOOD.tail(residual * residual);
            tails *= tail;
            equations.add_row(residual, &row.map(|x| x * scale), EDGE_LIKELIHOOD.weight_of_tail(tail));
        }
        equations.cost += EDGE_LIKELIHOOD.cost(tails);
    }
    body.add_shape_prior(1.0 / SHAPE_SD, &mut equations);
    if let Some((mean, weight)) = log_size {
        let axes = body.log_axes_gradient();
        let row = std::array::from_fn(|k| weight * (axes[0][k] + axes[1][k] + axes[2][k]) / 3.0);
        equations.add_quadratic(weight * (semi_axes.map(f64::ln).sum() / 3.0 - mean), &row);
    }
    equations.cost.is_finite().then_some(equations)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::association::test_scenes::{ellipsoid, seen_by};
    use crate::geometry::ConvexBody;

    #[test]
    fn exact_boxes_give_the_body_back() {
        let truth = ellipsoid();
        let (observations, _) = seen_by(12, &truth);
        let mut statistics = SceneStatistics::new(&observations, vec![None], 1e-3);
        statistics.edge_noise = 1e-4;
        let center = truth.center.coords - observations.origin;
        let start = Start::sphere(center + Vector3::new(0.5, -0.4, 0.3), 2.0);
        let object = fit(&observations, &statistics, (0..12).collect(), &[start]).unwrap();
        assert!((object.center - center).norm() < 1e-3, "{}", object.center - center);
        assert!((object.root * object.root.transpose() - truth.shape()).amax() < 1e-2);
        let volume = 4.0 / 3.0 * std::f64::consts::PI * object.radius.powi(3);
        assert!((volume / truth.volume() - 1.0).abs() < 1e-2);
        for index in 0..12 {
            let observation = &observations.boxes[index];
            let camera = &observations.cameras[observation.frame];
            assert!(object.residuals_px(camera, observation).iter().all(|r| r.abs() < 0.05));
            let predicted = object.predict(camera).unwrap();
            assert!((0..4).all(|e| (predicted.edges[e] - observation.edges[e]).abs() < 0.05));
        }
    }

    #[test]
    fn a_body_reaches_beyond_edges_that_are_cut_off_and_not_beyond_others() {
        let truth = ellipsoid();
        let center = |observations: &Observations| truth.center.coords - observations.origin;
        let error = |cut: bool| {
            let (mut observations, _) = seen_by(12, &truth);
            // In half of the views the image ends before the object does.
            for observation in observations.boxes.iter_mut().step_by(2) {
                observation.edges[2] -= 0.3 * observation.half_size;
                observation.cut[2] = cut;
            }
            let mut statistics = SceneStatistics::new(&observations, vec![None], 0.1);
            statistics.edge_noise = 0.05;
            let start = Start::sphere(center(&observations), 2.0);
            let object = fit(&observations, &statistics, (0..12).collect(), &[start]).unwrap();
            (object.root * object.root.transpose() - truth.shape()).amax()
        };
        assert!(error(true) < 0.3 * error(false), "{} {}", error(true), error(false));
    }

    #[test]
    fn the_covariance_is_the_curvature_of_the_cost() {
        let truth = ellipsoid();
        let (observations, statistics) = seen_by(8, &truth);
        let boxes: Vec<u32> = (0..8).collect();
        let center = truth.center.coords - observations.origin;
        let object = fit(&observations, &statistics, boxes.clone(), &[Start::sphere(center, 2.0)]).unwrap();
        // The cost of a body at given parameters: likelihood and priors.
        let cost = |step: &nalgebra::SVector<f64, 9>| {
            let start = Start::body(&object);
            let measured: Vec<Measured> = boxes
                .iter()
                .map(|&index| measure(&observations, &statistics, index as usize, &start, object.radius))
                .collect();
            let root = object.root / object.radius;
            let body = EllipsoidModel::new(Vector3::zeros(), &(root * root.transpose())).unwrap();
            0.5 * linearize(&measured, None, &body.retract(step).unwrap()).unwrap().cost
        };
        let zero = nalgebra::SVector::<f64, 9>::zeros();
        assert!((cost(&zero) - object.cost).abs() < 1e-6 * (1.0 + object.cost));
        // Along the center, where residuals of exact boxes leave nothing but the Gauss-Newton part of the curvature.
        let hessian = object.covariance.try_inverse().unwrap();
        for axis in 0..3 {
            let mut step = zero;
            step[axis] = 1e-2;
            let curvature = (cost(&step) + cost(&-step) - 2.0 * cost(&zero)) / (step[axis] * step[axis]);
            assert!((curvature / hessian[(axis, axis)] - 1.0).abs() < 0.05, "{curvature} {}", hessian[(axis, axis)]);
        }
        let log_det = -object.covariance.determinant().ln();
        assert!((log_det - object.log_det_hessian).abs() < 1e-6);
    }
}
