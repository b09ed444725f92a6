//! The method: from the views of one object to its body.

mod arrowhead;
mod estimate;
mod lfd;
mod options;
mod pfd;
mod reg;
mod singular;
mod streaming_qr;
pub(crate) mod triangulate;

pub use estimate::{Covariance, CovarianceCoordinates, Estimate, Matrix9, Status, ViewReport, Warning};
pub use lfd::{LfdSolution, lfd, lfd_from};
pub use options::{BodyKind, CategoryPrior, CategoryPriors, MapOptions, RegOptions, SizePrior};
pub use pfd::{ClosedFormError, PfdSolution, pfd, pfd_unit_quadric};
pub use reg::{RegSolution, reg};
