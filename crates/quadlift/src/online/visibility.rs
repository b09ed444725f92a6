//! Which objects a camera may see: those near enough to be as large in its image as detections are.

use std::collections::{BTreeMap, HashMap};

use nalgebra::Vector3;

/// A grid for each power of two of the range of visibility, so that a camera asks 27 cells of each.
#[derive(Debug, Clone, Default)]
pub(super) struct VisibilityIndex {
    levels: BTreeMap<i32, HashMap<[i64; 3], Vec<u32>>>,
    /// Where each slot is.
    places: Vec<Option<(i32, [i64; 3])>>,
}

/// Exponents of the smallest and largest range, powers of two.
const LEVELS: [f64; 2] = [-60.0, 60.0];

fn cell_at(point: &Vector3<f64>, level: i32) -> [i64; 3] {
    let size = f64::from(level).exp2();
    // Casts saturate.
    [0, 1, 2].map(|i| (point[i] / size).floor() as i64)
}

impl VisibilityIndex {
    /// Puts a slot where cameras within `range` of `center` find it.
    pub(super) fn put(&mut self, slot: u32, center: &Vector3<f64>, range: f64) {
        let level = range.log2().clamp(LEVELS[0], LEVELS[1]).ceil() as i32;
        let place = (level, cell_at(center, level));
        if self.places.len() <= slot as usize {
            self.places.resize(slot as usize + 1, None);
        }
        if self.places[slot as usize] == Some(place) {
            return;
        }
        self.remove(slot);
        self.levels.entry(level).or_default().entry(place.1).or_default().push(slot);
        self.places[slot as usize] = Some(place);
    }

    /// Takes a slot out.
    pub(super) fn remove(&mut self, slot: u32) {
        let Some((level, cell)) = self.places.get_mut(slot as usize).and_then(Option::take) else { return };
        let Some(cells) = self.levels.get_mut(&level) else { return };
        if let Some(slots) = cells.get_mut(&cell) {
            slots.retain(|&other| other != slot);
            if slots.is_empty() {
                cells.remove(&cell);
            }
        }
        if cells.is_empty() {
            self.levels.remove(&level);
        }
    }

    /// The slots that a camera may see, ascending; some of them are farther away than their range.
    pub(super) fn near(&self, camera: &Vector3<f64>) -> Vec<u32> {
        let mut found = Vec::new();
        for (&level, cells) in &self.levels {
            let [x, y, z] = cell_at(camera, level);
            for dx in -1..=1 {
                for dy in -1..=1 {
                    for dz in -1..=1 {
                        let cell = [x.saturating_add(dx), y.saturating_add(dy), z.saturating_add(dz)];
                        if let Some(slots) = cells.get(&cell) {
                            found.extend(slots);
                        }
                    }
                }
            }
        }
        found.sort_unstable();
        found.dedup();
        found
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn every_slot_within_its_range_is_found(
            places in prop::collection::vec((prop::array::uniform3(-50.0..50.0f64), 0.01..40.0f64), 1..40),
            camera in prop::array::uniform3(-50.0..50.0f64),
        ) {
            let mut index = VisibilityIndex::default();
            for (slot, (center, range)) in places.iter().enumerate() {
                // Moved once, as objects are.
                index.put(slot as u32, &Vector3::new(-center[0], 2.0, center[1]), 3.0 * range);
                index.put(slot as u32, &Vector3::from(*center), *range);
            }
            index.remove(0);
            let near = index.near(&Vector3::from(camera));
            for (slot, (center, range)) in places.iter().enumerate() {
                let within = (Vector3::from(*center) - Vector3::from(camera)).norm() <= *range;
                prop_assert!(slot == 0 || !within || near.contains(&(slot as u32)));
            }
            prop_assert!(!near.contains(&0));
        }
    }
}
