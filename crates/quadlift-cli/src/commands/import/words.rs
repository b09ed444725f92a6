//! What was read from files of other programs, in words and as JSON.

use quadlift_io::read::Import;
use quadlift_io::read::detections::AddedDetections;
use serde_json::{Value, json};

use crate::output::Output;
use crate::words::{count, some_of};

/// Problems that are printed, at most.
const MAX_REPORTED: usize = 10;

/// Prints what was left out.
pub(crate) fn tell_problems(import: &Import, out: &Output) {
    import.problems.iter().take(MAX_REPORTED).for_each(|problem| out.warning(problem));
    if import.problem_count > MAX_REPORTED {
        out.warning(&format!("{} more problems of this log", import.problem_count - MAX_REPORTED));
    }
}

/// The added detections, in one line.
pub(crate) fn in_words(added: &AddedDetections, source: &str) -> String {
    let images = added.matched_images + added.images_without_frame.len();
    let found = if images == added.matched_images {
        count(images, "image")
    } else {
        format!("{} of {}", added.matched_images, count(images, "image"))
    };
    format!(
        "{} of the source {source} in {found} matched to frames of the scene (by {})",
        count(added.added, "detection"),
        added.matched_by.name()
    )
}

/// Assumptions and skipped detections.
pub(crate) fn notes(added: &AddedDetections) -> Vec<String> {
    let mut notes = added.notes.clone();
    if !added.images_without_frame.is_empty() {
        notes.push(format!(
            "{} no frame in the scene, their {} are skipped: {}",
            has_or_have(added.images_without_frame.len(), "image"),
            count(added.in_no_frame, "detection"),
            some_of(&added.images_without_frame)
        ));
    }
    if !added.frames_without_image.is_empty() {
        notes.push(format!(
            "{} no image among the detections: {}",
            has_or_have(added.frames_without_image.len(), "frame"),
            some_of(&added.frames_without_image)
        ));
    }
    for (number, why) in [(added.low_score, "with a lower score"), (added.empty, "without width or height")] {
        if number > 0 {
            notes.push(format!("skipped {} {why}", count(number, "detection")));
        }
    }
    if added.removed > 0 {
        notes.push(format!("{} of the scene were removed", count(added.removed, "detection")));
    }
    notes.push(match added.with_object {
        0 => "no detection has a track id: `quadlift localize` associates the detections".to_owned(),
        n if n < added.added => {
            format!("{n} of {} detections have a track id, which becomes their object id", added.added)
        }
        _ => "track ids become object ids".to_owned(),
    });
    notes
}

fn has_or_have(n: usize, singular: &str) -> String {
    format!("{} {}", count(n, singular), if n == 1 { "has" } else { "have" })
}

/// The added detections as JSON.
pub(crate) fn to_json(added: &AddedDetections, notes: &[String]) -> Value {
    json!({
        "detections": added.added,
        "with_object": added.with_object,
        "matched_by": added.matched_by.name(),
        "matched_images": added.matched_images,
        "images_without_frame": added.images_without_frame,
        "frames_without_image": added.frames_without_image,
        "skipped": { "in_no_frame": added.in_no_frame, "low_score": added.low_score, "empty": added.empty },
        "removed": added.removed,
        "notes": notes,
    })
}
