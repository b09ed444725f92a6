//! Whether the points of a scene belong to its poses, before poses are corrected from them (docs/method.md, section 11.2).

use std::sync::Arc;

use super::point_tracks::choose_tracks;
use super::pose_points::PosePoints;
use super::pose_prior::{PoseLevels, PosePrior};
use super::pose_terms::SceneTerms;
use super::pose_unknowns::PoseUnknowns;
use super::poses::PoseCorrections;
use crate::scene::Scene;
use crate::solve::options::{PoseNoise, PosteriorOptions};
use crate::solve::pose_points_report::{PosePointsProblem, PosePointsReport};

/// Median error of observations beyond which they are no points of the poses, pixels: structure from motion leaves out single ones that
/// are further off (COLMAP's `filter_max_reproj_error`).
const MAX_ERROR: f64 = 4.0;

/// Error of the positions that the scene has, relative to the focal length, beyond which pixels and positions do not belong together: three
/// degrees, because all poses together may be turned.
const MAX_ANGLE: f64 = 0.05;

/// Standard deviations of the poses' errors with which points are tried: radians; shift relative to the distance of the points.
const TRIED_ROTATION: f64 = 0.05;
const TRIED_SHIFT: f64 = 0.05;

/// Steps with which points are tried.
const TRIED_STEPS: usize = 8;

impl PosePoints {
    /// The points of a scene that help to correct its poses, with a report; none where they contradict the poses.
    pub(crate) fn of(scene: &Scene, unknowns: &Arc<PoseUnknowns>, options: &PosteriorOptions) -> Self {
        if scene.points.iter().all(|point| point.observations.is_empty()) {
            return Self::default();
        }
        let mut points = Self::new(choose_tracks(scene, unknowns), scene);
        let mut report = PosePointsReport { scene_points: scene.points.len(), ..PosePointsReport::default() };
        if points.tracks.is_empty() {
            report.problem = Some(PosePointsProblem::NoParallax);
            return Self { as_given: Some(report), ..Self::default() };
        }
        report.points = points.tracks.len();
        report.observations = points.observations();
        let as_given = PoseCorrections::default();
        let given_error = points.fitted(&as_given).median;
        report.given_error = finite(given_error);
        let (tried, error) = points.tried(given_error, unknowns, options);
        report.error = finite(error);
        let elsewhere = points.median_as_given(&as_given).min(points.median_as_given(&tried));
        let apart = MAX_ANGLE * points.usual_focal_length();
        report.problem = if error > MAX_ERROR {
            Some(PosePointsProblem::Contradict)
        } else if elsewhere > apart.max(MAX_ERROR) {
            Some(PosePointsProblem::Elsewhere { error: finite(elsewhere) })
        } else {
            None
        };
        if report.problem.is_some() {
            points.tracks = Vec::new();
        }
        Self { as_given: Some(report), ..points }
    }

    /// Corrections from the points alone, and the median error that they leave. None are needed where it is small as given.
    fn tried(
        &self,
        given_error: f64,
        unknowns: &Arc<PoseUnknowns>,
        options: &PosteriorOptions,
    ) -> (PoseCorrections, f64) {
        let distance = self.median_distance();
        let wide = PoseNoise { rotation_sd: TRIED_ROTATION, translation_sd: TRIED_SHIFT * distance };
        let noise = options.pose_noise.unwrap_or(wide);
        let Some(prior) =
            PosePrior::new(&PosteriorOptions { pose_noise: Some(noise), ..options.clone() }, unknowns, || distance)
        else {
            return (PoseCorrections::default(), given_error);
        };
        let first =
            prior.first.iter().take(1).map(|levels| PoseLevels { correlation_length: 0.0, ..*levels }).collect();
        let prior = PosePrior { first, estimated: false, may_be_exact: false, ..prior };
        let (mut poses, mut error) = (PoseCorrections::default(), given_error);
        for _ in 0..TRIED_STEPS {
            if error <= MAX_ERROR {
                break;
            }
            poses.update(SceneTerms { objects: Vec::new(), points: self.terms(&poses) }, &prior);
            error = self.fitted(&poses).median;
        }
        (poses, error)
    }

    /// What is reported at the end: the points with these corrections.
    pub(crate) fn report(&self, poses: &PoseCorrections) -> Option<PosePointsReport> {
        let as_given = self.as_given?;
        if self.tracks.is_empty() {
            return Some(as_given);
        }
        let fitted = self.fitted(poses);
        Some(PosePointsReport { error: finite(fitted.median), noise: Some(fitted.level), ..as_given })
    }

    /// No points, where the corrections left so large errors that the points contradict the poses and the objects; `report` is theirs.
    pub(crate) fn left_out(report: PosePointsReport) -> Option<Self> {
        let contradicts = report.problem.is_none() && report.error.is_none_or(|error| error > MAX_ERROR);
        let report = PosePointsReport { noise: None, problem: Some(PosePointsProblem::Contradict), ..report };
        contradicts.then(|| Self { as_given: Some(report), ..Self::default() })
    }
}

fn finite(x: f64) -> Option<f64> {
    x.is_finite().then_some(x)
}
