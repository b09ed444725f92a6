//! Removes weak objects with their neighbours and searches again; the result with more evidence is kept.

use crate::tuning::SUSPECT_SHARE;
use std::ops::ControlFlow;

use super::assignment::assign;
use super::growth::grow;
use super::state::{State, born, refit};
use crate::association::input::context::AssociationContext;
use crate::association::input::point_tree::PointTree;
use crate::association::score::evidence::{MIN_EVIDENCE, evidence};
use crate::association::score::object::Object;

/// Maximum number of objects that are released together.
const MAX_RESEEDED: usize = 3;

/// Neighbours are nearer than this many times the sum of the radii.
const NEAR: f64 = 1.2;

/// Minimum gain in evidence of the new objects over the old ones.
const MIN_IMPROVEMENT: f64 = 1.0;

/// Rounds until the new objects converge.
const ROUNDS: usize = 3;

/// Releases the boxes of the weakest objects, one after the other, searches again, and keeps the better result.
pub(crate) fn reseed_weak(context: &AssociationContext, state: &mut State) {
    let per_view =
        |o: &Object| evidence(&context.rate, &state.observations, &state.statistics, o) / o.boxes.len() as f64;
    let mut ranked: Vec<(f64, u32)> =
        state.objects.iter().filter(|o| o.trusted_id.is_none()).map(|o| (per_view(o), o.boxes[0])).collect();
    ranked.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    ranked.truncate((SUSPECT_SHARE.get() * ranked.len() as f64).ceil() as usize);
    for (_, first_box) in ranked {
        // By a box of theirs, because the list of objects changes.
        let suspect = state.objects.iter().position(|o| o.trusted_id.is_none() && o.boxes.contains(&first_box));
        if let Some(suspect) = suspect {
            reseed(context, state, suspect);
        }
    }
}

/// Dissolves one object with its neighbours.
fn reseed(context: &AssociationContext, state: &mut State, suspect: usize) {
    let group = neighbours(&state.objects, suspect);
    let mut freed = vec![false; state.observations.boxes.len()];
    let mut used = freed.clone();
    for (place, object) in state.objects.iter().enumerate() {
        let marks = if group.contains(&place) { &mut freed } else { &mut used };
        for &index in &object.boxes {
            marks[index as usize] = true;
        }
    }
    let own_evidence = |state: &State, objects: &[Object]| -> f64 {
        objects.iter().map(|o| evidence(&context.rate, &state.observations, &state.statistics, o).max(0.0)).sum()
    };
    let old: Vec<Object> = group.iter().map(|&place| state.objects[place].clone()).collect();
    let old_evidence = own_evidence(state, &old);
    let hidden = state.statistics.hidden.clone();
    let reborn = born(context, &state.observations, &state.statistics, &used, &|i| freed[i]);
    let mut best: Option<(f64, Vec<Object>, Vec<[bool; 4]>)> = None;
    let regrown = regrow(context, state, &used, &freed);
    for start in [reborn, regrown] {
        let objects = settle(context, state, start, &used);
        let total = own_evidence(state, &objects);
        if !objects.is_empty() && best.as_ref().is_none_or(|(most, ..)| total > *most) {
            best = Some((total, objects, state.statistics.hidden.clone()));
        }
        state.statistics.hidden.clone_from(&hidden);
    }
    if let Some((total, objects, new_hidden)) = best
        && total > old_evidence + MIN_IMPROVEMENT
    {
        let mut place = 0;
        state.objects.retain(|_| {
            place += 1;
            !group.contains(&(place - 1))
        });
        state.objects.extend(objects);
        for (index, value) in new_hidden.into_iter().enumerate() {
            if !used[index] {
                state.statistics.hidden[index] = value;
            }
        }
    }
}

/// The object and its nearest neighbours of the same category.
fn neighbours(objects: &[Object], suspect: usize) -> Vec<usize> {
    let own = &objects[suspect];
    let largest = objects.iter().map(|o| o.radius).fold(0.0, f64::max);
    let tree = PointTree::new(objects.iter().map(|o| o.center).collect());
    let apart = |place: usize| (objects[place].center - own.center).norm() / (objects[place].radius + own.radius);
    let mut near: Vec<usize> = tree
        .within(&own.center, NEAR * (own.radius + largest))
        .into_iter()
        .map(|place| place as usize)
        .filter(|&p| objects[p].category == own.category && objects[p].trusted_id.is_none() && apart(p) < NEAR)
        .collect();
    near.sort_by(|&a, &b| apart(a).total_cmp(&apart(b)).then(a.cmp(&b)));
    near.truncate(MAX_RESEEDED);
    if !near.contains(&suspect) {
        // Several bodies at the very same place.
        near.truncate(MAX_RESEEDED - 1);
        near.push(suspect);
    }
    near
}

