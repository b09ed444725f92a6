//! Corrections of the camera poses: one small motion per frame, estimated with all objects (docs/method.md, section 11.2).

use std::collections::BTreeMap;
use std::sync::Arc;

use nalgebra::{Matrix6, SMatrix};

use super::pose_prior::{PoseLevels, PosePrior};
use super::pose_system::{MAX_STEP, PoseEquations, PoseSystem};
use super::pose_terms::{Motion, ObjectPoseTerms, SceneTerms};
use super::pose_unknowns::{Correction, PoseUnknowns};
use crate::geometry::Projection;
use crate::optimize::normal_equations::PARAMETERS;
use crate::scene::ObjectViews;
use crate::solve::estimate::Matrix9;
use crate::solve::refined_pose::RefinedPose;

/// Corrections of the cameras, by frame index.
#[derive(Debug, Clone, Default)]
pub(crate) struct PoseCorrections {
    frames: BTreeMap<usize, Correction>,
    /// Which motion moves which camera.
    unknowns: Arc<PoseUnknowns>,
    /// The motions, by their numbers.
    motions: BTreeMap<usize, Correction>,
    /// The equations and their solution, which have the covariance of two motions.
    covariance: Option<(PoseEquations, PoseSystem)>,
    /// Levels of the motions, given or estimated, for each correlation length that errors may have; empty unless poses are corrected.
    levels: Vec<PoseLevels>,
    /// The correlation length whose evidence is largest.
    correlation_length: Option<f64>,
    /// Number of parameters of the motions that the measurements determine: those of objects, and of points.
    determined: [f64; 2],
}

impl PoseCorrections {
    /// Corrects the frames from the fitted objects, the points and the prior: one step of Gauss and Newton for all of them together, with the
    /// levels whose evidence is largest. Poses that may be exact stay as given where that is not clearly larger than the evidence for it.
    /// Returns what is new in the corrections, which the objects then follow.
    pub(crate) fn update(&mut self, terms: SceneTerms, prior: &PosePrior) -> Self {
        let terms = prior.unknowns.of_scene(terms);
        let before = |number: usize| self.motions.get(&number).map_or_else(Motion::zeros, Correction::motion);
        // As given, or as they are.
        if prior.keeps_input_poses(&terms, &self.levels) {
            return Self::default();
        }
        let equations = PoseEquations::new(&terms, prior.unknowns.first_camera);
        let mut levels = prior.contenders(&equations, &self.levels, before);
        let system = levels.first().and_then(|levels| PoseSystem::new(&equations, *levels, before));
        let Some(system) = system else { return Self::default() };
        let stepped =
            |(number, step): (&usize, &Motion)| (*number, Correction::of(step).after(self.motions.get(number)));
        let motions = equations.numbers().iter().zip(system.step()).map(stepped).collect();
        let (shown, determined) = system.levels(&equations, levels[0], MAX_STEP);
        if prior.estimated {
            levels[0] = shown;
        }
        let of_points = determined * system.share_of_points(&equations);
        let corrected = Self {
            frames: prior.unknowns.corrections(&motions),
            unknowns: prior.unknowns.clone(),
            motions,
            correlation_length: Some(levels[0].correlation_length),
            covariance: Some((equations, system)),
            levels,
            determined: [determined - of_points, of_points],
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
            if let Some(moved) = self.camera(view.frame_index, &view.projection) {
                view.projection = moved;
            }
        }
    }

    /// The corrections, in the order of the frames.
    pub(crate) fn refined(&self) -> Vec<RefinedPose> {
        let covariance = |frame: usize| {
            let (equations, system) = self.covariance.as_ref()?;
            let by = self.unknowns.of_frame(frame);
            let mut sum = Matrix6::zeros();
            for (number, a) in &by {
                for (other, b) in &by {
                    sum += a * system.covariance(equations, *number, *other)? * b.transpose();
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
        let Some((equations, system)) = &self.covariance else { return Matrix9::zeros() };
        let object = self.unknowns.of_terms(object);
        let follow: Vec<(usize, SMatrix<f64, PARAMETERS, 6>)> =
            object.frames.iter().map(|term| (term.frame, object.covariance * term.coupling.transpose())).collect();
        let mut added = Matrix9::zeros();
        for (frame, a) in &follow {
            for (other, b) in &follow {
                if let Some(covariance) = system.covariance(equations, *frame, *other) {
                    added += a * covariance * b.transpose();
                }
            }
        }
        (added + added.transpose()) * 0.5
    }

    /// Number of parameters of the cameras that the measurements of objects determine: they took as many degrees of freedom of the
    /// residuals.
    pub(crate) fn determined(&self) -> f64 {
        self.determined[0]
    }

    /// The same of points.
    pub(crate) fn determined_by_points(&self) -> f64 {
        self.determined[1]
    }

    /// The camera of a frame, corrected; `None` where it has no center.
    pub(crate) fn camera(&self, frame: usize, given: &Projection) -> Option<Projection> {
        match self.frames.get(&frame) {
            None => Some(*given),
            Some(Correction { turn, shift }) => given.with_moved_camera(turn, shift),
        }
    }

    /// Frames over which the errors of poses last, once poses were corrected.
    pub(crate) fn correlation_length(&self) -> Option<f64> {
        self.correlation_length
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
