//! Resampling along one axis of an image, without aliasing.

/// The pixels that one cell of the new grid takes its value from.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Taps {
    /// The first pixel.
    pub first: usize,
    /// Weights of the pixels from `first` on; their sum is 1.
    pub weights: Vec<f32>,
}

/// Weights of the pixels for `count` cells that share the interval `start .. end` (in pixels) evenly.
///
/// A cell's value is the mean over its interval of the linear interpolation between pixel centers: the mean of the
/// pixels where cells are large, interpolation where they are small. Beyond the image (pixels `0 .. size`) the border
/// pixel goes on.
pub(crate) fn taps(start: f64, end: f64, count: usize, size: usize) -> Vec<Taps> {
    let step = (end - start) / count as f64;
    (0..count).map(|cell| cell_taps(start + cell as f64 * step, step, size)).collect()
}

fn cell_taps(start: f64, length: f64, size: usize) -> Taps {
    let last = size as f64 - 1.0;
    let end = start + length;
    // Pixels whose interpolation hat meets the interval; beyond the image all weight is the border pixel's.
    let first = (start - 0.5).floor().clamp(0.0, last) as usize;
    let stop = (end + 0.5).ceil().clamp(0.0, last) as usize;
    let mut weights: Vec<f32> = (first..=stop)
        .map(|pixel| {
            let position = pixel as f64 + 0.5;
            let below = if pixel == 0 { 0.0 } else { ramp_mean(start - (position - 1.0), length) };
            let above = if pixel + 1 == size { 0.0 } else { ramp_mean(start - position, length) };
            // The hat of a pixel is the ramp that rises towards it less the one that rises after it; before the
            // first pixel and after the last one there is nothing to share with.
            (if pixel == 0 { 1.0 - above } else { below - above }) as f32
        })
        .collect();
    let sum: f32 = weights.iter().sum();
    if sum > 0.0 && sum.is_finite() {
        weights.iter_mut().for_each(|weight| *weight /= sum);
    } else {
        // Intervals so far out or so small that nothing is left of the numbers.
        weights = vec![1.0];
    }
    Taps { first, weights }
}

/// Mean over `start .. start + length` of the ramp that is 0 up to 0, rises to 1 at 1 and stays there.
fn ramp_mean(start: f64, length: f64) -> f64 {
    if length < 1e-6 {
        return (start + 0.5 * length).clamp(0.0, 1.0);
    }
    let integral = |x: f64| if x <= 1.0 { 0.5 * x.max(0.0) * x.max(0.0) } else { x - 0.5 };
    (integral(start + length) - integral(start)) / length
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn value(taps: &Taps, pixels: &[f32]) -> f32 {
        taps.weights.iter().zip(&pixels[taps.first..]).map(|(w, p)| w * p).sum()
    }

    #[test]
    fn whole_pixels_are_interpolated_means() {
        // Cells of one pixel, half a pixel off the grid: the mean over [0.5, 1.5] is that of both neighbors.
        let cells = taps(0.5, 3.5, 3, 4);
        assert_eq!(cells[0], Taps { first: 0, weights: vec![0.5, 0.5, 0.0] });
        // On the grid: a quarter of each half is shared with a neighbor, so 1/8 and 3/4.
        let cells = taps(0.0, 4.0, 4, 4);
        for (found, expected) in cells[1].weights.iter().zip([0.125, 0.75, 0.125]) {
            assert!((found - expected).abs() < 1e-6, "{cells:?}");
        }
    }

    proptest! {
        #[test]
        fn lines_are_kept_and_borders_go_on(
            start in -30.0..30.0f64, length in 0.001..60.0f64, count in 1..20usize, size in 1..20usize,
        ) {
            let pixels: Vec<f32> = (0..size).map(|i| i as f32 + 0.5).collect();
            let step = length / count as f64;
            for (cell, taps) in taps(start, start + length, count, size).iter().enumerate() {
                let sum: f32 = taps.weights.iter().sum();
                prop_assert!((sum - 1.0).abs() < 1e-5);
                prop_assert!(taps.weights.iter().all(|&w| w > -1e-5));
                prop_assert!(taps.first + taps.weights.len() <= size);
                // Independent: the mean of the clamped line by many samples.
                let n = 2000;
                let mean: f64 = (0..n)
                    .map(|i| start + (cell as f64 + (f64::from(i) + 0.5) / f64::from(n)) * step)
                    .map(|x| x.clamp(0.5, size as f64 - 0.5))
                    .sum::<f64>() / f64::from(n);
                prop_assert!((f64::from(value(taps, &pixels)) - mean).abs() < 1e-3 * (1.0 + mean), "{taps:?} {mean}");
            }
        }

        #[test]
        fn any_numbers_give_weights(start in any::<f64>(), length in any::<f64>(), size in 1..9usize) {
            prop_assume!(start.is_finite() && length.is_finite());
            let near = |x: f64| x.clamp(-1e12, 1e12);
            for taps in taps(near(start), near(start) + near(length).abs(), 3, size) {
                prop_assert!(taps.weights.iter().all(|w| w.is_finite()));
                prop_assert!(taps.first + taps.weights.len() <= size);
            }
        }
    }
}
