//! The object map frame by frame, beside association of all frames at once (ours).

pub mod replay;
