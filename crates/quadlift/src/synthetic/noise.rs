//! Noise on exact measurements, and outliers.

use std::f64::consts::{FRAC_PI_2, PI};

use nalgebra::Vector2;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;

use super::options::{Noise, SyntheticOptions};
use crate::geometry::{BoundingBox, BoundingBoxError, Ellipse, EllipseError};
use crate::random;

/// Width and height in pixels that a box keeps when noise would make its edges cross.
const MIN_BOX: f64 = 1e-2;

/// Draws noise and outliers. Each kind of noise has its own random stream, so that they are independent.
pub(super) struct NoiseSource<'a> {
    noise: &'a [Noise],
    outlier_share: f64,
    outliers: ChaCha8Rng,
    by_kind: [ChaCha8Rng; 6],
}

impl<'a> NoiseSource<'a> {
    /// The noise of the options; `first_stream` and the six after it are taken.
    pub(super) fn new(options: &'a SyntheticOptions, first_stream: u64) -> Self {
        Self {
            noise: &options.noise,
            outlier_share: options.outlier_share,
            outliers: random::stream(options.seed, first_stream),
            by_kind: std::array::from_fn(|kind| random::stream(options.seed, first_stream + 1 + kind as u64)),
        }
    }

    /// The ellipse with noise; as everywhere, its first semi-axis is the longer one and its angle in (-pi/2, pi/2].
    pub(super) fn ellipse(&mut self, exact: &Ellipse) -> Result<Ellipse, EllipseError> {
        let Ellipse { mut center, mut semi_axes, mut angle } = *exact;
        let mean_semi_axis = exact.semi_axes.mean();
        for &noise in self.noise {
            let rng = &mut self.by_kind[stream_of(noise)];
            let mut uniform = |amount: f64| amount * rng.random_range(-1.0..=1.0f64);
            match noise {
                Noise::Rotation(degrees) => angle += uniform(degrees).to_radians(),
                Noise::Size(m) => semi_axes *= 1.0 + uniform(m),
                Noise::SizePerAxis(m) => {
                    semi_axes.component_mul_assign(&Vector2::new(1.0 + uniform(m), 1.0 + uniform(m)));
                }
                Noise::Translation(m) => center += Vector2::new(uniform(m), uniform(m)) * mean_semi_axis,
                Noise::TranslationFullAxis(m) => {
                    center += Vector2::new(uniform(m), uniform(m)) * (2.0 * mean_semi_axis);
                }
                Noise::BoxEdges(_) => {}
            }
        }
        if semi_axes.x < semi_axes.y {
            semi_axes = semi_axes.yx();
            angle += FRAC_PI_2;
        }
        angle -= PI * ((angle - FRAC_PI_2) / PI).ceil();
        Ellipse::new(center, semi_axes, angle)
    }

    /// The box with noise, after its edges have been moved by `bias` mean half sizes; where edges would cross, the right or bottom one stays and the box keeps 0.01 px.
    pub(super) fn bounding_box(
        &mut self,
        exact: &BoundingBox,
        bias: &[f64; 4],
    ) -> Result<BoundingBox, BoundingBoxError> {
        let mut edges = exact.edges();
        for (edge, bias) in edges.iter_mut().zip(bias) {
            *edge += bias * exact.mean_half_size();
        }
        for &noise in self.noise {
            if let Noise::BoxEdges(sigma) = noise {
                let rng = &mut self.by_kind[stream_of(noise)];
                for edge in &mut edges {
                    *edge += sigma * exact.mean_half_size() * random::normal(rng);
                }
            }
        }
        let [x0, y0, x1, y1] = edges;
        BoundingBox::new([x0.min(x1 - MIN_BOX), y0.min(y1 - MIN_BOX), x1, y1])
    }

    /// With the probability of an outlier, a wrong box: its center up to 4 mean half sizes away in x and in y, its
    /// half sides 0.4 to 2.5 mean half sizes.
    pub(super) fn outlier(&mut self, exact: &BoundingBox) -> Result<Option<BoundingBox>, BoundingBoxError> {
        // All five numbers are always drawn, so that a greater share keeps the outliers of a smaller one.
        let rng = &mut self.outliers;
        let is_outlier = rng.random_range(0.0..1.0f64) < self.outlier_share;
        let unit = exact.mean_half_size();
        let mut pair = |low: f64, high: f64| Vector2::from_fn(|_, _| rng.random_range(low..high)) * unit;
        let (center, half) = (exact.center() + pair(-4.0, 4.0), pair(0.4, 2.5));
        if !is_outlier {
            return Ok(None);
        }
        let (low, high) = (center - half, center + half);
        BoundingBox::new([low.x, low.y, high.x, high.y]).map(Some)
    }
}

