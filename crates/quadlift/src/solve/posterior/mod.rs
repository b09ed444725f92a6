//! Maximum a posteriori refinement: the default estimator (docs/method.md, sections 5 to 12).
//!
//! All objects of a scene are estimated together, because they share noise levels: each kind of measurement error has a
//! standard deviation, estimated from the residuals of the whole scene ([`noise`]). The problem of one object has nine parameters.
//! Levenberg-Marquardt ([`crate::optimize`]) minimizes the residuals of tangent planes and ellipses ([`residuals`]) and the
//! priors ([`object::objective`]).
//!
//! Rounds ([`scene::scene_fit`]): fit every object from its starts with default noise levels; search for outliers if the residuals
//! suggest some ([`object::outliers`]); then alternate between new noise levels and refits until the levels converge.

mod noise;
mod residuals;
pub(super) mod shared;
mod context;
pub(crate) mod object;
mod scene;

pub(crate) use self::context::PosteriorContext;
use self::scene::body_selection::BodyKinds;
use self::scene::scene_fit::SceneFit;
use self::shared::found_scales::FoundScale;
pub(crate) use self::shared::pose_points::PosePoints;
pub(crate) use self::shared::pose_unknowns::PoseUnknowns;
use super::estimate::Estimate;
use super::prediction::{Fold, FoldPrediction, predict_fold};
use super::scene_solution::SceneSolution;
use crate::geometry::BodyKind;
use crate::parallel::map_indices;
use crate::scene::ObjectViews;

/// Maximum number of objects for the estimate of the noise levels, evenly spread.
const NOISE_SAMPLE: usize = 2000;

/// A solution, with the chosen folds and the predictions of their left-out views from the others.
pub(crate) type CrossValidated = (SceneSolution, Vec<Fold>, Vec<FoldPrediction>);

/// Chooses which views of which objects are left out, one fit per fold, after the estimates.
pub(crate) type ChooseFolds<'a> = &'a (dyn Fn(&[Estimate]) -> Vec<Fold> + Sync);

/// Solves for `count` objects; `views_of` gathers the views of one, on demand and from any thread. Each finished object
/// is a step for the observer; if it cancels, the result is meaningless.
///
/// The views of each fold are then left out, the object is fitted again to the others, from its starts or from where
/// the fit to all views ended ([`Fold::warm_start`]), and its views are predicted. Data shared by the objects stays as
/// estimated from all views: noise levels, ground plane, corrections of the poses of the remaining views, and the kind
/// of body.
pub(crate) fn posterior(
    count: usize,
    views_of: &(dyn Fn(usize) -> ObjectViews + Sync),
    context: &PosteriorContext,
    folds: ChooseFolds,
) -> CrossValidated {
    let options = context.options;
    let stride = count.div_ceil(NOISE_SAMPLE).max(1);
    let sample: Vec<usize> = (0..count).step_by(stride).collect();
    let fitted = |body_kinds: &[BodyKind]| SceneFit::fit(body_kinds, &|k| views_of(sample[k]), context);
    // Without shared unknowns, each object is fitted independently.
    let apart = options.noise_model.is_some() && !context.has_shared_unknowns();
    let together = |body_kinds: &[BodyKind]| fitted(if apart { &[] } else { body_kinds });
    let (scene, body_kinds) = match options.body {
        Some(body) => (together(&vec![body; sample.len()]), BodyKinds::given(body, sample.len())),
        None => {
            let first: Vec<BodyKind> = sample.iter().map(|k| context.first_kind(&views_of(*k))).collect();
            let scene = fitted(&first);
            let noise = scene.noise_of_independent_views(context);
            let body_kinds = BodyKinds::among(&scene.fit_of_each(), first.clone(), noise, context);
            let as_they_are = !apart && body_kinds.of_each() == first;
            (if as_they_are { scene } else { together(body_kinds.of_each()) }, body_kinds)
        }
    };
    let scene = scene.with_upright(context).with_learned_sizes(context);
    let pose_points = scene.pose_points(context);
    if let Some(pose_points) = pose_points.and_then(PosePoints::left_out) {
        return posterior(count, views_of, &PosteriorContext { pose_points, ..context.clone() }, folds);
    }
    let kind_of = |index: usize| match body_kinds.of_each().get(index / stride) {
        Some(kind) if index.is_multiple_of(stride) => *kind,
        _ => body_kinds.of_all().unwrap_or_else(|| scene.kind_of_other(views_of(index), &body_kinds, context)),
    };
    let estimates = map_indices(count, |index| {
        if context.watch.is_canceled() {
            return Estimate::canceled();
        }
        let estimate = if index % stride == 0 && index / stride < scene.len() {
            scene.estimate(index / stride, context)
        } else {
            scene.estimate_other(views_of(index), kind_of(index), context)
        };
        context.watch.advance(1);
        estimate
    });
    let folds = folds(&estimates);
    let predicted = map_indices(folds.len(), |index| {
        if context.watch.stops_before(index) {
            return FoldPrediction::default();
        }
        let Fold { object, views, warm_start } = &folds[index];
        let whole = &estimates[*object];
        let start = whole.body.filter(|_| *warm_start);
        let outliers = whole.views.iter().any(|view| !view.inlier);
        let fit = |others: ObjectViews| match start {
            Some(start) => scene.body_from(others, &start, outliers, context),
            None => scene.body_of_other(others, kind_of(*object), context),
        };
        predict_fold(&views_of(*object), views, options.border_margin, fit)
    });
    let (noise, pose_noise) = (scene.noise_report(context), scene.pose_noise());
    let cue_scales = scene.scales().found().filter_map(FoundScale::report).collect();
    let learned_sizes = scene.sizes().report();
    let solution = SceneSolution {
        estimates,
        noise,
        pose_noise,
        pose_correlation_length: scene.pose_correlation_length(),
        refined_poses: scene.refined_poses(),
        pose_points,
        cue_scales,
        learned_sizes,
        body: body_kinds.of_all(),
    };
    (solution, folds, predicted)
}
