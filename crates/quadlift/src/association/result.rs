//! Results of association.

use std::collections::{HashMap, HashSet};

use super::implausible::doubts;
use super::input::context::AssociationContext;
use super::options::IdPolicy;
use super::score::evidence::evidence;
use super::score::object::Object;
use super::search::state::State;
use super::warning::AssociationWarning;
use crate::geometry::Ellipsoid;
use crate::scene::places::Places;
use crate::scene::{Scene, SkippedDetections};
use crate::sorting::StableSort;
use nalgebra::Point3;

/// How an association ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
#[non_exhaustive]
pub enum Outcome {
    /// There are objects.
    Found,
    /// No detection takes part.
    #[default]
    NoDetections,
    /// The detections are in fewer frames than an object needs views.
    TooFewFrames,
    /// No boxes of different frames agree on an object.
    NothingAgrees,
}

impl Outcome {
    /// The outcome as text.
    pub fn text(self) -> &'static str {
        match self {
            Self::Found => "objects were found",
            Self::NoDetections => "there are no detections to associate",
            Self::TooFewFrames => "the detections are in fewer frames than an object needs views",
            Self::NothingAgrees => "no detections of different frames agree on an object",
        }
    }
}

/// An object found by association.
#[derive(Debug, Clone, PartialEq)]
pub struct AssociatedObject {
    /// Its id: the most frequent id of its detections if no other object has it, otherwise a new one.
    pub id: String,
    /// Index into [`crate::scene::SceneParts::categories`]: the most frequent category of its detections.
    pub category_index: Option<u32>,
    /// Number of its detections, at most one per frame.
    pub views: usize,
    /// Number of frames in which it should be detected, if nothing hides it; at least `views`.
    pub expected_views: usize,
    /// Logarithm of how much better its detections are explained by it than by clutter (nats); absent for trusted ids
    /// whose detections no ellipsoid explains.
    pub evidence: Option<f64>,
    /// The quick fit of the association, in the world; the estimators give a better one.
    pub ellipsoid: Option<Ellipsoid>,
    /// Why it may not be one standing object.
    pub uncertain: Option<AssociationWarning>,
}

/// The result for a scene.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Association {
    /// How it ended.
    pub outcome: Outcome,
    /// For each detection of the scene, the index of its object in `objects`.
    pub object_of_detection: Vec<Option<u32>>,
    /// The objects, in the order of their first detections.
    pub objects: Vec<AssociatedObject>,
    /// Skipped detections.
    pub skipped: SkippedDetections,
    /// Unassigned detections.
    pub clutter: usize,
    /// Boxes from which it was made: those of one thing from one place are one.
    pub boxes: usize,
    /// Standard deviation of box edges relative to the mean half size of the box, as the objects show it.
    pub edge_noise: f64,
    /// The size-independent part of the standard deviation of box edges, pixels: given or selected.
    pub edge_noise_px: f64,
    /// Standard deviation of the shifts of whole frames due to pose errors, pixels.
    pub frame_shift_sd: f64,
}

impl Association {
    /// The scene with the object ids of this association; unassigned detections have none.
    ///
    /// Detections of other sources keep their ids. Detections that were skipped for their score or as duplicates have
    /// none.
    pub fn applied_to(&self, scene: &Scene, source: Option<u32>) -> Scene {
        let mut result = scene.clone().into_parts();
        result.object_ids = self.objects.iter().map(|o| o.id.clone()).collect();
        let mut by_id: HashMap<String, u32> =
            result.object_ids.iter().enumerate().map(|(index, id)| (id.clone(), index as u32)).collect();
        for (index, detection) in result.detections.iter_mut().enumerate() {
            let is_other = source.is_some() && detection.source_index != source;
            detection.object_index = match detection.object_index {
                Some(old) if is_other => {
                    let id = &scene.object_ids[old as usize];
                    let next = result.object_ids.len() as u32;
                    Some(*by_id.entry(id.clone()).or_insert_with(|| {
                        result.object_ids.push(id.clone());
                        next
                    }))
                }
                _ => self.object_of_detection.get(index).copied().flatten(),
            };
        }
        Scene(result)
    }

    /// That of so many given detections of a scene, from that of its places.
    pub(crate) fn spread(mut self, places: &Places, scene: &Scene, detections: usize) -> Self {
        let mut object_of_detection = vec![None; scene.detections.len()];
        let mut assigned = 0;
        for (copies, object) in places.copies.iter().zip(&self.object_of_detection) {
            let Some(object) = *object else { continue };
            assigned += copies.len();
            let known = &mut self.objects[object as usize];
            known.views += copies.len() - 1;
            known.expected_views += copies.len() - 1;
            for &copy in copies {
                object_of_detection[copy] = Some(object);
            }
        }
        Self { object_of_detection, clutter: detections - assigned, ..self }
    }
}

