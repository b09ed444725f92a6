//! What is found about the sources of depths and 3D boxes.

use super::map::shared::cue_scales::Constant;

/// The scale of one quantity of a source of cues, found from the objects of the scene. Measurements are divided by it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CueScale {
    /// What is scaled.
    pub quantity: ScaledQuantity,
    /// Index into [`crate::scene::SceneParts::cue_sources`]; `None` for cues without a source.
    pub source: Option<u32>,
    /// Measured over true length: 1 for a source without a bias.
    pub factor: f64,
    /// Standard deviation of its logarithm.
    pub log_sd: f64,
}

/// A quantity of a source of cues that has a scale of its own.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum ScaledQuantity {
    /// Depths.
    Depth,
    /// Depths in one frame, of a source whose scale differs between frames.
    DepthOfFrame {
        /// Index into [`crate::scene::SceneParts::frames`].
        frame: usize,
    },
    /// Distances of 3D boxes.
    BoxDistance,
    /// An extent of 3D boxes of a category.
    BoxSize {
        /// Index into [`crate::scene::SceneParts::categories`].
        category: Option<usize>,
        /// Which of the half extents: 0, 1, 2 (length, width, height).
        axis: usize,
    },
}

impl CueScale {
    /// A constant with its standard deviation; `None` for a part of others.
    pub(super) fn of((constant, value, log_sd): (Constant, f64, f64)) -> Option<Self> {
        let (quantity, source) = match constant {
            Constant::Depth(source) => (ScaledQuantity::Depth, source),
            Constant::DepthOfFrame(source, frame) => (ScaledQuantity::DepthOfFrame { frame }, source),
            Constant::Distance(source) => (ScaledQuantity::BoxDistance, source),
            Constant::Sizes(..) => return None,
            Constant::Size(source, category, axis) => (ScaledQuantity::BoxSize { category, axis }, source),
        };
        Some(Self { quantity, source, factor: value.exp(), log_sd })
    }
}
