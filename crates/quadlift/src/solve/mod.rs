//! The method: from the views of one object to its body.

mod closed_form;
pub mod conditioning;
mod estimate;
pub mod map;
mod options;
pub mod planes;
mod report;
mod streaming_qr;
mod triangulate;

pub use closed_form::solve_closed_form;
pub use estimate::{Covariance, CovarianceCoordinates, Estimate, Matrix9, Status, ViewReport, Warning};
pub use options::{BodyKind, CategoryPrior, CategoryPriors, MapOptions, Method, RegOptions, SizePrior};
