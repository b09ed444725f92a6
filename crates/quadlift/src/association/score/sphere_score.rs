//! Scores a sphere on unassigned boxes without a fit: the test of a birth (docs/method.md, section 15.4).

use nalgebra::{Matrix2, Matrix3, RowVector3, Vector2};

use super::free_boxes::{Expected, Free, FreeBoxes, SQUARED_GATE};
use super::rays::{LOG_RADIUS_SD, RAY_SD, Sphere};
use super::scene_statistics::SceneStatistics;
use crate::association::input::clutter::log_density_among_neighbors;
use crate::association::input::context::AssociationContext;
use crate::association::input::observations::{Camera, Observations};
use crate::association::statistics::LN_2PI;

/// Standard deviation of the log aspect of a box around a body that is not a sphere.
const LOG_ASPECT_SD: f64 = 0.33;

/// Nearer than this many radii a sphere has no box.
const NEAREST: f64 = 1.05;

/// The score of a sphere.
#[derive(Debug, Clone, Default)]
pub(crate) struct Score {
    /// Logarithm of the ratio of the likelihoods with and without the sphere.
    pub value: f64,
    /// Number of explained boxes in the tested frames.
    pub detected: usize,
    /// The boxes, in the order of the frames.
    pub boxes: Vec<u32>,
}

/// Scores spheres over the unassigned boxes.
pub(crate) struct SphereScorer<'a> {
    pub context: &'a AssociationContext<'a>,
    pub observations: &'a Observations,
    statistics: &'a SceneStatistics,
    /// The free boxes of each frame.
    free: Vec<FreeBoxes>,
}

impl<'a> SphereScorer<'a> {
    /// For the unused boxes.
    pub(crate) fn new(
        context: &'a AssociationContext<'a>,
        observations: &'a Observations,
        statistics: &'a SceneStatistics,
        used: &[bool],
    ) -> SphereScorer<'a> {
        let density = log_density_among_neighbors(
            (&observations.cameras, &observations.boxes),
            &observations.sizes,
            statistics.log_clutter_rate,
            used,
        );
        let in_frame = |camera: &Camera| {
            let is_free = |&i: &usize| !used[i] && !context.is_trusted(&observations.boxes[i]);
            let free = |i: usize| {
                let observation = &observations.boxes[i];
                let (center, log_half) = (observation.center(), observation.log_half);
                let (category, index) = (observation.category as u32, i as u32);
                Free { center, log_half, density: density[i], category, index }
            };
            FreeBoxes::new(camera.boxes.clone().filter(is_free).map(free).collect())
        };
        let free = observations.cameras.iter().map(in_frame).collect();
        Self { context, observations, statistics, free }
    }

    /// The free boxes of a frame in a category.
    pub(crate) fn free_in(&self, frame: usize, category: usize) -> impl Iterator<Item = u32> + '_ {
        self.free[frame].left().filter(move |b| b.category as usize == category).map(|b| b.index)
    }

    /// All free boxes, by frames.
    pub(crate) fn all_free(&self) -> impl Iterator<Item = usize> + '_ {
        self.free.iter().flat_map(FreeBoxes::left).map(|b| b.index as usize)
    }

    /// Takes boxes away.
    pub(crate) fn take(&mut self, boxes: &[u32]) {
        for &index in boxes {
            self.free[self.observations.boxes[index as usize].frame].take(index);
        }
    }

    /// The penalty of a size that is unusual for the category; `None` if it is impossible.
    pub(crate) fn size_penalty(&self, log_radius: f64, category: usize) -> Option<f64> {
        let Some(size) = self.statistics.log_sizes[category] else { return Some(0.0) };
        let deviation = (log_radius - size.mean) / size.sd;
        (deviation.abs() <= 3.5).then_some(0.5 * deviation * deviation)
    }

    /// Scores a sphere of a category in some frames; `covariance` is that of its center, `rays` the number of boxes that
    /// it comes from.
    pub(crate) fn score(
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
        // Each sphere has its own detection rate: a box counts if it is more likely than a miss.
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
        let value = sum + self.context.rate.log_probability(detected, visible);
        Score { value, detected, boxes }
    }

    /// The best-fitting free box of a frame, if any, with its log likelihood ratio; `None` if the sphere is not visible
    /// in the frame.
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
        let m = &camera.matrix;
        let slope = |axis: usize| -> RowVector3<f64> {
            (m.fixed_view::<1, 3>(axis, 0) - m.fixed_view::<1, 3>(2, 0) * place[axis]) / h.z
        };
        let du = slope(0);
        let own = (RAY_SD * half_size).powi(2);
        // Most frames have no free box there: one look before anything else is calculated.
        let across = own + (du * covariance).dot(&du);
        let reach = (SQUARED_GATE * across).sqrt();
        let free = &self.free[frame];
        let Some(first) = free.first_near(place.x, reach, category as u32) else { return Some(None) };
        let dv = slope(1);
        let off = (du * covariance).dot(&dv);
        let spread = Matrix2::new(across, off, off, own + (dv * covariance).dot(&dv));
        let determinant = spread.determinant();
        if determinant.is_nan() || determinant <= 0.0 {
            return Some(None);
        }
        let size_variance = LOG_RADIUS_SD * LOG_RADIUS_SD * (1.0 + 1.0 / rays.max(1) as f64);
        let aspect_variance = LOG_ASPECT_SD * LOG_ASPECT_SD;
        let constant = -2.0 * LN_2PI - 0.5 * (determinant * 4.0 * size_variance * aspect_variance).ln();
        let expected = Expected {
            category: category as u32,
            place,
            spread,
            determinant,
            log_half_size: half_size.ln(),
            size_variance,
            aspect_variance,
            constant,
        };
        Some(free.best(&expected, first, reach))
    }
}
