//! Half-vectorisation of symmetric matrices.
//!
//! `vech` stacks the lower triangle by columns, as in section 3 of *3D Pose from Detections* (PfD):
//! a 3x3 matrix becomes (11, 21, 31, 22, 32, 33), a 4x4 matrix (11, 21, 31, 41, 22, 32, 42, 33, 43, 44).

use nalgebra::{Matrix3, Matrix4, SVector};

/// Row and column of each entry of `vech` of a symmetric 3x3 matrix.
pub(crate) const VECH3: [(usize, usize); 6] = [(0, 0), (1, 0), (2, 0), (1, 1), (2, 1), (2, 2)];

/// Row and column of each entry of `vech` of a symmetric 4x4 matrix.
pub(crate) const VECH4: [(usize, usize); 10] =
    [(0, 0), (1, 0), (2, 0), (3, 0), (1, 1), (2, 1), (3, 1), (2, 2), (3, 2), (3, 3)];

/// The lower triangle of a symmetric 3x3 matrix, by columns.
pub fn vech3(m: &Matrix3<f64>) -> SVector<f64, 6> {
    SVector::from_fn(|k, _| m[VECH3[k]])
}

/// The symmetric 4x4 matrix with this lower triangle, by columns.
pub(super) fn unvech4(v: &SVector<f64, 10>) -> Matrix4<f64> {
    let mut m = Matrix4::zeros();
    for (k, &(i, j)) in VECH4.iter().enumerate() {
        m[(i, j)] = v[k];
        m[(j, i)] = v[k];
    }
    m
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn vech_and_unvech_are_inverse() {
        let v = SVector::<f64, 10>::from_fn(|k, _| k as f64);
        let unvech = unvech4(&v);
        assert_eq!(SVector::<f64, 10>::from_fn(|k, _| unvech[VECH4[k]]), v);
        assert_eq!(unvech, unvech.transpose());
        let m = Matrix3::new(0.0, 1.0, 2.0, 1.0, 3.0, 4.0, 2.0, 4.0, 5.0);
        assert_eq!(vech3(&m), SVector::<f64, 6>::from_fn(|k, _| k as f64));
    }
}
