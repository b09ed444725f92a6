//! Small dense helpers that never hang or return NaN silently.
//!
//! nalgebra's decompositions may loop for ever on NaN; everything here checks finiteness first and caps iterations.

use nalgebra::{Matrix3, SMatrix, SVector, SymmetricEigen, Vector3};

use crate::sorting::StableSort;

/// Iterations after which an eigenvalue decomposition is given up.
const MAX_ITERATIONS: usize = 200;

/// Eigenvalues (descending) and eigenvectors (columns, right-handed) of a symmetric 3x3 matrix.
///
/// `None` when the matrix holds a non-finite number or the iteration does not converge.
pub(crate) fn symmetric_eigen3(m: &Matrix3<f64>) -> Option<(Vector3<f64>, Matrix3<f64>)> {
    let scale = m.amax();
    if !scale.is_finite() || !m.iter().all(|x| x.is_finite()) {
        return None;
    }
    if scale == 0.0 {
        return Some((Vector3::zeros(), Matrix3::identity()));
    }
    let eigen = SymmetricEigen::try_new(m / scale, f64::EPSILON, MAX_ITERATIONS)?;
    let mut order = [0, 1, 2];
    order.stable_sort_by(|&a, &b| eigen.eigenvalues[b].total_cmp(&eigen.eigenvalues[a]));
    let values = Vector3::from_fn(|i, _| eigen.eigenvalues[order[i]] * scale);
    let mut vectors = Matrix3::from_fn(|i, j| eigen.eigenvectors[(i, order[j])]);
    if vectors.determinant() < 0.0 {
        vectors.column_mut(2).neg_mut();
    }
    Some((values, vectors))
}

/// Semi-axes and their directions (columns, orthonormal, in no particular order or handedness) of the ellipsoid
/// `{ m x : |x| <= 1 }`: the singular values and left singular vectors of `m`.
///
/// One-sided Jacobi rotations keep the relative precision of small semi-axes, which forming `m m^T` would lose.
/// `None` when a number is not finite or a semi-axis is zero.
pub(crate) fn axes_of_image_of_ball(m: &Matrix3<f64>) -> Option<(Vector3<f64>, Matrix3<f64>)> {
    let mut columns = *m;
    for _ in 0..MAX_ITERATIONS {
        let mut rotated = false;
        for (p, q) in [(0, 1), (0, 2), (1, 2)] {
            let (u, v) = (columns.column(p).into_owned(), columns.column(q).into_owned());
            let (uu, vv, uv) = (u.norm_squared(), v.norm_squared(), u.dot(&v));
            if uv.abs() <= 1e-15 * (uu * vv).sqrt() {
                continue;
            }
            rotated = true;
            let zeta = (vv - uu) / (2.0 * uv);
            let tan = zeta.signum() / (zeta.abs() + zeta.hypot(1.0));
            let cos = 1.0 / tan.hypot(1.0);
            let sin = cos * tan;
            columns.set_column(p, &(u * cos - v * sin));
            columns.set_column(q, &(u * sin + v * cos));
        }
        if !rotated {
            break;
        }
    }
    let lengths = Vector3::from_fn(|i, _| columns.column(i).norm());
    if !lengths.iter().all(|l| l.is_finite() && *l > 0.0) {
        return None;
    }
    Some((lengths, Matrix3::from_fn(|i, j| columns[(i, j)] / lengths[j])))
}

/// A pivot of a matrix whose diagonal is one is a rounding error below that: its inverse would be noise.
const MIN_PIVOT: f64 = 1e-13;

/// Inverse of a symmetric positive definite matrix, after scaling its diagonal to one.
///
/// `None` when the matrix is not positive definite to working precision.
pub(crate) fn invert_spd<const N: usize>(m: &SMatrix<f64, N, N>) -> Option<SMatrix<f64, N, N>> {
    let scale = SVector::<f64, N>::from_fn(|i, _| 1.0 / m[(i, i)].sqrt());
    if !scale.iter().all(|s| s.is_finite()) {
        return None;
    }
    let scaled = SMatrix::<f64, N, N>::from_fn(|i, j| m[(i, j)] * scale[i] * scale[j]);
    let lower = cholesky(&scaled).filter(|lower| lower.diagonal().iter().all(|root| root * root > MIN_PIVOT))?;
    // Invert the triangle, then multiply it with its transpose.
    let mut inverse = SMatrix::<f64, N, N>::zeros();
    for j in 0..N {
        inverse[(j, j)] = 1.0 / lower[(j, j)];
        for i in j + 1..N {
            let mut sum = 0.0;
            for k in j..i {
                sum -= lower[(i, k)] * inverse[(k, j)];
            }
            inverse[(i, j)] = sum / lower[(i, i)];
        }
    }
    let product = inverse.transpose() * inverse;
    Some(SMatrix::from_fn(|i, j| product[(i, j)] * scale[i] * scale[j]))
}

