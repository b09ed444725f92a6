//! All objects of a scene together: rounds of noise levels, ground plane and refits, until they agree.

use crate::optimize::median::median;
use crate::tuning::{CLEAR, UPRIGHT_SHARE};
use std::sync::Arc;

use super::body_selection::BodyKinds;
use super::learned_sizes::SceneSizes;
use super::scene_scales::step_scales;
use super::upright::{share_of_upright, stands, was_upright};
use crate::body_model::BodyModel;
use crate::body_model::ellipsoid::EllipsoidModel;
use crate::geometry::{Body, BodyKind};
use crate::parallel::map_indices;
use crate::scene::{Cues, ObjectViews};
use crate::solve::estimate::{Estimate, GoodnessOfFit};
use crate::solve::noise_model::NoiseModel;
use crate::solve::options::PoseNoise;
use crate::solve::pose_points_report::PosePointsReport;
use crate::solve::posterior::context::PosteriorContext;
use crate::solve::posterior::noise::common_errors::CommonStatistics;
use crate::solve::posterior::noise::levels::{CovarianceLevels, NoiseLevels};
use crate::solve::posterior::noise::object_spread::Spread;
use crate::solve::posterior::noise::statistics::NoiseStatistics;
use crate::solve::posterior::object::agreement::{Reference, is_inconsistent, median_level};
use crate::solve::posterior::object::fit::Fit;
use crate::solve::posterior::object::model::Model;
use crate::solve::posterior::object::objective::OUTLIER_SCALE;
use crate::solve::posterior::object::problem::ObjectProblem;
use crate::solve::posterior::residuals::cues::weights;
use crate::solve::posterior::shared::SharedErrors;
use crate::solve::posterior::shared::cue_scales::{CueScales, Ratios};
use crate::solve::posterior::shared::ground::GroundPlane;
use crate::solve::posterior::shared::pose_prior::PosePrior;
use crate::solve::posterior::shared::pose_terms::SceneTerms;
use crate::solve::posterior::shared::poses::PoseCorrections;
use crate::solve::posterior::shared::size_model::SizeInformation;
use crate::solve::refined_pose::RefinedPose;

/// Rounds of noise estimation, at most.
const ROUNDS: usize = 8;

/// Rounds in which fits that do not agree with the scene's noise are looked at again for outliers.
const RETRY_ROUNDS: usize = 4;

/// Rounds that what the objects share (ground plane, poses) and the objects take to agree.
const SHARED_ROUNDS: usize = 4;

/// Relative change of every noise level below which they stand.
const LEVEL_TOLERANCE: f64 = 0.02;

/// Share of an object's parameters that its measurements determine, on average, below which the noise levels may have
/// settled where the priors speak for the data: then they are sought from small noise as well.
const WELL_DETERMINED: f64 = 0.9;

/// Change (of the logarithm) of a noise level after which poorly determined objects are fitted from their starts again.
const RESTART_CHANGE: f64 = 0.7;

/// The small noise, relative to the default.
const SMALL_NOISE_FACTOR: f64 = 0.05;

/// The same where sizes of categories are learned: detectors are not more exact than that against the usual level, and a body that
/// follows two boxes leaves residuals that show less noise than there is.
const MIN_LEVEL: f64 = 0.3;

/// Largest standard deviation of an object's distance from its nearest camera, relative to that, with which it tells a scale.
const MAX_RELATIVE_DISTANCE_SD: f64 = 0.1;

/// Pairs of views, over all objects, from which errors that they have in common are estimated; with at least
/// [`COMMON_SAMPLE`] objects.
const COMMON_PAIRS: usize = 5000;
const COMMON_SAMPLE: usize = 24;

/// The fitted objects of a scene with their shared unknowns.
pub(crate) struct SceneFit {
    fits: Vec<Result<Fit, Box<Estimate>>>,
    noise: NoiseLevels,
    statistics: NoiseStatistics,
    /// The reference for the normalized residuals of objects.
    reference: Reference,
    ground: Option<GroundPlane>,
    poses: PoseCorrections,
    scales: CueScales,
    /// Learned sizes of categories.
    pub(super) sizes: SceneSizes,
    /// Fraction of upright objects.
    upright_share: f64,
}

