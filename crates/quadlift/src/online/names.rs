//! Names of categories and input ids, as numbers.

use std::collections::{BTreeMap, HashMap};

/// Maximum number of input ids that are remembered.
const MAX_INPUT_IDS: usize = 20_000;

/// Numbers of input ids.
#[derive(Debug, Clone, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub(super) struct InputIds {
    /// The number of each id, and the key of the last frame that has it.
    by_name: BTreeMap<String, (u32, u32)>,
    next: u32,
}

impl InputIds {
    /// Whether any detection had an id.
    pub(super) fn is_used(&self) -> bool {
        self.next > 0
    }

    /// The number of an id in a frame.
    pub(super) fn number(&mut self, name: &str, key: u32) -> u32 {
        if let Some((number, last)) = self.by_name.get_mut(name) {
            *last = key;
            return *number;
        }
        let number = self.next;
        self.next = self.next.saturating_add(1);
        self.by_name.insert(name.to_owned(), (number, key));
        number
    }

    /// If there are too many, forgets the half that was seen least recently and returns its numbers.
    pub(super) fn forget_old(&mut self) -> Vec<u32> {
        if self.by_name.len() <= MAX_INPUT_IDS {
            return Vec::new();
        }
        let mut ages: Vec<(u32, u32)> = self.by_name.values().map(|&(number, last)| (last, number)).collect();
        ages.sort_unstable();
        let limit = ages[ages.len() / 2];
        let mut forgotten = Vec::new();
        self.by_name.retain(|_, &mut (number, last)| {
            let stays = (last, number) >= limit;
            if !stays {
                forgotten.push(number);
            }
            stays
        });
        forgotten
    }
}

/// The categories of a map; detections without one have a category of their own.
#[derive(Debug, Clone, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(from = "Vec<Option<String>>", into = "Vec<Option<String>>"))]
pub(super) struct Categories {
    names: Vec<Option<String>>,
    by_name: HashMap<String, u16>,
    none: Option<u16>,
}

impl From<Vec<Option<String>>> for Categories {
    /// Categories in the order of their numbers.
    fn from(names: Vec<Option<String>>) -> Self {
        let mut categories = Self::default();
        for name in names {
            categories.add(name.as_deref());
        }
        categories
    }
}

impl From<Categories> for Vec<Option<String>> {
    fn from(categories: Categories) -> Self {
        categories.names
    }
}

impl Categories {
    pub(super) fn names(&self) -> &[Option<String>] {
        &self.names
    }

    /// The number of a known category.
    pub(super) fn find(&self, name: Option<&str>) -> Option<u16> {
        name.map_or(self.none, |name| self.by_name.get(name).copied())
    }

    /// Adds a category; the caller ensures that there are at most [`super::MAX_CATEGORIES`].
    pub(super) fn add(&mut self, name: Option<&str>) -> u16 {
        let index = self.names.len() as u16;
        match name {
            Some(name) => {
                self.by_name.insert(name.to_owned(), index);
            }
            None => self.none = Some(index),
        }
        self.names.push(name.map(str::to_owned));
        index
    }
}
