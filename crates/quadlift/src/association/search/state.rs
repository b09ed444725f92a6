//! The state of the search and the steps that change it.

use super::assignment::{Assignment, assign, count_visible, owners};
use super::births::births;
use crate::association::input::context::AssociationContext;
use crate::association::input::observations::Observations;
use crate::association::score::evidence::evidence;
use crate::association::score::fit::{Start, fit};
use crate::association::score::object::Object;
use crate::association::score::scene_statistics::SceneStatistics;
use crate::parallel::map_indices;
use crate::tuning::CLEAR;

/// The mutable state of the search.
#[derive(Debug, Clone)]
pub(crate) struct State {
    pub observations: Observations,
    pub statistics: SceneStatistics,
    pub objects: Vec<Object>,
}

impl State {
    /// Total evidence of the objects.
    pub(crate) fn evidence(&self, context: &AssociationContext) -> f64 {
        self.objects.iter().map(|o| evidence(&context.rate, &self.observations, &self.statistics, o).max(0.0)).sum()
    }

    /// Assigns all boxes and refits every object; those with too few boxes are removed.
    pub(crate) fn assign_and_fit(&mut self, context: &AssociationContext, with_spheres: bool) {
        let assignments = assign(context, &self.observations, &mut self.statistics, &self.objects);
        self.objects = refit(context, &self.observations, &self.statistics, &self.objects, &assignments, with_spheres);
    }

    /// Removes objects with too little evidence; trusted ones are kept.
    pub(crate) fn give_up_weak(&mut self, context: &AssociationContext) {
        let (observations, statistics) = (&self.observations, &self.statistics);
        self.objects.retain(|o| o.trusted_id.is_some() || evidence(&context.rate, observations, statistics, o) > CLEAR);
    }

    /// Learns the scene's noise, clutter and sizes.
    pub(crate) fn learn(&mut self, context: &AssociationContext) {
        self.statistics.learn(context, &self.observations, &self.objects);
    }

    /// A few rounds without births and shifts, as a start.
    pub(crate) fn settle(&mut self, context: &AssociationContext, rounds: usize) {
        for _ in 0..rounds {
            self.assign_and_fit(context, false);
            if self.objects.is_empty() {
                return;
            }
            self.learn(context);
            self.give_up_weak(context);
        }
    }

    /// The object of each box.
    pub(crate) fn owners(&self) -> Vec<Option<u32>> {
        owners(self.observations.boxes.len(), &self.objects)
    }

    /// Adds new objects from unassigned boxes, unless these are the same as those that were `tried` last.
    pub(crate) fn add_births(&mut self, context: &AssociationContext, tried: &mut Vec<bool>) {
        let used: Vec<bool> = self.owners().iter().map(Option::is_some).collect();
        if used.iter().filter(|&&u| !u).count() <= 2 || used == *tried {
            return;
        }
        let new = born(context, &self.observations, &self.statistics, &used);
        self.objects.extend(new);
        *tried = used;
    }
}

/// Births as objects: fitted, with the number of frames in which they should be visible.
fn born(
    context: &AssociationContext,
    observations: &Observations,
    statistics: &SceneStatistics,
    used: &[bool],
) -> Vec<Object> {
    let found = births(context, observations, statistics, used);
    let objects = map_indices(found.len(), |k| {
        let birth = &found[k];
        let start = Start::sphere(birth.sphere.center, birth.sphere.log_radius.exp());
        let mut object = fit(observations, statistics, birth.boxes.clone(), &[start])?;
        object.visible = count_visible(context, observations, &object);
        Some(object)
    });
    objects.into_iter().flatten().collect()
}

/// Fits objects to their boxes; those with too few boxes are removed, unless trusted.
fn refit(
    context: &AssociationContext,
    observations: &Observations,
    statistics: &SceneStatistics,
    objects: &[Object],
    assignments: &[Assignment],
    with_spheres: bool,
) -> Vec<Object> {
    let fitted = map_indices(objects.len(), |k| {
        let (object, share) = (&objects[k], &assignments[k]);
        if share.boxes.len() < context.options.min_views && object.trusted_id.is_none() {
            return None;
        }
        let mut starts = vec![Start::body(object)];
        if with_spheres {
            starts.push(Start::sphere(object.center, object.radius));
        }
        match fit(observations, statistics, share.boxes.clone(), &starts) {
            Some(fitted) => Some(Object { visible: share.visible, trusted_id: object.trusted_id, ..fitted }),
            None => object.trusted_id.map(|_| object.clone()),
        }
    });
    fitted.into_iter().flatten().collect()
}