impl SceneFit {
    /// The same with those objects upright that stand.
    pub(crate) fn with_upright(mut self, context: &PosteriorContext) -> Self {
        if !context.options.upright {
            return self;
        }
        let standing = |k: usize| self.fits[k].as_ref().ok()?.standing(&self.noise, context);
        let standing = map_indices(self.fits.len(), standing);
        let log_odds: Vec<f64> = standing.iter().flatten().map(|(_, log_odds)| *log_odds).collect();
        self.upright_share = share_of_upright(&log_odds);
        let mut changed = false;
        for (fit, standing) in self.fits.iter_mut().zip(standing) {
            if let Some((upright, _)) = standing.filter(|(_, log_odds)| stands(*log_odds, self.upright_share)) {
                *fit = Ok(upright);
                changed = true;
            }
        }
        if changed { self.alternate_until_converged(context) } else { self }
    }

    /// Fits one object for each of these kinds, that nothing makes upright but priors of categories.
    ///
    /// Noise levels and fits that agree are not unique where the priors have a say: with large noise the fits follow the
    /// priors and leave residuals that look like noise. Of two such ends the one with the larger evidence is taken.
    pub(crate) fn fit(
        body_kinds: &[BodyKind],
        views_of: &(dyn Fn(usize) -> ObjectViews + Sync),
        context: &PosteriorContext,
    ) -> Self {
        let pixel_size = context.options.pixel_noise_size;
        let none = CueScales::default();
        if let Some(noise_model) = &context.options.noise_model {
            return Self::fit_from(body_kinds, views_of, NoiseLevels::given(noise_model, pixel_size), none, context);
        }
        let cues = || (0..body_kinds.len()).flat_map(|k| views_of(k).views).flat_map(|view| weights(view.cues));
        let default =
            if context.has_cues { NoiseLevels::of_weights(pixel_size, cues()) } else { NoiseLevels::new(pixel_size) };
        let scales = Self::first_scales(body_kinds, views_of, default, context).unwrap_or(none);
        let scene = Self::fit_from(body_kinds, views_of, default, scales.clone(), context);
        if scene.statistics.determined() > WELL_DETERMINED {
            return scene;
        }
        let other = Self::fit_from(body_kinds, views_of, default.scaled(SMALL_NOISE_FACTOR), scales, context);
        if other.evidence_over(&scene) > CLEAR { other } else { scene }
    }

    /// The scales of cues that boxes alone show; `None` without cues.
    fn first_scales(
        body_kinds: &[BodyKind],
        views_of: &(dyn Fn(usize) -> ObjectViews + Sync),
        noise: NoiseLevels,
        context: &PosteriorContext,
    ) -> Option<CueScales> {
        if !context.has_cues {
            return None;
        }
        let without_cues = |k: usize| {
            let mut views = views_of(k);
            views.views.iter_mut().for_each(|view| view.cues = Cues::default());
            views
        };
        let boxes = Self::fit_from(body_kinds, &without_cues, noise, CueScales::default(), context);
        let mut ratios = Ratios::default();
        for (k, fit) in boxes.fits.iter().enumerate() {
            // Where boxes leave the distance open they do not tell a scale.
            let Ok(fit) = fit else { continue };
            if fit.relative_distance_sd().is_some_and(|sd| sd < MAX_RELATIVE_DISTANCE_SD) {
                fit.ratios(&views_of(k).views, &boxes.noise, &mut ratios);
            }
        }
        Some(CueScales::of_medians(ratios))
    }

    /// Alternates fits and noise levels until convergence; with given levels, until the fits converge.
    fn fit_from(
        body_kinds: &[BodyKind],
        views_of: &(dyn Fn(usize) -> ObjectViews + Sync),
        noise: NoiseLevels,
        scales: CueScales,
        context: &PosteriorContext,
    ) -> Self {
        let fits = map_indices(body_kinds.len(), |k| {
            if context.watch.stops_before(k) {
                return Err(Box::new(Estimate::canceled()));
            }
            let mut views = views_of(k);
            scales.apply(&mut views);
            Fit::first(ObjectProblem::new(views, body_kinds[k], context)?, &noise, context)
        });
        let statistics = NoiseStatistics::default();
        let reference = Reference::among(&noise, std::iter::empty(), context.options);
        let poses = PoseCorrections::default();
        let upright_share = UPRIGHT_SHARE.get();
        let (ground, sizes) = (None, SceneSizes::default());
        Self { fits, noise, statistics, reference, ground, poses, scales, sizes, upright_share }
            .alternate_until_converged(context)
    }

