//! The prior of pose corrections: how large they are, and how slowly they change from frame to frame.

use std::sync::Arc;

use nalgebra::Vector6;

use super::pose_unknowns::PoseUnknowns;
use crate::solve::options::{PoseMotion, PoseNoise, PosteriorOptions};

/// Levels from which those of the scene are estimated: rotation, radians; shift relative to the distance of the objects.
const FIRST_ROTATION: f64 = 0.005;
const FIRST_SHIFT: f64 = 0.01;

/// Factor on them where errors change slowly, so that they may become large.
const SLOW: f64 = 4.0;

/// Standard deviations of the places of cameras in their rig: one degree; shift relative to the distance of the objects.
const EXTRINSIC_ROTATION: f64 = 0.0175;
const EXTRINSIC_SHIFT: f64 = 0.003;

/// Frames after which the correlation of slowly changing errors has fallen to 1/e: ten seconds of a camera with ten images a second.
const CORRELATED_FRAMES: f64 = 100.0;

/// The same where it is found, in steps of a factor of three: the evidence is flat between them.
const MEMORIES: [f64; 4] = [0.0, 10.0, 30.0, CORRELATED_FRAMES];

/// How large the errors of poses are, and how long they last. Those of two frames have the correlation `exp(-gap / correlation length)`,
/// the gap in frames, and so have all six components (an Ornstein-Uhlenbeck process).
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct PoseLevels {
    /// Standard deviations.
    pub noise: PoseNoise,
    /// Frames; 0 where the errors of frames are independent.
    pub correlation_length: f64,
    /// Standard deviations of the motions of cameras in their rig.
    pub extrinsics: PoseNoise,
    /// Standard deviations from which their estimation started.
    pub first: PoseNoise,
    /// The number of the first camera of a rig; those before are frames, or time steps.
    pub first_camera: usize,
}

/// Prior of the corrections.
#[derive(Debug, Clone)]
pub(crate) struct PosePrior {
    /// The levels, or where their estimation starts, of each correlation length that errors may have.
    pub first: Vec<PoseLevels>,
    /// Whether standard deviations are estimated.
    pub estimated: bool,
    /// Whether poses are left as given unless they clearly show errors.
    pub may_be_exact: bool,
    /// Which motion moves which camera.
    pub unknowns: Arc<PoseUnknowns>,
}

impl PosePrior {
    /// The prior of the options; `None` where poses are taken as exact. `distance` gives a usual distance between cameras and objects.
    pub(crate) fn new(
        options: &PosteriorOptions,
        unknowns: &Arc<PoseUnknowns>,
        distance: impl FnOnce() -> f64,
    ) -> Option<Self> {
        let memories: &[f64] = match (options.refine_poses, options.pose_noise) {
            (None, None) => return None,
            (None, Some(_)) | (Some(PoseMotion::Independent), _) => &[0.0],
            (Some(PoseMotion::Slow), _) => &[CORRELATED_FRAMES],
            (Some(PoseMotion::Auto), _) => &MEMORIES,
        };
        let distance = distance();
        let shift = FIRST_SHIFT * distance;
        let extrinsics = PoseNoise { rotation_sd: EXTRINSIC_ROTATION, translation_sd: EXTRINSIC_SHIFT * distance };
        let first = |&correlation_length: &f64| {
            let larger = if correlation_length > 0.0 { SLOW } else { 1.0 };
            let usual = PoseNoise { rotation_sd: larger * FIRST_ROTATION, translation_sd: larger * shift };
            let noise = options.pose_noise.unwrap_or(usual);
            PoseLevels { noise, correlation_length, extrinsics, first: noise, first_camera: unknowns.first_camera }
        };
        let estimated = options.pose_noise.is_none();
        let may_be_exact = estimated && options.refine_poses == Some(PoseMotion::Auto);
        let first = memories.iter().map(first).collect();
        Some(Self { first, estimated, may_be_exact, unknowns: unknowns.clone() })
    }
}

impl PoseLevels {
    /// Whether frames that follow each other are coupled.
    pub(crate) fn is_correlated(&self) -> bool {
        self.correlation_length > 0.0
    }

    /// The larger relative change of a standard deviation against other levels.
    pub(crate) fn change(&self, other: &Self) -> f64 {
        let of = |a: f64, b: f64| (a / b - 1.0).abs();
        let (a, b) = (self.noise, other.noise);
        of(a.rotation_sd, b.rotation_sd).max(of(a.translation_sd, b.translation_sd))
    }

    /// With standard deviations by this function of its own ones and those of others.
    fn with(self, other: &Self, of: impl Fn(f64, f64) -> f64) -> Self {
        let (a, b) = (self.noise, other.noise);
        let rotation_sd = of(a.rotation_sd, b.rotation_sd);
        let translation_sd = of(a.translation_sd, b.translation_sd);
        Self { noise: PoseNoise { rotation_sd, translation_sd }, ..self }
    }

    /// Standard deviations times a factor.
    pub(super) fn scaled(self, factor: f64) -> Self {
        self.with(&self, |sd, _| factor * sd)
    }

