//! The smallest singular value of an upper triangular 10x10 matrix, with its right singular vector.
//!
//! Inverse iteration with two triangular solves a step (about a tenth of the cost of a full decomposition, and more
//! accurate for graded matrices); where the two smallest singular values lie close together, one-sided Jacobi.

use crate::solve::streaming_qr::{Row, StreamingQr};

/// Steps of inverse iteration before the full decomposition is cheaper.
const MAX_STEPS: usize = 60;

/// Change of the vector in one step at which it counts as exact.
pub(crate) const EXACT: f64 = 1e-15;

/// Change of the vector in one step at which the order of magnitude of the singular value is known.
pub(crate) const ROUGH: f64 = 1e-3;

/// The smallest singular value and its right singular vector.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Smallest {
    /// The singular value.
    pub(crate) value: f64,
    /// The unit right singular vector.
    pub(crate) vector: Row,
}

/// The smallest singular value of an upper triangular matrix; `None` when it holds a number that is not finite.
///
/// `start` is a guess of the vector, for instance that of a similar matrix; `tolerance` is [`EXACT`] or [`ROUGH`].
pub(crate) fn smallest_singular(r: &[Row; 10], start: Option<&Row>, tolerance: f64) -> Option<Smallest> {
    smallest_of_leading::<10>(r, start, tolerance)
}

/// The second smallest singular value of an upper triangular matrix, given the smallest; its order of magnitude only.
pub(crate) fn second_smallest_singular(r: &[Row; 10], smallest: &Smallest) -> Option<f64> {
    // A reflection H that swaps the singular vector with the last axis; without that column, R H has the remaining
    // singular values.
    let mut u = smallest.vector;
    u[9] += 1f64.copysign(u[9]);
    let factor = 1.0 / u[9].abs();
    let mut rows = *r;
    for row in &mut rows {
        let along = dot(row, &u) * factor;
        for j in 0..10 {
            row[j] -= along * u[j];
        }
        row[9] = 0.0;
    }
    let mut qr = StreamingQr::new();
    qr.push_rows(&mut rows);
    smallest_of_leading::<9>(qr.r(), None, ROUGH).map(|s| s.value)
}

/// As [`smallest_singular`], for the leading N x N block.
fn smallest_of_leading<const N: usize>(r: &[Row; 10], start: Option<&Row>, tolerance: f64) -> Option<Smallest> {
    if !r[..N].iter().flatten().all(|x| x.is_finite()) {
        return None;
    }
    // R = D U with a unit upper triangular U; U and its transpose without their diagonals, by rows.
    let (mut upper, mut lower, mut inverse_pivot) = ([[0.0; 10]; N], [[0.0; 10]; N], [0.0; 10]);
    for i in 0..N {
        let column = (0..=i).fold(0.0, |m: f64, k| m.max(r[k][i].abs()));
        if column == 0.0 {
            return Some(Smallest { value: 0.0, vector: std::array::from_fn(|j| if i == j { 1.0 } else { 0.0 }) });
        }
        // A pivot of zero stands for one below rounding error: the solves stay finite and find the null vector.
        inverse_pivot[i] = 1.0 / if r[i][i].abs() < 1e-20 * column { 1e-20 * column } else { r[i][i] };
        for j in i + 1..N {
            upper[i][j] = r[i][j] * inverse_pivot[i];
            lower[j][i] = upper[i][j];
        }
    }
    // An irregular start, so that no structured problem is orthogonal to it.
    let mut v = start.copied().unwrap_or([0.53, -0.31, 0.47, 0.61, 0.71, -0.41, 0.37, 0.83, 0.29, -0.67]);
    v[N..].fill(0.0);
    scale_to_largest(&mut v);
    let mut previous_change = f64::INFINITY;
    for _ in 0..MAX_STEPS {
        // next = R^-1 R^-T v, where R^-T v = D^-1 U^-T v.
        let mut next = v;
        for i in 0..N {
            let x = next[i];
            for j in 0..10 {
                next[j] -= upper[i][j] * x;
            }
        }
        for j in 0..10 {
            next[j] *= inverse_pivot[j];
        }
        let growth = scale_to_largest(&mut next);
        let norm = dot(&next, &next).sqrt() * growth;
        for j in 0..10 {
            next[j] *= inverse_pivot[j];
        }
        for i in (0..N).rev() {
            let x = next[i];
            for j in 0..10 {
                next[j] -= lower[i][j] * x;
            }
        }
        scale_to_largest(&mut next);
        let change = (0..10).fold(0.0, |m: f64, i| m.max((next[i] - v[i]).abs()));
        // Converged, or at the level where rounding errors no longer let the change shrink.
        if change <= tolerance || (change < 1e-13 && change >= previous_change) {
            let value = dot(&v, &v).sqrt() / norm;
            let length = dot(&next, &next).sqrt();
            return Some(Smallest { value, vector: next.map(|x| x / length) });
        }
        v = next;
        previous_change = change;
    }
    Some(jacobi(r, N))
}

