//! The self-check in the program: it is reported, corrected with `--fix`, and determines the exit code.

use std::path::Path;

use quadlift::Localization;
use quadlift::association::{AssociateOptions, IdUse, Outcome as AssociationOutcome, associate};
use quadlift::diagnosis::{Agreement, Cause, Diagnosis, diagnose, diagnose_association};
use quadlift::scene::Scene;
use quadlift_io::SceneFile;
use quadlift_io::correct::correct;
use quadlift_io::diagnosis::{Context, cause_record, diagnosis_in_words, diagnosis_record, together_in_words};
use serde_json::Value;

use crate::corrections::{CheckArgs, CorrectedScene};
use crate::error::{InconsistentError, Outcome};
use crate::output::Output;
use crate::two_mistakes::two_mistakes;

/// The result of the self-check, and the options for handling it.
#[derive(Debug, Clone, Default)]
pub struct Check {
    /// The result after the requested corrections.
    pub diagnosis: Diagnosis,
    /// Two mistakes that together explain what none explains alone.
    together: Option<[Cause; 2]>,
    /// How poses as given agree with the boxes, where only refined ones do.
    before_refinement: Option<Agreement>,
    /// Context of the scene.
    context: Context,
    /// Number of remaining corrections.
    fixes: usize,
    /// Whether the user accepts an inconsistent scene.
    accepted: bool,
}

impl Check {
    /// Checks a scene, and corrects it with `--fix`; corrections are added to its notes. If the detections are to be
    /// associated, `ids` is the use of their ids: uncertain ids are ignored here.
    pub fn new(
        scene: &mut CorrectedScene,
        args: &CheckArgs,
        source: Option<&str>,
        ids: Option<IdUse>,
        path: &Path,
    ) -> anyhow::Result<Self> {
        let context = Context::of(&scene.file, scene.frame_offset).after(&scene.corrections);
        let are_trusted = ids.is_none_or(|ids| ids == IdUse::Trust);
        let diagnosis = if are_trusted { of_source(&scene.scene, source) } else { Diagnosis::default() };
        let fixes = if args.fix { MOST_FIXES } else { 0 };
        let accepted = args.accept_inconsistent;
        let mut check = Self { diagnosis, context, fixes, accepted, ..Self::default() };
        check.seek_two(&scene.file, |scene| of_source(scene, source));
        while check.fix(scene, path)? {
            check.diagnosis = of_source(&scene.scene, source);
        }
        Ok(check)
    }

    /// The result for the detections of a source, without corrections.
    pub fn of(diagnosis: Diagnosis, context: Context, file: &SceneFile, source: Option<&str>) -> Self {
        let mut check = Self { diagnosis, context, ..Self::default() };
        check.seek_two(file, |scene| of_source(scene, source));
        check
    }

    /// The same, where detections that name no object are associated for it.
    pub fn with_identities(
        scene: &mut CorrectedScene,
        args: &CheckArgs,
        source: Option<&str>,
        path: &Path,
    ) -> anyhow::Result<Self> {
        let mut check = Self::new(scene, args, source, None, path)?;
        check.update(&without_ids(&scene.scene, source));
        while check.fix(scene, path)? {
            check.diagnosis = of_source(&scene.scene, source);
            check.update(&without_ids(&scene.scene, source));
        }
        Ok(check)
    }

    /// Searches for two mistakes if the scene is inconsistent and no cause is known.
    fn seek_two(&mut self, file: &SceneFile, check: impl Fn(&Scene) -> Diagnosis) {
        if !self.diagnosis.consistent && self.diagnosis.causes.is_empty() && self.together.is_none() {
            self.together = two_mistakes(file, &self.diagnosis, &self.context, check);
        }
    }

    /// Applies the best correction with `--fix`; returns whether anything was changed. A mistake is not corrected
    /// twice, unless it has a parameter, which may need refinement.
    pub fn fix(&mut self, scene: &mut CorrectedScene, path: &Path) -> anyhow::Result<bool> {
        if self.fixes == 0 || self.diagnosis.consistent {
            return Ok(false);
        }
        let causes: Vec<Cause> = match self.together.take() {
            Some(two) => two.into(),
            None => self.diagnosis.causes.first().copied().into_iter().collect(),
        };
        let mut mended = false;
        for cause in causes {
            let Some(correction) = self.context.correction(&cause) else { continue };
            let option = self.context.option(&cause).unwrap_or_default();
            let by_fix = format!("({option}, by --fix)");
            if cause.value.is_none() && scene.notes.iter().any(|note| note.ends_with(&by_fix)) {
                continue;
            }
            let notes = correct(&mut scene.file, &[correction]).map_err(|error| error.in_file(path))?;
            scene.notes.extend(notes.into_iter().map(|note| format!("{note} {by_fix}")));
            self.fixes = self.fixes.saturating_sub(1);
            mended = true;
        }
        scene.scene = scene.file.to_scene().map_err(|error| error.in_file(path))?;
        Ok(mended)
    }

