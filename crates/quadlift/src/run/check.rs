//! The consistency check of a run: before and after association, after refined poses, and with priors on lengths.

use super::input::Input;
use super::pairs::pair_of_causes;
use crate::association::{AssociateOptions, IdPolicy, associate};
use crate::diagnosis::{Agreement, Cause, Correction, Diagnosis, diagnose, diagnose_association};
use crate::localize::Localization;
use crate::scene::{Detection, Scene};
use crate::solve::Status;

/// Maximum number of corrections of one scene: numbers that are found without ids are rough at first.
const MAX_CORRECTIONS: usize = 3;

/// Maximum number of detections that are associated for the check alone, which would take too long.
const MAX_ASSOCIATED: usize = 5000;

/// Whether the scene of a run is consistent, and what explains it if not. It alone decides whether objects are
/// [`Status::Inconsistent`].
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Check {
    /// The result after the corrections.
    pub diagnosis: Diagnosis,
    /// Two causes that together explain what none explains alone.
    pub together: Option<[Cause; 2]>,
    /// Agreement of the poses as given, where only refined poses agree with the boxes.
    pub before_refinement: Option<Agreement>,
    /// The corrections that were made, in their order.
    pub corrected: Vec<Correction>,
}

impl Check {
    /// Checks the detections of a source that name an object. If `fix` is set, corrects the input up to three times
    /// while it is inconsistent.
    ///
    /// # Errors
    /// Those of [`Input::correct`].
    pub fn of<I: Input>(input: &mut I, source: Option<&str>, fix: bool) -> Result<Self, I::Error> {
        let mut check = Self::of_diagnosis(diagnose_source(input.scene(), source), input, source);
        while fix && check.fix(input)? {
            check.diagnosis = diagnose_source(input.scene(), source);
        }
        Ok(check)
    }

    /// The check with a diagnosis that was made before; searches for two causes if none explains it alone.
    pub fn of_diagnosis<I: Input>(diagnosis: Diagnosis, input: &I, source: Option<&str>) -> Self {
        let mut check = Self { diagnosis, ..Self::default() };
        if !check.diagnosis.consistent && check.diagnosis.causes.is_empty() {
            check.together = pair_of_causes(input, &check.diagnosis, |scene| diagnose_source(scene, source));
        }
        check
    }

    /// The same with what was found wrong before, unless something else is wrong ([`Input::known`]).
    pub fn with_known(mut self, known: Diagnosis) -> Self {
        if self.diagnosis.consistent && !known.consistent {
            self.diagnosis = known;
        }
        self
    }

    /// [`Self::of`], where detections that name no object are associated for the check alone.
    ///
    /// # Errors
    /// Those of [`Input::correct`].
    pub fn with_identities<I: Input>(input: &mut I, source: Option<&str>, fix: bool) -> Result<Self, I::Error> {
        let mut check = Self::of(input, source, fix)?;
        check.update(&diagnose_unnamed(input.scene(), source));
        while fix && check.fix(input)? {
            check.diagnosis = diagnose_source(input.scene(), source);
            check.update(&diagnose_unnamed(input.scene(), source));
        }
        Ok(check)
    }

    /// Whether `--fix` would correct something.
    pub fn is_fixable(&self) -> bool {
        !self.diagnosis.consistent && self.to_correct().iter().any(|cause| cause.correction.is_some())
    }

    /// The best cause, or the two that together explain the misfit.
    fn to_correct(&self) -> &[Cause] {
        match &self.together {
            Some(two) => two,
            None => &self.diagnosis.causes[..self.diagnosis.causes.len().min(1)],
        }
    }

    /// Corrects the best cause; returns whether anything was changed. A mistake is not corrected twice, unless it has a
    /// parameter, which may need refinement.
    pub(super) fn fix<I: Input>(&mut self, input: &mut I) -> Result<bool, I::Error> {
        if self.corrected.len() >= MAX_CORRECTIONS || self.diagnosis.consistent {
            return Ok(false);
        }
        let causes = self.to_correct().to_vec();
        self.together = None;
        let mut changed = false;
        for cause in causes {
            let Some(correction) = cause.correction else { continue };
            if (cause.value.is_some() || !self.corrected.contains(&correction)) && input.correct(&cause)? {
                self.corrected.push(correction);
                changed = true;
            }
        }
        Ok(changed)
    }

    /// Takes over a later result with more information, unless the scene was inconsistent before. One that has checked
    /// nothing has none.
    pub(super) fn update(&mut self, diagnosis: &Diagnosis) {
        let has_checked = diagnosis.agreement.is_some() || self.diagnosis.agreement.is_none();
        if self.diagnosis.consistent && has_checked {
            self.diagnosis = diagnosis.clone();
        }
    }

    /// The last step of a run: the diagnosis of its localization counts if the scene was consistent before, or if detections name
    /// their objects and only refined poses agree with the boxes. Objects of an inconsistent scene are not
    /// [`Status::Ok`], unless that is `accepted`.
    pub(super) fn conclude(&mut self, localization: &mut Localization, are_named: bool, accepted: bool) {
        let found = &localization.diagnosis;
        let refined = are_named && !localization.refined_poses.is_empty() && found.consistent;
        if refined && !self.diagnosis.consistent {
            self.before_refinement = self.diagnosis.agreement;
            self.together = None;
            self.diagnosis = found.clone();
        }
        self.update(found);
        localization.diagnosis = self.diagnosis.clone();
        if !self.diagnosis.consistent && !accepted {
            let ok = localization.estimates.iter_mut().filter(|estimate| estimate.status == Status::Ok);
            ok.for_each(|estimate| estimate.status = Status::Inconsistent);
        }
    }

    /// Whether the cause of an inconsistency is known.
    pub fn is_explained(&self) -> bool {
        self.together.is_some() || !self.diagnosis.causes.is_empty()
    }
}

/// The diagnosis of the detections of a source; an ambiguous source is reported later.
pub fn diagnose_source(scene: &Scene, source: Option<&str>) -> Diagnosis {
    let source = scene.source_index(source).unwrap_or_default();
    diagnose(scene, |detection| source.is_none() || detection.source_index == source)
}

/// The diagnosis of a scene in which most detections name no object: they are associated for it.
pub fn diagnose_unnamed(scene: &Scene, source: Option<&str>) -> Diagnosis {
    let index = scene.source_index(source).unwrap_or_default();
    let used = || scene.detections.iter().filter(|d: &&Detection| index.is_none() || d.source_index == index);
    let unnamed = used().filter(|d| d.object_index.is_none()).count();
    if 2 * unnamed <= used().count() || used().count() > MAX_ASSOCIATED {
        return Diagnosis::default();
    }
    let options = AssociateOptions { source: source.map(str::to_owned), ids: IdPolicy::Trust, ..Default::default() };
    // An ambiguous source is reported later.
    associate(scene, &options)
        .and_then(|association| diagnose_association(scene, &association, &options))
        .unwrap_or_default()
}
