//! Depth images: how far the visible surface of an object is, from the pixels of its mask or of its box.

use std::f64::consts::FRAC_PI_2;

use quadlift::geometry::BoundingBox;

use crate::label_image::LabelImage;
use crate::mask::{Mask, MaskError};

/// Depth of the window of the surface, in half sizes of the box: the object is about as deep as it is wide and high (swept on
/// simulated depth images: 90 % of the errors are within .145, .128 and .173 half sizes with windows of 1.5, 2 and 3; the median of the
/// ellipse in the box without a window has .207).
const WINDOW: f64 = 2.0;

/// Standard deviation of the median depth, in half sizes of the object: in a mask and in a box (68 % of simulated objects are within
/// .016 and .047).
const ERROR_IN_MASK: f64 = 0.016;
const ERROR_IN_BOX: f64 = 0.047;

/// Fewest pixels with a depth.
const FEWEST_PIXELS: usize = 9;

/// Most samples along each side of a box: more do not change a median.
const MOST_SAMPLES: u32 = 100;

/// Standard deviations of a normal distribution per median absolute deviation.
const SD_PER_MAD: f64 = 1.4826;

/// The depth along the optical axis of each pixel of an image.
#[derive(Debug, Clone, PartialEq)]
pub struct DepthImage {
    counts: LabelImage,
    scale: f64,
}

/// Where an object is in an image.
#[derive(Debug, Clone, Copy)]
pub struct Patch<'a> {
    /// The box, in pixels of the image.
    pub bounding_box: BoundingBox,
    /// The mask, in pixels of the image.
    pub mask: Option<&'a Mask>,
    /// Width and height of the image; the depth image may have fewer pixels.
    pub image_size: [f64; 2],
    /// Half the mean of width and height of the box over the focal length: half the size of the object, relative to its depth.
    pub half_size: f64,
}

/// The depth of a visible surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SurfaceDepth {
    /// Median.
    pub median: f64,
    /// Standard deviation of the error of the median.
    pub sd: f64,
}

/// A pixel of a box.
struct Sample {
    depth: f64,
    /// Squared distance from the middle of the box in half sides.
    off_center: f64,
}

impl DepthImage {
    /// A depth image of `width * height` counts, row by row, of so many world units each; 0 where the depth is unknown.
    ///
    /// # Errors
    /// [`MaskError::Length`] if there are not `width * height` counts.
    pub fn new(width: u32, height: u32, counts: Vec<u16>, scale: f64) -> Result<Self, MaskError> {
        Ok(Self { counts: LabelImage::new(width, height, counts)?, scale })
    }

    /// Width and height in pixels.
    pub fn size(&self) -> [u32; 2] {
        [self.counts.width(), self.counts.height()]
    }

    /// The median depth of the visible surface of an object; `None` if too few pixels have a depth.
    ///
    /// In a mask it is the median of its pixels. In a box some pixels show what is behind the object, or before it: of all windows
    /// of depth as long as the object probably is, two half sizes, the one with most pixels is taken, where pixels near the
    /// middle of the box count more (Epanechnikov); then the median of those pixels of the window that lie in the ellipse inscribed
    /// in the box.
    pub fn surface(&self, patch: &Patch) -> Option<SurfaceDepth> {
        self.surface_in(patch, WINDOW)
    }

    fn surface_in(&self, patch: &Patch, half_sizes: f64) -> Option<SurfaceDepth> {
        let samples = self.samples(patch);
        let (mut depths, error) = match patch.mask {
            Some(_) => (samples.iter().map(|sample| sample.depth).collect(), ERROR_IN_MASK),
            None => (window(samples, 1.0 + half_sizes * patch.half_size), ERROR_IN_BOX),
        };
        if depths.len() < FEWEST_PIXELS {
            return None;
        }
        let median = median(&mut depths)?;
        let mut deviations: Vec<f64> = depths.iter().map(|depth| (depth - median).abs()).collect();
        let spread = SD_PER_MAD * self::median(&mut deviations)?;
        // The error of the median of independent depths, and that of the pixels that were chosen.
        let of_median = FRAC_PI_2.sqrt() * spread / (depths.len() as f64).sqrt();
        let sd = of_median.hypot(error * patch.half_size * median);
        (median > 0.0 && sd > 0.0 && sd.is_finite()).then_some(SurfaceDepth { median, sd })
    }

    /// The pixels of the box, and of the mask if there is one, that have a depth; at most [`MOST_SAMPLES`] along each side.
    fn samples(&self, patch: &Patch) -> Vec<Sample> {
        let Patch { bounding_box, mask, image_size, .. } = patch;
        let [width, height] = self.size();
        // Pixels of the image in a pixel of the depth image.
        let [sx, sy] = [image_size[0] / f64::from(width), image_size[1] / f64::from(height)];
        // A mask may reach beyond its box.
        let around = mask.and_then(Mask::bounding_box).unwrap_or(*bounding_box);
        // The pixels whose centres lie inside; casts saturate.
        let range = |low: f64, high: f64, end: u32| {
            ((low - 0.5).ceil().max(0.0) as u32).min(end)
                ..((high - 0.5).floor() + 1.0).max(0.0).min(f64::from(end)) as u32
        };
        let columns = range(around.x0() / sx, around.x1() / sx, width);
        let rows = range(around.y0() / sy, around.y1() / sy, height);
        let stride = |range: &std::ops::Range<u32>| (range.len() as u32).div_ceil(MOST_SAMPLES).max(1) as usize;
        let (center, size) = (bounding_box.center(), bounding_box.size());
        let mut samples = Vec::new();
        for y in rows.clone().step_by(stride(&rows)) {
            for x in columns.clone().step_by(stride(&columns)) {
                let count = self.counts.value(x, y);
                let (u, v) = ((f64::from(x) + 0.5) * sx, (f64::from(y) + 0.5) * sy);
                if count == 0 || mask.is_some_and(|mask| !mask.contains(u as u32, v as u32)) {
                    continue;
                }
                let off_center = (2.0 * (u - center.x) / size.x).powi(2) + (2.0 * (v - center.y) / size.y).powi(2);
                samples.push(Sample { depth: f64::from(count) * self.scale, off_center });
            }
        }
        samples
    }
}

/// The depths of the ellipse inscribed in the box that lie in the window with most of the weight; a window ends at `length` times
/// the depth at which it starts.
fn window(mut samples: Vec<Sample>, length: f64) -> Vec<f64> {
    samples.sort_by(|a, b| a.depth.total_cmp(&b.depth));
    let weight = |sample: &Sample| (1.0 - sample.off_center).max(0.0);
    let (mut best, mut most) = (0..0, 0.0);
    let (mut end, mut inside) = (0, 0.0);
    for start in 0..samples.len() {
        while let Some(sample) = samples.get(end).filter(|sample| sample.depth <= length * samples[start].depth) {
            inside += weight(sample);
            end += 1;
        }
        if inside > most {
            (best, most) = (start..end, inside);
        }
        inside -= weight(&samples[start]);
    }
    samples[best].iter().filter(|sample| sample.off_center <= 1.0).map(|sample| sample.depth).collect()
}

/// The middle number, the larger one of two.
fn median(values: &mut [f64]) -> Option<f64> {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied()
}

#[cfg(test)]
#[path = "depth_image/tests.rs"]
mod tests;
