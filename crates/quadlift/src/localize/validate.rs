//! Checks of the options of a localization.

use super::measurement_kind::MeasurementKind;
use super::options::LocalizeOptions;
use crate::scene::Scene;
use crate::solve::{Method, OptionError, PosteriorOptions, refuse};

impl LocalizeOptions {
    /// Validates the options, independent of a scene.
    ///
    /// # Errors
    /// [`OptionError`] names the first option that is out of range.
    pub fn validate(&self) -> Result<(), OptionError> {
        if self.measurements == MeasurementKind::Mask && !matches!(self.method, Method::Posterior(_) | Method::Planes) {
            return refuse("only the methods map and planes use masks; the others use their ellipses");
        }
        self.method.validate()
    }
}

/// Rejects options that need the scene's `up` if it is missing.
pub(super) fn check_up(options: &PosteriorOptions, scene: &Scene) -> Result<(), OptionError> {
    if scene.up.is_some() || scene.frames.is_empty() {
        return Ok(());
    }
    let needs = |what: &str| refuse(format!("{what} needs an \"up\" direction (against gravity) in the scene"));
    if options.ground_plane {
        return needs("the ground plane");
    }
    if options.camera_height.is_some() { needs("the height of the cameras") } else { Ok(()) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synthetic::{SyntheticOptions, generate};

    #[test]
    fn options_of_a_localization_are_checked() {
        let masks = LocalizeOptions { measurements: MeasurementKind::Mask, ..LocalizeOptions::from(Method::Lfd) };
        assert!(masks.validate().unwrap_err().to_string().contains("masks"));
        let of_method = LocalizeOptions::from(PosteriorOptions { shape_sd: f64::NAN, ..Default::default() });
        assert!(of_method.validate().unwrap_err().to_string().contains("shape prior"));
    }

    #[test]
    fn what_needs_up_is_refused_without_it() {
        let mut scene = generate(&SyntheticOptions { objects: 1, views: 3, ..Default::default() }).unwrap().scene;
        scene.0.up = None;
        for options in [
            PosteriorOptions { camera_height: Some(1.6), ..Default::default() },
            PosteriorOptions { ground_plane: true, ..Default::default() },
        ] {
            assert!(check_up(&options, &scene).unwrap_err().to_string().contains("needs an \"up\" direction"));
        }
    }
}