/// Grows objects from the unused boxes; those that use a released box are kept.
fn regrow(context: &AssociationContext, state: &mut State, used: &[bool], freed: &[bool]) -> Vec<Object> {
    let observations = &state.observations;
    let is_free = |i: usize| !used[i] && !context.is_trusted(&observations.boxes[i]);
    let order: Vec<u32> = context
        .order
        .frames
        .iter()
        .copied()
        .filter(|&frame| observations.cameras[frame as usize].boxes.clone().any(is_free))
        .collect();
    let mut grown =
        grow(context, observations, &mut state.statistics, &order, &is_free, Vec::new(), &|| ControlFlow::Continue(()));
    grown.retain(|object| object.boxes.iter().any(|&index| freed[index as usize]));
    grown
}

/// Refines objects on the boxes that others do not use.
fn settle(context: &AssociationContext, state: &mut State, mut objects: Vec<Object>, used: &[bool]) -> Vec<Object> {
    let is_free = |i: usize| !used[i];
    for round in 0..ROUNDS {
        if objects.is_empty() {
            break;
        }
        let assignments = assign(context, &state.observations, &mut state.statistics, &objects, &is_free);
        objects = refit(context, &state.observations, &state.statistics, &objects, &assignments, false);
        if round + 1 == ROUNDS {
            objects.retain(|o| evidence(&context.rate, &state.observations, &state.statistics, o) > MIN_EVIDENCE);
        }
    }
    objects
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;

    use super::*;
    use crate::association::options::AssociateOptions;
    use crate::association::score::fit::{Start, fit};
    use crate::association::test_scenes::{ellipsoid, of_frames};
    use crate::geometry::Ellipsoid;

    /// Number of views.
    const VIEWS: usize = 12;

    /// The boxes of two bodies, one above the other, divided between two objects: those for which `swapped` holds of the
    /// frame are with the other's. Returns which detections each object has in the end.
    fn after_dissolving(swapped: impl Fn(usize) -> bool) -> Vec<Vec<usize>> {
        let above = Ellipsoid { center: ellipsoid().center + Vector3::new(0.0, 0.0, 4.5), ..ellipsoid() };
        let (scene, observations, mut statistics) = of_frames(VIEWS, |_| vec![(ellipsoid(), None), (above, None)]);
        (statistics.volume, statistics.edge_sd) = (1e5, 0.02);
        let options = AssociateOptions::default();
        let context = AssociationContext::new(&scene, &observations, &options);
        let start = Start::sphere(ellipsoid().center.coords - observations.origin, 2.0);
        let objects = [0, 1].map(|body| {
            let is_own = |detection: usize| (detection + usize::from(swapped(detection / 2))) % 2 == body;
            let own = (0..2 * VIEWS as u32).filter(|&index| is_own(observations.boxes[index as usize].detection));
            Object { visible: VIEWS, ..fit(&observations, &statistics, own.collect(), &[start]).unwrap() }
        });
        let mut state = State { observations, statistics, objects: objects.into() };
        reseed_weak(&context, &mut state);
        let detections = |object: &Object| {
            let mut all: Vec<usize> =
                object.boxes.iter().map(|&index| state.observations.boxes[index as usize].detection).collect();
            all.sort_unstable();
            all
        };
        let mut found: Vec<Vec<usize>> = state.objects.iter().map(detections).collect();
        found.sort();
        found
    }

    #[test]
    fn objects_that_have_mixed_up_their_boxes_are_sought_anew() {
        let right = |body: usize| (0..VIEWS).map(|frame| 2 * frame + body).collect::<Vec<_>>();
        assert_eq!(after_dissolving(|_| false), [right(0), right(1)]);
        assert_eq!(after_dissolving(|frame| frame % 3 == 0), [right(0), right(1)]);
        assert_eq!(after_dissolving(|frame| frame < 6), [right(0), right(1)]);
    }
}
