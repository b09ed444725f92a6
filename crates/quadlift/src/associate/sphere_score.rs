//! How well a sphere explains unassigned boxes, without a fit: the test of births.

use nalgebra::{Matrix2, Matrix3, RowVector3, Vector2};

use super::model::Model;
use super::observations::Observations;
use super::problem::Problem;
use super::rays::{LOG_RADIUS_SD, RAY_SD, Sphere};
use super::statistics::LN_2PI;

/// Standard deviation of the logarithm of the aspect of a box around a body that is no sphere.
const LOG_ASPECT_SD: f64 = 0.33;

/// Squared Mahalanobis distance of a box's middle from the predicted one, at most.
const GATE: f64 = 25.0;

/// Nearer than this many radii a sphere has no box.
const NEAREST: f64 = 1.05;

/// What a sphere explains.
#[derive(Debug, Clone, Default)]
pub(super) struct Score {
    /// Logarithm of the ratio of the likelihoods with and without the sphere.
    pub value: f64,
    /// Number of boxes that it explains in the frames that were looked at.
    pub detected: usize,
    /// The boxes, in the order of the frames.
    pub boxes: Vec<u32>,
}

/// Scores spheres over the boxes that are not used.
pub(super) struct SphereScorer<'a> {
    pub problem: &'a Problem<'a>,
    pub observations: &'a Observations,
    pub model: &'a Model,
    /// Boxes that belong to an object already.
    pub used: Vec<bool>,
    /// Log density of what else a box may be.
    pub density: Vec<f64>,
}

impl SphereScorer<'_> {
    /// Whether a box may be claimed for an object of a category.
    pub fn is_free(&self, index: usize, category: usize) -> bool {
        let sighting = &self.observations.boxes[index];
        !self.used[index] && sighting.category == category && !self.problem.is_trusted(sighting)
    }

    /// The penalty of a size that the category's objects do not have; `None` when it is out of the question.
    pub fn size_penalty(&self, log_radius: f64, category: usize) -> Option<f64> {
        let Some(size) = self.model.log_sizes[category] else { return Some(0.0) };
        let deviation = (log_radius - size.mean) / size.sd;
        (deviation.abs() <= 3.5).then_some(0.5 * deviation * deviation)
    }

    /// Scores a sphere of a category in some frames; `covariance` is that of its centre, `rays` the number of boxes that
    /// it comes from.
    pub fn score(
        &self,
        sphere: &Sphere,
        covariance: &Matrix3<f64>,
        rays: usize,
        frames: &[u32],
        category: usize,
    ) -> Score {
        let mut visible = 0;
        let mut best_of_frame: Vec<(u32, f64)> = Vec::new();
        for &frame in frames {
            if let Some(best) = self.best_in_frame(sphere, covariance, rays, frame as usize, category) {
                visible += 1;
                best_of_frame.extend(best);
            }
        }
        // The rate at which it is detected is its own: a box counts when it is more likely than a miss.
        let (mut rate, mut sum, mut detected): (f64, f64, usize) = (0.5, 0.0, 0);
        let threshold = |rate: f64| -(rate / (1.0 - rate)).ln();
        for _ in 0..3 {
            let limit = threshold(rate);
            let gains = best_of_frame.iter().map(|&(_, gain)| gain).filter(|&gain| gain > limit);
            (sum, detected) = gains.fold((0.0, 0), |(sum, n), gain| (sum + gain, n + 1));
            rate = (detected as f64 + 1.0) / (visible as f64 + 2.0);
        }
        let limit = threshold(rate);
        let boxes = best_of_frame.iter().filter(|&&(_, gain)| gain > limit).map(|&(index, _)| index).collect();
        let value = sum + self.problem.rate.log_probability(detected, visible);
        Score { value, detected, boxes }
    }

    /// The free box of a frame that fits best, if any, with its log likelihood ratio; `None` when the frame does not see
    /// the sphere.
    fn best_in_frame(
        &self,
        sphere: &Sphere,
        covariance: &Matrix3<f64>,
        rays: usize,
        frame: usize,
        category: usize,
    ) -> Option<Option<(u32, f64)>> {
        let camera = &self.observations.cameras[frame];
        let radius = sphere.log_radius.exp();
        let h = camera.matrix.fixed_columns::<3>(0) * sphere.center + camera.matrix.column(3);
        if h.z.is_nan() || h.z <= NEAREST * radius {
            return None;
        }
        let place = Vector2::new(h.x / h.z, h.y / h.z);
        let half_size = camera.focal * radius / h.z;
        let inside = place.x >= 0.0 && place.y >= 0.0 && place.x <= camera.size.x && place.y <= camera.size.y;
        if !inside || half_size < self.observations.least_half_size {
            return None;
        }
        // Most frames have no box there: one look before anything is calculated.
        let m = &camera.matrix;
        let slope = |axis: usize| -> RowVector3<f64> {
            (m.fixed_view::<1, 3>(axis, 0) - m.fixed_view::<1, 3>(2, 0) * place[axis]) / h.z
        };
        let (du, dv) = (slope(0), slope(1));
        let (cu, cv) = (du * covariance, dv * covariance);
        let own = (RAY_SD * half_size).powi(2);
        let spread = Matrix2::new(own + cu.dot(&du), cu.dot(&dv), cu.dot(&dv), own + cv.dot(&dv));
        let determinant = spread.determinant();
        if determinant.is_nan() || determinant <= 0.0 {
            return Some(None);
        }
        let reach = (GATE * spread.m11).sqrt();
        let mut best: Option<(u32, f64)> = None;
        // The middles of boxes lie right of their left edges, by half the widest box at most.
        for index in self.observations.overlapping(frame, place.x - reach, place.x + reach) {
            if !self.is_free(index, category) {
                continue;
            }
            let sighting = &self.observations.boxes[index];
            let d = sighting.center() - place;
            let distance =
                (spread.m22 * d.x * d.x - 2.0 * spread.m12 * d.x * d.y + spread.m11 * d.y * d.y) / determinant;
            if distance > GATE {
                continue;
            }
            let [w, h] = sighting.log_half;
            let size_variance = LOG_RADIUS_SD * LOG_RADIUS_SD * (1.0 + 1.0 / rays.max(1) as f64);
            let aspect_variance = LOG_ASPECT_SD * LOG_ASPECT_SD;
            let (size, aspect) = (0.5 * (w + h) - half_size.ln(), 0.5 * (w - h));
            let value = -2.0 * LN_2PI
                - 0.5 * (determinant.ln() + (4.0 * size_variance * aspect_variance).ln())
                - 0.5 * (distance + size * size / size_variance + aspect * aspect / aspect_variance)
                - self.density[index];
            if best.is_none_or(|(_, b)| value > b) {
                best = Some((index as u32, value));
            }
        }
        Some(best)
    }
}
