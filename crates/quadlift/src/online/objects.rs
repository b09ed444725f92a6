//! The objects of a map, in slots that are reused.

use std::collections::BTreeMap;

use nalgebra::Vector3;

use super::tracked::Tracked;
use super::update::ObjectId;
use super::visibility::VisibilityIndex;
use crate::association::score::input_ids::IdTally;

/// Margin of the range within which an object may be visible.
const RANGE_MARGIN: f64 = 1.2 * 1.3;

/// Maximum number of merged ids that are remembered; the oldest are forgotten.
const MAX_ALIASES: usize = 100_000;

/// The objects of a map.
#[derive(Debug, Clone, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub(super) struct Objects {
    slots: Vec<Option<Box<Tracked>>>,
    /// Empty slots; the last one is used first.
    free: Vec<u32>,
    #[cfg_attr(feature = "serde", serde(skip))]
    slot_of_id: BTreeMap<ObjectId, u32>,
    /// Merged objects and what they were merged into.
    aliases: BTreeMap<ObjectId, ObjectId>,
    #[cfg_attr(feature = "serde", serde(skip))]
    visibility: VisibilityIndex,
    /// Visibility range of an object of unit size for which the index was built.
    indexed_range: f64,
    /// Ids that were given so far.
    given_ids: u64,
    /// How often input ids belong to objects, by slot.
    pub tally: IdTally,
}

impl Objects {
    /// None so far.
    pub(super) fn new(tally: IdTally) -> Self {
        Self { tally, ..Self::default() }
    }

    /// Number of objects.
    pub(super) fn len(&self) -> usize {
        self.slot_of_id.len()
    }

    /// A new id.
    pub(super) fn new_id(&mut self) -> ObjectId {
        self.given_ids += 1;
        ObjectId(self.given_ids)
    }

