//! The correction of a support in all directions at once (docs/method.md, section 13): smooth and quick, for searches that ask for it
//! millions of times.
//!
//! The process is taken in even directions and interpolated between them with its own correlation. The point of the object that touches a
//! plane moves with the correction and its slope.

use std::sync::LazyLock;

use nalgebra::{Cholesky, DMatrix, DVector, Dyn, Vector3};

use super::corrected_support::{CorrectedSupport, FARTHEST, REACH, correlation};
use crate::geometry::Body;
use crate::geometry::rotation::on_spiral;
use crate::parallel::map_indices;
use crate::scene::View;

/// Directions, whose neighbors are about as far apart as the process reaches.
const DIRECTIONS: usize = 160;

/// Added to the correlation of a direction with itself: coefficients stay small.
const JITTER: f64 = 1e-4;

/// Standard deviations of the noise and of the process that are compared, in sizes of the body.
const NOISES: [f64; 9] = [0.01, 0.014, 0.02, 0.028, 0.04, 0.056, 0.08, 0.112, 0.16];
const DEVIATIONS: [f64; 6] = [0.01, 0.02, 0.04, 0.08, 0.16, 0.32];

/// Likelihoods of the deviations.
struct Weights {
    /// Logarithm of their sum.
    log_sum: f64,
    weights: [f64; DEVIATIONS.len()],
}

impl Weights {
    fn new(log_likelihoods: [f64; DEVIATIONS.len()]) -> Self {
        let most = log_likelihoods.into_iter().fold(f64::NEG_INFINITY, f64::max);
        let weights = log_likelihoods.map(|x| (x - most).exp());
        Self { log_sum: most + weights.iter().sum::<f64>().ln(), weights }
    }

    /// The geometric mean.
    fn mean_deviation(&self) -> f64 {
        let sum: f64 = self.weights.iter().zip(&DEVIATIONS).map(|(weight, deviation)| weight * deviation.ln()).sum();
        (sum / self.weights.iter().sum::<f64>()).exp()
    }
}

/// How much farther than its body an object reaches.
#[derive(Debug, Clone, PartialEq)]
pub struct SupportCorrection {
    /// Of each direction: coefficients of the correction (world units), and of the share of the process's variance that its edges explain.
    coefficients: Vec<[f64; 2]>,
    /// Standard deviation of the process, world units.
    deviation: f64,
    /// Noise of single edges over that of edges about the body alone.
    noise_ratio: f64,
}

/// The correction in a direction.
#[derive(Debug, Clone, Copy)]
pub(crate) struct PointCorrection {
    /// By how much the point moves that touches a plane with this normal, world units.
    pub shift: Vector3<f64>,
    /// Share of the errors of the body that its edges do not explain.
    pub unexplained: f64,
}

/// Directions, and the Cholesky factor of their correlations.
type Grid = (Vec<Vector3<f64>>, Option<Cholesky<f64, Dyn>>);

/// Evenly spread directions.
static GRID: LazyLock<Grid> = LazyLock::new(|| {
    let direction = |k: usize| on_spiral(k, 1.0 - (2.0 * k as f64 + 1.0) / DIRECTIONS as f64);
    let directions: Vec<Vector3<f64>> = (0..DIRECTIONS).map(direction).collect();
    let correlations = DMatrix::from_fn(DIRECTIONS, DIRECTIONS, |i, j| {
        let jitter = if i == j { JITTER } else { 0.0 };
        correlation((directions[i] - directions[j]).norm_squared()) + jitter
    });
    (directions, correlations.cholesky())
});

impl SupportCorrection {
    /// Of the bodies of a scene and the views that show each of them; `None` without views, or where numbers are not finite. All edges have
    /// one noise, whose likelihood is largest; each body has the mean of its deviations with it.
    pub(crate) fn of_all(objects: &[(&Body, Vec<View>)]) -> Vec<Option<Self>> {
        let all = map_indices(objects.len(), |k| {
            let (body, views) = &objects[k];
            let support = CorrectedSupport::new(body, views);
            let likelihoods = support.log_likelihoods(&NOISES, &DEVIATIONS).map(Weights::new);
            (support, likelihoods)
        });
        let total = |noise: usize| all.iter().map(|(_, likelihoods)| likelihoods[noise].log_sum).sum::<f64>();
        let noise = (0..NOISES.len()).max_by(|a, b| total(*a).total_cmp(&total(*b))).unwrap_or(0);
        let all: Vec<CorrectedSupport> = all
            .into_iter()
            .map(|(support, likelihoods)| support.with_levels(NOISES[noise], likelihoods[noise].mean_deviation()))
            .collect();
        map_indices(objects.len(), |k| if objects[k].1.is_empty() { None } else { Self::new(&all[k]) })
    }

