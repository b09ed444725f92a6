//! What is learned about the sizes of a category.

use super::options::SizePrior;
use crate::geometry::BodyKind;

/// The size of a category and kind of body, learned from the objects of the scene ([`super::PosteriorOptions::learn_sizes`]).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LearnedCategorySize {
    /// Index into [`crate::scene::SceneParts::categories`].
    pub category: usize,
    /// The kind of body of the objects.
    pub body: BodyKind,
    /// Number of objects.
    pub objects: usize,
    /// Number of well-determined objects that they are worth: one whose boxes leave its size open counts little.
    pub well_determined: f64,
    /// Full extents of the fitted bodies with the standard deviation of another object of the category. `None` if the objects are
    /// too few, or differ too much: these get no prior.
    pub size: Option<SizePrior>,
    /// Whether the extents are length, width and height, because the objects stand; otherwise they are in the order of their
    /// lengths.
    pub named: bool,
}
