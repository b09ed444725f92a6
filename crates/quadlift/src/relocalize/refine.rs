//! A pose that makes predicted boxes agree with measured ones: Levenberg-Marquardt over six parameters.

use nalgebra::{Matrix3, Matrix6, SMatrix, Vector3, Vector6};

use super::prepared::{MeasuredBox, PreparedQuery};
use crate::geometry::rigid::Pose;
use crate::geometry::{VECH3, box_of_outline, skew};
use crate::optimize::levenberg_marquardt::{Equations, Problem, minimize};
use crate::optimize::student_t::StudentT;

/// Degrees of freedom of an edge's Student t distribution, as of `posterior`.
pub(super) const DOF: f64 = 9.0;

/// Squared step (radians, mean depths) below which the search has ended.
const SMALL_STEP: f64 = 1e-22;

/// The pose followed by a small motion in the frame of the camera: rotation vector, shift.
fn moved(pose: &Pose, by: &Vector6<f64>) -> Pose {
    pose.moved(&by.fixed_rows::<3>(0).into_owned(), &by.fixed_rows::<3>(3).into_owned())
}

/// The box of a body in the frame of a camera, in coordinates (X / Z, Y / Z): left, top, right, bottom.
#[derive(Debug, Clone, Copy)]
pub(super) struct Predicted {
    pub edges: [f64; 4],
    pub center: Vector3<f64>,
    /// `S - c c^T` of the shape and the center: the dual conic of the outline.
    conic: Matrix3<f64>,
    /// Variance of each edge from the errors of the landmark.
    variance: [f64; 4],
}

impl Predicted {
    /// The box of a landmark. `None` where its body is not wholly in front of the camera.
    pub(super) fn of_landmark(query: &PreparedQuery, pose: &Pose, landmark: usize) -> Option<Self> {
        let mut predicted = Self::new(pose, &query.map.center(landmark), query.map.shape(landmark))?;
        if let Some(covariance) = &query.map.landmarks()[landmark].covariance {
            let slopes = predicted.body_slopes(pose);
            predicted.variance = std::array::from_fn(|edge| {
                let slope = slopes.row(edge);
                (slope * covariance).dot(&slope).max(0.0)
            });
        }
        Some(predicted)
    }

    /// The box of a body without errors. `None` where the body is not wholly in front of the camera.
    pub(super) fn new(pose: &Pose, center: &Vector3<f64>, shape: &Matrix3<f64>) -> Option<Self> {
        let center = pose.apply(center);
        if center.z <= 0.0 {
            return None;
        }
        let conic = pose.rotation * shape * pose.rotation.transpose() - center * center.transpose();
        let edges = box_of_outline(&conic, center.z)?;
        Some(Self { edges, center, conic, variance: [0.0; 4] })
    }

    /// Whether no edge is farther from that of a box than so many of the box's half sizes.
    pub(super) fn is_within(&self, measured: &MeasuredBox, half_sizes: f64) -> bool {
        let half = measured.half_size();
        (0..4).all(|edge| (self.edges[edge] - measured.edges[edge]).abs() < half_sizes * half[edge % 2])
    }

    /// Derivatives of an edge by a motion of [`moved`].
    fn slope(&self, edge: usize) -> Vector6<f64> {
        let (axis, x) = (edge % 2, self.edges[edge]);
        // The edge is a line l = (1, 0, -x) with l^T conic l = 0.
        let mut line = Vector3::zeros();
        line[axis] = 1.0;
        line[2] = -x;
        let seen = self.conic * line;
        // d(conic) = W conic + (W conic)^T for turns, -(v c^T + c v^T) for shifts; d(line) = -dx e_z.
        let by_turn = seen.cross(&line) * 2.0;
        let by_shift = line * (-2.0 * self.center.dot(&line));
        let by_edge = -2.0 * seen[2];
        let mut slope = Vector6::zeros();
        slope.fixed_rows_mut::<3>(0).copy_from(&by_turn);
        slope.fixed_rows_mut::<3>(3).copy_from(&by_shift);
        slope / -by_edge
    }

