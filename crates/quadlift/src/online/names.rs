//! Names of categories and input ids, as numbers.

use std::collections::BTreeMap;

use super::map::ObjectMap;
use crate::association::IdUse;
use crate::association::input::context::given_size;
use crate::association::score::input_ids::IdTally;

/// Input ids that are remembered, at most.
const MAX_INPUT_IDS: usize = 20_000;

/// Numbers of the ids that detections come with.
#[derive(Debug, Clone, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub(super) struct InputIds {
    /// The number of each id, and the key of the last frame that has it.
    by_name: BTreeMap<String, (u32, u32)>,
    pub next: u32,
}

impl ObjectMap {
    /// The number of a category.
    pub(super) fn category_index(&mut self, name: Option<&str>) -> u16 {
        let known = match name {
            Some(name) => self.category_of_name.get(name).copied(),
            None => self.no_category,
        };
        if let Some(known) = known {
            return known;
        }
        let index = self.categories.len() as u16;
        match name {
            Some(name) => {
                self.category_of_name.insert(name.to_owned(), index);
            }
            None => self.no_category = Some(index),
        }
        let size = name.and_then(|name| given_size(&self.options.priors, name));
        self.categories.push(name.map(str::to_owned));
        self.running.add_category(size);
        index
    }

    /// The number of an input id, where ids are used.
    pub(super) fn input_id_number(&mut self, name: &str, key: u32) -> Option<u32> {
        if self.options.ids == IdUse::Ignore {
            return None;
        }
        if let Some((number, last)) = self.input_ids.by_name.get_mut(name) {
            *last = key;
            return Some(*number);
        }
        let number = self.input_ids.next;
        self.input_ids.next += 1;
        self.input_ids.by_name.insert(name.to_owned(), (number, key));
        if self.input_ids.by_name.len() > MAX_INPUT_IDS {
            self.forget_old_ids();
        }
        Some(number)
    }

    /// Forgets the half of the input ids that has not been seen for longest.
    fn forget_old_ids(&mut self) {
        let mut ages: Vec<(u32, u32)> = self.input_ids.by_name.values().map(|&(number, last)| (last, number)).collect();
        ages.sort_unstable();
        let limit = ages[ages.len() / 2];
        let tally = &mut self.tally;
        self.input_ids.by_name.retain(|_, &mut (number, last)| {
            let stays = (last, number) >= limit;
            if !stays {
                tally.forget_id(number);
            }
            stays
        });
    }

    pub(super) fn forget_ids(tally: &mut IdTally, slot: u32, ids: &[(u32, u32)]) {
        for &(id, _) in ids {
            tally.forget(id, slot);
        }
    }
}