    /// None larger than those.
    pub(super) fn at_most(self, other: &Self) -> Self {
        self.with(other, f64::min)
    }

    /// Within a factor of those.
    pub(super) fn within(self, other: &Self, factor: f64) -> Self {
        self.with(other, |sd, of| sd.clamp(of / factor, of * factor))
    }

    /// Correlation of the errors of frames with this gap.
    fn correlation(&self, gap: usize) -> f64 {
        if self.is_correlated() { (-(gap as f64) / self.correlation_length).exp() } else { 0.0 }
    }

    /// The precision of unit standard deviation between corrections with these numbers, in ascending order: of each with itself and with the
    /// one before.
    pub(crate) fn precision(&self, numbers: &[usize]) -> Vec<(f64, f64)> {
        let mut entries = vec![(1.0, 0.0); numbers.len()];
        for k in 1..self.time_steps(numbers).len() {
            let rho = self.correlation(numbers[k] - numbers[k - 1]);
            let rest = 1.0 - rho * rho;
            entries[k] = (1.0 / rest, -rho / rest);
            entries[k - 1].0 += rho * rho / rest;
        }
        entries
    }

    /// The numbers that are frames or time steps, not cameras.
    pub(crate) fn time_steps<'a>(&self, numbers: &'a [usize]) -> &'a [usize] {
        &numbers[..numbers.partition_point(|number| *number < self.first_camera)]
    }

    /// Precision of each component of the motion with this number.
    pub(crate) fn scale(&self, number: usize) -> Vector6<f64> {
        let PoseNoise { rotation_sd, translation_sd } =
            if number < self.first_camera { self.noise } else { self.extrinsics };
        Vector6::from_fn(|k, _| if k < 3 { rotation_sd.powi(-2) } else { translation_sd.powi(-2) })
    }

    /// Logarithm of the determinant of the precision of the corrections with these numbers.
    pub(crate) fn log_determinant(&self, numbers: &[usize]) -> f64 {
        let scales = |number: &usize| self.scale(*number).iter().map(|scale| scale.ln()).sum::<f64>();
        let rest = |pair: &[usize]| -(1.0 - self.correlation(pair[1] - pair[0]).powi(2)).ln();
        let correlated = if self.is_correlated() { self.time_steps(numbers) } else { &[] };
        numbers.iter().map(scales).sum::<f64>() + 6.0 * correlated.windows(2).map(rest).sum::<f64>()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::DMatrix;

    #[test]
    fn the_precision_is_the_inverse_of_the_covariance() {
        let options = PosteriorOptions { refine_poses: Some(PoseMotion::Auto), ..Default::default() };
        let prior = PosePrior::new(&options, &Arc::default(), || 20.0).unwrap();
        assert!(prior.estimated && prior.first.len() == MEMORIES.len());
        for levels in prior.first {
            let larger = if levels.correlation_length > 0.0 { SLOW } else { 1.0 };
            assert!(levels.noise.translation_sd == larger * 0.2);
            let frames = [3, 4, 9, 200];
            let precision = levels.precision(&frames);
            let full = DMatrix::from_fn(4, 4, |i, j| match (i, j) {
                (i, j) if i == j => precision[i].0,
                (i, j) if i.abs_diff(j) == 1 => precision[i.max(j)].1,
                _ => 0.0,
            });
            let scale = levels.scale(0);
            let determinant: f64 = scale.iter().map(|scale| (&full * *scale).determinant().ln()).sum();
            assert!((determinant - levels.log_determinant(&frames)).abs() < 1e-9 * determinant.abs());
            let covariance = full.try_inverse().unwrap();
            for (i, a) in frames.iter().enumerate() {
                for (j, b) in frames.iter().enumerate() {
                    let gap = a.abs_diff(*b) as f64;
                    let expected = if levels.correlation_length > 0.0 {
                        (-gap / levels.correlation_length).exp()
                    } else {
                        f64::from(u8::from(i == j))
                    };
                    assert!((covariance[(i, j)] - expected).abs() < 1e-9, "{i} {j}");
                }
            }
        }
    }

    #[test]
    fn options_choose_the_memories() {
        let of = |refine_poses, pose_noise| {
            let options = PosteriorOptions { refine_poses, pose_noise, ..Default::default() };
            PosePrior::new(&options, &Arc::default(), || 1.0)
                .map(|prior| prior.first.iter().map(|levels| levels.correlation_length).collect::<Vec<_>>())
        };
        let noise = Some(PoseNoise { rotation_sd: 0.1, translation_sd: 0.2 });
        assert_eq!(of(None, None), None);
        assert_eq!(of(None, noise), Some(vec![0.0]));
        assert_eq!(of(Some(PoseMotion::Independent), None), Some(vec![0.0]));
        assert_eq!(of(Some(PoseMotion::Slow), noise), Some(vec![CORRELATED_FRAMES]));
        assert_eq!(of(Some(PoseMotion::Auto), None), Some(MEMORIES.to_vec()));
    }
}
