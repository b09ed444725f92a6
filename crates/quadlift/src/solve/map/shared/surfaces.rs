//! Level surfaces on which objects stand: tables, shelves, the floor (docs/method.md, section 22).
//!
//! Nothing says which objects stand on one surface. A surface is found where lowest points agree in height better than chance; each object
//! then gets the surface of the *others* as a prior, so that it does not tell its own height.

use std::f64::consts::TAU;

use nalgebra::{Matrix3, Point3, Unit, Vector3};

use super::ground::LowestPoint;
use crate::geometry::linalg::{invert_spd, solve_spd};
use crate::geometry::rotation::horizontal_basis;
use crate::tuning::SURFACE_SLOPE_SD;

/// Logarithm of the odds from which a surface is one: 55 to 1. With 3 there are 9 surfaces in 40 scenes of 20 objects at any height, with 4
/// at most 2.
const MIN_EVIDENCE: f64 = 4.0;

/// Objects of a surface, at least: with fewer the others of each say nothing.
const FEWEST_OBJECTS: usize = 3;

/// Objects that surfaces are tried through, at most: of more, evenly spread ones.
const MOST_SEEDS: usize = 256;

/// So many objects of the usual unevenness are added to those of a surface.
const UNEVENNESS_PRIOR: f64 = 4.0;

/// Rounds of memberships and planes.
const ROUNDS: usize = 12;

/// A surface with `up.(x - reference) = g . (1, e1.(x - reference), e2.(x - reference))`, in information form.
#[derive(Debug, Clone)]
pub(crate) struct Surface {
    reference: Point3<f64>,
    /// Directions: up, e1, e2.
    basis: [Vector3<f64>; 3],
    information: Matrix3<f64>,
    right: Vector3<f64>,
    plane: Vector3<f64>,
    /// Ratio of its squared unevenness to the usual one.
    unevenness2: f64,
    /// Share of the objects that stand on it: during the search of those that are left, then of all.
    share: f64,
}

/// What an object stands on, as the others have it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Support {
    /// Index of the surface.
    pub surface: usize,
    /// Upwards; heights above it are `normal.(x - reference) + offset`.
    pub normal: Vector3<f64>,
    pub reference: Point3<f64>,
    pub offset: f64,
    /// Standard deviation of the object's lowest point above it.
    pub sd: f64,
}

/// The surfaces of a scene.
#[derive(Debug, Clone, Default)]
pub(crate) struct Surfaces {
    pub surfaces: Vec<Surface>,
    /// Logarithm of the density of heights of objects that stand on none.
    log_density: f64,
}

impl Surface {
    /// The row of a point, and its height above the reference.
    fn row(&self, point: &Point3<f64>) -> (Vector3<f64>, f64) {
        let d = point - self.reference;
        (Vector3::new(1.0, self.basis[1].dot(&d), self.basis[2].dot(&d)), self.basis[0].dot(&d))
    }

    /// Height of a lowest point above the surface, and its variance without that of the surface.
    fn height(&self, lowest: &LowestPoint) -> (f64, f64) {
        let (row, height) = self.row(&lowest.point);
        (height - self.plane.dot(&row), self.variance(lowest))
    }

    /// A level one through a point.
    fn through(lowest: &LowestPoint, up: &Unit<Vector3<f64>>) -> Self {
        let [e1, e2] = horizontal_basis(up);
        Self {
            reference: lowest.point,
            basis: [up.into_inner(), e1, e2],
            information: slope_information(),
            right: Vector3::zeros(),
            plane: Vector3::zeros(),
            unevenness2: 1.0,
            share: 0.5,
        }
    }

    /// Variance of the height of a lowest point above the surface.
    fn variance(&self, lowest: &LowestPoint) -> f64 {
        lowest.variance + self.unevenness2 * lowest.unevenness().powi(2)
    }

    /// The unevenness by expectation and maximisation: each object's height is its error and its unevenness.
    fn updated_unevenness(&self, pool: &[&LowestPoint], membership: &[f64]) -> f64 {
        let mut squares = (UNEVENNESS_PRIOR, UNEVENNESS_PRIOR);
        for (lowest, membership) in pool.iter().zip(membership) {
            let (height, variance) = self.height(lowest);
            // In units of the usual unevenness.
            let share = self.unevenness2 * lowest.unevenness().powi(2) / variance;
            let expected = self.unevenness2 * (share * height * height / variance + 1.0 - share);
            squares.0 += membership * expected;
            squares.1 += membership;
        }
        // At most the usual one: larger ones would make a surface of anything.
        (squares.0 / squares.1).min(1.0)
    }

