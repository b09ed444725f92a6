//! The parts of a scene: frames and detections.

use std::collections::{BTreeSet, HashMap, HashSet};

use nalgebra::{Unit, Vector2, Vector3};

use super::cues::Cues;
use super::error::SceneError;
use super::points::{TrackedPoint, check_points};
use crate::geometry::{BoundingBox, Camera, Ellipse, Projection, TangentLines};

/// The contents of a [`super::Scene`].
#[derive(Debug, Clone, Default)]
pub struct SceneParts {
    /// Name of the scene, for messages.
    pub name: String,
    /// World unit ("m", ...), if known.
    pub length_unit: Option<String>,
    /// World direction against gravity, if known.
    pub up: Option<Unit<Vector3<f64>>>,
    /// The posed images.
    pub frames: Vec<Frame>,
    /// The detections, in the order of the input.
    pub detections: Vec<Detection>,
    /// Object ids of the detections; [`Detection::object_index`] points here.
    pub object_ids: Vec<String>,
    /// Categories of the detections; [`Detection::category_index`] points here.
    pub categories: Vec<String>,
    /// Sources (detectors) of the detections; [`Detection::source_index`] points here.
    pub sources: Vec<String>,
    /// Sources of cues (a depth network, a LiDAR, a 3D detector); the cues of [`Detection::cues`] point here.
    pub cue_sources: Vec<String>,
    /// Sources whose depths have another scale in each frame, as networks have that estimate depth up to scale: indices into
    /// `cue_sources`.
    pub scaled_by_frame: BTreeSet<u32>,
    /// Sources whose depths are lengths of the world, as those of points that were triangulated with its poses: no scale is estimated.
    /// Indices into `cue_sources`.
    pub scale_known: BTreeSet<u32>,
    /// Points with the pixels in which frames observed them. They tell errors of poses ([`crate::solve::PosteriorOptions::refine_poses`]).
    pub points: Vec<TrackedPoint>,
}

/// A posed image.
#[derive(Debug, Clone)]
pub struct Frame {
    /// Id of the frame.
    pub id: String,
    /// World to pixels; with a lens model, to pixels of its pinhole camera ([`Camera::pinhole`]).
    pub projection: Projection,
    /// Width and height of the original image in pixels, if known; without them no box edge is treated as cut off.
    pub image_size: Option<Vector2<f64>>,
    /// The camera of the image, if it has lens distortion. The measurements of a scene are already undistorted; this is
    /// for later measurements in the image.
    pub lens: Option<Camera>,
    /// When and by which camera of a rig it was taken, if by one.
    pub rig: Option<RigCamera>,
}

/// When and by which camera of a rig an image was taken. The images of one time step have poses with a common error
/// ([`crate::solve::PosteriorOptions::refine_poses`]).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RigCamera {
    /// Number of the time step; greater ones are later.
    pub time_step: u64,
    /// Number of the camera, from 0, if it is known which one.
    pub camera: Option<u32>,
}

/// Measurements in an image, in the pixels of [`Frame::projection`].
#[derive(Debug, Clone, Copy, Default)]
pub struct Undistorted {
    /// The box.
    pub bounding_box: Option<BoundingBox>,
    /// The ellipse.
    pub ellipse: Option<Ellipse>,
    /// Where they are in the image, see [`Detection::box_in_image`].
    pub box_in_image: Option<BoundingBox>,
}

impl Frame {
    /// A box and an ellipse that were measured in the image as it is, without the distortion of its lens. Measurements
    /// without pinhole pixels (see [`Camera::undistort_point`]) are dropped.
    pub fn undistorted(&self, bounding_box: Option<BoundingBox>, ellipse: Option<Ellipse>) -> Undistorted {
        let Some(lens) = &self.lens else { return Undistorted { bounding_box, ellipse, box_in_image: None } };
        Undistorted {
            bounding_box: bounding_box.and_then(|b| lens.undistort_box(&b)),
            ellipse: ellipse.and_then(|e| lens.undistort_ellipse(&e)),
            // The solvers prefer ellipses.
            box_in_image: ellipse.map(|e| e.bounding_box()).or(bounding_box),
        }
    }
}