/// One-sided Jacobi on the columns of the leading block: slower, but sure whatever the gap.
fn jacobi(r: &[Row; 10], n: usize) -> Smallest {
    // Columns of R V as rows, and those of V.
    let mut a: [Row; 10] = std::array::from_fn(|j| std::array::from_fn(|i| if i < n && j < n { r[i][j] } else { 0.0 }));
    let mut v: [Row; 10] = std::array::from_fn(|j| std::array::from_fn(|i| if i == j { 1.0 } else { 0.0 }));
    for _ in 0..30 {
        let mut rotated = false;
        for p in 0..n {
            for q in p + 1..n {
                let (alpha, beta, gamma) = (dot(&a[p], &a[p]), dot(&a[q], &a[q]), dot(&a[p], &a[q]));
                if gamma.abs() <= 1e-15 * (alpha * beta).sqrt() {
                    continue;
                }
                rotated = true;
                let zeta = (beta - alpha) / (2.0 * gamma);
                let t = 1f64.copysign(zeta) / (zeta.abs() + zeta.hypot(1.0));
                let c = 1.0 / t.hypot(1.0);
                let s = c * t;
                for m in [&mut a, &mut v] {
                    for i in 0..n {
                        (m[p][i], m[q][i]) = (c * m[p][i] - s * m[q][i], s * m[p][i] + c * m[q][i]);
                    }
                }
            }
        }
        if !rotated {
            break;
        }
    }
    let norm = |column: &Row| dot(column, column).sqrt();
    let best = (1..n).fold(0, |best, j| if norm(&a[j]) < norm(&a[best]) { j } else { best });
    Smallest { value: norm(&a[best]), vector: v[best] }
}

fn dot(a: &Row, b: &Row) -> f64 {
    a.iter().zip(b).map(|(x, y)| x * y).sum()
}

/// Divides by the largest absolute value, which it returns.
fn scale_to_largest(x: &mut Row) -> f64 {
    let largest = x.iter().fold(0.0, |m: f64, v| m.max(v.abs()));
    let inverse = 1.0 / largest;
    x.iter_mut().for_each(|v| *v *= inverse);
    largest
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::DMatrix;
    use rand::{RngExt, SeedableRng};

    /// The triangular factor of `U diag(values) V^T` with random orthogonal U and V.
    fn with_singular_values(values: &Row, seed: u64) -> [Row; 10] {
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(seed);
        let mut orthogonal = || DMatrix::from_fn(10, 10, |_, _| rng.random_range(-1.0..1.0f64)).qr().q();
        let (u, v) = (orthogonal(), orthogonal());
        let m = DMatrix::from_fn(10, 10, |i, j| (0..10).map(|k| u[(i, k)] * values[k] * v[(j, k)]).sum::<f64>());
        let mut rows: [Row; 10] = std::array::from_fn(|i| std::array::from_fn(|j| m[(i, j)]));
        let mut qr = StreamingQr::new();
        qr.push_rows(&mut rows);
        *qr.r()
    }

    #[test]
    fn agrees_with_a_full_decomposition() {
        for (seed, smallest_two) in [[0.01, 0.1], [1e-9, 0.3], [0.09, 0.1], [0.0999, 0.1]].iter().enumerate() {
            let mut values = [3.0, 2.0, 1.5, 1.0, 0.9, 0.8, 0.7, 0.6, 0.0, 0.0];
            values[8..].copy_from_slice(smallest_two);
            let r = with_singular_values(&values, seed as u64);
            let dense = DMatrix::from_fn(10, 10, |i, j| r[i][j]).svd(false, true);
            let expected: Row = std::array::from_fn(|i| dense.v_t.as_ref().unwrap()[(9, i)]);
            let gap = smallest_two[0] - smallest_two[1];
            for start in [None, Some(&expected)] {
                let smallest = smallest_singular(&r, start, EXACT).unwrap();
                assert!((smallest.value - dense.singular_values[9]).abs() < 1e-14);
                let sign = dot(&smallest.vector, &expected).signum();
                let error = (0..10).map(|i| (smallest.vector[i] - sign * expected[i]).abs()).fold(0.0, f64::max);
                assert!(error < 1e-14 / gap.abs(), "{error:e}");
                let second = second_smallest_singular(&r, &smallest).unwrap();
                assert!((second / dense.singular_values[8] - 1.0).abs() < 1e-3, "{second}");
            }
        }
    }

    #[test]
    fn singular_and_broken_matrices_neither_hang_nor_overflow() {
        let mut values = [1.0; 10];
        values[9] = 0.0;
        let mut r = with_singular_values(&values, 9);
        r[9][9] = 0.0;
        let smallest = smallest_singular(&r, None, EXACT).unwrap();
        assert!(smallest.value < 1e-18);
        let product = |i: usize| dot(&r[i], &smallest.vector);
        assert!((0..10).all(|i| product(i).abs() < 1e-14));
        assert_eq!(smallest_singular(&[[0.0; 10]; 10], None, EXACT).unwrap().value, 0.0);
        r[2][5] = f64::NAN;
        assert_eq!(smallest_singular(&r, None, EXACT), None);
    }
}
