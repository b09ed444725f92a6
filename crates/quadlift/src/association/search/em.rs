//! Rounds of expectation-maximisation: assign boxes, fit bodies, update the scene's statistics, remove weak objects,
//! add new ones.

use std::ops::ControlFlow;

use super::frame_shift::learn_shifts;
use super::nested::drop_nested;
use super::state::State;
use crate::association::input::context::AssociationContext;
use crate::association::options::Part;

/// Rounds, at most.
pub(crate) const ROUNDS: usize = 8;

/// Rounds that start with births, besides the third last.
const BIRTH_ROUNDS: usize = 2;

/// Rounds in which fits also start from a sphere.
const SPHERE_ROUNDS: usize = 1;

impl State {
    /// All rounds; ends early when nothing changes any more.
    pub(crate) fn run(&mut self, context: &AssociationContext, report: &impl Fn() -> ControlFlow<()>) {
        let (mut before, mut tried) = (None, Vec::new());
        for round in 0..ROUNDS {
            let last_births = ROUNDS - 3;
            if round < BIRTH_ROUNDS || round == last_births {
                if round == 1 {
                    // The first round has learned the shifts of the frames: everything is worth another try.
                    tried.clear();
                }
                self.add_births(context, &mut tried);
                self.statistics.objects = self.objects.len() as f64;
                if round == 0 {
                    self.learn(context);
                }
            }
            if self.objects.is_empty() {
                return;
            }
            self.assign_and_fit(context, round < SPHERE_ROUNDS);
            self.learn(context);
            learn_shifts(&mut self.observations, &mut self.statistics, &self.objects);
            self.give_up_weak(context);
            if round >= last_births && context.options.uses(Part::Nested) {
                let objects = std::mem::take(&mut self.objects);
                self.objects = drop_nested(context, &self.observations, &self.statistics, objects);
            }
            if report().is_break() {
                return;
            }
            let now = Some(self.owners());
            if now == before && round > last_births {
                return;
            }
            before = now;
        }
    }
}
