//! What a run reads, corrects and measures.

use std::convert::Infallible;

use crate::diagnosis::{Cause, Correction, Diagnosis};
use crate::localize::{LocalizeOptions, MeasurementKind};
use crate::observer::Observer;
use crate::scene::Scene;

/// A scene that can be corrected, and whose masks, depth images and points can be read.
///
/// A [`Scene`] is an input: it is corrected by `Correction::apply`, and everything in it is measured already.
pub trait Input {
    /// Why the input cannot be corrected or read.
    type Error: std::error::Error;

    /// The scene as it is now.
    fn scene(&self) -> &Scene;

    /// The scene, to give its detections the objects that association finds.
    fn scene_mut(&mut self) -> &mut Scene;

    /// What was found wrong with the scene before, with more frames and boxes than it has; consistent if nothing was.
    fn known(&self) -> Diagnosis {
        Diagnosis::default()
    }

    /// The scene after corrections, one after the other, on trial; `None` if they cannot be applied.
    fn corrected(&self, corrections: &[Correction]) -> Option<Scene>;

    /// Corrects the input for good; `false` if there is no correction for this cause.
    ///
    /// # Errors
    /// The corrected input is not valid.
    fn correct(&mut self, cause: &Cause) -> Result<bool, Self::Error>;

    /// Reads the masks, depth images and points that the options use. Detections name their objects by now: a point is counted
    /// once for each object. Returns the measurements to use: others than those of the options if these contradict the boxes.
    ///
    /// # Errors
    /// Nothing can be read; problems of single detections are not errors.
    fn measure(&mut self, options: &LocalizeOptions, observer: &dyn Observer) -> Result<MeasurementKind, Self::Error>;
}

impl Input for Scene {
    type Error = Infallible;

    fn scene(&self) -> &Scene {
        self
    }

    fn scene_mut(&mut self) -> &mut Scene {
        self
    }

    fn corrected(&self, corrections: &[Correction]) -> Option<Scene> {
        let [first, others @ ..] = corrections else { return Some(self.clone()) };
        Some(others.iter().fold(first.apply(self), |scene, correction| correction.apply(&scene)))
    }

    fn correct(&mut self, cause: &Cause) -> Result<bool, Infallible> {
        let Some(correction) = cause.correction else { return Ok(false) };
        *self = correction.apply(self);
        Ok(true)
    }

    fn measure(&mut self, options: &LocalizeOptions, _: &dyn Observer) -> Result<MeasurementKind, Infallible> {
        Ok(options.measurements)
    }
}
