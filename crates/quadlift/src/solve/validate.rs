//! Options of the estimators are validated before anything is computed.

use super::options::{CategoryPrior, Method, PoseNoise, PosteriorOptions, RegOptions};
use crate::geometry::BodyKind;

/// An option that is out of range, or that the scene does not allow; the message names it, what was found and what was
/// expected.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct OptionError(String);

impl Method {
    /// Validates the options of the method, independent of a scene.
    ///
    /// # Errors
    /// [`OptionError`] names the first option that is out of range.
    pub(crate) fn validate(&self) -> Result<(), OptionError> {
        match self {
            Self::Posterior(options) => options.validate(),
            Self::Reg(options) => check_lambda(options),
            Self::Planes | Self::Lfd | Self::Pfd => Ok(()),
        }
    }
}

impl PosteriorOptions {
    /// Validates the options, independent of a scene.
    ///
    /// # Errors
    /// [`OptionError`] names the first option that is out of range.
    pub(crate) fn validate(&self) -> Result<(), OptionError> {
        if let Some(BodyKind::Superellipsoid(_)) = self.body {
            return refuse(
                "superellipsoids are not fitted; expected an ellipsoid, a cuboid, a cylinder or a rounded body"
                    .to_owned(),
            );
        }
        if let Some(PoseNoise { rotation_sd, translation_sd }) = self.pose_noise
            && !(is_positive(rotation_sd) && is_positive(translation_sd))
        {
            return refuse(format!(
                "the standard deviations of the pose noise are {rotation_sd} and {translation_sd}; expected positive \
                 numbers"
            ));
        }
        if !is_positive(self.shape_sd) {
            return refuse(format!(
                "the standard deviation of the shape prior is {}; expected a positive number",
                self.shape_sd
            ));
        }
        for (what, value) in [("pixel noise size", self.pixel_noise_size), ("border margin", self.border_margin)] {
            if !is_not_negative(value) {
                return refuse(format!("the {what} is {value}; expected a finite number that is not negative"));
            }
        }
        if let Some(height) = self.camera_height
            && !is_positive(height)
        {
            return refuse(format!("the height of the cameras is {height}; expected a positive number"));
        }
        self.priors.by_category.iter().try_for_each(|(category, prior)| check_prior(category, prior))
    }
}

pub(crate) fn refuse(why: impl Into<String>) -> Result<(), OptionError> {
    Err(OptionError(why.into()))
}

/// The options of the paper's regularized estimator.
fn check_lambda(options: &RegOptions) -> Result<(), OptionError> {
    if is_not_negative(options.lambda) {
        return Ok(());
    }
    refuse(format!("lambda is {}; expected a finite number that is not negative", options.lambda))
}

/// The prior of a category.
fn check_prior(category: &str, prior: &CategoryPrior) -> Result<(), OptionError> {
    if let Some(sd) = prior.upright_sd
        && !is_positive(sd)
    {
        return refuse(format!("the prior of {category:?} has the upright_sd {sd}; expected a positive number"));
    }
    let Some(size) = prior.size else { return Ok(()) };
    for (what, numbers) in [("size", size.mean), ("standard deviation of the size", size.sd)] {
        if let Some(wrong) = numbers.into_iter().find(|x| !is_positive(*x)) {
            return refuse(format!("the prior of {category:?} has the {what} {wrong}; expected a positive number"));
        }
    }
    Ok(())
}

fn is_positive(x: f64) -> bool {
    x > 0.0 && x.is_finite()
}

fn is_not_negative(x: f64) -> bool {
    x >= 0.0 && x.is_finite()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::solve::SizePrior;

    fn refused(change: impl Fn(&mut PosteriorOptions)) -> String {
        let mut options = PosteriorOptions::default();
        change(&mut options);
        options.validate().map_or_else(|error| error.to_string(), |()| String::new())
    }

    fn with_prior(prior: CategoryPrior) -> String {
        refused(|o| {
            o.priors.by_category.insert("car".to_owned(), prior);
        })
    }

    #[test]
    fn numbers_outside_of_their_ranges_are_refused_by_name() {
        for wrong in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            let of_upright = with_prior(CategoryPrior { upright_sd: Some(wrong), ..Default::default() });
            assert!(of_upright.contains("\"car\" has the upright_sd"), "{wrong}: {of_upright:?}");
            let size = SizePrior { mean: [4.0, wrong, 1.5], sd: [0.4; 3] };
            let of_size = with_prior(CategoryPrior { size: Some(size), ..Default::default() });
            assert!(of_size.contains("\"car\" has the size"), "{wrong}: {of_size:?}");
            let size = SizePrior { mean: [4.0; 3], sd: [0.4, 0.4, wrong] };
            let of_sd = with_prior(CategoryPrior { size: Some(size), ..Default::default() });
            assert!(of_sd.contains("standard deviation of the size"), "{wrong}: {of_sd:?}");
            let of_height = refused(|o| o.camera_height = Some(wrong));
            assert!(of_height.contains("the height of the cameras is"), "{wrong}: {of_height:?}");
        }
        for wrong in [-1.0, f64::NAN, f64::INFINITY] {
            assert!(refused(|o| o.pixel_noise_size = wrong).contains("pixel noise size"));
            assert!(refused(|o| o.border_margin = wrong).contains("border margin"));
        }
        let right = SizePrior { mean: [4.0, 1.6, 1.5], sd: [0.4; 3] };
        let right = CategoryPrior { size: Some(right), upright_sd: Some(0.1), ..Default::default() };
        assert_eq!(with_prior(right), "");
        assert_eq!(refused(|o| o.pixel_noise_size = 0.0), "");
    }
}
