//! Detections as residuals: tangent planes and ellipses in the object's frame, whitened, with their derivatives.

pub(crate) mod row;
pub(crate) mod cues;
pub(crate) mod ellipse;
pub(crate) mod harmonics;
pub(crate) mod measurements;
pub(crate) mod view_rows;
