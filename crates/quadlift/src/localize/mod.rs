//! Objects of a scene: its detections and options in, estimates out.

mod measurement_kind;
mod options;
mod selection;
mod spread;
mod validate;

pub use measurement_kind::MeasurementKind;
pub use options::LocalizeOptions;

use std::ops::{Deref, DerefMut};
use std::sync::Arc;

use crate::cross_validation::{CrossValidation, choose_folds, summarize};
use crate::diagnosis::{Diagnosis, diagnose_refined};
use crate::geometry::BodyKind;
use crate::observer::{Observer, Watch};
use crate::parallel::map_indices;
use crate::scene::places::Places;
use crate::scene::{Detection, Scene, SkippedDetections, SourceError};
use crate::solve::evidence::estimate;
use crate::solve::plausible::warn_of_implausible_sizes;
use crate::solve::posterior::{CrossValidated, PosePoints, PoseUnknowns, PosteriorContext};
use crate::solve::{
    BORDER_MARGIN, Estimate, Fold, FoldPrediction, OptionError, PosteriorOptions, SceneSolution, ViewReport,
    add_bounds, predict_fold, solve_closed_form,
};
use selection::Selection;
use spread::{sort_objects, spread};

/// Why a scene cannot be localized at all.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum LocalizeError {
    /// The source to take is not clear.
    #[error(transparent)]
    Source(#[from] SourceError),
    /// An option is outside of its range, or does not fit the scene.
    #[error(transparent)]
    Option(#[from] OptionError),
    /// The observer canceled the work.
    #[error("canceled")]
    Canceled,
}

/// Predictions of left-out views from which their mean says something about the scene.
const MIN_PREDICTIONS: usize = 5;

/// The result for a scene: a [`SceneSolution`], whose fields are its own, and what is known about it.
#[derive(Debug, Clone, Default)]
pub struct Localization {
    /// The objects, and what was estimated with them.
    pub solution: SceneSolution,
    /// Skipped detections.
    pub skipped: SkippedDetections,
    /// Cross-validation: how well left-out views are predicted.
    pub cross_validation: CrossValidation,
    /// The consistency check, with refined poses where these agree with the boxes. If the scene is inconsistent, objects have the
    /// status [`crate::solve::Status::Inconsistent`] instead of [`crate::solve::Status::Ok`], unless [`LocalizeOptions::allow_inconsistent`] is set.
    pub diagnosis: Diagnosis,
}

impl Deref for Localization {
    type Target = SceneSolution;

    fn deref(&self) -> &SceneSolution {
        &self.solution
    }
}

impl DerefMut for Localization {
    fn deref_mut(&mut self) -> &mut SceneSolution {
        &mut self.solution
    }
}

/// The fourth step of a run: solves every object with an id in the detections. The diagnosis of the result is that of the detections that
/// are used, with refined poses; [`crate::run::Check`] draws the conclusion.
///
/// # Errors
/// [`LocalizeError`] if the options do not fit the scene, or the observer cancels.
pub(crate) fn solve_objects(
    scene: &Scene,
    options: &LocalizeOptions,
    observer: &dyn Observer,
) -> Result<Localization, LocalizeError> {
    options.validate()?;
    if let Some(posterior_options) = options.method.posterior_options() {
        validate::check_up(posterior_options, scene)?;
    }
    let of_all = Selection::new(scene, options)?;
    let places = Places::of(scene, &of_all.of_source(), true);
    let skipped = of_all.skipped;
    let selection = places.as_ref().map_or(Ok(of_all), |places| Selection::new(&places.scene, options))?;
    let watch = Watch::new(observer, selection.objects.len());
    let (mut solution, folds, predicted) = match options.method.posterior_options() {
        Some(posterior_options) => refined(selection.scene, options, posterior_options, &selection, &watch),
        None => closed_form(options, &selection, &watch),
    };
    if watch.is_canceled() {
        return Err(LocalizeError::Canceled);
    }
    add_bounds(&mut solution, &|k| selection.views_of(k), scene.up.as_ref());
    let cross_validation = summarize(&solution.estimates, &folds, predicted, &options.cross_validation);
    // The views of objects with too few of them are listed all the same, as not used.
    for (k, estimate) in solution.estimates.iter_mut().enumerate().filter(|(_, estimate)| estimate.views.is_empty()) {
        estimate.views = selection.frames_of(k).map(ViewReport::not_used).collect();
    }
    let mut localization = Localization { solution, skipped, cross_validation, diagnosis: Diagnosis::default() };
    if let Some(places) = &places {
        spread(places, scene, &mut localization);
    }
    sort_objects(&mut localization);
    let estimates = &mut localization.estimates;
    warn_of_implausible_sizes(estimates, &scene.categories, &options.plausible_sizes);
    let is_used = |d: &Detection| selection.is_used(d);
    localization.diagnosis = diagnose_refined(scene, &localization.refined_poses, is_used);
    if let Some(posterior_options) = options.method.posterior_options() {
        localization.diagnosis.check_lengths(scene, is_used, &posterior_options.priors);
    }
    let edge_noise =
        ["edge_noise", "ellipse_center"].into_iter().filter_map(|name| localization.noise.get(name)).reduce(f64::max);
    let held_out = &localization.cross_validation;
    let iou = held_out.iou().filter(|_| held_out.predictions().count() >= MIN_PREDICTIONS);
    localization.diagnosis.check_fit(edge_noise, iou);
    Ok(localization)
}

/// Which views are left out.
fn folds_of(estimates: &[Estimate], options: &LocalizeOptions) -> Vec<Fold> {
    choose_folds(estimates, &options.cross_validation, options.method.min_views())
}

/// By the default estimator.
fn refined(
    scene: &Scene,
    options: &LocalizeOptions,
    posterior_options: &PosteriorOptions,
    selection: &Selection,
    watch: &Watch,
) -> CrossValidated {
    let pose_unknowns = Arc::new(PoseUnknowns::of(&scene.frames, posterior_options.refine_extrinsics));
    let corrects = posterior_options.refine_poses.is_some() || posterior_options.pose_noise.is_some();
    let pose_points =
        if corrects { PosePoints::of(scene, &pose_unknowns, posterior_options) } else { PosePoints::default() };
    let context = PosteriorContext {
        categories: &scene.categories,
        up: scene.up,
        pose_unknowns,
        pose_points,
        cameras: scene.frames.iter().filter_map(|frame| frame.projection.center_in_world()).collect(),
        seed: options.seed,
        has_cues: scene.detections.iter().any(|d| d.cues.is_some()),
        with_enclosing: options.enclosing,
        options: posterior_options,
        watch,
    };
    let choose = |estimates: &[Estimate]| folds_of(estimates, options);
    estimate(selection.objects.len(), &|k| selection.views_of(k), &context, &choose)
}

/// By a closed form, object by object.
fn closed_form(options: &LocalizeOptions, selection: &Selection, watch: &Watch) -> CrossValidated {
    let solve = |views| solve_closed_form(&views, &options.method, options.enclosing);
    let estimates = map_indices(selection.objects.len(), |k| {
        if watch.is_canceled() {
            return Estimate::canceled();
        }
        let estimate = solve(selection.views_of(k));
        watch.advance(1);
        estimate
    });
    let folds = folds_of(&estimates, options);
    let predicted = map_indices(folds.len(), |index| {
        if watch.stops_before(index) {
            return FoldPrediction::default();
        }
        let Fold { object, views, .. } = &folds[index];
        predict_fold(&selection.views_of(*object), views, BORDER_MARGIN, |others| solve(others).body)
    });
    (SceneSolution { estimates, body: Some(BodyKind::Ellipsoid), ..SceneSolution::default() }, folds, predicted)
}