    /// Replaces the result by a later one with more information, unless the scene was inconsistent before.
    pub fn update(&mut self, diagnosis: &Diagnosis) {
        if self.diagnosis.consistent {
            self.diagnosis = diagnosis.clone();
        }
    }

    /// The same with the result of a localisation. If detections name their objects, and refined poses agree with the boxes, the result is
    /// that of the refined poses.
    pub fn update_localized(&mut self, localization: &Localization, are_named: bool) {
        let refined = are_named && !localization.refined_poses.is_empty() && localization.diagnosis.consistent;
        if refined && !self.diagnosis.consistent {
            self.before_refinement = self.diagnosis.agreement;
            (self.diagnosis, self.together) = (localization.diagnosis.clone(), None);
        }
        self.update(&localization.diagnosis);
    }

    /// Whether the scene is inconsistent and not accepted by the user.
    pub fn refuses(&self) -> bool {
        !self.diagnosis.consistent && !self.accepted
    }

    /// Whether the cause of the problem is known.
    pub fn is_explained(&self) -> bool {
        self.together.is_some() || !self.diagnosis.causes.is_empty()
    }

    /// For results and `--json`.
    pub fn record(&self) -> Value {
        let mut record = diagnosis_record(&self.diagnosis, &self.context);
        if let Some(two) = &self.together {
            record["together"] = two.iter().map(|cause| cause_record(cause, &self.context)).collect();
        }
        record
    }

    /// The problem and its correction, as text.
    pub fn in_words(&self) -> Option<String> {
        match &self.together {
            Some(two) => Some(together_in_words(two, &self.context)),
            None => diagnosis_in_words(&self.diagnosis, &self.context),
        }
    }

    /// The error of a scene in which association finds nothing; `left_out` describes skipped detections.
    pub fn nothing_agrees(&self, left_out: &str) -> InconsistentError {
        let why = self
            .in_words()
            .unwrap_or_else(|| "no common mistake explains it; see \"When it does not work\" in the manual".to_owned());
        let found = AssociationOutcome::NothingAgrees.text();
        let mut diagnosis = self.record();
        diagnosis["consistent"] = false.into();
        InconsistentError { text: format!("no object was found: {found}{left_out}: {why}"), diagnosis }
    }

    /// Reports the problem of a scene and returns the outcome of the finished command.
    pub fn tell(&self, title: &str, out: &Output) -> Outcome {
        if let (Some(given), Some(refined)) = (self.before_refinement, self.diagnosis.agreement) {
            out.warning(&format!(
                "{title}: the poses as given contradict the boxes, which miss their object by {:.0} % of their half size; refined poses: {:.0} %",
                100.0 * given.miss,
                100.0 * refined.miss
            ));
        }
        match self.in_words() {
            Some(words) if self.refuses() => {
                out.error(&format!("{title}: the scene is inconsistent: {words}"));
                Outcome::Inconsistent
            }
            Some(words) if !self.diagnosis.consistent => {
                out.warning(&format!("{title}: the scene is inconsistent: {words}"));
                Outcome::Fine
            }
            Some(words) => {
                out.warning(&format!("{title}: possible mistake: {words}"));
                Outcome::Fine
            }
            None => Outcome::Fine,
        }
    }
}

/// Corrections that `--fix` makes one after another: numbers that are found without ids are rough at first.
const MOST_FIXES: usize = 3;

/// More detections than this are not associated for the self-check alone, which would take too long.
const MOST_ASSOCIATED: usize = 5000;

/// The diagnosis of a scene in which most detections name no object: they are associated for it.
pub fn without_ids(scene: &Scene, source: Option<&str>) -> Diagnosis {
    let index = scene.source_index(source).unwrap_or_default();
    let used = || scene.detections.iter().filter(|d| index.is_none() || d.source_index == index);
    let unnamed = used().filter(|d| d.object_index.is_none()).count();
    if 2 * unnamed <= used().count() || used().count() > MOST_ASSOCIATED {
        return Diagnosis::default();
    }
    let options = AssociateOptions { source: source.map(str::to_owned), ids: IdUse::Trust, ..Default::default() };
    let diagnosis =
        associate(scene, &options).and_then(|association| diagnose_association(scene, &association, &options));
    // An ambiguous source is reported later.
    diagnosis.unwrap_or_default()
}

/// The diagnosis of the detections of a source; an ambiguous source is reported later.
pub fn of_source(scene: &Scene, source: Option<&str>) -> Diagnosis {
    let source = scene.source_index(source).unwrap_or_default();
    diagnose(scene, |detection| source.is_none() || detection.source_index == source)
}
