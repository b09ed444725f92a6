//! Depth images: how far the visible surface of an object is, from the pixels of its mask or of its box.

use crate::label_image::LabelImage;
use crate::mask::{Mask, MaskError};
use crate::surface::{Patch, Sample, Spread, SurfaceDepth, WINDOW, median_depth, of_surface};

/// Fewest pixels with a depth.
const MIN_PIXELS: usize = 9;

/// Most samples along each side of a box: more do not change a median.
const MAX_SAMPLES: u32 = 100;

/// The depth along the optical axis of each pixel of an image.
#[derive(Debug, Clone, PartialEq)]
pub struct DepthImage {
    counts: LabelImage,
    scale: f64,
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
        let samples = of_surface(self.samples(patch), patch, half_sizes);
        // There are enough of them to tell how far their depths spread.
        let spread = Spread { usual: 0.0, counts: 0.0, independent: 1.0 };
        if samples.len() < MIN_PIXELS { None } else { median_depth(&samples, patch, &spread) }
    }

    /// The pixels of the box, and of the mask if there is one, that have a depth; at most [`MAX_SAMPLES`] along each side.
    fn samples(&self, patch: &Patch) -> Vec<Sample> {
        let Patch { bounding_box, mask, image_size, .. } = patch;
        let [width, height] = self.size();
        // Pixels of the image in a pixel of the depth image.
        let [sx, sy] = [image_size[0] / f64::from(width), image_size[1] / f64::from(height)];
        // A mask may reach beyond its box.
        let around = mask.and_then(Mask::bounding_box).unwrap_or(*bounding_box);
        // The pixels whose centers lie inside; casts saturate.
        let range = |low: f64, high: f64, end: u32| {
            ((low - 0.5).ceil().max(0.0) as u32).min(end)
                ..((high - 0.5).floor() + 1.0).max(0.0).min(f64::from(end)) as u32
        };
        let columns = range(around.x0() / sx, around.x1() / sx, width);
        let rows = range(around.y0() / sy, around.y1() / sy, height);
        let stride = |range: &std::ops::Range<u32>| (range.len() as u32).div_ceil(MAX_SAMPLES).max(1) as usize;
        let mut samples = Vec::new();
        for y in rows.clone().step_by(stride(&rows)) {
            for x in columns.clone().step_by(stride(&columns)) {
                let count = self.counts.value(x, y);
                let (u, v) = ((f64::from(x) + 0.5) * sx, (f64::from(y) + 0.5) * sy);
                if count == 0 || mask.is_some_and(|mask| !mask.contains(u as u32, v as u32)) {
                    continue;
                }
                let (depth, off_center) = (f64::from(count) * self.scale, patch.off_center(u, v));
                samples.push(Sample { depth, off_center, index: 0 });
            }
        }
        samples
    }
}

#[cfg(test)]
#[path = "depth_image/tests.rs"]
mod tests;
