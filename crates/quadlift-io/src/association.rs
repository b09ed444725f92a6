//! Results of an association ([`quadlift::association`]) as records of scene files and as text.

use std::collections::HashMap;

use quadlift::association::{AssociatedObject, Association};
use quadlift::scene::{Scene, SkippedDetections};
use serde_json::{Map, Value, json};

use crate::scene_file::{DetectionRecord, SceneFile};
use crate::wording::count;

/// Writes the objects of an associated scene into the detections of its file.
pub fn write_objects(detections: &mut [DetectionRecord], associated: &Scene) {
    for (record, detection) in detections.iter_mut().zip(&associated.detections) {
        record.object = detection.object_index.map(|index| associated.object_ids[index as usize].as_str().into());
    }
}

/// Adds an association to a result: the detections with their object ids, and warnings of doubtful objects.
/// `detections` are those of the associated file.
pub fn add_to_result(
    result: &mut SceneFile,
    detections: Vec<DetectionRecord>,
    associated: &Scene,
    source: Option<&str>,
    association: &Association,
) {
    result.detections = detections;
    write_objects(&mut result.detections, associated);
    result.detections.retain(|record| source.is_none() || record.source.as_deref() == source);
    for record in &mut result.detections {
        // Masks are the bulk of a segmented scene, and stay there.
        (record.mask, record.segmentation) = (None, None);
    }
    let doubts: HashMap<&str, &str> =
        association.objects.iter().filter_map(|o| Some((o.id.as_str(), o.doubtful?.text()))).collect();
    for object in &mut result.objects {
        object.warnings.extend(doubts.get(object.id.as_str()).map(|doubt| format!("doubtful: {doubt}")));
    }
}

/// The association as JSON: counts, and the objects with their evidence.
pub fn association_record(scene: &Scene, association: &Association) -> Value {
    let skipped = association.skipped;
    json!({
        "objects": association.objects.iter().map(|object| object_json(scene, object)).collect::<Vec<_>>(),
        "associated": association.object_of_detection.iter().flatten().count(),
        "clutter": association.clutter,
        "skipped": {
            "other_source": skipped.other_source,
            "low_score": skipped.low_score,
            "duplicate": skipped.duplicate,
        },
        "edge_sd": association.edge_sd,
        "pixel_sd": association.pixel_sd,
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

/// The detections that took no part, to be added to a sentence.
pub fn skipped_in_words(skipped: SkippedDetections) -> String {
    let reasons = [(skipped.low_score, "with a low score"), (skipped.duplicate, "that overlap a better one")];
    let given = reasons.iter().filter(|(number, _)| *number > 0);
    given.map(|(number, why)| format!("; {} {why} skipped", count(*number, "detection"))).collect()
}
