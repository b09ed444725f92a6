//! Distances between the rays through the centers of an object's boxes, before and after a correction.

use nalgebra::{Vector2, Vector3};

use super::agreement::{Agreement, Improvement};
use super::correction::Correction;
use super::rays::{MAX_MISS, Ray, meeting_point, misses_of};
use super::sample::{Sample, Seen};
use crate::geometry::BoundingBox;
use crate::optimize::median::median;

/// Reprojection errors below this are as good as none: pixels are rounded, and a box's center is not quite the object's.
const MIN_MISS: f64 = 0.003;

/// A box that misses by less than this many half sizes agrees with the others of its object.
pub(crate) const AGREES: f64 = 0.5;

/// A box that extends beyond the image by more than this fraction of the image size was not measured in it.
const OUTSIDE_MARGIN: f64 = 0.1;

/// Assumed fraction of outlier boxes: as many as the fits of objects tolerate.
const OUTLIER_SHARE: f64 = 0.3;

/// The misses of all boxes of a sample, object by object.
#[derive(Debug, Clone, Default)]
pub(crate) struct ReprojectionErrors {
    /// In half sizes, from 0 to [`MAX_MISS`].
    values: Vec<f64>,
    /// Where each object's misses end.
    ends: Vec<usize>,
    /// Scale of the misses, see [`scale_of`].
    scale: f64,
    /// The cost of each miss under that scale, see [`cost`].
    costs: Vec<f64>,
}

impl ReprojectionErrors {
    pub(crate) fn new(values: Vec<f64>, ends: Vec<usize>) -> Self {
        let scale = scale_of(&values);
        let costs = values.iter().map(|miss| cost(*miss, scale)).collect();
        Self { values, ends, scale, costs }
    }

    /// The public summary.
    pub(crate) fn agreement(&self) -> Agreement {
        let agreeing = self.values.iter().filter(|miss| **miss < AGREES).count() as f64;
        let boxes = self.values.len();
        Agreement { miss: self.scale, share: agreeing / boxes.max(1) as f64, boxes }
    }

    /// How much better others explain the boxes.
    pub(crate) fn gain_of(&self, after: &Self) -> Improvement {
        let total = self.values.len() as f64;
        let (mut start, mut sums) = (0, Vec::with_capacity(self.ends.len()));
        for &end in &self.ends {
            let sum = |misses: &Self| misses.costs[start..end].iter().sum::<f64>();
            sums.push((sum(self) - sum(after), (end - start) as f64));
            start = end;
        }
        let gain = sums.iter().map(|(sum, _)| sum).sum::<f64>() / total;
        let objects = sums.len() as f64;
        let squares: f64 = sums.iter().map(|(sum, boxes)| (sum - gain * boxes).powi(2)).sum();
        // A single object gives no variance between objects: boxes are treated as independent.
        let sd =
            if objects > 1.0 { (squares * objects / (objects - 1.0)).sqrt() / total } else { total.sqrt().recip() };
        let better: f64 = sums.iter().map(|(sum, _)| sum.max(0.0)).sum();
        let all: f64 = sums.iter().map(|(sum, _)| sum.abs()).sum();
        Improvement {
            before: self.agreement(),
            after: after.agreement(),
            gain,
            sd,
            unanimity: if all > 0.0 { better / all } else { 0.0 },
        }
    }
}

/// Half the negative log likelihood of a box that misses by `miss`, up to a constant: Student's t distribution in the
/// plane with two degrees of freedom, or an outlier, which is uniform up to [`MAX_MISS`].
fn cost(miss: f64, scale: f64) -> f64 {
    let own = (scale * (1.0 + 0.5 * (miss / scale).powi(2))).powi(-2);
    let other = 2.0 / MAX_MISS.powi(2);
    -0.5 * ((1.0 - OUTLIER_SHARE) * own + OUTLIER_SHARE * other).ln()
}

