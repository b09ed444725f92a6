//! The contents of a report, and how much of them a page shows.

use quadlift::scene::Scene;
use quadlift_io::SceneFile;
use quadlift_io::scene_file::SceneImages;

use crate::scores::Scores;

/// Target size of a page in bytes: images fill what the other data leave.
pub const MAX_BYTES: usize = 30_000_000;
/// Largest number of frames in a report; of more, an evenly spread selection is shown.
pub const MAX_FRAMES: usize = 10_000;
/// Largest number of objects in a report; of more, the first are shown.
pub const MAX_OBJECTS: usize = 10_000;
/// Detections in a report; with more, only every second frame keeps its own, or every third, and so on.
pub const MAX_DETECTIONS: usize = 500_000;

/// The contents of a report.
#[derive(Debug, Clone, Copy)]
pub struct Content<'a> {
    /// Title of the page.
    pub title: &'a str,
    /// Frames and detections.
    pub scene: &'a Scene,
    /// The images of the scene's frames.
    pub images: Option<&'a SceneImages>,
    /// A result: the objects with a `status` are estimates.
    pub estimate: Option<&'a SceneFile>,
    /// A scene whose objects are the truth.
    pub truth: Option<&'a SceneFile>,
    /// Show only the detections of this source; by default that of the estimate.
    pub source: Option<&'a str>,
    /// Points of the scene's surfaces in the world, shown as context.
    pub points: &'a [[f64; 3]],
    /// Scores of the estimates against the truth.
    pub scores: Option<&'a Scores>,
}
