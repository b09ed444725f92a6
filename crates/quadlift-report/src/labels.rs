//! The labels of objects in texts and pictures: "cup 3" for `object_0003`, as pages show them.

use std::collections::HashMap;

use quadlift::Localization;
use quadlift::scene::Scene;
use quadlift::solve::Estimate;
use quadlift_io::SceneFile;

/// The labels of some objects by their ids. An object has its category and its number where its id has one, else its id.
#[derive(Debug, Default)]
pub struct Labels(HashMap<String, String>);

impl Labels {
    /// Of objects with these ids and categories. Two objects never have one label.
    pub fn new<'a>(objects: impl IntoIterator<Item = (&'a str, Option<&'a str>)>) -> Self {
        let wished: Vec<(&str, String)> = objects.into_iter().map(|(id, category)| (id, label(id, category))).collect();
        let mut times: HashMap<&str, usize> = HashMap::new();
        wished.iter().for_each(|(_, label)| *times.entry(label).or_default() += 1);
        let label = |(id, label): &(&str, String)| {
            let is_unique = times.get(&**label) == Some(&1);
            ((*id).to_owned(), if is_unique { label.clone() } else { (*id).to_owned() })
        };
        Self(wished.iter().map(label).collect())
    }

    /// Of the objects of a file.
    pub fn of_file(file: &SceneFile) -> Self {
        Self::new(file.objects.iter().map(|object| (&*object.id, object.category.as_deref())))
    }

    /// Of the estimated objects of a scene.
    pub fn of_estimates(scene: &Scene, localization: &Localization) -> Self {
        let category = |estimate: &Estimate| estimate.category_index.map(|index| scene.categories[index].as_str());
        let id = |estimate: &Estimate| scene.object_ids[estimate.object_index].as_str();
        Self::new(localization.estimates.iter().map(|estimate| (id(estimate), category(estimate))))
    }

    /// Of the objects in the detections of a scene, each with the category that most of its detections have.
    pub fn of_scene(scene: &Scene) -> Self {
        let mut counts: Vec<HashMap<u32, usize>> = vec![HashMap::new(); scene.object_ids.len()];
        for detection in &scene.detections {
            if let (Some(object), Some(category)) = (detection.object_index, detection.category_index) {
                *counts[object as usize].entry(category).or_default() += 1;
            }
        }
        // Of equally many the first.
        let most = |counts: &HashMap<u32, usize>| {
            let best = counts.iter().max_by_key(|(category, count)| (**count, std::cmp::Reverse(**category)));
            best.map(|(category, _)| scene.categories[*category as usize].as_str())
        };
        Self::new(scene.object_ids.iter().map(String::as_str).zip(counts.iter().map(most)))
    }

    /// The label of an object.
    pub fn of<'a>(&'a self, id: &'a str) -> &'a str {
        self.0.get(id).map_or(id, String::as_str)
    }

    /// The labels of several objects.
    pub fn of_all<'a>(&'a self, ids: &'a [String]) -> Vec<&'a str> {
        ids.iter().map(|id| self.of(id)).collect()
    }

    /// The category in a column beside the label; empty where the label has it.
    pub fn category<'a>(&self, id: &str, category: Option<&'a str>) -> &'a str {
        category.filter(|category| !self.of(id).starts_with(&format!("{category} "))).unwrap_or_default()
    }
}

/// The label of one object: its category and its number where its id has one (`object_0003`, `cup_3`, `3`), else its id.
pub fn label(id: &str, category: Option<&str>) -> String {
    let before = id.trim_end_matches(|c: char| c.is_ascii_digit());
    let number = &id[before.len()..];
    let kind = before.strip_suffix([' ', '_', '-']).unwrap_or(before);
    match category {
        Some(category) if !number.is_empty() && ["", "object", category].contains(&kind) => {
            let number = number.trim_start_matches('0');
            format!("{category} {}", if number.is_empty() { "0" } else { number })
        }
        _ => id.to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn objects_with_numbers_are_called_by_their_category() {
        for (id, expected) in [
            ("object_0003", "cup 3"),
            ("object_0000", "cup 0"),
            ("cup-12", "cup 12"),
            ("7", "cup 7"),
            ("cup7", "cup 7"),
        ] {
            assert_eq!(label(id, Some("cup")), expected);
            assert_eq!(label(id, None), id);
        }
        for id in ["red cup", "can_3", "object_", "object_3b"] {
            assert_eq!(label(id, Some("cup")), id);
        }
    }

    #[test]
    fn two_objects_never_have_one_label() {
        let labels = Labels::new([("object_1", Some("cup")), ("cup_01", Some("cup")), ("object_2", Some("cup"))]);
        assert_eq!(
            ["object_1", "cup_01", "object_2", "other"].map(|id| labels.of(id)),
            ["object_1", "cup_01", "cup 2", "other"]
        );
        assert_eq!(labels.category("object_1", Some("cup")), "cup");
        assert_eq!(labels.category("object_2", Some("cup")), "");
    }
}
