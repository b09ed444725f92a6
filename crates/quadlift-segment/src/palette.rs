//! Palettes: the colors of a region as a mixture of Gaussians.

use nalgebra::{Matrix3, Vector3};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;

use crate::vector_math::{exp, ln, weighted_sums};

/// Standard deviation that every Gaussian has at least, in scaled CIELAB: noise of the camera and of compression.
pub(crate) const COLOR_NOISE: f64 = 0.01;

/// Colors of many pixels, one list for each axis of the color space.
pub(crate) type Colors = [Vec<f32>; 3];

/// The same part of the three lists.
pub(crate) fn part(colors: &Colors, range: std::ops::Range<usize>) -> [&[f32]; 3] {
    [&colors[0][range.clone()], &colors[1][range.clone()], &colors[2][range]]
}

/// One Gaussian of a palette.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Gaussian {
    /// Its share of the palette.
    pub weight: f64,
    pub mean: Vector3<f64>,
    pub covariance: Matrix3<f64>,
}

/// The colors of one region; the weights sum to 1.
pub(crate) type Palette = Vec<Gaussian>;

/// A Gaussian prepared to be evaluated: `log(weight N(z)) = constant - |W z - shift|^2 / 2`, W lower triangular.
#[derive(Debug, Clone, Copy)]
pub(crate) struct LogDensity {
    whitening: [f32; 6],
    shift: [f32; 3],
    constant: f32,
}

impl LogDensity {
    pub(crate) fn new(gaussian: &Gaussian) -> Self {
        // The Cholesky factor L of the covariance, then its inverse W. The floor is never reached by covariances that
        // hold the noise; it keeps rounding from making NaN.
        let c = &gaussian.covariance;
        let root = |x: f64| x.max(1e-10).sqrt();
        let l00 = root(c.m11);
        let (l10, l20) = (c.m21 / l00, c.m31 / l00);
        let l11 = root(c.m22 - l10 * l10);
        let l21 = (c.m32 - l20 * l10) / l11;
        let l22 = root(c.m33 - l20 * l20 - l21 * l21);
        let (w00, w11, w22) = (1.0 / l00, 1.0 / l11, 1.0 / l22);
        let w10 = -l10 * w00 * w11;
        let w21 = -l21 * w11 * w22;
        let w20 = -(l20 * w00 + l21 * w10) * w22;
        let m = &gaussian.mean;
        let log_weight = gaussian.weight.max(1e-30).ln();
        Self {
            whitening: [w00, w10, w11, w20, w21, w22].map(|x| x as f32),
            shift: [w00 * m.x, w10 * m.x + w11 * m.y, w20 * m.x + w21 * m.y + w22 * m.z].map(|x| x as f32),
            constant: (log_weight + (w00 * w11 * w22).ln() - 1.5 * std::f64::consts::TAU.ln()) as f32,
        }
    }

    /// The log densities of a row of colors.
    pub(crate) fn evaluate(&self, [a, b, c]: [&[f32]; 3], out: &mut [f32]) {
        let ([w00, w10, w11, w20, w21, w22], [s0, s1, s2]) = (self.whitening, self.shift);
        for (((out, &a), &b), &c) in out.iter_mut().zip(a).zip(b).zip(c) {
            let x = w00 * a - s0;
            let y = w10 * a + w11 * b - s1;
            let z = w20 * a + w21 * b + w22 * c - s2;
            *out = self.constant - 0.5 * (x * x + y * y + z * z);
        }
    }
}

