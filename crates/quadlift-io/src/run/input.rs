//! A scene file as the input of a run: read, corrected, and measured.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use quadlift::diagnosis::{Cause, Correction, Diagnosis};
use quadlift::online::ObjectMap;
use quadlift::run::Input;
use quadlift::scene::Scene;
use quadlift::{LocalizeOptions, MeasurementKind, Observer, Phase};

use crate::correct::{RecordCorrection, correct};
use crate::diagnosis::Context;
use crate::error::{EntryError, ReadError};
use crate::problems::Problems;
use crate::scene_file::{DepthsFound, DetectionRecord, SceneFile, read_scene_file};
use crate::stream::{MapMemory, StreamedScene};
use crate::wording::count;

/// A scene file, its scene, and what was done to it.
#[derive(Debug, Clone)]
pub struct FileInput {
    /// The path to which those in the file are relative; messages name it.
    pub path: PathBuf,
    /// The corrected records.
    pub file: Arc<SceneFile>,
    /// Descriptions of the corrections, and of what was left out.
    pub notes: Vec<String>,
    /// What is known of the file when mistakes are reported.
    pub context: Context,
    /// Masks, depth images and points that could not be read, and the detections that they affect.
    pub problems: Vec<String>,
    /// What was left out because it contradicts the boxes.
    pub warnings: Vec<String>,
    /// What depth images gave, if the scene has any.
    pub depth_images: Option<DepthsFound>,
    /// What points gave, if the scene has any.
    pub points: Option<DepthsFound>,
    /// What an object map knows of its objects, if the scene is one of a map.
    pub memory: Option<MapMemory>,
    scene: Arc<Scene>,
}

/// Why a [`FileInput`] cannot be measured.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum InputError {
    /// A file is not as expected.
    #[error(transparent)]
    Read(#[from] ReadError),
    /// Masks are to be measured, and there are none.
    #[error("no detection has a \"mask\" or an \"outline\"; `quadlift segment` finds masks in the images")]
    NoMasks,
}

impl FileInput {
    /// Reads a scene file, corrects and checks it.
    ///
    /// # Errors
    /// [`ReadError`] names the place of what is wrong.
    pub fn read(path: &Path, corrections: &[RecordCorrection]) -> Result<Self, ReadError> {
        Self::from_file(read_scene_file(path)?, path, corrections)
    }

    /// Corrects and checks what was read from a path.
    ///
    /// # Errors
    /// As [`Self::read`].
    pub fn from_file(mut file: SceneFile, path: &Path, corrections: &[RecordCorrection]) -> Result<Self, ReadError> {
        let notes = correct(&mut file, corrections).map_err(|error| error.in_file(path))?;
        let scene = file.to_scene().map_err(|error| error.in_file(path))?;
        let context = Context::of(&file, 0).after(corrections);
        Ok(Self { notes, context, ..Self::of(Arc::new(file), Arc::new(scene), path) })
    }

    /// A file and its scene ([`SceneFile::to_scene`]).
    pub fn of(file: Arc<SceneFile>, scene: Arc<Scene>, path: &Path) -> Self {
        Self {
            path: path.to_owned(),
            context: Context::of(&file, 0),
            file,
            notes: Vec::new(),
            problems: Vec::new(),
            warnings: Vec::new(),
            depth_images: None,
            points: None,
            memory: None,
            scene,
        }
    }

    /// The kept views of an object map. Objects are estimated from the means of views that were forgotten
    /// (`StreamedScene::to_averaged_file`); the file shows the boxes themselves.
    ///
    /// # Errors
    /// [`ReadError`] with `path` if the scene of the map is not valid.
    pub fn of_map(streamed: &StreamedScene, map: &ObjectMap, path: &Path) -> Result<Self, ReadError> {
        let scene = streamed.to_averaged_file(map).to_scene().map_err(|error| error.in_file(path))?;
        let file = streamed.to_file(map);
        Ok(Self { memory: Some(MapMemory::of(map)), ..Self::of(Arc::new(file), Arc::new(scene), path) })
    }

    /// The scene as it is now: after a run with the objects that association found.
    pub fn scene(&self) -> &Scene {
        &self.scene
    }

    /// Drops detections with a lower score; those without a score are kept.
    ///
    /// # Errors
    /// [`ReadError`] if the scene without them is not valid.
    pub fn drop_below_score(&mut self, min_score: f64) -> Result<(), ReadError> {
        let file = Arc::make_mut(&mut self.file);
        let before = file.detections.len();
        file.detections.retain(|detection| detection.score.is_none_or(|score| score >= min_score));
        let dropped = before - file.detections.len();
        if dropped > 0 {
            self.rebuild()?;
            self.notes.push(format!("skipped {} with a score below {min_score}", count(dropped, "detection")));
        }
        Ok(())
    }