    /// Logarithm of the ratio of the densities of a height on the surface and anywhere; `more` is added to its variance.
    fn log_ratio(&self, lowest: &LowestPoint, log_density: f64, more: f64) -> f64 {
        let (height, variance) = self.height(lowest);
        let variance = variance + more;
        -0.5 * (height * height / variance + (TAU * variance).ln()) - log_density
    }

    /// Fits it to the objects of a pool; `None` if fewer than [`FEWEST_OBJECTS`] stand on it or it is not better than chance.
    fn fitted(mut self, pool: &[&LowestPoint], log_density: f64, seed: &LowestPoint) -> Option<Self> {
        let mut evidence = f64::NEG_INFINITY;
        let mut members = 0;
        for round in 0..ROUNDS {
            let more = if round == 0 { self.variance(seed) } else { 0.0 };
            let membership: Vec<f64> =
                pool.iter().map(|lowest| member(self.share, self.log_ratio(lowest, log_density, more))).collect();
            (self.information, self.right) = (slope_information(), Vector3::zeros());
            for (lowest, membership) in pool.iter().zip(&membership) {
                let (row, height) = self.row(&lowest.point);
                let weight = membership / self.variance(lowest);
                self.information += row * row.transpose() * weight;
                self.right += row * (height * weight);
            }
            self.plane = solve_spd(&self.information, &self.right)?;
            self.unevenness2 = self.updated_unevenness(pool, &membership);
            self.share = (membership.iter().sum::<f64>() + 1.0) / (pool.len() as f64 + 2.0);
            members = membership.iter().filter(|m| **m > 0.5).count();
            // Objects that are not on it may stand on other surfaces: they do not count against it.
            let told = pool.iter().zip(&membership).filter(|(_, membership)| **membership > 0.5);
            let told = told.map(|(lowest, _)| self.share.ln() + self.log_ratio(lowest, log_density, 0.0));
            let slope = SURFACE_SLOPE_SD.get();
            let tilt = (self.plane.y * self.plane.y + self.plane.z * self.plane.z) / (slope * slope);
            // Laplace's approximation: heights are as probable as those of objects that stand on nothing.
            evidence = told.sum::<f64>() + 1.5 * TAU.ln() - 0.5 * self.information.determinant().ln() + log_density
                - (TAU * slope * slope).ln()
                - 0.5 * tilt;
        }
        (members >= FEWEST_OBJECTS && evidence > MIN_EVIDENCE).then_some(self)
    }

    /// The surface without an object whose share in it is `membership`, below this object.
    fn below(&self, lowest: &LowestPoint, membership: f64, surface: usize) -> Option<Support> {
        let (row, height) = self.row(&lowest.point);
        let weight = membership / self.variance(lowest);
        let covariance = invert_spd(&(self.information - row * row.transpose() * weight))?;
        let plane = covariance * (self.right - row * (height * weight));
        let of_surface = row.dot(&(covariance * row));
        let direction = self.basis[0] - self.basis[1] * plane.y - self.basis[2] * plane.z;
        let length = direction.norm();
        let sd = (self.unevenness2 * lowest.unevenness().powi(2) + of_surface).sqrt();
        (length > 0.0 && sd.is_finite()).then(|| Support {
            surface,
            normal: direction / length,
            reference: self.reference,
            offset: -plane.x / length,
            sd,
        })
    }

    /// The point of the surface in the middle of what stands on it, its normal, and the standard deviation of its height there.
    pub(crate) fn describe(&self, members: &[LowestPoint]) -> (Point3<f64>, Unit<Vector3<f64>>, f64) {
        let middle = members.iter().map(|m| m.point.coords).sum::<Vector3<f64>>() / members.len().max(1) as f64;
        let (row, height) = self.row(&Point3::from(middle));
        let point = Point3::from(middle + self.basis[0] * (self.plane.dot(&row) - height));
        let normal = Unit::new_normalize(self.basis[0] - self.basis[1] * self.plane.y - self.basis[2] * self.plane.z);
        let sd = invert_spd(&self.information).map_or(f64::INFINITY, |c| row.dot(&(c * row)).sqrt());
        (point, normal, sd)
    }
}

