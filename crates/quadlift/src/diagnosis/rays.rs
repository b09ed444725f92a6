//! Rays through the centers of boxes and the point nearest to those of an object (docs/method.md, section 16.1).

use crate::optimize::median::median;
use nalgebra::{Matrix3, Vector2, Vector3};

use super::camera::CameraParts;
use crate::geometry::BoundingBox;
use crate::geometry::linalg::solve_spd;

/// Rounds of reweighting, at most.
const ROUNDS: usize = 8;

/// Rounds end when the sum of the misses changes by less than this share.
const CONVERGED: f64 = 0.003;

/// Where the rays cost this on average, with misses of [`CONTESTED_MISS`] half sizes costing one half, the point may be that
/// of false boxes: points where two rays meet are tried as well...
const CONTESTED: f64 = 0.25;
const CONTESTED_MISS: f64 = 0.2;

/// ...from so many rays on...
const MIN_FOR_PAIRS: usize = 4;

/// ...so many of them, at most.
const MAX_PAIRS: usize = 20;

/// Reprojection errors beyond this, in half sizes, are equally bad: the box shows something else.
pub(crate) const MAX_MISS: f64 = 3.0;

/// A ray through the center of a box.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Ray {
    rotation: Matrix3<f64>,
    translation: Vector3<f64>,
    /// The intersection with the plane at depth one.
    direction: Vector2<f64>,
    /// Half size of the box at depth one.
    half_size: f64,
}

impl Ray {
    /// The ray through the center of a box: the intersection of the planes halfway between those of opposite edges. For
    /// a sphere it passes exactly through the center.
    pub(crate) fn new(camera: &CameraParts, b: &BoundingBox, half_size: f64) -> Self {
        let k = &camera.intrinsics;
        let middle = |low: f64, high: f64| (0.5 * (low.atan() + high.atan())).tan();
        Self {
            rotation: camera.rotation,
            translation: camera.translation,
            direction: Vector2::new(
                middle((b.x0 - k.cx) / k.fx, (b.x1 - k.cx) / k.fx),
                middle((b.y0 - k.cy) / k.fy, (b.y1 - k.cy) / k.fy),
            ),
            half_size: half_size / (k.fx * k.fy).sqrt(),
        }
    }

    /// Half size of the box at depth one.
    pub(crate) fn half_size(&self) -> f64 {
        self.half_size
    }

    /// The camera center in the world.
    pub(crate) fn center(&self) -> Vector3<f64> {
        -(self.rotation.transpose() * self.translation)
    }

    /// Normal of the plane through the ray that is vertical (0) or horizontal (1) in the image, as long as the distance of
    /// a point from it is the distance in the image at depth one times the point's depth.
    pub(crate) fn normal(&self, axis: usize) -> Vector3<f64> {
        (self.rotation.row(axis) - self.rotation.row(2) * self.direction[axis]).transpose()
    }

    /// Depth of a point.
    pub(crate) fn depth(&self, point: &Vector3<f64>) -> f64 {
        self.rotation.row(2).transpose().dot(point) + self.translation.z
    }

    /// Distance of the projected point from the center of the box, in half sizes.
    pub(crate) fn miss(&self, point: &Vector3<f64>) -> f64 {
        let p = self.rotation * point + self.translation;
        if p.z.is_nan() || p.z <= 0.0 {
            return MAX_MISS;
        }
        ((p.xy() / p.z - self.direction).norm() / self.half_size).min(MAX_MISS)
    }
}

/// The miss of each ray by the point that most of them agree with, as large as if the point had not been fitted to them.
pub(crate) fn misses_of(rays: &[Ray]) -> Vec<f64> {
    let Some(point) = meeting_point(rays) else { return vec![MAX_MISS; rays.len()] };
    let count = 2.0 * rays.len() as f64;
    let dof = (count / (count - 3.0).max(1.0)).sqrt();
    rays.iter().map(|ray| (ray.miss(&point) * dof).min(MAX_MISS)).collect()
}

/// The point where most of the rays meet; `None` if they do not meet.
pub(crate) fn meeting_point(rays: &[Ray]) -> Option<Vector3<f64>> {
    let point = refined(rays, least_squares(rays, &vec![1.0; rays.len()])?)?;
    let contested = rays.len() >= MIN_FOR_PAIRS && total_cost(rays, &point) > CONTESTED * rays.len() as f64;
    Some(if contested { best_of_pairs(rays, point) } else { point })
}

/// The point where most of the rays meet, from a start: squared misses with decreasing weights beyond a shrinking
/// scale.
fn refined(rays: &[Ray], start: Vector3<f64>) -> Option<Vector3<f64>> {
    let mut point = start;
    let mut weights = vec![1.0; rays.len()];
    let mut last = f64::INFINITY;
    for round in 0..ROUNDS {
        let mut misses: Vec<f64> = rays.iter().map(|ray| ray.miss(&point)).collect();
        let total: f64 = misses.iter().sum();
        if (total - last).abs() <= CONVERGED * total {
            break;
        }
        last = total;
        weights.copy_from_slice(&misses);
        let scale = (2.0 * median(&mut misses)?).clamp(0.02, if round < 3 { 3.0 } else { 1.0 });
        for (weight, ray) in weights.iter_mut().zip(rays) {
            // The linear residual is the miss times depth and half size.
            let depth = ray.depth(&point).abs().max(1e-12);
            let robust = (1.0 + (*weight / scale).powi(2)).powi(-2);
            *weight = robust / (depth * ray.half_size).powi(2);
        }
        point = least_squares(rays, &weights)?;
    }
    Some(point)
}

/// The point nearest to rays, in squared linear residuals with weights.
fn least_squares(rays: &[Ray], weights: &[f64]) -> Option<Vector3<f64>> {
    if rays.len() < 2 {
        return None;
    }
    let mut normal = Matrix3::zeros();
    let mut right = Vector3::zeros();
    for (ray, weight) in rays.iter().zip(weights) {
        for axis in 0..2 {
            let row = ray.normal(axis);
            let value = ray.direction[axis] * ray.translation.z - ray.translation[axis];
            normal += row * row.transpose() * *weight;
            right += row * (value * weight);
        }
    }
    solve_spd(&normal, &right).filter(|p| p.iter().all(|x| x.is_finite()))
}

/// A better point than the given one, at the intersection of two rays, if other rays agree with it.
fn best_of_pairs(rays: &[Ray], given: Vector3<f64>) -> Vector3<f64> {
    let mut best = (total_cost(rays, &given), given);
    let count = rays.len();
    let pairs = (1..count).flat_map(|step| (0..count - step).map(move |first| (first, first + step)));
    // Distant pairs first: their rays meet at larger angles.
    let mut pairs: Vec<(usize, usize)> = pairs.collect();
    pairs.reverse();
    let stride = pairs.len().div_ceil(MAX_PAIRS);
    for &(a, b) in pairs.iter().step_by(stride) {
        let Some(point) = least_squares(&[rays[a], rays[b]], &[1.0; 2]) else { continue };
        let cost = total_cost(rays, &point);
        if cost < best.0 {
            best = (cost, point);
        }
    }
    let Some(point) = refined(rays, best.1) else { return best.1 };
    if total_cost(rays, &point) < best.0 { point } else { best.1 }
}

/// The cost of the misses of a point, in [0, 1] each.
fn total_cost(rays: &[Ray], point: &Vector3<f64>) -> f64 {
    let bounded = |miss: f64| 1.0 - 1.0 / (1.0 + (miss / CONTESTED_MISS).powi(2));
    rays.iter().map(|ray| bounded(ray.miss(point))).sum()
}