    fn new(support: &CorrectedSupport) -> Option<Self> {
        let (directions, factor) = &*GRID;
        let of_directions: Vec<[f64; 2]> =
            directions.iter().map(|direction| support.amount_and_explained(direction)).collect();
        let solved = [0, 1].map(|k| {
            let values = DVector::from_iterator(DIRECTIONS, of_directions.iter().map(|of| of[k]));
            factor.as_ref().map(|factor| factor.solve(&values))
        });
        let [Some(amounts), Some(explained)] = solved else { return None };
        let coefficients: Vec<[f64; 2]> = amounts.iter().zip(&explained).map(|(a, b)| [*a, *b]).collect();
        let (deviation, noise_ratio) = (support.deviation(), support.noise_ratio());
        let finite = coefficients.iter().flatten().chain([&deviation, &noise_ratio]).all(|x| x.is_finite());
        finite.then_some(Self { coefficients, deviation, noise_ratio })
    }

    /// The correction along a unit vector (world axes).
    pub(crate) fn along(&self, direction: &Vector3<f64>) -> PointCorrection {
        let (mut amount, mut explained, mut slope) = (0.0, 0.0, Vector3::zeros());
        for (other, coefficients) in GRID.0.iter().zip(&self.coefficients) {
            let off = other - direction;
            let squared = off.norm_squared();
            if squared < (FARTHEST * REACH).powi(2) {
                let correlation = correlation(squared);
                amount += coefficients[0] * correlation;
                explained += coefficients[1] * correlation;
                slope += off * (coefficients[0] * correlation / (REACH * REACH));
            }
        }
        // On the sphere.
        slope -= direction * direction.dot(&slope);
        PointCorrection { shift: direction * amount + slope, unexplained: (1.0 - explained).clamp(0.0, 1.0) }
    }

    /// Standard deviation of the correction where no edge explains it, world units.
    pub(crate) fn deviation(&self) -> f64 {
        self.deviation
    }

    /// Standard deviation of edges about the corrected support over that about the body.
    pub(crate) fn noise_ratio(&self) -> f64 {
        self.noise_ratio
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Rotation3;
    use rand_chacha::ChaCha8Rng;
    use rand_chacha::rand_core::SeedableRng;

    use super::super::corrected_support::tests::{body, views};
    use super::*;
    use crate::geometry::{BodyKind, BoundingBox};
    use crate::random::normal;

    /// Evenly spread directions that are none of the grid.
    fn elsewhere() -> impl Iterator<Item = Vector3<f64>> {
        (0..100).map(|k| Vector3::new((k as f64).cos(), (k as f64).sin(), 0.02 * k as f64 - 1.0).normalize())
    }

    /// Views of a cuboid, and the ellipsoid that stands for it.
    fn cuboid() -> (Body, Vec<View>) {
        let truth = body(BodyKind::Cuboid);
        let fitted = Body { half_extents: truth.half_extents * 1.2, kind: BodyKind::Ellipsoid, ..truth };
        (fitted, views(&truth, 30, &Rotation3::identity()))
    }

    #[test]
    fn between_the_directions_the_correction_is_that_of_the_edges() {
        let (fitted, views) = cuboid();
        let support = CorrectedSupport::new(&fitted, &views).with_levels(0.02, 0.1);
        let correction = SupportCorrection::new(&support).unwrap();
        for direction in elsewhere() {
            let [amount, explained] = support.amount_and_explained(&direction);
            let found = correction.along(&direction);
            let off = (found.shift.dot(&direction) - amount).abs();
            assert!(off < 0.03, "{amount}, off by {off}, {found:?}");
            assert!((1.0 - found.unexplained - explained).abs() < 0.15, "{explained} {found:?}");
            // The point that touches the plane is the slope of the support.
            let across = direction.cross(&Vector3::new(0.3, -0.7, 0.2)).normalize();
            let turned = |by: f64| {
                let turned = (direction + across * by).normalize();
                correction.along(&turned).shift.dot(&turned)
            };
            let slope = (turned(1e-5) - turned(-1e-5)) / 2e-5;
            assert!((found.shift.dot(&across) - slope).abs() < 1e-4, "{slope} {found:?}");
        }
    }

    /// Boxes with noise of a body of the right kind leave it nearly as it is; exact boxes of another body show it.
    #[test]
    fn noise_is_told_from_what_edges_have_in_common() {
        let truth = body(BodyKind::Ellipsoid);
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let noisy: Vec<View> = views(&truth, 30, &Rotation3::identity())
            .into_iter()
            .map(|view| {
                let exact = view.bounding_box.unwrap();
                let edges = exact.edges().map(|edge| edge + 0.05 * exact.mean_half_size() * normal(&mut rng));
                View { bounding_box: Some(BoundingBox::new(edges).unwrap()), ..view }
            })
            .collect();
        let size = truth.half_extents.product().cbrt();
        let of = |body: &Body, views: Vec<View>| SupportCorrection::of_all(&[(body, views)]).remove(0).unwrap();
        let right = of(&truth, noisy);
        assert!(right.deviation < 0.06 * size && right.noise_ratio > 0.8, "{} {}", right.deviation, right.noise_ratio);
        let (fitted, views) = cuboid();
        let other = of(&fitted, views);
        assert!(other.deviation > 0.05 * size && other.noise_ratio < 0.3, "{} {}", other.deviation, other.noise_ratio);
        assert_eq!(SupportCorrection::of_all(&[(&truth, Vec::new())]), [None]);
    }
}
