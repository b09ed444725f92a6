//! Input ids as evidence.

use std::collections::BTreeMap;

use super::object::Object;
use crate::association::input::observations::Observations;

/// Maximum number of other objects to which a wrong id may belong.
const MAX_RIVALS: f64 = 20.0;

/// How often each id sits in each object.
#[derive(Debug, Clone, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub(crate) struct IdTally {
    wrong_share: f64,
    by_id: BTreeMap<u32, Vec<(u32, u32)>>,
}

impl IdTally {
    /// An empty tally for ids with this error probability.
    pub(crate) fn new(wrong_share: f64) -> Self {
        Self { wrong_share, by_id: BTreeMap::new() }
    }

    /// The tally of all objects, numbered by their places.
    pub(crate) fn of(wrong_share: f64, observations: &Observations, objects: &[Object]) -> Self {
        let mut tally = Self::new(wrong_share);
        for (place, object) in objects.iter().enumerate() {
            tally.add(observations, place as u32, &object.boxes);
        }
        tally
    }

    /// Counts boxes of an object.
    pub(crate) fn add(&mut self, observations: &Observations, object: u32, boxes: &[u32]) {
        for id in boxes.iter().filter_map(|&b| observations.boxes[b as usize].id) {
            self.count(id, object, 1);
        }
    }

    /// Counts an id in an object, so many times.
    pub(crate) fn count(&mut self, id: u32, object: u32, times: u32) {
        let counts = self.by_id.entry(id).or_default();
        match counts.iter_mut().find(|(o, _)| *o == object) {
            Some((_, count)) => *count += times,
            None => counts.push((object, times)),
        }
    }

    /// Counts an id in an object once less.
    pub(crate) fn uncount(&mut self, id: u32, object: u32) {
        if let Some(counts) = self.by_id.get_mut(&id)
            && let Some((_, count)) = counts.iter_mut().find(|(o, _)| *o == object)
        {
            *count = count.saturating_sub(1);
        }
    }

    /// Forgets an id in an object; returns how often it was counted.
    pub(crate) fn forget(&mut self, id: u32, object: u32) -> u32 {
        let Some(counts) = self.by_id.get_mut(&id) else { return 0 };
        let count = counts.iter().find(|(o, _)| *o == object).map_or(0, |&(_, count)| count);
        counts.retain(|(o, _)| *o != object);
        if counts.is_empty() {
            self.by_id.remove(&id);
        }
        count
    }

    /// Forgets the boxes of an object.
    pub(crate) fn remove(&mut self, observations: &Observations, object: u32, boxes: &[u32]) {
        for id in boxes.iter().filter_map(|&b| observations.boxes[b as usize].id) {
            self.forget(id, object);
        }
    }

    /// Forgets an id in all objects.
    pub(crate) fn forget_id(&mut self, id: u32) {
        self.by_id.remove(&id);
    }

    /// The contribution of the id of a box to its gain for an object, if the box now belongs to `current`: the log
    /// probability of meeting this id in this object, relative to a box without an id.
    pub(crate) fn bonus(&self, id: Option<u32>, object: u32, current: Option<u32>, objects: usize) -> f64 {
        let Some(counts) = id.and_then(|id| self.by_id.get(&id)) else { return 0.0 };
        // The box itself is excluded.
        let others = |o: u32, count: u32| count - u32::from(current == Some(o)).min(count);
        let total: u32 = counts.iter().map(|&(o, count)| others(o, count)).sum();
        if total == 0 {
            return 0.0;
        }
        let here = counts.iter().find(|(o, _)| *o == object).map_or(0, |&(o, count)| others(o, count));
        let share = f64::from(here) / f64::from(total);
        ((1.0 - self.wrong_share) * share * (objects as f64).min(MAX_RIVALS) + self.wrong_share).ln()
    }

    /// Upper bound of [`Self::bonus`].
    pub(crate) fn largest_bonus(&self) -> f64 {
        if self.by_id.is_empty() { 0.0 } else { MAX_RIVALS.ln() }
    }

    /// The contribution of two ids to the score of a pair of boxes as a new object.
    pub(crate) fn pair_bonus(&self, a: Option<u32>, b: Option<u32>) -> f64 {
        match (a, b) {
            (Some(a), Some(b)) if a == b => MAX_RIVALS.ln(),
            (Some(_), Some(_)) => self.wrong_share.ln(),
            _ => 0.0,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_id_draws_to_where_its_others_are() {
        let mut tally = IdTally::new(0.05);
        tally.by_id.insert(7, vec![(0, 3), (1, 1)]);
        // Without looking at the box itself, which now is in object 0: 2 of 3 others are in object 0.
        let expected = (0.95f64 * 2.0 / 3.0 * 10.0 + 0.05).ln();
        assert!((tally.bonus(Some(7), 0, Some(0), 10) - expected).abs() < 1e-12);
        assert!((tally.bonus(Some(7), 2, None, 10) - 0.05f64.ln()).abs() < 1e-12);
        assert_eq!((tally.bonus(None, 0, None, 10), tally.bonus(Some(8), 0, None, 10)), (0.0, 0.0));
        // The only box of its id says nothing.
        tally.by_id.insert(9, vec![(1, 1)]);
        assert_eq!(tally.bonus(Some(9), 1, Some(1), 10), 0.0);
        assert!(tally.pair_bonus(Some(1), Some(1)) > 2.9 && tally.pair_bonus(Some(1), Some(2)) < -2.9);
        assert_eq!(tally.pair_bonus(Some(1), None), 0.0);
    }
}
