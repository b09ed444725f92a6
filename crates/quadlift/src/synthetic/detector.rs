//! ReprojectionErrors and false positives of a detector.

use nalgebra::Vector2;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;

use super::options::Detector;
use crate::geometry::rotation::GOLDEN_ANGLE;
use crate::geometry::{BoundingBox, BoundingBoxError};
use crate::random;

/// Boxes that are smaller than this after clipping at the image border, in pixels, are not detected.
const MIN_BOX: f64 = 2.0;

/// Standard deviation of the edges of a duplicate, in mean half sizes.
const DUPLICATE_SD: f64 = 0.12;

/// Standard deviation of the logarithms of the sides of a false box, relative to a true one.
const FALSE_SIZE_SD: f64 = 0.3;

/// Fraction of an object that others may cover before it is missed.
const MAX_COVERED: f64 = 0.65;

/// Points of an outline that are tested for being covered.
const POINTS: usize = 60;

/// Simulates a detector; each decision has its own random stream, so that they are independent.
pub(super) struct DetectorSource {
    detector: Detector,
    misses: ChaCha8Rng,
    duplicates: ChaCha8Rng,
    false_boxes: ChaCha8Rng,
}

impl DetectorSource {
    /// `first_stream` and the two after it are taken.
    pub(super) fn new(detector: Detector, seed: u64, first_stream: u64) -> Self {
        let stream = |number| random::stream(seed, first_stream + number);
        Self { detector, misses: stream(0), duplicates: stream(1), false_boxes: stream(2) }
    }

    /// Whether an object is missed.
    pub(super) fn misses(&mut self) -> bool {
        self.misses.random_range(0.0..1.0f64) < self.detector.misses
    }

    /// A second box of an object, if there is one.
    pub(super) fn duplicate(&mut self, first: &BoundingBox) -> Option<BoundingBox> {
        let rng = &mut self.duplicates;
        let is_there = rng.random_range(0.0..1.0f64) < self.detector.duplicates;
        let unit = first.mean_half_size();
        let edges = first.edges().map(|edge| edge + DUPLICATE_SD * unit * random::normal(rng));
        BoundingBox::new(edges).ok().filter(|_| is_there)
    }

    /// The false boxes of a frame: as large as one of all true boxes, more or less, somewhere in the region of the true
    /// boxes of the frame. A frame has as many as any other on average.
    pub(super) fn false_boxes(
        &mut self,
        in_frame: &[BoundingBox],
        all: &[BoundingBox],
        frames: usize,
        image: Vector2<f64>,
    ) -> Result<Vec<BoundingBox>, BoundingBoxError> {
        let rng = &mut self.false_boxes;
        let count = poisson(self.detector.false_boxes * all.len() as f64 / frames.max(1) as f64, rng);
        let mut made = Vec::new();
        let Some(region) = in_frame.iter().copied().reduce(hull) else { return Ok(made) };
        for _ in 0..count {
            let size = all[rng.random_range(0..all.len())].size();
            let half = size.map(|x| 0.5 * x * (FALSE_SIZE_SD * random::normal(rng)).exp());
            let center = Vector2::new(rng.random_range(region.x0..region.x1), rng.random_range(region.y0..region.y1));
            let (low, high) = (center - half, center + half);
            made.extend(cut(&BoundingBox::new([low.x, low.y, high.x, high.y])?, image));
        }
        Ok(made)
    }
}

/// The smallest box around two.
fn hull(a: BoundingBox, b: BoundingBox) -> BoundingBox {
    BoundingBox { x0: a.x0.min(b.x0), y0: a.y0.min(b.y0), x1: a.x1.max(b.x1), y1: a.y1.max(b.y1) }
}

/// The part of a box inside of the image, where enough is left.
pub(super) fn cut(bounding_box: &BoundingBox, image: Vector2<f64>) -> Option<BoundingBox> {
    let inside = BoundingBox {
        x0: bounding_box.x0.max(0.0),
        y0: bounding_box.y0.max(0.0),
        x1: bounding_box.x1.min(image.x),
        y1: bounding_box.y1.min(image.y),
    };
    (inside.size().min() >= MIN_BOX).then_some(inside)
}

