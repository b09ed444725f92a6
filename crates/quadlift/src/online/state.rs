//! An object map in a file, to go on later as if nothing had happened: serde writes what does not follow from the rest.
//!
//! A map that is read has the default options; [`ObjectMap::with_options`] gives it those that it had. Files have a version and a
//! checksum (`quadlift-io`). What they contain all the same is checked as far as it could make the map panic.

use serde::de::Error;
use serde::{Deserialize, Deserializer, Serialize, Serializer};

use super::map::ObjectMap;
use super::running::MAX_COUNT;
use super::{MAX_CATEGORIES, MAX_CUE_SOURCES};

impl Serialize for ObjectMap {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        // The derived one: fields of the struct.
        ObjectMap::serialize(self, serializer)
    }
}

impl<'de> Deserialize<'de> for ObjectMap {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let mut map = ObjectMap::deserialize(deserializer)?;
        rebuild(&mut map).ok_or_else(|| D::Error::custom("its parts contradict each other"))?;
        Ok(map)
    }
}

/// Whether the numbers of a map that was read are in their ranges.
fn is_valid(map: &ObjectMap) -> bool {
    let (categories, sources) = (map.categories.names().len(), map.cue_sources.len());
    let mut frames = map.recent.iter().chain(map.windows.all());
    categories <= MAX_CATEGORIES
        && sources <= MAX_CUE_SOURCES
        && map.scaled_by_frame.last().is_none_or(|&source| (source as usize) < sources)
        && map.origin.iter().all(|x| x.is_finite())
        && map.running.is_valid(categories)
        && map.next_id < MAX_COUNT
        && map.keyframes.last_key().is_none_or(|key| key < map.next_key)
        && frames.all(|frame| frame.is_valid(categories, sources))
        && map.slots.iter().flatten().all(|tracked| tracked.id.0 < map.next_id && tracked.is_valid(categories, sources))
        // Aliases lead to older objects, so that following them ends.
        && map.aliases.iter().all(|(alias, id)| id < alias)
}

/// Computes what was not stored; `None` if the map contradicts itself.
fn rebuild(map: &mut ObjectMap) -> Option<()> {
    is_valid(map).then_some(())?;
    let of_objects = map.slots.iter().flatten().flat_map(|tracked| tracked.views.iter().map(|view| view.keyframe));
    let of_frames = map.recent.iter().chain(map.windows.all()).map(|frame| frame.key);
    map.keyframes.rebuild(&map.origin, of_objects.chain(of_frames))?;
    let is_empty = |&slot: &u32| map.slots[slot as usize].is_none();
    let empty: Vec<u32> = (0..map.slots.len() as u32).filter(is_empty).collect();
    let mut free = map.free_slots.clone();
    free.sort_unstable();
    (free == empty).then_some(())?;
    for slot in 0..map.slots.len() as u32 {
        let Some(tracked) = map.slot_mut(slot) else { continue };
        tracked.renumber();
        let id = tracked.id;
        map.slot_of_id.insert(id, slot).is_none().then_some(())?;
        map.index(slot);
    }
    Some(())
}