impl Surfaces {
    /// The surfaces below objects with these lowest points.
    pub(crate) fn find(up: &Unit<Vector3<f64>>, objects: &[&LowestPoint]) -> Self {
        let Some(extent) = extent(up, objects) else { return Self::default() };
        let log_density = -extent.ln();
        let mut pool: Vec<&LowestPoint> = objects.to_vec();
        let mut surfaces: Vec<Surface> = Vec::new();
        while pool.len() >= FEWEST_OBJECTS {
            let stride = pool.len().div_ceil(MOST_SEEDS);
            let score = |seed: &&LowestPoint| {
                let surface = Surface::through(seed, up);
                let slope2 = SURFACE_SLOPE_SD.get().powi(2);
                let of = |lowest: &&LowestPoint| {
                    let (row, _) = surface.row(&lowest.point);
                    let more = surface.variance(seed) + slope2 * (row.y * row.y + row.z * row.z);
                    (1.0 + surface.log_ratio(lowest, log_density, more).exp()).ln()
                };
                pool.iter().map(of).sum::<f64>()
            };
            let seeds = pool.iter().step_by(stride).map(|seed| (score(seed), *seed));
            let Some((_, seed)) = seeds.max_by(|a, b| a.0.total_cmp(&b.0)) else { break };
            let Some(surface) = Surface::through(seed, up).fitted(&pool, log_density, seed) else { break };
            pool.retain(|lowest| member(surface.share, surface.log_ratio(lowest, log_density, 0.0)) < 0.5);
            surfaces.push(surface);
        }
        let mut found = Self { surfaces, log_density };
        found.count_shares(objects);
        found
    }

    /// The share of each surface, of all objects.
    fn count_shares(&mut self, objects: &[&LowestPoint]) {
        let counts: Vec<f64> = (0..self.surfaces.len())
            .map(|k| objects.iter().map(|lowest| self.membership(lowest, k)).sum::<f64>())
            .collect();
        for (surface, count) in self.surfaces.iter_mut().zip(counts) {
            surface.share = (count + 1.0) / (objects.len() as f64 + 2.0);
        }
    }

    /// Probability that an object stands on a surface.
    fn membership(&self, lowest: &LowestPoint, index: usize) -> f64 {
        let of = |surface: &Surface| surface.share * surface.log_ratio(lowest, self.log_density, 0.0).exp();
        let none = (1.0 - self.surfaces.iter().map(|surface| surface.share).sum::<f64>()).max(0.01);
        let all: f64 = self.surfaces.iter().map(of).sum();
        of(&self.surfaces[index]) / (none + all)
    }

    /// What an object probably stands on. `is_known` says that the surfaces were found with this object.
    pub(crate) fn below(&self, lowest: &LowestPoint, is_known: bool) -> Option<Support> {
        let (surface, membership) = (0..self.surfaces.len())
            .map(|k| (k, self.membership(lowest, k)))
            .max_by(|a, b| a.1.total_cmp(&b.1))
            .filter(|(_, membership)| *membership > 0.5)?;
        let told = if is_known { membership } else { 0.0 };
        let support = self.surfaces[surface].below(lowest, told, surface)?;
        // A doubtful one counts less.
        Some(Support { sd: support.sd / membership.sqrt(), ..support })
    }
}

fn slope_information() -> Matrix3<f64> {
    let slope = SURFACE_SLOPE_SD.get().powi(-2);
    Matrix3::from_diagonal(&Vector3::new(0.0, slope, slope))
}

/// The probability of one of two with this share, from the logarithm of the ratio of their densities.
fn member(share: f64, log_ratio: f64) -> f64 {
    1.0 / (1.0 + (1.0 - share) / share * (-log_ratio).exp())
}

