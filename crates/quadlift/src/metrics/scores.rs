//! Estimated and true objects, and their scores.

use nalgebra::Point3;

use crate::geometry::{Body, Ellipsoid};

/// The estimate of one object; missing values are absent.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct EstimatedObject {
    /// The id.
    pub id: String,
    /// How the estimation ended (see [`crate::solve::Status::name`]); only passed on.
    pub status: String,
    /// The center in the world; a failed estimation can have one nevertheless.
    pub center: Option<Point3<f64>>,
    /// The body.
    pub body: Option<Body>,
    /// The ellipsoid that should contain the real object.
    pub enclosing: Option<Ellipsoid>,
}

/// The ground truth of one object. If there is only a cuboid, its inscribed ellipsoid is used.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct TruthObject {
    /// The id.
    pub id: String,
    /// The true ellipsoid.
    pub ellipsoid: Option<Ellipsoid>,
    /// The true cuboid.
    pub cuboid: Option<Body>,
}

/// Scores of one true object; absent if either side has no value.
///
/// Volume IoUs are the exception: a failed estimate scores 0, so that no method gains by failing.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct ObjectScore {
    /// The id.
    pub id: String,
    /// Id of the paired estimate; absent if there is none.
    pub estimate: Option<String>,
    /// Status of that estimate.
    pub status: Option<String>,
    /// Whether there is an estimated body at all.
    pub has_body: bool,
    /// Volume IoU of the closest ellipsoid of the body with the true one (O3D of the paper), 0 without an estimated body. Of two cuboids
    /// that of the inscribed ellipsoids, as in the papers.
    pub iou3d: Option<f64>,
    /// Volume IoU of the enclosing ellipsoid with the true ellipsoid; 0 without an estimated body, absent when the estimator
    /// reports no enclosing ellipsoids or there is no true ellipsoid.
    pub iou3d_enclosing: Option<f64>,
    /// Volume IoU of the cuboids; 0 without any estimated body, absent for a body of another kind.
    pub cuboid_iou3d: Option<f64>,
    /// Angle between the longest axes modulo the symmetry of the true body, radians in [0, pi/2] (see
    /// [`axis_error`](super::axis_error)); absent for a ball.
    pub axis_error: Option<f64>,
    /// Angle between the longest axes of the ellipsoids, radians in [0, pi/2] (theta_err of the paper).
    pub theta_err: Option<f64>,
    /// Angle from the sorted axes of one ellipsoid to those of the other modulo half turns, radians in [0, 2 pi / 3].
    pub rotation_error: Option<f64>,
    /// Distance of the centers, world units.
    pub center_error: Option<f64>,
    /// Mean of the moduli of the relative errors of the sorted semi-axes of the ellipsoids (0.1 is ten percent).
    pub size_error: Option<f64>,
    /// Agreement in the images.
    pub reprojection: Option<ReprojectionScore>,
}

/// Agreement of the bodies in the images where both lie wholly in front of the camera.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ReprojectionScore {
    /// Mean IoU of the outlines of the ellipsoids.
    pub ellipse_iou: f64,
    /// Mean IoU of the boxes around the outlines: of the cuboids where both sides have one, else of the ellipsoids.
    pub box_iou: f64,
    /// Number of these images.
    pub frames: usize,
}

/// A mean and its number of objects.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Mean {
    /// The mean.
    pub value: f64,
    /// Number of objects with this score.
    pub count: usize,
}

/// Means over the objects that have the score; the fields are those of [`ObjectScore`].
#[derive(Debug, Clone, PartialEq, Default)]
pub struct MeanScore {
    /// Volume IoU of the ellipsoids, failures with 0.
    pub iou3d: Option<Mean>,
    /// Volume IoU with the enclosing ellipsoid, failures with 0.
    pub iou3d_enclosing: Option<Mean>,
    /// Volume IoU of the cuboids, failures with 0.
    pub cuboid_iou3d: Option<Mean>,
    /// Angle between the longest axes modulo symmetry, radians.
    pub axis_error: Option<Mean>,
    /// Angle between the longest axes, radians.
    pub theta_err: Option<Mean>,
    /// Angle between the axes, radians.
    pub rotation_error: Option<Mean>,
    /// Distance of the centers, world units.
    pub center_error: Option<Mean>,
    /// Relative error of the semi-axes.
    pub size_error: Option<Mean>,
    /// IoU of the outlines in the images.
    pub ellipse_reprojection_iou: Option<Mean>,
    /// IoU of the boxes in the images.
    pub box_reprojection_iou: Option<Mean>,
}

/// How estimates and true objects are paired.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum PairedBy {
    /// By their ids; of several estimates with one id the first counts.
    #[default]
    Ids,
    /// By the overlap of their bodies.
    Overlap,
}

/// The scores of a list of estimates.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Evaluation {
    /// One score for each object of the truth, in its order.
    pub objects: Vec<ObjectScore>,
    /// How estimates and true objects were paired.
    pub paired_by: PairedBy,
    /// Ids of estimates that are not paired with a true object.
    pub unmatched: Vec<String>,
    /// Means over the objects.
    pub mean: MeanScore,
    /// Number of true objects without an estimated body, missing or failed.
    pub failures: usize,
}

impl Evaluation {
    /// Fraction of true objects without an estimated body; `None` if there are no true objects.
    pub fn failure_share(&self) -> Option<f64> {
        (!self.objects.is_empty()).then(|| self.failures as f64 / self.objects.len() as f64)
    }
}

impl TruthObject {
    /// The true ellipsoid, or the one inscribed in the cuboid.
    pub fn ellipsoid(&self) -> Option<Ellipsoid> {
        self.ellipsoid.or_else(|| self.cuboid.as_ref().map(Body::inscribed))
    }
}
