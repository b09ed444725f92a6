//! What an estimator reports about one object.

use std::f64::consts::PI;

use nalgebra::{Matrix3, Matrix6, Point3, SMatrix, Unit, Vector3, Vector6};

use super::bounds::Bounds;
use crate::geometry::linalg::symmetric_eigen3;
use crate::geometry::{Body, Ellipsoid, VECH3, skew, vech3};

/// A symmetric 9x9 matrix.
pub type Matrix9 = SMatrix<f64, 9, 9>;

/// How an estimation ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Status {
    /// A body was found.
    Ok,
    /// A body was found, but its measurements contradict each other, more than half of its views contradict it, or the scene
    /// is inconsistent. The body is reported for inspection and does not count as localized.
    Inconsistent,
    /// A body was found, but the views leave its place open: the largest standard deviation of the center exceeds
    /// 0.7 of its own size (the geometric mean of its extents), or the fit did not converge. It does not count as localized.
    Undetermined,
    /// The best-fitting quadric is not an ellipsoid; only its center is reported. Nothing is repaired.
    NotAnEllipsoid,
    /// Fewer views than the method needs.
    TooFewViews,
    /// The views do not determine the object (all from one point, or no solution of the linear system).
    Degenerate,
    /// The iteration ended without a finite result in front of the cameras.
    Diverged,
}

impl Status {
    /// All of them, in the order of the documentation.
    pub const ALL: [Self; 7] = [
        Self::Ok,
        Self::Inconsistent,
        Self::Undetermined,
        Self::NotAnEllipsoid,
        Self::TooFewViews,
        Self::Degenerate,
        Self::Diverged,
    ];

    /// The name in files and on the terminal.
    pub fn name(self) -> &'static str {
        match self {
            Self::Ok => "ok",
            Self::Inconsistent => "inconsistent",
            Self::Undetermined => "undetermined",
            Self::NotAnEllipsoid => "not_an_ellipsoid",
            Self::TooFewViews => "too_few_views",
            Self::Degenerate => "degenerate",
            Self::Diverged => "diverged",
        }
    }
}

/// Largest standard deviation of the center over the size of the body (the geometric mean of its extents) with which an object counts as
/// localized. Of 356 real objects 83 were off by more than half their size: at .5, .7 and 1 these are 55, 50 and 45 of them, and 35, 18
/// and 13 of the others.
pub(crate) const MAX_RELATIVE_CENTER_SD: f64 = 0.7;

/// A reason why an estimate is weaker than its status suggests; `Display` gives a readable message.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum Warning {
    /// The viewing rays differ by a small angle only, so the depth is uncertain.
    NarrowBaseline {
        /// The largest angle between two viewing rays, radians.
        largest_angle: f64,
    },
    /// Every box edge on some side lies on the image border: the object's extent there is not seen.
    AllEdgesCutOff,
    /// Only one view: distance and size rest on what is known besides the box (a depth, a 3D box, the size of the category
    /// and the ground), and nothing contradicts a wrong one.
    OneView,
    /// Only two views: the size and the axes rest on the shape prior, and a false box cannot be detected, because nearly any
    /// two boxes fit some body with small residuals.
    TwoViews,
    /// The object lies behind, or across the camera plane of, some of the cameras that see it.
    BehindCamera {
        /// Number of such views.
        views: usize,
    },
    /// Another body agrees with the measurements about as well ([`Estimate::alternatives`]).
    Ambiguous {
        /// Logarithm of the odds of the most probable other body against the reported one.
        log_odds: f64,
    },
    /// The optimization stopped before reaching the best fit ([`super::Method::Posterior`] only).
    NotConverged,
    /// The longest extent is implausible for its category ([`crate::LocalizeOptions::plausible_sizes`]).
    ImplausibleSize {
        /// The longest full extent of the body, world units.
        extent: f64,
        /// Typical extent of the category.
        expected: f64,
    },
}

