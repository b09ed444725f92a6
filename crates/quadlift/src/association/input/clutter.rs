//! Density of clutter boxes around each box (docs/method.md, section 15.2).

use nalgebra::Vector2;

use super::observations::{BoxObservation, Observations};
use crate::association::statistics::LN_2PI;

/// Other boxes of a frame that are looked at for the density at one; more are sampled evenly.
const MOST_NEIGHBOURS: usize = 2000;

/// Boxes of a frame that count as much as the assumption that clutter is anywhere.
const UNIFORM_WEIGHT: f64 = 3.0;

/// Clutter as a density over boxes: where (more where the frame's other boxes are) and how large (as the scene's).
#[derive(Debug, Clone)]
pub(crate) struct Clutter {
    /// Log density of one clutter box per frame, over its four edges in pixels.
    edges: Vec<f64>,
    /// Log density over the logarithms of half the width and half the height.
    size: Vec<f64>,
}

impl Clutter {
    /// The densities at every box.
    pub fn new(observations: &Observations) -> Self {
        let boxes = &observations.boxes;
        let count = (2 * boxes.len()).max(1) as f64;
        let mean = boxes.iter().flat_map(|b| b.log_half).sum::<f64>() / count;
        let square = |b: &BoxObservation| b.log_half.iter().map(|x| (x - mean) * (x - mean)).sum::<f64>();
        let sd = (boxes.iter().map(square).sum::<f64>() / count).sqrt().max(0.3);
        let constant = -LN_2PI - 2.0 * sd.ln();
        // Cut at three standard deviations.
        let size: Vec<f64> =
            boxes.iter().map(|b| (constant - 0.5 * square(b) / (sd * sd)).max(constant - 4.5)).collect();
        let mut edges = size.clone();
        for (frame, camera) in observations.cameras.iter().enumerate() {
            let places = places(observations, frame);
            for (value, observation) in edges[camera.boxes.clone()].iter_mut().zip(observations.in_frame(frame)) {
                let wh = observation.log_half[0] + observation.log_half[1] + 4.0f64.ln();
                *value += place_density(&places, observation, camera.size) - wh;
            }
        }
        Self { edges, size }
    }

    /// Log density of clutter for each edge of a box, at a log number of clutter boxes per frame.
    pub fn per_edge(&self, index: usize, log_rate: f64) -> f64 {
        0.25 * (log_rate + self.edges[index])
    }

    /// For births: log density over the middle and the two log sizes of what else an unassigned box may be, clutter or
    /// another object near by.
    pub fn among_neighbours(&self, observations: &Observations, log_rate: f64, used: &[bool]) -> Vec<f64> {
        let mut densities = self.size.clone();
        for camera in &observations.cameras {
            let all: Vec<usize> = camera.boxes.clone().filter(|&i| !used[i]).collect();
            let step = all.len().div_ceil(MOST_NEIGHBOURS).max(1);
            let uniform = log_rate.exp() / camera.size.product();
            for &index in &all {
                let observation = &observations.boxes[index];
                let width = 2.0 * observation.half_size;
                let neighbours = all.iter().step_by(step).filter(|&&i| i != index);
                let near: f64 = neighbours
                    .map(|&i| &observations.boxes[i])
                    .filter(|other| other.category == observation.category)
                    .map(|other| {
                        (-0.5 * (other.center() - observation.center()).norm_squared() / (width * width)).exp()
                    })
                    .sum();
                let near = near * step as f64 / (std::f64::consts::TAU * width * width);
                densities[index] += (near + uniform).ln();
            }
        }
        densities
    }
}

/// The middles of a frame's boxes and the bandwidth of a kernel density estimate over them.
struct Places {
    middles: Vec<Vector2<f64>>,
    bandwidth: Vector2<f64>,
    count: f64,
}

fn places(observations: &Observations, frame: usize) -> Places {
    let boxes = observations.in_frame(frame);
    let count = boxes.len() as f64;
    let mean = boxes.iter().map(BoxObservation::center).sum::<Vector2<f64>>() / count;
    let square = |b: &BoxObservation| (b.center() - mean).map(|x| x * x);
    let sd = (boxes.iter().map(square).sum::<Vector2<f64>>() / count).map(f64::sqrt);
    let half_size = boxes.iter().map(|b| b.half_size).sum::<f64>() / count;
    let step = boxes.len().div_ceil(MOST_NEIGHBOURS).max(1);
    let middles = boxes.iter().step_by(step).map(BoxObservation::center).collect();
    Places { middles, bandwidth: (0.7 * sd).add_scalar(half_size), count }
}

/// Log density of the place of a clutter box, per square pixel: where the frame's other boxes are, or anywhere.
fn place_density(places: &Places, observation: &BoxObservation, image: Vector2<f64>) -> f64 {
    let uniform = 1.0 / image.product();
    let kernel = |d: Vector2<f64>| (-0.5 * d.component_div(&places.bandwidth).norm_squared()).exp();
    // The box itself is among the places (as a whole number of samples, when sampled): its own kernel is taken off.
    let share = (places.middles.len() as f64 / places.count).min(1.0);
    let others: f64 = places.middles.iter().map(|m| kernel(m - observation.center())).sum::<f64>() - share;
    let others = others.max(0.0) / (std::f64::consts::TAU * places.bandwidth.product());
    let density = if places.count > 1.0 { others / (share * (places.count - 1.0)) } else { uniform };
    let weight = places.count / (places.count + UNIFORM_WEIGHT);
    (weight * density + (1.0 - weight) * uniform).max(uniform).ln()
}
