//! Running estimates of the map: sizes of boxes, categories, noise, clutter, how often objects are detected.

use nalgebra::Vector2;

use crate::association::input::clutter::BoxSizes;
use crate::association::input::observations::SMALLEST_SIZE;
use crate::association::input::sizes::LogSize;
use crate::association::score::scene_statistics::{LARGEST_SHIFT_SD, SceneStatistics};

/// Counts are smaller than this, so that counting on does not overflow.
pub(super) const MOST: u64 = 1 << 53;

/// Bins of the histogram of half sizes, eight for each octave from 1/16 of a pixel on.
const BINS: usize = 256;
const BINS_PER_OCTAVE: f64 = 8.0;
const FIRST_OCTAVE: f64 = -4.0;

/// Prior of the share of clear views in which an object is detected, as so many views with this share.
const RATE_PRIOR: [f64; 2] = [8.0, 0.8];

/// Shifts of frames, at most and at least, and how many frames must tell one before their spread is learnt.
const LEAST_SHIFT_SD: f64 = 0.2;
const MIN_INFORMATIVE_FRAMES: u64 = 5;

/// Everything that is learnt from all frames together.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub(super) struct Running {
    pub frames: u64,
    pub boxes: u64,
    /// Boxes that objects have.
    pub assigned: i64,
    /// Sum, and sum of squares, of the logarithms of half widths and half heights.
    log_sizes: [f64; 2],
    histogram: Vec<u64>,
    category_counts: Vec<u64>,
    /// Clear views of confirmed objects, and in how many of them they were detected.
    pub clear: f64,
    pub clear_detected: f64,
    shift_squares: f64,
    shift_frames: u64,
    /// Longest focal length, pixels.
    pub longest_focal: f64,
    /// Extent of all boxes, for images of unknown size.
    pub extent: [f64; 2],
    /// Number of assigned boxes at which the statistics are learnt again.
    pub next_learning: i64,
    /// Number of assigned boxes at which the slack of edges is chosen again.
    pub next_slack: i64,
    pub statistics: SceneStatistics,
    pub given_sizes: Vec<Option<LogSize>>,
}

impl Running {
    pub fn new(pixel_sd: f64) -> Self {
        Self {
            frames: 0,
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
            statistics: SceneStatistics::unlearnt(pixel_sd),
            given_sizes: Vec::new(),
        }
    }

    /// Whether there are numbers for so many categories, and all lists have their sizes.
    pub fn has_categories(&self, count: usize) -> bool {
        let counts = [self.category_counts.len(), self.given_sizes.len(), self.statistics.log_sizes.len()];
        counts.iter().all(|&n| n == count) && self.histogram.len() == BINS && self.statistics.hidden.is_empty()
    }

    /// Whether all counts can be counted on.
    pub fn is_countable(&self) -> bool {
        let assigned = self.assigned.unsigned_abs();
        [self.frames, self.boxes, assigned, self.shift_frames].iter().all(|&n| n < MOST)
            && self.histogram.iter().chain(&self.category_counts).all(|&n| n < MOST)
    }

    /// A category more.
    pub fn add_category(&mut self, size: Option<LogSize>) {
        self.category_counts.push(0);
        self.given_sizes.push(size);
        self.statistics.log_sizes.push(size);
    }

    /// Counts a box by its log half sizes.
    pub fn count_box(&mut self, log_half: [f64; 2], half_size: f64, category: usize) {
        self.boxes += 1;
        self.category_counts[category] += 1;
        for value in log_half {
            self.log_sizes[0] += value;
            self.log_sizes[1] += value * value;
        }
        let bin = ((half_size.log2() - FIRST_OCTAVE) * BINS_PER_OCTAVE).clamp(0.0, (BINS - 1) as f64);
        self.histogram[bin as usize] += 1;
    }

    /// How large boxes are.
    pub fn box_sizes(&self) -> BoxSizes {
        let count = (2 * self.boxes).max(1) as f64;
        let mean = self.log_sizes[0] / count;
        BoxSizes::new(mean, (self.log_sizes[1] / count - mean * mean).max(0.0))
    }

    /// Predicted boxes of a smaller half size are not expected to be detected.
    pub fn least_half_size(&self) -> f64 {
        let below = (0.02 * self.boxes as f64) as u64;
        let mut sum = 0;
        for (bin, &count) in self.histogram.iter().enumerate() {
            sum += count;
            if sum > below {
                return SMALLEST_SIZE * (FIRST_OCTAVE + (bin as f64 + 0.5) / BINS_PER_OCTAVE).exp2();
            }
        }
        0.0
    }

    /// Share of the boxes in each category.
    pub fn category_share(&self) -> Vec<f64> {
        self.category_counts.iter().map(|&n| 1e-9 + n as f64 / self.boxes.max(1) as f64).collect()
    }

    /// Share of clear views in which a confirmed object is detected.
    pub fn detection_share(&self) -> f64 {
        (self.clear_detected + RATE_PRIOR[0] * RATE_PRIOR[1]) / (self.clear + RATE_PRIOR[0])
    }

    /// Learns how many boxes are clutter.
    pub fn learn_clutter(&mut self) {
        let (frames, all) = (self.frames.max(1) as f64, self.boxes as f64);
        let free = (all - self.assigned as f64) / frames;
        self.statistics.log_clutter_rate = free.max(0.02 * all / frames).max(0.02).ln();
    }

    /// Learns the spread of the shifts of frames from that of one, with the information about it.
    pub fn learn_shift(&mut self, shift: &Vector2<f64>, information: &Vector2<f64>) {
        self.shift_frames += 1;
        self.shift_squares += shift.norm_squared() + 1.0 / information.x + 1.0 / information.y;
        if self.shift_frames >= MIN_INFORMATIVE_FRAMES {
            let sd = (0.5 * self.shift_squares / self.shift_frames as f64).sqrt();
            self.statistics.shift_sd = sd.clamp(LEAST_SHIFT_SD, LARGEST_SHIFT_SD);
        }
    }
}
