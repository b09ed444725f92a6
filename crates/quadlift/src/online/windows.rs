//! The frames that the consistency check of a map looks at, and what it has found.

use super::recent_frames::RecentFrame;

/// The windows of a map.
#[derive(Debug, Clone, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(default))]
pub(super) struct Windows {
    /// The frames before the recent ones since the last check.
    pub(super) frames: Vec<RecentFrame>,
    /// The last frames that were inconsistent.
    pub(super) suspect: Vec<RecentFrame>,
    /// Whether the map was checked for the first time.
    pub(super) is_begun: bool,
    /// Number of windows that could be checked, and of those that are inconsistent for a known and for an unknown cause.
    pub(super) checked: u32,
    pub(super) explained: u32,
    pub(super) unexplained: u32,
    /// How far the camera moves between frames when it moves.
    pub(super) usual_step: f64,
    /// Number of full windows since one took long to check.
    pub(super) since_slow: Option<u32>,
    /// Whether the map is inconsistent; `None` if nothing could be checked so far.
    pub(super) consistent: Option<bool>,
}

impl Windows {
    /// A motion that is small beside those of a camera that moves: a tenth; zero before the first check.
    pub(super) fn small_step(&self) -> f64 {
        0.1 * self.usual_step
    }

    /// Takes a frame that is not recent any more, or that the map has left out, with its reference.
    pub(super) fn keep(&mut self, mut frame: RecentFrame) {
        frame.forget_extras();
        let place = self.frames.partition_point(|other| other.key < frame.key);
        self.frames.insert(place, frame);
    }

    /// All frames that it holds.
    #[cfg(any(feature = "serde", test))]
    pub(super) fn all(&self) -> impl Iterator<Item = &RecentFrame> {
        self.frames.iter().chain(&self.suspect)
    }
}
