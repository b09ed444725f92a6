//! All objects of a scene: ellipsoids down their own noise levels, then the other families, then thorough searches where no body explains
//! the boxes; after each stage the evidence of the scene decides on its noise level.

use super::choice::choose;
use super::conditions::{Conditions, FIRST_NOISE};
use super::fit::{Termination, Workspace, minimize};
use super::levels::{best_level, proposed};
use super::noise_names::Shared;
use super::object::{FINE_NOISE, Hypotheses, Object, Plan};
use super::rows::Rows;
use super::shares::Shares;
use super::solid::Solid;
use crate::geometry::Body;
use crate::observer::Watch;
use crate::parallel::map_mut;

/// Rounds of the noise level with ellipsoids only, and with all families.
const ELLIPSOID_ROUNDS: usize = 6;
const ROUNDS: usize = 12;

/// Stages with thorough searches.
const MAX_SEARCHES: usize = 3;

/// A change of the noise level by less than this share ends the rounds; larger ones are cut.
const MIN_LEVEL_CHANGE: f64 = 0.03;
const MAX_LEVEL_STEP: (f64, f64) = (-1.6, 0.7);

/// A step that lowers the evidence is undone and shortened by this factor, down to the last one.
const SHORTER: f64 = 0.4;
const SHORTEST: f64 = 0.1;

/// Rotations are scanned again where the level fell by this factor since, and the typical residual exceeds the noise by that.
const RESCAN_LEVEL: f64 = 0.7;
const RESCAN_RESIDUAL: f64 = 1.3;

/// Typical residual, in units of the noise, above which no body explains the boxes: for low noise, and from this level on.
const UNEXPLAINED: f64 = 1.3;
const UNEXPLAINED_NOISY: f64 = 1.6;
const NOISY: f64 = 0.02;

/// At this level boxes are exact: there is nothing to find below.
const EXACT: f64 = 5e-5;

/// Of the fit to some views of an object from the fit to all.
const FROM_WHOLE: Termination = Termination::new(1e-4, 40);

/// The objects of a scene under its conditions.
pub(super) struct SceneFit<'a> {
    pub objects: Vec<Object>,
    pub conditions: Conditions,
    pub shares: Shares,
    plan: &'a Plan,
    watch: &'a Watch<'a>,
}

impl<'a> SceneFit<'a> {
    /// Fits the objects, and estimates what they share from them. `objects` have the fit of an ellipsoid under `conditions`.
    pub(super) fn new(objects: Vec<Object>, conditions: Conditions, plan: &'a Plan, watch: &'a Watch<'a>) -> Self {
        let mut scene = Self { objects, conditions, shares: Shares::first(plan.family), plan, watch };
        if scene.objects.is_empty() {
            return scene;
        }
        scene.fit_ellipsoids();
        if !plan.hypotheses().is_empty() {
            scene.fit_families();
        }
        scene.each(|object, conditions, shares, plan, work| object.finish(conditions, shares, plan, work));
        scene
    }

    /// Without objects, under given conditions.
    pub(super) fn given(shared: &Shared, plan: &'a Plan, watch: &'a Watch<'a>) -> Self {
        Self { objects: Vec::new(), conditions: shared.conditions, shares: shared.shares, plan, watch }
    }

    /// Each object with buffers of its own; results in order.
    fn each<T: Send>(
        &mut self,
        f: impl Fn(&mut Object, &Conditions, &Shares, &Plan, &mut Workspace) -> T + Sync,
    ) -> Vec<T> {
        let (conditions, shares, plan) = (self.conditions, self.shares, self.plan);
        map_mut(&mut self.objects, |object| f(object, &conditions, &shares, plan, &mut Workspace::default()))
    }

    fn refit_all(&mut self) {
        self.each(|object, conditions, shares, plan, work| object.refit_all(conditions, shares, plan, work));
    }

    fn choose(&mut self) {
        self.shares = choose(&mut self.objects, self.plan.family, &mut self.conditions);
    }

    /// Each ellipsoid down its own levels; the level of the scene, if other families follow not below the median.
    fn fit_ellipsoids(&mut self) {
        self.each(|object, conditions, shares, plan, work| object.descend(conditions, shares, plan, work));
        let mut own: Vec<f64> = self.objects.iter().map(|object| object.own_level).collect();
        own.sort_by(f64::total_cmp);
        let lowest = if self.plan.hypotheses().is_empty() { 0.0 } else { own[own.len() / 2] };
        self.conditions = self.conditions.at(best_level(&self.objects, &self.conditions, lowest));
        self.refit_all();
        self.alternate(ELLIPSOID_ROUNDS, false);
    }

    /// All families from the scan; each object down its own levels; thorough searches where they are needed.
    fn fit_families(&mut self) {
        self.each(|object, conditions, _, plan, work| object.scan(plan, conditions, work));
        self.choose();
        for round in 0..=MAX_SEARCHES {
            if self.watch.is_canceled() {
                return;
            }
            self.each(|object, conditions, shares, plan, work| object.descend(conditions, shares, plan, work));
            let level = best_level(&self.objects, &self.conditions, 0.0);
            self.conditions = self.conditions.at(level);
            self.refit_all();
            self.choose();
            self.alternate(ROUNDS, true);
            if round == MAX_SEARCHES || !self.search_unexplained() {
                break;
            }
        }
    }

