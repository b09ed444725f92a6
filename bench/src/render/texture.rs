//! Solid textures: a color for every point of space.

use nalgebra::Vector3;
use quadlift::random::normal;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;

/// A linear RGB color, each channel 0 (black) to 1.
pub(super) type Color = Vector3<f32>;

/// Number of waves that are summed for the pattern.
const WAVES: usize = 8;

/// Frequency of the fine pattern against the coarse one.
const FINE: f32 = 12.0;

/// Two or three colors, mixed by a sum of waves in random directions, with a fine pattern of little contrast.
#[derive(Debug, Clone)]
pub(super) struct Texture {
    colors: Vec<Color>,
    /// Wave vectors in periods per unit of length, phases in periods, amplitudes.
    waves: [(Vector3<f32>, f32, f32); WAVES],
    /// Whether the colors have sharp borders.
    hard: bool,
    fine: [Vector3<f32>; 3],
}

impl Texture {
    /// Draws a texture around a color. `contrast` is the standard deviation of the other colors, `scale` the
    /// frequency of the pattern in radians per unit of length.
    pub(super) fn draw(rng: &mut ChaCha8Rng, base: &Color, contrast: f32, scale: f32) -> Self {
        let count = rng.random_range(2..4);
        let spread = contrast * rng.random_range(0.3..1.0f32);
        let mut colors = vec![*base];
        colors.extend((1..count).map(|_| near(rng, base, spread, 0.03)));
        let scale = scale / std::f32::consts::TAU;
        let amplitudes: [f32; WAVES] = std::array::from_fn(|_| rng.random_range(0.3..1.0));
        let norm = (amplitudes.iter().map(|a| a * a).sum::<f32>() / 2.0).sqrt();
        let waves = amplitudes.map(|amplitude| {
            let frequency = scale * rng.random_range(0.5..3.0f32);
            (gaussian(rng) * frequency, rng.random_range(0.0..1.0f32), amplitude / norm)
        });
        let fine = std::array::from_fn(|_| gaussian(rng) * (scale * FINE));
        Self { colors, waves, hard: rng.random_range(0.0..1.0f64) < 0.5, fine }
    }

    /// The color at a point.
    pub(super) fn color(&self, point: &Vector3<f32>) -> Color {
        let field: f32 = self.waves.iter().map(|(vector, phase, a)| a * wave(vector.dot(point) + phase)).sum();
        let sharpness = if self.hard { 2.4 } else { 0.7 };
        let last = self.colors.len() - 1;
        let position = (0.5 + 0.5 * sharpness * field).clamp(0.0, 1.0) * last as f32;
        let index = (position as usize).min(last - 1);
        let between = position - index as f32;
        let color = self.colors[index] * (1.0 - between) + self.colors[index + 1] * between;
        let fine: f32 = self.fine.iter().map(|vector| wave(vector.dot(point))).product();
        color * (1.0 + 0.08 * fine)
    }
}

/// A smooth wave of period 1 from 1 at 0 down to -1 at 0.5 and back, close to a cosine but made of a few
/// multiplications: fast, and the same on every platform.
fn wave(x: f32) -> f32 {
    let t = x - x.floor();
    let hump = t * (1.0 - t);
    1.0 - 32.0 * hump * hump
}

/// Three normal numbers.
fn gaussian(rng: &mut ChaCha8Rng) -> Vector3<f32> {
    Vector3::from_fn(|_, _| normal(rng) as f32)
}

/// A color drawn around another one with a standard deviation, each channel at least `margin` away from 0 and 1.
pub(super) fn near(rng: &mut ChaCha8Rng, base: &Color, deviation: f32, margin: f32) -> Color {
    (base + gaussian(rng) * deviation).map(|channel| channel.clamp(margin, 1.0 - margin))
}

/// A color drawn uniformly, each channel in a range.
pub(super) fn any_color(rng: &mut ChaCha8Rng, range: std::ops::Range<f32>) -> Color {
    Color::from_fn(|_, _| rng.random_range(range.clone()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use quadlift::random::stream;

    #[test]
    fn waves_are_smooth_and_periodic() {
        for k in 0..1000 {
            let x = k as f32 / 100.0 - 5.0;
            assert!((wave(x) - (std::f32::consts::TAU * x).cos()).abs() < 0.15, "{x}");
            assert!((wave(x + 1.0) - wave(x)).abs() < 1e-4);
            assert!((wave(x + 1e-3) - wave(x)).abs() < 0.01);
        }
    }

    #[test]
    fn textures_keep_to_their_colors_and_vary() {
        let mut rng = stream(1, 0);
        for _ in 0..20 {
            let base = any_color(&mut rng, 0.05..0.95);
            let texture = Texture::draw(&mut rng, &base, 0.3, 2.5);
            let low = texture.colors.iter().fold(Color::repeat(9.0), |low, c| low.inf(c));
            let high = texture.colors.iter().fold(Color::repeat(-9.0), |high, c| high.sup(c));
            let mut seen = Vec::new();
            for k in 0..500 {
                let point = Vector3::new(k as f32 * 0.1, (k % 7) as f32, (k % 13) as f32 * 0.3);
                let color = texture.color(&point);
                let slack = 0.09;
                assert!((0..3).all(|i| color[i] > low[i] * (1.0 - slack) && color[i] < high[i] * (1.0 + slack)));
                seen.push(color);
            }
            let range = seen.iter().fold(0.0f32, |range, c| range.max((c - seen[0]).norm()));
            assert!(range > 0.5 * (high - low).norm(), "{range}");
        }
    }
}
