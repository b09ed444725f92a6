//! The passes of the search: objects from trusted ids, growth, rounds, and the choice of the slack (docs/method.md,
//! section 15.7).

use crate::tuning::MIN_EVIDENCE_SHARE;
use std::collections::BTreeMap;
use std::ops::ControlFlow;

use super::assignment::count_visible;
use super::em::ROUNDS;
use super::growth::grow;
use super::state::State;
use crate::association::input::context::AssociationContext;
use crate::association::input::observations::Observations;
use crate::association::options::{IdPolicy, Part};
use crate::association::score::fit::{Start, fit};
use crate::association::score::object::Object;
use crate::association::score::rays::triangulate_sphere;
use crate::association::score::scene_statistics::SceneStatistics;
use crate::observer::{Observer, Watch};
use crate::parallel::map_indices;

/// Rounds after growth, before births from the remaining boxes.
const FIRST_ROUNDS: usize = 2;

/// Slack of edges in pixels: as much as costs little evidence.
pub(crate) const PIXEL_SDS: [f64; 3] = [2.0, 4.0, 8.0];

/// Rounds in which more slack is tested before a full search.
const TRIAL_ROUNDS: usize = 2;

/// Finds the objects; `None` if the observer cancels.
pub(crate) fn search(
    context: &AssociationContext,
    observations: Observations,
    observer: &dyn Observer,
) -> Option<State> {
    let slack = context.options.edge_noise_px.unwrap_or(PIXEL_SDS[0]);
    let statistics = SceneStatistics::new(&observations, context.given_sizes.clone(), slack);
    let mut state = State { observations, statistics, objects: Vec::new() };
    state.objects = trusted_objects(context, &state);
    if state.observations.boxes.iter().all(|b| context.is_trusted(b)) {
        // Nothing is left to associate.
        if !state.objects.is_empty() {
            state.learn(context);
        }
        return Some(state);
    }
    let steps = Steps::new(context, &state, observer);
    let mut best = passes(context, &state, &steps);
    if context.options.edge_noise_px.is_none() {
        for slack in &PIXEL_SDS[1..] {
            if best.objects.is_empty() {
                break;
            }
            let mut trial = best.clone();
            trial.statistics.edge_noise_px = *slack;
            trial.settle(context, TRIAL_ROUNDS);
            let least = MIN_EVIDENCE_SHARE.get() * best.evidence(context);
            if trial.evidence(context) < least {
                break;
            }
            state.statistics.edge_noise_px = *slack;
            steps.another();
            let other = passes(context, &state, &steps);
            if other.evidence(context) < least {
                break;
            }
            best = other;
        }
    }
    steps.watch.finish();
    (!steps.watch.is_canceled()).then_some(best)
}

/// All passes from the objects of trusted ids on, the best of them.
fn passes(context: &AssociationContext, state: &State, steps: &Steps) -> State {
    let pass = |mut from: State, order: Option<&[u32]>| {
        if steps.watch.is_canceled() {
            return from;
        }
        from.objects = state.objects.clone();
        if let Some(order) = order {
            from.grow(context, order, &|| steps.advance(1));
        }
        from.run(context, &|| steps.advance(steps.per_round));
        from
    };
    let mut best = pass(state.clone(), Some(&context.order.frames));
    if context.options.thorough {
        let cameras = &best.observations.cameras;
        let other_order = context.order.starting_at(cameras, cameras.len() / 2);
        for order in [Some(other_order.as_slice()), None] {
            best = better(context, best, pass(state.clone(), order));
        }
    }
    // Second pass with the learned statistics: noise, sizes, and in particular the shifts of the frames.
    if context.options.uses(Part::SecondPass) {
        let again = pass(best.clone(), Some(&context.order.frames));
        best = better(context, best, again);
    }
    best
}

/// Counts finished steps.
struct Steps<'a> {
    watch: Watch<'a>,
    /// Rounds take about as long as the growth over all frames.
    per_round: usize,
    of_passes: usize,
}

impl<'a> Steps<'a> {
    fn new(context: &AssociationContext, state: &State, observer: &'a dyn Observer) -> Self {
        let frames = state.observations.cameras.len();
        let per_round = frames / ROUNDS + 1;
        let of_passes = if context.options.thorough { 4 } else { 2 } * (frames + ROUNDS * per_round);
        Self { watch: Watch::new(observer, of_passes), per_round, of_passes }
    }

    /// Counts steps; breaks if the observer has canceled.
    fn advance(&self, steps: usize) -> ControlFlow<()> {
        self.watch.advance(steps);
        if self.watch.is_canceled() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    }

    /// What there is to do is done; the same comes once more.
    fn another(&self) {
        self.watch.finish();
        self.watch.extend(self.of_passes);
    }
}

/// The state with more evidence, the first of equals.
fn better(context: &AssociationContext, first: State, second: State) -> State {
    if second.evidence(context) > first.evidence(context) { second } else { first }
}

impl State {
    /// Grows objects over all frames and settles them.
    fn grow(&mut self, context: &AssociationContext, order: &[u32], report: &impl Fn() -> ControlFlow<()>) {
        let initial = std::mem::take(&mut self.objects);
        let observations = &self.observations;
        self.objects = grow(context, observations, &mut self.statistics, order, initial, report);
        if self.objects.is_empty() {
            return;
        }
        self.learn(context);
        self.give_up_weak(context);
        if self.objects.is_empty() {
            return;
        }
        self.learn(context);
        self.settle(context, FIRST_ROUNDS);
    }
}

/// An object fitted to boxes (two at least) from the sphere that their rays show.
pub(crate) fn fit_rays(observations: &Observations, statistics: &SceneStatistics, boxes: Vec<u32>) -> Option<Object> {
    let first = &observations.boxes[*boxes.first()? as usize];
    let guess = observations.cameras[first.frame].center + first.ray;
    let sphere = triangulate_sphere(observations, &boxes, &guess)?;
    let sphere = triangulate_sphere(observations, &boxes, &sphere.center)?;
    let start = Start::sphere(sphere.center, sphere.log_radius.exp());
    fit(observations, statistics, boxes, &[start])
}

/// Objects of trusted ids.
fn trusted_objects(context: &AssociationContext, state: &State) -> Vec<Object> {
    if context.options.ids != IdPolicy::Trust {
        return Vec::new();
    }
    let observations = &state.observations;
    let mut by_id: BTreeMap<u32, Vec<u32>> = BTreeMap::new();
    for (index, observation) in observations.boxes.iter().enumerate() {
        if let Some(id) = observation.id {
            by_id.entry(id).or_default().push(index as u32);
        }
    }
    let groups: Vec<(u32, Vec<u32>)> = by_id.into_iter().filter(|(_, boxes)| boxes.len() >= 2).collect();
    let objects = map_indices(groups.len(), |k| {
        let (id, boxes) = &groups[k];
        let mut object = fit_rays(observations, &state.statistics, boxes.clone())?;
        object.trusted_id = Some(*id);
        object.visible = count_visible(context, observations, &object);
        Some(object)
    });
    objects.into_iter().flatten().collect()
}
