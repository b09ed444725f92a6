//! The search for the best division of the boxes into objects.

pub(crate) mod births;
pub(crate) mod candidates;
pub(crate) mod assignment;
pub(crate) mod frame_shift;
pub(crate) mod growth;
pub(crate) mod nested;
pub(crate) mod state;
pub(crate) mod em;
pub(crate) mod passes;
