//! A pose that makes predicted boxes agree with measured ones: Levenberg-Marquardt over six parameters.

use nalgebra::{Matrix6, Point3, Rotation3, SMatrix, Vector3, Vector6};

use super::Landmark;
use super::prepared::{MeasuredBox, PreparedQuery};
use crate::geometry::rigid::Pose;
use crate::geometry::visible_surface::first_meeting;
use crate::geometry::{Body, VECH3, skew, tangent_points};
use crate::optimize::levenberg_marquardt::{Equations, Problem, minimize};
use crate::optimize::student_t::StudentT;
use crate::solve::{Covariance, CovarianceCoordinates, PointCorrection, SupportCorrection};

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
    /// The body, in the frame of the camera.
    pub body: Body,
    /// Where the body touches the planes of the edges, in the frame of the camera.
    points: [Vector3<f64>; 4],
    /// Variance of each edge from the errors of the landmark.
    variance: [f64; 4],
    /// Share of the standard deviation of the body's errors that its views do not explain in the direction of each edge.
    unexplained: [f64; 4],
}

impl Predicted {
    /// The box of a landmark. `None` where its body is not wholly in front of the camera.
    pub(super) fn of_landmark(query: &PreparedQuery, pose: &Pose, landmark: usize) -> Option<Self> {
        let Landmark { body, covariance, correction, .. } = &query.map.landmarks()[landmark];
        let mut predicted = Self::new(pose, body)?;
        if let Some(correction) = correction {
            predicted.correct(pose, correction)?;
        }
        Some(predicted.with_variance(pose, covariance.as_ref()))
    }

    /// The same without the correction of the landmark.
    pub(super) fn of_body(query: &PreparedQuery, pose: &Pose, landmark: usize) -> Option<Self> {
        let Landmark { body, covariance, .. } = &query.map.landmarks()[landmark];
        Some(Self::new(pose, body)?.with_variance(pose, covariance.as_ref()))
    }

    /// With the errors of a body beside those that are known.
    fn with_variance(mut self, pose: &Pose, covariance: Option<&Covariance>) -> Self {
        if let Some(covariance) = covariance {
            let slopes = self.body_slopes(pose, covariance.coordinates);
            for edge in 0..4 {
                let slope = slopes.row(edge);
                self.variance[edge] += (slope * covariance.matrix).dot(&slope).max(0.0);
            }
        }
        self
    }

    /// Moves the points where the planes of the edges touch, and with them the edges, by the correction of the support. A step of Newton's
    /// method: the planes turn with it by far less than the correction varies.
    fn correct(&mut self, pose: &Pose, correction: &SupportCorrection) -> Option<()> {
        for edge in 0..4 {
            let outwards = if edge < 2 { -1.0 } else { 1.0 };
            let mut normal = Vector3::zeros();
            normal[edge % 2] = outwards;
            normal[2] = -outwards * self.edges[edge];
            let PointCorrection { shift, unexplained } = correction.along(&pose.rotation.tr_mul(&normal.normalize()));
            self.points[edge] += pose.rotation * shift;
            let at = self.points[edge];
            (at.z > 0.0).then_some(())?;
            self.edges[edge] = at[edge % 2] / at.z;
            self.unexplained[edge] = unexplained.sqrt();
            let sd = self.by_point(edge).norm() * correction.deviation();
            self.variance[edge] = unexplained * sd * sd;
        }
        Some(())
    }

    /// The box of a body without errors. `None` where the body is not wholly in front of the camera.
    pub(super) fn new(pose: &Pose, body: &Body) -> Option<Self> {
        let center = pose.apply(&body.center.coords);
        let rotation = Rotation3::from_matrix_unchecked(pose.rotation * body.rotation.matrix());
        let body = Body { center: center.into(), rotation, ..*body };
        let points = tangent_points(&body)?.map(|point| center + point);
        let edges = std::array::from_fn(|edge| points[edge][edge % 2] / points[edge].z);
        Some(Self { edges, body, points, variance: [0.0; 4], unexplained: [1.0; 4] })
    }

    /// How far the edges are from those of a box, at most, in half sizes of the box; infinite where a number is not finite.
    pub(super) fn off(&self, measured: &MeasuredBox) -> f64 {
        let half = measured.half_size();
        let off = (0..4).map(|edge| (self.edges[edge] - measured.edges[edge]).abs() / half[edge % 2]);
        off.map(|x| if x.is_finite() { x } else { f64::INFINITY }).fold(0.0, f64::max)
    }

