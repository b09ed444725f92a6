//! The default estimator of scenes of boxes: one likelihood, one scan over rotations, one evidence (docs/method.md).
//!
//! Each box gives four planes that touch the body ([`rows`]). A view shows its object, with Student's t of each edge, or it is a wrong box
//! ([`fit`]). An ellipsoid is fitted from a sphere ([`spheres`], [`search`]); from its weights the scan finds cuboids and cylinders of any
//! rotation by linear problems ([`scan`]). Families, upright bodies and noise levels are compared by their evidence ([`evidence`]): each
//! object goes down its own levels ([`object`]), the scene decides on its own ([`scene`], [`levels`]) and on how frequent families are
//! ([`shares`]). Nothing is random, and nothing depends on the order or the frame of the world.

mod lanes;
mod conditions;
mod solid;
mod prior;
mod spheres;
mod rows;
mod fit;
mod evidence;
mod rotations;
mod scan;
mod rounded;
mod search;
mod shares;
mod object;
mod levels;
mod scene;
mod covariance;
mod estimates;

use fit::Workspace;
use object::{Object, Plan};
use rows::Rows;
use scene::{SceneFit, first_conditions};
use solid::Family;

use self::covariance::Systematic;
use self::estimates::{Reporter, reference};
use super::estimate::{Estimate, Status};
use super::noise_model::NoiseModel;
use super::posterior::{ChooseFolds, CrossValidated, PosteriorContext};
use super::prediction::{Fold, FoldPrediction, predict_fold};
use super::scene_solution::SceneSolution;
use crate::geometry::{Body, BodyKind};
use crate::parallel::map_indices;
use crate::scene::{ObjectViews, View};

/// Scenes of more than twice as many objects take their levels from so many.
const SAMPLE: usize = 250;

/// Probability that an object is upright whose category has an `upright_sd`.
const UPRIGHT_CATEGORY: f64 = 0.98;

/// Whether a scene has nothing but boxes, no shared unknowns and no sizes: what this estimator fits.
pub(super) fn serves(
    count: usize,
    views_of: &(dyn Fn(usize) -> ObjectViews + Sync),
    context: &PosteriorContext,
) -> bool {
    let options = context.options;
    let has_sizes = options.priors.by_category.values().any(|prior| prior.size.is_some());
    let plain = options.robust && options.heavy_tails && options.correlated_views && options.common_errors;
    let is_box = |view: &View| view.bounding_box.is_some() && view.ellipse.is_none() && view.tangent_lines.is_none();
    family_of(options.body).is_some()
        && plain
        && !has_sizes
        && options.noise_model.is_none()
        && !context.has_cues
        && !context.has_shared_unknowns()
        && (0..count).all(|k| views_of(k).views.iter().all(is_box))
}

/// The family of a given kind, or any; `None` where the kind is not fitted.
fn family_of(kind: Option<BodyKind>) -> Option<Option<Family>> {
    match kind {
        None => Some(None),
        Some(BodyKind::Ellipsoid) => Some(Some(Family::Ellipsoid)),
        Some(BodyKind::Cuboid) => Some(Some(Family::Cuboid)),
        Some(BodyKind::Cylinder) => Some(Some(Family::Cylinder)),
        Some(BodyKind::Superellipsoid(_) | BodyKind::Rounded(_)) => None,
    }
}

