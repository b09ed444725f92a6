//! The frame whose boxes are assigned.

use super::views::KeptView;
use crate::association::input::observations::Observations;

/// The boxes of the frame that is observed, or looked at again.
pub(super) struct Current {
    pub key: u32,
    pub time: f64,
    /// One camera and its boxes, from left to right.
    pub observations: Observations,
    /// The boxes as they are kept, in the same order.
    pub views: Vec<KeptView>,
    /// Ids that they came with, in the same order.
    pub input_ids: Vec<Option<u32>>,
    /// Boxes that belong to no object so far.
    pub free: Vec<u32>,
}
