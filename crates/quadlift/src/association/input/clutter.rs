//! Density of clutter boxes around each box (docs/method.md, section 15.2).

use nalgebra::Vector2;

use super::box_observation::{BoxObservation, Camera};
use crate::association::statistics::LN_2PI;

/// Maximum number of other boxes of a frame for the density at a box; more are sampled evenly.
const MAX_NEIGHBORS: usize = 2000;

/// Weight of the uniform density of clutter, in boxes of a frame.
const UNIFORM_WEIGHT: f64 = 3.0;

/// How large boxes are: a normal distribution of the logarithms of half the width and half the height.
#[derive(Debug, Clone, Copy)]
pub(crate) struct BoxSizes {
    mean: f64,
    sd: f64,
}

/// Minimum standard deviation of the log sizes.
const MIN_SD: f64 = 0.3;

impl BoxSizes {
    /// From the mean and the variance of all log half sizes.
    pub(crate) fn new(mean: f64, variance: f64) -> Self {
        Self { mean, sd: variance.sqrt().max(MIN_SD) }
    }

    /// Of these boxes.
    pub(crate) fn of(boxes: &[BoxObservation]) -> Self {
        let count = (2 * boxes.len()).max(1) as f64;
        let mean = boxes.iter().flat_map(|b| b.log_half).sum::<f64>() / count;
        let square = |b: &BoxObservation| b.log_half.iter().map(|x| (x - mean) * (x - mean)).sum::<f64>();
        Self::new(mean, boxes.iter().map(square).sum::<f64>() / count)
    }

    /// Log density over the logarithms of half the width and half the height, cut at three standard deviations.
    fn log_density(&self, observation: &BoxObservation) -> f64 {
        let constant = -LN_2PI - 2.0 * self.sd.ln();
        let square = observation.log_half.iter().map(|x| (x - self.mean) * (x - self.mean)).sum::<f64>();
        (constant - 0.5 * square / (self.sd * self.sd)).max(constant - 4.5)
    }
}

/// Sets the log density of clutter at each box of a frame for one clutter box per frame: of position (higher near the
/// frame's other boxes) and size (like the scene's boxes), over the four edges in pixels.
pub(crate) fn set_clutter(boxes: &mut [BoxObservation], camera: &Camera, sizes: &BoxSizes) {
    let places = places(boxes);
    for observation in boxes {
        let wh = observation.log_half[0] + observation.log_half[1] + 4.0f64.ln();
        observation.log_clutter =
            sizes.log_density(observation) + (place_density(&places, observation, camera.size) - wh);
    }
}

/// For births: log density, over the center and the two log sizes, of the alternatives for an unassigned box: clutter
/// or another object nearby.
pub(crate) fn log_density_among_neighbors(
    (cameras, boxes): (&[Camera], &[BoxObservation]),
    sizes: &BoxSizes,
    log_rate: f64,
    used: &[bool],
) -> Vec<f64> {
    let mut densities: Vec<f64> = boxes.iter().map(|b| sizes.log_density(b)).collect();
    for camera in cameras {
        let all: Vec<usize> = camera.boxes.clone().filter(|&i| !used[i]).collect();
        let step = all.len().div_ceil(MAX_NEIGHBORS).max(1);
        let uniform = log_rate.exp() / camera.size.product();
        for &index in &all {
            let observation = &boxes[index];
            let width = 2.0 * observation.half_size;
            let neighbors = all.iter().step_by(step).filter(|&&i| i != index);
            let near: f64 = neighbors
                .map(|&i| &boxes[i])
                .filter(|other| other.category == observation.category)
                .map(|other| (-0.5 * (other.center() - observation.center()).norm_squared() / (width * width)).exp())
                .sum();
            let near = near * step as f64 / (std::f64::consts::TAU * width * width);
            densities[index] += (near + uniform).ln();
        }
    }
    densities
}

/// The middles of a frame's boxes and the bandwidth of a kernel density estimate over them.
struct Places {
    middles: Vec<Vector2<f64>>,
    bandwidth: Vector2<f64>,
    count: f64,
}

fn places(boxes: &[BoxObservation]) -> Places {
    let count = boxes.len() as f64;
    let mean = boxes.iter().map(BoxObservation::center).sum::<Vector2<f64>>() / count;
    let square = |b: &BoxObservation| (b.center() - mean).map(|x| x * x);
    let sd = (boxes.iter().map(square).sum::<Vector2<f64>>() / count).map(f64::sqrt);
    let half_size = boxes.iter().map(|b| b.half_size).sum::<f64>() / count;
    let step = boxes.len().div_ceil(MAX_NEIGHBORS).max(1);
    let middles = boxes.iter().step_by(step).map(BoxObservation::center).collect();
    Places { middles, bandwidth: (0.7 * sd).add_scalar(half_size), count }
}

/// Log density of the position of a clutter box, per square pixel: near the frame's other boxes, or uniform.
fn place_density(places: &Places, observation: &BoxObservation, image: Vector2<f64>) -> f64 {
    let uniform = 1.0 / image.product();
    let kernel = |d: Vector2<f64>| (-0.5 * d.component_div(&places.bandwidth).norm_squared()).exp();
    // The box itself is among the positions (as a whole number of samples, when sampled): its own kernel is subtracted.
    let share = (places.middles.len() as f64 / places.count).min(1.0);
    let others: f64 = places.middles.iter().map(|m| kernel(m - observation.center())).sum::<f64>() - share;
    let others = others.max(0.0) / (std::f64::consts::TAU * places.bandwidth.product());
    let density = if places.count > 1.0 { others / (share * (places.count - 1.0)) } else { uniform };
    let weight = places.count / (places.count + UNIFORM_WEIGHT);
    (weight * density + (1.0 - weight) * uniform).max(uniform).ln()
}