/// Which of the streams a kind of noise draws from.
fn stream_of(noise: Noise) -> usize {
    match noise {
        Noise::Rotation(_) => 0,
        Noise::Size(_) => 1,
        Noise::SizePerAxis(_) => 2,
        Noise::Translation(_) => 3,
        Noise::TranslationFullAxis(_) => 4,
        Noise::BoxEdges(_) => 5,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const COUNT: usize = 20_000;

    fn options(noise: &[Noise]) -> SyntheticOptions {
        SyntheticOptions { seed: 11, noise: noise.to_vec(), ..Default::default() }
    }

    fn exact() -> Ellipse {
        Ellipse::new(Vector2::new(600.0, 400.0), Vector2::new(60.0, 20.0), 0.3).unwrap()
    }

    fn noisy(noise: Noise) -> Vec<Ellipse> {
        let options = options(&[noise]);
        let mut source = NoiseSource::new(&options, 0);
        (0..COUNT).map(|_| source.ellipse(&exact()).unwrap()).collect()
    }

    /// Asserts that the numbers are uniform on [-amount, amount]: range, mean, variance.
    fn assert_uniform(x: impl Iterator<Item = f64>, amount: f64) {
        let x: Vec<f64> = x.collect();
        let mean = x.iter().sum::<f64>() / x.len() as f64;
        let variance = x.iter().map(|x| x * x).sum::<f64>() / x.len() as f64;
        let largest = x.iter().fold(0.0f64, |m, x| m.max(x.abs()));
        assert!(largest <= amount * (1.0 + 1e-9) && largest > 0.99 * amount, "{largest} of {amount}");
        // Four standard errors: sd / sqrt(n) for the mean, 2 / sqrt(5 n) of itself for the variance.
        let n = (x.len() as f64).sqrt();
        assert!(mean.abs() < 4.0 * amount / 3.0f64.sqrt() / n, "{mean}");
        assert!((variance * 3.0 / (amount * amount) - 1.0).abs() < 4.0 * 2.0 / 5.0f64.sqrt() / n, "{variance}");
    }

    #[test]
    fn rotation_noise_turns_only() {
        let ellipses = noisy(Noise::Rotation(45.0));
        assert!(ellipses.iter().all(|e| e.center == exact().center && e.semi_axes == exact().semi_axes));
        assert_uniform(ellipses.iter().map(|e| e.angle - 0.3), 45f64.to_radians());
    }

    #[test]
    fn size_noise_scales_only() {
        let ellipses = noisy(Noise::Size(0.3));
        assert!(ellipses.iter().all(|e| e.center == exact().center && (e.angle - 0.3).abs() < 1e-15));
        assert!(ellipses.iter().all(|e| (e.semi_axes.x / e.semi_axes.y - 3.0).abs() < 1e-12));
        assert_uniform(ellipses.iter().map(|e| e.semi_axes.x / 60.0 - 1.0), 0.3);
        let ellipses = noisy(Noise::SizePerAxis(0.3));
        let factors = |e: &Ellipse| e.semi_axes.component_div(&exact().semi_axes) - Vector2::repeat(1.0);
        assert_uniform(ellipses.iter().map(|e| factors(e).x), 0.3);
        assert_uniform(ellipses.iter().map(|e| factors(e).y), 0.3);
        let product = ellipses.iter().map(|e| factors(e).x * factors(e).y).sum::<f64>() / COUNT as f64;
        // The product of two independent ones has the standard deviation 0.3^2 / 3.
        assert!(product.abs() < 4.0 * 0.03 / (COUNT as f64).sqrt(), "{product}");
    }

    #[test]
    fn translation_noise_is_relative_to_the_mean_axis() {
        for (noise, unit) in [(Noise::Translation(0.3), 40.0), (Noise::TranslationFullAxis(0.3), 80.0)] {
            let ellipses = noisy(noise);
            let moves: Vec<_> = ellipses.iter().map(|e| (e.center - exact().center) / unit).collect();
            assert!(ellipses.iter().all(|e| e.semi_axes == exact().semi_axes));
            assert_uniform(moves.iter().map(|m| m.x), 0.3);
            assert_uniform(moves.iter().map(|m| m.y), 0.3);
            let product = moves.iter().map(|m| m.x * m.y).sum::<f64>() / COUNT as f64;
            assert!(product.abs() < 4.0 * 0.03 / (COUNT as f64).sqrt(), "{product}");
        }
    }

    #[test]
    fn the_longer_axis_stays_first() {
        let round = Ellipse::new(Vector2::zeros(), Vector2::new(10.0, 9.9), 1.5).unwrap();
        let stretched = options(&[Noise::SizePerAxis(0.3)]);
        let mut source = NoiseSource::new(&stretched, 0);
        let (mut kept, mut swapped) = (0, 0);
        for _ in 0..1000 {
            let e = source.ellipse(&round).unwrap();
            assert!(e.semi_axes.x >= e.semi_axes.y);
            kept += usize::from((e.angle - 1.5).abs() < 1e-12);
            swapped += usize::from((e.angle - (1.5 - FRAC_PI_2)).abs() < 1e-12);
        }
        assert_eq!(kept + swapped, 1000);
        assert!(kept > 400 && swapped > 400);
        // Any turn: the angle is the one of the canonical form.
        let turned = options(&[Noise::SizePerAxis(0.3), Noise::Rotation(1000.0)]);
        let mut source = NoiseSource::new(&turned, 0);
        for _ in 0..1000 {
            let e = source.ellipse(&exact()).unwrap();
            let canonical = Ellipse::from_shape(e.center, &e.shape()).unwrap();
            assert!((canonical.angle - e.angle).abs() < 1e-9, "{canonical:?} {e:?}");
        }
    }

    #[test]
    fn the_order_of_the_noises_does_not_matter() {
        let (a, b) = ([Noise::Size(0.2), Noise::Translation(0.1)], [Noise::Translation(0.1), Noise::Size(0.2)]);
        let (a, b) = (options(&a), options(&b));
        let (mut a, mut b) = (NoiseSource::new(&a, 0), NoiseSource::new(&b, 0));
        for _ in 0..10 {
            assert_eq!(a.ellipse(&exact()), b.ellipse(&exact()));
        }
    }

    #[test]
    fn box_noise_has_its_standard_deviation_and_boxes_stay_boxes() {
        let exact = BoundingBox::new([100.0, 200.0, 160.0, 220.0]).unwrap();
        let small = options(&[Noise::BoxEdges(0.1)]);
        let mut source = NoiseSource::new(&small, 0);
        let mut sums = [[0.0f64; 2]; 4];
        for _ in 0..COUNT {
            let noisy = source.bounding_box(&exact, &[0.0; 4]).unwrap();
            for k in 0..4 {
                let x = (noisy.edges()[k] - exact.edges()[k]) / 20.0;
                sums[k][0] += x;
                sums[k][1] += x * x;
            }
        }
        for [sum, squares] in sums {
            let n = COUNT as f64;
            assert!((sum / n).abs() < 4.0 * 0.1 / n.sqrt(), "{}", sum / n);
            assert!((squares / n / 0.01 - 1.0).abs() < 4.0 * (2.0 / n).sqrt(), "{}", squares / n);
        }
        let large = options(&[Noise::BoxEdges(3.0)]);
        let mut source = NoiseSource::new(&large, 0);
        let sizes: Vec<_> = (0..1000).map(|_| source.bounding_box(&exact, &[0.0; 4]).unwrap().size().min()).collect();
        assert!(sizes.iter().all(|&s| s > 0.009));
        assert!(sizes.iter().any(|&s| s < 0.011));
    }

    #[test]
    fn outliers_are_near_the_box_and_as_frequent_as_asked() {
        let exact = BoundingBox::new([100.0, 200.0, 160.0, 220.0]).unwrap();
        let drawn = |outlier_share| {
            let options = SyntheticOptions { outlier_share, ..options(&[]) };
            let mut source = NoiseSource::new(&options, 0);
            (0..COUNT).map(|_| source.outlier(&exact).unwrap()).collect::<Vec<_>>()
        };
        let outliers = drawn(0.3);
        let found: Vec<_> = outliers.iter().flatten().collect();
        let expected = 0.3 * COUNT as f64;
        assert!((found.len() as f64 - expected).abs() < 4.0 * (expected * 0.7).sqrt());
        assert_uniform(found.iter().map(|b| (b.center() - exact.center()).x / 20.0), 4.0);
        assert_uniform(found.iter().map(|b| (b.center() - exact.center()).y / 20.0), 4.0);
        assert_uniform(found.iter().map(|b| 0.5 * b.size().x / 20.0 - 1.45), 1.05);
        assert_uniform(found.iter().map(|b| 0.5 * b.size().y / 20.0 - 1.45), 1.05);
        assert!(drawn(0.0).iter().all(Option::is_none));
        assert!(drawn(1.0).iter().all(Option::is_some));
        // A smaller share gives some of the same outliers.
        assert!(drawn(0.1).iter().zip(&outliers).all(|(few, many)| few.is_none() || few == many));
    }
}