/// An object with its detections.
struct Found<'a> {
    /// Indices into the scene, ascending.
    members: Vec<usize>,
    object: Option<&'a Object>,
    doubt: Option<AssociationWarning>,
    trusted_id: Option<u32>,
}

/// Collects the result of a search.
pub(crate) fn collect(scene: &Scene, detections: &[usize], context: &AssociationContext, state: &State) -> Association {
    let observations = &state.observations;
    let mut found: Vec<Found> = Vec::new();
    for (object, doubt) in state.objects.iter().zip(doubts(context, state)) {
        let mut members: Vec<usize> = object.boxes.iter().map(|&i| observations.boxes[i as usize].detection).collect();
        members.sort_unstable();
        found.push(Found { members, object: Some(object), doubt, trusted_id: object.trusted_id });
    }
    if context.options.ids == IdPolicy::Trust {
        // Ids whose boxes no ellipsoid explains stay all the same.
        let explained: HashSet<u32> = state.objects.iter().filter_map(|o| o.trusted_id).collect();
        let mut others: HashMap<u32, Vec<usize>> = HashMap::new();
        for &index in detections {
            if let Some(id) = scene.detections[index].object_index.filter(|id| !explained.contains(id)) {
                others.entry(id).or_default().push(index);
            }
        }
        let named = |(id, members)| Found { members, object: None, doubt: None, trusted_id: Some(id) };
        found.extend(others.into_iter().map(named));
    }
    found.stable_sort_by(|a, b| a.members.first().cmp(&b.members.first()));
    let mut association = Association {
        object_of_detection: vec![None; scene.detections.len()],
        edge_noise: state.statistics.edge_noise,
        edge_noise_px: state.statistics.edge_noise_px,
        frame_shift_sd: state.statistics.shift_sd,
        clutter: detections.len().saturating_sub(found.iter().map(|f| f.members.len()).sum()),
        boxes: detections.len(),
        ..Default::default()
    };
    let names = names(scene, &found, context.options.ids);
    for (index, (Found { members, object, doubt, .. }, id)) in found.into_iter().zip(names).enumerate() {
        for &member in &members {
            association.object_of_detection[member] = Some(index as u32);
        }
        let category_index = match object {
            Some(object) => observations.categories[object.category],
            None => members.first().and_then(|&m| scene.detections[m].category_index),
        };
        let ellipsoid = object.and_then(|o| {
            Ellipsoid::from_shape(Point3::from(o.center + observations.origin), &(o.root * o.root.transpose())).ok()
        });
        association.objects.push(AssociatedObject {
            id,
            category_index,
            views: members.len(),
            expected_views: object.map_or(0, |o| o.visible).max(members.len()),
            evidence: object.map(|o| evidence(&context.rate, observations, &state.statistics, o)),
            ellipsoid,
            uncertain: doubt,
        });
    }
    association.outcome = if association.objects.is_empty() { Outcome::NothingAgrees } else { Outcome::Found };
    association
}

/// Ids of the objects: the most frequent id of an object's detections (for the object with most of them), or a new one
/// that is not used in the scene.
fn names(scene: &Scene, found: &[Found], ids: IdPolicy) -> Vec<String> {
    let mut claims: Vec<(usize, u32, usize)> = Vec::new();
    for (object, Found { members, trusted_id, .. }) in found.iter().enumerate() {
        if let Some(id) = *trusted_id {
            claims.push((usize::MAX, id, object));
        } else if ids == IdPolicy::Evidence {
            let mut counts: HashMap<u32, usize> = HashMap::new();
            for id in members.iter().filter_map(|&m| scene.detections[m].object_index) {
                *counts.entry(id).or_default() += 1;
            }
            let most = counts.into_iter().max_by_key(|&(id, count)| (count, std::cmp::Reverse(id)));
            claims.extend(most.map(|(id, count)| (count, id, object)));
        }
    }
    claims.stable_sort_by_key(|&(count, id, object)| (std::cmp::Reverse(count), object, id));
    let mut names: Vec<Option<String>> = vec![None; found.len()];
    let mut given = HashSet::new();
    for (_, id, object) in claims {
        if given.insert(id) {
            names[object] = Some(scene.object_ids[id as usize].clone());
        }
    }
    let taken: HashSet<&str> = scene.object_ids.iter().map(String::as_str).collect();
    let mut next = 0;
    let mut new_name = || loop {
        let name = format!("object_{next:04}");
        next += 1;
        if !taken.contains(name.as_str()) {
            return name;
        }
    };
    names.into_iter().map(|name| name.unwrap_or_else(&mut new_name)).collect()
}
