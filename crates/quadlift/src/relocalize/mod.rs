//! Where a camera is, from the objects that it sees: the boxes of one image against a map of objects (ours; docs/method.md,
//! section 20).
//!
//! Appearance is not used: a map that was made from one side is found again from the other, in any light. An object's size and
//! its box tell about how far it is, so that three objects give a pose (`hypotheses`); poses are refined with the edges of all
//! boxes that they explain (`refine`), and compared by their evidence (`score`). Where another pose explains the image
//! nearly as well, the answer is [`LocateStatus::Ambiguous`], and all of them are given.
//!
//! ```
//! use nalgebra::{Matrix3x4, Point3, Rotation3, Vector3};
//! use quadlift::geometry::{Body, BodyKind, CamFromWorld, Intrinsics, Projection, project_bounding_box};
//! use quadlift::relocalize::{Landmark, LandmarkMap, LocateOptions, LocateStatus, Query, QueryBox};
//!
//! let landmark = |x: f64, y: f64, z: f64, size: f64| Landmark {
//!     body: Body {
//!         center: Point3::new(x, y, z),
//!         half_extents: Vector3::new(size, 0.8 * size, 0.6 * size),
//!         rotation: Rotation3::identity(),
//!         kind: BodyKind::Cuboid,
//!     },
//!     covariance: None,
//!     category: Some(format!("thing {size}")),
//!     correction: None,
//! };
//! let landmarks = vec![
//!     landmark(0.0, 0.0, 5.0, 0.3),
//!     landmark(1.0, 0.4, 6.0, 0.4),
//!     landmark(-1.2, -0.3, 5.5, 0.5),
//!     landmark(0.6, -0.8, 4.5, 0.2),
//! ];
//! let intrinsics = Intrinsics::new(600.0, 600.0, 320.0, 240.0)?;
//! let truth = CamFromWorld::new(Matrix3x4::identity())?;
//! let projection = Projection::from_camera(&intrinsics, &truth);
//! let boxes = landmarks.iter().map(|landmark| {
//!     let bounding_box = project_bounding_box(&projection, &landmark.body)?;
//!     Ok(QueryBox { bounding_box, box_in_image: None, category: landmark.category.clone() })
//! });
//! let boxes = boxes.collect::<Result<Vec<_>, quadlift::geometry::ProjectionError>>()?;
//! let query = Query { intrinsics, image_size: Some([640.0, 480.0].into()), boxes };
//! let map = LandmarkMap::new(landmarks);
//! let found = map.relocalize(&query, &LocateOptions::default());
//! assert_eq!(found.status, LocateStatus::Ok);
//! assert!((found.poses[0].cam_from_world.matrix() - truth.matrix()).norm() < 1e-6);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod check;
mod prepared;
mod refine;
mod score;
mod hypotheses;
#[cfg(test)]
mod tests;

use nalgebra::{Matrix6, Unit, Vector2, Vector3};

pub use self::check::{CommonMistake, LocatedImage};
use self::hypotheses::{Budget, Groups, MATCHED};
use self::prepared::PreparedQuery;
use crate::geometry::rigid::Pose;
use crate::geometry::{Body, BoundingBox, CamFromWorld, Intrinsics};
use crate::scene::{Scene, View};
use crate::solve::{BORDER_MARGIN, Covariance, Estimate, NoiseModel, Status, SupportCorrection};
use crate::tuning::CLEAR;

/// An object of the map whose place is known.
#[derive(Debug, Clone, PartialEq)]
pub struct Landmark {
    /// Its body, world frame.
    pub body: Body,
    /// Covariance of the body; without one it counts as exact.
    pub covariance: Option<Covariance>,
    /// Boxes of other categories are not this object. Without one any box may be.
    pub category: Option<String>,
    /// How much farther than its body it reaches, where views have shown that ([`correct`]).
    pub correction: Option<SupportCorrection>,
}

/// A box of an image whose camera is sought.
#[derive(Debug, Clone, PartialEq)]
pub struct QueryBox {
    /// The box, pixels without distortion.
    pub bounding_box: BoundingBox,
    /// Where it is in the image itself, whose border may cut it: only where a lens bends the image.
    pub box_in_image: Option<BoundingBox>,
    /// Its category, if known.
    pub category: Option<String>,
}

