//! Warns of implausible sizes.

use super::estimate::{Estimate, Warning};
use super::options::CategoryPriors;

/// Standard deviations of a category's sizes that are not odd.
const USUAL_SDS: f64 = 3.0;

/// Tolerance factor beyond the typical range: estimates along the view are often off by this factor.
const ROOM_FOR_ERRORS: f64 = 1.5;

/// Warns of estimates whose longest extent is implausible for their category.
pub(crate) fn warn_of_implausible_sizes(estimates: &mut [Estimate], categories: &[String], sizes: &CategoryPriors) {
    for estimate in estimates {
        let Some(category) = estimate.category_index.and_then(|index| categories.get(index)) else { continue };
        let Some(size) = sizes.of(category).and_then(|prior| prior.size) else { continue };
        let Some(body) = &estimate.body else { continue };
        let extent = 2.0 * body.half_extents.max();
        let longest = if size.mean[0] >= size.mean[2] { 0 } else { 2 };
        let (expected, sd) = (size.mean[longest], size.sd[longest]);
        let least = (expected - USUAL_SDS * sd) / ROOM_FOR_ERRORS;
        let largest = (expected + USUAL_SDS * sd) * ROOM_FOR_ERRORS;
        if !(least..=largest).contains(&extent) {
            estimate.warnings.push(Warning::ImplausibleSize { extent, expected });
        }
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{Point3, Rotation3, Vector3};

    use super::super::{CategoryPrior, SizePrior, Status};
    use super::*;
    use crate::geometry::{Body, BodyKind};

    /// Warnings about a thing of these extents.
    fn warnings(category: &str, extents: [f64; 3]) -> Vec<Warning> {
        let prior = |mean, sd| CategoryPrior { size: Some(SizePrior { mean, sd }), ..Default::default() };
        let mut sizes = CategoryPriors::default();
        sizes.by_category.insert("car".to_owned(), prior([4.0, 1.65, 1.5], [0.36, 0.10, 0.12]));
        sizes.by_category.insert("person".to_owned(), prior([0.85, 0.65, 1.65], [0.3, 0.2, 0.3]));
        let categories = ["car", "person", "dog"].map(str::to_owned);
        let index = categories.iter().position(|name| name == category);
        let half_extents = Vector3::from(extents) / 2.0;
        let cuboid =
            Body { kind: BodyKind::Cuboid, center: Point3::origin(), half_extents, rotation: Rotation3::identity() };
        let estimate = Estimate { body: Some(cuboid), ..Estimate::failed(0, index, Status::Ok) };
        let mut estimates = [estimate];
        warn_of_implausible_sizes(&mut estimates, &categories, &sizes);
        let [estimate] = estimates;
        estimate.warnings
    }

    #[test]
    fn a_car_of_the_size_of_a_table_is_implausible() {
        let expected = Warning::ImplausibleSize { extent: 1.4, expected: 4.0 };
        assert_eq!(warnings("car", [1.0, 1.4, 1.2]), [expected]);
        assert_eq!(warnings("car", [1.6, 11.0, 1.5]).len(), 1);
        // What an ellipsoid along the view may be off by.
        assert!(warnings("car", [1.6, 6.5, 1.5]).is_empty() && warnings("car", [1.6, 2.5, 1.5]).is_empty());
        // The height of a person is the longest side.
        assert!(warnings("person", [0.5, 0.5, 1.7]).is_empty());
        assert_eq!(warnings("person", [0.3, 0.3, 0.4]).len(), 1);
        // Nothing is known of dogs.
        assert!(warnings("dog", [80.0; 3]).is_empty());
    }
}
