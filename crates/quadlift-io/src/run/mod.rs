//! One run on a file: [`quadlift::run()`], and its result as a file. The program, Python, the ROS 2 node and maps of streams
//! call [`run_file`].

mod input;
mod options;
mod record;

use std::borrow::Cow;
use std::path::Path;

use quadlift::Observer;
use quadlift::run::{Check, Input, Run, RunError};

pub use input::{FileInput, InputError};
pub use options::{FileOptions, PriorSource};
pub use record::{
    CueScaleRecord, LearnedSizeRecord, PosePointsRecord, Quantity, RunRecord, SceneCrossValidationRecord, SizeAxes,
    SkippedRecord,
};

use crate::association::{add_doubts, write_objects};
use crate::diagnosis::DiagnosisRecord;
use crate::error::WriteError;
use crate::scene_file::{
    Detail, DetectionRecord, SceneFile, estimates_to_objects, write_localized_file, write_scene_file,
};

/// A finished run: what was read, how, and what was found.
#[derive(Debug, Clone)]
pub struct FileRun {
    /// The scene, with the objects that association found.
    pub input: FileInput,
    /// The result.
    pub run: Run,
    /// How it was made.
    pub options: FileOptions,
}

/// Why a run on a file has no result.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum FileRunError {
    /// The built-in priors do not fit the unit of the scene.
    #[error("{0}")]
    Unit(String),
    /// The run failed.
    #[error(transparent)]
    Run(Box<RunError<InputError>>),
}

/// Runs the steps of [`quadlift::run()`] on a file. The map of a stream without detections has an empty result.
///
/// # Errors
/// [`FileRunError`] if there is no result, with the input as it is by then.
pub fn run_file(
    mut input: FileInput,
    options: &FileOptions,
    observer: &dyn Observer,
) -> Result<FileRun, Box<(FileInput, FileRunError)>> {
    let run = if input.memory.is_some() && input.scene().detections.is_empty() {
        Ok(Run { check: Check::default().with_known(input.known()), ..Run::default() })
    } else {
        match options.for_scene(input.scene()) {
            Err(problem) => Err(FileRunError::Unit(problem)),
            Ok(run_options) => {
                quadlift::run(&mut input, &run_options, observer).map_err(|error| FileRunError::Run(Box::new(error)))
            }
        }
    };
    match run {
        Ok(run) => Ok(FileRun { input, run, options: options.clone() }),
        Err(error) => Err(Box::new((input, error))),
    }
}

impl FileRun {
    /// The consistency check.
    pub fn diagnosis(&self) -> DiagnosisRecord {
        DiagnosisRecord::of(&self.run.check, &self.input.context)
    }

    /// What the result says about the run: `localization` of its file.
    pub fn record(&self) -> RunRecord {
        RunRecord::of(self)
    }

    /// The result as a file.
    pub fn result(&self) -> SceneFile {
        let mut result = self.without_objects();
        result.objects = estimates_to_objects(self.input.scene(), &self.run.localization).collect();
        result.detections = self.used_detections();
        if let Some(association) = &self.run.association {
            add_doubts(&mut result.objects, association);
        }
        if let Some(memory) = &self.input.memory {
            memory.add_to(&mut result, &self.input.file);
        }
        result
    }

    /// The detections of the source that was used, with the ids of their objects.
    fn used_detections(&self) -> Vec<DetectionRecord> {
        let mut detections = self.input.file.detections.clone();
        write_objects(&mut detections, self.input.scene());
        let source = self.options.run.localize.source.as_deref();
        detections.retain(|record| source.is_none() || record.source.as_deref() == source);
        for record in &mut detections {
            // Masks are the bulk of a segmented scene, and stay there.
            (record.mask, record.segmentation) = (None, None);
        }
        detections
    }

    /// Writes the result; `detail` says how much of each object, and whether detections are written whose ids were given. `made` is
    /// [`Self::result`], where it was made already.
    ///
    /// # Errors
    /// As [`write_scene_file`].
    pub fn write(&self, path: &Path, detail: Detail, made: Option<&SceneFile>) -> Result<(), WriteError> {
        let are_given = self.run.association.is_none() && self.input.memory.is_none();
        if made.is_none() && are_given {
            // Without records of all objects at once.
            let mut result = self.without_objects();
            if detail == Detail::Full {
                result.detections = self.used_detections();
            }
            return write_localized_file(path, &result, self.input.scene(), &self.run.localization, detail);
        }
        let mut result = made.map_or_else(|| Cow::Owned(self.result()), Cow::Borrowed);
        if detail != Detail::Full {
            let result = result.to_mut();
            result.objects.iter_mut().for_each(|object| detail.apply(object));
            result.detections.retain(|_| !are_given);
        }
        write_scene_file(path, &result)
    }

    /// The result without objects and detections.
    fn without_objects(&self) -> SceneFile {
        let about = serde_json::to_value(self.record()).unwrap_or_default();
        self.input.file.with_results(Vec::new(), about).with_refined_poses(&self.run.localization)
    }
}
