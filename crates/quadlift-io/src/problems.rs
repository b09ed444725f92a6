//! Problems with single detections: each message is reported once, and the other detections are processed.

use std::collections::HashMap;

use quadlift::scene::Scene;

use crate::wording::some_of;

/// Something that went wrong, and the detections that it befell.
#[derive(Debug, Clone)]
pub struct Problem {
    /// File, entry, what was found and what was expected.
    pub message: String,
    /// Indices of the detections.
    pub detections: Vec<usize>,
}

impl Problem {
    /// The problem in one line, with the detections and their objects.
    pub(crate) fn in_words(&self, scene: &Scene) -> String {
        let name = |&index: &usize| match scene.detections[index].object_index {
            Some(object) => format!("detections[{index}] ({})", scene.object_ids[object as usize]),
            None => format!("detections[{index}]"),
        };
        let names: Vec<String> = self.detections.iter().map(name).collect();
        format!("{}; affects {}", self.message, some_of(&names))
    }
}

/// Problems in the order in which they were met; detections with the same message share one.
#[derive(Debug, Clone, Default)]
pub struct Problems {
    list: Vec<Problem>,
    /// The index of each problem, by its message.
    by_message: HashMap<String, usize>,
}

impl Problems {
    /// Adds detections to the problem with a message; returns its index.
    pub(crate) fn add(&mut self, message: String, detections: &[usize]) -> usize {
        let index = *self.by_message.entry(message.clone()).or_insert_with(|| {
            self.list.push(Problem { message, detections: Vec::new() });
            self.list.len() - 1
        });
        self.list[index].detections.extend(detections);
        index
    }

    /// All of them.
    pub(crate) fn list(&self) -> &[Problem] {
        &self.list
    }

    /// Each in one line.
    pub fn in_words(&self, scene: &Scene) -> Vec<String> {
        self.list.iter().map(|problem| problem.in_words(scene)).collect()
    }
}
