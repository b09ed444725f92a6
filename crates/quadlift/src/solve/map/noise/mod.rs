//! Measurement errors: of single edges and ellipses, and those common to the views of an object.

pub(crate) mod common_errors;
pub(crate) mod levels;
pub(crate) mod usual_level;