/// Lower Cholesky factor; `None` when a pivot is not positive.
pub(crate) fn cholesky<const N: usize>(m: &SMatrix<f64, N, N>) -> Option<SMatrix<f64, N, N>> {
    let mut lower = SMatrix::<f64, N, N>::zeros();
    for j in 0..N {
        for i in j..N {
            let mut sum = m[(i, j)];
            for k in 0..j {
                sum -= lower[(i, k)] * lower[(j, k)];
            }
            if i == j {
                if sum.is_nan() || sum <= 0.0 {
                    return None;
                }
                lower[(j, j)] = sum.sqrt();
            } else {
                lower[(i, j)] = sum / lower[(j, j)];
            }
        }
    }
    Some(lower)
}

/// Solves `m x = b` for a symmetric positive definite `m`; `None` when it is not positive definite.
pub(crate) fn solve_spd<const N: usize>(m: &SMatrix<f64, N, N>, b: &SVector<f64, N>) -> Option<SVector<f64, N>> {
    let lower = cholesky(m)?;
    let mut x = *b;
    for i in 0..N {
        for k in 0..i {
            x[i] -= lower[(i, k)] * x[k];
        }
        x[i] /= lower[(i, i)];
    }
    for i in (0..N).rev() {
        for k in i + 1..N {
            x[i] -= lower[(k, i)] * x[k];
        }
        x[i] /= lower[(i, i)];
    }
    x.iter().all(|v| v.is_finite()).then_some(x)
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Matrix4, Rotation3, Vector4};

    #[test]
    fn eigenvalues_come_in_descending_order_with_a_right_handed_basis() {
        let m = Matrix3::new(2.0, 0.3, -0.1, 0.3, 5.0, 0.7, -0.1, 0.7, 1.0);
        let (values, vectors) = symmetric_eigen3(&m).unwrap();
        assert!(values[0] >= values[1] && values[1] >= values[2]);
        assert!((vectors.determinant() - 1.0).abs() < 1e-12);
        let rebuilt = vectors * Matrix3::from_diagonal(&values) * vectors.transpose();
        assert!((rebuilt - m).norm() < 1e-12);
    }

    #[test]
    fn small_semi_axes_of_an_image_of_the_ball_are_precise() {
        let (u, v) = (Rotation3::from_euler_angles(0.3, -1.0, 2.0), Rotation3::from_euler_angles(1.3, 0.4, -0.7));
        // Columns of very different length: the rotation on the right mixes them, so scale a mild matrix instead.
        let mild = u.matrix() * Matrix3::from_diagonal(&Vector3::new(2.0, 1.0, 0.5)) * v.matrix();
        let (lengths, axes) = axes_of_image_of_ball(&mild).unwrap();
        let mut sorted: Vec<f64> = lengths.iter().copied().collect();
        sorted.sort_by(f64::total_cmp);
        for (length, expected) in sorted.iter().zip([0.5, 1.0, 2.0]) {
            assert!((length - expected).abs() < 1e-14);
        }
        assert!((axes.transpose() * axes - Matrix3::identity()).amax() < 1e-14);
        let shape = axes * Matrix3::from_diagonal(&lengths.component_mul(&lengths)) * axes.transpose();
        assert!((shape - mild * mild.transpose()).amax() < 1e-13);
        // Nearly orthogonal columns whose lengths differ by 1e6: the product of the lengths is the determinant.
        let graded = u.matrix() * Matrix3::from_diagonal(&Vector3::new(1e3, 1.0, 1e-3));
        let (lengths, _) = axes_of_image_of_ball(&graded).unwrap();
        assert!((lengths.min() - 1e-3).abs() < 1e-17);
        assert!(axes_of_image_of_ball(&Matrix3::zeros()).is_none());
        assert!(axes_of_image_of_ball(&Matrix3::repeat(f64::NAN)).is_none());
    }

    #[test]
    fn non_finite_input_is_refused() {
        let mut m = Matrix3::identity();
        m[(1, 1)] = f64::NAN;
        assert!(symmetric_eigen3(&m).is_none());
        assert!(cholesky(&m).is_none());
    }

    #[test]
    fn spd_solve_and_inverse_agree() {
        let a = Matrix4::from_fn(|i, j| ((i * 3 + j * 7) % 5) as f64 - 1.5);
        let m = a.transpose() * a + Matrix4::identity();
        let b = Vector4::new(1.0, -2.0, 0.5, 3.0);
        let x = solve_spd(&m, &b).unwrap();
        assert!((m * x - b).norm() < 1e-10);
        assert!((invert_spd(&m).unwrap() * b - x).norm() < 1e-10);
        assert!(solve_spd(&(-m), &b).is_none());
    }
}
