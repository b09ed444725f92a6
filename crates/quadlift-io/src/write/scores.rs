//! Scores of objects, from their detections or an object map.

use std::collections::HashMap;

use super::CheckedScene;
use crate::wording::count;

/// Scores of objects.
pub(super) struct Scores<'a> {
    of_object: HashMap<&'a str, f64>,
    of_view: HashMap<(&'a str, &'a str), f64>,
}

impl<'a> Scores<'a> {
    /// The probability that an object of an object map exists; otherwise the mean score of its detections.
    pub(super) fn of(scene: &CheckedScene<'a>, notes: &mut Vec<String>) -> Self {
        let scores = Self::known(scene);
        let without = scene.objects.iter().filter(|object| scores.known_score(&object.id).is_none()).count();
        if without > 0 {
            notes.push(format!("{} without detections with scores in this file: score 1", count(without, "object")));
        }
        scores
    }

    /// The same without a note about objects that have none.
    pub(super) fn known(scene: &CheckedScene<'a>) -> Self {
        let (mut sums, mut of_view): (HashMap<&str, (f64, f64)>, HashMap<_, _>) = Default::default();
        for detection in &scene.file.detections {
            if let (Some(object), Some(score)) = (detection.object.as_deref(), detection.score) {
                let (sum, n) = sums.entry(object).or_default();
                (*sum, *n) = (*sum + score, *n + 1.0);
                of_view.insert((&*detection.frame, object), score);
            }
        }
        let mut of_object: HashMap<&str, f64> = sums.into_iter().map(|(id, (sum, n))| (id, sum / n)).collect();
        for object in &scene.file.objects {
            let existence = object.memory().and_then(|memory| memory.existence);
            of_object.extend(existence.map(|existence| (object.id.as_str(), existence)));
        }
        Self { of_object, of_view }
    }

    /// The score of an object, if it is known.
    pub(super) fn known_score(&self, object: &str) -> Option<f64> {
        self.of_object.get(object).copied()
    }

    /// The score of an object in a frame, or of the object; 1 if it is not known.
    pub(super) fn get(&self, object: &str, frame: Option<&str>) -> f64 {
        let of_view = frame.and_then(|frame| self.of_view.get(&(frame, object)));
        *of_view.or(self.of_object.get(object)).unwrap_or(&1.0)
    }
}