impl std::fmt::Display for Warning {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::NarrowBaseline { largest_angle } => write!(
                f,
                "narrow baseline: the viewing rays differ by at most {:.1} degrees, so depth and extent along the \
                 view are uncertain",
                largest_angle.to_degrees()
            ),
            Self::AllEdgesCutOff => {
                write!(
                    f,
                    "cut off: on one side of the object every box ends at the image border, so its extent there is \
                     unobserved"
                )
            }
            Self::OneView => write!(f, "only one view: distance and shape rest on cues and priors"),
            Self::TwoViews => write!(f, "only two views: the shape rests on the prior"),
            Self::BehindCamera { views } => {
                write!(f, "the object is not entirely in front of {views} of the cameras that detect it")
            }
            Self::Ambiguous { log_odds } => write!(
                f,
                "ambiguous: another body fits the views about as well (probability {:.0} %); it is among the \
                 alternatives",
                100.0 / (1.0 + (-log_odds).exp())
            ),
            Self::NotConverged => {
                write!(f, "not converged: the optimization stopped before reaching the best fit")
            }
            Self::ImplausibleSize { extent, expected } => {
                write!(f, "implausible size: {extent:.2} long; objects of its category are about {expected:.2}")
            }
        }
    }
}

/// Why a view was not used.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Rejection {
    /// Its measurement is farther from the body than noise explains.
    Residual,
    /// The body does not lie wholly in front of the view's camera.
    BehindCamera,
}

impl Rejection {
    /// The name in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Residual => "residual",
            Self::BehindCamera => "behind_camera",
        }
    }
}

/// The contribution of one view to an estimate.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ViewReport {
    /// Index of the frame in the scene.
    pub frame_index: usize,
    /// Root mean square distance between the measured and the predicted box edges (or, for an ellipse, its four extreme
    /// tangents), in pixels. An edge that is cut off at the image border is used only if the body does not reach it.
    /// Absent if the body has no outline in the view, or if no edge is used.
    pub residual_px: Option<f64>,
    /// Root mean square residual of the measurements used of the view, in standard deviations of the scene's noise,
    /// which is relative to the size of the box: a large residual in pixels may be small here ([`super::Method::Posterior`]
    /// only).
    pub normalized_residual: Option<f64>,
    /// Whether the view was used. If not, it is an outlier, or its object could not be solved.
    pub inlier: bool,
    /// Why it was rejected; absent if it was used or if the object could not be solved.
    pub rejection_reason: Option<Rejection>,
}

impl ViewReport {
    /// A view of an object that could not be solved.
    pub(crate) fn not_used(frame_index: usize) -> Self {
        Self { inlier: false, ..Self::without_body(frame_index) }
    }

    /// A used view without residuals, because the object has no body.
    pub fn without_body(frame_index: usize) -> Self {
        Self { frame_index, residual_px: None, normalized_residual: None, inlier: true, rejection_reason: None }
    }
}

/// Residual statistics of an object over the used measurements.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GoodnessOfFit {
    /// Root of the mean squared residual per degree of freedom, in standard deviations of the scene's noise: about one
    /// for objects with typical noise. With at least five views weighted as in the fit, so that gross errors have
    /// little effect.
    pub normalized_residual: f64,
    /// Root of the mean squared residual per degree of freedom, relative to the half size of the measured boxes.
    pub relative_residual: f64,
    /// Degrees of freedom: residuals minus the degrees used by the fit.
    pub dof: f64,
}

/// Coordinates of a covariance.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CovarianceCoordinates {
    /// Center (3, world) and `vech` of the shape matrix A (6): for ellipsoids. There the normalized estimation error
    /// is right even for narrow baselines.
    CenterVechShape,
    /// Center (3, world), rotation vector in the object's frame (3, radians), log semi-axes (3): for the other
    /// bodies, whose axes A does not determine when two are equal.
    CenterRotationLogAxes,
}

/// Covariance of an estimate.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Covariance {
    /// What the rows and columns mean.
    pub coordinates: CovarianceCoordinates,
    /// The 9x9 matrix in world units.
    pub matrix: Matrix9,
}