    /// Rounds of noise levels and refits, from these fits and levels.
    pub(super) fn alternate_until_converged(self, context: &PosteriorContext) -> Self {
        let Self { mut fits, mut noise, mut statistics, mut ground, mut poses, mut scales, .. } = self;
        let mut started = noise;
        let pose_prior = PosePrior::new(context.options, &context.pose_unknowns, || median_distance(&fits));
        let (mut round, mut follows) = (0, false);
        while round < ROUNDS && !context.watch.is_canceled() {
            statistics = NoiseStatistics::default();
            // Summed in the order of the objects, so that the result does not depend on the number of threads.
            let goodness: Vec<Option<GoodnessOfFit>> =
                fits.iter().flatten().map(|fit| fit.goodness_of_fit(&noise)).collect();
            let reference = Reference::among(&noise, goodness.iter().copied().flatten(), context.options);
            for (fit, goodness_of_fit) in fits.iter().flatten().zip(goodness) {
                // False boxes that could not be rejected must not affect the noise levels.
                if goodness_of_fit.is_none_or(|goodness_of_fit| !is_inconsistent(&reference.against(goodness_of_fit))) {
                    statistics.merge(&fit.statistics(&noise, context));
                }
            }
            statistics.take(poses.determined());
            let updated = if context.options.noise_model.is_some() { noise } else { noise.updated(&statistics) };
            let settled = updated.change(&noise, &statistics) < LEVEL_TOLERANCE;
            noise = updated;
            ground = ground_plane(&fits, context);
            if let (Some(ground), Some(up)) = (&ground, &context.up) {
                for (k, fit) in fits.iter_mut().enumerate() {
                    if let Ok(fit) = fit {
                        fit.stand_on_ground(Some(k), ground, up);
                    }
                }
            }
            // Poses would follow what the objects have not yet.
            let as_given = poses.is_empty();
            // Poses as given are looked at when the noise is about known, and when it is known.
            let looks = !as_given || settled || round == 1 || round + 1 == ROUNDS;
            let corrects = |prior: &&PosePrior| round > 0 && (looks || !prior.may_be_exact);
            let moved = pose_prior.as_ref().filter(corrects).map(|prior| {
                let terms = map_indices(fits.len(), |k| fits[k].as_ref().ok().and_then(|fit| fit.pose_terms(&noise)));
                let objects = terms.into_iter().flatten().collect();
                let points = context.pose_points.terms(&poses);
                poses.update(SceneTerms { objects, points }, prior)
            });
            let moved = moved.filter(|moved| !moved.is_empty());
            // The objects then follow the cameras, once.
            if as_given && !poses.is_empty() && !follows {
                (round, follows) = (1, true);
            }
            let cues = step_scales(&mut fits, &mut scales, &noise, context);
            if let Some(moved) = &moved {
                for fit in fits.iter_mut().flatten() {
                    fit.problem = Arc::new(fit.problem.with_corrected_cameras(moved));
                }
            }
            let restart =
                statistics.determined() < WELL_DETERMINED && noise.change(&started, &statistics) > RESTART_CHANGE;
            if restart {
                started = noise;
            }
            fits = map_indices(fits.len(), |k| {
                let fit = fits[k].as_ref().map_err(Clone::clone)?;
                if context.watch.stops_before(k) {
                    return Ok(fit.clone());
                }
                // Now that the noise of the scene is known, a fit with much larger residuals stands out.
                let fit = if round < RETRY_ROUNDS {
                    fit.retry_starts_and_outliers(&noise, round, context)
                } else {
                    fit.refined(&noise, false)
                };
                Ok(if restart { fit.restarted(&noise) } else { fit })
            });
            let shared = ground.is_some() || !poses.is_empty() || cues;
            if settled && (!shared || round >= SHARED_ROUNDS) {
                break;
            }
            round += 1;
        }
        let goodness = fits.iter().flatten().filter_map(|fit| fit.goodness_of_fit(&noise));
        let reference = Reference::among(&noise, goodness, context.options).clamped_to_noise(&noise);
        if context.options.noise_model.is_none() && context.options.common_errors {
            noise = noise.with_covariance_levels(covariance_levels(&fits, &noise));
        }
        Self { fits, noise, statistics, reference, ground, poses, scales, ..self }
    }

