//! The method: from the views of one object to its body.

mod estimate;
mod options;
mod singular;
mod streaming_qr;

pub use estimate::{Covariance, CovarianceCoordinates, Estimate, Matrix9, Status, ViewReport, Warning};
pub use options::{BodyKind, CategoryPrior, CategoryPriors, MapOptions, RegOptions, SizePrior};
