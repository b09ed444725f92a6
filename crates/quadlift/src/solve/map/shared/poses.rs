//! Corrections of the camera poses: one small motion per frame, estimated with all objects (docs/method.md, section 11.2).

use std::collections::BTreeMap;

use nalgebra::{Matrix6, Rotation3, SMatrix, SVector, Vector3, Vector6};

use super::pose_prior::{PoseLevels, PosePrior};
use super::pose_system::PoseSystem;
use crate::optimize::normal_equations::{PARAMETERS, Row};
use crate::parallel::map_indices;
use crate::scene::ObjectViews;
use crate::solve::estimate::Matrix9;
use crate::solve::refined_pose::RefinedPose;

/// Correction of a camera: a rotation about its centre (rotation vector, radians) and a shift (world units), both in
/// world axes.
pub(crate) type Motion = Vector6<f64>;

/// What the measurements of an object in one frame tell about the camera.
#[derive(Debug, Clone)]
pub(crate) struct FrameTerm {
    /// Index of the frame.
    pub frame: usize,
    /// Sum of weighted products of the derivatives by the motion.
    pub information: Matrix6<f64>,
    /// Sum of weighted products of residuals and derivatives.
    pub gradient: Motion,
    /// Products of the derivatives by the motion and by the object's parameters.
    pub coupling: SMatrix<f64, 6, PARAMETERS>,
}

impl FrameTerm {
    /// Nothing about a frame.
    pub(crate) fn new(frame: usize) -> Self {
        Self { frame, information: Matrix6::zeros(), gradient: Motion::zeros(), coupling: SMatrix::zeros() }
    }

    /// Adds a residual with its derivatives by the motion and by the object's parameters.
    pub(crate) fn add(&mut self, residual: f64, by_motion: &Motion, by_object: &Row, weight: f64) {
        self.information += by_motion * by_motion.transpose() * weight;
        self.gradient += by_motion * (residual * weight);
        self.coupling += by_motion * SVector::from(*by_object).transpose() * weight;
    }
}

/// What an object tells about the cameras that see it.
#[derive(Debug, Clone)]
pub(crate) struct ObjectPoseTerms {
    /// By frame, each once.
    pub frames: Vec<FrameTerm>,
    /// Covariance of the object's parameters were the cameras known.
    pub covariance: Matrix9,
    /// The step that its parameters are still from their minimum.
    pub step: SVector<f64, PARAMETERS>,
}

/// The correction of one camera.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Correction {
    turn: Rotation3<f64>,
    shift: Vector3<f64>,
}

impl Correction {
    fn of(motion: &Motion) -> Self {
        Self {
            turn: Rotation3::new(motion.fixed_rows::<3>(0).into_owned()),
            shift: motion.fixed_rows::<3>(3).into_owned(),
        }
    }

    fn motion(&self) -> Motion {
        let turn = self.turn.scaled_axis();
        Motion::new(turn.x, turn.y, turn.z, self.shift.x, self.shift.y, self.shift.z)
    }

    fn after(&self, before: Option<&Self>) -> Self {
        before.map_or(*self, |b| Self { turn: self.turn * b.turn, shift: self.shift + b.shift })
    }
}

/// A step under the levels of one memory.
struct Candidate {
    system: PoseSystem,
    /// The corrections after it, in the order of the system's frames.
    corrections: Vec<Correction>,
    /// The levels that they show.
    levels: PoseLevels,
    /// Number of parameters that the measurements determine.
    determined: f64,
}

impl Candidate {
    fn is_worse_than(&self, other: &Self) -> bool {
        self.system.log_evidence() < other.system.log_evidence()
    }
}

/// Corrections of the cameras, by frame index.
#[derive(Debug, Clone, Default)]
pub(crate) struct PoseCorrections {
    frames: BTreeMap<usize, Correction>,
    /// Covariance of the motions of two frames.
    covariance: Option<PoseSystem>,
    /// Levels of the motions, given or estimated, for each memory that errors may have.
    levels: Vec<PoseLevels>,
    /// The memory whose evidence is largest.
    memory: Option<f64>,
    /// Number of parameters of the motions that the measurements determine.
    determined: f64,
}

