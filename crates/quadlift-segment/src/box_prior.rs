//! Prior on the pixels of an object in its box, before colors are used (docs/method.md, section 18).

/// Likely places of an object on the grid of crops that were cut with the same margin (ours).
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct BoxPrior {
    /// Probability that a grid pixel shows the object, row by row.
    pub object: Vec<f32>,
    /// Pixels so far outside of the box that they are background for certain.
    pub excluded: Vec<bool>,
    /// 1 for the pixels inside the ellipse that is inscribed in the box, 0 for the others.
    pub core: Vec<f32>,
    /// 1 for the pixels outside of the box, 0 for the others.
    pub ring: Vec<f32>,
}

/// Probability of the object at the center of the box, on the inscribed ellipse and in a corner of the box; linear in
/// between along the distance from the center (1 on the ellipse).
const CENTER: f64 = 0.8;
const EDGE: f64 = 0.45;
const CORNER: f64 = 0.15;
/// Outside of the box: detectors cut parts off.
const OUTSIDE: f64 = 0.03;
/// For pixels that are background for certain; a positive number, so that logarithms stay finite.
const EXCLUDED: f64 = 1e-4;
/// How far the object may extend outside the box, in half sizes of the box.
const SLACK: f64 = 0.12;

impl BoxPrior {
    /// The prior for a grid and the margin its crops were cut with.
    pub(crate) fn new(grid: usize, margin: f64) -> Self {
        let half = 0.5 / (1.0 + 2.0 * margin);
        // +-1 on the edges of the box.
        let at: Vec<f64> = (0..grid).map(|i| ((i as f64 + 0.5) / grid as f64 - 0.5) / half).collect();
        let mut prior = Self { object: vec![], excluded: vec![], core: vec![], ring: vec![] };
        for &y in &at {
            for &x in &at {
                let (radius, reach) = (x.hypot(y), x.abs().max(y.abs()));
                let excluded = reach > 1.0 + SLACK;
                let probability = if excluded {
                    EXCLUDED
                } else if reach > 1.0 {
                    OUTSIDE
                } else if radius <= 1.0 {
                    CENTER + (EDGE - CENTER) * radius
                } else {
                    EDGE + (CORNER - EDGE) * (radius - 1.0) / (std::f64::consts::SQRT_2 - 1.0)
                };
                prior.object.push(probability as f32);
                prior.excluded.push(excluded);
                prior.core.push(if radius < 1.0 { 1.0 } else { 0.0 });
                prior.ring.push(if reach > 1.0 { 1.0 } else { 0.0 });
            }
        }
        prior
    }

    /// How well each pixel stands for the object's colors (from 0 on its edge to 1 in the middle), and for those of
    /// the background (from 0 well inside of the box to 1 outside).
    pub(crate) fn color_weights(&self) -> (Vec<f64>, Vec<f64>) {
        // A trace of everything, so that neither is empty.
        const TRACE: f64 = 1e-6;
        let object = self.object.iter().map(|&p| ((f64::from(p) - 0.4) / 0.4).clamp(0.0, 1.0) + TRACE).collect();
        let background =
            self.object.iter().map(|&p| ((0.3 - f64::from(p)) / 0.3).clamp(0.0, 1.0).powi(2) + TRACE).collect();
        (object, background)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_prior_falls_from_the_center_outwards() {
        let prior = BoxPrior::new(64, 0.2);
        let at = |x: usize, y: usize| f64::from(prior.object[y * 64 + x]);
        // The center of the pixel is half a pixel off both ways: 0.031 of the ellipse's radius.
        assert!((at(32, 32) - (CENTER - 0.031 * (CENTER - EDGE))).abs() < 1e-3);
        assert!(at(32, 32) > at(20, 32) && at(20, 32) > at(12, 32) && at(12, 32) > at(10, 10));
        assert!((at(32, 8) - OUTSIDE).abs() < 1e-6 && (at(1, 1) - EXCLUDED).abs() < 1e-6);
        // Symmetric in x and y.
        assert!((0..64 * 64).all(|i| prior.object[i] == prior.object[64 * 64 - 1 - i]));
        // Box: 64 / 1.4 = 45.7 pixels; core: the ellipse inscribed in it.
        let core: f32 = prior.core.iter().sum();
        assert!((core / (std::f32::consts::PI * 22.857 * 22.857) - 1.0).abs() < 0.01);
        let ring: f32 = prior.ring.iter().sum();
        assert_eq!(ring as usize, 64 * 64 - 46 * 46);
    }
}
