//! Measurement errors: of single edges and ellipses, and those common to the views of an object.

pub(crate) mod common_errors;
pub(crate) mod groups;
pub(crate) mod object_spread;
pub(crate) mod statistics;
pub(crate) mod noise_prior;
pub(crate) mod levels;

#[cfg(test)]
mod test_rows;
