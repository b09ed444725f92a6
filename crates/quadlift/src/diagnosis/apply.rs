//! Corrections and mistakes applied to a whole scene.

use nalgebra::{Unit, Vector2, Vector3};

use super::camera::CameraParts;
use super::correction::{Correction, Mistake};
use crate::geometry::{BoundingBox, Ellipse};
use crate::scene::Scene;

impl Correction {
    /// The corrected scene. Detections without a frame or a measurement are dropped; lenses are not changed
    /// (measurements undistorted with wrong intrinsics are not undistorted again).
    pub fn apply(&self, scene: &Scene) -> Scene {
        let mut corrected = rewrite(
            scene,
            |camera, size| self.camera(camera, size),
            |b, camera, size| self.bounding_box(b, &camera.intrinsics, size),
            |e, size| self.ellipse(e, size),
            self.frames(&ids(scene)),
        );
        if let Self::Up(up) = self {
            corrected.0.up = Unit::try_new(Vector3::from(*up), 0.0).or(scene.up);
        }
        corrected
    }
}

impl Mistake {
    /// The scene as the mistake writes it; see [`Correction::apply`].
    pub fn apply(&self, scene: &Scene) -> Scene {
        rewrite(
            scene,
            |camera, size| {
                let (rotation, translation) = self.pose(&camera.rotation, &camera.translation);
                Some(CameraParts { intrinsics: self.intrinsics(&camera.intrinsics, size)?, rotation, translation })
            },
            |b, camera, size| self.bounding_box(b, &camera.intrinsics, size),
            |e, _| Some(*e),
            self.frames(&ids(scene)),
        )
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
        detection.bounding_box = detection.bounding_box.and_then(|b| box_of(&b, camera?, size));
        detection.ellipse = detection.ellipse.and_then(|e| ellipse_of(&e, size));
        detection.bounding_box.is_some() || detection.ellipse.is_some()
    });
    Scene(result)
}
