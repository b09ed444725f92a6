//! One image shift per frame, which absorbs errors of its pose (docs/method.md, section 15.6).

use nalgebra::Vector2;

use crate::association::input::observations::Observations;
use crate::association::score::object::Object;
use crate::association::score::scene_statistics::{LARGEST_SHIFT_SD, SceneStatistics};
use crate::association::statistics::STUDENT_T_DOF;

/// Smallest standard deviation of the shifts, pixels.
const LEAST_SHIFT_SD: f64 = 0.2;

/// Minimum number of views of objects used to estimate the shift of a frame.
const MIN_INFORMATIVE_VIEWS: usize = 4;

/// Minimum number of informative frames to learn the spread of the shifts.
const MIN_INFORMATIVE_FRAMES: usize = 5;

/// Estimates the shifts from all objects (their most probable values, with a Gaussian prior whose spread is learnt) and
/// moves the boxes.
pub(crate) fn learn_shifts(observations: &mut Observations, statistics: &mut SceneStatistics, objects: &[Object]) {
    let frames = observations.cameras.len();
    let prior = 1.0 / (statistics.shift_sd * statistics.shift_sd);
    let (mut sums, mut weights) = (vec![Vector2::zeros(); frames], vec![Vector2::repeat(prior); frames]);
    for object in objects.iter().filter(|o| o.boxes.len() >= MIN_INFORMATIVE_VIEWS) {
        for &index in &object.boxes {
            let observation = &observations.boxes[index as usize];
            let frame = observation.frame;
            let one_sided = statistics.one_sided(index as usize, observation);
            let residuals = object.residuals_px(&observations.cameras[frame], observation);
            let information = statistics.sd(observation).powi(-2);
            for edge in (0..4).filter(|&e| !one_sided[e]) {
                // Measured less predicted place of the edge.
                let error = if edge < 2 { -residuals[edge] } else { residuals[edge] };
                let weight = information * (STUDENT_T_DOF + 1.0) / (STUDENT_T_DOF + error * error * information);
                sums[frame][edge % 2] += weight * (error + statistics.shifts[frame][edge % 2]);
                weights[frame][edge % 2] += weight;
            }
        }
    }
    let shifts: Vec<Vector2<f64>> = sums.iter().zip(&weights).map(|(s, w)| s.component_div(w)).collect();
    let telling = |w: &Vector2<f64>| w.x > 1.5 * prior;
    let count = weights.iter().filter(|w| telling(w)).count();
    if count >= MIN_INFORMATIVE_FRAMES {
        let told = shifts.iter().zip(&weights).filter(|(_, w)| telling(w));
        let squares: f64 = told.map(|(s, w)| s.norm_squared() + 1.0 / w.x + 1.0 / w.y).sum();
        statistics.shift_sd = (0.5 * squares / count as f64).sqrt().clamp(LEAST_SHIFT_SD, LARGEST_SHIFT_SD);
    }
    for (frame, shift) in shifts.iter().enumerate() {
        observations.move_boxes(frame, &(statistics.shifts[frame] - shift));
    }
    statistics.shifts = shifts;
}