/// `log b(z)` of a row of colors under a mixture, and in `responsibilities` (a row for each Gaussian, one after the
/// other) the part of each Gaussian in it.
pub(crate) fn mixture_row(
    densities: &[LogDensity],
    colors: [&[f32]; 3],
    responsibilities: &mut [f32],
    log_likelihood: &mut [f32],
) {
    let n = log_likelihood.len();
    log_likelihood.fill(f32::MIN);
    for (density, row) in densities.iter().zip(responsibilities.chunks_exact_mut(n)) {
        density.evaluate(colors, row);
        for (top, &value) in log_likelihood.iter_mut().zip(&*row) {
            *top = if value > *top { value } else { *top };
        }
    }
    // Without allocation: a second buffer on the stack for rows of any length, in pieces.
    const PIECE: usize = 64;
    let mut start = 0;
    while start < n {
        let end = (start + PIECE).min(n);
        let mut total = [0.0f32; PIECE];
        let total = &mut total[..end - start];
        let top = &mut log_likelihood[start..end];
        for row in responsibilities.chunks_exact_mut(n) {
            for ((value, total), &top) in row[start..end].iter_mut().zip(&mut *total).zip(&*top) {
                *value = exp(*value - top);
                *total += *value;
            }
        }
        for (top, total) in top.iter_mut().zip(&mut *total) {
            *top += ln(*total);
            *total = 1.0 / *total;
        }
        for row in responsibilities.chunks_exact_mut(n) {
            for (value, &inverse) in row[start..end].iter_mut().zip(&*total) {
                *value *= inverse;
            }
        }
        start = end;
    }
}

/// Weight, and sums of the colors and of their products (xx, xy, xz, yy, yz, zz), over the pixels of a Gaussian.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct ColorSums(pub [f64; 10]);

impl ColorSums {
    /// Adds a row of colors with weights; `products` are those of [`color_products`].
    ///
    /// A row is added up in f32, the rows in f64.
    pub(crate) fn add_row(&mut self, weights: &[f32], colors: [&[f32]; 3], products: [&[f32]; 6]) {
        let [x, y, z] = colors;
        let [xx, xy, xz, yy, yz, zz] = products;
        let sums = weighted_sums(weights, [x, y, z, xx, xy, xz, yy, yz, zz]);
        for (total, value) in self.0.iter_mut().zip(sums) {
            *total += f64::from(value);
        }
    }

    /// Adds `factor` times other sums.
    pub(crate) fn add_scaled(&mut self, other: &Self, factor: f64) {
        for (a, b) in self.0.iter_mut().zip(&other.0) {
            *a += factor * b;
        }
    }

    /// Number of pixels, mean and covariance (with the noise added) given an earlier Gaussian that counts as a
    /// thousandth of a pixel, so that one without pixels stays where it is.
    pub(crate) fn gaussian(&self, earlier: &Gaussian) -> (f64, Vector3<f64>, Matrix3<f64>) {
        const EARLIER: f64 = 1e-3;
        let [n, x, y, z, xx, xy, xz, yy, yz, zz] = self.0;
        let total = n + EARLIER;
        let mean = (Vector3::new(x, y, z) + earlier.mean * EARLIER) / total;
        let second = Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz);
        let second = (second + (earlier.covariance + earlier.mean * earlier.mean.transpose()) * EARLIER) / total;
        let covariance = second - mean * mean.transpose() + Matrix3::identity() * (COLOR_NOISE * COLOR_NOISE);
        (n, mean, covariance)
    }
}

/// The palette of the pixels that `sums` were taken over: one pixel more for each Gaussian, so that no weight vanishes.
pub(crate) fn palette_of(sums: &[ColorSums], earlier: &[Gaussian]) -> Palette {
    let total: f64 = sums.iter().map(|s| s.0[0] + 1.0).sum();
    sums.iter()
        .zip(earlier)
        .map(|(sums, earlier)| {
            let (n, mean, covariance) = sums.gaussian(earlier);
            Gaussian { weight: (n + 1.0) / total, mean, covariance }
        })
        .collect()
}

/// The six products of the colors' axes.
pub(crate) fn color_products([x, y, z]: [&[f32]; 3], products: &mut [Vec<f32>; 6]) {
    for (product, (a, b)) in products.iter_mut().zip([(x, x), (x, y), (x, z), (y, y), (y, z), (z, z)]) {
        product.clear();
        product.extend(a.iter().zip(b).map(|(a, b)| a * b));
    }
}

