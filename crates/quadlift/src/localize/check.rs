//! Options outside of their ranges are refused before anything is calculated.

use super::{LocalizeError, MeasurementKind, Options};
use crate::scene::Scene;
use crate::solve::{BodyKind, CategoryPrior, MapOptions, Method, PoseNoise};

/// Checks the options, for a scene.
///
/// # Errors
/// [`LocalizeError::Option`] names the first option that is outside of its range, or that the scene does not allow.
pub(super) fn check(options: &Options, scene: &Scene) -> Result<(), LocalizeError> {
    check_method(options)
        .and_then(|()| check_numbers(options))
        .and_then(|()| check_ground(&options.map, scene))
        .map_err(LocalizeError::Option)
}

/// What the method does not know.
fn check_method(options: &Options) -> Result<(), String> {
    let map = &options.map;
    if options.method != Method::Map && map.body.is_some_and(|body| body != BodyKind::Ellipsoid) {
        return Err("only the method map fits bodies other than ellipsoids".to_owned());
    }
    if options.method != Method::Map && map.sigmas.is_some() {
        return Err("only the method map takes sigmas".to_owned());
    }
    if options.measurements == MeasurementKind::Mask && !matches!(options.method, Method::Map | Method::Planes) {
        return Err("only the methods map and planes take masks; the others take their ellipses".to_owned());
    }
    Ok(())
}

/// Numbers outside of their ranges.
fn check_numbers(options: &Options) -> Result<(), String> {
    let map = &options.map;
    if let Some(BodyKind::Superellipsoid(q)) = map.body
        && !(1.0..=2.0).contains(&q)
    {
        return Err(format!("the support exponent of a superellipsoid is {q}; expected 1 (cuboid) to 2 (ellipsoid)"));
    }
    if let Some(PoseNoise { rotation_sd, translation_sd }) = map.pose_noise
        && !(is_positive(rotation_sd) && is_positive(translation_sd))
    {
        return Err(format!(
            "the standard deviations of the pose noise are {rotation_sd} and {translation_sd}; expected positive numbers"
        ));
    }
    if map.shape_sd.is_nan() || map.shape_sd <= 0.0 {
        return Err(format!(
            "the standard deviation of the shape prior is {}; expected a positive number",
            map.shape_sd
        ));
    }
    if !is_not_negative(map.pixel_noise_size) {
        return Err(format!(
            "the pixel noise size is {}; expected a finite number that is not negative",
            map.pixel_noise_size
        ));
    }
    if !is_not_negative(map.border_margin) {
        return Err(format!(
            "the border margin is {}; expected a finite number that is not negative",
            map.border_margin
        ));
    }
    if !(0.0..=1.0).contains(&map.enclosing_quantile) {
        return Err(format!("the enclosing quantile is {}; expected 0 to 1", map.enclosing_quantile));
    }
    if !is_not_negative(options.reg.lambda) {
        return Err(format!("lambda is {}; expected a finite number that is not negative", options.reg.lambda));
    }
    map.priors.by_category.iter().try_for_each(|(category, prior)| check_prior(category, prior))
}

/// The prior of a category.
fn check_prior(category: &str, prior: &CategoryPrior) -> Result<(), String> {
    if let Some(sd) = prior.upright_sd
        && !is_positive(sd)
    {
        return Err(format!("the prior of {category:?} has the upright_sd {sd}; expected a positive number"));
    }
    let Some(size) = prior.size else { return Ok(()) };
    for (what, numbers) in [("size", size.mean), ("standard deviation of the size", size.sd)] {
        if let Some(wrong) = numbers.into_iter().find(|x| !is_positive(*x)) {
            return Err(format!("the prior of {category:?} has the {what} {wrong}; expected a positive number"));
        }
    }
    Ok(())
}

/// The ground plane and the height of the cameras above it.
fn check_ground(map: &MapOptions, scene: &Scene) -> Result<(), String> {
    let up_is_missing = scene.up.is_none() && !scene.frames.is_empty();
    if map.ground_plane && up_is_missing {
        return Err("the ground plane needs to know where up is; give the scene an \"up\" direction (against gravity)"
            .to_owned());
    }
    let Some(height) = map.camera_height else { return Ok(()) };
    if !is_positive(height) {
        return Err(format!("the height of the cameras is {height}; expected a positive number"));
    }
    if up_is_missing {
        return Err(
            "the height of the cameras needs to know where up is; give the scene an \"up\" direction (against \
                    gravity)"
                .to_owned(),
        );
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
    use crate::synthetic::{SyntheticOptions, generate};

    fn refused(change: impl Fn(&mut Options)) -> String {
        let mut scene = generate(&SyntheticOptions { objects: 1, views: 3, ..Default::default() }).unwrap().scene;
        scene.up = None;
        let mut options = Options::default();
        change(&mut options);
        check(&options, &scene).map_or_else(|error| error.to_string(), |()| String::new())
    }

    fn with_prior(prior: CategoryPrior) -> String {
        refused(|o| {
            o.map.priors.by_category.insert("car".to_owned(), prior);
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
            let of_height = refused(|o| o.map.camera_height = Some(wrong));
            assert!(of_height.contains("the height of the cameras is"), "{wrong}: {of_height:?}");
        }
        for wrong in [-1.0, f64::NAN, f64::INFINITY] {
            assert!(refused(|o| o.map.pixel_noise_size = wrong).contains("pixel noise size"));
            assert!(refused(|o| o.map.border_margin = wrong).contains("border margin"));
            assert!(refused(|o| o.map.enclosing_quantile = wrong).contains("enclosing quantile"));
        }
        let right = SizePrior { mean: [4.0, 1.6, 1.5], sd: [0.4; 3] };
        let right = CategoryPrior { size: Some(right), upright_sd: Some(0.1), ..Default::default() };
        assert_eq!(with_prior(right), "");
        assert_eq!(refused(|o| o.map.pixel_noise_size = 0.0), "");
    }

    #[test]
    fn what_needs_up_is_refused_without_it() {
        assert!(refused(|o| o.map.camera_height = Some(1.6)).contains("needs to know where up is"));
        assert!(refused(|o| o.map.ground_plane = true).contains("needs to know where up is"));
    }
}