impl Covariance {
    /// The matrix in the coordinates [`CovarianceCoordinates::CenterVechShape`] of the body's ellipsoid.
    pub fn in_center_vech_shape(&self, ellipsoid: &Ellipsoid) -> Matrix9 {
        if self.coordinates == CovarianceCoordinates::CenterVechShape {
            return self.matrix;
        }
        let rotation = ellipsoid.rotation.matrix();
        let shape = Matrix3::from_diagonal(&ellipsoid.semi_axes.map(|x| x * x));
        let columns: [Vector6<f64>; 6] = std::array::from_fn(|k| {
            let mut axis = Vector3::zeros();
            axis[k % 3] = 1.0;
            let in_body = match k {
                0..3 => skew(&axis) * shape - shape * skew(&axis),
                _ => Matrix3::from_diagonal(&axis) * shape * 2.0,
            };
            vech3(&(rotation * in_body * rotation.transpose()))
        });
        let mut slopes = Matrix9::identity();
        slopes.fixed_view_mut::<6, 6>(3, 3).copy_from(&Matrix6::from_columns(&columns));
        slopes * self.matrix * slopes.transpose()
    }
}

/// Variance of an angle that may be anything over half a turn: after one the bodies look the same.
const ANY_ANGLE: f64 = PI * PI / 12.0;

impl Covariance {
    /// The blocks of the rotation vector and of the logarithms of the half extents of a body, in its frame.
    fn rotation_and_log_axes(&self, body: &Body) -> (Matrix3<f64>, Matrix3<f64>) {
        if self.coordinates == CovarianceCoordinates::CenterRotationLogAxes {
            let block = |first| self.matrix.fixed_view::<3, 3>(first, first).into_owned();
            return (block(3), block(6));
        }
        // With D = R^T dA R: a rotation about axis k turns the axes i and j into each other, D_ij = w_k (a_i^2 - a_j^2), and D_ii is twice the
        // squared semi-axis times the change of its logarithm.
        let (axes, squares) = (body.rotation.matrix(), body.half_extents.map(|x| x * x));
        let row = |i: usize, j: usize, scale: f64| {
            let both = axes.column(i) * axes.column(j).transpose();
            let both = (both + both.transpose()) * 0.5;
            Vector6::from_iterator(
                VECH3.iter().map(|&(k, l)| scale * if k == l { both[(k, l)] } else { 2.0 * both[(k, l)] }),
            )
        };
        let by_rotation = [(1, 2), (2, 0), (0, 1)].map(|(i, j)| row(i, j, 1.0 / (squares[i] - squares[j])));
        let by_size = [0, 1, 2].map(|i| row(i, i, 0.5 / squares[i]));
        let shape = self.matrix.fixed_view::<6, 6>(3, 3);
        let of = |rows: [Vector6<f64>; 3]| Matrix3::from_fn(|i, j| rows[i].dot(&(shape * rows[j])));
        (of(by_rotation), of(by_size))
    }

    pub(super) fn half_extents_sd(&self, body: &Body) -> Vector3<f64> {
        let (_, log_axes) = self.rotation_and_log_axes(body);
        Vector3::from_fn(|axis, _| body.half_extents[axis] * log_axes[(axis, axis)].max(0.0).sqrt())
    }

    fn rotation_sd(&self, body: &Body, up: Option<&Unit<Vector3<f64>>>) -> [f64; 2] {
        let (rotation, _) = self.rotation_and_log_axes(body);
        let about = |axis: &Vector3<f64>| {
            let variance = axis.dot(&(rotation * axis));
            // Of equal axes it is not finite.
            if variance < ANY_ANGLE { variance.max(0.0) } else { ANY_ANGLE }
        };
        let axes = [Vector3::x(), Vector3::y(), Vector3::z()];
        let sum: f64 = axes.iter().map(about).sum();
        let Some(up) = up else { return [(sum / 3.0).sqrt(); 2] };
        let up = body.rotation.inverse() * up.into_inner();
        let level = up.cross(&axes[up.iamin()]).normalize();
        let away = 0.5 * (about(&level) + about(&up.cross(&level)));
        [about(&up).sqrt(), away.sqrt()]
    }
}

