//! One run, in its order: check, associate, check again, measure, solve, conclude.
//!
//! The program, Python, the ROS 2 node and maps of streams call [`run()`]; [`localize()`] is the same without association.

mod input;
mod options;
mod pairs;
mod check;
mod sources;
#[cfg(test)]
mod tests;

pub use check::{Check, diagnose_source, diagnose_unnamed};
pub use input::Input;
pub use options::{AssociateWhen, RunOptions};

use crate::association::{AssociateError, AssociateOptions, Association, IdPolicy, Outcome, associate_observed};
use crate::diagnosis::diagnose_association;
use crate::localize::{Localization, LocalizeError, LocalizeOptions};
use crate::observer::{Observer, Phase, Unobserved};
use crate::scene::{Scene, SkippedDetections};
use sources::solve_consistent;

/// The result of a run.
#[derive(Debug, Clone, Default)]
pub struct Run {
    /// Whether the scene is consistent.
    pub check: Check,
    /// The association, if detections were associated.
    pub association: Option<Association>,
    /// The estimates.
    pub localization: Localization,
}

/// Why a run has no result. `E` is the error of its [`Input`].
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum RunError<E: std::error::Error> {
    /// The input cannot be read or corrected.
    #[error("{0}")]
    Input(E),
    /// The detections cannot be associated.
    #[error(transparent)]
    Associate(#[from] AssociateError),
    /// Association found no object.
    #[error("no object was found: {}", outcome.text())]
    NothingFound {
        /// How the association ended.
        outcome: Outcome,
        /// Skipped detections.
        skipped: SkippedDetections,
        /// What the check says about it.
        check: Box<Check>,
    },
    /// The objects cannot be localized.
    #[error(transparent)]
    Localize(#[from] LocalizeError),
    /// There is no object.
    #[error("{}", nothing_to_localize(*detections, *without_object))]
    NothingToLocalize {
        /// Number of detections.
        detections: usize,
        /// Those without an object id.
        without_object: usize,
    },
}

fn nothing_to_localize(detections: usize, without_object: usize) -> String {
    match detections {
        0 => "there is nothing to localize: the scene has no detections".to_owned(),
        _ => format!("there is nothing to localize: {without_object} detections have no object id"),
    }
}

/// Checks, associates, measures and localizes the scene of an input.
///
/// # Errors
/// [`RunError`]. A single object that cannot be solved is a [`crate::solve::Status`] instead, an inconsistent scene a
/// [`Check`].
pub fn run<I: Input>(input: &mut I, options: &RunOptions, observer: &dyn Observer) -> Result<Run, RunError<I::Error>> {
    let source = options.localize.source.as_deref();
    let known = input.known();
    let (check, association) = match options.ids_for(input.scene()) {
        None => (Check::of(input, source, options.fix).map_err(RunError::Input)?, None),
        Some(ids) => {
            let (check, found) = identify(input, &options.of_association(ids), options.fix, observer)?;
            let source = input.scene().source_index(source).unwrap_or_default();
            *input.scene_mut() = found.applied_to(input.scene(), source);
            (check, Some(found))
        }
    };
    let measurements = input.measure(&options.localize, observer).map_err(RunError::Input)?;
    observer.begins(Phase::Objects);
    let localize = LocalizeOptions { measurements, ..options.localize.clone() };
    let localization = solve_consistent(input.scene(), &localize, observer)?;
    let skipped = localization.skipped.without_object;
    if localization.estimates.is_empty() {
        let detections = input.scene().detections.len();
        return Err(RunError::NothingToLocalize { detections, without_object: skipped });
    }
    // Refined poses agree with the boxes that are left in the scene, which say nothing then.
    let may_agree = association.is_none() && known.consistent;
    let check = check.with_known(known);
    Ok(concluded(check, association, localization, &options.localize, may_agree))
}

/// The first two steps: checks and associates the detections of an input, and checks again. The input's scene has its detections
/// as they were; see [`Association::applied_to`].
///
/// # Errors
/// [`RunError`], [`RunError::NothingFound`] if there is no object.
pub fn identify<I: Input>(
    input: &mut I,
    options: &AssociateOptions,
    fix: bool,
    observer: &dyn Observer,
) -> Result<(Check, Association), RunError<I::Error>> {
    let source = options.source.as_deref();
    // Ids that are not trusted say nothing yet.
    let mut check = match options.ids {
        IdPolicy::Trust => Check::of(input, source, fix).map_err(RunError::Input)?,
        _ => Check::default(),
    };
    let associate = |scene: &Scene| {
        observer.begins(Phase::Association);
        associate_observed(scene, options, observer)
    };
    let mut found = associate(input.scene())?;
    check.update(&diagnose_association(input.scene(), &found, options)?);
    while fix && check.fix(input).map_err(RunError::Input)? {
        found = associate(input.scene())?;
        check.diagnosis = diagnose_association(input.scene(), &found, options)?;
    }
    if found.outcome == Outcome::Found {
        return Ok((check, found));
    }
    Err(RunError::NothingFound { outcome: found.outcome, skipped: found.skipped, check: Box::new(check) })
}

/// The last step; `may_agree`: refined poses may settle an inconsistency.
fn concluded(
    mut check: Check,
    association: Option<Association>,
    mut localization: Localization,
    options: &LocalizeOptions,
    may_agree: bool,
) -> Run {
    if association.is_some() {
        // The association lists them.
        localization.skipped.without_object = 0;
    }
    check.conclude(&mut localization, may_agree, options.allow_inconsistent);
    Run { check, association, localization }
}

/// Localizes every object with an id in the detections: [`run()`] without association and corrections.
///
/// # Errors
/// [`LocalizeError`] if the options do not fit the scene; a single object that cannot be solved is a
/// [`crate::solve::Status`] instead.
pub fn localize(scene: &Scene, options: &LocalizeOptions) -> Result<Localization, LocalizeError> {
    localize_observed(scene, options, &Unobserved)
}

/// [`localize()`] with an observer, whose steps are objects.
///
/// # Errors
/// As [`localize()`]; [`LocalizeError::Canceled`] if the observer cancels.
pub fn localize_observed(
    scene: &Scene,
    options: &LocalizeOptions,
    observer: &dyn Observer,
) -> Result<Localization, LocalizeError> {
    let localization = solve_consistent(scene, options, observer)?;
    Ok(concluded(Check::default(), None, localization, options, true).localization)
}
