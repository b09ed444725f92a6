//! The estimator of scenes of boxes: one likelihood, one scan over rotations, one evidence (docs/method.md, section 24).
//!
//! Each box gives four planes that touch the body ([`rows`]). A view shows its object, with Student's t of each edge, or it is a wrong box
//! ([`fit`]). An ellipsoid is fitted from a sphere ([`spheres`], [`search`]); from its weights the scan finds cuboids and cylinders of any
//! rotation by linear problems ([`scan`]). Families, upright bodies and noise levels are compared by their evidence ([`log_evidence`]): each
//! object goes down its own levels ([`object`]), the scene decides on its own ([`scene`], [`levels`]) and on how frequent families are
//! ([`choice`]). Nothing is random, and nothing depends on the order or the frame of the world.

mod lanes;
mod conditions;
mod solid;
mod prior;
mod box_planes;
mod spheres;
mod rows;
mod fit;
mod log_evidence;
mod rotations;
mod scan;
mod rounded;
mod search;
mod hypothesis;
mod shares;
mod object;
mod choice;
mod levels;
mod covariance;
mod noise_names;
mod scene;
mod estimates;

use choice::shares_of_chosen;
use conditions::Conditions;
use fit::Workspace;
use noise_names::Shared;
use object::{Object, Plan};
use rows::Rows;
use scene::{SceneFit, first_conditions};
use solid::Family;

use self::covariance::Systematic;
use self::estimates::{Reporter, reference};
use super::estimate::{Estimate, Status};
use super::noise_model::NoiseModel;
use super::posterior::{ChooseFolds, CrossValidated, PosteriorContext, posterior};
use super::prediction::{Fold, FoldPrediction, predict_fold};
use super::scene_solution::SceneSolution;
use crate::geometry::{Body, BodyKind};
use crate::parallel::map_indices;
use crate::scene::{ObjectViews, View};

/// Scenes of more than twice as many objects take their levels from so many.
const SAMPLE: usize = 250;

/// Probability that an object is upright whose category has an `upright_sd`.
const UPRIGHT_CATEGORY: f64 = 0.98;

/// Solves for `count` objects by the estimator for what they share and were measured with, see [`posterior`]. With given noise levels each
/// object is on its own, and so is its estimator.
pub(crate) fn estimate(
    count: usize,
    views_of: &(dyn Fn(usize) -> ObjectViews + Sync),
    context: &PosteriorContext,
    folds: ChooseFolds,
) -> CrossValidated {
    let serves = |k: &usize| serves_scene(context) && serves_object(&views_of(*k), context);
    let (of_boxes, others): (Vec<usize>, Vec<usize>) = (0..count).partition(serves);
    if others.is_empty() {
        return estimate_boxes(count, views_of, context, folds);
    }
    if of_boxes.is_empty() || context.options.noise_model.is_none() || context.has_shared_unknowns() {
        return posterior(count, views_of, context, folds);
    }
    let boxes = estimate_boxes(of_boxes.len(), &|k| views_of(of_boxes[k]), context, folds);
    let rest = posterior(others.len(), &|k| views_of(others[k]), context, folds);
    merged([(of_boxes, boxes), (others, rest)])
}

/// Whether nothing is asked for but what this estimator has.
fn serves_scene(context: &PosteriorContext) -> bool {
    let options = context.options;
    let plain = options.robust && options.heavy_tails && options.correlated_views && options.common_errors;
    plain && options.by_evidence && family_of(options.body).is_some() && !context.has_shared_unknowns()
}

/// Whether an object has nothing but boxes, and no size.
fn serves_object(object: &ObjectViews, context: &PosteriorContext) -> bool {
    let prior = object.category_index.and_then(|index| context.options.priors.of(&context.categories[index]));
    let is_box = |view: &View| {
        view.bounding_box.is_some() && view.ellipse.is_none() && view.tangent_lines.is_none() && view.cues.is_empty()
    };
    prior.is_none_or(|prior| prior.size.is_none()) && object.views.iter().all(is_box)
}

/// The results of two groups of objects, whose numbers are given, in the order of the objects.
fn merged(groups: [(Vec<usize>, CrossValidated); 2]) -> CrossValidated {
    let (mut estimates, mut folds, mut predicted) = (Vec::new(), Vec::new(), Vec::new());
    let mut solutions = Vec::new();
    for (objects, (mut solution, of_group, of_folds)) in groups {
        estimates.extend(objects.iter().copied().zip(std::mem::take(&mut solution.estimates)));
        folds.extend(of_group.into_iter().map(|fold| Fold { object: objects[fold.object], ..fold }));
        predicted.extend(of_folds);
        solutions.push(solution);
    }
    estimates.sort_by_key(|(object, _)| *object);
    let estimates = estimates.into_iter().map(|(_, estimate)| estimate).collect();
    let kinds: Vec<Option<BodyKind>> = solutions.iter().map(|solution| solution.body).collect();
    let body = kinds[0].filter(|_| kinds[0] == kinds[1]);
    (SceneSolution { estimates, body, ..solutions.remove(1) }, folds, predicted)
}

/// The family of a given kind, or any; `None` where the kind is not fitted.
fn family_of(kind: Option<BodyKind>) -> Option<Option<Family>> {
    match kind {
        None => Some(None),
        Some(BodyKind::Ellipsoid) => Some(Some(Family::Ellipsoid)),
        Some(BodyKind::Cuboid) => Some(Some(Family::Cuboid)),
        Some(BodyKind::Cylinder) => Some(Some(Family::Cylinder)),
        Some(BodyKind::Rounded(_)) => Some(Some(Family::Rounded)),
        Some(BodyKind::Superellipsoid(_)) => None,
    }
}

