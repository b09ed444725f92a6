//! What readers of cameras return, and what they share.

use std::path::{Path, PathBuf};

use crate::error::{EntryError, ReadError};
use crate::scene_file::{CameraRecord, SceneFile};

/// What a reader has found.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Import {
    /// Cameras, frames and whatever else the format holds. It is a valid scene.
    pub scene: SceneFile,
    /// The folder to which the images of the frames are relative, where it is known.
    pub image_folder: Option<PathBuf>,
    /// In words: what was converted, what was assumed, what was left out.
    pub notes: Vec<String>,
}

impl Import {
    /// The scene that was read from a file, once it is known to be valid: repeated ids, impossible cameras and poses are
    /// refused here, for all formats alike.
    pub(crate) fn checked(self, path: &Path) -> Result<Self, ReadError> {
        let in_file = |error: EntryError| {
            let problem = format!("the scene made of this file is not valid: {}: {}", error.entry, error.problem);
            ReadError::new(path, problem)
        };
        self.scene.to_scene().map_err(in_file)?;
        self.scene.to_objects().map_err(in_file)?;
        Ok(self)
    }
}

/// The id of a camera in a scene, to which it is added when it is new: ids are numbers from 0.
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

/// Where a format's pixel coordinates have their origin, where it does not say.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum PixelCenters {
    /// The centre of the first pixel is (0, 0), as in OpenCV: half a pixel is added to principal points.
    Integer,
    /// The centre of the first pixel is (0.5, 0.5), as in COLMAP and in scene files: nothing is added.
    #[default]
    Half,
}

impl PixelCenters {
    /// What to add to principal points.
    pub fn shift(self) -> f64 {
        match self {
            Self::Integer => 0.5,
            Self::Half => 0.0,
        }
    }

    /// What was assumed, in words.
    pub(super) fn note(self) -> String {
        match self {
            Self::Integer => "pixel centres at integers: 0.5 was added to the principal points".to_owned(),
            Self::Half => "pixel centres at halves: the principal points are as in the file".to_owned(),
        }
    }
}
