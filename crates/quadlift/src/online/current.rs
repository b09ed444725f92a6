//! The frame whose boxes are assigned, and the pairs of its boxes with objects.

use super::views::KeptView;
use crate::association::input::observations::Observations;
use crate::association::score::log_likelihood_ratio::LogLikelihoodRatio;
use crate::association::score::object::Prediction;

/// The boxes of the frame that is being assigned.
pub(super) struct Current {
    pub key: u32,
    pub time: f64,
    /// One camera and its boxes, from left to right.
    pub observations: Observations,
    /// The boxes as they are kept, in the same order.
    pub views: Vec<KeptView>,
    /// Their input ids, in the same order.
    pub input_ids: Vec<Option<u32>>,
    /// Unassigned boxes.
    pub free: Vec<u32>,
}

/// An object that should be visible in the frame.
#[derive(Debug, Clone, Copy)]
pub(super) struct Seen {
    pub slot: u32,
    pub prediction: Prediction,
}

/// The pairs of objects and boxes of a frame.
#[derive(Debug, Default)]
pub(super) struct Matched {
    /// Slot, index of the box, log likelihood ratio.
    pub pairs: Vec<(u32, u32, LogLikelihoodRatio)>,
    /// Objects that should be visible.
    pub seen: Vec<Seen>,
}
