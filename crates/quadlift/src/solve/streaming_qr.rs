//! QR factorization of a tall matrix with ten columns (one for each entry of `vech Q*`) whose rows arrive a few at a
//! time.
//!
//! Only the triangular factor is kept, so that any number of views needs constant memory. The matrix is never
//! multiplied with its transpose: that would square its condition number. Householder reflections, with the ten
//! columns in the innermost loops (they vectorise).

/// A row of the matrix.
pub(crate) type Row = [f64; 10];

/// The triangular factor of the rows seen so far: `R^T R = M^T M`, `R` upper triangular.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct StreamingQr {
    r: [Row; 10],
}

impl StreamingQr {
    /// The factor of no rows: zero.
    pub(crate) fn new() -> Self {
        Self { r: [[0.0; 10]; 10] }
    }

    /// Adds rows. They serve as working space; what they hold afterwards means nothing.
    ///
    /// Many rows at once (20 to 40) are several times faster than single ones: setting up the ten reflections costs
    /// as much as applying them to about ten rows.
    pub(crate) fn push_rows(&mut self, rows: &mut [Row]) {
        for k in 0..10 {
            // Columns left of k are finished; working on them is harmless, and fixed widths let the compiler unroll.
            match k {
                0..=3 => reflect::<0>(k, &mut self.r[k], rows),
                4..=7 => reflect::<4>(k, &mut self.r[k], rows),
                _ => reflect::<8>(k, &mut self.r[k], rows),
            }
        }
    }

    /// The upper triangular factor, by rows.
    pub(crate) fn r(&self) -> &[Row; 10] {
        &self.r
    }
}

/// One Householder reflection, which maps column `k` of `[top; rows]` onto `top`; columns `FIRST..` are updated.
#[inline(always)]
fn reflect<const FIRST: usize>(k: usize, top: &mut Row, rows: &mut [Row]) {
    // Inner products of column k with all columns.
    let mut dot = [0.0; 10];
    for row in rows.iter() {
        let x = row[k];
        for j in FIRST..10 {
            dot[j] += x * row[j];
        }
    }
    let below = dot[k];
    if below == 0.0 {
        return;
    }
    let diagonal = top[k];
    let norm = (diagonal * diagonal + below).sqrt();
    // The reflection is I - u u^T / (norm |head|) with u = (head, column k of the rows).
    let head = diagonal + norm.copysign(diagonal);
    let factor = 1.0 / (norm * head.abs());
    for j in FIRST..10 {
        dot[j] = (dot[j] + head * top[j]) * factor;
    }
    for row in rows.iter_mut() {
        let x = row[k];
        for j in FIRST..10 {
            row[j] -= x * dot[j];
        }
    }
    for j in k + 1..10 {
        top[j] -= head * dot[j];
    }
    top[k] = -norm.copysign(diagonal);
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::SMatrix;
    use rand::{RngExt, SeedableRng};

    fn random_rows(count: usize, seed: u64) -> Vec<Row> {
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(seed);
        (0..count).map(|_| std::array::from_fn(|_| rng.random_range(-1.0..1.0))).collect()
    }

    fn gram(rows: &[Row]) -> SMatrix<f64, 10, 10> {
        SMatrix::from_fn(|i, j| rows.iter().map(|row| row[i] * row[j]).sum())
    }

    #[test]
    fn r_has_the_inner_products_of_the_rows_whatever_the_blocks() {
        let rows = random_rows(43, 1);
        for block in [1, 5, 20, 43] {
            let mut qr = StreamingQr::new();
            for chunk in rows.chunks(block) {
                qr.push_rows(&mut chunk.to_vec());
            }
            assert!((gram(qr.r()) - gram(&rows)).amax() < 1e-13, "blocks of {block}");
            for i in 0..10 {
                assert!(qr.r()[i][..i].iter().all(|&x| x == 0.0));
            }
        }
    }

    #[test]
    fn fewer_rows_than_columns_and_empty_columns_are_fine() {
        let mut rows = random_rows(4, 2);
        rows.iter_mut().for_each(|row| row[3] = 0.0);
        let expected = gram(&rows);
        let mut qr = StreamingQr::new();
        qr.push_rows(&mut rows);
        qr.push_rows(&mut []);
        assert!((gram(qr.r()) - expected).amax() < 1e-14);
    }
}
