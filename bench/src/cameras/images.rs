//! Maps from some frames of a scene, and the other frames located in them.

use quadlift::geometry::{CamFromWorld, rotation_vector};
use quadlift::nalgebra::{Matrix6, Rotation3, Unit, Vector3, Vector6};
use quadlift::relocalize::{Gravity, Landmark, LandmarkMap, LocateOptions, LocateStatus, Query, QueryBox, correct};
use quadlift::scene::Scene;
use quadlift::{LocalizeOptions, localize};

use super::centers::locate_by_centers;
use crate::error::Error;
use crate::table::Cell;

/// Which frames make the map; the others are located.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Split {
    /// Every second one.
    Alternate,
    /// Those of one side of the scene.
    Halves,
}

impl Split {
    pub(super) const ALL: [Self; 2] = [Self::Alternate, Self::Halves];

    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Alternate => "every second frame",
            Self::Halves => "one side",
        }
    }

    /// Whether each frame of a scene makes the map.
    fn is_of_map(self, scene: &Scene) -> Vec<bool> {
        let count = scene.frames.len();
        match self {
            Self::Alternate => (0..count).map(|k| k % 2 == 0).collect(),
            Self::Halves => {
                // The frames on one side of the plane through the middle of the cameras that divides them best: across the
                // direction, among 180 horizontal ones, along which the halves are farthest apart.
                let centers: Vec<Vector3<f64>> =
                    scene.frames.iter().map(|f| f.projection.center_in_world().unwrap_or_default().coords).collect();
                let up = scene.up.unwrap_or(Vector3::z_axis());
                let side = any_across(&up);
                let other = up.cross(&side);
                let along = |angle: f64| {
                    let direction = side * angle.cos() + other * angle.sin();
                    let mut places: Vec<(f64, usize)> =
                        centers.iter().enumerate().map(|(k, center)| (center.dot(&direction), k)).collect();
                    places.sort_by(|a, b| a.0.total_cmp(&b.0));
                    places
                };
                let apart = |places: &[(f64, usize)]| {
                    let sum =
                        |of: &[(f64, usize)]| of.iter().map(|place| place.0).sum::<f64>() / of.len().max(1) as f64;
                    sum(&places[count / 2..]) - sum(&places[..count / 2])
                };
                let all = (0..180).map(|k| along(f64::from(k).to_radians()));
                let best = all.max_by(|a, b| apart(a).total_cmp(&apart(b))).unwrap_or_default();
                let mut of_map = vec![false; count];
                best[..count / 2].iter().for_each(|&(_, frame)| of_map[frame] = true);
                of_map
            }
        }
    }
}

/// A direction across another one.
pub(crate) fn any_across(up: &Unit<Vector3<f64>>) -> Vector3<f64> {
    let other = if up.x.abs() < 0.5 { Vector3::x() } else { Vector3::y() };
    up.cross(&other).normalize()
}

/// An image that is located, with the truth.
#[derive(Debug, Clone)]
pub(crate) struct Image {
    pub query: Query,
    pub truth: CamFromWorld,
    /// Boxes of objects of the map.
    pub seen: usize,
}

/// A map and the images that are located in it.
#[derive(Debug, Clone)]
pub(crate) struct MapAndImages {
    pub map: LandmarkMap,
    pub options: LocateOptions,
    pub up: Option<Unit<Vector3<f64>>>,
    pub images: Vec<Image>,
}

/// Makes a map of the objects that some frames of a scene show, by their ids, and the boxes of the other frames without ids.
pub(crate) fn divide(scene: &Scene, split: Split, options: &LocalizeOptions) -> Result<MapAndImages, Error> {
    let of_map = split.is_of_map(scene);
    let mut half = scene.clone();
    half.edit(|parts| parts.detections.retain(|d| of_map[d.frame_index as usize] && d.object_index.is_some()))?;
    let found = localize(&half, options)?;
    let (mut objects, mut places) = (Vec::new(), Vec::new());
    let mut landmarks = Vec::new();
    for estimate in &found.estimates {
        let category = estimate.category_index.map(|index| half.categories[index].clone());
        if let Some(landmark) = Landmark::from_estimate(estimate, category) {
            objects.push(half.object_ids[estimate.object_index].clone());
            places.push(estimate.object_index);
            landmarks.push(landmark);
        }
    }
    correct(&mut landmarks, &half, &places);
    let mut images = Vec::new();
    for (index, frame) in scene.frames.iter().enumerate().filter(|(index, _)| !of_map[*index]) {
        let (Some(truth), Some(intrinsics)) = (frame.projection.camera_pose(), frame.projection.intrinsics()) else {
            continue;
        };
        let mut query = Query { intrinsics, image_size: frame.image_size, boxes: Vec::new() };
        let mut seen = 0;
        for detection in scene.detections.iter().filter(|d| d.frame_index as usize == index) {
            let Some(bounding_box) = scene.view(detection).measured_box() else { continue };
            let category = detection.category_index.map(|k| scene.categories[k as usize].clone());
            query.boxes.push(QueryBox { bounding_box, box_in_image: detection.box_in_image, category });
            seen +=
                usize::from(detection.object_index.is_some_and(|k| objects.contains(&scene.object_ids[k as usize])));
        }
        images.push(Image { query, truth, seen });
    }
    Ok(MapAndImages {
        options: LocateOptions::with_noise(&found.noise, &landmarks),
        map: LandmarkMap::new(landmarks),
        up: scene.up,
        images,
    })
}

