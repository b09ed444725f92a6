//! A symmetric positive definite matrix of 6 x 6 blocks in envelope (skyline) storage: its factor, solutions, and those blocks of its inverse
//! that lie in the envelope.
//!
//! Frames that show the same objects are mostly near in time, so that with the frames in their order the blocks lie near the diagonal, and the
//! factor has no others.

use nalgebra::{Cholesky, Matrix6, Vector6};

/// The blocks of the lower triangle: of each row those from its first one to the diagonal.
#[derive(Debug, Clone, Default)]
pub(crate) struct Envelope {
    rows: Vec<BlockRow>,
}

#[derive(Debug, Clone)]
struct BlockRow {
    first: usize,
    blocks: Vec<Matrix6<f64>>,
}

impl BlockRow {
    fn get(&self, column: usize) -> Option<&Matrix6<f64>> {
        self.blocks.get(column.checked_sub(self.first)?)
    }
}

impl Envelope {
    /// Zeros; `first` has the first column of each row, at most the row itself.
    pub(crate) fn zeros(first: &[usize]) -> Self {
        let row = |(row, &first): (usize, &usize)| BlockRow { first, blocks: vec![Matrix6::zeros(); row + 1 - first] };
        Self { rows: first.iter().enumerate().map(row).collect() }
    }

    /// Number of block rows.
    pub(crate) fn len(&self) -> usize {
        self.rows.len()
    }

    /// Multiplications of blocks that a factor takes, about.
    pub(crate) fn work(first: &[usize]) -> f64 {
        first.iter().enumerate().map(|(row, first)| ((row - first) as f64).powi(2)).sum()
    }

    /// Adds to the block in this row and column of the lower triangle; it must lie in the envelope.
    pub(crate) fn add(&mut self, row: usize, column: usize, block: &Matrix6<f64>) {
        let row = &mut self.rows[row];
        row.blocks[column - row.first] += block;
    }

    /// Adds a matrix with the same envelope.
    pub(crate) fn add_all(&mut self, other: &Self) {
        for (row, other) in self.rows.iter_mut().zip(&other.rows) {
            row.blocks.iter_mut().zip(&other.blocks).for_each(|(block, other)| *block += other);
        }
    }

    /// The product with a vector.
    pub(crate) fn times(&self, x: &[Vector6<f64>]) -> Vec<Vector6<f64>> {
        let mut product = vec![Vector6::zeros(); x.len()];
        for (i, row) in self.rows.iter().enumerate() {
            for (block, k) in row.blocks.iter().zip(row.first..) {
                product[i] += block * x[k];
                if k < i {
                    product[k] += block.tr_mul(&x[i]);
                }
            }
        }
        product
    }

    /// The trace of the product with a symmetric matrix, whose blocks outside of this envelope do not count.
    pub(crate) fn trace_of_product(&self, other: &Self) -> f64 {
        let of_row = |(i, row): (usize, &BlockRow)| {
            let of_block = |(block, k): (&Matrix6<f64>, usize)| {
                let twice = if k < i { 2.0 } else { 1.0 };
                twice * other.block(i, k).map_or(0.0, |other| block.dot(&other))
            };
            row.blocks.iter().zip(row.first..).map(of_block).sum::<f64>()
        };
        self.rows.iter().enumerate().map(of_row).sum()
    }

    /// The block in this row and column, of either triangle; `None` outside of the envelope.
    pub(crate) fn block(&self, row: usize, column: usize) -> Option<Matrix6<f64>> {
        if row >= column {
            self.rows[row].get(column).copied()
        } else {
            self.rows[column].get(row).map(Matrix6::transpose)
        }
    }

    /// The Cholesky factor; `None` unless it is positive definite.
    pub(crate) fn factor(mut self) -> Option<Factor> {
        let mut inverse_diagonal: Vec<Matrix6<f64>> = Vec::with_capacity(self.rows.len());
        for i in 0..self.rows.len() {
            let (before, rest) = self.rows.split_at_mut(i);
            let row = &mut rest[0];
            for j in row.first..i {
                let other = &before[j];
                let start = row.first.max(other.first);
                let mut block = row.blocks[j - row.first];
                for k in start..j {
                    block -= row.blocks[k - row.first] * other.blocks[k - other.first].transpose();
                }
                row.blocks[j - row.first] = block * inverse_diagonal[j].transpose();
            }
            let mut diagonal = row.blocks[i - row.first];
            for block in &row.blocks[..i - row.first] {
                diagonal -= block * block.transpose();
            }
            let lower = Cholesky::new(diagonal)?.l();
            inverse_diagonal.push(lower.try_inverse().filter(|inverse| inverse.iter().all(|x| x.is_finite()))?);
            row.blocks[i - row.first] = lower;
        }
        Some(Factor { lower: self, inverse_diagonal })
    }
}

/// A Cholesky factor.
#[derive(Debug, Clone)]
pub(crate) struct Factor {
    lower: Envelope,
    inverse_diagonal: Vec<Matrix6<f64>>,
}

impl Factor {
    /// Logarithm of the determinant of the matrix.
    pub(crate) fn log_determinant(&self) -> f64 {
        -2.0 * self.inverse_diagonal.iter().flat_map(|block| (0..6).map(|k| block[(k, k)].ln())).sum::<f64>()
    }