/// How far objects that stand on nothing spread in height: as they do sideways, if they are all at one height.
fn extent(up: &Unit<Vector3<f64>>, objects: &[&LowestPoint]) -> Option<f64> {
    let [e1, e2] = horizontal_basis(up);
    let range = |direction: &Vector3<f64>| {
        let along = || objects.iter().map(|lowest| direction.dot(&lowest.point.coords));
        along().fold(f64::NEG_INFINITY, f64::max) - along().fold(f64::INFINITY, f64::min)
    };
    let extent = range(up).max(range(&e1).hypot(range(&e2)));
    (extent > 0.0 && extent.is_finite()).then_some(extent)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synthetic::random::{normal, stream};
    use rand::RngExt as _;

    /// Objects at these heights with errors of these deviations, spread over 2 x 2.
    fn at_heights(heights: &[f64], sd: f64, seed: u64) -> Vec<LowestPoint> {
        let mut rng = stream(seed, 0);
        let object = |height: &f64| LowestPoint {
            point: Point3::new(
                rng.random_range(-1.0..1.0),
                rng.random_range(-1.0..1.0),
                height + sd * normal(&mut rng),
            ),
            variance: sd * sd,
            height: 0.05,
            distance: 0.0,
        };
        heights.iter().map(object).collect()
    }

    fn find(objects: &[LowestPoint]) -> Surfaces {
        Surfaces::find(&Vector3::z_axis(), &objects.iter().collect::<Vec<_>>())
    }

    #[test]
    fn the_boards_of_a_shelf_are_found_and_what_hangs_beside_them_is_on_none() {
        let mut heights: Vec<f64> = [0.3, 0.8, 1.3].into_iter().flat_map(|height| [height; 6]).collect();
        heights.extend([0.55, 1.05]);
        let objects = at_heights(&heights, 0.02, 3);
        let found = find(&objects);
        assert_eq!(found.surfaces.len(), 3);
        for (object, truth) in objects.iter().zip(&heights) {
            let below = found.below(object, true);
            assert_eq!(below.is_some(), *truth != 0.55 && *truth != 1.05, "{object:?} {below:?}");
            if let Some(support) = below {
                let height = support.normal.dot(&(object.point - support.reference)) + support.offset;
                assert!((object.point.z - height - truth).abs() < 4.0 * support.sd, "{support:?}");
                assert!(support.sd < 0.04);
            }
        }
    }

    #[test]
    fn objects_at_any_height_stand_on_nothing() {
        let mut surfaces = 0;
        for seed in 0..40 {
            let mut rng = stream(seed, 1);
            let heights: Vec<f64> = (0..20).map(|_| rng.random_range(-1.0..1.0)).collect();
            surfaces += find(&at_heights(&heights, 0.02, seed)).surfaces.len();
        }
        assert!(surfaces <= 2, "{surfaces} in 40 scenes");
    }

    #[test]
    fn an_object_does_not_tell_its_own_height() {
        let objects = at_heights(&[0.5; 5], 0.01, 7);
        let found = find(&objects);
        let support = found.below(&objects[0], true).unwrap();
        let uneven = |object: &LowestPoint| found.surfaces[0].unevenness2 * object.unevenness().powi(2);
        let variance = |object: &LowestPoint| object.variance + uneven(object);
        // The weighted line through the others, by an independent calculation.
        let slope = SURFACE_SLOPE_SD.get().powi(-2);
        let (mut a, mut b) = (Matrix3::from_diagonal(&Vector3::new(0.0, slope, slope)), Vector3::zeros());
        for object in &objects[1..] {
            let d = object.point - objects[0].point;
            let row = Vector3::new(1.0, d.x, d.y);
            a += row * row.transpose() / variance(object);
            b += row * (d.z / variance(object));
        }
        let covariance = a.try_inverse().unwrap();
        let expected = (covariance * b).x;
        let height = -(support.normal.dot(&(objects[0].point - support.reference)) + support.offset) / support.normal.z;
        assert!((height - expected).abs() < 1e-3, "{height} {expected}");
        let sd = (covariance.m11 + uneven(&objects[0])).sqrt();
        assert!((support.sd - sd).abs() < 0.02 * sd, "{} {sd}", support.sd);
    }

    #[test]
    fn too_few_or_useless_points_give_no_surface() {
        assert!(find(&[]).surfaces.is_empty());
        assert!(find(&at_heights(&[0.1, 0.1], 0.01, 1)).surfaces.is_empty());
        let same = LowestPoint { point: Point3::origin(), variance: 1.0, height: 1.0, distance: 1.0 };
        assert!(find(&[same; 5]).surfaces.is_empty());
    }
}
