//! What an object map knows in a file, to go on later as if nothing had happened: serde writes what does not follow from the rest.
//!
//! A map that is read has the default options; [`super::ObjectMap::with_options`] gives it those that it had. Files have a version
//! and a checksum (`quadlift-io`). What they contain all the same is checked as far as it could make the map panic.

use serde::de::Error;
use serde::{Deserialize, Deserializer, Serialize, Serializer};

use super::memory::Memory;
use super::{MAX_CATEGORIES, MAX_CUE_SOURCES};

impl Serialize for Memory {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        // The derived one: fields of the struct.
        Memory::serialize(self, serializer)
    }
}

impl<'de> Deserialize<'de> for Memory {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let mut memory = Memory::deserialize(deserializer)?;
        rebuild(&mut memory).ok_or_else(|| D::Error::custom("its parts contradict each other"))?;
        Ok(memory)
    }
}

/// Whether the numbers of a map that was read are in their ranges.
fn is_valid(memory: &Memory) -> bool {
    let (categories, sources) = (memory.categories.names().len(), memory.cue_sources.len());
    let mut frames = memory.recent.iter().chain(memory.windows.all());
    categories <= MAX_CATEGORIES
        && sources <= MAX_CUE_SOURCES
        && memory.scaled_by_frame.last().is_none_or(|&source| (source as usize) < sources)
        && memory.origin.iter().all(|x| x.is_finite())
        && memory.running.is_valid(categories)
        && memory.keyframes.last_key().is_none_or(|key| key < memory.next_key)
        && frames.all(|frame| frame.is_valid(categories, sources))
        && memory.objects.is_valid(categories, sources)
}

/// Computes what was not stored; `None` if the map contradicts itself.
fn rebuild(memory: &mut Memory) -> Option<()> {
    is_valid(memory).then_some(())?;
    let of_objects = memory.objects.all().flat_map(|tracked| tracked.views.iter().map(|view| view.keyframe));
    let of_frames = memory.recent.iter().chain(memory.windows.all()).map(|frame| frame.key);
    memory.keyframes.rebuild(&memory.origin, of_objects.chain(of_frames))?;
    memory.objects.rebuild()
}
