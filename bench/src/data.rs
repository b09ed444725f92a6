//! The real data: where it is, and its scenes. It cannot be part of the project (its licenses do not allow it).

use std::path::{Path, PathBuf};

use quadlift::metrics::{EstimatedObject, ObjectScore, PairedBy, TruthObject, evaluate};
use quadlift::scene::Scene;
use quadlift::{Localization, LocalizeOptions, localize};
use quadlift_io::{SceneFile, read_scene_file};

use crate::error::Error;

/// Default folder of the data.
pub const DEFAULT_FOLDER: &str = "../shared/data";

/// An object counts when it is detected in so many views that the protocol keeps.
pub(crate) const MIN_VIEWS: usize = 2;

/// The folder of the data: the given one, that of the environment variable QUADLIFT_DATA, or `../shared/data`.
///
/// # Errors
/// [`Error::NoData`] if it has no folder `scenes`.
pub fn data_folder(chosen: Option<&Path>) -> Result<PathBuf, Error> {
    let from_environment = || std::env::var_os("QUADLIFT_DATA").map(PathBuf::from);
    let folder = chosen.map(Path::to_owned).or_else(from_environment).unwrap_or_else(|| DEFAULT_FOLDER.into());
    if folder.join("scenes").is_dir() { Ok(folder) } else { Err(Error::NoData(folder)) }
}

/// A scene and its ground truth.
#[derive(Debug, Clone)]
pub struct TrueScene {
    /// Name of the sequence in the tables.
    pub sequence: String,
    /// The scene as an estimator gets it.
    pub scene: Scene,
    /// The true objects.
    pub truth: Vec<TruthObject>,
}

impl TrueScene {
    /// Reads `scenes/FILE.json`.
    ///
    /// # Errors
    /// [`Error::Read`] if the file cannot be read or is invalid.
    pub fn read(data: &Path, file: &str, sequence: &str) -> Result<Self, Error> {
        let path = data.join("scenes").join(format!("{file}.json"));
        Self::of_file(&read_scene_file(&path)?, &path, sequence)
    }

    /// The scene and the objects of a scene file; `path` is for messages.
    ///
    /// # Errors
    /// [`Error::Read`] if the content is invalid.
    pub fn of_file(content: &SceneFile, path: &Path, sequence: &str) -> Result<Self, Error> {
        let scene = content.to_scene().map_err(|error| error.in_file(path))?;
        let objects = content.to_objects().map_err(|error| error.in_file(path))?;
        let truth = objects
            .into_iter()
            .map(|object| TruthObject { ellipsoid: object.ellipsoid(), cuboid: object.cuboid(), id: object.id })
            .collect();
        Ok(Self { sequence: sequence.to_owned(), scene, truth })
    }

    /// Localizes the objects and scores them. Objects that are detected in fewer than two of the views that the
    /// options keep do not count; all others do, with 0 where a method fails or needs more views.
    ///
    /// # Errors
    /// [`Error::Localize`] if the options do not fit the scene.
    pub fn scores(&self, options: &LocalizeOptions) -> Result<Vec<ObjectScore>, Error> {
        let options = LocalizeOptions { enclosing: true, ..options.clone() };
        Ok(self.scores_of(&localize(&self.scene, &options)?))
    }

    /// The scores of a localization of the scene, of the objects that [`Self::scores`] counts.
    pub(crate) fn scores_of(&self, localization: &Localization) -> Vec<ObjectScore> {
        let seen = |id: &str| {
            let estimate = localization.estimates.iter().find(|e| self.scene.object_ids[e.object_index] == id);
            estimate.is_some_and(|estimate| estimate.views.len() >= MIN_VIEWS)
        };
        let truth: Vec<TruthObject> = self.truth.iter().filter(|object| seen(&object.id)).cloned().collect();
        evaluate(&estimated_objects(&self.scene, localization), &truth, &[], PairedBy::Ids).objects
    }
}

/// The estimates in the form that the metrics take.
pub fn estimated_objects(scene: &Scene, localization: &Localization) -> Vec<EstimatedObject> {
    let object = |estimate: &quadlift::solve::Estimate| EstimatedObject {
        id: scene.object_ids[estimate.object_index].clone(),
        status: estimate.status.name().to_owned(),
        center: estimate.center,
        body: estimate.body,
        enclosing: estimate.enclosing,
    };
    localization.estimates.iter().map(object).collect()
}
