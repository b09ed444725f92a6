//! Corrections of the camera poses: one small motion per frame, estimated from all objects in it (docs/method.md,
//! section 11.2).

use std::collections::BTreeMap;

use nalgebra::{Matrix6, Rotation3, Vector6};

use crate::geometry::linalg::solve_spd;
use crate::scene::ObjectViews;
use crate::solve::options::PoseNoise;

/// Correction of a camera: a rotation about its centre (rotation vector, radians) and a shift (world units), both in
/// world axes.
type Motion = Vector6<f64>;

/// Corrections of the cameras, by frame index.
#[derive(Debug, Clone, Default)]
pub(crate) struct PoseCorrections {
    frames: BTreeMap<usize, Motion>,
}

#[cfg(test)]
impl PoseCorrections {
    /// Corrected frames.
    pub(crate) fn of_frames(frames: BTreeMap<usize, Motion>) -> Self {
        Self { frames }
    }

    /// The correction of a frame.
    pub(crate) fn of_frame(&self, frame: usize) -> Option<Motion> {
        self.frames.get(&frame).copied()
    }
}

impl PoseCorrections {
    /// Corrects the frames from the fitted objects and the prior. Returns the new corrections, which the objects then
    /// follow.
    ///
    /// `each_row` gives every residual of the objects: index of its frame, residual, its derivatives by a motion of the
    /// camera, weight.
    pub(crate) fn update(
        &mut self,
        each_row: impl FnOnce(&mut dyn FnMut(usize, f64, Motion, f64)),
        prior: PoseNoise,
    ) -> Self {
        let precision = Matrix6::from_diagonal(&Motion::from_fn(|k, _| {
            if k < 3 { prior.rotation_sd.powi(-2) } else { prior.translation_sd.powi(-2) }
        }));
        // One step of Gauss and Newton for each frame; the objects stay where they are.
        let mut systems: BTreeMap<usize, (Matrix6<f64>, Motion)> = BTreeMap::new();
        each_row(&mut |frame, residual, row, weight| {
            let (normal, right) = systems.entry(frame).or_insert_with(|| {
                (precision, self.frames.get(&frame).map_or_else(Motion::zeros, |moved| precision * moved))
            });
            *normal += row * row.transpose() * weight;
            *right += row * (residual * weight);
        });
        let mut step = Self::default();
        for (frame, (normal, right)) in systems {
            if let Some(more) = solve_spd(&normal, &-right).filter(|more| more.iter().all(|x| x.is_finite())) {
                *self.frames.entry(frame).or_insert_with(Motion::zeros) += more;
                step.frames.insert(frame, more);
            }
        }
        step
    }

    /// Moves the cameras of an object's views.
    pub(crate) fn apply(&self, views: &mut ObjectViews) {
        for view in &mut views.views {
            let Some(motion) = self.frames.get(&view.frame_index) else { continue };
            // Small turns: in which order they are made does not matter.
            let turn = Rotation3::new(motion.fixed_rows::<3>(0).into_owned());
            let shift = motion.fixed_rows::<3>(3).into_owned();
            if let Some(moved) = view.projection.with_moved_camera(&turn, &shift) {
                view.projection = moved;
            }
        }
    }

    /// Root mean square rotation (radians) and shift (world units) of the corrected frames.
    pub(crate) fn size(&self) -> Option<(f64, f64)> {
        let count = self.frames.len() as f64;
        let squares = |first: usize| self.frames.values().map(|m| m.fixed_rows::<3>(first).norm_squared()).sum::<f64>();
        (count > 0.0).then(|| ((squares(0) / count).sqrt(), (squares(3) / count).sqrt()))
    }
}
