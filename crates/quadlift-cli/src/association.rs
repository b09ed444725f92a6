//! Finding out which detections show the same object: what `associate` and `localize` share.

use std::path::Path;

use anyhow::bail;
use quadlift::associate_observed;
use quadlift::association::{AssociateError, AssociateOptions, Association, IdUse, Outcome};
use quadlift::diagnosis::diagnose_association;
use quadlift::scene::{Detection, Scene, SourceError};
use quadlift_io::association::skipped_in_words;

use crate::corrections::CorrectedScene;
use crate::diagnosis::Check;
use crate::output::{Output, one_line};
use crate::progress::{counting_bar, shown_on};
use crate::words::{count, some_of};

/// How far to trust the ids of detections, as on the command line.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum IdsName {
    /// They are right; only detections without an id are associated.
    Trust,
    /// They may be wrong (tracks break and swap their objects).
    Evidence,
    /// Ignore the ids.
    Ignore,
}

impl IdsName {
    /// The library's word.
    pub fn use_of_ids(self) -> IdUse {
        match self {
            Self::Trust => IdUse::Trust,
            Self::Evidence => IdUse::Evidence,
            Self::Ignore => IdUse::Ignore,
        }
    }
}

/// Whether `localize` associates detections first.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, clap::ValueEnum)]
pub enum When {
    /// If detections of the source lack an object id; existing ids are trusted.
    #[default]
    Auto,
    /// Never: detections without an object id are skipped.
    Never,
    /// In any case; ids are evidence.
    Always,
}

impl When {
    /// How to use the ids of a scene if it is to be associated, otherwise `None`. `chosen` is the user's choice.
    pub fn ids_for(self, scene: &Scene, source: Option<&str>, chosen: Option<IdsName>) -> Option<IdUse> {
        let default = match self {
            Self::Never => return None,
            Self::Always => IdUse::Evidence,
            Self::Auto if named_and_unnamed(scene, source).1 == 0 => return None,
            Self::Auto => IdUse::Trust,
        };
        Some(chosen.map_or(default, IdsName::use_of_ids))
    }
}

/// Numbers of detections of a source with and without an object id; an ambiguous source is reported later.
fn named_and_unnamed(scene: &Scene, source: Option<&str>) -> (usize, usize) {
    let source = scene.source_index(source).unwrap_or_default();
    let of_source = |d: &&Detection| source.is_none() || d.source_index == source;
    let (named, unnamed): (Vec<_>, Vec<_>) =
        scene.detections.iter().filter(of_source).partition(|d| d.object_index.is_some());
    (named.len(), unnamed.len())
}

/// The message of `localize` about an association.
pub fn localize_in_words(scene: &Scene, source: Option<&str>, ids: IdUse, association: &Association) -> String {
    let (named, unnamed) = named_and_unnamed(scene, source);
    let given = match ids {
        _ if named == 0 => "no detection has an object id".to_owned(),
        IdUse::Trust => {
            format!("{} without an object id; the ids of the others are trusted", count(unnamed, "detection"))
        }
        IdUse::Evidence => "existing ids are used as evidence".to_owned(),
        IdUse::Ignore => "existing ids are ignored".to_owned(),
    };
    let doubtful: Vec<&str> =
        association.objects.iter().filter(|o| o.doubtful.is_some()).map(|o| o.id.as_str()).collect();
    let mut text = format!("detections were associated ({given}): {}", in_words(association));
    if !doubtful.is_empty() {
        text.push_str(&format!("\ndoubtful: {}", one_line(&some_of(&doubtful))));
    }
    text
}

/// Associates the detections of a scene and runs the self-check; with `--fix` the scene is corrected and associated
/// again. `title` precedes the progress bar. If no object is found, the error gives the reason with the result of the
/// self-check.
pub fn associate_and_check(
    title: &str,
    corrected: &mut CorrectedScene,
    path: &Path,
    options: &AssociateOptions,
    check: &mut Check,
    out: &Output,
) -> anyhow::Result<Association> {
    let mut association = with_progress(title, &corrected.scene, options, out)?;
    check.update(&diagnose_association(&corrected.scene, &association, options)?);
    while check.fix(corrected, path)? {
        association = with_progress(title, &corrected.scene, options, out)?;
        check.diagnosis = diagnose_association(&corrected.scene, &association, options)?;
    }
    judged(association, check)
}

fn with_progress(title: &str, scene: &Scene, options: &AssociateOptions, out: &Output) -> anyhow::Result<Association> {
    let bar = counting_bar(title, "association steps", out);
    let result = associate_observed(scene, options, &shown_on(&bar));
    bar.finish_and_clear();
    match result {
        Err(error @ AssociateError::Source(SourceError::Several(_))) => bail!("{error} (--source NAME)"),
        result => Ok(result?),
    }
}

/// An association that has found something; otherwise an error.
fn judged(association: Association, check: &Check) -> anyhow::Result<Association> {
    if association.outcome == Outcome::NothingAgrees {
        return Err(check.nothing_agrees(&skipped_in_words(association.skipped)).into());
    }
    if association.outcome != Outcome::Found {
        bail!("no object was found: {}{}", association.outcome.text(), skipped_in_words(association.skipped));
    }
    Ok(association)
}

/// The scene with the objects of an association.
pub fn associated_scene(scene: &Scene, association: &Association, source: Option<&str>) -> anyhow::Result<Scene> {
    Ok(association.applied_to(scene, scene.source_index(source)?))
}

/// The result, in one sentence.
pub fn in_words(association: &Association) -> String {
    let members = association.object_of_detection.iter().flatten().count();
    let doubtful = association.objects.iter().filter(|object| object.doubtful.is_some()).count();
    let mut text = format!(
        "{} assigned to {}; {} unassigned",
        count(members, "detection"),
        count(association.objects.len(), "object"),
        association.clutter
    );
    if doubtful > 0 {
        text.push_str(&format!("; {doubtful} doubtful"));
    }
    text + &skipped_in_words(association.skipped)
}
