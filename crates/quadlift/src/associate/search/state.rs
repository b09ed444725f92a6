//! Everything that changes while objects are sought, and the steps that change it.

use super::assignment::{Share, assign, count_visible, owners};
use super::births::births;
use super::merge::merge;
use crate::associate::input::context::Problem;
use crate::associate::input::observations::Observations;
use crate::associate::options::Part;
use crate::associate::score::evidence::{LEAST_EVIDENCE, evidence};
use crate::associate::score::fit::{Start, fit};
use crate::associate::score::object::Object;
use crate::associate::score::scene_statistics::Model;
use crate::parallel::map_indices;

/// Everything that changes while objects are sought.
#[derive(Debug, Clone)]
pub(crate) struct State {
    pub observations: Observations,
    pub model: Model,
    pub objects: Vec<Object>,
}

impl State {
    /// Total evidence of the objects.
    pub fn evidence(&self, problem: &Problem) -> f64 {
        self.objects.iter().map(|o| evidence(problem, &self.observations, &self.model, o).max(0.0)).sum()
    }

    /// Assigns all boxes and fits every object to its own; those with too few are given up.
    pub fn assign_and_fit(&mut self, problem: &Problem, with_spheres: bool) {
        let shares = assign(problem, &self.observations, &mut self.model, &self.objects, &|_| true);
        self.objects = refit(problem, &self.observations, &self.model, &self.objects, &shares, with_spheres);
    }

    /// Gives up objects with too little evidence; those that are trusted stay.
    pub fn give_up_weak(&mut self, problem: &Problem) {
        let (observations, model) = (&self.observations, &self.model);
        self.objects.retain(|o| o.trusted_id.is_some() || evidence(problem, observations, model, o) > LEAST_EVIDENCE);
    }

    /// Learns the scene's noise, clutter and sizes.
    pub fn learn(&mut self, problem: &Problem) {
        self.model.learn(problem, &self.observations, &self.objects);
    }

    /// Merges objects that are one.
    pub fn merge(&mut self, problem: &Problem) {
        if !problem.options.uses(Part::Merge) {
            return;
        }
        let objects = std::mem::take(&mut self.objects);
        self.objects = merge(problem, &self.observations, &self.model, objects);
    }

    /// A few rounds without births and shifts, as a start.
    pub fn settle(&mut self, problem: &Problem, rounds: usize) {
        for _ in 0..rounds {
            self.assign_and_fit(problem, false);
            if self.objects.is_empty() {
                return;
            }
            self.learn(problem);
            self.give_up_weak(problem);
            self.merge(problem);
        }
    }

    /// Which object each box belongs to.
    pub fn owners(&self) -> Vec<Option<u32>> {
        owners(self.observations.boxes.len(), &self.objects)
    }

    /// Adds new objects from boxes that belong to none, unless these are the same as those that were `tried` last.
    pub fn add_births(&mut self, problem: &Problem, tried: &mut Vec<bool>) {
        let used: Vec<bool> = self.owners().iter().map(Option::is_some).collect();
        if used.iter().filter(|&&u| !u).count() <= 2 || used == *tried {
            return;
        }
        let new = born(problem, &self.observations, &self.model, &used, &|_| true);
        self.objects.extend(new);
        *tried = used;
    }
}

/// Births as objects: fitted, with the number of frames that should see them.
pub(crate) fn born(
    problem: &Problem,
    observations: &Observations,
    model: &Model,
    used: &[bool],
    is_seed: &(impl Fn(usize) -> bool + Sync),
) -> Vec<Object> {
    let found = births(problem, observations, model, used, is_seed);
    let objects = map_indices(found.len(), |k| {
        let birth = &found[k];
        let start = Start::sphere(birth.sphere.center, birth.sphere.log_radius.exp());
        let mut object = fit(observations, model, birth.boxes.clone(), &[start])?;
        object.visible = count_visible(problem, observations, &object);
        Some(object)
    });
    objects.into_iter().flatten().collect()
}

/// Fits objects to their shares; those with too few boxes are given up, unless trusted.
pub(crate) fn refit(
    problem: &Problem,
    observations: &Observations,
    model: &Model,
    objects: &[Object],
    shares: &[Share],
    with_spheres: bool,
) -> Vec<Object> {
    let fitted = map_indices(objects.len(), |k| {
        let (object, share) = (&objects[k], &shares[k]);
        if share.boxes.len() < problem.options.min_views && object.trusted_id.is_none() {
            return None;
        }
        let mut starts = vec![Start::body(object)];
        if with_spheres {
            starts.push(Start::sphere(object.center, object.radius));
        }
        match fit(observations, model, share.boxes.clone(), &starts) {
            Some(fitted) => Some(Object { visible: share.visible, trusted_id: object.trusted_id, ..fitted }),
            None => object.trusted_id.map(|_| object.clone()),
        }
    });
    fitted.into_iter().flatten().collect()
}
