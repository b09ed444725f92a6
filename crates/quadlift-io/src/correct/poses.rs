//! Poses of frames, corrected.

use nalgebra::{Matrix3, Matrix3x4, Vector3};
use quadlift::diagnosis::{CameraParts, Correction};
use quadlift::geometry::Projection;

use crate::error::EntryError;
use crate::scene_file::SceneFile;

/// Corrects the poses of all frames, also those in projections; returns their number.
pub(super) fn correct(file: &mut SceneFile, correction: &Correction) -> Result<usize, EntryError> {
    change(file, |rotation, translation| correction.pose(rotation, translation))
}

/// Multiplies the translations of all poses; returns their number.
pub(super) fn scale(file: &mut SceneFile, factor: f64) -> usize {
    // No entry can be wrong here: `to_scene` reports invalid projections.
    change(file, |rotation, translation| (*rotation, translation * factor)).unwrap_or_default()
}

/// Maps rotation and translation of all poses; returns their number.
pub(super) fn change(
    file: &mut SceneFile,
    map: impl Fn(&Matrix3<f64>, &Vector3<f64>) -> (Matrix3<f64>, Vector3<f64>),
) -> Result<usize, EntryError> {
    let mut changed = 0;
    for frame in &mut file.frames {
        if let Some(rows) = &mut frame.cam_from_world {
            let pose = matrix(rows);
            let (rotation, translation) = map(&pose.fixed_columns::<3>(0).into_owned(), &pose.column(3).into_owned());
            for (i, row) in rows.iter_mut().enumerate() {
                *row = [rotation[(i, 0)], rotation[(i, 1)], rotation[(i, 2)], translation[i]];
            }
            changed += 1;
        }
        if let Some(rows) = &mut frame.projection {
            // `to_scene` reports invalid projections.
            let parts = Projection::from_matrix(matrix(rows)).ok().as_ref().and_then(CameraParts::from_projection);
            let Some(parts) = parts else { continue };
            let (rotation, translation) = map(&parts.rotation, &parts.translation);
            if let Some(projection) = (CameraParts { rotation, translation, ..parts }).projection() {
                *rows = super::poses::rows(projection.matrix());
                changed += 1;
            }
        }
    }
    Ok(changed)
}

/// The matrix with these rows.
pub(super) fn matrix(rows: &[[f64; 4]; 3]) -> Matrix3x4<f64> {
    Matrix3x4::from_fn(|i, j| rows[i][j])
}

/// The rows of a matrix.
pub(super) fn rows(matrix: &Matrix3x4<f64>) -> [[f64; 4]; 3] {
    [0, 1, 2].map(|i| [0, 1, 2, 3].map(|j| matrix[(i, j)]))
}
