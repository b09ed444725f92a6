//! Sizes of the things of one category, learned from the objects of the scene (docs/method.md, section 21).
//!
//! The logarithms of the half extents of an object are those of its category plus a difference of its own, both Gaussian:
//! `x = mu + delta`, `delta ~ N(0, T)`. What the measurements tell about `x` comes in the form of information, so that objects
//! whose length nobody has seen say nothing about lengths. `mu` and `T` are found by expectation and maximization. The prior of
//! an object is the predictive distribution from the others: its own size is told by its own measurements alone.

use nalgebra::{Matrix3, Vector3};

use crate::body_model::descending;
use crate::geometry::BodyKind;
use crate::geometry::linalg::{cholesky, invert_spd};
use crate::parallel::map_indices;
use crate::solve::learned_size::LearnedCategorySize;
use crate::solve::options::SizePrior;
use crate::tuning::{CATEGORY_SPREAD, LEARNT_DOF};

/// Objects, worth this many that are well determined, that others need before they get a prior.
const MIN_OTHERS: f64 = 2.0;

/// Largest variance of the shapes of a category, relative to that of any objects.
const ALIKE: f64 = 0.2;

/// Rounds of expectation and maximization.
const ROUNDS: usize = 40;

/// Rounds after which the axes of each object keep their names.
const NAMING_ROUNDS: usize = 8;

/// Objects up to which each is left out alone; of more, one in so many is left out at a time.
const LEFT_OUT_ALONE: usize = 48;

/// Precision of the logarithm of the mean size of a category before anything is known: none, but regular.
const FLAT: f64 = 1e-6;

/// The names that the axes of an object may have where they are length, width and height with a vertical height, and where
/// nothing but their lengths names them.
const HORIZONTAL_ORDERS: [[usize; 3]; 2] = [[0, 1, 2], [1, 0, 2]];
const ALL_ORDERS: [[usize; 3]; 6] = [[0, 1, 2], [0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]];

/// The axes in the order length, width, height with a vertical height, or from the longest to the shortest.
pub(crate) fn first_order(log: &Vector3<f64>, axes: &Matrix3<f64>, up: Option<&Vector3<f64>>) -> [usize; 3] {
    let Some(up) = up else { return descending(log) };
    let vertical = axes.tr_mul(up).iamax();
    let (a, b) = ((vertical + 1) % 3, (vertical + 2) % 3);
    if log[a] >= log[b] { [a, b, vertical] } else { [b, a, vertical] }
}

/// The orders that the axes may have.
pub(crate) fn orders(named: bool) -> &'static [[usize; 3]] {
    if named { &HORIZONTAL_ORDERS } else { &ALL_ORDERS }
}

/// What the measurements of an object tell about the logarithms of its half extents, in world units, without any prior: the
/// information matrix, and that times the estimate.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct SizeInformation {
    pub information: Matrix3<f64>,
    pub vector: Vector3<f64>,
}

impl SizeInformation {
    /// The same with the axes in another order: axis k of the result is axis `order[k]` of this one.
    pub(crate) fn ordered(&self, order: [usize; 3]) -> Self {
        Self {
            information: Matrix3::from_fn(|i, j| self.information[(order[i], order[j])]),
            vector: Vector3::from_fn(|i, _| self.vector[order[i]]),
        }
    }

    /// The same of measurements that are more certain by this factor (of precisions).
    pub(crate) fn scaled(&self, factor: f64) -> Self {
        Self { information: self.information * factor, vector: self.vector * factor }
    }

    /// How much of an object that is known as well as objects of one category usually agree this one is worth, 0 to 1.
    fn worth(&self) -> f64 {
        let usual = CATEGORY_SPREAD.get().powi(2);
        let total = Matrix3::identity() + self.information * usual;
        total.try_inverse().map_or(0.0, |inverse| (inverse * self.information).trace() * usual / 3.0)
    }
}