/// One detection of one object in one frame: a box, an ellipse or both, in the pixels of [`Frame::projection`], or a 3D box alone. None of
/// them if the lens has no pinhole pixels for it; [`crate::localize()`] skips such detections.
#[derive(Debug, Clone, Default)]
pub struct Detection {
    /// Index into [`SceneParts::frames`].
    pub frame_index: u32,
    /// Index into [`SceneParts::object_ids`]; absent when the identity is not known.
    pub object_index: Option<u32>,
    /// Index into [`SceneParts::categories`].
    pub category_index: Option<u32>,
    /// Index into [`SceneParts::sources`].
    pub source_index: Option<u32>,
    /// Score of the detector, in [0, 1] by custom.
    pub score: Option<f64>,
    /// The box in pixels.
    pub bounding_box: Option<BoundingBox>,
    /// The ellipse in pixels.
    pub ellipse: Option<Ellipse>,
    /// The tangent lines in pixels of the outline or the oriented box; of a mask if computed, because a scene is built without them.
    /// Boxed, because most detections have none.
    pub tangent_lines: Option<Box<TangentLines>>,
    /// Whether ellipse and mask may be of a part of the object: the border of the image or another object cuts them.
    pub partial: bool,
    /// With lens distortion: the measured box, or the box around the measured ellipse, in the original image, whose
    /// border may cut it.
    pub box_in_image: Option<BoundingBox>,
    /// Which edges of the box are hidden by another detection of the frame, if precomputed: the hiding detection need
    /// not be in the scene. Otherwise computed from the boxes of the scene ([`super::Scene::occluded_edges`]).
    pub occluded_edges: Option<[bool; 4]>,
    /// Occlusion level (KITTI: 0 visible, 1 partly, 2 largely, 3 unknown).
    pub occluded: Option<f64>,
    /// Truncation level (KITTI: 0 wholly inside the image).
    pub truncated: Option<f64>,
    /// Depth and 3D box. Boxed, because most detections have none.
    pub cues: Option<Box<Cues>>,
}

impl Detection {
    /// The box of the measurement in pixels: the box itself, or the one around the ellipse.
    pub(crate) fn measured_box(&self) -> Option<BoundingBox> {
        self.bounding_box.or_else(|| self.ellipse.map(|ellipse| ellipse.bounding_box()))
    }

    /// Whether it says where the object is: by a box, an ellipse, or a 3D box with a center.
    pub fn is_measured(&self) -> bool {
        self.bounding_box.is_some() || self.ellipse.is_some() || self.cues.as_deref().is_some_and(Cues::have_center)
    }
}

/// Whether parts make a scene, see [`super::Scene::from_parts`].
pub(super) fn check_parts(parts: &SceneParts) -> Result<(), SceneError> {
    let counts = [parts.frames.len(), parts.detections.len(), parts.object_ids.len()];
    if counts.into_iter().any(|count| u32::try_from(count).is_err()) {
        return Err(SceneError::TooLarge);
    }
    let mut ids = HashSet::with_capacity(parts.frames.len());
    for frame in &parts.frames {
        if !ids.insert(frame.id.as_str()) {
            return Err(SceneError::DuplicateFrame(frame.id.clone()));
        }
        if let Some(size) = frame.image_size
            && !(size.min() > 0.0 && size.iter().all(|x| x.is_finite()))
        {
            return Err(SceneError::ImageSize { width: size.x, height: size.y });
        }
    }
    check_points(&parts.points, parts.frames.len())?;
    let mut seen = HashMap::new();
    for (detection, d) in parts.detections.iter().enumerate() {
        let cues = d.cues.as_deref().copied().unwrap_or_default();
        cues.check()?;
        let indices = [
            ("frame", Some(d.frame_index), parts.frames.len()),
            ("object", d.object_index, parts.object_ids.len()),
            ("category", d.category_index, parts.categories.len()),
            ("source", d.source_index, parts.sources.len()),
            ("cue source", cues.sources().max(), parts.cue_sources.len()),
        ];
        for (what, index, count) in indices {
            if let Some(index) = index.filter(|&index| index as usize >= count) {
                return Err(SceneError::IndexOutOfRange { detection, what, index, count });
            }
        }
        let Some(object) = d.object_index else { continue };
        if let Some(first) = seen.insert((object, d.frame_index, d.source_index), detection) {
            let (object, frame) = (parts.object_ids[object as usize].clone(), &parts.frames[d.frame_index as usize]);
            return Err(SceneError::DuplicateDetection { object, frame: frame.id.clone(), first, second: detection });
        }
    }
    Ok(())
}
