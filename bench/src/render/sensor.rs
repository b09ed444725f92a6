//! The camera's sensor: a little blur, changing exposure, and noise that grows with the light.

use quadlift::random::normal;
use quadlift_segment::image::RgbImage;
use rand::{Rng, RngExt};
use rand_chacha::ChaCha8Rng;

use super::texture::Color;

/// Relative standard deviation of the exposure.
const EXPOSURE: f64 = 0.03;

/// Variance of a channel's noise: of the amplifier, and per light (channels from 0 to 1).
const READ_VARIANCE: f32 = 0.012 * 0.012;
const LIGHT_VARIANCE: f32 = 0.0012;

/// Exponent of the tone curve.
const GAMMA: f32 = 1.0 / 1.1;

/// Entries of the tables over a channel's light.
const LEVELS: usize = 4096;

/// The image of the light that falls on the pixels, row by row; `noise` is a factor on exposure changes and noise.
pub(super) fn expose(mut light: Vec<Color>, width: u32, height: u32, noise: f64, rng: &mut ChaCha8Rng) -> RgbImage {
    let exposure = (1.0 + EXPOSURE * noise * normal(rng)).max(0.0) as f32;
    light.iter_mut().for_each(|color| *color = (*color * exposure).map(|x| x.clamp(0.0, 1.0)));
    let sigma = rng.random_range(0.5..1.0f32);
    let blurred = blur(&light, width as usize, height as usize, sigma);
    // Tone and noise depend on the light alone: tables save a root and a power for each channel.
    let table: Vec<(f32, f32)> = (0..LEVELS)
        .map(|level| {
            let tone = (level as f32 / (LEVELS - 1) as f32).powf(GAMMA);
            (tone, noise as f32 * (READ_VARIANCE + LIGHT_VARIANCE * tone).sqrt())
        })
        .collect();
    let mut bytes = Vec::with_capacity(3 * blurred.len());
    for color in &blurred {
        bytes.extend(color.iter().map(|&channel| {
            let (tone, deviation) = table[(channel * (LEVELS - 1) as f32 + 0.5) as usize % LEVELS];
            // The cast cuts off at 0 and 255.
            ((tone + deviation * nearly_normal(rng)) * 255.0 + 0.5) as u8
        }));
    }
    // Three bytes for each pixel: the size cannot be wrong.
    RgbImage::from_raw(width, height, bytes).unwrap_or_default()
}

/// The sum of four uniform numbers, brought to mean 0 and variance 1: close enough to normal for a sensor's noise, and
/// ten times as quick.
fn nearly_normal(rng: &mut ChaCha8Rng) -> f32 {
    let bits = rng.next_u64();
    let sum: i32 = (0..4).map(|k| (bits >> (16 * k)) as u16 as i32).sum();
    (sum as f32 - 2.0 * 65535.0) / (65536.0 * (4.0f32 / 12.0).sqrt())
}

/// A Gaussian blur with a standard deviation of at most 1 pixel; beyond the border the image goes on with its last
/// pixels.
fn blur(image: &[Color], width: usize, height: usize, sigma: f32) -> Vec<Color> {
    const REACH: usize = 3;
    let mut weights: [f32; 2 * REACH + 1] =
        std::array::from_fn(|k| (-0.5 * ((k as f32 - REACH as f32) / sigma).powi(2)).exp());
    let sum: f32 = weights.iter().sum();
    weights.iter_mut().for_each(|weight| *weight /= sum);
    let along = |from: &[Color], size: usize, stride: usize, start: usize, position: usize| -> Color {
        let mut color = Color::zeros();
        for (k, weight) in weights.iter().enumerate() {
            let at = (position + k).saturating_sub(REACH).min(size - 1);
            color += from[start + at * stride] * *weight;
        }
        color
    };
    let rows: Vec<Color> = (0..width * height).map(|i| along(image, width, 1, i - i % width, i % width)).collect();
    (0..width * height).map(|i| along(&rows, height, width, i % width, i / width)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use quadlift::random::stream;

    #[test]
    fn the_noise_has_the_moments_of_the_normal_distribution() {
        let mut rng = stream(1, 0);
        let n = 200_000;
        let x: Vec<f64> = (0..n).map(|_| f64::from(nearly_normal(&mut rng))).collect();
        let moment = |k: i32| x.iter().map(|x| x.powi(k)).sum::<f64>() / f64::from(n);
        assert!(moment(1).abs() < 0.009 && (moment(2) - 1.0).abs() < 0.01 && moment(3).abs() < 0.03);
        // Four uniform numbers have the excess -1.2 / 4.
        assert!((moment(4) - 2.7).abs() < 0.06, "{}", moment(4));
    }

    #[test]
    fn the_blur_keeps_flat_images_and_the_sum_of_a_point() {
        let flat = vec![Color::new(0.2, 0.5, 0.7); 12 * 9];
        for color in blur(&flat, 12, 9, 0.8) {
            assert!((color - flat[0]).amax() < 1e-6);
        }
        let mut point = vec![Color::zeros(); 12 * 9];
        point[4 * 12 + 6] = Color::repeat(1.0);
        let blurred = blur(&point, 12, 9, 0.8);
        assert!((blurred.iter().map(|c| c.x).sum::<f32>() - 1.0).abs() < 1e-5);
        let second: f32 = blurred.iter().enumerate().map(|(i, c)| c.x * ((i % 12) as f32 - 6.0).powi(2)).sum();
        assert!((second - 0.64).abs() < 0.02, "{second}");
    }

    #[test]
    fn without_noise_the_light_is_the_image() {
        let light = vec![Color::new(0.0, 0.5, 1.7); 20 * 20];
        let image = expose(light, 20, 20, 0.0, &mut stream(2, 0));
        let expected = [0, (0.5f32.powf(GAMMA) * 255.0).round() as u8, 255];
        assert!(image.pixels().all(|pixel| (0..3).all(|k| pixel.0[k].abs_diff(expected[k]) <= 1)));
    }

    #[test]
    fn the_noise_is_as_strong_as_it_should_be() {
        let light = vec![Color::repeat(0.5); 100 * 100];
        let image = expose(light, 100, 100, 1.0, &mut stream(3, 0));
        let values: Vec<f64> = image.as_raw().iter().map(|&x| f64::from(x) / 255.0).collect();
        let mean = values.iter().sum::<f64>() / values.len() as f64;
        let variance = values.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / values.len() as f64;
        let expected = f64::from(READ_VARIANCE) + f64::from(LIGHT_VARIANCE) * mean + 1.0 / 255.0f64.powi(2) / 12.0;
        assert!((variance / expected - 1.0).abs() < 0.05, "{variance} {expected}");
    }
}
