//! One image shift per frame, which absorbs errors of its pose (docs/method.md, section 15.6).

use nalgebra::Vector2;

use crate::association::input::observations::Observations;
use crate::association::score::object::Object;
use crate::association::score::scene_statistics::{MAX_SHIFT_SD, SceneStatistics};
use crate::association::statistics::STUDENT_T_DOF;

/// Smallest standard deviation of the shifts, pixels.
const MIN_SHIFT_SD: f64 = 0.2;

/// Minimum number of views of objects used to estimate the shift of a frame.
pub(crate) const MIN_INFORMATIVE_VIEWS: usize = 4;

/// Minimum number of informative frames to learn the spread of the shifts.
const MIN_INFORMATIVE_FRAMES: usize = 5;

/// The most probable shift of the boxes of a frame, from robust residuals and a Gaussian prior.
#[derive(Debug, Clone)]
pub(crate) struct FrameShift {
    prior: f64,
    sum: Vector2<f64>,
    weights: Vector2<f64>,
}

impl FrameShift {
    /// Before any residual; `sd` is the standard deviation of the prior, pixels.
    pub(crate) fn new(sd: f64) -> Self {
        let prior = 1.0 / (sd * sd);
        Self { prior, sum: Vector2::zeros(), weights: Vector2::repeat(prior) }
    }

    /// Adds the residuals of a box ([`Object::residuals_px`]) whose edges have this standard deviation, and from which a shift
    /// was subtracted before.
    pub(crate) fn add(&mut self, residuals: &[f64; 4], one_sided: [bool; 4], sd: f64, subtracted: &Vector2<f64>) {
        let information = sd.powi(-2);
        for edge in (0..4).filter(|&e| !one_sided[e]) {
            // Measured less predicted place of the edge.
            let error = if edge < 2 { -residuals[edge] } else { residuals[edge] };
            let weight = information * (STUDENT_T_DOF + 1.0) / (STUDENT_T_DOF + error * error * information);
            self.sum[edge % 2] += weight * (error + subtracted[edge % 2]);
            self.weights[edge % 2] += weight;
        }
    }

    /// The shift, pixels.
    pub(crate) fn shift(&self) -> Vector2<f64> {
        self.sum.component_div(&self.weights)
    }

    /// Whether the residuals say more than the prior.
    pub(crate) fn is_informative(&self) -> bool {
        self.weights.x > 1.5 * self.prior
    }

    /// Expected squared length of the shift.
    pub(crate) fn expected_square(&self) -> f64 {
        self.shift().norm_squared() + 1.0 / self.weights.x + 1.0 / self.weights.y
    }
}

/// Standard deviation of the shifts, from the sum of their expected squares; `None` for too few frames.
pub(crate) fn spread(squares: f64, frames: usize) -> Option<f64> {
    let sd = || (0.5 * squares / frames as f64).sqrt().clamp(MIN_SHIFT_SD, MAX_SHIFT_SD);
    (frames >= MIN_INFORMATIVE_FRAMES).then(sd)
}

/// Estimates the shifts from all objects (their most probable values, with a Gaussian prior whose spread is learned) and
/// moves the boxes.
pub(crate) fn learn_shifts(observations: &mut Observations, statistics: &mut SceneStatistics, objects: &[Object]) {
    let mut estimates = vec![FrameShift::new(statistics.shift_sd); observations.cameras.len()];
    for object in objects.iter().filter(|o| o.boxes.len() >= MIN_INFORMATIVE_VIEWS) {
        for &index in &object.boxes {
            let observation = &observations.boxes[index as usize];
            let frame = observation.frame;
            let one_sided = statistics.one_sided(index as usize, observation);
            let residuals = object.residuals_px(&observations.cameras[frame], observation);
            estimates[frame].add(&residuals, one_sided, statistics.sd(observation), &statistics.shifts[frame]);
        }
    }
    let informative = estimates.iter().filter(|estimate| estimate.is_informative());
    let squares: f64 = informative.clone().map(FrameShift::expected_square).sum();
    if let Some(sd) = spread(squares, informative.count()) {
        statistics.shift_sd = sd;
    }
    let shifts: Vec<Vector2<f64>> = estimates.iter().map(FrameShift::shift).collect();
    for (frame, shift) in shifts.iter().enumerate() {
        observations.move_boxes(frame, &(statistics.shifts[frame] - shift));
    }
    statistics.shifts = shifts;
}