/// How images were located.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Tally {
    pub images: usize,
    /// Within the bounds, and claimed to be right.
    pub right: usize,
    /// Beyond them, and claimed to be right.
    pub wrong: usize,
    /// Of the wrong ones, those that their own covariance excludes; without a covariance all.
    pub excluded: usize,
}

impl Tally {
    /// Counts a pose that is claimed to be right, if there is one; `covariance` is that of its errors, as of
    /// [`LocatedPose`](quadlift::relocalize::LocatedPose).
    fn add(
        &mut self,
        claimed: Option<&CamFromWorld>,
        covariance: Option<&Matrix6<f64>>,
        truth: &CamFromWorld,
        bound: f64,
    ) {
        self.images += 1;
        let Some(pose) = claimed else { return };
        if is_within(pose, truth, bound) {
            self.right += 1;
            return;
        }
        self.wrong += 1;
        let is_excluded = covariance.is_none_or(|covariance| normalized_square(pose, covariance, truth) > EXCLUDED);
        self.excluded += usize::from(is_excluded);
    }

    pub(super) fn plus(self, other: Self) -> Self {
        Self {
            images: self.images + other.images,
            right: self.right + other.right,
            wrong: self.wrong + other.wrong,
            excluded: self.excluded + other.excluded,
        }
    }

    /// Number of images; percentages within the bounds, wrong although claimed, of these excluded by the covariance, refused.
    pub(super) fn cells(&self) -> Vec<Cell> {
        let percent = |n: usize| Cell::number(100.0 * n as f64 / self.images.max(1) as f64, 1);
        let refused = self.images - self.right - self.wrong;
        let images = Cell::number(self.images as f64, 0);
        vec![images, percent(self.right), percent(self.wrong), percent(self.excluded), percent(refused)]
    }
}

/// Titles of [`Tally::cells`].
pub(super) const TITLES: [&str; 5] = ["images", "right [%]", "wrong [%]", "excluded [%]", "refused [%]"];

/// The normalized squared error with six parameters that one in a thousand exceeds.
const EXCLUDED: f64 = 22.46;

/// The normalized squared error of a pose: of the motion of the camera, in its frame, that leads to the truth.
fn normalized_square(pose: &CamFromWorld, covariance: &Matrix6<f64>, truth: &CamFromWorld) -> f64 {
    let (from, to) = (pose.matrix(), truth.matrix());
    let turn = to.fixed_columns::<3>(0) * from.fixed_columns::<3>(0).transpose();
    let shift = to.column(3) - turn * from.column(3);
    let turn = rotation_vector(&Rotation3::from_matrix_unchecked(turn));
    let error = Vector6::new(turn.x, turn.y, turn.z, shift.x, shift.y, shift.z);
    covariance.cholesky().map_or(f64::INFINITY, |root| error.dot(&root.solve(&error)))
}

/// Largest error of the rotation, degrees.
const MAX_DEGREES: f64 = 5.0;

/// Whether a pose is so near to the truth: position in world units, rotation in degrees.
pub(crate) fn is_within(pose: &CamFromWorld, truth: &CamFromWorld, bound: f64) -> bool {
    let parts =
        |pose: &CamFromWorld| (pose.matrix().fixed_columns::<3>(0).into_owned(), pose.matrix().column(3).into_owned());
    let ((r0, t0), (r1, t1)) = (parts(pose), parts(truth));
    let apart = (r0.tr_mul(&t0) - r1.tr_mul(&t1)).norm();
    let angle = 2.0 * ((r0 - r1).norm() / 8f64.sqrt()).min(1.0).asin();
    apart < bound && angle.to_degrees() < MAX_DEGREES
}

/// What is known of the cameras.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Known {
    Nothing,
    /// The direction of gravity, to one degree.
    Gravity,
}

/// Standard deviation of the known direction, radians.
const GRAVITY_SD: f64 = 0.017;

/// Locates the images with the library; `least` is the smallest number of objects of the map in an image that counts.
pub(super) fn located(all: &MapAndImages, known: Known, least: usize, bound: f64) -> Tally {
    let mut tally = Tally::default();
    for image in all.images.iter().filter(|image| image.seen >= least) {
        let gravity = all.up.filter(|_| known == Known::Gravity).map(|up_in_world| Gravity {
            up_in_world,
            up_in_camera: Unit::new_normalize(image.truth.matrix().fixed_columns::<3>(0) * up_in_world.into_inner()),
            sd: GRAVITY_SD,
        });
        let found = all.map.relocalize(&image.query, &LocateOptions { gravity, ..all.options.clone() });
        let best = found.poses.first().filter(|_| found.status == LocateStatus::Ok);
        let covariance = best.map(|pose| &pose.covariance);
        tally.add(best.map(|pose| &pose.cam_from_world), covariance, &image.truth, bound);
    }
    tally
}

/// Locates them by the centers of boxes.
pub(super) fn located_by_centers(all: &MapAndImages, least: usize, bound: f64, seed: u64) -> Tally {
    let mut tally = Tally::default();
    for image in all.images.iter().filter(|image| image.seen >= least) {
        let found = locate_by_centers(&all.map, &image.query, seed);
        tally.add(found.as_ref(), None, &image.truth, bound);
    }
    tally
}
