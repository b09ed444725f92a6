//! What is found about the sources of depths and 3D boxes.

/// The scale of one quantity of a source of cues, found from the objects of the scene: measured = factor * true, of depths + shift.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CueScale {
    /// What is scaled.
    pub quantity: ScaledQuantity,
    /// Index into [`crate::scene::SceneParts::cue_sources`]; `None` for cues without a source.
    pub source: Option<u32>,
    /// Measured over true length, where there is no shift: 1 for a source without a bias.
    pub factor: f64,
    /// Standard deviation of its logarithm.
    pub log_sd: f64,
    /// What is added to the true depth times the factor; `None` for other quantities, and where too few depths are seen to tell.
    pub shift: Option<DepthShift>,
}

/// What is added to the depths of a source, in its own lengths.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DepthShift {
    /// Measured depth minus the factor times the true depth: 0 for a source without a bias.
    pub value: f64,
    /// Its standard deviation.
    pub sd: f64,
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