    /// Makes the scene of the file anew.
    fn rebuild(&mut self) -> Result<(), ReadError> {
        self.scene = Arc::new(self.file.to_scene().map_err(|error| error.in_file(&self.path))?);
        Ok(())
    }

    /// Adds problems, each once.
    fn failed(&mut self, problems: impl IntoIterator<Item = String>) {
        for problem in problems {
            if !self.problems.contains(&problem) {
                self.problems.push(problem);
            }
        }
    }

    /// Gives detections the tangent lines of their masks; whether these are used.
    fn measure_masks(&mut self, source: Option<u32>, observer: &dyn Observer) -> Result<bool, InputError> {
        let has_lines = |d: &DetectionRecord| d.mask.is_some() || d.outline.is_some() || d.oriented_box.is_some();
        if !self.file.detections.iter().any(has_lines) {
            return Err(InputError::NoMasks);
        }
        observer.begins(Phase::Masks);
        let scene = Arc::make_mut(&mut self.scene);
        let found = self.file.add_support_lines(&self.path, scene, source, observer);
        // Detections of one label image share its problem.
        let mut problems = Problems::default();
        let found = found.map_err(|error| error.in_file(&self.path))?;
        let are_used = found.are_used;
        self.warnings.extend(found.left_out);
        for (index, error) in found.unread {
            problems.add(error.to_string(), &[index]);
        }
        let problems = problems.in_words(&self.scene);
        self.failed(problems);
        Ok(are_used)
    }

    /// Adds depths of detections by one of the functions of [`SceneFile`].
    fn measure_depths(
        &mut self,
        add: impl FnOnce(&SceneFile, &Path, &mut Scene) -> Result<DepthsFound, EntryError>,
    ) -> Result<DepthsFound, InputError> {
        let found = add(&self.file, &self.path, Arc::make_mut(&mut self.scene));
        let found = found.map_err(|error| error.in_file(&self.path))?;
        self.failed(found.problems.iter().map(ToString::to_string));
        Ok(found)
    }
}

impl Input for FileInput {
    type Error = InputError;

    fn scene(&self) -> &Scene {
        &self.scene
    }

    fn scene_mut(&mut self) -> &mut Scene {
        Arc::make_mut(&mut self.scene)
    }

    fn known(&self) -> Diagnosis {
        self.memory.as_ref().map_or_else(Diagnosis::default, |memory| memory.diagnosis.clone())
    }

    fn corrected(&self, corrections: &[Correction]) -> Option<Scene> {
        let mut file = (*self.file).clone();
        for correction in corrections {
            correct(&mut file, &[RecordCorrection::of(correction, self.context.image_size)]).ok()?;
        }
        file.to_scene().ok()
    }

    fn correct(&mut self, cause: &Cause) -> Result<bool, InputError> {
        let Some(correction) = self.context.correction(cause) else { return Ok(false) };
        let by_fix = format!("({}, by --fix)", self.context.option(cause).unwrap_or_default());
        let notes = correct(Arc::make_mut(&mut self.file), &[correction]).map_err(|error| error.in_file(&self.path))?;
        self.notes.extend(notes.into_iter().map(|note| format!("{note} {by_fix}")));
        self.rebuild()?;
        Ok(true)
    }

    fn measure(&mut self, options: &LocalizeOptions, observer: &dyn Observer) -> Result<MeasurementKind, InputError> {
        let mut kind = options.measurements;
        // The views of a map carry what was measured in them.
        if self.memory.is_some() {
            return Ok(kind);
        }
        // An ambiguous source is reported by the localization.
        let source = self.scene.source_index(options.source.as_deref()).unwrap_or_default();
        if kind == MeasurementKind::Mask && !self.measure_masks(source, observer)? {
            kind = MeasurementKind::Auto;
        }
        if options.method.posterior_options().is_none() {
            return Ok(kind);
        }
        if self.file.has_depth_images() {
            observer.begins(Phase::DepthImages);
            let found = self.measure_depths(|file, path, scene| file.add_depths(path, scene, source, observer))?;
            self.depth_images = Some(found);
        }
        if self.file.has_points_of_frames() {
            observer.begins(Phase::Points);
            let found =
                self.measure_depths(|file, path, scene| file.add_depths_of_points(path, scene, source, observer))?;
            self.points = Some(found);
        }
        Ok(kind)
    }
}
