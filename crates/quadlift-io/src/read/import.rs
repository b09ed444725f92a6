//! Result and common code of readers of cameras.

use std::path::{Path, PathBuf};

use quadlift::diagnosis::corrected_up;

use crate::error::{EntryError, ReadError};
use crate::scene_file::{CameraRecord, SceneFile};

/// The result of a reader.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Import {
    /// Cameras, frames and other content of the format. It is a valid scene.
    pub scene: SceneFile,
    /// The folder to which the images of the frames are relative, if known.
    pub image_folder: Option<PathBuf>,
    /// Notes: conversions, assumptions and skipped parts.
    pub notes: Vec<String>,
    /// Whether the format is another form of the scene file: then nothing is added to the scene.
    pub is_scene: bool,
    /// What was left out because it cannot be used, at most a thousand.
    pub problems: Vec<String>,
    /// How often something was left out.
    pub problem_count: usize,
}

impl Import {
    /// The scene read from a file, after validation: duplicate ids and invalid cameras and poses are rejected here, for
    /// all formats.
    ///
    /// The direction `up` of a format that its cameras contradict is left out: nobody said that it is right.
    pub(crate) fn checked(mut self, path: &Path) -> Result<Self, ReadError> {
        let in_file = |error: EntryError| {
            let problem = format!("the scene made of this file is not valid: {}: {}", error.entry, error.problem);
            ReadError::new(path, problem)
        };
        let scene = self.scene.to_scene().map_err(in_file)?;
        if corrected_up(&scene).is_some() {
            self.scene.up = None;
            self.notes
                .push("the cameras are not upright in this world: its direction against gravity is unknown".to_owned());
        }
        self.scene.to_objects().map_err(in_file)?;
        Ok(self)
    }
}

/// The id of a camera in a scene, which is added if it is new: ids are numbers from 0.
pub(super) fn camera_id(scene: &mut SceneFile, camera: CameraRecord) -> String {
    let same = |known: &&CameraRecord| {
        known.params == camera.params
            && known.model == camera.model
            && (known.width, known.height) == (camera.width, camera.height)
    };
    if let Some(known) = scene.cameras.iter().find(same) {
        return known.id.clone();
    }
    let id = scene.cameras.len().to_string();
    scene.cameras.push(CameraRecord { id: id.clone(), ..camera });
    id
}

/// Origin of the pixel coordinates of a format that does not document it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum PixelCenters {
    /// The center of the first pixel is (0, 0), as in OpenCV: half a pixel is added to principal points.
    Integer,
    /// The center of the first pixel is (0.5, 0.5), as in COLMAP and in scene files: nothing is added.
    #[default]
    Half,
}

impl PixelCenters {
    /// What to add to principal points.
    pub(crate) fn shift(self) -> f64 {
        match self {
            Self::Integer => 0.5,
            Self::Half => 0.0,
        }
    }

    /// Assumptions, as text.
    pub(crate) fn note(self) -> String {
        match self {
            Self::Integer => "pixel centers at integers: 0.5 was added to the principal points".to_owned(),
            Self::Half => "pixel centers at halves: the principal points are as in the file".to_owned(),
        }
    }
}
