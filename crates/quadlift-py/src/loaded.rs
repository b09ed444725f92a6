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
    source: Source,
}

/// Where the scene file comes from.
enum Source {
    File(SceneFile),
    /// More detections than another one has. The file is made when it is asked for: arrays become estimates without it.
    Added {
        base: Arc<Loaded>,
        originals: Originals,
        file: OnceLock<SceneFile>,
    },
}

impl Loaded {
    /// A file, checked.
    pub fn new(file: SceneFile, path: PathBuf) -> PyResult<Self> {
        let scene = file.to_scene().map_err(|error| match path.as_os_str().is_empty() {
            true => refuse(format!("{}: {}", error.entry, error.problem)),
            false => refuse(error.in_file(&path)),
        })?;
        Ok(Self { scene, path, source: Source::File(file) })
    }

    /// A scene with more detections.
    pub fn with_detections(base: &Arc<Self>, detections: DetectionArrays) -> PyResult<Self> {
        let mut scene = base.scene.clone();
        let originals = detections.add_to(&mut scene)?;
        let source = Source::Added { base: Arc::clone(base), originals, file: OnceLock::new() };
        Ok(Self { scene, path: base.path.clone(), source })
    }

    /// The scene file.
    pub fn file(&self) -> &SceneFile {
        match &self.source {
            Source::File(file) => file,
            Source::Added { base, originals, file } => file.get_or_init(|| {
                let mut file = base.file().clone();
                originals.add_records(&mut file, &self.scene, base.scene.detections.len());
                file
            }),
        }
    }
}