/// Draws `count` indices with probabilities proportional to the (non-negative) weights; empty when all
/// are zero.
pub(crate) fn draw_indices(weights: impl Iterator<Item = f64>, count: usize, rng: &mut ChaCha8Rng) -> Vec<usize> {
    let mut total = 0.0;
    let cumulative: Vec<f64> = weights
        .map(|weight| {
            total += weight;
            total
        })
        .collect();
    if total.is_nan() || total <= 0.0 {
        return Vec::new();
    }
    let draw = |rng: &mut ChaCha8Rng| {
        let u = rng.random_range(0.0..1.0f64) * total;
        cumulative.partition_point(|&c| c <= u).min(cumulative.len() - 1)
    };
    (0..count).map(|_| draw(rng)).collect()
}

/// Points of a mixture's first clusters (k-means++ and some rounds of k-means).
fn clusters(colors: &Colors, count: usize, rng: &mut ChaCha8Rng) -> Vec<usize> {
    let n = colors[0].len();
    let point = |i: usize| [colors[0][i], colors[1][i], colors[2][i]];
    let distance = |a: [f32; 3], b: [f32; 3]| (0..3).map(|c| (a[c] - b[c]) * (a[c] - b[c])).sum::<f32>();
    let mut centers = vec![point(rng.random_range(0..n))];
    let mut nearest = vec![f32::MAX; n];
    while centers.len() < count {
        let last = centers[centers.len() - 1];
        for (i, d) in nearest.iter_mut().enumerate() {
            *d = d.min(distance(point(i), last));
        }
        // The small term: where all colors are the same, any of them will do.
        let drawn = draw_indices(nearest.iter().map(|&d| f64::from(d) + 1e-12), 1, rng);
        centers.push(drawn.first().map_or(last, |&i| point(i)));
    }
    let mut assigned = vec![0; n];
    for _ in 0..7 {
        let mut sums = vec![[0.0f64; 4]; count];
        let mut changed = false;
        for (i, assigned) in assigned.iter_mut().enumerate() {
            let p = point(i);
            let (mut best, mut least) = (0, f32::MAX);
            for (k, center) in centers.iter().enumerate() {
                let d = distance(p, *center);
                if d < least {
                    (best, least) = (k, d);
                }
            }
            changed |= best != *assigned;
            *assigned = best;
            for c in 0..3 {
                sums[best][c] += f64::from(p[c]);
            }
            sums[best][3] += 1.0;
        }
        if !changed {
            break;
        }
        for (center, sums) in centers.iter_mut().zip(&sums) {
            if sums[3] > 0.0 {
                *center = std::array::from_fn(|c| (sums[c] / sums[3]) as f32);
            }
        }
    }
    assigned
}

/// Pixels that are worked on together.
const ROW: usize = 64;
/// Rounds of EM after the clusters are found.
const ROUNDS: usize = 8;

