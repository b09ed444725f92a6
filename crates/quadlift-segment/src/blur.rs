//! Gaussian blur of a map on the grid.

use std::f32::consts::SQRT_2;

/// A Gaussian filter of a standard deviation in pixels, cut at four of them; the border goes on.
#[derive(Debug, Clone)]
pub(crate) struct Blur {
    /// Weights from the center outwards; with their mirror images they sum to 1.
    weights: Vec<f32>,
}

impl Blur {
    pub(crate) fn new(sigma: f32) -> Self {
        let reach = (4.0 * sigma.max(0.0) + 0.5) as usize;
        let mut weights: Vec<f32> =
            (0..=reach).map(|i| if i == 0 { 1.0 } else { (-(i as f32 / (sigma * SQRT_2)).powi(2)).exp() }).collect();
        let sum = 2.0 * weights.iter().sum::<f32>() - weights[0];
        weights.iter_mut().for_each(|weight| *weight /= sum);
        Self { weights }
    }

    /// Blurs a square map of `grid * grid` values in place; `scratch` is for use inside.
    pub(crate) fn apply(&self, map: &mut [f32], grid: usize, scratch: &mut Vec<f32>) {
        let reach = self.weights.len() - 1;
        if reach == 0 || grid == 0 {
            return;
        }
        // Along the rows, from a copy of each that goes on beyond its ends.
        for row in map.chunks_exact_mut(grid) {
            scratch.clear();
            scratch.extend(std::iter::repeat_n(row[0], reach));
            scratch.extend_from_slice(row);
            scratch.extend(std::iter::repeat_n(row[grid - 1], reach));
            self.combine(row, &scratch[reach..reach + grid], |i| {
                (&scratch[reach - i..reach - i + grid], &scratch[reach + i..reach + i + grid])
            });
        }
        // Along the columns, whole rows at a time.
        scratch.clear();
        scratch.extend_from_slice(map);
        let row_at = |y: usize| &scratch[y * grid..(y + 1) * grid];
        for (y, row) in map.chunks_exact_mut(grid).enumerate() {
            self.combine(row, row_at(y), |i| (row_at(y.saturating_sub(i)), row_at((y + i).min(grid - 1))));
        }
    }

    fn combine<'a>(&self, out: &mut [f32], center: &[f32], pair: impl Fn(usize) -> (&'a [f32], &'a [f32])) {
        for (out, center) in out.iter_mut().zip(center) {
            *out = self.weights[0] * center;
        }
        for (i, weight) in self.weights.iter().enumerate().skip(1) {
            let (before, after) = pair(i);
            for ((out, before), after) in out.iter_mut().zip(before).zip(after) {
                *out += weight * (before + after);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_point_becomes_the_gaussian_and_constants_stay() {
        let (grid, sigma) = (32, 1.5f32);
        let mut map = vec![0.0; grid * grid];
        map[16 * grid + 15] = 1.0;
        let blur = Blur::new(sigma);
        blur.apply(&mut map, grid, &mut Vec::new());
        let density = |dx: f32, dy: f32| {
            (-(dx * dx + dy * dy) / (2.0 * sigma * sigma)).exp() / (std::f32::consts::TAU * sigma * sigma)
        };
        for (x, y) in [(15, 16), (17, 16), (15, 13), (12, 18)] {
            let expected = density(x as f32 - 15.0, y as f32 - 16.0);
            assert!((map[y * grid + x] - expected).abs() < 2e-4, "{x} {y}");
        }
        assert!((map.iter().sum::<f32>() - 1.0).abs() < 1e-5);
        let mut constant = vec![0.7; grid * grid];
        blur.apply(&mut constant, grid, &mut Vec::new());
        assert!(constant.iter().all(|x| (x - 0.7).abs() < 1e-5));
        Blur::new(0.0).apply(&mut constant, grid, &mut Vec::new());
        assert!(constant.iter().all(|x| (x - 0.7).abs() < 1e-5));
    }
}