    /// What the measurements of an object tell about its size; `None` where they contradict each other.
    pub(super) fn size_information(&self, index: usize, context: &PosteriorContext) -> Option<SizeInformation> {
        let fit = self.fits[index].as_ref().ok()?;
        let level = self.size_level();
        let consistent =
            fit.goodness_of_fit(&self.noise).is_none_or(|found| !is_inconsistent(&self.reference.against(found)));
        let covariance = fit.local_covariance(&self.noise, self.shared(), context).filter(|_| consistent)?;
        let told = fit.size_information(&covariance, context)?;
        Some(told.scaled(1.0 / (level * level)))
    }

    /// What the residuals show of the noise, at most all of it: in few views the levels are drawn towards the default, and
    /// beside measurements that seem noisier than they are a prior would count too much.
    fn size_level(&self) -> f64 {
        median_level(self.fits().filter_map(|fit| fit.goodness_of_fit(&self.noise))).clamp(MIN_LEVEL, 1.0)
    }

    /// The same with sizes of categories learned from the objects, if that is asked for.
    pub(crate) fn with_learned_sizes(mut self, context: &PosteriorContext) -> Self {
        if !context.options.learn_sizes || context.watch.is_canceled() {
            return self;
        }
        let told = map_indices(self.len(), |k| self.size_information(k, context));
        let objects: Vec<(usize, &Fit, SizeInformation)> = self
            .fit_of_each()
            .into_iter()
            .zip(told)
            .filter_map(|(fit, told)| fit.zip(told))
            .map(|(fit, told)| (fit.problem.views.object_index, fit, told))
            .collect();
        let sizes = SceneSizes::learn(&objects, context);
        if sizes.are_none() {
            self.sizes = sizes;
            return self;
        }
        self.with_sizes(sizes, context).alternate_until_converged(context)
    }

    /// The fits of the objects with these sizes, before the noise levels are estimated again.
    pub(super) fn with_sizes(mut self, sizes: SceneSizes, context: &PosteriorContext) -> Self {
        let level = self.size_level();
        let sized = |k: usize| {
            let fit = self.fits[k].as_ref().map_err(Clone::clone)?;
            Ok(sizes.of(fit).map_or_else(
                || fit.without_learned_size(context),
                |size| fit.with_learned_size(size, level, &self.noise, self.shared(), context),
            ))
        };
        let fits = map_indices(self.fits.len(), sized);
        (self.fits, self.sizes) = (fits, sizes);
        self
    }