/// The distribution of the logarithms of the half extents of another object of a category: Student's t.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct SizeDistribution {
    /// Logarithms of the half extents, world units.
    pub mean: Vector3<f64>,
    /// Differences between objects, and how uncertain the mean is.
    pub covariance: Matrix3<f64>,
    /// Degrees of freedom.
    pub dof: f64,
    /// Whether the third axis is the vertical one.
    pub named: bool,
}

/// The sizes of a category with those that each of its objects gets.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct LearnedSizes {
    /// From all objects; `None` if they are too few or differ as much as any objects do.
    pub of_all: Option<SizeDistribution>,
    /// For each object from the others.
    pub of_each: Vec<Option<SizeDistribution>>,
    /// Number of well-determined objects that all of them are worth.
    pub worth: f64,
}

impl LearnedSizes {
    /// From objects whose axes are length, width, height (`named`), or in the order of their lengths. `shape_sd` is the standard
    /// deviation of the shape prior: shapes of a category differ less than shapes of any objects.
    pub(crate) fn of(objects: &[SizeInformation], named: bool, shape_sd: f64) -> Self {
        let stride = objects.len().clamp(1, LEFT_OUT_ALONE);
        let without = |left_out: Option<usize>| {
            let kept =
                objects.iter().enumerate().filter(|(k, _)| left_out != Some(k % stride)).map(|(_, object)| object);
            Category::fit(&kept.copied().collect::<Vec<_>>(), named, shape_sd).and_then(|category| category.predict())
        };
        // Whether the others teach an object does not depend on itself.
        let of_others = map_indices(stride, |k| without(Some(k)));
        let of_each: Vec<_> = (0..objects.len()).map(|k| of_others[k % stride]).collect();
        let of_all = without(None).filter(|_| of_each.iter().any(Option::is_some));
        Self { of_all, of_each, worth: objects.iter().map(SizeInformation::worth).sum() }
    }

    /// As they are reported: those of a category and kind of body, learned from so many objects.
    pub(crate) fn report(&self, category: usize, body: BodyKind, objects: usize) -> LearnedCategorySize {
        let size = self.of_all.map(|size| {
            let mean: [f64; 3] = std::array::from_fn(|k| 2.0 * size.mean[k].exp());
            SizePrior { mean, sd: std::array::from_fn(|k| mean[k] * size.covariance[(k, k)].sqrt()) }
        });
        let named = self.of_all.is_some_and(|size| size.named);
        LearnedCategorySize { category, body, objects, well_determined: self.worth, size, named }
    }
}

/// The parameters of a category.
struct Category {
    mean: Vector3<f64>,
    mean_covariance: Matrix3<f64>,
    /// Of the differences between objects.
    spread: Matrix3<f64>,
    worth: f64,
    named: bool,
    shape_sd: f64,
}

impl Category {
    /// By expectation and maximization; `None` if a matrix is singular.
    fn fit(objects: &[SizeInformation], named: bool, shape_sd: f64) -> Option<Self> {
        let usual = Matrix3::from_diagonal_element(CATEGORY_SPREAD.get().powi(2));
        let prior_dof = LEARNT_DOF.get();
        let across = across();
        // With the differences within a category, shapes differ as the shape prior has it.
        let between = (shape_sd * shape_sd - usual[(0, 0)]).max(usual[(0, 0)]);
        let hyper = across / between + (Matrix3::identity() - across) * FLAT;
        let mut objects = objects.to_vec();
        let worth = objects.iter().map(SizeInformation::worth).sum();
        let (mut mean, mut mean_covariance, mut spread) = (Vector3::zeros(), Matrix3::zeros(), usual);
        for round in 0..ROUNDS {
            let (mut precision, mut vector) = (hyper, Vector3::zeros());
            for object in &objects {
                let share = (Matrix3::identity() + object.information * spread).try_inverse()?;
                precision += symmetric(share * object.information);
                vector += share * object.vector;
            }
            mean_covariance = invert_spd(&precision)?;
            mean = mean_covariance * vector;
            let inverse = invert_spd(&spread)?;
            let mut sum = usual * prior_dof;
            for object in &objects {
                let own = invert_spd(&(object.information + inverse))?;
                let difference = own * (object.vector - object.information * mean);
                let gain = own * object.information;
                sum += own + difference * difference.transpose() + gain * mean_covariance * gain.transpose();
            }
            spread = symmetric(sum / (prior_dof + objects.len() as f64));
            if round < NAMING_ROUNDS {
                let inverse = invert_spd(&(spread + mean_covariance))?;
                objects.iter_mut().for_each(|object| *object = renamed(object, &mean, &inverse, named));
            }
        }
        Some(Self { mean, mean_covariance, spread, worth, named, shape_sd })
    }

