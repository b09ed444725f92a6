//! The pose of a frame as it is written.

use nalgebra::Matrix3x4;
use quadlift::geometry::{CamFromWorld, Projection};

use super::records::FrameRecord;

/// The pose of a frame; `None` where it has none that is valid.
pub(super) fn pose_of(frame: &FrameRecord) -> Option<CamFromWorld> {
    match (&frame.cam_from_world, &frame.projection) {
        (Some(rows), _) => CamFromWorld::new(matrix(rows)).ok(),
        (None, Some(rows)) => Projection::from_matrix(matrix(rows)).ok()?.camera_pose(),
        (None, None) => None,
    }
}

pub(super) fn matrix(rows: &[[f64; 4]; 3]) -> Matrix3x4<f64> {
    Matrix3x4::from_fn(|i, j| rows[i][j])
}
