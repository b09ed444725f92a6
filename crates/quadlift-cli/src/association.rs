//! Finding out which detections show the same object: what `associate` and `localize` share.

use anyhow::bail;
use quadlift::associate;
use quadlift::associate::{AssociateError, AssociateOptions, AssociatedObject, Association, IdUse, Outcome};
use quadlift::scene::{Scene, SourceError};
use quadlift_io::SceneFile;
use serde_json::{Map, Value, json};

use crate::output::Output;
use crate::progress::counting_bar;
use crate::words::count;

/// What the ids of a scene's detections are worth, as on the command line.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum IdsName {
    /// They are right; only detections without an id are associated.
    Trust,
    /// They may be wrong (tracks break and swap their objects).
    Evidence,
    /// They are not looked at.
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

/// Whether `localize` finds out first which detections show the same object.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, clap::ValueEnum)]
pub enum When {
    /// Where no detection of the source names an object.
    #[default]
    Auto,
    /// Not at all: detections without an object are left out.
    Never,
    /// In any case.
    Always,
}

impl When {
    /// Whether a scene is to be associated.
    pub fn applies_to(self, scene: &Scene, source: Option<&str>) -> anyhow::Result<bool> {
        Ok(match self {
            Self::Never => false,
            Self::Always => true,
            Self::Auto => {
                let Ok(source) = scene.source_index(source) else { return Ok(false) };
                let mut detections =
                    scene.detections.iter().filter(|d| source.is_none() || d.source_index == source).peekable();
                detections.peek().is_some() && detections.all(|detection| detection.object_index.is_none())
            }
        })
    }
}

/// Associates the detections of a scene; `title` stands before the progress bar. That nothing is found is an error that
/// says why.
pub fn associate_scene(
    title: &str,
    scene: &Scene,
    options: &AssociateOptions,
    out: &Output,
) -> anyhow::Result<Association> {
    let bar = counting_bar(title, "steps of association", out);
    let result = associate(scene, options, &|done, total| {
        bar.set_length(total as u64);
        bar.set_position(done as u64);
    });
    bar.finish_and_clear();
    let association = match result {
        Err(error @ AssociateError::Source(SourceError::Several(_))) => bail!("{error} (--source NAME)"),
        result => result?,
    };
    if association.outcome != Outcome::Found {
        bail!("no object was found: {}", association.outcome.text());
    }
    Ok(association)
}

/// The scene with the objects of an association.
pub fn associated_scene(scene: &Scene, association: &Association, source: Option<&str>) -> anyhow::Result<Scene> {
    Ok(association.applied_to(scene, scene.source_index(source)?))
}

/// Writes the objects of an associated scene into the detections of its file.
pub fn write_objects(file: &mut SceneFile, associated: &Scene) {
    for (record, detection) in file.detections.iter_mut().zip(&associated.detections) {
        record.object = detection.object_index.map(|index| associated.object_ids[index as usize].as_str().into());
    }
}

/// What was found, in one sentence.
pub fn in_words(association: &Association) -> String {
    let members = association.object_of_detection.iter().flatten().count();
    let doubtful = association.objects.iter().filter(|object| object.doubtful.is_some()).count();
    let mut text = format!(
        "{} show {}, {} none",
        count(members, "detection"),
        count(association.objects.len(), "object"),
        association.clutter
    );
    if doubtful > 0 {
        text.push_str(&format!("; {doubtful} doubtful"));
    }
    let not_used = association.not_used;
    for (number, why) in [(not_used.low_score, "with a low score"), (not_used.duplicate, "that overlap a better one")] {
        if number > 0 {
            text.push_str(&format!("; {} {why} left out", count(number, "detection")));
        }
    }
    text
}

/// The association as JSON: counts, and the objects with their evidence.
pub fn to_json(scene: &Scene, association: &Association) -> Value {
    let not_used = association.not_used;
    json!({
        "objects": association.objects.iter().map(|object| object_json(scene, object)).collect::<Vec<_>>(),
        "associated": association.object_of_detection.iter().flatten().count(),
        "clutter": association.clutter,
        "not_used": {
            "other_source": not_used.other_source,
            "low_score": not_used.low_score,
            "duplicate": not_used.duplicate,
        },
        "edge_sd": association.edge_sd,
        "frame_shift_sd_px": association.frame_shift_sd,
    })
}

fn object_json(scene: &Scene, object: &AssociatedObject) -> Value {
    let mut json = Map::new();
    json.insert("id".to_owned(), object.id.as_str().into());
    if let Some(category) = object.category_index {
        json.insert("category".to_owned(), scene.categories[category as usize].as_str().into());
    }
    json.insert("views".to_owned(), object.views.into());
    json.insert("expected_views".to_owned(), object.expected_views.into());
    json.insert("evidence".to_owned(), object.evidence.into());
    if let Some(doubt) = object.doubtful {
        json.insert("doubtful".to_owned(), doubt.text().into());
    }
    Value::Object(json)
}
