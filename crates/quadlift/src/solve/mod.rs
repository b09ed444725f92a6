//! The method: from the views of one object to its body.

mod bounds;
mod cue_scale;
mod estimate;
mod pose_points_report;
mod prediction;
mod refined_pose;
mod noise_model;
mod options;
mod learned_size;
mod scene_solution;
pub(crate) mod plausible;
mod streaming_qr;
mod triangulate;
pub(crate) mod conditioning;
mod corrected_support;
mod support_correction;
mod bounding;
mod enclosing;
mod report;
mod closed_form;
pub(crate) mod posterior;
pub(crate) mod evidence;
mod validate;
mod estimator;

pub(crate) use bounding::add_bounds;
pub use bounds::Bounds;
pub use closed_form::lfd::{ConditionedSolution, lfd};
pub use closed_form::pfd::{ClosedFormError, PfdSolution, pfd};
pub use closed_form::reg::{RegSolution, reg};
pub(crate) use closed_form::solve_closed_form;
pub use cue_scale::{CueScale, DepthShift, ScaledQuantity};
pub use estimate::{
    Alternative, Covariance, CovarianceCoordinates, Estimate, GoodnessOfFit, Matrix9, Rejection, Status, ViewReport,
    Warning,
};
pub use estimator::Estimator;
pub use learned_size::LearnedCategorySize;
pub use noise_model::{NoiseModel, NoiseModelError};
pub(crate) use options::BORDER_MARGIN;
pub use options::{
    CategoryPrior, CategoryPriors, Method, PoseMotion, PoseNoise, PosteriorOptions, RegOptions, SizePrior,
};
pub use pose_points_report::{PosePointsProblem, PosePointsReport};
pub(crate) use prediction::LARGE_ERROR;
pub use prediction::Prediction;
pub(crate) use prediction::{Fold, FoldPrediction, predict_fold};
pub use refined_pose::RefinedPose;
pub use scene_solution::SceneSolution;
pub(crate) use support_correction::PointCorrection;
pub use support_correction::SupportCorrection;
pub use triangulate::triangulate;
pub use validate::OptionError;
pub(crate) use validate::refuse;