/// Where the fit of an object is.
#[derive(Debug, Clone, Copy)]
enum Place {
    /// In the scene, whose levels it has set.
    InScene(usize),
    /// It has none.
    Nowhere,
    /// It follows from the levels.
    Later,
}

/// The same by the evidence of boxes.
fn estimate_boxes(
    count: usize,
    views_of: &(dyn Fn(usize) -> ObjectViews + Sync),
    context: &PosteriorContext,
    choose_folds: ChooseFolds,
) -> CrossValidated {
    let options = context.options;
    let up = context.up.filter(|_| options.upright).map(nalgebra::Unit::into_inner);
    let plan = Plan { family: family_of(options.body).flatten(), up };
    let given = options.noise_model.as_ref();
    let given = given.map(|model| Shared::from_model(model, plan.family, options.shape_sd, options.pixel_noise_size));
    let pixel_noise_size = given.map_or(options.pixel_noise_size, |given| given.pixel_noise_size);
    let start = |views: &ObjectViews, conditions: &Conditions, work: &mut Workspace| {
        let prior = views.category_index.and_then(|index| options.priors.of(&context.categories[index]));
        let upright_share = prior.and_then(|prior| prior.upright_sd).map(|_| UPRIGHT_CATEGORY);
        Object::new(Rows::new(&views.views, pixel_noise_size)?, upright_share, conditions, work)
    };
    // Levels and frequencies from all objects, or from evenly spread ones.
    let stride = if count > 2 * SAMPLE { count / SAMPLE } else { 1 };
    let sample: Vec<usize> = if given.is_some() { Vec::new() } else { (0..count).step_by(stride).collect() };
    let first = first_conditions(options.shape_sd);
    let started = map_indices(sample.len(), |k| start(&views_of(sample[k]), &first, &mut Workspace::default()));
    let mut place = vec![Place::Later; count];
    let mut objects = Vec::with_capacity(sample.len());
    for (k, object) in sample.into_iter().zip(started) {
        place[k] = if object.is_some() { Place::InScene(objects.len()) } else { Place::Nowhere };
        objects.extend(object);
    }
    let scene = match &given {
        None => SceneFit::new(objects, first, &plan, context.watch),
        Some(given) => SceneFit::given(given, &plan, context.watch),
    };
    let shared = given.unwrap_or_else(|| Shared {
        conditions: scene.conditions,
        shares: shares_of_chosen(&scene.objects, plan.family),
        systematic: Systematic::new(&scene.objects, &scene.conditions),
        pixel_noise_size,
    });
    let reference = reference(&scene.objects, &scene.conditions);
    let reporter = Reporter { shared: &shared, reference, with_enclosing: context.with_enclosing };
    let fit_later = |views: &ObjectViews, work: &mut Workspace| {
        let mut object = start(views, &scene.conditions, work)?;
        scene.fit_other(&mut object, work);
        Some(object)
    };
    let estimates = map_indices(count, |k| {
        if context.watch.is_canceled() {
            return Estimate::canceled();
        }
        let (views, mut work) = (views_of(k), Workspace::default());
        let estimate = match place[k] {
            _ if views.views.len() < 2 => Err(Status::TooFewViews),
            Place::InScene(index) => Ok(reporter.estimate(&scene.objects[index], &views, &mut work)),
            Place::Nowhere => Err(Status::Degenerate),
            Place::Later => fit_later(&views, &mut work)
                .map(|object| reporter.estimate(&object, &views, &mut work))
                .ok_or(Status::Degenerate),
        };
        context.watch.advance(1);
        estimate.unwrap_or_else(|status| Estimate::failed(views.object_index, views.category_index, status))
    });
    let folds = choose_folds(&estimates);
    let predicted = map_indices(folds.len(), |index| {
        if context.watch.stops_before(index) {
            return FoldPrediction::default();
        }
        let Fold { object, views, warm_start } = &folds[index];
        let fit = |others: ObjectViews| {
            let mut work = Workspace::default();
            match place[*object] {
                Place::InScene(whole) if *warm_start => {
                    let rows = Rows::new(&others.views, pixel_noise_size)?;
                    Some(scene.refit_from(&scene.objects[whole], &rows, &mut work))
                }
                _ => fit_later(&others, &mut work).map(|object| in_world(&object)),
            }
        };
        predict_fold(&views_of(*object), views, options.border_margin, fit)
    });
    let kinds: Vec<BodyKind> = estimates.iter().filter_map(|estimate| Some(estimate.body?.kind)).collect();
    let body = kinds.first().copied().filter(|first| kinds.iter().all(|kind| kind == first));
    let has_occluded = scene.objects.iter().flat_map(|object| &object.rows.views).any(|view| view.two_sided[1] > 0);
    let noise = match &options.noise_model {
        Some(model) => model.clone(),
        None if scene.objects.is_empty() => NoiseModel::default(),
        None => shared.to_model(has_occluded),
    };
    (SceneSolution { estimates, noise, body, ..SceneSolution::default() }, folds, predicted)
}

/// The chosen body in the world.
fn in_world(object: &Object) -> Body {
    object.fit().body.in_world(&object.rows.origin, object.rows.unit)
}

#[cfg(test)]
mod tests;