/// Whether at least half of a box lies inside of the image.
pub(super) fn is_in_image(bounding_box: &BoundingBox, image: Vector2<f64>) -> bool {
    let area = |b: &BoundingBox| b.size().x * b.size().y;
    cut(bounding_box, image).is_some_and(|inside| area(&inside) >= 0.5 * area(bounding_box))
}

/// Of the objects of a frame, given by their boxes and depths, which are covered by nearer ones too much to be
/// detected; outlines count as the ellipses inscribed in the boxes.
pub(super) fn covered(objects: &[(BoundingBox, f64)]) -> Vec<bool> {
    // A spiral that fills the disc evenly.
    let disc = (0..POINTS).map(|k| {
        let (radius, angle) = (((k as f64 + 0.5) / POINTS as f64).sqrt(), GOLDEN_ANGLE * k as f64);
        Vector2::new(angle.cos(), angle.sin()) * radius
    });
    let disc: Vec<Vector2<f64>> = disc.collect();
    let is_covered = |(own, depth): &(BoundingBox, f64)| {
        let nearer: Vec<&BoundingBox> = objects.iter().filter(|(_, d)| d < depth).map(|(b, _)| b).collect();
        let hidden = |point: &&Vector2<f64>| {
            let place = own.center() + own.size().component_mul(point) * 0.5;
            nearer.iter().any(|b| (place - b.center()).component_div(&(b.size() * 0.5)).norm_squared() <= 1.0)
        };
        disc.iter().filter(hidden).count() as f64 > MAX_COVERED * POINTS as f64
    };
    objects.iter().map(is_covered).collect()
}

/// A number from the Poisson distribution, by the products of uniform numbers; large means in parts.
fn poisson(mean: f64, rng: &mut ChaCha8Rng) -> usize {
    const PART: f64 = 30.0;
    let (mut left, mut count) = (mean, 0);
    while left > 0.0 {
        let limit = (-left.min(PART)).exp();
        let mut product = rng.random_range(0.0..1.0f64);
        while product > limit {
            count += 1;
            product *= rng.random_range(0.0..1.0f64);
        }
        left -= PART;
    }
    count
}

#[cfg(test)]
mod tests {
    use super::*;

    fn square(x: f64, side: f64) -> BoundingBox {
        BoundingBox::new([x, 0.0, x + side, side]).unwrap()
    }

    #[test]
    fn poisson_numbers_have_their_mean_and_variance() {
        for mean in [0.0, 0.7, 12.0, 95.0] {
            let mut rng = random::stream(1, 0);
            let numbers: Vec<f64> = (0..4000).map(|_| poisson(mean, &mut rng) as f64).collect();
            let average = numbers.iter().sum::<f64>() / 4000.0;
            let variance = numbers.iter().map(|x| (x - average).powi(2)).sum::<f64>() / 4000.0;
            // Four standard errors; that of the variance is about sqrt(2 / n) of it, more for small means.
            assert!((average - mean).abs() <= 4.0 * (mean / 4000.0).sqrt(), "{mean} {average}");
            assert!((variance - mean).abs() <= 0.15 * mean, "{mean} {variance}");
        }
    }

    #[test]
    fn what_others_cover_is_covered() {
        // In front of the second stands the first, in front of the third nothing.
        let objects = [(square(0.0, 10.0), 1.0), (square(1.0, 8.0), 2.0), (square(20.0, 10.0), 3.0)];
        assert_eq!(covered(&objects), [false, true, false]);
        // Moved by half its width it shows about half of itself.
        assert_eq!(covered(&[(square(0.0, 10.0), 1.0), (square(5.0, 10.0), 2.0)]), [false, false]);
    }

    #[test]
    fn boxes_are_cut_at_the_border() {
        let image = Vector2::new(100.0, 50.0);
        assert_eq!(cut(&square(-4.0, 10.0), image).unwrap().edges(), [0.0, 0.0, 6.0, 10.0]);
        assert!(cut(&square(-9.0, 10.0), image).is_none());
        assert!(is_in_image(&square(-4.0, 10.0), image) && !is_in_image(&square(-6.0, 10.0), image));
    }
}
