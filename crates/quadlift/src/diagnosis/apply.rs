//! Corrections and mistakes applied to a whole scene.

use nalgebra::{Unit, Vector2, Vector3};

use super::camera::CameraParts;
use super::correction::{Correction, Mistake};
use crate::geometry::{BoundingBox, Ellipse};
use crate::scene::Scene;

impl Correction {
    /// The corrected scene. Detections without a frame or a measurement are dropped; lenses are not changed
    /// (measurements undistorted with wrong intrinsics are not undistorted again). Depths and 3D boxes stay where they are in the
    /// frame of the camera; their lengths are in the world's unit. Where the box changes, the tangent lines of an outline are
    /// dropped, and so are tracked points: correct the scene file to keep them.
    pub(crate) fn apply(&self, scene: &Scene) -> Scene {
        let mut corrected = rewrite(
            scene,
            |camera, size| self.camera(camera, size),
            |b, camera, size| self.bounding_box(b, &camera.intrinsics, size),
            |e, size| self.ellipse(e, size),
            self.frames(&ids(scene)),
        );
        match *self {
            Self::Up(up) => corrected.0.up = Unit::try_new(Vector3::from(up), 0.0).or(scene.up),
            Self::Lengths(factor) => scale_cues(&mut corrected, factor),
            _ => {}
        }
        corrected
    }
}

impl Mistake {
    /// The scene as the mistake writes it; see `Correction::apply`.
    pub fn apply(&self, scene: &Scene) -> Scene {
        let mut mistaken = rewrite(
            scene,
            |camera, size| {
                let (rotation, translation) = self.pose(&camera.rotation, &camera.translation);
                Some(CameraParts { intrinsics: self.intrinsics(&camera.intrinsics, size)?, rotation, translation })
            },
            |b, camera, size| self.bounding_box(b, &camera.intrinsics, size),
            |e, _| Some(*e),
            self.frames(&ids(scene)),
        );
        if let Correction::Lengths(factor) = self.0 {
            scale_cues(&mut mistaken, 1.0 / factor);
        }
        mistaken
    }
}

/// Multiplies the lengths of all depths and 3D boxes.
fn scale_cues(scene: &mut Scene, factor: f64) {
    for cues in scene.0.detections.iter_mut().filter_map(|detection| detection.cues.as_deref_mut()) {
        *cues = cues.scaled(factor);
    }
}

fn ids(scene: &Scene) -> Vec<&str> {
    scene.frames.iter().map(|frame| frame.id.as_str()).collect()
}

fn rewrite(
    scene: &Scene,
    camera_of: impl Fn(&CameraParts, Option<Vector2<f64>>) -> Option<CameraParts>,
    box_of: impl Fn(&BoundingBox, &CameraParts, Option<Vector2<f64>>) -> Option<BoundingBox>,
    ellipse_of: impl Fn(&Ellipse, Option<Vector2<f64>>) -> Option<Ellipse>,
    frames: Option<Vec<Option<usize>>>,
) -> Scene {
    let mut result = scene.clone().into_parts();
    result.points = Vec::new();
    let given: Vec<Option<CameraParts>> =
        scene.frames.iter().map(|frame| CameraParts::from_projection(&frame.projection)).collect();
    for (frame, camera) in result.frames.iter_mut().zip(&given) {
        let changed = camera.and_then(|camera| camera_of(&camera, frame.image_size)?.projection());
        frame.projection = changed.unwrap_or(frame.projection);
    }
    result.detections.retain_mut(|detection| {
        let from = detection.frame_index as usize;
        let Some(to) = frames.as_ref().map_or(Some(from), |frames| frames[from]) else { return false };
        let (camera, size) = (given[from].as_ref(), scene.frames[from].image_size);
        detection.frame_index = to as u32;
        let given = detection.bounding_box;
        detection.bounding_box = given.and_then(|b| box_of(&b, camera?, size));
        if detection.bounding_box != given {
            detection.tangent_lines = None;
        }
        detection.ellipse = detection.ellipse.and_then(|e| ellipse_of(&e, size));
        detection.is_measured()
    });
    Scene(result)
}