/// Solves for `count` objects, see [`super::posterior::posterior`].
pub(super) fn estimate_boxes(
    count: usize,
    views_of: &(dyn Fn(usize) -> ObjectViews + Sync),
    context: &PosteriorContext,
    choose_folds: ChooseFolds,
) -> CrossValidated {
    let options = context.options;
    let up = context.up.filter(|_| options.upright).map(nalgebra::Unit::into_inner);
    let plan = Plan { family: family_of(options.body).flatten(), up };
    let first = first_conditions(options.shape_sd);
    let prepare = |views: &ObjectViews| Rows::new(&views.views, options.pixel_noise_size);
    let upright_share = |views: &ObjectViews| {
        let prior = options.priors.of(&context.categories[views.category_index?])?;
        prior.upright_sd.map(|_| UPRIGHT_CATEGORY)
    };
    let start = |views: &ObjectViews, conditions: &conditions::Conditions, work: &mut Workspace| {
        Object::new(prepare(views)?, upright_share(views), conditions, work)
    };
    // Levels and frequencies from all objects, or from evenly spread ones.
    let stride = if count > 2 * SAMPLE { count / SAMPLE } else { 1 };
    let in_sample = count.div_ceil(stride);
    let started = map_indices(in_sample, |k| start(&views_of(k * stride), &first, &mut Workspace::default()));
    let has_fit: Vec<bool> = started.iter().map(Option::is_some).collect();
    let mut scene = SceneFit::new(started.into_iter().flatten().collect(), first, &plan);
    scene.finish();
    let systematic = Systematic::new(&scene.objects, &scene.conditions);
    let reporter = Reporter {
        conditions: &scene.conditions,
        systematic: &systematic,
        reference: reference(&scene.objects, &scene.conditions),
        with_enclosing: context.with_enclosing,
    };
    let place = places_among(&has_fit);
    let estimates = map_indices(count, |k| {
        if context.watch.is_canceled() {
            return Estimate::canceled();
        }
        let (views, mut work) = (views_of(k), Workspace::default());
        let failed = |status| Estimate::failed(views.object_index, views.category_index, status);
        let estimate = if views.views.len() < 2 {
            failed(Status::TooFewViews)
        } else if k % stride == 0 {
            match place[k / stride] {
                Some(place) => reporter.estimate(&scene.objects[place], &views, &mut work),
                None => failed(Status::Degenerate),
            }
        } else {
            let object = start(&views, &scene.conditions, &mut work).map(|mut object| {
                scene.fit_other(&mut object, &mut work);
                object
            });
            object.map_or_else(|| failed(Status::Degenerate), |object| reporter.estimate(&object, &views, &mut work))
        };
        context.watch.advance(1);
        estimate
    });
    let folds = choose_folds(&estimates);
    let predicted = map_indices(folds.len(), |index| {
        if context.watch.stops_before(index) {
            return FoldPrediction::default();
        }
        let Fold { object, views, warm_start } = &folds[index];
        let of_all = (*object % stride == 0).then(|| place[*object / stride]).flatten().map(|k| &scene.objects[k]);
        let fit = |others: ObjectViews| {
            let mut work = Workspace::default();
            let mut rest = start(&others, &scene.conditions, &mut work)?;
            match of_all.filter(|_| *warm_start) {
                Some(whole) => Some(scene.refit_from(whole, &rest.rows, &mut work)),
                None => {
                    scene.fit_other(&mut rest, &mut work);
                    Some(in_world(&rest))
                }
            }
        };
        predict_fold(&views_of(*object), views, options.border_margin, fit)
    });
    let kinds: Vec<BodyKind> = estimates.iter().filter_map(|estimate| Some(estimate.body?.kind)).collect();
    let body = kinds.first().copied().filter(|first| kinds.iter().all(|kind| kind == first));
    let noise = noise_report(&scene, options.pixel_noise_size);
    (SceneSolution { estimates, noise, body, ..SceneSolution::default() }, folds, predicted)
}

/// For each object of the sample its place among those with a fit.
fn places_among(has_fit: &[bool]) -> Vec<Option<usize>> {
    let mut next = 0;
    let place = |has_fit: &bool| {
        has_fit.then(|| {
            next += 1;
            next - 1
        })
    };
    has_fit.iter().map(place).collect()
}

/// The chosen body in the world.
fn in_world(object: &Object) -> Body {
    object.fit().body.in_world(&object.rows.origin, object.rows.unit)
}

/// The noise of an edge has two equal parts at the half size `pixel_noise_size`, relative to the half size and in pixels.
fn noise_report(scene: &SceneFit, pixel_noise_size: f64) -> NoiseModel {
    if scene.objects.is_empty() {
        return NoiseModel::default();
    }
    let [free, occluded] = scene.conditions.noise.map(|sd| sd * std::f64::consts::FRAC_1_SQRT_2);
    let has_occluded = scene.objects.iter().flat_map(|object| &object.rows.views).any(|view| view.two_sided[1] > 0);
    let mut levels = vec![("edge_noise", free), ("edge_noise_px", free * pixel_noise_size)];
    if has_occluded {
        levels.push(("occluded_edge_noise", occluded));
    }
    let weight = scene.conditions.view_weight;
    levels.push(("edge_correlation", (1.0 - weight) / (1.0 + weight)));
    NoiseModel::of_report(levels)
}