    /// The normal l = (1, 0, -x) of the plane of an edge at x, over the depth of the point that touches it: how far the edge goes when that
    /// point moves by a small vector is the product of both. Which point touches does not change that (the envelope theorem).
    fn by_point(&self, edge: usize) -> Vector3<f64> {
        let mut normal = Vector3::zeros();
        normal[edge % 2] = 1.0;
        normal[2] = -self.edges[edge];
        normal / self.points[edge].z
    }

    /// Derivatives of an edge by a motion of [`moved`].
    fn slope(&self, edge: usize) -> Vector6<f64> {
        let by_point = self.by_point(edge);
        let by_turn = self.points[edge].cross(&by_point);
        Vector6::from_fn(|k, _| if k < 3 { by_turn[k] } else { by_point[k - 3] })
    }

    /// Where the outline touches an edge, in coordinates (X / Z, Y / Z).
    pub(super) fn touches(&self, edge: usize) -> Vector3<f64> {
        self.points[edge] / self.points[edge].z
    }

    /// Depth of the center.
    pub(super) fn depth(&self) -> f64 {
        self.body.center.z
    }

    /// Whether a point (X / Z, Y / Z, 1) is inside of the outline.
    pub(super) fn covers(&self, point: &Vector3<f64>) -> bool {
        let [x0, y0, x1, y1] = self.edges;
        let in_box = point.x > x0 && point.x < x1 && point.y > y0 && point.y < y1;
        in_box && first_meeting(&self.body, &Point3::origin(), &point.normalize()).is_some()
    }