    /// What the objects share whose errors are part of their covariances.
    fn shared(&self) -> SharedErrors<'_> {
        SharedErrors { scales: &self.scales, poses: &self.poses }
    }

    /// Number of the objects.
    pub(crate) fn len(&self) -> usize {
        self.fits.len()
    }

    /// Logarithm of the evidence for the noise levels against those of another fit to the same objects, over the objects
    /// whose normal equations are regular in both.
    fn evidence_over(&self, other: &Self) -> f64 {
        let evidence = |scene: &Self, index: usize| scene.fits[index].as_ref().ok()?.evidence(&scene.noise);
        (0..self.fits.len()).filter_map(|k| Some(evidence(self, k)? - evidence(other, k)?)).sum()
    }

    /// The fitted objects.
    pub(crate) fn fits(&self) -> impl Iterator<Item = &Fit> {
        self.fits.iter().flatten()
    }

    /// The fit of each object, if it has one.
    pub(crate) fn fit_of_each(&self) -> Vec<Option<&Fit>> {
        self.fits.iter().map(|fit| fit.as_ref().ok()).collect()
    }

    /// The noise levels that the same residuals show when views are taken as independent; those that were given.
    pub(crate) fn noise_of_independent_views(&self, context: &PosteriorContext) -> NoiseLevels {
        let noise = self.noise.uncorrelated();
        if context.options.noise_model.is_some() { noise } else { noise.updated(&self.statistics).uncorrelated() }
    }

    /// The estimate of a fitted object.
    pub(crate) fn estimate(&self, index: usize, context: &PosteriorContext) -> Estimate {
        match &self.fits[index] {
            Ok(fit) => {
                self.polish(Some(index), fit, context).estimate(&self.noise, self.reference, self.shared(), context)
            }
            Err(failed) => (**failed).clone(),
        }
    }

    /// The estimate of another object of the scene.
    pub(crate) fn estimate_other(&self, views: ObjectViews, kind: BodyKind, context: &PosteriorContext) -> Estimate {
        self.fit_held_out(views, kind, context)
            .map_or_else(|failed| *failed, |fit| fit.estimate(&self.noise, self.reference, self.shared(), context))
    }

    /// The body of another object of the scene, in the world.
    pub(crate) fn body_of_other(&self, views: ObjectViews, kind: BodyKind, context: &PosteriorContext) -> Option<Body> {
        let fit = self.fit_held_out(views, kind, context).ok()?;
        Some(fit.body.body_in_world(&fit.problem.measurements.frame))
    }

    /// The body, in the world, that an object's views give from where an earlier fit to more views ended. `outliers` says
    /// whether some of them may be wrong.
    pub(crate) fn body_from(
        &self,
        mut views: ObjectViews,
        start: &Body,
        outliers: bool,
        context: &PosteriorContext,
    ) -> Option<Body> {
        self.poses.apply(&mut views);
        self.scales.apply(&mut views);
        let mut problem = ObjectProblem::new(views, start.kind, context).ok()?;
        let frame = problem.measurements.frame;
        let body = Model::of_body(start, &frame);
        if let Some(up) = context.up.filter(|up| {
            context.options.upright
                && problem.prior.log_size.is_none()
                && was_upright(&body, &frame.direction_from_world(up))
        }) {
            problem = problem.standing(&up);
        }
        let outlier_scale = outliers.then_some(OUTLIER_SCALE);
        let equations = problem.objective(&self.noise, outlier_scale).linearize(&body)?;
        let ellipsoid = EllipsoidModel::from_axes(*body.center(), *body.axes(), body.semi_axes());
        let mut fit = Fit {
            problem: Arc::new(problem),
            ellipsoid,
            body,
            equations,
            outlier_scale,
            ground: None,
            converged: false,
        };
        self.constrain_to_plane(None, &mut fit, context);
        // The level takes all objects: only where it is needed.
        if let Some(size) = self.sizes.of(&fit) {
            fit = fit.with_learned_size(size, self.size_level(), &self.noise, self.shared(), context);
        }
        Some(fit.refined(&self.noise, true).body.body_in_world(&frame))
    }

    /// The kind of body of another object of the scene.
    pub(crate) fn kind_of_other(
        &self,
        views: ObjectViews,
        body_kinds: &BodyKinds,
        context: &PosteriorContext,
    ) -> BodyKind {
        let first = context.first_kind(&views);
        self.fit_held_out(views, first, context).map_or(first, |fit| body_kinds.of_other(&fit, context))
    }

    /// Another object of the scene, fitted from its starts under what the scene shares.
    fn fit_held_out(
        &self,
        mut views: ObjectViews,
        kind: BodyKind,
        context: &PosteriorContext,
    ) -> Result<Fit, Box<Estimate>> {
        self.poses.apply(&mut views);
        self.scales.apply(&mut views);
        let mut fit = Fit::first(ObjectProblem::new(views, kind, context)?, &self.noise, context)?;
        self.constrain_to_plane(None, &mut fit, context);
        let rounds = if fit.problem.has_several_starts() { RETRY_ROUNDS } else { 1 };
        let retry_starts_and_outliers =
            |fit: Fit| (0..rounds).fold(fit, |fit, round| fit.retry_starts_and_outliers(&self.noise, round, context));
        let fit = retry_starts_and_outliers(fit);
        let upright = fit.standing(&self.noise, context).filter(|(_, log_odds)| stands(*log_odds, self.upright_share));
        let fit = upright.map_or(fit, |(upright, _)| retry_starts_and_outliers(upright));
        let fit = match self.sizes.of(&fit) {
            Some(size) => {
                let level = self.size_level();
                retry_starts_and_outliers(fit.with_learned_size(size, level, &self.noise, self.shared(), context))
            }
            None => fit,
        };
        Ok(self.polish(None, &fit, context))
    }

    /// A fit that has been through the rounds, to the end: without the views that contradict the others. `object` is its
    /// index, if it was in the rounds.
    fn polish(&self, object: Option<usize>, fit: &Fit, context: &PosteriorContext) -> Fit {
        let mut fit = fit.refined(&self.noise, true);
        if let Some(mut without) = fit.reject_one_of_few_views(&self.noise, self.reference, context) {
            self.constrain_to_plane(object, &mut without, context);
            fit = without.refined(&self.noise, true);
        }
        fit.reject_gross_outliers(&self.noise, self.reference, context)
    }

    /// Puts an object on the ground, if it stands there.
    fn constrain_to_plane(&self, object: Option<usize>, fit: &mut Fit, context: &PosteriorContext) {
        if let (Some(ground), Some(up)) = (&self.ground, &context.up) {
            fit.stand_on_ground(object, ground, up);
        }
    }

    /// The given noise levels, or those of groups with data.
    pub(crate) fn noise_report(&self, context: &PosteriorContext) -> NoiseModel {
        context
            .options
            .noise_model
            .clone()
            .unwrap_or_else(|| NoiseModel::of_report(self.noise.report(&self.statistics)))
    }

    /// The scales of cues.
    pub(crate) fn scales(&self) -> &CueScales {
        &self.scales
    }

    /// The learned sizes of categories.
    pub(crate) fn sizes(&self) -> &SceneSizes {
        &self.sizes
    }

    /// The corrections of the poses.
    pub(crate) fn refined_poses(&self) -> Vec<RefinedPose> {
        self.poses.refined()
    }

    /// The points with the corrected poses, if there are any.
    pub(crate) fn pose_points(&self, context: &PosteriorContext) -> Option<PosePointsReport> {
        context.pose_points.report(&self.poses)
    }

    /// Frames over which the errors of poses last, if they are estimated.
    pub(crate) fn pose_correlation_length(&self) -> Option<f64> {
        self.poses.correlation_length()
    }

    /// Root mean square corrections of the poses, if estimated.
    pub(crate) fn pose_noise(&self) -> Option<PoseNoise> {
        self.poses.size().map(|(rotation_sd, translation_sd)| PoseNoise { rotation_sd, translation_sd })
    }
}