/// Fits a mixture of `count` Gaussians to at least one color.
pub(crate) fn fit_palette(colors: &Colors, count: usize, rng: &mut ChaCha8Rng) -> Palette {
    let n = colors[0].len();
    let nothing = Gaussian { weight: 0.0, mean: Vector3::zeros(), covariance: Matrix3::identity() };
    let mut palette = vec![nothing; count];
    let assigned = clusters(colors, count, rng);
    let mut products = Default::default();
    let mut responsibilities = vec![0.0; count * ROW];
    let mut log_likelihood = vec![0.0; ROW];
    for round in 0..ROUNDS {
        let densities: Vec<LogDensity> = palette.iter().map(LogDensity::new).collect();
        let mut sums = vec![ColorSums::default(); count];
        for start in (0..n).step_by(ROW) {
            let range = start..(start + ROW).min(n);
            let length = range.len();
            let row = part(colors, range.clone());
            let responsibilities = &mut responsibilities[..count * length];
            if round == 0 {
                responsibilities.fill(0.0);
                for (i, &cluster) in assigned[range].iter().enumerate() {
                    responsibilities[cluster * length + i] = 1.0;
                }
            } else {
                mixture_row(&densities, row, responsibilities, &mut log_likelihood[..length]);
            }
            color_products(row, &mut products);
            for (sums, weights) in sums.iter_mut().zip(responsibilities.chunks_exact(length)) {
                sums.add_row(weights, row, products.each_ref().map(Vec::as_slice));
            }
        }
        palette = palette_of(&sums, &palette);
    }
    palette
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use rand::SeedableRng;

    #[test]
    fn densities_are_those_of_the_formula() {
        let a = Matrix3::new(0.1, 0.0, 0.0, 0.05, 0.2, 0.0, -0.03, 0.1, 0.15);
        let gaussian = Gaussian { weight: 0.3, mean: Vector3::new(0.5, -0.1, 0.2), covariance: a * a.transpose() };
        let z = Vector3::new(0.6f64, 0.0, 0.3);
        let d = z - gaussian.mean;
        let inverse = gaussian.covariance.try_inverse().unwrap();
        let norm = (2.0 * std::f64::consts::PI).powi(3) * gaussian.covariance.determinant();
        let expected = 0.3f64.ln() - 0.5 * (d.dot(&(inverse * d)) + norm.ln());
        let mut out = [0.0];
        LogDensity::new(&gaussian).evaluate([&[0.6], &[0.0], &[0.3]], &mut out);
        assert!((f64::from(out[0]) - expected).abs() < 1e-5, "{} {expected}", out[0]);
    }

    #[test]
    fn a_planted_mixture_is_found() {
        let mut rng = ChaCha8Rng::seed_from_u64(5);
        let means = [[0.2f32, 0.0, 0.1], [0.7, 0.2, -0.3], [0.5, -0.4, 0.3]];
        let mut colors: Colors = Default::default();
        for i in 0..3000 {
            // Shares 1/2, 1/3, 1/6.
            let mean = means[[0, 0, 0, 1, 1, 2][i % 6]];
            for c in 0..3 {
                colors[c].push(mean[c] + rng.random_range(-0.05..0.05f32));
            }
        }
        let mut palette = fit_palette(&colors, 3, &mut rng);
        palette.sort_by(|a, b| b.weight.total_cmp(&a.weight));
        for ((gaussian, mean), share) in palette.iter().zip(means).zip([0.5, 1.0 / 3.0, 1.0 / 6.0]) {
            assert!((gaussian.weight - share).abs() < 2e-3, "{gaussian:?}");
            assert!((gaussian.mean - Vector3::from(mean.map(f64::from))).amax() < 5e-3);
            // Uniform numbers of width 0.1, and the noise that is added.
            let variance = 0.01 / 12.0 + 1e-4;
            assert!((gaussian.covariance - Matrix3::identity() * variance).amax() < 1e-4, "{gaussian:?}");
        }
    }

    #[test]
    fn one_color_is_enough() {
        let colors: Colors = [vec![0.3; 100], vec![0.1; 100], vec![-0.2; 100]];
        for gaussian in fit_palette(&colors, 6, &mut ChaCha8Rng::seed_from_u64(1)) {
            assert!(gaussian.mean.iter().chain(gaussian.covariance.iter()).all(|x| x.is_finite()));
        }
        assert_eq!(draw_indices([0.0, 0.0].into_iter(), 3, &mut ChaCha8Rng::seed_from_u64(1)), []);
    }

    proptest! {
        #[test]
        fn responsibilities_sum_to_one(
            z in proptest::collection::vec(-2.0..2.0f32, 3), spread in 0.001..1.0f64, n in 1..150usize,
        ) {
            let gaussian = |k: f64| Gaussian {
                weight: 0.25,
                mean: Vector3::new(0.3 * k, -0.2 * k, 0.5),
                covariance: Matrix3::identity() * (spread * k),
            };
            let densities: Vec<_> = [1.0, 2.0, 3.0, 4.0].map(|k| LogDensity::new(&gaussian(k))).into();
            let (mut responsibilities, mut log_likelihood) = (vec![0.0; 4 * n], vec![0.0; n]);
            let planes: [Vec<f32>; 3] = std::array::from_fn(|c| (0..n).map(|i| z[c] * (i as f32 / 40.0)).collect());
            mixture_row(&densities, part(&planes, 0..n), &mut responsibilities, &mut log_likelihood);
            for i in 0..n {
                let total: f32 = (0..4).map(|g| responsibilities[g * n + i]).sum();
                prop_assert!((total - 1.0).abs() < 1e-5 && log_likelihood[i].is_finite());
            }
        }
    }
}
