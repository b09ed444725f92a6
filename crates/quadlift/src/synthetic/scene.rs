//! A synthetic scene and what is true about it.

use crate::geometry::{Body, CamFromWorld, Intrinsics};
use crate::scene::Scene;

/// A scene and its ground truth.
#[derive(Debug, Clone)]
pub struct SyntheticScene {
    /// The scene as an estimator gets it: no categories, no sources, no length unit. The detections of true objects are
    /// ordered by object, then by frame; false boxes and duplicates come after them, by frame.
    pub scene: Scene,
    /// Id ("object_000", ...) and true body of each object, in the world of the scene.
    pub truth: Vec<(String, Body)>,
    /// The cameras, in the order of the scene's frames, with intrinsics and pose apart.
    pub frames: Vec<SyntheticFrame>,
    /// For each detection of the scene, whether it was replaced by an outlier.
    pub outliers: Vec<bool>,
    /// For each detection of the scene, the index of its object in `truth`; absent for false boxes and duplicates.
    pub true_objects: Vec<Option<usize>>,
}

/// A camera of a synthetic scene.
#[derive(Debug, Clone, PartialEq)]
pub struct SyntheticFrame {
    /// Id of the frame ("000000", ...).
    pub id: String,
    /// Intrinsics, pixels.
    pub intrinsics: Intrinsics,
    /// Pose, with its noise.
    pub cam_from_world: CamFromWorld,
    /// Width of the image in pixels.
    pub width: u32,
    /// Height of the image in pixels.
    pub height: u32,
}
