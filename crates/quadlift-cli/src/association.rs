//! Association in words: what `associate` and `localize` share.

use quadlift::association::{Association, IdUse};
use quadlift::run::AssociateWhen;
use quadlift_io::SceneFile;
use quadlift_io::association::skipped_in_words;

use crate::output::one_line;
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
    /// The library's word.
    pub fn of_library(self) -> AssociateWhen {
        match self {
            Self::Auto => AssociateWhen::Auto,
            Self::Never => AssociateWhen::Never,
            Self::Always => AssociateWhen::Always,
        }
    }
}

/// The message of `localize` about an association of the detections of a file.
pub fn localize_in_words(file: &SceneFile, source: Option<&str>, ids: IdUse, association: &Association) -> String {
    let used = || file.detections.iter().filter(|d| source.is_none() || d.source.as_deref() == source);
    let unnamed = used().filter(|d| d.object.is_none()).count();
    let given = match ids {
        _ if unnamed == used().count() => "no detection has an object id".to_owned(),
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
