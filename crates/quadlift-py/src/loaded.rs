//! A scene with its file, which is created on demand.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::{Arc, OnceLock};

use pyo3::PyResult;
use quadlift::scene::Scene;
use quadlift_io::SceneFile;
use quadlift_io::guard::is_same_file;
use quadlift_io::run::FileInput;
use quadlift_io::video::VideoFrames;

use crate::detections::{DetectionArrays, Originals, refused};
use crate::error::{refuse, refuse_to_read};

/// A validated scene and its scene file.
pub struct Loaded {
    /// Frames and detections.
    pub scene: Arc<Scene>,
    /// The path to which those in the file are relative, as that of the file is.
    pub path: PathBuf,
    /// The scene was computed from that of the path and lacks parts of it, such as detections.
    is_result: bool,
    source: Source,
    /// Images that are frames of videos, which are decoded once.
    pub videos: VideoFrames,
}

/// Where the scene file comes from.
enum Source {
    File(Arc<SceneFile>),
    /// Another scene with more detections. The file is created on demand: localizing arrays does not need it.
    Added {
        base: Arc<Loaded>,
        originals: Originals,
        file: OnceLock<Arc<SceneFile>>,
    },
}

impl Loaded {
    /// A file, checked.
    pub fn new(file: SceneFile, path: PathBuf) -> PyResult<Self> {
        let scene = file.to_scene().map_err(|error| match path.as_os_str().is_empty() {
            true => refuse_to_read(error),
            false => refuse_to_read(error.in_file(&path)),
        })?;
        let (scene, source) = (Arc::new(scene), Source::File(Arc::new(file)));
        Ok(Self { scene, path, is_result: false, source, videos: VideoFrames::default() })
    }

    /// The result of a localization of the scene of a path.
    pub fn of_result(file: SceneFile, path: PathBuf) -> PyResult<Self> {
        Ok(Self { is_result: true, ..Self::new(file, path)? })
    }

    /// Refuses to write a page or a recording over the scene's file, or over an image or mask that it refers to.
    pub fn check_output(&self, output: &Path) -> PyResult<()> {
        self.check(output, true)
    }

    /// Rejects an output that is an image or mask of the scene; and, for results, the scene file. A scene may be
    /// written to the file from which it was read.
    pub fn check_scene_output(&self, output: &Path) -> PyResult<()> {
        self.check(output, self.is_result)
    }

    fn check(&self, output: &Path, keeps_scene: bool) -> PyResult<()> {
        if !output.exists() {
            return Ok(());
        }
        let refuse = |what: &str| {
            let output = output.display();
            Err(refuse(format!("{output}: {what} and would be overwritten; choose another output")))
        };
        if keeps_scene && is_same_file(&self.path, output) {
            return refuse("the scene was read from this file");
        }
        // Many detections may share a mask.
        let named: BTreeSet<PathBuf> = self.file().named_files(&self.path).collect();
        if named.iter().any(|path| is_same_file(path, output)) {
            return refuse("the file is an image or mask of the scene");
        }
        Ok(())
    }

    /// The input of a run.
    pub fn input(&self) -> FileInput {
        FileInput::of(Arc::clone(self.file()), Arc::clone(&self.scene), &self.path)
    }

    /// A scene with more detections.
    pub fn with_detections(base: &Arc<Self>, detections: DetectionArrays) -> PyResult<Self> {
        let mut parts = (*base.scene).clone().into_parts();
        let originals = detections.add_to(&mut parts)?;
        let scene = Scene::from_parts(parts).map_err(|error| refused(error, base.scene.detections.len()))?;
        let scene = Arc::new(scene);
        let source = Source::Added { base: Arc::clone(base), originals, file: OnceLock::new() };
        Ok(Self { scene, path: base.path.clone(), is_result: base.is_result, source, videos: base.videos.clone() })
    }

    /// The scene file.
    pub fn file(&self) -> &Arc<SceneFile> {
        match &self.source {
            Source::File(file) => file,
            Source::Added { base, originals, file } => file.get_or_init(|| {
                let mut file = SceneFile::clone(base.file());
                originals.add_records(&mut file, &self.scene, base.scene.detections.len());
                Arc::new(file)
            }),
        }
    }
}
