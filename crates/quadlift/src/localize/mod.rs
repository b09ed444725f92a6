//! Objects of a scene: its detections and options in, estimates out.

mod measurement_kind;
mod options;
mod validate;

pub use measurement_kind::MeasurementKind;
pub use options::LocalizeOptions;

use std::sync::Arc;

use crate::cross_validation::{CrossValidation, choose_folds, summarise};
use crate::diagnosis::{Diagnosis, diagnose_refined};
use crate::observer::{Observer, Watch};
use crate::parallel::map_indices;
use crate::scene::{Detection, Scene, SkippedDetections, SourceError};
use crate::solve::map::{MapContext, PosePoints, PoseUnknowns, map};
use crate::solve::plausible::warn_of_implausible_sizes;
use crate::solve::{
    BORDER_MARGIN, BodyKind, CueScale, Estimate, Fold, FoldPrediction, LearntCategorySize, OptionError,
    POSE_NOISE_NAMES, PoseNoise, PosePointsReport, RefinedPose, Sigmas, ViewReport, predict_fold, solve_closed_form,
};

/// Why a scene cannot be localised at all.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum LocalizeError {
    /// The source to take is not clear.
    #[error(transparent)]
    Source(#[from] SourceError),
    /// An option is outside of its range, or does not fit the scene.
    #[error(transparent)]
    Option(#[from] OptionError),
    /// The observer cancelled the work.
    #[error("cancelled")]
    Cancelled,
}

/// The result for a scene.
#[derive(Debug, Clone, Default)]
pub struct Localization {
    /// One estimate per object id of the detections of the chosen source, in the order of the ids.
    pub estimates: Vec<Estimate>,
    /// Skipped detections.
    pub skipped: SkippedDetections,
    /// Noise levels, estimated from the scene's residuals or given ([`crate::solve::Method::Map`] only).
    pub noise: Sigmas,
    /// Root mean square corrections of the poses, where [`crate::solve::MapOptions::pose_noise`] asks for them.
    pub pose_noise: Option<PoseNoise>,
    /// Frames over which the errors of poses last, 0 if those of frames are independent; found by [`crate::solve::PoseMotion::Auto`].
    pub pose_memory: Option<f64>,
    /// Corrections of the poses of the frames that show objects or points, where [`crate::solve::MapOptions::refine_poses`] or
    /// [`crate::solve::MapOptions::pose_noise`] asks for them.
    pub refined_poses: Vec<RefinedPose>,
    /// The points from which poses were corrected beside the objects, if the scene has any.
    pub pose_points: Option<PosePointsReport>,
    /// Scales of the sources of depths and 3D boxes, if there are any and noise levels are not given.
    pub cue_scales: Vec<CueScale>,
    /// Sizes of categories, where [`crate::solve::MapOptions::learn_sizes`] asks for them: one for each category and kind of body.
    pub learnt_sizes: Vec<LearntCategorySize>,
    /// The fitted kind of body, given or selected.
    pub body: Option<BodyKind>,
    /// Cross-validation: how well left-out views are predicted.
    pub cross_validation: CrossValidation,
    /// The self-check, with refined poses where these agree with the boxes. If the scene is inconsistent, objects have the
    /// status [`crate::solve::Status::Inconsistent`] instead of [`crate::solve::Status::Ok`], unless [`LocalizeOptions::accept_inconsistent`] is set.
    pub diagnosis: Diagnosis,
}

impl Localization {
    /// The noise levels by their names in results, pose noise last.
    pub fn noise_levels(&self) -> impl Iterator<Item = (&'static str, f64)> {
        let of_poses = self
            .pose_noise
            .zip(self.pose_memory)
            .map(|(poses, memory)| POSE_NOISE_NAMES.into_iter().zip([poses.rotation_sd, poses.translation_sd, memory]));
        self.noise.levels().chain(of_poses.into_iter().flatten())
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
    let map_options = options.method.map_options();
    if let Some(map_options) = map_options {
        validate::check_up(map_options, scene)?;
    }
    let source = scene.source_index(options.source.as_deref())?;
    let from_source = |d: &Detection| source.is_none() || d.source_index == source;
    let visible = |d: &Detection| {
        let within = |level: Option<f64>, limit: Option<f64>| limit.is_none_or(|l| level.is_none_or(|x| x <= l));
        within(d.occluded, options.max_occluded) && within(d.truncated, options.max_truncated)
    };
    // With a 3D box alone for the refinement only.
    let measured =
        |d: &Detection| d.bounding_box.is_some() || d.ellipse.is_some() || (map_options.is_some() && d.is_measured());
    let usable = |d: &Detection| measured(d) && options.measurements.are_in(d);
    let mut groups = scene.detections_by_object(|d| from_source(d) && visible(d) && usable(d));
    // In the order of the frames, so that neighbours in the list are neighbours in time.
    for group in &mut groups {
        group.sort_by_key(|&index| scene.detections[index as usize].frame_index);
    }
    // The closed forms do not use them.
    let uses_hidden_edges = map_options.is_some_and(|map| map.hidden_edges);
    let hidden = scene.hidden_edges(|d| uses_hidden_edges && from_source(d));
    // Objects of other sources are not listed; objects whose detections are all skipped are.
    let mut named = vec![false; scene.object_ids.len()];
    let mut skipped = SkippedDetections::default();
    for detection in scene.detections.iter().filter(|d| from_source(d)) {
        match detection.object_index {
            None => skipped.without_object += 1,
            Some(object) => {
                named[object as usize] = true;
                skipped.occluded_or_truncated += usize::from(!visible(detection));
                skipped.beyond_lens += usize::from(visible(detection) && !measured(detection));
                let lacks = measured(detection) && !usable(detection);
                skipped.without_measurement += usize::from(visible(detection) && lacks);
            }
        }
    }
    let objects: Vec<usize> = (0..named.len()).filter(|&object| named[object]).collect();
    let watch = Watch::new(observer, objects.len());
    // With a cue, or with a size and the ground, one view is enough for the refinement.
    let fewest = options.min_views.max(if map_options.is_some() { 1 } else { options.method.fewest_views() });
    let views_of = |k: usize| {
        let mut object = scene.object_views(objects[k], &groups[objects[k]]);
        for (view, &detection) in object.views.iter_mut().zip(&groups[objects[k]]) {
            view.hidden_edges = hidden[detection as usize];
        }
        object.views.iter_mut().for_each(|view| options.measurements.keep_only(view));
        // The closed forms use the border as it is; the refinement accounts for detector errors near it.
        if let Some(map_options) = map_options {
            object.views.iter_mut().for_each(|view| *view = view.within_margin(map_options.border_margin));
        }
        if object.views.len() < fewest {
            // Too few views: the solvers return a status.
            object.views.clear();
        }
        object
    };
    let folds_of =
        |estimates: &[Estimate]| choose_folds(estimates, &options.cross_validation, options.method.fewest_views());
    let (mut refined_poses, mut pose_memory, mut points) = (Vec::new(), None, None);
    let (mut cue_scales, mut learnt_sizes) = (Vec::new(), Vec::new());
    let (mut estimates, noise, pose_noise, body, folds, predicted) = if let Some(map_options) = map_options {
        let pose_unknowns = Arc::new(PoseUnknowns::of(&scene.frames, map_options.refine_extrinsics));
        let corrects = map_options.refine_poses.is_some() || map_options.pose_noise.is_some();
        let pose_points =
            if corrects { PosePoints::of(scene, &pose_unknowns, map_options) } else { PosePoints::default() };
        let context = MapContext {
            categories: &scene.categories,
            up: scene.up,
            pose_unknowns,
            pose_points,
            cameras: scene.frames.iter().filter_map(|frame| frame.projection.center_in_world()).collect(),
            seed: options.seed,
            has_cues: scene.detections.iter().any(|d| d.cues.is_some()),
            enclosing_quantile: options.enclosing_quantile,
            options: map_options,
            watch: &watch,
        };
        let solution = map(objects.len(), &views_of, &context, &folds_of);
        (cue_scales, learnt_sizes) = (solution.cue_scales, solution.learnt_sizes);
        (refined_poses, pose_memory) = (solution.refined_poses, solution.pose_memory);
        points = solution.pose_points;
        (solution.estimates, solution.noise, solution.pose_noise, solution.body, solution.folds, solution.predicted)
    } else {
        let solve = |views| solve_closed_form(&views, &options.method, options.enclosing_quantile);
        let estimates = map_indices(objects.len(), |k| {
            if watch.is_cancelled() {
                return Estimate::cancelled();
            }
            let estimate = solve(views_of(k));
            watch.advance(1);
            estimate
        });
        let folds = folds_of(&estimates);
        let predicted = map_indices(folds.len(), |index| {
            if watch.stops_before(index) {
                return FoldPrediction::default();
            }
            let Fold { object, views, .. } = &folds[index];
            predict_fold(&views_of(*object), views, BORDER_MARGIN, |others| solve(others).body)
        });
        (estimates, Sigmas::default(), None, Some(BodyKind::Ellipsoid), folds, predicted)
    };
    if watch.is_cancelled() {
        return Err(LocalizeError::Cancelled);
    }
    let cross_validation = summarise(&estimates, &folds, predicted, &options.cross_validation);
    // The views of objects with too few of them are listed all the same, as not used.
    for (estimate, &object) in estimates.iter_mut().zip(&objects) {
        if estimate.views.is_empty() {
            estimate.views = groups[object]
                .iter()
                .map(|&d| scene.detections[d as usize].frame_index as usize)
                .map(ViewReport::not_used)
                .collect();
        }
    }
    warn_of_implausible_sizes(&mut estimates, &scene.categories, &options.plausible_sizes);
    let is_used = |d: &Detection| from_source(d) && visible(d);
    let mut diagnosis = diagnose_refined(scene, &refined_poses, is_used);
    if let Some(map_options) = map_options {
        diagnosis.check_lengths(scene, is_used, &map_options.priors);
    }
    Ok(Localization {
        estimates,
        skipped,
        noise,
        pose_noise,
        pose_memory,
        refined_poses,
        pose_points: points,
        cue_scales,
        learnt_sizes,
        body,
        cross_validation,
        diagnosis,
    })
}
