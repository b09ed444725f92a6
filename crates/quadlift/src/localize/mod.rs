//! The one call: a scene and options in, estimates out.

mod check;

use std::sync::atomic::{AtomicUsize, Ordering};

use crate::cross_validation::{CrossValidation, CrossValidationOptions, choose_folds, summarise};
use crate::diagnose::{Diagnosis, diagnose};
use crate::parallel::map_indices;
use crate::scene::{BORDER_TOLERANCE_PX, Detection, Scene, SourceError, View};
use crate::solve::map::{MapContext, map};
use crate::solve::plausible::warn_of_implausible_sizes;
use crate::solve::{
    BodyKind, CategoryPriors, Estimate, Fold, MapOptions, Method, RegOptions, Status, ViewReport, predict_fold,
    solve_closed_form,
};

/// Which of a detection's measurements are used.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum MeasurementKind {
    /// What the detection has. Of one with box and ellipse `map` takes place and size from the box's edges and the shape
    /// from the ellipse; `planes` takes the box, `lfd`, `pfd` and `reg` take the ellipse.
    #[default]
    Auto,
    /// The box; detections without one take no part.
    Box,
    /// The ellipse; detections without one take no part.
    Ellipse,
    /// Box and ellipse, as with `Auto`; detections that lack one of them take no part.
    BoxAndEllipse,
    /// The supporting lines of the mask, in the place of the box's edges, with `map` and `planes`; detections without
    /// any ([`Detection::support_lines`]) take no part.
    Mask,
}

impl MeasurementKind {
    /// Whether a detection has what is used.
    fn are_in(self, detection: &Detection) -> bool {
        match self {
            Self::Auto => true,
            Self::Box => detection.bounding_box.is_some(),
            Self::Ellipse => detection.ellipse.is_some(),
            Self::BoxAndEllipse => detection.bounding_box.is_some() && detection.ellipse.is_some(),
            Self::Mask => detection.support_lines.as_deref().is_some_and(|lines| lines.bounding_box().is_some()),
        }
    }

    /// Removes from a view what is not used.
    fn keep_only(self, view: &mut View) {
        if self != Self::Mask {
            view.support_lines = None;
        }
        match self {
            Self::Auto | Self::BoxAndEllipse => {}
            Self::Box => view.ellipse = None,
            Self::Ellipse => view.bounding_box = None,
            Self::Mask => {
                view.ellipse = None;
                view.bounding_box = view.support_lines.and_then(|lines| lines.bounding_box());
            }
        }
    }
}

/// Everything that can be chosen.
#[derive(Debug, Clone, Default)]
pub struct Options {
    /// Which estimator.
    pub method: Method,
    /// Take the detections of this source only; needed when the scene has several.
    pub source: Option<String>,
    /// Objects with fewer views get the status `too_few_views` (never below what the method needs).
    pub min_views: usize,
    /// Leave out detections with a higher occlusion level.
    pub max_occluded: Option<f64>,
    /// Leave out detections with a higher truncation level.
    pub max_truncated: Option<f64>,
    /// Which of a detection's measurements are used.
    pub measurements: MeasurementKind,
    /// Report objects of a scene that does not agree with itself (see [`crate::diagnose`]) as if it did; otherwise
    /// none of them is [`Status::Ok`].
    pub accept_inconsistent: bool,
    /// Sizes that categories have: an object that is much longer or shorter than all of its category gets a warning
    /// ([`crate::solve::Warning::ImplausibleSize`]). No estimate depends on them; the priors of [`MapOptions`] do more.
    pub plausible_sizes: CategoryPriors,
    /// Seed of everything that is drawn at random.
    pub seed: u64,
    /// Options of [`Method::Map`].
    pub map: MapOptions,
    /// Options of [`Method::Reg`].
    pub reg: RegOptions,
    /// How much is cross-validated, and how.
    pub cross_validation: CrossValidationOptions,
}

/// Why a scene cannot be localised at all.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum LocalizeError {
    /// The source to take is not clear.
    #[error(transparent)]
    Source(#[from] SourceError),
    /// An option is outside of its range.
    #[error("{0}")]
    Option(String),
}

/// Detections that took no part, by reason.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct LeftOut {
    /// They name no object (see [`crate::associate()`]).
    pub without_object: usize,
    /// Their occlusion or truncation level is too high.
    pub occluded_or_truncated: usize,
    /// They lie where the lens cannot be undistorted, see [`crate::geometry::Camera::undistort_point`].
    pub beyond_lens: usize,
    /// They lack what is used of detections, see [`Options::measurements`].
    pub without_measurement: usize,
}

