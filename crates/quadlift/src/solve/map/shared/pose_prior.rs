//! The prior of pose corrections: how large they are, and how slowly they change from frame to frame.

use nalgebra::Vector6;

use crate::solve::options::{MapOptions, PoseMotion, PoseNoise};

/// Levels from which those of the scene are estimated: rotation, radians; shift relative to the distance of the objects.
const FIRST_ROTATION: f64 = 0.005;
const FIRST_SHIFT: f64 = 0.01;

/// Factor on them where errors change slowly, so that they may become large.
const SLOW: f64 = 4.0;

/// Frames after which the correlation of slowly changing errors has fallen to 1/e: ten seconds of a camera with ten images a second.
const CORRELATED_FRAMES: f64 = 100.0;

/// The same where it is found, in steps of a factor of three: the evidence is flat between them.
const MEMORIES: [f64; 4] = [0.0, 10.0, 30.0, CORRELATED_FRAMES];

/// How large the errors of poses are, and how long they last. Those of two frames have the correlation `exp(-gap / memory)`, the gap in
/// frames, and so have all six components (an Ornstein-Uhlenbeck process).
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct PoseLevels {
    /// Standard deviations.
    pub noise: PoseNoise,
    /// Frames; 0 where the errors of frames are independent.
    pub memory: f64,
}

/// Prior of the corrections.
#[derive(Debug, Clone)]
pub(crate) struct PosePrior {
    /// The levels, or where their estimation starts, of each memory that errors may have.
    pub first: Vec<PoseLevels>,
    /// Whether standard deviations are estimated.
    pub estimated: bool,
}

impl PosePrior {
    /// The prior of the options; `None` where poses are taken as exact. `distance` gives a usual distance between cameras and objects.
    pub(crate) fn new(options: &MapOptions, distance: impl FnOnce() -> f64) -> Option<Self> {
        let memories: &[f64] = match (options.refine_poses, options.pose_noise) {
            (None, None) => return None,
            (None, Some(_)) | (Some(PoseMotion::Independent), _) => &[0.0],
            (Some(PoseMotion::Slow), _) => &[CORRELATED_FRAMES],
            (Some(PoseMotion::Auto), _) => &MEMORIES,
        };
        let shift = if options.pose_noise.is_none() { FIRST_SHIFT * distance() } else { 0.0 };
        let first = |&memory: &f64| {
            let larger = if memory > 0.0 { SLOW } else { 1.0 };
            let usual = PoseNoise { rotation_sd: larger * FIRST_ROTATION, translation_sd: larger * shift };
            PoseLevels { noise: options.pose_noise.unwrap_or(usual), memory }
        };
        Some(Self { first: memories.iter().map(first).collect(), estimated: options.pose_noise.is_none() })
    }
}

impl PoseLevels {
    /// Whether frames that follow each other are coupled.
    pub(crate) fn is_correlated(&self) -> bool {
        self.memory > 0.0
    }

    /// Correlation of the errors of frames with this gap.
    fn correlation(&self, gap: usize) -> f64 {
        if self.is_correlated() { (-(gap as f64) / self.memory).exp() } else { 0.0 }
    }

    /// The precision of unit standard deviation between corrections of these frames, in ascending order: of each with itself and with the
    /// one before.
    pub(crate) fn precision(&self, frames: &[usize]) -> Vec<(f64, f64)> {
        let mut entries = vec![(1.0, 0.0); frames.len()];
        for k in 1..frames.len() {
            let rho = self.correlation(frames[k] - frames[k - 1]);
            let rest = 1.0 - rho * rho;
            entries[k] = (1.0 / rest, -rho / rest);
            entries[k - 1].0 += rho * rho / rest;
        }
        entries
    }

    /// Precision of each component of a motion.
    pub(crate) fn scale(&self) -> Vector6<f64> {
        let PoseNoise { rotation_sd, translation_sd } = self.noise;
        Vector6::from_fn(|k, _| if k < 3 { rotation_sd.powi(-2) } else { translation_sd.powi(-2) })
    }

    /// Logarithm of the determinant of the precision of the corrections of these frames.
    pub(crate) fn log_determinant(&self, frames: &[usize]) -> f64 {
        let scales: f64 = self.scale().iter().map(|scale| scale.ln()).sum();
        let rest = |pair: &[usize]| -(1.0 - self.correlation(pair[1] - pair[0]).powi(2)).ln();
        frames.len() as f64 * scales + 6.0 * frames.windows(2).map(rest).sum::<f64>()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::DMatrix;

    #[test]
    fn the_precision_is_the_inverse_of_the_covariance() {
        let options = MapOptions { refine_poses: Some(PoseMotion::Auto), ..Default::default() };
        let prior = PosePrior::new(&options, || 20.0).unwrap();
        assert!(prior.estimated && prior.first.len() == MEMORIES.len());
        for levels in prior.first {
            let larger = if levels.memory > 0.0 { SLOW } else { 1.0 };
            assert!(levels.noise.translation_sd == larger * 0.2);
            let frames = [3, 4, 9, 200];
            let precision = levels.precision(&frames);
            let full = DMatrix::from_fn(4, 4, |i, j| match (i, j) {
                (i, j) if i == j => precision[i].0,
                (i, j) if i.abs_diff(j) == 1 => precision[i.max(j)].1,
                _ => 0.0,
            });
            let scale = levels.scale();
            let determinant: f64 = scale.iter().map(|scale| (&full * *scale).determinant().ln()).sum();
            assert!((determinant - levels.log_determinant(&frames)).abs() < 1e-9 * determinant.abs());
            let covariance = full.try_inverse().unwrap();
            for (i, a) in frames.iter().enumerate() {
                for (j, b) in frames.iter().enumerate() {
                    let gap = a.abs_diff(*b) as f64;
                    let expected =
                        if levels.memory > 0.0 { (-gap / levels.memory).exp() } else { f64::from(u8::from(i == j)) };
                    assert!((covariance[(i, j)] - expected).abs() < 1e-9, "{i} {j}");
                }
            }
        }
    }

    #[test]
    fn options_choose_the_memories() {
        let of = |refine_poses, pose_noise| {
            let options = MapOptions { refine_poses, pose_noise, ..Default::default() };
            PosePrior::new(&options, || 1.0)
                .map(|prior| prior.first.iter().map(|levels| levels.memory).collect::<Vec<_>>())
        };
        let noise = Some(PoseNoise { rotation_sd: 0.1, translation_sd: 0.2 });
        assert_eq!(of(None, None), None);
        assert_eq!(of(None, noise), Some(vec![0.0]));
        assert_eq!(of(Some(PoseMotion::Independent), None), Some(vec![0.0]));
        assert_eq!(of(Some(PoseMotion::Slow), noise), Some(vec![CORRELATED_FRAMES]));
        assert_eq!(of(Some(PoseMotion::Auto), None), Some(MEMORIES.to_vec()));
    }
}