/// The boxes of one image.
#[derive(Debug, Clone, PartialEq)]
pub struct Query {
    /// The camera, without distortion.
    pub intrinsics: Intrinsics,
    /// Width and height in pixels: boxes at the border may be cut off there. Without it none is.
    pub image_size: Option<Vector2<f64>>,
    /// Its boxes.
    pub boxes: Vec<QueryBox>,
}

/// The direction against gravity, where a sensor tells it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Gravity {
    /// Upwards in the world.
    pub up_in_world: Unit<Vector3<f64>>,
    /// Upwards in the frame of the camera: x to the right, y down, z forwards.
    pub up_in_camera: Unit<Vector3<f64>>,
    /// Standard deviation of the angle between the two, each way, radians.
    pub sd: f64,
}

/// How high a camera is, where that is known.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CameraHeight {
    /// Upwards in the world.
    pub up_in_world: Unit<Vector3<f64>>,
    /// Coordinate of the camera's center along it, from the origin of the world, world units.
    pub height: f64,
    /// Its standard deviation, world units.
    pub sd: f64,
}

/// Options of [`LandmarkMap::relocalize`].
#[derive(Debug, Clone, PartialEq)]
pub struct LocateOptions {
    /// Standard deviation of the edges of boxes, relative to their mean half size.
    pub edge_noise: f64,
    /// Part of it that does not depend on the size of the box, pixels.
    pub edge_noise_px: f64,
    /// Share of the variance of edges that all images of an object have in common, because its body in the map is not quite its own;
    /// in [0, 1). Evidence of several images counts less by it ([`LandmarkMap::common_mistake`]).
    pub common_share: f64,
    /// Direction against gravity: two objects are then enough, more are examined as without it.
    pub gravity: Option<Gravity>,
    /// Height of the camera.
    pub height: Option<CameraHeight>,
}

impl Default for LocateOptions {
    /// Edges with 5 % and one pixel (docs/method/constants.csv), gravity and height unknown.
    fn default() -> Self {
        Self { edge_noise: EDGE_SD, edge_noise_px: EDGE_PX, common_share: 0.0, gravity: None, height: None }
    }
}

/// Usual standard deviation of the edges of a detector's boxes, relative to the half size.
const EDGE_SD: f64 = 0.05;

/// Part of the error of an edge that does not depend on the size of the box, pixels.
const EDGE_PX: f64 = 1.0;

/// How an image was located.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum LocateStatus {
    /// The first pose is the only one that explains the image.
    Ok,
    /// Several different poses explain it; they are all given, the most probable one first. Or not all could be examined, and none that was
    /// explains most of the boxes.
    Ambiguous,
    /// Fewer than three boxes (two with gravity) whose category is in the map.
    TooFewObjects,
    /// So many boxes may show so many objects, because they share a category, that no search could come far: hundreds of each.
    TooManyAlike,
    /// No pose explains it better than chance.
    NoPose,
    /// All images are clearly better explained once a common mistake is corrected. [`LandmarkMap::relocalize`] sees one image and does
    /// not check it: callers with several use [`LandmarkMap::common_mistake`].
    Inconsistent,
}

impl LocateStatus {
    /// Its name in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Ok => "ok",
            Self::Ambiguous => "ambiguous",
            Self::TooFewObjects => "too_few_objects",
            Self::TooManyAlike => "too_many_alike",
            Self::NoPose => "no_pose",
            Self::Inconsistent => "inconsistent",
        }
    }
}

/// A pose that explains the boxes of an image.
#[derive(Debug, Clone, PartialEq)]
pub struct LocatedPose {
    /// The pose.
    pub cam_from_world: CamFromWorld,
    /// Covariance of the camera's errors, in the frame of the camera: rotation vector (radians) and position (world units).
    pub covariance: Matrix6<f64>,
    /// Which box shows which landmark (indices), for boxes that are explained.
    pub matches: Vec<(usize, usize)>,
    /// Logarithm of the odds against boxes that come from nowhere (nats): the larger, the better.
    pub evidence: f64,
}

