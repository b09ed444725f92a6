//! How well the views of each object agree with each other: do the rays through its boxes' centres meet?

use nalgebra::{Matrix3, Vector2, Vector3};

use super::camera::CameraParts;
use super::correction::Correction;
use super::sample::{Sample, Seen};
use crate::geometry::BoundingBox;
use crate::geometry::linalg::solve_spd;

/// Rounds of reweighting.
const ROUNDS: usize = 8;

/// Misses beyond this, in half sizes, are equally bad: the box shows something else.
const LARGEST_MISS: f64 = 3.0;

/// Misses below this are as good as none: pixels are rounded, and a box's centre is not quite the object's.
const SMALLEST_MISS: f64 = 0.003;

/// A box that misses by less than this many half sizes agrees with the others of its object.
const AGREES: f64 = 0.5;

/// A box that reaches farther out of the image than this share of the image's size was not measured in it.
const OUTSIDE_MARGIN: f64 = 0.1;

/// How well a scene agrees with itself.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Agreement {
    /// Typical distance between the middle of a box and the object's projected centre, in half sizes of the box: the
    /// scale of a distribution with heavy tails (Student's t, two degrees of freedom), between 0.003 and 3.
    pub miss: f64,
    /// Share of the boxes that miss by less than half of their half size, in [0, 1].
    pub share: f64,
    /// Number of boxes that were looked at.
    pub boxes: usize,
}

/// A ray through the centre of a box.
#[derive(Debug, Clone, Copy)]
struct Ray {
    rotation: Matrix3<f64>,
    translation: Vector3<f64>,
    /// Where it meets the plane at depth one.
    direction: Vector2<f64>,
    /// Half size of the box at depth one.
    half_size: f64,
}

impl Ray {
    /// The ray through the middle of a box: the planes halfway between those of opposite edges meet in it. Through the
    /// centre of a sphere it goes exactly.
    fn new(camera: &CameraParts, b: &BoundingBox, half_size: f64) -> Self {
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

    /// Distance of the projected point from the centre of the box, in half sizes.
    fn miss(&self, point: &Vector3<f64>) -> f64 {
        let p = self.rotation * point + self.translation;
        if p.z.is_nan() || p.z <= 0.0 {
            return LARGEST_MISS;
        }
        ((p.xy() / p.z - self.direction).norm() / self.half_size).min(LARGEST_MISS)
    }
}

/// The misses of all boxes of a sample, object by object.
#[derive(Debug, Clone, Default)]
pub(super) struct Misses {
    /// In half sizes, from 0 to [`LARGEST_MISS`].
    values: Vec<f64>,
    /// Where each object's misses end.
    ends: Vec<usize>,
    /// Scale of the misses, see [`scale_of`].
    scale: f64,
}

impl Misses {
    fn new(values: Vec<f64>, ends: Vec<usize>) -> Self {
        let scale = scale_of(&values);
        Self { values, ends, scale }
    }

    /// What users see of it.
    pub(super) fn agreement(&self) -> Agreement {
        let agreeing = self.values.iter().filter(|miss| **miss < AGREES).count() as f64;
        let boxes = self.values.len();
        Agreement { miss: self.scale, share: agreeing / boxes.max(1) as f64, boxes }
    }

