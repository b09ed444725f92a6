//! A scene as a Python object; its methods are in `scene_methods`, above everything that they call.

use std::path::PathBuf;
use std::sync::Arc;

use pyo3::prelude::*;
use quadlift_io::SceneFile;

use crate::loaded::Loaded;

/// A scene; it never changes.
#[pyclass(name = "Scene", module = "quadlift._core", frozen)]
pub struct PyScene {
    /// What it holds; shared with the results.
    pub loaded: Arc<Loaded>,
}

impl PyScene {
    /// A checked scene.
    pub fn new(file: SceneFile, path: PathBuf) -> PyResult<Self> {
        Ok(Self { loaded: Arc::new(Loaded::new(file, path)?) })
    }
}
