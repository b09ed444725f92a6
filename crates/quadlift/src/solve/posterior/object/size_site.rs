//! A learned size as a prior of an ellipsoid (docs/method.md, section 21.3).
//!
//! The boxes of few views leave open which way the axes point, and the best single rotation is then a guess: with lengths of
//! axes as the prior the most probable body is often far from the true one. So the prior is averaged over the rotations that
//! the measurements allow, by importance sampling, and the Gaussian with the mean and the covariance of the posterior takes its
//! place (a site, as in expectation propagation). The coordinates are those of `W = 1/2 log A`, in which the measurements are about
//! Gaussian.

use nalgebra::{Matrix3, SMatrix, SVector, SymmetricEigen, Vector3};

use crate::body_model::BodyModel;
use crate::geometry::linalg::{cholesky, invert_spd, symmetric_eigen3};
use crate::optimize::normal_equations::{NormalEquations, Row};
use crate::random;
use crate::solve::posterior::shared::size_model::{SizeDistribution, first_order, orders};

/// Coordinates of a symmetric matrix: its diagonal, and its other entries times the root of two, so that lengths of vectors are
/// norms of matrices.
pub(crate) const ENTRIES: [(usize, usize); 6] = [(0, 0), (1, 1), (2, 2), (1, 0), (2, 0), (2, 1)];

pub(crate) type Vector6 = SVector<f64, 6>;
pub(crate) type Matrix6 = SMatrix<f64, 6, 6>;

/// Rotations that are drawn, and the fewest that they must be worth.
const NUM_SAMPLES: usize = 192;
const MIN_EFFECTIVE_SAMPLES: f64 = 8.0;

/// Nodes and weights of Gauss and Hermite's quadrature of a normal number, for the scale of Student's t distribution.
const NODES: [(f64, f64); 5] = [
    (-2.856_970, 0.011_257_4),
    (-1.355_626, 0.222_076),
    (0.0, 0.533_333),
    (1.355_626, 0.222_076),
    (2.856_970, 0.011_257_4),
];

/// Added to the precision from which rotations are drawn, so that it has an inverse.
const REGULAR: f64 = 1e-6;

/// Iterations after which an eigenvalue decomposition is given up.
const MAX_ITERATIONS: usize = 200;

/// A Gaussian factor on `W = 1/2 log A` of an ellipsoid, in an object's frame and unit.
#[derive(Debug, Clone)]
pub(crate) struct SizeSite {
    /// The directions between which the entries of W are.
    axes: Matrix3<f64>,
    pub(crate) precision: Matrix6,
    /// The precision times the mean.
    pub(crate) vector: Vector6,
    /// Rows whose squares are the cost.
    rows: Vec<(Vector6, f64)>,
}

/// `sqrt(2)` for entries beside the diagonal.
fn factor(i: usize, j: usize) -> f64 {
    if i == j { 1.0 } else { std::f64::consts::SQRT_2 }
}

fn coordinates(matrix: &Matrix3<f64>) -> Vector6 {
    Vector6::from_fn(|k, _| factor(ENTRIES[k].0, ENTRIES[k].1) * matrix[ENTRIES[k]])
}

fn matrix(u: &Vector6) -> Matrix3<f64> {
    let mut matrix = Matrix3::zeros();
    for (k, &(i, j)) in ENTRIES.iter().enumerate() {
        (matrix[(i, j)], matrix[(j, i)]) = (u[k] / factor(i, j), u[k] / factor(i, j));
    }
    matrix
}

/// The precision of the shape prior.
pub(crate) fn shape_precision(weight: f64) -> Matrix6 {
    let trace = Vector6::from_fn(|k, _| if k < 3 { 1.0 } else { 0.0 });
    (Matrix6::identity() - trace * trace.transpose() / 3.0) * (weight * weight)
}

/// What the measurements tell about W, without a prior on it.
#[derive(Debug, Clone)]
pub(crate) struct ShapeInformation {
    pub axes: Matrix3<f64>,
    pub information: Matrix6,
    pub vector: Vector6,
}

/// A sum of Gaussians, with their logarithmic weights.
#[derive(Default)]
struct Mixture {
    parts: Vec<(f64, Vector6, Matrix6)>,
}

