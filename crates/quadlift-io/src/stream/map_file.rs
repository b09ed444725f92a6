//! What the map knows of its objects beside their estimates, in the objects of a result file.

use std::collections::HashMap;

use quadlift::online::{MapObject, ObjectMap, Presence};
use serde_json::{Value, json};

use crate::numbers::significant;
use crate::scene_file::{ObjectRecord, SceneFile};

/// What a result file says of a map, beside the estimates of its objects.
#[derive(Debug, Clone, PartialEq)]
pub struct MapMemory {
    /// Confirmed and gone objects, in the order of their ids.
    pub objects: Vec<MapObject>,
    /// Number of frames, id and time of the last one, if there is one.
    stream: Option<Value>,
}

impl MapMemory {
    /// What a map knows now.
    pub fn of(map: &ObjectMap) -> Self {
        let last = map.last_frame();
        Self {
            objects: map.objects().collect(),
            stream: last.map(|(id, time)| json!({ "frames": map.frames(), "last_frame": id, "last_time": time })),
        }
    }

    /// Completes the result file of a map. `file` is the file whose objects were estimated
    /// ([`super::StreamedScene::to_file`]).
    ///
    /// Objects get a `memory` (whether they are there or gone, how likely they are there, when they were seen) and the order
    /// of their ids; the result gets the detections.
    pub fn add_to(&self, result: &mut SceneFile, file: &SceneFile) {
        self.add_to_objects(&mut result.objects);
        result.detections.clone_from(&file.detections);
        if let (Some(about), Some(stream)) = (&mut result.localization, &self.stream) {
            about["stream"] = stream.clone();
        }
    }

    fn add_to_objects(&self, objects: &mut [ObjectRecord]) {
        let of_id: HashMap<String, (usize, &MapObject)> =
            self.objects.iter().enumerate().map(|(place, object)| (object.id.to_string(), (place, object))).collect();
        for object in objects.iter_mut() {
            if let Some((_, of_map)) = of_id.get(&object.id) {
                object.extra.insert("memory".to_owned(), memory(of_map));
            }
        }
        objects.sort_by_key(|object| of_id.get(&object.id).map_or(usize::MAX, |(place, _)| *place));
    }
}

/// The name of a presence in files.
pub fn presence_name(presence: Presence) -> &'static str {
    match presence {
        Presence::Tentative => "tentative",
        Presence::Confirmed => "confirmed",
        Presence::Gone => "gone",
    }
}

fn memory(object: &MapObject) -> Value {
    let categories: Vec<Value> = object
        .categories
        .iter()
        .map(|(category, share)| json!({ "category": category, "share": significant(*share, 6) }))
        .collect();
    json!({
        "presence": presence_name(object.presence),
        "existence": significant(object.existence, 6),
        "first_seen": object.first_seen,
        "last_seen": object.last_seen,
        "detections": object.detections,
        "expected_views": object.expected_views,
        "kept_views": object.kept_views,
        "categories": categories,
    })
}
