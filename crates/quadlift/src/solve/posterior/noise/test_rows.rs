//! Rows for the tests of this folder.

use nalgebra::{DMatrix, Vector3};

use super::common_errors::CommonRow;
use crate::optimize::normal_equations::PARAMETERS;
use crate::solve::estimate::Matrix9;
use crate::tuning::CORRELATION_SCALE;

/// Rows without a pattern, of edges in several views.
pub(super) fn rows(views: usize) -> Vec<CommonRow> {
    let number = |seed: f64| (seed * 12.9898).sin() * 43758.5453 % 1.0;
    let mut rows = Vec::new();
    for view in 0..views {
        for side in 0..4 {
            let seed = (4 * view + side) as f64;
            let direction = Vector3::from_fn(|k, _| number(seed + 0.31 * k as f64)).normalize();
            rows.push(CommonRow {
                view,
                class: 0,
                component: 0,
                direction,
                reach: 1.0 + 0.3 * number(seed + 5.0),
                residual: 2.0 * number(seed + 7.0),
                row: std::array::from_fn(|k| number(seed + 9.0 + 1.7 * k as f64)),
                weight: 1.0,
                slope: 1.0,
                total_weight: 1.0,
            });
        }
    }
    rows
}

/// Jacobian, correlations of the field, those of pairs of views, and covariance of a fit, as dense matrices.
pub(super) fn dense(rows: &[CommonRow]) -> (DMatrix<f64>, DMatrix<f64>, DMatrix<f64>, Matrix9) {
    let n = rows.len();
    let jacobian = DMatrix::from_fn(n, PARAMETERS, |i, k| rows[i].row[k]);
    let correlation = DMatrix::from_fn(n, n, |i, j| {
        CORRELATION_SCALE.get() / (CORRELATION_SCALE.get() + (rows[i].direction - rows[j].direction).norm())
    });
    let field = DMatrix::from_fn(n, n, |i, j| correlation[(i, j)] * rows[i].reach * rows[j].reach);
    let pairs = DMatrix::from_fn(n, n, |i, j| {
        let other = rows[i].view != rows[j].view;
        if other { correlation[(i, j)] / (rows[i].reach * rows[j].reach) } else { 0.0 }
    });
    let hessian = jacobian.transpose() * &jacobian + DMatrix::identity(PARAMETERS, PARAMETERS) * 0.1;
    let covariance = Matrix9::from_iterator(hessian.try_inverse().unwrap().iter().copied());
    (jacobian, field, pairs, covariance)
}
