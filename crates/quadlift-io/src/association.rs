//! Results of an association ([`quadlift::association`]) as records of scene files and as text.

use std::collections::HashMap;

use quadlift::association::{AssociatedObject, Association};
use quadlift::scene::{Scene, SkippedDetections};
use serde::{Deserialize, Serialize};

use crate::scene_file::{DetectionRecord, ObjectRecord};
use crate::wording::count;

/// Writes the objects of an associated scene into the detections of its file.
pub fn write_objects(detections: &mut [DetectionRecord], associated: &Scene) {
    for (record, detection) in detections.iter_mut().zip(&associated.detections) {
        record.object = detection.object_index.map(|index| associated.object_ids[index as usize].as_str().into());
    }
}

/// Adds the warnings of uncertain objects of an association to those of a result.
pub(crate) fn add_doubts(objects: &mut [ObjectRecord], association: &Association) {
    let doubts: HashMap<&str, &str> =
        association.objects.iter().filter_map(|o| Some((o.id.as_str(), o.uncertain?.text()))).collect();
    for object in objects {
        object.warnings.extend(doubts.get(object.id.as_str()).map(|doubt| format!("uncertain: {doubt}")));
    }
}

/// An association in a result file: counts, and the objects with their evidence.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct AssociationRecord {
    /// Number of assigned detections.
    pub associated: usize,
    /// Number of unassigned detections.
    pub clutter: usize,
    /// Standard deviation of box edges relative to the mean half size of the box.
    pub edge_noise: f64,
    /// Standard deviation of the shifts of whole frames, pixels.
    pub frame_shift_sd_px: f64,
    /// The objects, in the order of their first detections.
    pub objects: Vec<AssociatedObjectRecord>,
    /// The size-independent part of the standard deviation of box edges, pixels.
    pub edge_noise_px: f64,
    /// The detections that took no part.
    pub skipped: NotAssociatedRecord,
}

/// An object in an [`AssociationRecord`].
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct AssociatedObjectRecord {
    /// Its category.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub category: Option<String>,
    /// Why it may not be one standing object, in words.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub uncertain: Option<String>,
    /// Evidence that its detections show it instead of clutter (nats).
    pub evidence: Option<f64>,
    /// Number of frames in which it should be detected.
    pub expected_views: usize,
    /// Its id.
    pub id: String,
    /// Number of its detections.
    pub views: usize,
}

/// Numbers of detections that an association skipped, by reason.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default)]
pub struct NotAssociatedRecord {
    /// They overlap a better one.
    pub duplicate: usize,
    /// Their score is low.
    pub low_score: usize,
    /// They are of another source.
    pub other_source: usize,
}

impl AssociationRecord {
    /// The record of an association of a scene.
    pub fn of(scene: &Scene, association: &Association) -> Self {
        let SkippedDetections { other_source, low_score, duplicate, .. } = association.skipped;
        Self {
            associated: association.object_of_detection.iter().flatten().count(),
            clutter: association.clutter,
            edge_noise: association.edge_noise,
            frame_shift_sd_px: association.frame_shift_sd,
            objects: association.objects.iter().map(|object| AssociatedObjectRecord::of(scene, object)).collect(),
            edge_noise_px: association.edge_noise_px,
            skipped: NotAssociatedRecord { duplicate, low_score, other_source },
        }
    }
}

impl AssociatedObjectRecord {
    fn of(scene: &Scene, object: &AssociatedObject) -> Self {
        Self {
            category: object.category_index.map(|category| scene.categories[category as usize].clone()),
            uncertain: object.uncertain.map(|doubt| doubt.text().to_owned()),
            evidence: object.evidence,
            expected_views: object.expected_views,
            id: object.id.clone(),
            views: object.views,
        }
    }
}

/// The detections that took no part, to be added to a sentence.
pub fn skipped_in_words(skipped: SkippedDetections) -> String {
    let reasons = [(skipped.low_score, "with a low score"), (skipped.duplicate, "that overlap a better one")];
    let given = reasons.iter().filter(|(number, _)| *number > 0);
    given.map(|(number, why)| format!("; {} {why} skipped", count(*number, "detection"))).collect()
}