    /// Where the outline touches an edge, in coordinates (X / Z, Y / Z).
    pub(super) fn touches(&self, edge: usize) -> Vector3<f64> {
        let mut line = Vector3::zeros();
        line[edge % 2] = 1.0;
        line[2] = -self.edges[edge];
        // The pole of the tangent line.
        let seen = self.conic * line;
        seen / seen.z
    }

    /// Whether a point (X / Z, Y / Z, 1) is inside of the outline.
    pub(super) fn covers(&self, point: &Vector3<f64>) -> bool {
        let [x0, y0, x1, y1] = self.edges;
        let in_box = point.x > x0 && point.x < x1 && point.y > y0 && point.y < y1;
        // The quadratic form of the outline has the sign that it has at the center.
        in_box
            && self.conic.try_inverse().is_some_and(|outline| point.dot(&(outline * point)) * self.conic[(2, 2)] > 0.0)
    }

    /// Derivatives of the edges by the body: center, and `vech` of the shape, in the world.
    fn body_slopes(&self, pose: &Pose) -> SMatrix<f64, 4, 9> {
        let mut slopes = SMatrix::zeros();
        for edge in 0..4 {
            let mut line = Vector3::zeros();
            line[edge % 2] = 1.0;
            line[2] = -self.edges[edge];
            // l^T conic l = m^T A m - (l . c)^2 with m = R^T l.
            let m = pose.rotation.tr_mul(&line);
            let by_edge = 2.0 * (self.conic * line)[2];
            let along = -2.0 * self.center.dot(&line);
            (0..3).for_each(|k| slopes[(edge, k)] = along * m[k] / by_edge);
            for (k, &(i, j)) in VECH3.iter().enumerate() {
                slopes[(edge, 3 + k)] = if i == j { m[i] * m[i] } else { 2.0 * m[i] * m[j] } / by_edge;
            }
        }
        slopes
    }
}

/// An edge of a match: residual, and the standard deviation by which it is divided.
#[derive(Debug, Clone, Copy)]
pub(super) struct EdgeResidual {
    pub residual: f64,
    pub sd: f64,
}

/// A box and the landmark that it shows.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Match {
    pub query_box: usize,
    pub landmark: usize,
    /// Edges beyond which the body may reach: the image ends there, or something hides the rest.
    pub one_sided: [bool; 4],
}

impl Match {
    /// A match of which nothing is hidden.
    pub(super) fn new(query: &PreparedQuery, query_box: usize, landmark: usize) -> Self {
        Self { query_box, landmark, one_sided: query.boxes[query_box].cut_off }
    }
}

/// The four edges of a box against a predicted one. `None` where the edge says nothing: one-sided, and the body reaches beyond it.
pub(super) fn edge_residuals(query: &PreparedQuery, predicted: &Predicted, of: &Match) -> [Option<EdgeResidual>; 4] {
    let measured = &query.boxes[of.query_box];
    std::array::from_fn(|edge| {
        let off = predicted.edges[edge] - measured.edges[edge];
        let outwards = if edge < 2 { -off } else { off };
        if of.one_sided[edge] && outwards >= 0.0 {
            return None;
        }
        let sd = (measured.sd[edge] * measured.sd[edge] + predicted.variance[edge]).sqrt();
        Some(EdgeResidual { residual: off / sd, sd })
    })
}

