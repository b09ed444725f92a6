//! Association in words: what `associate` and `localize` share.

use quadlift::association::{Association, IdPolicy};
use quadlift::scene::Scene;
use quadlift_io::SceneFile;
use quadlift_io::association::skipped_in_words;
use quadlift_report::Labels;

use crate::output::one_line;
use crate::words::{count, some_of};

/// The message of `localize` about an association of the detections of a file, whose scene has the objects.
pub(crate) fn localize_in_words(
    file: &SceneFile,
    scene: &Scene,
    source: Option<&str>,
    ids: IdPolicy,
    association: &Association,
) -> String {
    let used = || file.detections.iter().filter(|d| source.is_none() || d.source.as_deref() == source);
    let unnamed = used().filter(|d| d.object.is_none()).count();
    let given = match ids {
        _ if unnamed == used().count() => "no detection has an object id".to_owned(),
        IdPolicy::Trust => {
            format!("{} without an object id; the ids of the others are trusted", count(unnamed, "detection"))
        }
        IdPolicy::Evidence => "existing ids are used as evidence".to_owned(),
        IdPolicy::Ignore => "existing ids are ignored".to_owned(),
    };
    let labels = labels(scene, association);
    let uncertain: Vec<&str> =
        association.objects.iter().filter(|o| o.uncertain.is_some()).map(|o| labels.of(&o.id)).collect();
    let mut text = format!("detections were associated ({given}): {}", in_words(association));
    if !uncertain.is_empty() {
        text.push_str(&format!("\nuncertain: {}", one_line(&some_of(&uncertain))));
    }
    text
}

/// The labels of the objects of an association in a scene.
pub(crate) fn labels(scene: &Scene, association: &Association) -> Labels {
    let category = |index: Option<u32>| index.map(|index| scene.categories[index as usize].as_str());
    Labels::new(association.objects.iter().map(|object| (object.id.as_str(), category(object.category_index))))
}

/// The result, in one sentence.
pub(crate) fn in_words(association: &Association) -> String {
    let members = association.object_of_detection.iter().flatten().count();
    let uncertain = association.objects.iter().filter(|object| object.uncertain.is_some()).count();
    let mut text = format!(
        "{} assigned to {}; {} unassigned",
        count(members, "detection"),
        count(association.objects.len(), "object"),
        association.clutter
    );
    if uncertain > 0 {
        text.push_str(&format!("; {uncertain} uncertain"));
    }
    text + &skipped_in_words(association.skipped)
}
