//! The search as a whole: objects from trusted ids, growth, rounds.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicUsize, Ordering};

use super::assignment::count_visible;
use super::fit::{Start, fit};
use super::growth::grow;
use super::model::Model;
use super::object::Object;
use super::observations::Observations;
use super::options::{IdUse, Part};
use super::problem::Problem;
use super::rays::triangulate;
use super::rounds::{ROUNDS, State};
use crate::parallel::map_indices;

/// Rounds after growth, before anything is born of what is left.
const FIRST_ROUNDS: usize = 2;

/// Finds the objects.
pub(super) fn search(problem: &Problem, observations: Observations, progress: &(dyn Fn(usize, usize) + Sync)) -> State {
    let model = Model::new(&observations, problem.options, problem.given_sizes.clone());
    let mut state = State { observations, model, objects: Vec::new() };
    state.objects = trusted_objects(problem, &state);
    if state.observations.boxes.iter().all(|b| problem.is_trusted(b)) {
        // Nothing is left to associate.
        if !state.objects.is_empty() {
            state.learn(problem);
        }
        return state;
    }
    let trusted = state.objects.clone();
    let frames = state.observations.cameras.len();
    let thorough = problem.options.thorough;
    // Rounds take about as long as the growth over all frames.
    let (per_round, done) = (frames / ROUNDS + 1, AtomicUsize::new(0));
    let passes = if thorough { 4 } else { 2 };
    let total = passes * (frames + ROUNDS * per_round);
    let advance = |steps: usize| progress((done.fetch_add(steps, Ordering::Relaxed) + steps).min(total), total);
    let pass = |mut state: State, order: Option<&[u32]>| {
        state.objects = trusted.clone();
        if let Some(order) = order {
            state.grow(problem, order, &|| advance(1));
        }
        state.run(problem, &|| advance(per_round), thorough);
        state
    };
    let mut best = pass(state.clone(), Some(&problem.order.frames));
    if thorough {
        let other_order = problem.order.starting_at(&best.observations.cameras, frames / 2);
        for order in [Some(other_order.as_slice()), None] {
            best = better(problem, best, pass(state.clone(), order));
        }
    }
    // Once more with what has been learnt: noise, sizes, and above all the shifts of the frames.
    if problem.options.uses(Part::SecondPass) {
        let again = pass(best.clone(), Some(&problem.order.frames));
        best = better(problem, best, again);
    }
    progress(total, total);
    best
}

/// The state with more evidence, the first of equals.
fn better(problem: &Problem, first: State, second: State) -> State {
    if second.evidence(problem) > first.evidence(problem) { second } else { first }
}

impl State {
    /// Grows objects over all frames and settles them.
    fn grow(&mut self, problem: &Problem, order: &[u32], report: &impl Fn()) {
        let initial = std::mem::take(&mut self.objects);
        let observations = &self.observations;
        let free = |index: usize| !problem.is_trusted(&observations.boxes[index]);
        self.objects = grow(problem, observations, &mut self.model, order, &free, initial, report);
        if self.objects.is_empty() {
            return;
        }
        self.learn(problem);
        self.give_up_weak(problem);
        if self.objects.is_empty() {
            return;
        }
        self.learn(problem);
        self.merge(problem);
        self.settle(problem, FIRST_ROUNDS);
    }
}

/// Objects of the ids, where those are trusted.
fn trusted_objects(problem: &Problem, state: &State) -> Vec<Object> {
    if problem.options.ids != IdUse::Trust {
        return Vec::new();
    }
    let observations = &state.observations;
    let mut by_id: BTreeMap<u32, Vec<u32>> = BTreeMap::new();
    for (index, sighting) in observations.boxes.iter().enumerate() {
        if let Some(id) = sighting.id {
            by_id.entry(id).or_default().push(index as u32);
        }
    }
    let groups: Vec<(u32, Vec<u32>)> = by_id.into_iter().filter(|(_, boxes)| boxes.len() >= 2).collect();
    let objects = map_indices(groups.len(), |k| {
        let (id, boxes) = &groups[k];
        let first = &observations.boxes[boxes[0] as usize];
        let guess = observations.cameras[first.frame].center + first.ray;
        let sphere = triangulate(observations, boxes, &guess)?;
        let sphere = triangulate(observations, boxes, &sphere.center)?;
        let start = Start::sphere(sphere.center, sphere.log_radius.exp());
        let mut object = fit(observations, &state.model, boxes.clone(), &[start])?;
        object.trusted_id = Some(*id);
        object.visible = count_visible(problem, observations, &object);
        Some(object)
    });
    objects.into_iter().flatten().collect()
}
