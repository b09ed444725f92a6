//! What the map knows of its objects beside their estimates, in the objects of a result file.

use std::collections::HashMap;

use quadlift::online::{MapObject, ObjectMap, Presence};
use serde_json::{Value, json};

use crate::numbers::significant;
use crate::scene_file::ObjectRecord;

/// Adds a `memory` to each object that the map has: whether it is there or gone, how likely it is there, when it was seen.
/// Puts the objects in the order of their ids.
pub fn add_memory(objects: &mut [ObjectRecord], map: &ObjectMap) {
    let of_id: HashMap<String, (usize, MapObject)> =
        map.objects().enumerate().map(|(place, object)| (object.id.to_string(), (place, object))).collect();
    for object in objects.iter_mut() {
        if let Some((_, of_map)) = of_id.get(&object.id) {
            object.extra.insert("memory".to_owned(), memory(of_map));
        }
    }
    objects.sort_by_key(|object| of_id.get(&object.id).map_or(usize::MAX, |(place, _)| *place));
}

fn memory(object: &MapObject) -> Value {
    let presence = match object.presence {
        Presence::Tentative => "tentative",
        Presence::Confirmed => "confirmed",
        Presence::Gone => "gone",
    };
    let categories: Vec<Value> = object
        .categories
        .iter()
        .map(|(category, share)| json!({ "category": category, "share": significant(*share, 6) }))
        .collect();
    json!({
        "presence": presence,
        "existence": significant(object.existence, 6),
        "first_seen": object.first_seen,
        "last_seen": object.last_seen,
        "detections": object.detections,
        "expected_views": object.expected_views,
        "kept_views": object.kept_views,
        "categories": categories,
    })
}
