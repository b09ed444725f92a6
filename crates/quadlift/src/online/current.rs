//! The frame whose boxes are assigned.

use super::views::KeptView;
use crate::association::input::observations::Observations;

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