    /// All objects in the order of their ids.
    pub(super) fn tracked(&self) -> impl Iterator<Item = &Tracked> + '_ {
        self.slot_of_id.values().filter_map(|&slot| self.get(slot))
    }

    /// Their slots in the same order.
    pub(super) fn slots(&self) -> Vec<u32> {
        self.slot_of_id.values().copied().collect()
    }

    pub(super) fn get(&self, slot: u32) -> Option<&Tracked> {
        self.slots.get(slot as usize).and_then(Option::as_deref)
    }

    pub(super) fn get_mut(&mut self, slot: u32) -> Option<&mut Tracked> {
        self.slots.get_mut(slot as usize).and_then(Option::as_deref_mut)
    }

    /// The slot of an object.
    pub(super) fn slot_of(&self, id: ObjectId) -> Option<u32> {
        self.slot_of_id.get(&id).copied()
    }

    /// An object by its id.
    pub(super) fn by_id(&self, id: ObjectId) -> Option<&Tracked> {
        self.get(self.slot_of(id)?)
    }

    /// Whether there is an object with this id.
    pub(super) fn has(&self, id: ObjectId) -> bool {
        self.slot_of_id.contains_key(&id)
    }

    /// The object that an object was merged into, or the object itself.
    pub(super) fn resolve(&self, id: ObjectId) -> ObjectId {
        let mut id = id;
        while let Some(&older) = self.aliases.get(&id) {
            id = older;
        }
        id
    }

    /// Makes an id one of an older object.
    pub(super) fn add_alias(&mut self, alias: ObjectId, of: ObjectId) {
        self.aliases.insert(alias, of);
        if self.aliases.len() > MAX_ALIASES {
            self.aliases.pop_first();
        }
    }

    /// Puts an object into a free slot and returns the slot.
    pub(super) fn put(&mut self, tracked: Tracked) -> u32 {
        let slot = self.free.pop().unwrap_or_else(|| {
            self.slots.push(None);
            (self.slots.len() - 1) as u32
        });
        for &(input_id, count) in &tracked.input_ids {
            self.tally.count(input_id, slot, count);
        }
        self.slot_of_id.insert(tracked.id, slot);
        self.slots[slot as usize] = Some(Box::new(tracked));
        self.index(slot);
        slot
    }

    /// Takes an object out for good.
    pub(super) fn take(&mut self, slot: u32) -> Option<Tracked> {
        let tracked = self.borrow(slot)?;
        self.visibility.remove(slot);
        self.slot_of_id.remove(&tracked.id);
        self.free.push(slot);
        for &(id, _) in &tracked.input_ids {
            self.tally.forget(id, slot);
        }
        Some(*tracked)
    }

    /// Takes an object out of its slot, for [`Objects::give_back`].
    pub(super) fn borrow(&mut self, slot: u32) -> Option<Box<Tracked>> {
        self.slots.get_mut(slot as usize)?.take()
    }

    /// Puts an object into the slot that it was taken out of, or another one in its place.
    pub(super) fn give_back(&mut self, slot: u32, tracked: Box<Tracked>) {
        self.slots[slot as usize] = Some(tracked);
    }

    /// The slots of the objects that a camera may see, ascending.
    pub(super) fn near(&self, camera: &Vector3<f64>) -> Vec<u32> {
        self.visibility.near(camera)
    }

    /// Updates the place of an object in the visibility index.
    pub(super) fn index(&mut self, slot: u32) {
        let Some(tracked) = self.slots[slot as usize].as_ref() else { return };
        let range = RANGE_MARGIN * self.indexed_range * tracked.object.longest_semi_axis();
        self.visibility.put(slot, &tracked.object.center, range);
    }

    /// Rebuilds the visibility index if an object of unit size may be visible from farther away than it allows for.
    pub(super) fn set_range(&mut self, range: f64) {
        if range <= self.indexed_range && range > 0.25 * self.indexed_range {
            return;
        }
        self.indexed_range = 1.1 * range;
        for slot in 0..self.slots.len() as u32 {
            self.index(slot);
        }
    }

    /// All objects in the order of their slots, which is known before it is [rebuilt](Objects::rebuild).
    #[cfg(feature = "serde")]
    pub(super) fn all(&self) -> impl Iterator<Item = &Tracked> + '_ {
        self.slots.iter().flatten().map(AsRef::as_ref)
    }

    /// Whether what was stored can be used in a map with so many categories and sources of cues.
    #[cfg(feature = "serde")]
    pub(super) fn is_valid(&self, categories: usize, cue_sources: usize) -> bool {
        let is_valid = |tracked: &Tracked| tracked.id.0 <= self.given_ids && tracked.is_valid(categories, cue_sources);
        self.given_ids < super::running::MAX_COUNT
            && self.all().all(is_valid)
            // Aliases lead to older objects, so that following them ends.
            && self.aliases.iter().all(|(alias, id)| id < alias)
    }

    /// Computes what was not stored; `None` if an id is used twice or a slot is free and taken.
    #[cfg(feature = "serde")]
    pub(super) fn rebuild(&mut self) -> Option<()> {
        let mut free = self.free.clone();
        free.sort_unstable();
        (0..self.slots.len() as u32).filter(|&slot| self.get(slot).is_none()).eq(free).then_some(())?;
        for slot in 0..self.slots.len() as u32 {
            let Some(tracked) = self.get_mut(slot) else { continue };
            tracked.renumber();
            let id = tracked.id;
            self.slot_of_id.insert(id, slot).is_none().then_some(())?;
            self.index(slot);
        }
        Some(())
    }

    /// Panics if what follows from the slots does not.
    #[cfg(test)]
    pub(super) fn assert_sound(&self) {
        assert_eq!(self.free.len() + self.len(), self.slots.len());
        assert!(self.free.iter().all(|&slot| self.get(slot).is_none()));
        assert!(self.slot_of_id.iter().all(|(&id, &slot)| self.get(slot).is_some_and(|tracked| tracked.id == id)));
    }
}