fn equations(query: &PreparedQuery, pose: &Pose, matches: &[Match]) -> Option<Equations<6>> {
    let mut all = Equations::zero();
    let student_t = StudentT::new(DOF);
    for of in matches {
        let predicted = Predicted::of_landmark(query, pose, of.landmark)?;
        let residuals = edge_residuals(query, &predicted, of);
        for (edge, of_edge) in residuals.into_iter().enumerate() {
            let Some(EdgeResidual { residual, sd }) = of_edge else { continue };
            let slope = predicted.slope(edge) / sd;
            let weight = student_t.weight(residual * residual);
            all.cost += student_t.cost_of_one(residual * residual);
            all.gradient += slope * (weight * residual);
            all.hessian += slope * slope.transpose() * weight;
        }
    }
    if let Some(gravity) = &query.gravity {
        let up = pose.rotation * gravity.up_in_world.into_inner();
        let measured = gravity.up_in_camera.into_inner();
        let residual = up.cross(&measured) / gravity.sd;
        let slope = skew(&measured) * skew(&up) / gravity.sd;
        all.cost += residual.norm_squared();
        let mut gradient = all.gradient.fixed_rows_mut::<3>(0);
        gradient += slope.tr_mul(&residual);
        let mut hessian = all.hessian.fixed_view_mut::<3, 3>(0, 0);
        hessian += slope.tr_mul(&slope);
    }
    if let Some(known) = &query.height {
        let up = pose.rotation * known.up_in_world.into_inner();
        // The center is -R^T t. A turn in the frame of the camera turns both `up` and `t`.
        let residual = (-up.dot(&pose.translation) - known.height) / known.sd;
        let slope = -up / known.sd;
        all.cost += residual * residual;
        let mut gradient = all.gradient.fixed_rows_mut::<3>(3);
        gradient += slope * residual;
        let mut hessian = all.hessian.fixed_view_mut::<3, 3>(3, 3);
        hessian += slope * slope.transpose();
    }
    all.cost.is_finite().then_some(all)
}

/// Covariance of a motion of a pose from its `information` (see [`Refined`]), which takes the errors of edges for independent: those of
/// a landmark move all edges of its box together. With the weighted slopes G of the edges and the correlations C of their errors it is
/// `H^-1 (sum G^T C G) H^-1`, H the information.
pub(super) fn covariance(
    query: &PreparedQuery,
    pose: &Pose,
    matches: &[Match],
    information: &Matrix6<f64>,
) -> Option<Matrix6<f64>> {
    let student_t = StudentT::new(DOF);
    let mut middle = *information;
    for of in matches {
        let Some(covariance) = &query.map.landmarks()[of.landmark].covariance else { continue };
        let predicted = Predicted::of_landmark(query, pose, of.landmark)?;
        let of_body = predicted.body_slopes(pose);
        let of_body = of_body * covariance * of_body.transpose();
        let edges = edge_residuals(query, &predicted, of);
        let slopes: [Option<Vector6<f64>>; 4] = std::array::from_fn(|edge| {
            let EdgeResidual { residual, sd } = edges[edge]?;
            Some(predicted.slope(edge) * (student_t.weight(residual * residual).sqrt() / (sd * sd)))
        });
        for (i, j) in [(1, 0), (2, 0), (2, 1), (3, 0), (3, 1), (3, 2)] {
            let (Some(a), Some(b)) = (&slopes[i], &slopes[j]) else { continue };
            let both = a * b.transpose() * of_body[(i, j)];
            middle += both + both.transpose();
        }
    }
    // As a square, which has no negative variances however little is determined.
    let root = information.cholesky()?.solve(&middle.cholesky()?.l());
    Some(root * root.transpose())
}

/// A refined pose.
#[derive(Debug, Clone, Copy)]
pub(super) struct Refined {
    pub pose: Pose,
    /// Inverse covariance of a motion of the pose: rotation vector, shift, in the frame of the camera.
    pub information: Matrix6<f64>,
    pub cost: f64,
}

/// Boxes of a query, and the landmarks that they are taken for.
struct Matched<'a> {
    query: &'a PreparedQuery<'a>,
    matches: &'a [Match],
}

impl Problem for Matched<'_> {
    type State = Pose;
    type Equations = Equations<6>;

    fn linearize(&self, pose: &Pose) -> Option<Equations<6>> {
        equations(self.query, pose, self.matches)
    }

    fn retract(&self, pose: &Pose, step: &Vector6<f64>) -> Option<Pose> {
        Some(moved(pose, step))
    }

    fn is_last(&self, step: &Vector6<f64>, pose: &Pose, _: f64, _: f64) -> bool {
        let depth = pose.translation.norm_squared().max(f64::MIN_POSITIVE);
        let turn = step.fixed_rows::<3>(0).norm_squared();
        turn + step.fixed_rows::<3>(3).norm_squared() / depth < SMALL_STEP
    }
}

