//! The objects of a scene, and what was estimated with them.

use super::cue_scale::CueScale;
use super::estimate::Estimate;
use super::learned_size::LearnedCategorySize;
use super::noise_model::{NoiseModel, POSE_NOISE_NAMES};
use super::options::PoseNoise;
use super::pose_points_report::PosePointsReport;
use super::refined_pose::RefinedPose;
use crate::geometry::BodyKind;

/// The objects of a scene, and what was estimated with them.
#[derive(Debug, Clone, Default)]
pub struct SceneSolution {
    /// One estimate per object id of the detections of the chosen source, in the order of the ids.
    pub estimates: Vec<Estimate>,
    /// Noise levels, estimated from the scene's residuals or given ([`crate::solve::Method::Posterior`] only).
    pub noise: NoiseModel,
    /// Root mean square corrections of the poses, where [`crate::solve::PosteriorOptions::pose_noise`] asks for them.
    pub pose_noise: Option<PoseNoise>,
    /// Frames over which the errors of poses last, 0 if those of frames are independent; found by [`crate::solve::PoseMotion::Auto`].
    pub pose_correlation_length: Option<f64>,
    /// Corrections of the poses of the frames that show objects or points, where [`crate::solve::PosteriorOptions::refine_poses`] or
    /// [`crate::solve::PosteriorOptions::pose_noise`] asks for them.
    pub refined_poses: Vec<RefinedPose>,
    /// The points from which poses were corrected beside the objects, if the scene has any.
    pub pose_points: Option<PosePointsReport>,
    /// Scales of the sources of depths and 3D boxes, if there are any and noise levels are not given.
    pub cue_scales: Vec<CueScale>,
    /// Sizes of categories, where [`crate::solve::PosteriorOptions::learn_sizes`] asks for them: one for each category and kind of body.
    pub learned_sizes: Vec<LearnedCategorySize>,
    /// The fitted kind of body, given or selected; `None` if objects differ.
    pub body: Option<BodyKind>,
}

impl SceneSolution {
    /// The noise levels by their names in results, pose noise last.
    pub fn noise_levels(&self) -> impl Iterator<Item = (&'static str, f64)> {
        let of_poses = self.pose_noise.zip(self.pose_correlation_length).map(|(poses, correlation_length)| {
            POSE_NOISE_NAMES.into_iter().zip([poses.rotation_sd, poses.translation_sd, correlation_length])
        });
        self.noise.levels().chain(of_poses.into_iter().flatten())
    }
}