impl Mixture {
    /// Mean and covariance.
    fn moments(&self) -> Option<(Vector6, Matrix6)> {
        let largest = self.parts.iter().map(|part| part.0).fold(f64::NEG_INFINITY, f64::max);
        let (mut sum, mut mean, mut square) = (0.0, Vector6::zeros(), Matrix6::zeros());
        for (log_weight, center, covariance) in &self.parts {
            let weight = (log_weight - largest).exp();
            sum += weight;
            mean += center * weight;
            square += (covariance + center * center.transpose()) * weight;
        }
        mean /= sum;
        let covariance = square / sum - mean * mean.transpose();
        (sum.is_finite() && sum > 0.0).then_some((mean, covariance))
    }
}

/// Logarithm of the integral of `exp(-1/2 x^T A x + b^T x)`, up to a constant, with the mean and covariance of x.
fn integral(precision: &Matrix3<f64>, vector: &Vector3<f64>) -> Option<(f64, Vector3<f64>, Matrix3<f64>)> {
    let covariance = invert_spd(precision)?;
    let root = cholesky(precision)?;
    let mean = covariance * vector;
    let log_determinant = 2.0 * (0..3).map(|k| root[(k, k)].ln()).sum::<f64>();
    Some((0.5 * (vector.dot(&mean) - log_determinant), mean, covariance))
}

impl SizeSite {
    /// The site of a learned size, whose mean is in the unit of the object; `None` where the rotations that the measurements allow are
    /// not those that the size allows. `shape_weight` is that of the shape prior. The measurements are taken to be more certain than
    /// they seem: their precision is divided by `tempered`, and the site is multiplied by it again.
    pub(crate) fn new(
        told: &ShapeInformation,
        size: &SizeDistribution,
        up: Option<&Vector3<f64>>,
        shape_weight: f64,
        tempered: f64,
        seed: u64,
    ) -> Option<Self> {
        let seen = told;
        let told = &ShapeInformation {
            axes: seen.axes,
            information: seen.information / tempered,
            vector: seen.vector / tempered,
        };
        let precision = told.information + shape_precision(shape_weight) + Matrix6::from_diagonal_element(REGULAR);
        let spread = cholesky(&invert_spd(&precision)?)?;
        let center = invert_spd(&precision)? * told.vector;
        let up = up.map(|up| told.axes.tr_mul(up));
        let inverse = invert_spd(&size.covariance)?;
        let dof = size.dof;
        // Scales of the covariance of which Student's t distribution is made (Wilson and Hilferty).
        let scales = NODES.map(|(z, weight)| {
            let root = 1.0 - 2.0 / (9.0 * dof) + z * (2.0 / (9.0 * dof)).sqrt();
            (root.max(0.1).powi(3), weight.ln())
        });
        let mut rng = random::stream(seed, 1);
        let mut mixture = Mixture::default();
        let mut totals = Vec::with_capacity(NUM_SAMPLES);
        for _ in 0..NUM_SAMPLES {
            let drawn = center + spread * Vector6::from_fn(|_, _| random::normal(&mut rng));
            let (values, axes) = symmetric_eigen3(&matrix(&drawn))?;
            let first = first_order(&values, &axes, up.as_ref());
            // W of logarithms of lengths along these axes.
            let embed = |order: [usize; 3]| {
                SMatrix::<f64, 6, 3>::from_columns(&order.map(|k| {
                    let axis = axes.column(k);
                    coordinates(&(axis * axis.transpose()))
                }))
            };
            // The density with which this rotation is drawn; equal axes have more rotations (the factor of Vandermonde).
            let plain = embed([0, 1, 2]);
            let projected =
                |m: &Matrix6, v: &Vector6, b: &SMatrix<f64, 6, 3>| (b.transpose() * m * b, b.transpose() * v);
            let (a, b) = projected(&precision, &told.vector, &plain);
            let (mut drawn_with, x, c) = integral(&a, &b)?;
            for (i, j) in [(0, 1), (0, 2), (1, 2)] {
                let variance = c[(i, i)] + c[(j, j)] - 2.0 * c[(i, j)];
                drawn_with += 0.5 * ((x[i] - x[j]).powi(2) + variance).ln();
            }
            let mut total = 0.0;
            let mut largest = f64::NEG_INFINITY;
            let start = mixture.parts.len();
            for order in orders(size.named) {
                let b = embed(order.map(|k| first[k]));
                let (information, vector) = projected(&told.information, &told.vector, &b);
                for (scale, log_weight) in scales {
                    let prior = inverse * scale;
                    let Some((value, x, c)) = integral(&(information + prior), &(vector + prior * size.mean)) else {
                        continue;
                    };
                    let constant = 1.5 * scale.ln() - 0.5 * size.mean.dot(&(prior * size.mean)) + log_weight;
                    let log = value + constant - drawn_with;
                    largest = largest.max(log);
                    mixture.parts.push((log, b * x, b * c * b.transpose()));
                }
            }
            mixture.parts[start..].iter().for_each(|part| total += (part.0 - largest).exp());
            totals.push(largest + total.ln());
        }
        if worth(&totals) < MIN_EFFECTIVE_SAMPLES {
            return None;
        }
        let (mean, covariance) = mixture.moments()?;
        let posterior = invert_spd(&covariance)?;
        let (values, vectors) = eigen(&((posterior - told.information) * tempered))?;
        // Where several rotations are possible the mixture may be wider than each; no category differs more than any objects do.
        let kept = Matrix6::from_diagonal(&values.map(|x| x.max(shape_weight * shape_weight)));
        let precision = vectors * kept * vectors.transpose();
        let vector = (seen.information + precision) * mean - seen.vector;
        Self::from_parts(told.axes, precision, vector)
    }