    /// Derivatives of the edges by the body in the world, in the coordinates of its covariance.
    fn body_slopes(&self, pose: &Pose, coordinates: CovarianceCoordinates) -> SMatrix<f64, 4, 9> {
        let mut slopes = SMatrix::zeros();
        for edge in 0..4 {
            let by_point = self.by_point(edge);
            let in_world = pose.rotation.tr_mul(&by_point);
            let from_center = self.points[edge] - self.body.center.coords;
            let of_shape: [f64; 6] = match coordinates {
                // The support function is h = sqrt(n^T A n), the normal of length 1/Z with the sign that points outwards.
                CovarianceCoordinates::CenterVechShape => VECH3.map(|(i, j)| {
                    let twice = if i == j { 1.0 } else { 2.0 };
                    twice * in_world[i] * in_world[j] / (2.0 * by_point.dot(&from_center))
                }),
                CovarianceCoordinates::CenterRotationLogAxes => {
                    let to_body = self.body.rotation.inverse();
                    let (point, normal) = (to_body * from_center, to_body * by_point);
                    let by_turn = point.cross(&normal);
                    let by_size = point.component_mul(&normal);
                    std::array::from_fn(|k| if k < 3 { by_turn[k] } else { by_size[k - 3] })
                }
            };
            (0..3).for_each(|k| slopes[(edge, k)] = self.unexplained[edge] * in_world[k]);
            (0..6).for_each(|k| slopes[(edge, 3 + k)] = self.unexplained[edge] * of_shape[k]);
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

/// The equations of the edges, and of what is known beside them.
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
    all.cost += known_cost(query, pose);
    if let Some(gravity) = &query.gravity {
        let up = pose.rotation * gravity.up_in_world.into_inner();
        let measured = gravity.up_in_camera.into_inner();
        let residual = up.cross(&measured) / gravity.sd;
        let slope = skew(&measured) * skew(&up) / gravity.sd;
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
        let mut gradient = all.gradient.fixed_rows_mut::<3>(3);
        gradient += slope * residual;
        let mut hessian = all.hessian.fixed_view_mut::<3, 3>(3, 3);
        hessian += slope * slope.transpose();
    }
    all.cost.is_finite().then_some(all)
}

/// Squared deviations of a pose from the directions and heights that are known.
pub(super) fn known_cost(query: &PreparedQuery, pose: &Pose) -> f64 {
    let of_gravity = query.gravity.as_ref().map_or(0.0, |known| {
        let up = pose.rotation * known.up_in_world.into_inner();
        up.cross(&known.up_in_camera).norm_squared() / (known.sd * known.sd)
    });
    let of_height = query
        .height
        .as_ref()
        .map_or(0.0, |known| ((pose.center().dot(&known.up_in_world) - known.height) / known.sd).powi(2));
    of_gravity + of_height
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
        let of_body = predicted.body_slopes(pose, covariance.coordinates);
        let of_body = of_body * covariance.matrix * of_body.transpose();
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
    /// Cost of the edges: that of a known direction or height has its own weight.
    pub edge_cost: f64,
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
    let edge_cost = found.equations.cost - known_cost(query, &found.state);
    Some(Refined { pose: found.state, information: found.equations.hessian, edge_cost })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{BodyKind, Ellipsoid, Intrinsics, Projection, project_bounding_box, vech3};
    use nalgebra::Matrix3;

    fn pose() -> Pose {
        let rotation = *Rotation3::from_euler_angles(0.2, -0.3, 0.1).matrix();
        Pose { rotation, translation: Vector3::new(0.3, -0.2, 4.0) }
    }

    fn body(kind: BodyKind) -> Body {
        Body {
            center: Point3::new(0.4, 0.1, 0.3),
            half_extents: Vector3::new(0.7, 0.4, 0.2),
            rotation: Rotation3::from_euler_angles(0.5, 0.1, -0.8),
            kind,
        }
    }

    #[test]
    fn the_predicted_box_is_that_of_the_projection() {
        let intrinsics = Intrinsics::new(1.0, 1.0, 0.0, 0.0).unwrap();
        let projection = Projection::from_camera(&intrinsics, &pose().checked().unwrap());
        for body in BodyKind::ALL.map(body) {
            let predicted = Predicted::new(&pose(), &body).unwrap();
            let b = project_bounding_box(&projection, &body).unwrap();
            for (found, expected) in predicted.edges.into_iter().zip(b.edges()) {
                assert!((found - expected).abs() < 1e-12, "{found} {expected}");
            }
            let behind = Pose { translation: -pose().translation, ..pose() };
            assert!(Predicted::new(&behind, &body).is_none());
        }
    }

    #[test]
    fn outlines_touch_their_edges_and_cover_what_is_inside() {
        for body in BodyKind::ALL.map(body) {
            let predicted = Predicted::new(&pose(), &body).unwrap();
            let middle = predicted.body.center.coords / predicted.depth();
            assert!(predicted.covers(&middle));
            for edge in 0..4 {
                let at = predicted.touches(edge);
                assert!((at[edge % 2] - predicted.edges[edge]).abs() < 1e-12);
                assert!(predicted.covers(&(middle + (at - middle) * 0.97)), "{:?}", body.kind);
                assert!(!predicted.covers(&(middle + (at - middle) * 1.001)));
            }
            let [x0, y0, x1, y1] = predicted.edges;
            for (x, y) in [(x0, y0), (x1, y0), (x0, y1), (x1, y1)] {
                assert!(!predicted.covers(&Vector3::new(x, y, 1.0)), "a corner of the box");
            }
        }
    }

    /// The derivatives of the edges by the body against differences of `moved_by`, the body with one coordinate changed.
    fn check_body_slopes(body: Body, coordinates: CovarianceCoordinates, moved_by: impl Fn(usize, f64) -> Body) {
        let edges = |k: usize, by: f64| Predicted::new(&pose(), &moved_by(k, by)).unwrap().edges;
        let slopes = Predicted::new(&pose(), &body).unwrap().body_slopes(&pose(), coordinates);
        for k in 0..9 {
            let (above, below) = (edges(k, 1e-6), edges(k, -1e-6));
            for edge in 0..4 {
                let numeric = (above[edge] - below[edge]) / 2e-6;
                let slope = slopes[(edge, k)];
                assert!((numeric - slope).abs() < 1e-8, "{:?} {edge} {k}: {numeric} {slope}", body.kind);
            }
        }
    }

    #[test]
    fn slopes_by_the_body_are_those_of_differences() {
        let given = body(BodyKind::Ellipsoid);
        check_body_slopes(given, CovarianceCoordinates::CenterVechShape, |k, by| {
            let (mut center, mut shape) = (given.center, given.inscribed().shape());
            if k < 3 {
                center[k] += by;
            } else {
                let (i, j) = VECH3[k - 3];
                shape[(i, j)] += by;
                shape[(j, i)] = shape[(i, j)];
            }
            assert!(k < 3 || (vech3(&shape) - vech3(&given.inscribed().shape())).amax() > 0.9e-6);
            Ellipsoid::from_shape(center, &shape).unwrap().into()
        });
        for given in BodyKind::ALL.map(body) {
            check_body_slopes(given, CovarianceCoordinates::CenterRotationLogAxes, |k, by| {
                let step = Matrix3::identity().column(k % 3) * by;
                let mut moved = given;
                match k {
                    0..3 => moved.center += step,
                    3..6 => moved.rotation *= Rotation3::new(step),
                    _ => moved.half_extents.component_mul_assign(&step.map(f64::exp)),
                }
                moved
            });
        }
    }

    #[test]
    fn slopes_are_those_of_differences() {
        for body in BodyKind::ALL.map(body) {
            let edges = |by: Vector6<f64>| Predicted::new(&moved(&pose(), &by), &body).unwrap().edges;
            let predicted = Predicted::new(&pose(), &body).unwrap();
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
}
