//! Sums of squares and their derivatives, nine parameters at a time.

use nalgebra::{SMatrix, SVector};

/// Number of parameters of a body.
pub(crate) const PARAMETERS: usize = 9;

/// A row of a Jacobian.
pub(crate) type Row = [f64; PARAMETERS];

/// `J^T J` (lower triangle) and `J^T r` of weighted residuals, and their cost.
#[derive(Debug, Clone, Copy)]
pub(crate) struct NormalEquations {
    /// Sum of squares, or what a robust loss makes of them.
    pub cost: f64,
    hessian: [[f64; PARAMETERS]; PARAMETERS],
    gradient: [f64; PARAMETERS],
}

impl NormalEquations {
    pub(crate) fn zero() -> Self {
        Self { cost: 0.0, hessian: [[0.0; PARAMETERS]; PARAMETERS], gradient: [0.0; PARAMETERS] }
    }

    /// Of a state at which the objective cannot be evaluated: infinite cost, singular equations.
    pub(crate) fn nowhere() -> Self {
        Self { cost: f64::INFINITY, ..Self::zero() }
    }

    /// Adds the derivatives of one residual; the cost is left to the caller.
    #[inline]
    pub(crate) fn add_row(&mut self, residual: f64, row: &Row, weight: f64) {
        for i in 0..PARAMETERS {
            let wi = weight * row[i];
            self.gradient[i] += wi * residual;
            for j in 0..=i {
                self.hessian[i][j] += wi * row[j];
            }
        }
    }

    /// Adds one quadratic residual, its square to the cost as well.
    #[inline]
    pub(crate) fn add_quadratic(&mut self, residual: f64, row: &Row) {
        self.cost += residual * residual;
        self.add_row(residual, row, 1.0);
    }

    /// The same with the rotation of an oriented body (parameters 3 to 5) held where it is.
    pub(crate) fn with_held_rotation(mut self) -> Self {
        for i in 3..6 {
            self.gradient[i] = 0.0;
            for j in 0..PARAMETERS {
                self.hessian[i.max(j)][i.min(j)] = f64::from(i == j);
            }
        }
        self
    }

    /// `J^T J` as a full matrix.
    pub(crate) fn hessian(&self) -> SMatrix<f64, 9, 9> {
        SMatrix::from_fn(|i, j| self.hessian[i.max(j)][i.min(j)])
    }

    /// `J^T r`.
    pub(crate) fn gradient(&self) -> SVector<f64, 9> {
        SVector::from(self.gradient)
    }
}
