//! Synthetic scenes whose objects are of categories: things of one category are of about the same size (ours).

use nalgebra::Vector3;
use rand_chacha::ChaCha8Rng;

use super::generate_objects;
use super::objects::Object;
use super::options::{SyntheticError, SyntheticOptions};
use super::scene::SyntheticScene;
use crate::random;

/// Stream of the seed for the differences between things of a category.
const DIFFERENCE_STREAM: u64 = 20;

/// The categories of a synthetic scene.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CategoryOptions {
    /// Number of categories, of which the objects are in turn. Their names are `category_0`, `category_1` and so on.
    pub categories: usize,
    /// The sizes of their objects.
    pub sizes: CategorySizes,
}

/// Sizes of the objects of a category.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum CategorySizes {
    /// About that of the first one: the logarithm of each extent differs by a normal number with this standard deviation.
    Alike(f64),
    /// The same, and every second one is twice as large (cars and buses under one name).
    TwoSizes(f64),
    /// Any: a category is a name only.
    Any,
}

impl CategorySizes {
    /// The semi-axes of the object with this number within its category, given those of the first one and its own.
    fn of(self, number: usize, first: &Vector3<f64>, own: &Vector3<f64>, rng: &mut ChaCha8Rng) -> Vector3<f64> {
        let differences = Vector3::from_fn(|_, _| random::normal(rng));
        let alike = |spread: f64| first.zip_map(&differences, |x, difference| x * (spread * difference).exp());
        match self {
            Self::Alike(spread) => alike(spread),
            Self::TwoSizes(spread) => alike(spread) * if number.is_multiple_of(2) { 1.0 } else { 2.0 },
            Self::Any => *own,
        }
    }
}

/// Makes a scene of categories; positions and rotations are those of [`super::generate`].
///
/// # Errors
/// As [`super::generate`]; [`SyntheticError::OutOfRange`] without categories or with a negative spread.
pub fn generate_categories(
    options: &SyntheticOptions,
    categories: &CategoryOptions,
) -> Result<SyntheticScene, SyntheticError> {
    let CategoryOptions { categories: count, sizes } = *categories;
    if count == 0 {
        return Err(SyntheticError::OutOfRange { what: "number of categories", value: 0.0, expected: "at least 1" });
    }
    if let CategorySizes::Alike(spread) | CategorySizes::TwoSizes(spread) = sizes
        && !(spread >= 0.0 && spread.is_finite())
    {
        let expected = "a number that is not negative";
        return Err(SyntheticError::OutOfRange { what: "spread of sizes", value: spread, expected });
    }
    let mut rng = random::stream(options.seed, DIFFERENCE_STREAM);
    let resize = |objects: &mut Vec<Object>| {
        let first: Vec<Vector3<f64>> = objects.iter().take(count).map(|object| object.semi_axes).collect();
        for (k, object) in objects.iter_mut().enumerate() {
            object.semi_axes = sizes.of(k / count, &first[k % count], &object.semi_axes, &mut rng);
        }
    };
    generate_objects(options, resize, |object| Some(format!("category_{}", object % count)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::ConvexBody;
    use crate::synthetic::generate;

    fn made(sizes: CategorySizes) -> SyntheticScene {
        let options = SyntheticOptions { objects: 12, views: 3, standing: true, ..Default::default() };
        generate_categories(&options, &CategoryOptions { categories: 3, sizes }).unwrap()
    }

    #[test]
    fn things_of_a_category_are_of_its_size() {
        let volume = |scene: &SyntheticScene, k: usize| scene.truth[k].1.closest_ellipsoid().semi_axes.product();
        let alike = made(CategorySizes::Alike(0.0));
        assert!((volume(&alike, 3) / volume(&alike, 0) - 1.0).abs() < 1e-12 && alike.scene.categories.len() == 3);
        assert!((volume(&made(CategorySizes::TwoSizes(0.0)), 3) / volume(&alike, 0) - 8.0).abs() < 1e-9);
        // They still stand.
        assert!(alike.truth.iter().all(|(_, body)| (body.center().z - body.half_extents.z).abs() < 1e-9));
        let options = SyntheticOptions { objects: 12, views: 3, standing: true, ..Default::default() };
        let any = made(CategorySizes::Any);
        assert_eq!(any.truth, generate(&options).unwrap().truth);
        let none = CategoryOptions { categories: 0, sizes: CategorySizes::Any };
        assert!(generate_categories(&options, &none).unwrap_err().to_string().contains("number of categories"));
        let negative = CategoryOptions { categories: 2, sizes: CategorySizes::Alike(-0.1) };
        assert!(generate_categories(&options, &negative).unwrap_err().to_string().contains("spread of sizes"));
    }
}
