//! The input: posed frames with detections, validated and indexed.
//!
//! A [`Scene`] is built with [`SceneBuilder`]; solvers therefore never see an unknown id, an empty box or a NaN.

mod cues;
mod error;
pub(crate) mod frame_names;
mod points;
mod parts;
mod occluded;
mod skipped;
mod sources;
mod views;
mod outlines;
mod builder;
pub(crate) mod places;

pub use builder::{NewDetection, SceneBuilder};
pub use cues::{Box3dCue, Box3dSd, CueError, Cues, DepthCue};
pub use error::{OutlineError, SceneError};
pub use occluded::occluded_edges;
pub(crate) use outlines::extreme_corners;
pub use outlines::{Outlines, Shape, check_outline, occluded_lines};
pub use parts::{Detection, Frame, RigCamera, SceneParts, Undistorted};
pub use points::{PointObservation, TrackedPoint};
pub use skipped::SkippedDetections;
pub use sources::SourceError;
pub(crate) use views::ObjectViews;
pub(crate) use views::{BORDER_TOLERANCE_PX, edges_at_border};
pub use views::{DepthScale, View};

use std::ops::Deref;

use parts::check_parts;

use crate::geometry::TangentLines;

/// Posed frames and detections, checked, with every reference resolved to an index.
///
/// It reads like its [`SceneParts`]; [`Scene::edit`] changes it.
#[derive(Debug, Clone, Default)]
pub struct Scene(pub(crate) SceneParts);

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
    /// two detections of one object in one frame, or a tracked point is wrong.
    pub fn from_parts(parts: SceneParts) -> Result<Self, SceneError> {
        check_parts(&parts)?;
        Ok(Self(parts))
    }

    /// Changes the scene and validates it again. A copy is changed, because a rejected change cannot be undone;
    /// [`Scene::into_parts`] and [`Scene::from_parts`] change a scene without a copy.
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

    /// Sets the tangent lines of the mask of the detection with this index. Does nothing if there is no such
    /// detection.
    pub fn set_support_lines(&mut self, detection: usize, lines: Option<TangentLines>) {
        if let Some(detection) = self.0.detections.get_mut(detection) {
            detection.tangent_lines = lines.map(Box::new);
        }
    }

    /// The parts of the scene.
    pub fn into_parts(self) -> SceneParts {
        self.0
    }
}