/// The result for a scene.
#[derive(Debug, Clone, Default)]
pub struct Localization {
    /// One estimate for each object id that a detection of the chosen source names, in the order of the ids.
    pub estimates: Vec<Estimate>,
    /// Detections that took no part.
    pub left_out: LeftOut,
    /// Noise levels that the scene's residuals show, by name (relative to the detection's half size; radians for angles).
    pub noise: Vec<(&'static str, f64)>,
    /// The kind of body that was fitted: the one that was asked for, or the one that was chosen.
    pub body: Option<BodyKind>,
    /// How well the views of an object predict those that were left out.
    pub cross_validation: CrossValidation,
    /// Whether the scene agrees with itself. Where it does not, objects have the status [`Status::Inconsistent`] instead
    /// of [`Status::Ok`], unless [`Options::accept_inconsistent`] is set.
    pub diagnosis: Diagnosis,
}

/// Called with the number of objects done and their total, from any thread.
pub type Progress<'a> = &'a (dyn Fn(usize, usize) + Sync);

/// Localises every object that the detections name.
///
/// # Errors
/// [`LocalizeError`] when the options do not fit the scene; a single object that cannot be solved is a
/// [`crate::solve::Status`] instead.
pub fn localize(scene: &Scene, options: &Options, progress: Progress) -> Result<Localization, LocalizeError> {
    check::check(options, scene)?;
    let source = scene.source_index(options.source.as_deref())?;
    let from_source = |d: &Detection| source.is_none() || d.source_index == source;
    let visible = |d: &Detection| {
        let within = |level: Option<f64>, limit: Option<f64>| limit.is_none_or(|l| level.is_none_or(|x| x <= l));
        within(d.occluded, options.max_occluded) && within(d.truncated, options.max_truncated)
    };
    let measured = |d: &Detection| d.bounding_box.is_some() || d.ellipse.is_some();
    let usable = |d: &Detection| measured(d) && options.measurements.are_in(d);
    let mut groups = scene.detections_by_object(|d| from_source(d) && visible(d) && usable(d));
    // In the order of the frames, so that neighbours in the list are neighbours in time.
    for group in &mut groups {
        group.sort_by_key(|&index| scene.detections[index as usize].frame_index);
    }
    // The closed forms do not look at them.
    let uses_hidden_edges = options.method == Method::Map && options.map.hidden_edges;
    let hidden = scene.hidden_edges(|d| uses_hidden_edges && from_source(d));
    // Objects that only other sources name are not listed; those whose detections are all left out are.
    let mut named = vec![false; scene.object_ids.len()];
    let mut left_out = LeftOut::default();
    for detection in scene.detections.iter().filter(|d| from_source(d)) {
        match detection.object_index {
            None => left_out.without_object += 1,
            Some(object) => {
                named[object as usize] = true;
                left_out.occluded_or_truncated += usize::from(!visible(detection));
                left_out.beyond_lens += usize::from(visible(detection) && !measured(detection));
                let lacks = measured(detection) && !usable(detection);
                left_out.without_measurement += usize::from(visible(detection) && lacks);
            }
        }
    }
    let objects: Vec<usize> = (0..named.len()).filter(|&object| named[object]).collect();
    let done = AtomicUsize::new(0);
    let report = || progress(done.fetch_add(1, Ordering::Relaxed) + 1, objects.len());
    let fewest = options.min_views.max(options.method.fewest_views());
    let views_of = |k: usize| {
        let mut object = scene.object_views(objects[k], &groups[objects[k]]);
        for (view, &detection) in object.views.iter_mut().zip(&groups[objects[k]]) {
            view.hidden_edges = hidden[detection as usize];
        }
        object.views.iter_mut().for_each(|view| options.measurements.keep_only(view));
        // The closed forms keep the border as it is; the refinement knows that detectors are wrong near it.
        if options.method == Method::Map {
            for view in &mut object.views {
                let margin = view.image_size.map_or(0.0, |size| options.map.border_margin * size.max());
                *view = view.with_cut_off_edges(margin.max(BORDER_TOLERANCE_PX));
            }
        }
        if object.views.len() < fewest {
            // Too few to be asked for: the solvers answer with a status.
            object.views.clear();
        }
        object
    };
    let folds_of =
        |estimates: &[Estimate]| choose_folds(estimates, &options.cross_validation, options.method.fewest_views());
    let (mut estimates, noise, body, folds, predicted) = if options.method == Method::Map {
        let cameras = scene.frames.iter().filter_map(|frame| frame.projection.center_in_world()).collect();
        let context = MapContext::new(&scene.categories, scene.up, cameras, options.seed, &options.map);
        let solution = map(objects.len(), &views_of, &context, &folds_of, &report);
        (solution.estimates, solution.noise, solution.body, solution.folds, solution.predicted)
    } else {
        let solve = |views| solve_closed_form(&views, options.method, &options.reg, options.map.enclosing_quantile);
        let estimates = map_indices(objects.len(), |k| {
            let estimate = solve(views_of(k));
            report();
            estimate
        });
        let folds = folds_of(&estimates);
        let predicted = map_indices(folds.len(), |index| {
            let Fold { object, views, .. } = &folds[index];
            predict_fold(&views_of(*object), views, options.map.border_margin, |others| solve(others).body)
        });
        (estimates, Vec::new(), Some(BodyKind::Ellipsoid), folds, predicted)
    };
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
    let mut diagnosis = diagnose(scene, is_used);
    diagnosis.check_lengths(scene, is_used, &options.map.priors);
    if !diagnosis.consistent && !options.accept_inconsistent {
        estimates.iter_mut().filter(|e| e.status == Status::Ok).for_each(|e| e.status = Status::Inconsistent);
    }
    Ok(Localization { estimates, left_out, noise, body, cross_validation, diagnosis })
}