    /// How much better others explain the boxes: the mean decrease of half the negative log likelihood of a box, which
    /// is about that of the logarithm of its miss; the standard deviation of that mean from the differences between objects
    /// (the boxes of an object err together); and the share of all changes, summed over the objects, for the better.
    pub(super) fn gain_of(&self, after: &Self) -> (f64, f64, f64) {
        let total = self.values.len() as f64;
        let (mut start, mut sums) = (0, Vec::with_capacity(self.ends.len()));
        for &end in &self.ends {
            let sum = |misses: &Self| misses.values[start..end].iter().map(|m| cost(*m, misses.scale)).sum::<f64>();
            sums.push((sum(self) - sum(after), (end - start) as f64));
            start = end;
        }
        let gain = sums.iter().map(|(sum, _)| sum).sum::<f64>() / total;
        let objects = sums.len() as f64;
        let squares: f64 = sums.iter().map(|(sum, boxes)| (sum - gain * boxes).powi(2)).sum();
        // One object tells nothing of the differences: as if each box were apart.
        let sd =
            if objects > 1.0 { (squares * objects / (objects - 1.0)).sqrt() / total } else { total.sqrt().recip() };
        let better: f64 = sums.iter().map(|(sum, _)| sum.max(0.0)).sum();
        let all: f64 = sums.iter().map(|(sum, _)| sum.abs()).sum();
        (gain, sd, if all > 0.0 { better / all } else { 0.0 })
    }
}

/// Half the negative log likelihood of a box that misses by `miss`, up to a constant: Student's t distribution in the
/// plane with two degrees of freedom, whose tails hold the outliers.
fn cost(miss: f64, scale: f64) -> f64 {
    scale.ln() + (1.0 + 0.5 * (miss / scale).powi(2)).ln()
}

/// The scale of the misses by maximum likelihood; no smaller than [`SMALLEST_MISS`].
fn scale_of(misses: &[f64]) -> f64 {
    let mut sorted = misses.to_vec();
    sorted.sort_by(f64::total_cmp);
    let mut scale = sorted.get(sorted.len() / 2).copied().unwrap_or(0.0).max(SMALLEST_MISS);
    for _ in 0..20 {
        // Expectation and maximisation: weights 4 / (2 + m^2 / s^2) of two residuals each.
        let sum: f64 = misses.iter().map(|m| m * m * 4.0 / (2.0 + (m / scale).powi(2))).sum();
        scale = (sum / (2.0 * misses.len().max(1) as f64)).sqrt().max(SMALLEST_MISS);
    }
    scale
}

/// Share of the boxes after which a correction may be given up.
const ENOUGH_TO_GIVE_UP: f64 = 0.25;

/// A correction whose first boxes cost so much more than they do as they are is given up.
const HOPELESS: f64 = 0.7;

/// The misses of a sample after a correction, or as it is; `None` where they are hopeless beside `given`, the misses of the
/// sample as it is.
pub(super) fn misses(sample: &Sample, correction: Option<Correction>, given: Option<&Misses>) -> Option<Misses> {
    let frames = correction.and_then(|correction| correction.frames(&sample.frame_ids));
    let total = sample.boxes();
    let (mut values, mut ends) = (Vec::with_capacity(total), Vec::with_capacity(sample.objects.len()));
    // Costs of the boxes so far: after the correction, and as they are.
    let (mut cost_after, mut cost_before) = (0.0, 0.0);
    for object in &sample.objects {
        let ray = |seen: &Seen| corrected_ray(sample, seen, correction, frames.as_deref());
        let rays: Vec<Ray> = object.iter().filter_map(ray).collect();
        let start = values.len();
        // Boxes without a place after the correction speak against it.
        values.extend(std::iter::repeat_n(LARGEST_MISS, object.len() - rays.len()));
        values.extend(object_misses(&rays));
        ends.push(values.len());
        if let Some(given) = given {
            for (after, before) in values[start..].iter().zip(&given.values[start..]) {
                cost_after += cost(*after, given.scale);
                cost_before += cost(*before, given.scale);
            }
            let boxes = values.len() as f64;
            let enough = boxes > ENOUGH_TO_GIVE_UP * total as f64 && values.len() < total;
            if enough && cost_after / boxes > cost_before / boxes + HOPELESS {
                return None;
            }
        }
    }
    (!values.is_empty()).then(|| Misses::new(values, ends))
}

/// The ray of a box after a correction; `frames` has the frame to which the detections of each frame belong then. `None`
/// where the box has no place.
fn corrected_ray(
    sample: &Sample,
    seen: &Seen,
    correction: Option<Correction>,
    frames: Option<&[Option<usize>]>,
) -> Option<Ray> {
    let given = seen.frame as usize;
    let frame = frames.map_or(Some(given), |frames| frames[given])?;
    let mut camera = sample.frames[frame].camera?;
    let image_size = sample.frames[given].image_size;
    let mut bounding_box = seen.bounding_box;
    // The unit of a miss is the half size that was measured, so that boxes that a correction enlarges do not seem to
    // agree better.
    let mut half_size = bounding_box.mean_half_size();
    if let Some(correction) = correction {
        camera = correction.camera(&camera, sample.frames[frame].image_size)?;
        bounding_box = correction.bounding_box(&bounding_box, &camera.intrinsics, image_size)?;
        let (factor, _) = correction.pixel_map(image_size)?;
        half_size *= (factor.x * factor.y).sqrt();
    }
    let fits = lies_in_image(&bounding_box, sample.frames[frame].image_size);
    fits.then(|| Ray::new(&camera, &bounding_box, half_size))
}

/// Whether a box lies in an image, but for a margin; where the size of the image is not known it does.
fn lies_in_image(b: &BoundingBox, image_size: Option<Vector2<f64>>) -> bool {
    image_size.is_none_or(|size| {
        let margin = size * OUTSIDE_MARGIN;
        b.x0 > -margin.x && b.y0 > -margin.y && b.x1 < size.x + margin.x && b.y1 < size.y + margin.y
    })
}

/// The miss of each ray by the point that most of them agree with, as large as if the point had not been fitted to them.
fn object_misses(rays: &[Ray]) -> Vec<f64> {
    let Some(point) = meeting_point(rays) else { return vec![LARGEST_MISS; rays.len()] };
    let count = 2.0 * rays.len() as f64;
    let freedom = (count / (count - 3.0).max(1.0)).sqrt();
    rays.iter().map(|ray| (ray.miss(&point) * freedom).min(LARGEST_MISS)).collect()
}

/// The point where most of the rays meet: squared misses, those beyond a shrinking scale count less and less.
fn meeting_point(rays: &[Ray]) -> Option<Vector3<f64>> {
    if rays.len() < 2 {
        return None;
    }
    let mut weights = vec![1.0; rays.len()];
    let mut point = None;
    for round in 0..ROUNDS {
        let mut normal = Matrix3::zeros();
        let mut right = Vector3::zeros();
        for (ray, weight) in rays.iter().zip(&weights) {
            for axis in 0..2 {
                let row = (ray.rotation.row(axis) - ray.rotation.row(2) * ray.direction[axis]).transpose();
                let value = ray.direction[axis] * ray.translation.z - ray.translation[axis];
                normal += row * row.transpose() * *weight;
                right += row * (value * weight);
            }
        }
        let solution = solve_spd(&normal, &right).filter(|p| p.iter().all(|x| x.is_finite()))?;
        point = Some(solution);
        let misses: Vec<f64> = rays.iter().map(|ray| ray.miss(&solution)).collect();
        let mut sorted = misses.clone();
        sorted.sort_by(f64::total_cmp);
        let scale = (2.0 * sorted[sorted.len() / 2]).clamp(0.02, if round < 3 { 3.0 } else { 1.0 });
        for ((weight, ray), miss) in weights.iter_mut().zip(rays).zip(misses) {
            // The linear residual is the miss times depth and half size.
            let depth = (ray.rotation.row(2).transpose().dot(&solution) + ray.translation.z).abs().max(1e-12);
            let robust = 1.0 / (1.0 + (miss / scale).powi(2)).powi(2);
            *weight = robust / (depth * ray.half_size).powi(2);
        }
    }
    point
}