impl PoseCorrections {
    /// Corrects the frames from the fitted objects and the prior: one step of Gauss and Newton for cameras and objects together, with the
    /// levels whose evidence is largest. Returns what is new in the corrections, which the objects then follow.
    pub(crate) fn update(&mut self, objects: &[ObjectPoseTerms], prior: &PosePrior) -> Self {
        if self.levels.len() != prior.first.len() {
            self.levels.clone_from(&prior.first);
        }
        let before = |frame: usize| self.frames.get(&frame).map_or_else(Motion::zeros, Correction::motion);
        let stepped = |k: usize| {
            let system = PoseSystem::new(objects, self.levels[k], before)?;
            let corrected = |(frame, step): (&usize, &Motion)| Correction::of(step).after(self.frames.get(frame));
            let corrections: Vec<Correction> = system.frames().iter().zip(system.step()).map(corrected).collect();
            let motions: Vec<Motion> = corrections.iter().map(Correction::motion).collect();
            let (levels, determined) = system.levels(&motions, prior.first[k], self.levels[k]);
            Some(Candidate { system, corrections, levels, determined })
        };
        let candidates = map_indices(self.levels.len(), stepped);
        if prior.estimated {
            for (levels, candidate) in self.levels.iter_mut().zip(&candidates) {
                *levels = candidate.as_ref().map_or(*levels, |candidate| candidate.levels);
            }
        }
        // The first of equal ones: independent errors.
        let better = |a: Candidate, b| if a.is_worse_than(&b) { b } else { a };
        let best = candidates.into_iter().flatten().reduce(better);
        let Some(Candidate { system, corrections, levels, determined }) = best else { return Self::default() };
        let steps = system.frames().iter().copied().zip(system.step().iter().map(Correction::of));
        let step = Self { frames: steps.collect(), ..Self::default() };
        self.frames.extend(system.frames().iter().copied().zip(corrections));
        self.memory = Some(levels.memory);
        self.determined = determined;
        self.covariance = Some(system);
        step
    }

    /// Moves the cameras of an object's views.
    pub(crate) fn apply(&self, views: &mut ObjectViews) {
        for view in &mut views.views {
            let Some(Correction { turn, shift }) = self.frames.get(&view.frame_index) else { continue };
            if let Some(moved) = view.projection.with_moved_camera(turn, shift) {
                view.projection = moved;
            }
        }
    }

    /// The corrections, in the order of the frames.
    pub(crate) fn refined(&self) -> Vec<RefinedPose> {
        let covariance = |frame: usize| self.covariance.as_ref().and_then(|system| system.covariance(frame, frame));
        let of = |(&frame_index, &Correction { turn, shift }): (&usize, &Correction)| RefinedPose {
            frame_index,
            turn,
            shift,
            covariance: covariance(frame_index),
        };
        self.frames.iter().map(of).collect()
    }

    /// What the errors of the corrected cameras add to the covariance of an object's parameters.
    pub(crate) fn added_covariance(&self, object: &ObjectPoseTerms) -> Matrix9 {
        let Some(system) = &self.covariance else { return Matrix9::zeros() };
        let follow: Vec<(usize, SMatrix<f64, PARAMETERS, 6>)> =
            object.frames.iter().map(|term| (term.frame, object.covariance * term.coupling.transpose())).collect();
        let mut added = Matrix9::zeros();
        for (frame, a) in &follow {
            for (other, b) in &follow {
                if let Some(covariance) = system.covariance(*frame, *other) {
                    added += a * covariance * b.transpose();
                }
            }
        }
        (added + added.transpose()) * 0.5
    }

    /// Number of parameters of the cameras that the measurements determine: they took as many degrees of freedom of the residuals.
    pub(crate) fn determined(&self) -> f64 {
        self.determined
    }

    /// Frames over which the errors of poses last, once poses were corrected.
    pub(crate) fn memory(&self) -> Option<f64> {
        self.memory
    }

    /// Root mean square rotation (radians) and shift (world units) of the corrected frames.
    pub(crate) fn size(&self) -> Option<(f64, f64)> {
        let count = self.frames.len() as f64;
        let motions = || self.frames.values().map(Correction::motion);
        let squares = |first: usize| motions().map(|m| m.fixed_rows::<3>(first).norm_squared()).sum::<f64>();
        (count > 0.0).then(|| ((squares(0) / count).sqrt(), (squares(3) / count).sqrt()))
    }
}

#[cfg(test)]
impl PoseCorrections {
    /// Corrected frames.
    pub(crate) fn of_frames(frames: &BTreeMap<usize, Motion>) -> Self {
        let frames = frames.iter().map(|(frame, motion)| (*frame, Correction::of(motion))).collect();
        Self { frames, ..Self::default() }
    }

    /// The motion of a frame.
    pub(crate) fn motion_of(&self, frame: usize) -> Option<Motion> {
        self.frames.get(&frame).map(Correction::motion)
    }
}
