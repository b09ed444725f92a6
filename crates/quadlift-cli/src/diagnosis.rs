//! The self-check of a scene in the program: it is told, mended where that is asked for, and decides the exit code.

use std::path::Path;

use quadlift::associate::Outcome as AssociationOutcome;
use quadlift::diagnose::{Diagnosis, diagnose};
use quadlift::scene::Scene;
use quadlift_io::correct::correct;
use quadlift_io::diagnosis::{Context, diagnosis_in_words, diagnosis_record};
use serde_json::Value;

use crate::corrections::{CheckArgs, CorrectedScene};
use crate::error::{InconsistentError, Outcome};
use crate::output::Output;

/// What the self-check found, and what it was told to do about it.
#[derive(Debug, Clone, Default)]
pub struct Check {
    /// What it found, once what was asked for has been mended.
    pub diagnosis: Diagnosis,
    /// What is known of the scene.
    context: Context,
    /// Whether the user wants to go on with a scene that does not agree with itself.
    accepted: bool,
}

impl Check {
    /// Checks a scene, and mends it where `--fix` asks for that: what was done is added to its notes.
    pub fn new(
        scene: &mut CorrectedScene,
        args: &CheckArgs,
        source: Option<&str>,
        path: &Path,
    ) -> anyhow::Result<Self> {
        let context = Context::of(&scene.file, scene.frame_offset);
        let mut check =
            Self { diagnosis: of_source(&scene.scene, source), context, accepted: args.accept_inconsistent };
        let fix = check.diagnosis.causes.first().filter(|_| args.fix && !check.diagnosis.consistent);
        let Some((cause, correction)) = fix.and_then(|cause| Some((cause, context.correction(cause)?))) else {
            return Ok(check);
        };
        let notes = correct(&mut scene.file, &[correction]).map_err(|error| error.in_file(path))?;
        scene.scene = scene.file.to_scene().map_err(|error| error.in_file(path))?;
        let option = context.option(cause).unwrap_or_default();
        scene.notes.extend(notes.into_iter().map(|note| format!("{note} ({option}, by --fix)")));
        check.diagnosis = of_source(&scene.scene, source);
        Ok(check)
    }

    /// Takes what was found later, with more knowledge of the scene, unless it had disagreed with itself before.
    pub fn update(&mut self, diagnosis: &Diagnosis) {
        if self.diagnosis.consistent {
            self.diagnosis = diagnosis.clone();
        }
    }

    /// Whether the scene does not agree with itself and the user has not accepted that.
    pub fn refuses(&self) -> bool {
        !self.diagnosis.consistent && !self.accepted
    }

    /// For results and `--json`.
    pub fn record(&self) -> Value {
        diagnosis_record(&self.diagnosis, &self.context)
    }

    /// What is wrong and what mends it, in words.
    pub fn in_words(&self) -> Option<String> {
        diagnosis_in_words(&self.diagnosis, &self.context)
    }

    /// The error of a scene in which association finds nothing; `left_out` says which detections took no part.
    pub fn nothing_agrees(&self, left_out: &str) -> InconsistentError {
        let why = self.in_words().unwrap_or_else(|| {
            "the self-check finds no usual mistake that explains it; see \"When it does not work\" in the manual"
                .to_owned()
        });
        let found = AssociationOutcome::NothingAgrees.text();
        let mut diagnosis = self.record();
        diagnosis["consistent"] = false.into();
        InconsistentError { text: format!("no object was found: {found}{left_out}: {why}"), diagnosis }
    }

    /// Tells what is wrong with a scene; the outcome of a command that has done its work.
    pub fn tell(&self, title: &str, out: &Output) -> Outcome {
        match self.in_words() {
            Some(words) if self.refuses() => {
                out.error(&format!("{title}: the scene does not agree with itself: {words}"));
                Outcome::Inconsistent
            }
            Some(words) => {
                out.warning(&format!("{title}: {words}"));
                Outcome::Fine
            }
            None => Outcome::Fine,
        }
    }
}

/// The diagnosis of the detections of a source; an unclear source is for what comes next to tell.
pub fn of_source(scene: &Scene, source: Option<&str>) -> Diagnosis {
    let source = scene.source_index(source).unwrap_or_default();
    diagnose(scene, |detection| source.is_none() || detection.source_index == source)
}
