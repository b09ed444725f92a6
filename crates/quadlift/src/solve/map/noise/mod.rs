//! Measurement errors: of single edges and ellipses, and those common to the views of an object.

pub(crate) mod common_errors;
pub(crate) mod groups;
pub(crate) mod levels;
pub(crate) mod object_spread;
pub(crate) mod statistics;
#[cfg(test)]
mod test_rows;
pub(crate) mod usual_level;
