//! Assigns boxes to objects: in each frame, the pairs with the largest total log likelihood ratio.

use super::candidates::{Candidate, Candidates};
use crate::association::input::context::AssociationContext;
use crate::association::input::observations::Observations;
use crate::association::score::input_ids::IdTally;
use crate::association::score::log_likelihood_ratio::LogLikelihoodRatios;
use crate::association::score::object::{Object, is_visible};
use crate::association::score::scene_statistics::SceneStatistics;
use crate::optimize::matching::{Pair, best_pairs};
use crate::parallel::map_indices;

/// The assignment of an object.
#[derive(Debug, Clone, Default)]
pub(crate) struct Assignment {
    /// Indices of its boxes, ascending.
    pub boxes: Vec<u32>,
    /// Frames in which it should be visible.
    pub visible: usize,
}

/// Assigns the boxes; those with a trusted id stay with their object. Stores in the model which edges are hidden.
pub(crate) fn assign(
    context: &AssociationContext,
    observations: &Observations,
    statistics: &mut SceneStatistics,
    objects: &[Object],
) -> Vec<Assignment> {
    let current = owners(observations.boxes.len(), objects);
    let tally = if context.weighs_ids {
        IdTally::of(context.options.wrong_id_share, observations, objects)
    } else {
        IdTally::default()
    };
    let gains = LogLikelihoodRatios::new(observations, statistics);
    let candidates = map_indices(observations.cameras.len(), |frame| {
        let boxes = observations.cameras[frame].boxes.clone();
        let free = boxes.filter(|&i| !context.is_trusted(&observations.boxes[i])).map(|i| i as u32);
        Candidates::new(observations, statistics, &free.collect::<Vec<_>>())
    });
    let largest_bonus = tally.largest_bonus();
    let found = map_indices(objects.len(), |place| {
        let bonus = |index: u32| {
            tally.bonus(observations.boxes[index as usize].id, place as u32, current[index as usize], objects.len())
        };
        gaining(context, &gains, &objects[place], &candidates, bonus, largest_bonus)
    });
    let mut by_frame: Vec<Vec<(u32, Candidate)>> = Vec::new();
    by_frame.resize_with(observations.cameras.len(), Vec::new);
    let mut assignments = Vec::with_capacity(objects.len());
    for (place, (own, visible)) in found.into_iter().enumerate() {
        for candidate in own {
            by_frame[observations.boxes[candidate.index as usize].frame].push((place as u32, candidate));
        }
        assignments.push(Assignment { boxes: trusted_boxes(context, observations, &objects[place]), visible });
    }
    statistics.hidden.fill([false; 4]);
    for in_frame in by_frame {
        let pairs: Vec<Pair> =
            in_frame.iter().map(|(place, c)| Pair { row: *place, column: c.index, gain: c.gain.value }).collect();
        for k in best_pairs(&pairs) {
            let (place, candidate) = &in_frame[k];
            assignments[*place as usize].boxes.push(candidate.index);
            statistics.hidden[candidate.index as usize] = candidate.gain.hidden;
        }
    }
    for share in &mut assignments {
        share.boxes.sort_unstable();
    }
    assignments
}

/// For each box, the index of its object.
pub(crate) fn owners(boxes: usize, objects: &[Object]) -> Vec<Option<u32>> {
    let mut owners = vec![None; boxes];
    for (place, object) in objects.iter().enumerate() {
        for &index in &object.boxes {
            owners[index as usize] = Some(place as u32);
        }
    }
    owners
}

/// The number of frames in which an object should be visible.
pub(crate) fn count_visible(context: &AssociationContext, observations: &Observations, object: &Object) -> usize {
    let least = observations.least_half_size;
    let is_seen = |frame: &&u32| {
        let camera = &observations.cameras[**frame as usize];
        object.predict(camera).is_some_and(|prediction| is_visible(&prediction, camera, least))
    };
    context.frames_near(&object.center, object.longest_semi_axis(), least).iter().filter(is_seen).count()
}

/// The boxes that an object always keeps.
fn trusted_boxes(context: &AssociationContext, observations: &Observations, object: &Object) -> Vec<u32> {
    if object.trusted_id.is_none() {
        return Vec::new();
    }
    object.boxes.iter().copied().filter(|&i| context.is_trusted(&observations.boxes[i as usize])).collect()
}

/// Boxes with a positive gain for an object, and the number of frames in which it should be visible.
fn gaining(
    context: &AssociationContext,
    gains: &LogLikelihoodRatios,
    object: &Object,
    candidates: &[Candidates],
    bonus: impl Fn(u32) -> f64,
    largest_bonus: f64,
) -> (Vec<Candidate>, usize) {
    let observations = gains.observations;
    let taken: Vec<usize> =
        trusted_boxes(context, observations, object).iter().map(|&i| observations.boxes[i as usize].frame).collect();
    let (mut found, mut visible) = (Vec::new(), 0);
    let least = observations.least_half_size;
    for frame in context.frames_near(&object.center, object.longest_semi_axis(), least) {
        let frame = frame as usize;
        let camera = &observations.cameras[frame];
        let Some(prediction) = object.predict(camera) else { continue };
        visible += usize::from(is_visible(&prediction, camera, least));
        if taken.binary_search(&frame).is_ok() || !overlaps_image(&prediction.edges, &camera.size) {
            continue;
        }
        found.extend(candidates[frame].best(gains, object, (camera, &prediction), &bonus, largest_bonus));
    }
    (found, visible)
}

/// Whether a predicted box reaches into the image.
pub(crate) fn overlaps_image(edges: &[f64; 4], size: &nalgebra::Vector2<f64>) -> bool {
    edges[2] > 0.0 && edges[3] > 0.0 && edges[0] < size.x && edges[1] < size.y
}