impl LocatedPose {
    /// Standard deviations of the rotation (radians) and the position (world units): root mean squares over the axes.
    pub fn sds(&self) -> [f64; 2] {
        [0, 3].map(|first| {
            let mean = self.covariance.fixed_view::<3, 3>(first, first).trace() / 3.0;
            mean.max(0.0).sqrt()
        })
    }
}

/// Where the camera of an image is.
#[derive(Debug, Clone, PartialEq)]
pub struct Relocalization {
    /// Whether the first pose can be trusted.
    pub status: LocateStatus,
    /// Poses that explain the image, the best first; with [`LocateStatus::Ok`] the others are less probable than 1 in 100.
    pub poses: Vec<LocatedPose>,
}

/// Matches of a pose that explains most boxes from which the search ends: chance does not explain as many.
const ENOUGH_MATCHES: usize = 6;

/// Poses that are told at most.
const MAX_POSES: usize = 8;

/// A map of objects in which images are located.
#[derive(Debug, Clone)]
pub struct LandmarkMap {
    landmarks: Vec<Landmark>,
    /// Of the closest ellipsoid of each, the smallest first.
    squared_axes: Vec<[f64; 3]>,
    /// Diameter of the map, world units.
    extent: f64,
}

impl Landmark {
    /// An object that was localized; `None` where it was not (its status is not [`Status::Ok`]).
    pub fn from_estimate(estimate: &Estimate, category: Option<String>) -> Option<Self> {
        (estimate.status == Status::Ok).then_some(())?;
        Some(Self { body: estimate.body?, covariance: estimate.covariance, category, correction: None })
    }

    /// Whether a box of this category may show it.
    fn may_be(&self, category: Option<&str>) -> bool {
        self.category.as_deref().zip(category).is_none_or(|(own, of_box)| own == of_box)
    }
}

/// Corrects the supports of landmarks by the residuals of the views of a scene (docs/method.md, section 13), which predicts boxes, and
/// locates images, more exactly. The detections of the scene are those that the bodies were estimated from; `objects` are the indices of the
/// landmarks in [`crate::scene::SceneParts::object_ids`].
pub fn correct(landmarks: &mut [Landmark], scene: &Scene, objects: &[usize]) {
    let hidden = scene.occluded_edges(|_| true);
    let groups = scene.detections_by_object(|_| true);
    let views = |&object: &usize| -> Vec<View> {
        let view = |&detection: &u32| View {
            occluded_edges: hidden[detection as usize],
            ..scene.view(&scene.detections[detection as usize]).within_margin(BORDER_MARGIN)
        };
        groups.get(object).map_or_else(Vec::new, |group| group.iter().map(view).collect())
    };
    let bodies: Vec<(&Body, Vec<View>)> =
        landmarks.iter().zip(objects).map(|(landmark, object)| (&landmark.body, views(object))).collect();
    let corrections = SupportCorrection::of_all(&bodies);
    landmarks.iter_mut().zip(corrections).for_each(|(landmark, correction)| landmark.correction = correction);
}

impl LocateOptions {
    /// The noise of boxes as it was estimated with a map ([`crate::solve::SceneSolution::noise`]), where it was. Errors that the views of an object
    /// have in common are in the covariances of the landmarks.
    pub fn with_noise(noise: &NoiseModel, landmarks: &[Landmark]) -> Self {
        let Some(edge_noise) = noise.get("edge_noise") else { return Self::default() };
        let edge_noise_px = noise.get("edge_noise_px").unwrap_or(EDGE_PX);
        let ratio = noise_ratio(landmarks);
        let (edge_noise, edge_noise_px) = (ratio * edge_noise, ratio * edge_noise_px);
        let common = noise.get("edge_common").unwrap_or(0.0).powi(2);
        Self { edge_noise, edge_noise_px, common_share: common / (1.0 + common), ..Self::default() }
    }
}