    /// Searches thoroughly where no body explains the boxes, or they are nearly exact; whether something more probable was found.
    fn search_unexplained(&mut self) -> bool {
        let found = self.each(|object, conditions, shares, plan, work| {
            let noise = conditions.noise[0];
            let needed = (EXACT..FINE_NOISE).contains(&noise) || is_unexplained(object, conditions, work);
            needed && object.may_be_searched(conditions) && object.search_deeply(plan, conditions, shares, work)
        });
        self.choose();
        found.contains(&true)
    }

    /// Noise levels by variance components, as long as the evidence of the scene grows; a worse step is undone and shortened.
    fn alternate(&mut self, rounds: usize, rescans: bool) {
        let mut evidence = self.log_evidence();
        let mut shrink = 1.0;
        for _ in 0..rounds {
            self.watch.poll();
            if self.watch.is_canceled() {
                return;
            }
            let mut conditions = proposed(&self.objects, &self.conditions);
            let step = (conditions.noise[0] / self.conditions.noise[0]).ln() * shrink;
            let step = step.clamp(MAX_LEVEL_STEP.0, MAX_LEVEL_STEP.1);
            if !step.is_finite() {
                return;
            }
            conditions = conditions.at(self.conditions.noise[0] * step.exp());
            let turned = conditions.opposite_correlation.atanh() - self.conditions.opposite_correlation.atanh();
            if step.abs() < MIN_LEVEL_CHANGE && turned.abs() < MIN_LEVEL_CHANGE {
                self.conditions = conditions;
                return;
            }
            let before = (self.hypotheses(), self.conditions, self.shares);
            self.conditions = conditions;
            self.each(|object, conditions, shares, plan, work| {
                if rescans && conditions.noise[0] < RESCAN_LEVEL * object.scanned_at {
                    let residual = object.residual_level(conditions, work);
                    if residual > RESCAN_RESIDUAL {
                        return object.scan(plan, conditions, work);
                    }
                }
                object.refit_all(conditions, shares, plan, work);
            });
            self.choose();
            let found = self.log_evidence_at_last_fits();
            if found > evidence {
                evidence = found;
                continue;
            }
            let (hypotheses, conditions, shares) = before;
            self.objects.iter_mut().zip(hypotheses).for_each(|(object, before)| object.hypotheses = before);
            (self.conditions, self.shares) = (conditions, shares);
            shrink *= SHORTER;
            if shrink < SHORTEST {
                return;
            }
        }
    }

    fn hypotheses(&self) -> Vec<Hypotheses> {
        self.objects.iter().map(|object| object.hypotheses.clone()).collect()
    }

    /// Log evidence of the scene, with the chosen hypotheses.
    fn log_evidence(&mut self) -> f64 {
        let of_objects =
            self.each(|object, conditions, _, _, work| object.log_evidence_of(object.fit(), conditions, work));
        of_objects.iter().sum::<f64>() + self.conditions.log_prior()
    }

    /// The same, as computed with the fits.
    fn log_evidence_at_last_fits(&self) -> f64 {
        let of = |object: &Object| object.hypotheses.log_evidence[object.hypotheses.chosen.0].max(-1e12);
        self.objects.iter().map(of).sum::<f64>() + self.conditions.log_prior()
    }

    /// The body of other rows of an object, from where the fit to all of them ended, in the world.
    pub(super) fn refit_from(&self, whole: &Object, rows: &Rows, work: &mut Workspace) -> Body {
        let ratio = whole.rows.unit / rows.unit;
        let shift = (whole.rows.origin - rows.origin) / rows.unit;
        let body = whole.fit().body;
        let start = Solid { center: body.center * ratio + shift, half_extents: body.half_extents * ratio, ..body };
        let fit = minimize(rows, &start, &self.conditions, FROM_WHOLE, work);
        fit.body.in_world(&rows.origin, rows.unit)
    }

    /// Fits an object that the scene's levels do not depend on.
    pub(super) fn fit_other(&self, object: &mut Object, work: &mut Workspace) {
        let (conditions, plan) = (&self.conditions, self.plan);
        if !plan.hypotheses().is_empty() {
            object.scan(plan, conditions, work);
            object.choose(&self.shares);
            if is_unexplained(object, conditions, work) {
                object.search_deeply(plan, conditions, &self.shares, work);
                object.choose(&self.shares);
            }
        }
        object.finish(conditions, &self.shares, plan, work);
    }
}

/// Whether no hypothesis explains the boxes of an object; of nearly exact boxes all should be explained.
fn is_unexplained(object: &Object, conditions: &Conditions, work: &mut Workspace) -> bool {
    let limit = if conditions.noise[0] < NOISY { UNEXPLAINED } else { UNEXPLAINED_NOISY };
    let residual = object.residual_level(conditions, work);
    residual > limit || conditions.noise[0] < FINE_NOISE && work.views.iter().any(|view| view.probability < 0.5)
}

/// Conditions of the first fits.
pub(super) fn first_conditions(shape_sd: f64) -> Conditions {
    Conditions::first(FIRST_NOISE, shape_sd)
}