    fn from_parts(axes: Matrix3<f64>, precision: Matrix6, vector: Vector6) -> Option<Self> {
        let (values, vectors) = eigen(&precision)?;
        let least = 1e-9 * values.max();
        let rows = (0..6)
            .filter(|&k| values[k] > least)
            .map(|k| {
                let (direction, root) = (vectors.column(k).into_owned(), values[k].sqrt());
                (direction * root, direction.dot(&vector) / root)
            })
            .collect();
        let finite = precision.iter().chain(vector.iter()).all(|x| x.is_finite());
        finite.then_some(Self { axes, precision, vector, rows })
    }

    /// Adds the factor to the objective.
    pub(crate) fn add_to(&self, body: &impl BodyModel, equations: &mut NormalEquations) {
        let Some(entries) = body.log_shape_along(&self.axes) else { return };
        for (row, target) in &self.rows {
            let value: f64 = (0..6).map(|k| row[k] * entries[k].0).sum();
            let by: Row = std::array::from_fn(|p| (0..6).map(|k| row[k] * entries[k].1[p]).sum());
            equations.add_quadratic(value - target, &by);
        }
    }

    /// Precision, and that times the mean, between other directions.
    pub(crate) fn along(&self, axes: &Matrix3<f64>) -> (Matrix6, Vector6) {
        let turn = self.axes.transpose() * axes;
        // Entries between the old directions of a matrix that has one entry between the new ones.
        let columns: [Vector6; 6] = std::array::from_fn(|k| {
            let mut unit = Vector6::zeros();
            unit[k] = 1.0;
            coordinates(&(turn * matrix(&unit) * turn.transpose()))
        });
        let map = Matrix6::from_columns(&columns);
        (map.transpose() * self.precision * map, map.transpose() * self.vector)
    }
}

/// How many equal weights these logarithmic ones are worth.
fn worth(log_weights: &[f64]) -> f64 {
    let largest = log_weights.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let weights = log_weights.iter().map(|log| (log - largest).exp());
    let (sum, squares) = weights.fold((0.0, 0.0), |(sum, squares), w| (sum + w, squares + w * w));
    if squares > 0.0 { sum * sum / squares } else { 0.0 }
}