    /// The distribution for another object; `None` if too few objects tell it, or if their shapes differ as much as those of any
    /// objects do.
    fn predict(&self) -> Option<SizeDistribution> {
        let covariance = self.spread + self.mean_covariance;
        let shape = (across() * covariance).trace();
        let usable = self.worth >= MIN_OTHERS && shape < 2.0 * ALIKE * self.shape_sd * self.shape_sd;
        let dof = LEARNT_DOF.get() + self.worth;
        let finite = self.mean.iter().chain(covariance.iter()).all(|x| x.is_finite());
        (usable && finite).then_some(SizeDistribution { mean: self.mean, covariance, dof, named: self.named })
    }
}

/// The projection on differences from the mean of three numbers.
pub(crate) fn across() -> Matrix3<f64> {
    Matrix3::identity() - Matrix3::from_element(1.0 / 3.0)
}

fn symmetric(matrix: Matrix3<f64>) -> Matrix3<f64> {
    (matrix + matrix.transpose()) * 0.5
}

/// The object with its axes in the order that suits a Gaussian best, as they are where two suit it equally.
fn renamed(object: &SizeInformation, mean: &Vector3<f64>, inverse: &Matrix3<f64>, named: bool) -> SizeInformation {
    // Minus twice the logarithm of the evidence, up to a constant.
    let cost = |object: &SizeInformation| {
        let joint = object.information + inverse;
        let vector = object.vector + inverse * mean;
        let (Some(own), Some(root)) = (invert_spd(&joint), cholesky(&joint)) else { return f64::INFINITY };
        2.0 * (0..3).map(|k| root[(k, k)].ln()).sum::<f64>() - vector.dot(&(own * vector))
    };
    let mut best = (cost(object), *object);
    for order in &orders(named)[1..] {
        let other = object.ordered(*order);
        let other_cost = cost(&other);
        if other_cost < best.0 - 1e-9 {
            best = (other_cost, other);
        }
    }
    best.1
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random;

    const SHAPE_SD: f64 = 0.4;

    /// What is known with this standard deviation of each logarithm.
    fn known(log: [f64; 3], sd: f64) -> SizeInformation {
        let information = Matrix3::from_diagonal_element(sd.powi(-2));
        SizeInformation { information, vector: information * Vector3::from(log) }
    }

    /// Objects of a category of cars, about 5 % different, each known to 3 %.
    fn cars(count: usize) -> Vec<SizeInformation> {
        let mut rng = random::stream(5, 0);
        let mut about = |x: f64| x + 0.05 * random::normal(&mut rng);
        (0..count).map(|_| known([about(0.7), about(-0.2), about(-0.35)], 0.03)).collect()
    }

    #[test]
    fn no_object_tells_its_own_size() {
        for count in [6, 60] {
            let objects = cars(count);
            let mut changed = objects.clone();
            changed[3] = known([2.0, 1.5, -1.0], 0.01);
            let (before, after) =
                (LearnedSizes::of(&objects, true, SHAPE_SD), LearnedSizes::of(&changed, true, SHAPE_SD));
            assert!(before.of_each[3].is_some());
            assert_eq!(before.of_each[3], after.of_each[3], "bit for bit");
            assert_ne!(before.of_each[2], after.of_each[2]);
            assert_ne!(before.of_all, after.of_all);
        }
    }

    #[test]
    fn an_object_of_well_known_others_gets_their_mean_and_spread() {
        let objects: Vec<SizeInformation> =
            cars(40).iter().map(|car| known((car.vector * 0.03f64.powi(2)).into(), 1e-4)).collect();
        let learned = LearnedSizes::of(&objects, true, SHAPE_SD).of_all.unwrap();
        let sizes: Vec<Vector3<f64>> = objects.iter().map(|car| car.vector * 1e-8).collect();
        let mean = sizes.iter().sum::<Vector3<f64>>() / 40.0;
        assert!((learned.mean - mean).amax() < 2e-3, "{} {mean}", learned.mean);
        // With exact sizes: the squares and those of the prior over their numbers, and the uncertainty of the mean.
        let prior = Matrix3::from_diagonal_element(CATEGORY_SPREAD.get().powi(2)) * LEARNT_DOF.get();
        let squares = sizes.iter().fold(prior, |sum, x| sum + (x - mean) * (x - mean).transpose());
        let spread = squares / (40.0 + LEARNT_DOF.get());
        assert!((learned.covariance - spread * (1.0 + 1.0 / 40.0)).amax() < 0.03 * spread[(0, 0)], "{learned:?}");
    }

    #[test]
    fn too_few_objects_and_objects_that_say_little_teach_nothing() {
        let sizes = |objects: &[SizeInformation]| LearnedSizes::of(objects, true, SHAPE_SD);
        for few in [0, 1] {
            let learned = sizes(&cars(few));
            assert!(learned.of_all.is_none() && learned.of_each.iter().all(Option::is_none), "{few}");
        }
        // Of three each has two others, which are worth a little less than two.
        assert!(sizes(&cars(3)).of_each.iter().all(Option::is_none));
        assert!(sizes(&cars(4)).of_each.iter().all(Option::is_some));
        let vague: Vec<SizeInformation> = (0..20).map(|_| known([0.7, -0.2, -0.35], 2.0)).collect();
        assert!(sizes(&vague).of_all.is_none() && sizes(&vague).worth < 0.2);
    }

    #[test]
    fn things_of_any_shape_under_one_name_teach_nothing() {
        let mut rng = random::stream(6, 0);
        let any: Vec<SizeInformation> =
            (0..30).map(|_| known([(); 3].map(|()| 0.8 * random::normal(&mut rng)), 0.03)).collect();
        assert!(LearnedSizes::of(&any, true, SHAPE_SD).of_all.is_none());
    }

    #[test]
    fn the_order_of_the_objects_does_not_matter() {
        let objects = cars(12);
        let turned: Vec<SizeInformation> = objects.iter().rev().copied().collect();
        let (one, other) = (LearnedSizes::of(&objects, false, SHAPE_SD), LearnedSizes::of(&turned, false, SHAPE_SD));
        for (a, b) in one.of_each.iter().zip(other.of_each.iter().rev()) {
            let (a, b) = (a.unwrap(), b.unwrap());
            assert!((a.mean - b.mean).amax() < 1e-9 && (a.covariance - b.covariance).amax() < 1e-9);
        }
    }

    #[test]
    fn an_axis_that_nobody_has_seen_gets_the_name_that_suits() {
        // Of one more car the length is open; its width and height are known, but named length and width.
        let mut objects = cars(8);
        let mut open = known([-0.2, -0.35, -0.5], 0.03);
        open.information[(2, 2)] = 1e-3;
        open.vector[2] = 0.0;
        objects.push(open);
        let learned = LearnedSizes::of(&objects, false, SHAPE_SD).of_all.unwrap();
        assert!((learned.mean - Vector3::new(0.7, -0.2, -0.35)).amax() < 0.06, "{learned:?}");
    }
}
