//! Running estimates of the map: sizes of boxes, categories, noise, clutter, how often objects are detected.

use crate::association::input::clutter::BoxSizes;
use crate::association::input::observations::MIN_SIZE;
use crate::association::input::sizes::LogSize;
use crate::association::score::scene_statistics::SceneStatistics;
use crate::association::search::frame_shift::{FrameShift, spread};

/// Upper bound of counts in a state, so that counting on does not overflow.
#[cfg(feature = "serde")]
pub(super) const MAX_COUNT: u64 = 1 << 53;

/// Bins of the histogram of half sizes, eight for each octave from 1/16 of a pixel on.
const BINS: usize = 256;
const BINS_PER_OCTAVE: f64 = 8.0;
const FIRST_OCTAVE: f64 = -4.0;

/// Prior of the detection rate in clear views: its weight in views, and the rate.
const RATE_PRIOR: [f64; 2] = [8.0, 0.8];

/// Running statistics of all frames.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub(super) struct Running {
    pub frames: u64,
    /// Frames from the place of an earlier one: their boxes do not count.
    #[cfg_attr(feature = "serde", serde(default))]
    pub repeated: u64,
    pub boxes: u64,
    /// Assigned boxes.
    pub assigned: i64,
    /// Sum, and sum of squares, of the logarithms of half widths and half heights.
    log_sizes: [f64; 2],
    histogram: Vec<u64>,
    category_counts: Vec<u64>,
    /// Clear views of confirmed objects, and those with a detection.
    pub clear: f64,
    pub clear_detected: f64,
    shift_squares: f64,
    shift_frames: u64,
    /// Longest focal length, pixels.
    pub longest_focal: f64,
    /// Extent of all boxes, for images of unknown size.
    pub extent: [f64; 2],
    /// Number of assigned boxes at which statistics are estimated again.
    pub next_learning: i64,
    /// Number of assigned boxes at which the slack of edges is selected again.
    pub next_slack: i64,
    pub statistics: SceneStatistics,
    pub given_sizes: Vec<Option<LogSize>>,
}

impl Running {
    pub(super) fn new(edge_noise_px: f64) -> Self {
        Self {
            frames: 0,
            repeated: 0,
            boxes: 0,
            assigned: 0,
            log_sizes: [0.0; 2],
            histogram: vec![0; BINS],
            category_counts: Vec::new(),
            clear: 0.0,
            clear_detected: 0.0,
            shift_squares: 0.0,
            shift_frames: 0,
            longest_focal: 0.0,
            extent: [1.0, 1.0],
            next_learning: 6,
            next_slack: 60,
            statistics: SceneStatistics::unlearned(edge_noise_px),
            given_sizes: Vec::new(),
        }
    }

    /// Whether what was stored can be used in a map with so many categories.
    #[cfg(feature = "serde")]
    pub(super) fn is_valid(&self, categories: usize) -> bool {
        let lists = [self.category_counts.len(), self.given_sizes.len(), self.statistics.log_sizes.len()];
        let counts = [self.frames, self.repeated, self.boxes, self.assigned.unsigned_abs(), self.shift_frames];
        lists.iter().all(|&length| length == categories)
            && self.histogram.len() == BINS
            && self.statistics.hidden.is_empty()
            && counts.iter().chain(&self.histogram).chain(&self.category_counts).all(|&n| n < MAX_COUNT)
    }

    /// Adds a category.
    pub(super) fn add_category(&mut self, size: Option<LogSize>) {
        self.category_counts.push(0);
        self.given_sizes.push(size);
        self.statistics.log_sizes.push(size);
    }

    /// Counts a box by its log half sizes.
    pub(super) fn count_box(&mut self, log_half: [f64; 2], half_size: f64, category: usize) {
        self.boxes += 1;
        self.category_counts[category] += 1;
        for value in log_half {
            self.log_sizes[0] += value;
            self.log_sizes[1] += value * value;
        }
        let bin = ((half_size.log2() - FIRST_OCTAVE) * BINS_PER_OCTAVE).clamp(0.0, (BINS - 1) as f64);
        self.histogram[bin as usize] += 1;
    }

    /// The distribution of box sizes.
    pub(super) fn box_sizes(&self) -> BoxSizes {
        let count = (2 * self.boxes).max(1) as f64;
        let mean = self.log_sizes[0] / count;
        BoxSizes::new(mean, (self.log_sizes[1] / count - mean * mean).max(0.0))
    }

    /// Half size below which predicted boxes are not expected to be detected, pixels.
    pub(super) fn least_half_size(&self) -> f64 {
        let below = (0.02 * self.boxes as f64) as u64;
        let mut sum = 0;
        for (bin, &count) in self.histogram.iter().enumerate() {
            sum += count;
            if sum > below {
                return MIN_SIZE * (FIRST_OCTAVE + (bin as f64 + 0.5) / BINS_PER_OCTAVE).exp2();
            }
        }
        0.0
    }

    /// Share of the boxes in each category.
    pub(super) fn category_share(&self) -> Vec<f64> {
        self.category_counts.iter().map(|&n| 1e-9 + n as f64 / self.boxes.max(1) as f64).collect()
    }

    /// Detection rate of confirmed objects in clear views.
    pub(super) fn detection_share(&self) -> f64 {
        (self.clear_detected + RATE_PRIOR[0] * RATE_PRIOR[1]) / (self.clear + RATE_PRIOR[0])
    }

    /// Updates the clutter rate.
    pub(super) fn learn_clutter(&mut self) {
        let (frames, all) = (self.frames.saturating_sub(self.repeated).max(1) as f64, self.boxes as f64);
        let free = (all - self.assigned as f64) / frames;
        self.statistics.log_clutter_rate = free.max(0.02 * all / frames).max(0.02).ln();
    }

    /// Updates the standard deviation of frame shifts with the shift of a frame.
    pub(super) fn learn_shift(&mut self, shift: &FrameShift) {
        self.shift_frames += 1;
        self.shift_squares += shift.expected_square();
        if let Some(sd) = spread(self.shift_squares, self.shift_frames as usize) {
            self.statistics.shift_sd = sd;
        }
    }
}