fn eigen(symmetric: &Matrix6) -> Option<(Vector6, Matrix6)> {
    let scale = symmetric.amax();
    if !scale.is_finite() || scale == 0.0 || !symmetric.iter().all(|x| x.is_finite()) {
        return None;
    }
    let found =
        SymmetricEigen::try_new((symmetric + symmetric.transpose()) * (0.5 / scale), f64::EPSILON, MAX_ITERATIONS)?;
    Some((found.eigenvalues * scale, found.eigenvectors))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::body_model::ellipsoid::EllipsoidModel;

    const SHAPE_WEIGHT: f64 = 2.5;

    fn size(named: bool) -> SizeDistribution {
        let mean = Vector3::new(0.5, 0.0, -0.4);
        SizeDistribution { mean, covariance: Matrix3::from_diagonal_element(0.02), dof: 1e4, named }
    }

    /// Measurements of a body with these axes that tell W with these standard deviations.
    fn told(axes: &Matrix3<f64>, sds: [f64; 6]) -> ShapeInformation {
        let w = axes * Matrix3::from_diagonal(&Vector3::new(0.6, 0.1, -0.3)) * axes.transpose();
        let information = Matrix6::from_diagonal(&Vector6::from(sds.map(|sd| sd.powi(-2))));
        ShapeInformation { axes: Matrix3::identity(), information, vector: information * coordinates(&w) }
    }

    /// Against the mean over sizes and rotations that are drawn from the prior and weighted with the likelihood.
    #[test]
    fn the_site_has_the_moments_of_the_posterior() {
        let mut rng = random::stream(3, 0);
        let axes = *random::rotation(&mut rng).matrix();
        for sds in [[0.25; 6], [0.2, 0.2, 0.9, 0.3, 0.9, 0.9]] {
            let told = told(&axes, sds);
            let site = SizeSite::new(&told, &size(false), None, SHAPE_WEIGHT, 1.0, 4).unwrap();
            let mean = invert_spd(&(told.information + site.precision)).unwrap() * (told.vector + site.vector);
            let (mut sum, mut weighted) = (0.0, Vector6::zeros());
            for _ in 0..400_000 {
                let x = size(false).mean.map(|x| x + 0.02f64.sqrt() * random::normal(&mut rng));
                let rotation = random::rotation(&mut rng);
                let u = coordinates(&(rotation.matrix() * Matrix3::from_diagonal(&x) * rotation.matrix().transpose()));
                let weight = (u.dot(&told.vector) - 0.5 * u.dot(&(told.information * u))).exp();
                sum += weight;
                weighted += u * weight;
            }
            let brute = weighted / sum;
            assert!((mean - brute).amax() < 0.03, "{sds:?}: {mean} {brute}");
        }
    }

    #[test]
    fn where_rotation_and_size_are_measured_the_site_changes_little_and_odd_sizes_are_left_alone() {
        let told = told(&Matrix3::identity(), [0.01; 6]);
        let mean_with = |size: &SizeDistribution| {
            let site = SizeSite::new(&told, size, None, SHAPE_WEIGHT, 1.0, 4).unwrap();
            invert_spd(&(told.information + site.precision)).unwrap() * (told.vector + site.vector)
        };
        let own = invert_spd(&told.information).unwrap() * told.vector;
        assert!((mean_with(&size(false)) - own).amax() < 5e-3);
        // Ten standard deviations larger than the others of its category.
        let odd = SizeDistribution { mean: Vector3::new(2.0, 1.5, 1.1), dof: 8.0, ..size(false) };
        assert!((mean_with(&odd) - own).amax() < 5e-3, "{} {own}", mean_with(&odd));
    }

    #[test]
    fn the_site_does_not_depend_on_the_directions_of_its_entries() {
        let mut rng = random::stream(5, 0);
        let told = told(&Matrix3::identity(), [0.2, 0.3, 0.2, 0.3, 0.2, 0.3]);
        let site = SizeSite::new(&told, &size(true), Some(&Vector3::z()), SHAPE_WEIGHT, 0.5, 4).unwrap();
        let axes = *random::rotation(&mut rng).matrix();
        let body = EllipsoidModel::from_axes(Vector3::zeros(), axes, Vector3::new(1.9, 1.2, 0.7));
        let cost = |axes: &Matrix3<f64>| {
            let (precision, vector) = site.along(axes);
            let u = Vector6::from(body.log_shape_along(axes).unwrap().map(|(value, _)| value));
            u.dot(&(precision * u)) - 2.0 * u.dot(&vector)
        };
        assert!((cost(&Matrix3::identity()) - cost(&axes)).abs() < 1e-8);
        // The rows have the same cost, up to a constant.
        let rows = |body: &EllipsoidModel| {
            let mut equations = NormalEquations::zero();
            site.add_to(body, &mut equations);
            equations.cost
        };
        let other = EllipsoidModel::from_axes(Vector3::zeros(), axes, Vector3::new(1.5, 1.0, 0.9));
        let of = |body: &EllipsoidModel| {
            let u = Vector6::from(body.log_shape_along(&Matrix3::identity()).unwrap().map(|(value, _)| value));
            u.dot(&(site.precision * u)) - 2.0 * u.dot(&site.vector)
        };
        assert!((rows(&body) - rows(&other) - of(&body) + of(&other)).abs() < 1e-6 * rows(&body).abs().max(1.0));
    }
}
