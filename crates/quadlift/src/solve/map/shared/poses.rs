//! Corrections of the camera poses: one small motion per frame, estimated with all objects (docs/method.md, section 11.2).

use std::collections::BTreeMap;
use std::sync::Arc;

use nalgebra::{Matrix6, Rotation3, SMatrix, SVector, Vector3, Vector6};

use super::pose_prior::{PoseLevels, PosePrior};
use super::pose_system::{LARGEST_STEP, PoseSystem};
use super::pose_unknowns::PoseUnknowns;
use crate::geometry::rotation_vector;
use crate::optimize::normal_equations::{PARAMETERS, Row};
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

    /// The same about a motion by which that of the camera has this derivative.
    pub(super) fn by(&self, by: &Matrix6<f64>) -> Self {
        Self {
            frame: self.frame,
            information: by.transpose() * self.information * by,
            gradient: by.tr_mul(&self.gradient),
            coupling: by.transpose() * self.coupling,
        }
    }

    /// Adds what another frame tells, if it has the same motion.
    pub(crate) fn merge(&mut self, other: &Self) {
        self.information += other.information;
        self.gradient += other.gradient;
        self.coupling += other.coupling;
    }
}

/// What an object tells about the cameras that see it.
#[derive(Debug, Clone)]
pub(crate) struct ObjectPoseTerms {
    /// By frame, each once; by unknown after [`PoseUnknowns::of_object`].
    pub frames: Vec<FrameTerm>,
    /// Products of the derivatives by the motions of two unknowns that move the same camera: the larger number, the smaller one.
    pub cross: Vec<((usize, usize), Matrix6<f64>)>,
    /// Covariance of the object's parameters were the cameras known.
    pub covariance: Matrix9,
    /// The step that its parameters are still from their minimum.
    pub step: SVector<f64, PARAMETERS>,
}

/// The correction of one camera.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Correction {
    pub(super) turn: Rotation3<f64>,
    pub(super) shift: Vector3<f64>,
}

impl Correction {
    pub(super) fn of(motion: &Motion) -> Self {
        Self {
            turn: Rotation3::new(motion.fixed_rows::<3>(0).into_owned()),
            shift: motion.fixed_rows::<3>(3).into_owned(),
        }
    }

    pub(super) fn motion(&self) -> Motion {
        let turn = rotation_vector(&self.turn);
        Motion::new(turn.x, turn.y, turn.z, self.shift.x, self.shift.y, self.shift.z)
    }

    fn after(&self, before: Option<&Self>) -> Self {
        before.map_or(*self, |b| Self { turn: self.turn * b.turn, shift: self.shift + b.shift })
    }

    fn inverse(&self) -> Self {
        Self { turn: self.turn.inverse(), shift: -self.shift }
    }
}

/// Corrections of the cameras, by frame index.
#[derive(Debug, Clone, Default)]
pub(crate) struct PoseCorrections {
    frames: BTreeMap<usize, Correction>,
    /// Which motion moves which camera.
    unknowns: Arc<PoseUnknowns>,
    /// The motions, by their numbers.
    motions: BTreeMap<usize, Correction>,
    /// Covariance of two motions.
    covariance: Option<PoseSystem>,
    /// Levels of the motions, given or estimated, for each memory that errors may have; empty unless poses are corrected.
    levels: Vec<PoseLevels>,
    /// The memory whose evidence is largest.
    memory: Option<f64>,
    /// Number of parameters of the motions that the measurements determine.
    determined: f64,
}

impl PoseCorrections {
    /// Corrects the frames from the fitted objects and the prior: one step of Gauss and Newton for cameras and objects together, with the
    /// levels whose evidence is largest. Poses that may be exact stay as given where that is not clearly larger than the evidence for it.
    /// Returns what is new in the corrections, which the objects then follow.
    pub(crate) fn update(&mut self, objects: Vec<ObjectPoseTerms>, prior: &PosePrior) -> Self {
        let objects: Vec<_> = objects.into_iter().map(|object| prior.unknowns.of_object(object)).collect();
        let before = |number: usize| self.motions.get(&number).map_or_else(Motion::zeros, Correction::motion);
        let mut levels = prior.contenders(&objects, &self.levels, before);
        let system = levels.first().and_then(|levels| PoseSystem::new(&objects, *levels, before));
        // As given, or as they are.
        let Some(system) = system else { return Self::default() };
        let stepped =
            |(number, step): (&usize, &Motion)| (*number, Correction::of(step).after(self.motions.get(number)));
        let motions = system.numbers().iter().zip(system.step()).map(stepped).collect();
        let (shown, determined) = system.levels(levels[0], LARGEST_STEP);
        if prior.estimated {
            levels[0] = shown;
        }
        let corrected = Self {
            frames: prior.unknowns.corrections(&motions),
            unknowns: prior.unknowns.clone(),
            motions,
            covariance: Some(system),
            memory: Some(levels[0].memory),
            levels,
            determined,
        };
        let before = std::mem::replace(self, corrected);
        let mut step = self.frames.clone();
        for (frame, old) in &before.frames {
            let back = old.inverse();
            step.entry(*frame).and_modify(|new| *new = new.after(Some(&back))).or_insert(back);
        }
        Self { frames: step, ..Self::default() }
    }

    /// Whether poses are corrected.
    pub(crate) fn is_empty(&self) -> bool {
        self.frames.is_empty()
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
        let covariance = |frame: usize| {
            let system = self.covariance.as_ref()?;
            let by = self.unknowns.of_frame(frame);
            let mut sum = Matrix6::zeros();
            for (number, a) in &by {
                for (other, b) in &by {
                    sum += a * system.covariance(*number, *other)? * b.transpose();
                }
            }
            Some((sum + sum.transpose()) * 0.5)
        };
        let of = |(&frame_index, &Correction { turn, shift }): (&usize, &Correction)| RefinedPose {
            frame_index,
            turn,
            shift,
            covariance: covariance(frame_index),
        };
        self.frames.iter().map(of).collect()
    }

    /// What the errors of the corrected cameras add to the covariance of an object's parameters.
    pub(crate) fn added_covariance(&self, object: ObjectPoseTerms) -> Matrix9 {
        let Some(system) = &self.covariance else { return Matrix9::zeros() };
        let object = self.unknowns.of_object(object);
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
        let frames: BTreeMap<_, _> = frames.iter().map(|(frame, motion)| (*frame, Correction::of(motion))).collect();
        Self { motions: frames.clone(), frames, ..Self::default() }
    }

    /// The motion of a frame.
    pub(crate) fn motion_of(&self, frame: usize) -> Option<Motion> {
        self.frames.get(&frame).map(Correction::motion)
    }
}
