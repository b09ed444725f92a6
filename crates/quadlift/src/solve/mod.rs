//! The method: from the views of one object to its body.

mod arrowhead;
mod closed_form;
pub mod conditioning;
mod enclosing;
mod estimate;
mod lfd;
pub mod map;
mod options;
mod pfd;
pub mod planes;
pub(crate) mod plausible;
mod prediction;
mod reg;
mod report;
mod sigmas;
mod singular;
mod streaming_qr;
mod triangulate;

pub use closed_form::solve_closed_form;
pub use estimate::{
    Alternative, Covariance, CovarianceCoordinates, Estimate, Matrix9, Misfit, Rejection, Status, ViewReport, Warning,
};
pub use lfd::{ConditionedSolution, lfd, lfd_from};
pub use options::{BodyKind, CategoryPrior, CategoryPriors, MapOptions, Method, PoseNoise, RegOptions, SizePrior};
pub use pfd::{ClosedFormError, PfdSolution, pfd, pfd_unit_quadric};
pub(crate) use prediction::LARGE_ERROR;
pub use prediction::{Fold, FoldPrediction, Prediction, predict_fold};
pub use reg::{RegSolution, reg};
pub use sigmas::{SIGMA_NAMES, Sigmas, SigmasError};
pub use triangulate::triangulate;
