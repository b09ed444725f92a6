//! How large measurement errors are: of single edges and ellipses, and those that the views of an object share.

pub(crate) mod common_errors;
pub(crate) mod levels;
pub(crate) mod usual_level;