/// Another body that is consistent with the measurements of an object.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Alternative {
    /// The body.
    pub body: Body,
    /// Natural logarithm of its odds against the reported body: of both posterior densities, integrated over their
    /// neighbourhoods (Laplace's approximation).
    pub log_odds: f64,
}

/// The estimate of one object.
#[derive(Debug, Clone, PartialEq)]
pub struct Estimate {
    /// Index into the scene's object ids.
    pub object_index: usize,
    /// Index into the scene's categories.
    pub category_index: Option<usize>,
    /// How the estimation ended.
    pub status: Status,
    /// The center in the world, whenever there is one.
    pub center: Option<Point3<f64>>,
    /// The body.
    pub body: Option<Body>,
    /// The ellipsoid that encloses the object, parts of which may lie outside of `body` (docs/method.md, section 13): only where it was asked
    /// for ([`crate::LocalizeOptions::enclosing`]).
    pub enclosing: Option<Ellipsoid>,
    /// The box around the object, with the extents that its measurements show beside those of `body`.
    pub bounds: Option<Bounds>,
    /// Uncertainty of `body`.
    pub covariance: Option<Covariance>,
    /// Other bodies that fit the measurements about as well, the most probable first. For cuboids only; the covariance includes
    /// the spread between them.
    pub alternatives: Vec<Alternative>,
    /// How far the measurements are from the body ([`super::Method::Posterior`] only).
    pub goodness_of_fit: Option<GoodnessOfFit>,
    /// One entry per view, used or rejected.
    pub views: Vec<ViewReport>,
    /// Reasons why the estimate is weaker than its status says.
    pub warnings: Vec<Warning>,
}

impl Estimate {
    /// An estimate without a body.
    pub fn failed(object_index: usize, category_index: Option<usize>, status: Status) -> Self {
        Self {
            object_index,
            category_index,
            status,
            center: None,
            body: None,
            enclosing: None,
            bounds: None,
            covariance: None,
            alternatives: Vec::new(),
            goodness_of_fit: None,
            views: Vec::new(),
            warnings: Vec::new(),
        }
    }

    /// A placeholder estimate in canceled work, whose results are discarded.
    pub(crate) fn canceled() -> Self {
        Self::failed(0, None, Status::Diverged)
    }

    /// The ellipsoid that reaches about as far as the body in all directions, see [`Body::closest_ellipsoid`].
    pub fn closest_ellipsoid(&self) -> Option<Ellipsoid> {
        self.body.as_ref().map(Body::closest_ellipsoid)
    }

    /// Number of used views.
    pub fn views_used(&self) -> usize {
        self.views.iter().filter(|view| view.inlier).count()
    }

    /// Root mean square residual over the used views, in pixels.
    pub fn rms_residual_px(&self) -> Option<f64> {
        let (sum, count) = self
            .views
            .iter()
            .filter(|view| view.inlier)
            .filter_map(|view| view.residual_px)
            .fold((0.0, 0usize), |(sum, count), r| (sum + r * r, count + 1));
        (count > 0).then(|| (sum / count as f64).sqrt())
    }

    /// Standard deviations of the half extents of the body, in their order, world units.
    pub fn half_extents_sd(&self) -> Option<Vector3<f64>> {
        Some(self.covariance.as_ref()?.half_extents_sd(self.body.as_ref()?))
    }

    /// Standard deviations of the rotation of the body, radians: about the vertical `up`, and away from it (about a horizontal axis, each
    /// way). Without `up` both are the root mean square over all axes. An axis of rotation about which the body looks the same has that of an
    /// angle that may be anything.
    pub fn rotation_sd(&self, up: Option<&Unit<Vector3<f64>>>) -> Option<[f64; 2]> {
        Some(self.covariance.as_ref()?.rotation_sd(self.body.as_ref()?, up))
    }