/// The scale of the misses by maximum likelihood; no smaller than [`MIN_MISS`].
fn scale_of(misses: &[f64]) -> f64 {
    let mut sorted = misses.to_vec();
    sorted.sort_by(f64::total_cmp);
    let mut scale = sorted.get(sorted.len() / 2).copied().unwrap_or(0.0).max(MIN_MISS);
    for _ in 0..20 {
        // Expectation and maximization: weights 4 / (2 + m^2 / s^2) of two residuals each.
        let sum: f64 = misses.iter().map(|m| m * m * 4.0 / (2.0 + (m / scale).powi(2))).sum();
        scale = (sum / (2.0 * misses.len().max(1) as f64)).sqrt().max(MIN_MISS);
    }
    scale
}

/// A correction is abandoned after a fraction of the boxes if their mean cost exceeds the cost without the correction
/// by this much.
const HOPELESS: [(f64, f64); 2] = [(0.05, 1.5), (0.25, 0.5)];

/// The misses of a sample after a correction, or as it is; `None` if they are much worse than `given`, the misses of
/// the sample as it is.
pub(crate) fn misses(
    sample: &Sample,
    correction: Option<Correction>,
    given: Option<&ReprojectionErrors>,
) -> Option<ReprojectionErrors> {
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
        values.extend(std::iter::repeat_n(MAX_MISS, object.len() - rays.len()));
        values.extend(misses_of(&rays));
        ends.push(values.len());
        if let Some(given) = given {
            for (after, before) in values[start..].iter().zip(&given.costs[start..]) {
                cost_after += cost(*after, given.scale);
                cost_before += before;
            }
            let boxes = values.len() as f64;
            let loss = (cost_after - cost_before) / boxes;
            if HOPELESS.iter().any(|(share, limit)| boxes > share * total as f64 && loss > *limit) {
                return None;
            }
        }
    }
    (!values.is_empty()).then(|| ReprojectionErrors::new(values, ends))
}

/// The point where most of the rays of boxes meet, as they are; `None` if they do not meet.
pub(crate) fn point_of(sample: &Sample, boxes: &[Seen]) -> Option<Vector3<f64>> {
    let rays: Vec<Ray> = boxes.iter().filter_map(|seen| corrected_ray(sample, seen, None, None)).collect();
    meeting_point(&rays)
}

/// The ray of a box after a correction; `frames` has the frame to which the detections of each frame belong then.
/// `None` if the box has no frame.
pub(crate) fn corrected_ray(
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
    // Reprojection errors are in measured half sizes, so that a correction that enlarges boxes does not seem to improve the
    // agreement.
    let mut half_size = bounding_box.mean_half_size();
    if let Some(correction) = correction {
        camera = correction.camera(&camera, sample.frames[frame].image_size)?;
        bounding_box = correction.bounding_box(&bounding_box, &camera.intrinsics, image_size)?;
        half_size *= correction.pixel_map(image_size)?.scale();
    }
    let fits = lies_in_image(&bounding_box, sample.frames[frame].image_size);
    fits.then(|| Ray::new(&camera, &bounding_box, half_size))
}

/// Whether a box lies in an image, up to a margin; true if the image size is unknown.
fn lies_in_image(b: &BoundingBox, image_size: Option<Vector2<f64>>) -> bool {
    image_size.is_none_or(|size| {
        let margin = size * OUTSIDE_MARGIN;
        b.x0 > -margin.x && b.y0 > -margin.y && b.x1 < size.x + margin.x && b.y1 < size.y + margin.y
    })
}

/// The mean half extent of an object of a sample, in world units: that of the sphere that its boxes show; `None` if its
/// rays do not meet.
pub(crate) fn size(sample: &Sample, object: &[Seen]) -> Option<f64> {
    let rays: Vec<Ray> = object.iter().filter_map(|seen| corrected_ray(sample, seen, None, None)).collect();
    let point = meeting_point(&rays)?;
    let mut sizes: Vec<f64> = rays.iter().map(|ray| ray.half_size() * ray.depth(&point)).collect();
    median(&mut sizes).filter(|size| *size > 0.0)
}