    /// The solution for a right side.
    pub(crate) fn solve(&self, right: &[Vector6<f64>]) -> Vec<Vector6<f64>> {
        let mut x = right.to_vec();
        for i in 0..x.len() {
            let row = &self.lower.rows[i];
            for (block, k) in row.blocks[..i - row.first].iter().zip(row.first..) {
                let known = block * x[k];
                x[i] -= known;
            }
            x[i] = self.inverse_diagonal[i] * x[i];
        }
        for i in (0..x.len()).rev() {
            x[i] = self.inverse_diagonal[i].tr_mul(&x[i]);
            let row = &self.lower.rows[i];
            let known = x[i];
            for (block, k) in row.blocks[..i - row.first].iter().zip(row.first..) {
                x[k] -= block.tr_mul(&known);
            }
        }
        x
    }

    /// The blocks of the inverse that lie in the envelope (the recurrence of Takahashi, Fagan and Chin, 1973).
    pub(crate) fn inverse(&self) -> Envelope {
        let count = self.lower.len();
        let mut inverse = Envelope::zeros(&self.lower.rows.iter().map(|row| row.first).collect::<Vec<_>>());
        // Rows below the diagonal of each column.
        let mut below: Vec<Vec<usize>> = vec![Vec::new(); count];
        for (i, row) in self.lower.rows.iter().enumerate() {
            (row.first..i).for_each(|column| below[column].push(i));
        }
        for j in (0..count).rev() {
            let scaled: Vec<Matrix6<f64>> = below[j]
                .iter()
                .map(|&k| self.lower.rows[k].blocks[j - self.lower.rows[k].first] * self.inverse_diagonal[j])
                .collect();
            let mut diagonal = self.inverse_diagonal[j].tr_mul(&self.inverse_diagonal[j]);
            let column: Vec<Matrix6<f64>> = below[j]
                .iter()
                .map(|&i| {
                    let products =
                        below[j].iter().zip(&scaled).filter_map(|(&k, block)| Some(inverse.block(i, k)? * block));
                    -products.sum::<Matrix6<f64>>()
                })
                .collect();
            for (block, of_factor) in column.iter().zip(&scaled) {
                diagonal -= block.tr_mul(of_factor);
            }
            for (&i, block) in below[j].iter().zip(&column) {
                inverse.add(i, j, block);
            }
            inverse.add(j, j, &((diagonal + diagonal.transpose()) * 0.5));
        }
        inverse
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::{normal, stream};
    use nalgebra::{DMatrix, DVector};

    /// A positive definite matrix with this envelope, and the same full.
    fn made(first: &[usize]) -> (Envelope, DMatrix<f64>) {
        let mut rng = stream(3, 0);
        let mut envelope = Envelope::zeros(first);
        for (row, &first) in first.iter().enumerate() {
            for column in first..row {
                envelope.add(row, column, &Matrix6::from_fn(|_, _| normal(&mut rng)));
            }
            let root = Matrix6::from_fn(|_, _| normal(&mut rng));
            envelope.add(row, row, &(root * root.transpose() + Matrix6::identity() * 40.0));
        }
        let full = DMatrix::from_fn(6 * first.len(), 6 * first.len(), |i, j| {
            envelope.block(i / 6, j / 6).map_or(0.0, |block| block[(i % 6, j % 6)])
        });
        (envelope, full)
    }

    const FIRST: [usize; 7] = [0, 0, 2, 1, 3, 3, 0];

    #[test]
    fn solutions_and_inverses_are_those_of_the_full_matrix() {
        let (envelope, full) = made(&FIRST);
        let factor = envelope.clone().factor().unwrap();
        let right: Vec<Vector6<f64>> =
            (0..FIRST.len()).map(|k| Vector6::from_fn(|i, _| (k * 6 + i) as f64 - 9.0)).collect();
        let stacked = DVector::from_iterator(6 * FIRST.len(), right.iter().flat_map(|block| block.iter().copied()));
        let expected = full.clone().lu().solve(&stacked).unwrap();
        for (k, block) in factor.solve(&right).iter().enumerate() {
            assert!((block - expected.rows(6 * k, 6)).norm() < 1e-10);
        }
        let (inverse, expected) = (factor.inverse(), full.clone().try_inverse().unwrap());
        for (row, &first) in FIRST.iter().enumerate() {
            for column in first..=row {
                let block = inverse.block(row, column).unwrap();
                assert!((block - expected.view((6 * row, 6 * column), (6, 6))).norm() < 1e-10, "{row} {column}");
                assert_eq!(inverse.block(column, row).unwrap(), block.transpose());
            }
        }
        assert!(inverse.block(5, 2).is_none());
        let product = &full * &stacked;
        for (k, block) in envelope.times(&right).iter().enumerate() {
            assert!((block - product.rows(6 * k, 6)).norm() < 1e-9);
        }
        // All of the inverse that the product needs lies in the envelope.
        assert!((envelope.trace_of_product(&inverse) - 6.0 * FIRST.len() as f64).abs() < 1e-9);
        let mut twice = envelope.clone();
        twice.add_all(&envelope);
        assert!((twice.trace_of_product(&inverse) - 12.0 * FIRST.len() as f64).abs() < 1e-9);
    }

    #[test]
    fn what_is_not_positive_definite_has_no_factor() {
        let (mut envelope, _) = made(&FIRST);
        envelope.add(3, 3, &(Matrix6::identity() * -1e3));
        assert!(envelope.factor().is_none());
        assert_eq!(Envelope::work(&FIRST), 0.0 + 1.0 + 0.0 + 4.0 + 1.0 + 4.0 + 36.0);
    }
}