    /// Largest standard deviation of the center, in any direction, over the geometric mean of the extents of the body.
    pub(crate) fn relative_center_sd(&self) -> Option<f64> {
        let center = self.covariance.as_ref()?.matrix.fixed_view::<3, 3>(0, 0).into_owned();
        let (variances, _) = symmetric_eigen3(&center)?;
        Some(variances[0].max(0.0).sqrt() / (2.0 * self.body.as_ref()?.half_extents.product().cbrt()))
    }

    /// Standard deviation of the center: the root of the mean variance over the three coordinates, world units.
    pub fn center_sd(&self) -> Option<f64> {
        let c = self.covariance.as_ref()?.matrix;
        Some(((c[(0, 0)] + c[(1, 1)] + c[(2, 2)]) / 3.0).sqrt())
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Rotation3;

    use super::*;
    use crate::geometry::BodyKind;

    /// The two coordinates of a covariance of an ellipsoid say the same.
    #[test]
    fn deviations_of_sizes_and_rotation_do_not_depend_on_the_coordinates() {
        let body = Body {
            center: Point3::new(1.0, 2.0, 3.0),
            rotation: Rotation3::from_euler_angles(0.3, -0.5, 1.1),
            half_extents: Vector3::new(0.9, 0.5, 0.2),
            kind: BodyKind::Ellipsoid,
        };
        // Correlated, with given variances of the rotation (radians) and the logarithms.
        let root = Matrix9::from_fn(|i, j| if i == j { 0.1 } else { 0.01 * ((3 * i + 5 * j) % 7) as f64 - 0.03 });
        let matrix = root * root.transpose() * 0.1;
        let given = Covariance { coordinates: CovarianceCoordinates::CenterRotationLogAxes, matrix };
        let shape = given.in_center_vech_shape(&body.inscribed());
        let other = Covariance { coordinates: CovarianceCoordinates::CenterVechShape, matrix: shape };
        let expected = Vector3::from_fn(|k, _| body.half_extents[k] * matrix[(6 + k, 6 + k)].sqrt());
        let up = Unit::new_normalize(Vector3::new(0.2, -0.4, 0.8));
        for covariance in [given, other] {
            assert!((covariance.half_extents_sd(&body) - expected).amax() < 1e-12);
            // In the frame of the body.
            let rotation = matrix.fixed_view::<3, 3>(3, 3);
            let axis = body.rotation.inverse() * up.into_inner();
            let [yaw, tilt] = covariance.rotation_sd(&body, Some(&up));
            assert!((yaw * yaw - axis.dot(&(rotation * axis))).abs() < 1e-12);
            assert!((yaw * yaw + 2.0 * tilt * tilt - rotation.trace()).abs() < 1e-12);
            assert!((covariance.rotation_sd(&body, None)[0].powi(2) * 3.0 - rotation.trace()).abs() < 1e-12);
        }
        // A ball has no direction.
        let ball = Body { half_extents: Vector3::repeat(0.5), ..body };
        assert!((other.rotation_sd(&ball, None)[0] - 0.9069).abs() < 1e-4);
    }

    #[test]
    fn residuals_are_those_of_the_views_that_were_used() {
        let seen = |residual, inlier| ViewReport {
            residual_px: residual,
            inlier,
            rejection_reason: (!inlier).then_some(Rejection::Residual),
            ..ViewReport::without_body(0)
        };
        let views = vec![seen(Some(3.0), true), seen(Some(100.0), false), seen(None, true), seen(Some(5.0), true)];
        let estimate = Estimate { views, ..Estimate::failed(0, None, Status::Ok) };
        assert_eq!(estimate.views_used(), 3);
        assert!((estimate.rms_residual_px().unwrap() - 17.0f64.sqrt()).abs() < 1e-12);
        assert_eq!(Estimate::failed(0, None, Status::Diverged).rms_residual_px(), None);
    }
}
