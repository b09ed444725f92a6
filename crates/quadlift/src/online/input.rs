//! What an object map observes: posed images and the detections in them.

use std::collections::BTreeSet;

use nalgebra::Vector2;

use crate::geometry::{Camera, Projection};
use crate::scene::{self, CueError, OutlineError, Scene};
use crate::solve::PoseNoise;

/// A posed image at a time step.
#[derive(Debug, Clone)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Frame {
    /// Its id, by which [`super::ObjectMap::update_poses`] finds it again.
    pub id: String,
    /// Time in seconds, from any origin. It never goes back.
    pub time: f64,
    /// World to pixels; where there is a lens, to those of its pinhole camera ([`Camera::pinhole`]).
    pub projection: Projection,
    /// Width and height of the image in pixels, where known.
    pub image_size: Option<Vector2<f64>>,
    /// The camera that made the image, where it has lens distortion.
    pub lens: Option<Camera>,
    /// Standard deviations of the pose, where known.
    pub pose_noise: Option<PoseNoise>,
    /// Names of the sources of the cues of its detections, by their indices.
    #[cfg_attr(feature = "serde", serde(default, skip_serializing_if = "Vec::is_empty"))]
    pub cue_sources: Vec<String>,
    /// Sources whose depths have another scale in each frame, as indices; see [`scene::SceneParts::scaled_by_frame`].
    #[cfg_attr(feature = "serde", serde(default, skip_serializing_if = "BTreeSet::is_empty"))]
    pub scaled_by_frame: BTreeSet<u32>,
}

impl Frame {
    /// A frame without what need not be known.
    pub fn new(id: String, time: f64, projection: Projection) -> Self {
        Self {
            id,
            time,
            projection,
            image_size: None,
            lens: None,
            pose_noise: None,
            cue_sources: Vec::new(),
            scaled_by_frame: BTreeSet::new(),
        }
    }

    /// A frame of a scene with a time.
    pub fn of_scene(scene: &Scene, frame: &scene::Frame, time: f64) -> Self {
        Self {
            image_size: frame.image_size,
            lens: frame.lens,
            cue_sources: scene.cue_sources.clone(),
            scaled_by_frame: scene.scaled_by_frame.clone(),
            ..Self::new(frame.id.clone(), time, frame.projection)
        }
    }

    /// The frame of a scene.
    pub(super) fn to_scene(&self) -> scene::Frame {
        let Self { projection, image_size, lens, .. } = *self;
        scene::Frame { id: self.id.clone(), projection, image_size, lens, rig: None }
    }
}

/// Why a frame was refused. The map is unchanged.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ObserveError {
    /// A frame of this id is in the map.
    #[error("frame {0:?} was observed before")]
    DuplicateFrame(String),
    /// The time is not a number.
    #[error("the time of frame {0:?} is not a finite number")]
    Time(String),
    /// The time is earlier than that of the frame before.
    #[error(
        "frame {id:?} is of time {time}, but the frame before it is of time {last}; expected frames in the order of time"
    )]
    TimeWentBack {
        /// Id of the frame.
        id: String,
        /// Its time.
        time: f64,
        /// The time of the last frame.
        last: f64,
    },
    /// The image size is not positive.
    #[error("the image size of frame {id:?} is {width} x {height}; expected positive numbers")]
    ImageSize {
        /// Id of the frame.
        id: String,
        /// Width.
        width: f64,
        /// Height.
        height: f64,
    },
    /// The projection has no center in the world.
    #[error("the camera of frame {0:?} has no finite center")]
    NoCenter(String),
    /// Too many detections.
    #[error("frame {id:?} has {count} detections; expected {} at most", super::MAX_DETECTIONS)]
    TooManyDetections {
        /// Id of the frame.
        id: String,
        /// Number of its detections.
        count: usize,
    },
    /// A detection without a box, an ellipse, an outline or an oriented box.
    #[error("detection {detection} of frame {id:?} has neither a box nor an ellipse nor an outline")]
    NoBox {
        /// Id of the frame.
        id: String,
        /// Index of the detection.
        detection: usize,
    },
    /// Too many categories.
    #[error("frame {id:?} brings the map to {count} categories; expected {} at most", super::MAX_CATEGORIES)]
    TooManyCategories {
        /// Id of the frame.
        id: String,
        /// Number of categories including those of this frame.
        count: usize,
    },
    /// A depth or a 3D box is out of range.
    #[error("detection {detection} of frame {id:?}: {error}")]
    Cue {
        /// Id of the frame.
        id: String,
        /// Index of the detection.
        detection: usize,
        /// What is wrong.
        error: CueError,
    },
    /// Points are no outline.
    #[error("detection {detection} of frame {id:?}: {error}")]
    Outline {
        /// Id of the frame.
        id: String,
        /// Index of the detection.
        detection: usize,
        /// What is wrong.
        error: OutlineError,
    },
    /// A depth or a 3D box has a source without a name.
    #[error("detection {detection} of frame {id:?} has the cue source {source_index}, of {count}")]
    CueSource {
        /// Id of the frame.
        id: String,
        /// Index of the detection.
        detection: usize,
        /// Index of the source.
        source_index: u32,
        /// Number of names.
        count: usize,
    },
    /// Too many sources of depths and 3D boxes.
    #[error(
        "frame {id:?} brings the map to {count} sources of depths and 3D boxes; expected {} at most",
        super::MAX_CUE_SOURCES
    )]
    TooManyCueSources {
        /// Id of the frame.
        id: String,
        /// Number of sources including those of this frame.
        count: usize,
    },
    /// The score of a detection is not a number.
    #[error("the score of detection {detection} of frame {id:?} is not a finite number")]
    Score {
        /// Id of the frame.
        id: String,
        /// Index of the detection.
        detection: usize,
    },
}
