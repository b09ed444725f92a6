//! Options of a localization.

use super::measurement_kind::MeasurementKind;
use crate::cross_validation::CrossValidationOptions;
use crate::solve::{CategoryPriors, Method, PosteriorOptions};

/// Options of [`crate::localize()`].
///
/// ```
/// use quadlift::geometry::BodyKind;
/// use quadlift::solve::PosteriorOptions;
/// use quadlift::LocalizeOptions;
///
/// // The default estimator, cuboids only.
/// let options = LocalizeOptions::from(PosteriorOptions { body: Some(BodyKind::Cuboid), ..Default::default() });
/// assert!(options.validate().is_ok());
/// ```
#[derive(Debug, Clone, Default)]
pub struct LocalizeOptions {
    /// The estimator with its options.
    pub method: Method,
    /// Take the detections of this source only; needed when the scene has several.
    pub source: Option<String>,
    /// Objects with fewer views get the status `too_few_views` (never below what the method needs).
    pub min_views: usize,
    /// Skip detections with a higher occlusion level.
    pub max_occluded: Option<f64>,
    /// Skip detections with a higher truncation level.
    pub max_truncated: Option<f64>,
    /// Which measurements of a detection are used.
    pub measurements: MeasurementKind,
    /// Whether each estimate gets an ellipsoid that encloses the object ([`crate::solve::Estimate::enclosing`]), as in the tables of the
    /// paper.
    pub enclosing: bool,
    /// Accept a scene that is inconsistent (see [`crate::diagnosis`]); otherwise none of its objects is
    /// [`crate::solve::Status::Ok`].
    pub allow_inconsistent: bool,
    /// Sizes of categories: an object that is much longer or shorter than its category gets a warning
    /// ([`crate::solve::Warning::ImplausibleSize`]). Estimates do not depend on them, in contrast to the priors of
    /// [`PosteriorOptions`].
    pub plausible_sizes: CategoryPriors,
    /// Seed of the random starts that scenes with anything but boxes, or with unknown poses, have.
    pub seed: u64,
    /// How much is cross-validated, and how.
    pub cross_validation: CrossValidationOptions,
}

impl From<Method> for LocalizeOptions {
    fn from(method: Method) -> Self {
        Self { method, ..Self::default() }
    }
}

impl From<PosteriorOptions> for LocalizeOptions {
    fn from(options: PosteriorOptions) -> Self {
        Self::from(Method::Posterior(options))
    }
}
