//! The prior of pose corrections: how large they are, and how slowly they change from frame to frame.

use crate::solve::options::{MapOptions, PoseMotion, PoseNoise};

/// Levels from which those of the scene are estimated: rotation, radians; shift relative to the distance of the objects.
const FIRST_ROTATION: f64 = 0.005;
const FIRST_SHIFT: f64 = 0.01;

/// Factor on them where errors change slowly, so that they may become large.
const SLOW: f64 = 4.0;

/// Frames after which the correlation of slowly changing errors has fallen to 1/e: ten seconds of a camera with ten images a second.
const CORRELATED_FRAMES: f64 = 100.0;

/// Prior of the corrections: those of two frames have the correlation `exp(-gap / memory)`, the gap in frames, and so have all six
/// components (an Ornstein-Uhlenbeck process).
#[derive(Debug, Clone, Copy)]
pub(crate) struct PosePrior {
    /// Standard deviations, or where their estimation starts.
    pub levels: PoseNoise,
    /// Whether they are estimated.
    pub estimated: bool,
    /// Frames; 0 where the errors of frames are independent.
    memory: f64,
}

impl PosePrior {
    /// The prior of the options; `None` where poses are taken as exact. `distance` gives a usual distance between cameras and objects.
    pub(crate) fn new(options: &MapOptions, distance: impl FnOnce() -> f64) -> Option<Self> {
        let motion = options.refine_poses;
        if options.pose_noise.is_none() && motion.is_none() {
            return None;
        }
        let first = || {
            let larger = if motion == Some(PoseMotion::Slow) { SLOW } else { 1.0 };
            PoseNoise { rotation_sd: larger * FIRST_ROTATION, translation_sd: larger * FIRST_SHIFT * distance() }
        };
        Some(Self {
            levels: options.pose_noise.unwrap_or_else(first),
            estimated: options.pose_noise.is_none(),
            memory: if motion == Some(PoseMotion::Slow) { CORRELATED_FRAMES } else { 0.0 },
        })
    }

    /// Whether frames that follow each other are coupled.
    pub(crate) fn is_correlated(&self) -> bool {
        self.memory > 0.0
    }

    /// The precision of unit standard deviation between corrections of these frames, in ascending order: of each with itself and with the
    /// one before.
    pub(crate) fn precision(&self, frames: &[usize]) -> Vec<(f64, f64)> {
        let correlation = |k: usize| {
            let gap = (frames[k] - frames[k - 1]) as f64;
            if self.is_correlated() { (-gap / self.memory).exp() } else { 0.0 }
        };
        let mut entries = vec![(1.0, 0.0); frames.len()];
        for k in 1..frames.len() {
            let rho = correlation(k);
            let rest = 1.0 - rho * rho;
            entries[k] = (1.0 / rest, -rho / rest);
            entries[k - 1].0 += rho * rho / rest;
        }
        entries
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::DMatrix;

    #[test]
    fn the_precision_is_the_inverse_of_the_covariance() {
        for refine_poses in [PoseMotion::Slow, PoseMotion::Independent] {
            let options = MapOptions { refine_poses: Some(refine_poses), ..Default::default() };
            let prior = PosePrior::new(&options, || 20.0).unwrap();
            let larger = if refine_poses == PoseMotion::Slow { SLOW } else { 1.0 };
            assert!(prior.estimated && prior.levels.translation_sd == larger * 0.2);
            let frames = [3, 4, 9, 200];
            let precision = prior.precision(&frames);
            let full = DMatrix::from_fn(4, 4, |i, j| match (i, j) {
                (i, j) if i == j => precision[i].0,
                (i, j) if i.abs_diff(j) == 1 => precision[i.max(j)].1,
                _ => 0.0,
            });
            let covariance = full.try_inverse().unwrap();
            for (i, a) in frames.iter().enumerate() {
                for (j, b) in frames.iter().enumerate() {
                    let gap = a.abs_diff(*b) as f64;
                    let expected = match refine_poses {
                        PoseMotion::Slow => (-gap / CORRELATED_FRAMES).exp(),
                        PoseMotion::Independent => f64::from(i == j),
                    };
                    assert!((covariance[(i, j)] - expected).abs() < 1e-9, "{i} {j}");
                }
            }
        }
        assert!(PosePrior::new(&MapOptions::default(), || 1.0).is_none());
    }
}
