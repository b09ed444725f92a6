//! Poses of other formats as rows of `cam_from_world`.

use nalgebra::{Matrix3, Matrix4, Quaternion, UnitQuaternion, Vector3};
use quadlift::geometry::rotation_defect;

/// The 4x4 matrix with a rotation (or any 3x3 matrix) and a translation.
pub(super) fn matrix4(rotation: &Matrix3<f64>, translation: &Vector3<f64>) -> Matrix4<f64> {
    let mut matrix = rotation.to_homogeneous();
    matrix.fixed_view_mut::<3, 1>(0, 3).copy_from(translation);
    matrix
}

/// The first three rows of a 4x4 matrix, as files have them.
pub(super) fn rows(matrix: &Matrix4<f64>) -> [[f64; 4]; 3] {
    [0, 1, 2].map(|i| [0, 1, 2, 3].map(|j| matrix[(i, j)]))
}

/// The 4x4 matrix of three rows.
pub(crate) fn from_rows(rows: &[[f64; 4]; 3]) -> Matrix4<f64> {
    let mut matrix = Matrix4::identity();
    for (i, row) in rows.iter().enumerate() {
        for (j, value) in row.iter().enumerate() {
            matrix[(i, j)] = *value;
        }
    }
    matrix
}

/// Checks that a matrix, of this name in messages, is a rotation and a translation, to 1e-3.
pub(super) fn check_rigid(matrix: &Matrix4<f64>, name: &str) -> Result<(), String> {
    let defect = rotation_defect(&matrix.fixed_view::<3, 3>(0, 0).into_owned());
    if defect > 1e-3 {
        return Err(format!(
            "the 3x3 part of {name} is not a rotation (|R R^T - I| is {defect:.3e}, at most 1e-3 is accepted)"
        ));
    }
    Ok(())
}

/// The inverse of a rotation and a translation, whose rotation need not be orthonormal to the last digit; `None` if it
/// is singular.
pub(super) fn inverse(matrix: &Matrix4<f64>) -> Option<Matrix4<f64>> {
    let inverse = matrix.fixed_view::<3, 3>(0, 0).into_owned().try_inverse()?;
    let translation = -(inverse * matrix.fixed_view::<3, 1>(0, 3));
    Some(matrix4(&inverse, &translation))
}

/// The rotation of a quaternion of any length `[w, x, y, z]`; `None` if it is zero or not finite.
pub(super) fn rotation_of(wxyz: [f64; 4]) -> Option<Matrix3<f64>> {
    let [w, x, y, z] = wxyz;
    let quaternion = UnitQuaternion::try_new(Quaternion::new(w, x, y, z), 1e-12)?;
    quaternion.coords.iter().all(|c| c.is_finite()).then(|| *quaternion.to_rotation_matrix().matrix())
}