/// Noise of edges about corrected supports over that about bodies: root mean square of the landmarks.
fn noise_ratio(landmarks: &[Landmark]) -> f64 {
    let ratio = |landmark: &Landmark| landmark.correction.as_ref().map_or(1.0, SupportCorrection::noise_ratio);
    let sum: f64 = landmarks.iter().map(|landmark| ratio(landmark).powi(2)).sum();
    if landmarks.is_empty() { 1.0 } else { (sum / landmarks.len() as f64).sqrt() }
}

impl LandmarkMap {
    /// A map of these objects; those whose numbers are not finite are never found.
    pub fn new(landmarks: Vec<Landmark>) -> Self {
        let squared_axes = landmarks.iter().map(|landmark| {
            let mut squares: [f64; 3] = landmark.body.closest_ellipsoid().semi_axes.map(|x| x * x).into();
            squares.sort_by(f64::total_cmp);
            squares
        });
        let squared_axes = squared_axes.collect();
        let finite = || landmarks.iter().map(|l| l.body.center.coords).filter(|c| c.iter().all(|x| x.is_finite()));
        let low = finite().reduce(|a, b| a.inf(&b)).unwrap_or_default();
        let high = finite().reduce(|a, b| a.sup(&b)).unwrap_or_default();
        Self { extent: (high - low).norm(), squared_axes, landmarks }
    }

    /// Its objects.
    pub fn landmarks(&self) -> &[Landmark] {
        &self.landmarks
    }

    /// The pose of the camera of an image. The same input gives the same answer.
    pub fn relocalize(&self, query: &Query, options: &LocateOptions) -> Relocalization {
        let nowhere = |status| Relocalization { status, poses: Vec::new() };
        let mut budget = Budget::new(self, query);
        if budget.is_small() {
            return nowhere(LocateStatus::TooManyAlike);
        }
        let prepared = PreparedQuery::new(self, query, options);
        let needed = if options.gravity.is_some() { 2 } else { 3 };
        if prepared.boxes_with_candidates() < needed {
            return nowhere(LocateStatus::TooFewObjects);
        }
        let mut poses: Vec<LocatedPose> = Vec::new();
        let groups = Groups::new(&prepared);
        let explains_most = |pose: &LocatedPose| {
            pose.matches.len() >= ENOUGH_MATCHES && 2 * pose.matches.len() > prepared.boxes_with_candidates()
        };
        let (mut round, mut last) = (0, groups.rounds());
        while round < last && !budget.is_spent() {
            for start in hypotheses::starts(&prepared, &groups, round, &mut budget) {
                if budget.is_spent() && !poses.is_empty() {
                    break;
                }
                budget.spend(MATCHED);
                let found = score::located(&prepared, start).filter(|pose| pose.matches.len() >= needed);
                let Some(pose) = found else { continue };
                let at = Pose::from(&pose.cam_from_world);
                let is_same = |other: &LocatedPose| prepared.same_pose(&Pose::from(&other.cam_from_world), &at);
                match poses.iter_mut().find(|other| is_same(other)) {
                    Some(other) if other.evidence < pose.evidence => *other = pose,
                    Some(_) => {}
                    None => poses.push(pose),
                }
            }
            round += 1;
            if poses.iter().any(explains_most) {
                // Others that explain as much are found in as many rounds again.
                last = last.min(2 * round);
            }
        }
        let searched = groups.are_complete() && round == groups.rounds() && !budget.is_spent();
        poses.sort_by(|a, b| b.evidence.total_cmp(&a.evidence));
        poses.truncate(MAX_POSES);
        match &poses[..] {
            [] => nowhere(LocateStatus::NoPose),
            [best, ..] if best.evidence < CLEAR => Relocalization { status: LocateStatus::NoPose, poses },
            [best, second, ..] if best.evidence - second.evidence < CLEAR => {
                Relocalization { status: LocateStatus::Ambiguous, poses }
            }
            // A better one may be among those that were not examined.
            [best, ..] if !searched && !explains_most(best) => {
                Relocalization { status: LocateStatus::Ambiguous, poses }
            }
            _ => Relocalization { status: LocateStatus::Ok, poses },
        }
    }
}
