//! A scene with its file, which is made when it is asked for.

use std::path::PathBuf;
use std::sync::{Arc, OnceLock};

use pyo3::PyResult;
use quadlift::scene::Scene;
use quadlift_io::SceneFile;

use crate::detections::{DetectionArrays, Originals};
use crate::error::refuse;

/// A checked scene and the scene file that it stands for.
pub struct Loaded {
    /// Frames and detections.
    pub scene: Scene,
    /// The path to which those in the file are relative, as that of the file is.
    pub path: PathBuf,
    file: OnceLock<SceneFile>,
    /// Where the file is made only when it is asked for: arrays become estimates without it.
    added: Option<Added>,
}

/// Detections that are not in a file yet.
struct Added {
    base: Arc<Loaded>,
    originals: Originals,
}

impl Loaded {
    /// A file, checked.
    pub fn new(file: SceneFile, path: PathBuf) -> PyResult<Self> {
        let scene = file.to_scene().map_err(|error| match path.as_os_str().is_empty() {
            true => refuse(format!("{}: {}", error.entry, error.problem)),
            false => refuse(error.in_file(&path)),
        })?;
        Ok(Self { scene, path, file: file.into(), added: None })
    }

    /// A scene with more detections.
    pub fn with_detections(base: &Arc<Self>, detections: DetectionArrays) -> PyResult<Self> {
        let mut scene = base.scene.clone();
        let originals = detections.add_to(&mut scene)?;
        let added = Some(Added { base: Arc::clone(base), originals });
        Ok(Self { scene, path: base.path.clone(), file: OnceLock::new(), added })
    }

    /// The scene file.
    pub fn file(&self) -> &SceneFile {
        self.file.get_or_init(|| {
            let Some(Added { base, originals }) = &self.added else { return SceneFile::default() };
            let mut file = base.file().clone();
            originals.add_records(&mut file, &self.scene, base.scene.detections.len());
            file
        })
    }
}
