//! Half-vectorisation of symmetric matrices and the matrix `G` of the projection equation.
//!
//! `vech` stacks the lower triangle by columns, as in section 3 of *3D Pose from Detections* (PfD):
//! a 3x3 matrix becomes (11, 21, 31, 22, 32, 33), a 4x4 matrix (11, 21, 31, 41, 22, 32, 42, 33, 43, 44).

use nalgebra::{Matrix3, Matrix3x4, Matrix4, SMatrix, SVector};

/// Row and column of each entry of `vech` of a symmetric 3x3 matrix.
pub const VECH3: [(usize, usize); 6] = [(0, 0), (1, 0), (2, 0), (1, 1), (2, 1), (2, 2)];

/// Row and column of each entry of `vech` of a symmetric 4x4 matrix.
pub const VECH4: [(usize, usize); 10] =
    [(0, 0), (1, 0), (2, 0), (3, 0), (1, 1), (2, 1), (3, 1), (2, 2), (3, 2), (3, 3)];

/// The lower triangle of a symmetric 3x3 matrix, by columns.
pub fn vech3(m: &Matrix3<f64>) -> SVector<f64, 6> {
    SVector::from_fn(|k, _| m[VECH3[k]])
}

/// The lower triangle of a symmetric 4x4 matrix, by columns.
pub fn vech4(m: &Matrix4<f64>) -> SVector<f64, 10> {
    SVector::from_fn(|k, _| m[VECH4[k]])
}

/// The symmetric 4x4 matrix with the given [`vech4`].
pub fn unvech4(v: &SVector<f64, 10>) -> Matrix4<f64> {
    let mut m = Matrix4::zeros();
    for (k, &(i, j)) in VECH4.iter().enumerate() {
        m[(i, j)] = v[k];
        m[(j, i)] = v[k];
    }
    m
}

/// The matrix `G` (6x10) with `vech(P Q P^T) = G vech(Q)` for every symmetric `Q` (PfD section 3).
pub fn projection_matrix_on_vech(p: &Matrix3x4<f64>) -> SMatrix<f64, 6, 10> {
    SMatrix::from_fn(|row, column| {
        let (i, j) = VECH3[row];
        let (k, l) = VECH4[column];
        let product = p[(i, k)] * p[(j, l)];
        if k == l { product } else { product + p[(i, l)] * p[(j, k)] }
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Matrix3x4, SVector};

    #[test]
    fn g_maps_vech_of_the_quadric_to_vech_of_its_projection() {
        let p = Matrix3x4::from_fn(|i, j| 0.3 * i as f64 - 0.7 * j as f64 + (i * j) as f64 + 0.1);
        let v = SVector::<f64, 10>::from_fn(|k, _| (k as f64 - 4.0) * 0.37);
        let direct = vech3(&(p * unvech4(&v) * p.transpose()));
        assert!((projection_matrix_on_vech(&p) * v - direct).norm() < 1e-12);
    }

    #[test]
    fn vech_and_unvech_are_inverse() {
        let v = SVector::<f64, 10>::from_fn(|k, _| k as f64);
        assert_eq!(vech4(&unvech4(&v)), v);
        let m = Matrix3::new(0.0, 1.0, 2.0, 1.0, 3.0, 4.0, 2.0, 4.0, 5.0);
        assert_eq!(vech3(&m), SVector::<f64, 6>::from_fn(|k, _| k as f64));
    }
}
