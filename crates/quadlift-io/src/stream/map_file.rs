//! What the map knows of its objects beside their estimates, in the objects of a result file.

use std::collections::HashMap;

use quadlift::diagnosis::Diagnosis;
use quadlift::online::{MapObject, ObjectMap, Presence};
use serde::{Deserialize, Serialize};

use crate::numbers::significant;
use crate::scene_file::{ObjectRecord, SceneFile};

/// The field of objects that holds a [`MemoryRecord`].
const MEMORY: &str = "memory";

/// What a result file says of a map, beside the estimates of its objects.
#[derive(Debug, Clone, PartialEq)]
pub struct MapMemory {
    /// Confirmed and gone objects, in the order of their ids.
    pub objects: Vec<MapObject>,
    /// Number of frames, id and time of the last one, if there is one.
    pub(crate) stream: Option<StreamRecord>,
    /// What the map has found wrong with its frames; consistent if nothing is.
    pub diagnosis: Diagnosis,
}

impl MapMemory {
    /// What a map knows now.
    pub(crate) fn of(map: &ObjectMap) -> Self {
        let last = map.last_frame();
        Self {
            objects: map.objects().collect(),
            diagnosis: map.diagnosis().clone(),
            stream: last.map(|(id, last_time)| StreamRecord {
                frames: map.frames(),
                last_frame: id.to_owned(),
                last_time,
            }),
        }
    }

    /// Completes the result file of a map. `file` is the file whose objects were estimated
    /// ([`super::StreamedScene::to_file`]).
    ///
    /// Objects get a `memory` (whether they are there or gone, how likely they are there, when they were seen) and the order
    /// of their ids; the result gets the detections.
    pub(crate) fn add_to(&self, result: &mut SceneFile, file: &SceneFile) {
        self.add_to_objects(&mut result.objects);
        result.detections.clone_from(&file.detections);
    }

    fn add_to_objects(&self, objects: &mut [ObjectRecord]) {
        let of_id: HashMap<String, (usize, &MapObject)> =
            self.objects.iter().enumerate().map(|(place, object)| (object.id.to_string(), (place, object))).collect();
        for object in objects.iter_mut() {
            if let Some((_, of_map)) = of_id.get(&object.id) {
                let memory = serde_json::to_value(MemoryRecord::of(of_map)).unwrap_or_default();
                object.extra.insert(MEMORY.to_owned(), memory);
            }
        }
        objects.sort_by_key(|object| of_id.get(&object.id).map_or(usize::MAX, |(place, _)| *place));
    }
}

/// How far a stream had come.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct StreamRecord {
    /// Number of frames.
    pub frames: u64,
    /// Id of the last frame.
    pub last_frame: String,
    /// Time of the last frame, seconds.
    pub last_time: f64,
}

/// What a map knows of an object (`memory` of an object in a file).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct MemoryRecord {
    /// Share of its detections in each category, the most frequent first.
    #[serde(default)]
    pub categories: Vec<ShareRecord>,
    /// Number of its detections.
    #[serde(default)]
    pub detections: usize,
    /// Probability that it exists and is still there.
    pub existence: Option<f64>,
    /// Number of frames in which it should be detected if nothing hides it.
    #[serde(default)]
    pub expected_views: usize,
    /// Time of its first detection, seconds.
    #[serde(default)]
    pub first_seen: f64,
    /// Number of kept views.
    #[serde(default)]
    pub kept_views: usize,
    /// Time of its last detection, seconds.
    #[serde(default)]
    pub last_seen: f64,
    /// How certain the map is of it.
    #[serde(with = "PresenceName")]
    pub presence: Presence,
}

#[derive(Serialize, Deserialize)]
#[serde(remote = "Presence", rename_all = "snake_case")]
enum PresenceName {
    Tentative,
    Confirmed,
    Gone,
}

/// Share of the detections of an object in a category.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct ShareRecord {
    /// The category.
    pub category: Option<String>,
    /// The share.
    pub share: f64,
}

impl MemoryRecord {
    fn of(object: &MapObject) -> Self {
        let share = |(category, share): &(Option<String>, f64)| ShareRecord {
            category: category.clone(),
            share: significant(*share, 6),
        };
        Self {
            categories: object.categories.iter().map(share).collect(),
            detections: object.detections,
            existence: Some(significant(object.existence, 6)),
            expected_views: object.expected_views,
            first_seen: object.first_seen,
            kept_views: object.kept_views,
            last_seen: object.last_seen,
            presence: object.presence,
        }
    }
}

impl ObjectRecord {
    /// What a map of a stream knows of the object.
    pub(crate) fn memory(&self) -> Option<MemoryRecord> {
        MemoryRecord::deserialize(self.extra.get(MEMORY)?).ok()
    }

    /// Whether a map of a stream believes that the object is gone.
    pub fn is_gone(&self) -> bool {
        self.memory().is_some_and(|memory| memory.presence == Presence::Gone)
    }
}
