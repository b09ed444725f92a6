//! Cross-validation: how good the estimates are, without the truth (docs/method.md, section 14).
//!
//! A view of an object is left out, the object is fitted to the others, and its box in the view that was left out is
//! predicted. The agreement of measured and predicted boxes (IoU, errors of the edges) detects overfitting, which
//! residuals cannot: a body that fits three boxes closely has small residuals, but may predict a fourth one badly.
//! Noise levels, the kind of body, the ground plane and pose corrections stay as estimated from all views; to evaluate
//! noise levels, pass them ([`crate::solve::PosteriorOptions::noise_model`]) and compare the errors.
//!
//! [`crate::localize()`] does it for a few views of each scene, or for all of them ([`Extent`]).

mod folds;
mod summary;

pub use summary::{CrossValidation, ObjectCrossValidation};
pub(crate) use {folds::choose_folds, summary::summarize};

/// How much is cross-validated.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Extent {
    /// Nothing.
    Nothing,
    /// A few views of the scene, for its summary: [`CrossValidationOptions::sampled_fits`].
    #[default]
    Sample,
    /// Every view of every object.
    All,
}

/// Options of the cross-validation.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct CrossValidationOptions {
    /// How much is cross-validated.
    pub extent: Extent,
    /// Maximum number of fits per object (at least 2): in objects with more views, several views are left out together.
    pub fits_per_object: usize,
    /// Maximum number of fits for the scene with [`Extent::Sample`], evenly spread over its objects. 16 of them took 1
    /// to 3 % of the time of localizing 50 objects in 20 views (6 to 9 % where the kind of body was given); 8 take
    /// about half of that.
    pub sampled_fits: usize,
}

impl Default for CrossValidationOptions {
    fn default() -> Self {
        Self { extent: Extent::default(), fits_per_object: 10, sampled_fits: 8 }
    }
}