/// The pose near a start at which the matched boxes agree best; `None` where a body is not in front of the camera.
pub(super) fn refine(query: &PreparedQuery, start: Pose, matches: &[Match], steps: usize) -> Option<Refined> {
    let found = minimize(&Matched { query, matches }, start, steps)?;
    Some(Refined { pose: found.state, information: found.equations.hessian, cost: found.equations.cost })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{Ellipsoid, Intrinsics, Projection, project_bounding_box};
    use nalgebra::{Point3, Rotation3};

    fn pose() -> Pose {
        let rotation = *Rotation3::from_euler_angles(0.2, -0.3, 0.1).matrix();
        Pose { rotation, translation: Vector3::new(0.3, -0.2, 4.0) }
    }

    fn body() -> Ellipsoid {
        Ellipsoid {
            center: Point3::new(0.4, 0.1, 0.3),
            semi_axes: Vector3::new(0.7, 0.4, 0.2),
            rotation: Rotation3::from_euler_angles(0.5, 0.1, -0.8),
        }
    }

    #[test]
    fn the_predicted_box_is_that_of_the_projection() {
        let predicted = Predicted::new(&pose(), &body().center.coords, &body().shape()).unwrap();
        let intrinsics = Intrinsics::new(1.0, 1.0, 0.0, 0.0).unwrap();
        let projection = Projection::from_camera(&intrinsics, &pose().checked().unwrap());
        let b = project_bounding_box(&projection, &body()).unwrap();
        for (found, expected) in predicted.edges.into_iter().zip([b.x0, b.y0, b.x1, b.y1]) {
            assert!((found - expected).abs() < 1e-12, "{found} {expected}");
        }
        let behind = Pose { translation: -pose().translation, ..pose() };
        assert!(Predicted::new(&behind, &body().center.coords, &body().shape()).is_none());
    }

    #[test]
    fn outlines_touch_their_edges_and_cover_what_is_inside() {
        let predicted = Predicted::new(&pose(), &body().center.coords, &body().shape()).unwrap();
        let middle = predicted.center / predicted.center.z;
        assert!(predicted.covers(&middle));
        for edge in 0..4 {
            let at = predicted.touches(edge);
            assert!((at[edge % 2] - predicted.edges[edge]).abs() < 1e-12);
            assert!(predicted.covers(&(middle + (at - middle) * 0.999)));
            assert!(!predicted.covers(&(middle + (at - middle) * 1.001)));
        }
        let [x0, y0, x1, y1] = predicted.edges;
        for (x, y) in [(x0, y0), (x1, y0), (x0, y1), (x1, y1)] {
            assert!(!predicted.covers(&Vector3::new(x, y, 1.0)), "a corner of the box");
        }
    }

    #[test]
    fn slopes_by_the_body_are_those_of_differences() {
        let edges = |k: usize, by: f64| {
            let (mut center, mut shape) = (body().center.coords, body().shape());
            if k < 3 {
                center[k] += by;
            } else {
                let (i, j) = VECH3[k - 3];
                shape[(i, j)] += by;
                shape[(j, i)] = shape[(i, j)];
            }
            Predicted::new(&pose(), &center, &shape).unwrap().edges
        };
        let slopes = Predicted::new(&pose(), &body().center.coords, &body().shape()).unwrap().body_slopes(&pose());
        for k in 0..9 {
            let (above, below) = (edges(k, 1e-6), edges(k, -1e-6));
            for edge in 0..4 {
                let numeric = (above[edge] - below[edge]) / 2e-6;
                assert!((numeric - slopes[(edge, k)]).abs() < 1e-8, "{edge} {k}: {numeric} {}", slopes[(edge, k)]);
            }
        }
    }

    #[test]
    fn slopes_are_those_of_differences() {
        let edges = |by: Vector6<f64>| {
            Predicted::new(&moved(&pose(), &by), &body().center.coords, &body().shape()).unwrap().edges
        };
        let predicted = Predicted::new(&pose(), &body().center.coords, &body().shape()).unwrap();
        for edge in 0..4 {
            let slope = predicted.slope(edge);
            for k in 0..6 {
                let mut by = Vector6::zeros();
                by[k] = 1e-6;
                let numeric = (edges(by)[edge] - edges(-by)[edge]) / 2e-6;
                assert!((numeric - slope[k]).abs() < 1e-8, "{edge} {k}: {numeric} {}", slope[k]);
            }
        }
    }
}
