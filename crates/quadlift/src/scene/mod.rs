//! What users bring: posed frames and the detections in them, validated and indexed.
//!
//! A [`Scene`] is built with [`SceneBuilder`]; after that no solver meets an unknown id, an empty box or a NaN.

mod builder;
mod hidden;
mod skipped;
mod sources;
mod views;

pub use builder::{DetectionInput, SceneBuilder, SceneError};
pub use hidden::hidden_edges;
pub use skipped::SkippedDetections;
pub use sources::SourceError;
pub use views::{BORDER_TOLERANCE_PX, ObjectViews, View, edges_at_border};

use std::ops::Deref;

use nalgebra::{Unit, Vector2, Vector3};

use crate::geometry::{BoundingBox, Camera, Ellipse, Projection, SupportLines};

/// Posed frames and detections, checked, with every reference resolved to an index.
///
/// It reads like its [`SceneParts`]; [`Scene::edit`] changes it.
#[derive(Debug, Clone, Default)]
pub struct Scene(pub(crate) SceneParts);

/// What a [`Scene`] holds.
#[derive(Debug, Clone, Default)]
pub struct SceneParts {
    /// Name of the scene, for messages.
    pub name: String,
    /// World unit ("m", ...), where it is known.
    pub length_unit: Option<String>,
    /// World direction against gravity, where it is known.
    pub up: Option<Unit<Vector3<f64>>>,
    /// The posed images.
    pub frames: Vec<Frame>,
    /// The detections, in the order of the input.
    pub detections: Vec<Detection>,
    /// Ids of the objects that the detections name; [`Detection::object_index`] points here.
    pub object_ids: Vec<String>,
    /// Categories that the detections name; [`Detection::category_index`] points here.
    pub categories: Vec<String>,
    /// Sources (detectors) that the detections name; [`Detection::source_index`] points here.
    pub sources: Vec<String>,
}

impl Deref for Scene {
    type Target = SceneParts;

    fn deref(&self) -> &SceneParts {
        &self.0
    }
}

impl Scene {
    /// A scene of these parts.
    ///
    /// # Errors
    /// [`SceneError`] when an index points nowhere, two frames share an id, an image size is not positive, or one source has
    /// two detections of one object in one frame.
    pub fn from_parts(parts: SceneParts) -> Result<Self, SceneError> {
        builder::check_parts(&parts)?;
        Ok(Self(parts))
    }

    /// Changes the scene and checks it again.
    ///
    /// ```
    /// # let mut scene = quadlift::synthetic::generate(&Default::default()).unwrap().scene;
    /// // Detections with a score of at least one half, and those without a score.
    /// scene.edit(|parts| parts.detections.retain(|d| d.score.is_none_or(|score| score >= 0.5)))?;
    /// # Ok::<(), quadlift::scene::SceneError>(())
    /// ```
    ///
    /// # Errors
    /// As [`Scene::from_parts`]; the scene stays as it was.
    pub fn edit(&mut self, change: impl FnOnce(&mut SceneParts)) -> Result<(), SceneError> {
        let mut parts = self.0.clone();
        change(&mut parts);
        *self = Self::from_parts(parts)?;
        Ok(())
    }

    /// Sets the supporting lines of a detection's mask, by the index of the detection. Nothing where there is no such
    /// detection.
    pub fn set_support_lines(&mut self, detection: usize, lines: Option<SupportLines>) {
        if let Some(detection) = self.0.detections.get_mut(detection) {
            detection.support_lines = lines.map(Box::new);
        }
    }

    /// The parts of the scene.
    pub fn into_parts(self) -> SceneParts {
        self.0
    }
}

/// A posed image.
#[derive(Debug, Clone)]
pub struct Frame {
    /// Id of the frame.
    pub id: String,
    /// World to pixels; where there is a lens, to those of its pinhole camera ([`Camera::pinhole`]).
    pub projection: Projection,
    /// Width and height of the image as it is, in pixels, where known; without them no box edge counts as cut off.
    pub image_size: Option<Vector2<f64>>,
    /// The camera that made the image, where it has lens distortion. The measurements of a scene are undistorted
    /// already; this is for what is measured in the image later.
    pub lens: Option<Camera>,
}

/// What was measured in an image, in the pixels of [`Frame::projection`].
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
    /// A box and an ellipse that were measured in the image as it is, without the distortion of its lens. What the lens
    /// has no pinhole pixels for (see [`Camera::undistort_point`]) is left out.
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

/// One detection of one object in one frame: a box, an ellipse or both, in the pixels of [`Frame::projection`]. Neither
/// where the lens has no pinhole pixels for it; [`crate::localize()`] leaves such detections out.
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
    /// The supporting lines of the mask in pixels, where it was looked at: a scene is built without them. Boxed, because
    /// most of millions of detections have none.
    pub support_lines: Option<Box<SupportLines>>,
    /// Whether ellipse and mask may be of a part of the object: the border of the image or another object cuts them.
    pub partial: bool,
    /// Where a lens bends the image: the measured box, or the box around the measured ellipse, in the image itself,
    /// whose border may cut it.
    pub box_in_image: Option<BoundingBox>,
    /// Which edges of the box another detection of the frame hides, where it was found before: what hides them need not be
    /// in the scene. Without it the scene's own boxes tell ([`Scene::hidden_edges`]).
    pub hidden_edges: Option<[bool; 4]>,
    /// Occlusion level (KITTI: 0 visible, 1 partly, 2 largely, 3 unknown).
    pub occluded: Option<f64>,
    /// Truncation level (KITTI: 0 wholly inside the image).
    pub truncated: Option<f64>,
}