/// Terms that affect only covariances: errors common to views, from an evenly spread sample of the objects, and
/// differences between objects.
fn covariance_levels(fits: &[Result<Fit, Box<Estimate>>], noise: &NoiseLevels) -> CovarianceLevels {
    let fits: Vec<&Fit> = fits.iter().flatten().collect();
    let pairs: usize = fits.iter().map(|fit| fit.problem.views.views.len().pow(2) / 2).sum();
    let stride = pairs.div_ceil(COMMON_PAIRS).min(fits.len() / COMMON_SAMPLE).max(1);
    let count = fits.len().div_ceil(stride);
    // Summed in the order of the objects, so that the result does not depend on the number of threads.
    let all = map_indices(count, |k| fits[k * stride].common_statistics(noise));
    let mut sums = CommonStatistics::default();
    all.iter().for_each(|(statistics, _)| sums.merge(statistics));
    let agreements: Vec<_> = all.into_iter().map(|(_, agreement)| agreement).collect();
    CovarianceLevels { common: sums.deviations(), spread: Spread::of(&agreements) }
}

/// The median distance of objects from their nearest cameras.
fn median_distance(fits: &[Result<Fit, Box<Estimate>>]) -> f64 {
    let mut distances: Vec<f64> = fits.iter().flatten().filter_map(Fit::distance).collect();
    median(&mut distances).unwrap_or(1.0)
}

/// The ground plane under the objects that stand on it.
fn ground_plane(fits: &[Result<Fit, Box<Estimate>>], context: &PosteriorContext) -> Option<GroundPlane> {
    let up = context.up?;
    let standing = fits.iter().enumerate().filter_map(|(k, fit)| Some((k, fit.as_ref().ok()?)));
    let standing = standing.filter(|(_, fit)| fit.is_on_ground());
    let lowest: Vec<_> = standing.filter_map(|(k, fit)| Some((k, fit.lowest_point(&up)?))).collect();
    GroundPlane::fit(&up, &lowest, &context.cameras, context.options.camera_height)
}

#[cfg(test)]
#[path = "scene_fit_tests.rs"]
mod tests;
