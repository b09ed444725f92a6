//! The fit of a cuboid or cylinder of given rotation is linear: with weights and depths of an ellipsoid's fit,
//! `min |N c + d - V a|^2 + rho |a - mean(a)|^2` over the center c and the half extents a, with V the absolute components of the normals
//! along the axes. The center is eliminated once for all rotations.

use nalgebra::{Matrix2, Matrix3, SMatrix, Vector2, Vector3};

use super::conditions::Conditions;
use super::fit::Workspace;
use super::lanes::{Lanes, dot};
use super::rows::{Pairing, Rows};
use super::solid::Solid;
use crate::geometry::linalg::{invert_spd, solve_spd};

/// Half extents are at least this share of their mean.
const MIN_RATIO: f64 = 0.05;

/// Share of a cuboid's half extents in the semi-axes of the ellipsoid that fits it.
const CUBOID_IN_ELLIPSOID: f64 = 0.75;

/// A body of the scan, and its cost.
#[derive(Debug, Clone, Copy)]
pub(super) struct Scanned<const N: usize> {
    pub cost: f64,
    pub center: Vector3<f64>,
    pub half_extents: [f64; N],
}

/// The rows of one view.
struct LinearView {
    /// Normals of the edges.
    edge_normal: [Lanes; 3],
    /// How they become residuals times the root of their weight.
    pairing: Pairing,
    /// Normals and offsets of the residuals times the root of their weight.
    normal: [Lanes; 3],
    offset: Lanes,
}

/// Weighted rows of an object, with the center eliminated.
pub(super) struct LinearRows {
    views: Vec<LinearView>,
    /// Sums of n n^T, of n d and of d^2.
    normals: Matrix3<f64>,
    by_offset: Vector3<f64>,
    offsets: f64,
    /// Inverse of `normals`.
    inverse: Matrix3<f64>,
    ridge: f64,
}

impl LinearRows {
    /// With the depths of this ellipsoid's center and the weights that were last computed at it under `conditions`.
    pub(super) fn new(rows: &Rows, ellipsoid: &Solid, conditions: &Conditions, work: &Workspace) -> Self {
        let size = CUBOID_IN_ELLIPSOID * ellipsoid.size();
        let mut linear = Self {
            views: Vec::with_capacity(rows.views.len()),
            normals: Matrix3::zeros(),
            by_offset: Vector3::zeros(),
            offsets: 0.0,
            inverse: Matrix3::zeros(),
            ridge: (conditions.shape_sd * size).powi(-2),
        };
        let center: [f64; 3] = ellipsoid.center.into();
        for (view, at) in rows.views.iter().zip(&work.views) {
            let inverse_depth = view.inverse_depth(&center);
            let sd = view.sd(conditions);
            let factor = Lanes(std::array::from_fn(|edge| {
                if view.is_reached(edge, at.residual.0[edge]) {
                    return 0.0;
                }
                inverse_depth / sd.0[edge] * (at.weight.0[edge] * conditions.view_weight).sqrt()
            }));
            let (n, d) = (view.residual_normal.map(|n| n * factor), view.residual_offset * factor);
            for i in 0..3 {
                for j in 0..=i {
                    linear.normals[(i, j)] += (n[i] * n[j]).sum();
                }
                linear.by_offset[i] += (n[i] * d).sum();
            }
            linear.offsets += (d * d).sum();
            let pairing = view.pairing.times(factor);
            linear.views.push(LinearView { edge_normal: view.normal, pairing, normal: n, offset: d });
        }
        linear.normals.fill_upper_triangle_with_lower_triangle();
        let jitter = 1e-6 * linear.normals.trace() + 1e-9;
        linear.inverse = invert_spd(&(linear.normals + Matrix3::identity() * jitter)).unwrap_or_default();
        linear
    }

    /// The cuboid with these axes.
    #[inline(always)]
    pub(super) fn cuboid(&self, axes: &Matrix3<f64>) -> Scanned<3> {
        let columns = axes.data.0;
        let mut by_normal = [[Lanes::ZERO; 3]; 3];
        let (mut squares_of, mut products) = ([Lanes::ZERO; 3], [Lanes::ZERO; 3]);
        let mut by_offset = [Lanes::ZERO; 3];
        for view in &self.views {
            let v = [0, 1, 2].map(|k| view.pairing.residuals(dot(&view.edge_normal, &columns[k]).map(f64::abs)));
            for i in 0..3 {
                for j in 0..3 {
                    by_normal[i][j] = by_normal[i][j] + v[i] * view.normal[j];
                }
                by_offset[i] = by_offset[i] + v[i] * view.offset;
                squares_of[i] = squares_of[i] + v[i] * v[i];
                products[i] = products[i] + v[(i + 1) % 3] * v[(i + 2) % 3];
            }
        }
        let mut squares = Matrix3::zeros();
        for k in 0..3 {
            squares[(k, k)] = squares_of[k].sum();
            let (i, j) = ((k + 1) % 3, (k + 2) % 3);
            squares[(i, j)] = products[k].sum();
            squares[(j, i)] = squares[(i, j)];
        }
        let centered = Matrix3::from_fn(|i, j| if i == j { 2.0 / 3.0 } else { -1.0 / 3.0 });
        let by_normal = Matrix3::from_fn(|i, j| by_normal[i][j].sum());
        let (normal, right) =
            self.eliminated(squares + centered * self.ridge, &by_normal, by_offset.map(Lanes::sum).into());
        self.scanned(&normal, &right, &by_normal, bounded3(&normal, &right))
    }

    /// The cylinder about this axis: radius, half height.
    #[inline(always)]
    pub(super) fn cylinder(&self, axis: &Vector3<f64>) -> Scanned<2> {
        let u: [f64; 3] = (*axis).into();
        let mut by_normal = [[Lanes::ZERO; 3]; 2];
        let (mut squares_of, mut product, mut by_offset) = ([Lanes::ZERO; 2], Lanes::ZERO, [Lanes::ZERO; 2]);
        for view in &self.views {
            let n = &view.edge_normal;
            let along = dot(n, &u).map(f64::abs);
            let squared = n[0] * n[0] + n[1] * n[1] + n[2] * n[2] - along * along;
            let across = squared.map(|x| x.max(0.0)).sqrt();
            let v = [across, along].map(|support| view.pairing.residuals(support));
            for k in 0..2 {
                for j in 0..3 {
                    by_normal[k][j] = by_normal[k][j] + v[k] * view.normal[j];
                }
                by_offset[k] = by_offset[k] + v[k] * view.offset;
                squares_of[k] = squares_of[k] + v[k] * v[k];
            }
            product = product + v[0] * v[1];
        }
        let ridge = self.ridge * 2.0 / 3.0;
        let product = product.sum() - ridge;
        let squares = Matrix2::new(squares_of[0].sum() + ridge, product, product, squares_of[1].sum() + ridge);
        let by_normal = SMatrix::<f64, 2, 3>::from_fn(|i, j| by_normal[i][j].sum());
        let (normal, right) = self.eliminated(squares, &by_normal, by_offset.map(Lanes::sum).into());
        self.scanned(&normal, &right, &by_normal, bounded2(&normal, &right))
    }

    /// Normal matrix and right side of the half extents: the center is `inverse (by_normal^T a - by_offset)`.
    #[inline(always)]
    fn eliminated<const N: usize>(
        &self,
        squares: SMatrix<f64, N, N>,
        by_normal: &SMatrix<f64, N, 3>,
        by_offset: SMatrix<f64, N, 1>,
    ) -> (SMatrix<f64, N, N>, SMatrix<f64, N, 1>) {
        let through = by_normal * self.inverse;
        let jitter = SMatrix::<f64, N, N>::identity() * 1e-9;
        (squares - through * by_normal.transpose() + jitter, by_offset - through * self.by_offset)
    }

    #[inline(always)]
    fn scanned<const N: usize>(
        &self,
        normal: &SMatrix<f64, N, N>,
        right: &SMatrix<f64, N, 1>,
        by_normal: &SMatrix<f64, N, 3>,
        a: SMatrix<f64, N, 1>,
    ) -> Scanned<N> {
        let rest = self.offsets - self.by_offset.dot(&(self.inverse * self.by_offset));
        let cost = rest - 2.0 * a.dot(right) + a.dot(&(normal * a));
        let center = self.inverse * (by_normal.transpose() * a - self.by_offset);
        Scanned { cost, center, half_extents: a.into() }
    }
}

/// The least squares solution with all entries of at least [`MIN_RATIO`] of the mean.
fn bounded3(normal: &Matrix3<f64>, right: &Vector3<f64>) -> Vector3<f64> {
    let Some(mut a) = solve_spd(normal, right) else { return Vector3::repeat(0.5) };
    let low = MIN_RATIO * a.map(|x| x.max(0.0)).mean() + 1e-3;
    let small = |a: &Vector3<f64>| (0..3).filter(|&k| a[k].is_nan() || a[k] < low).count();
    match small(&a) {
        0 => a,
        1 => {
            let k = (0..3).find(|&k| a[k] < low).unwrap_or(0);
            let (i, j) = ((k + 1) % 3, (k + 2) % 3);
            let block = Matrix2::new(normal[(i, i)], normal[(i, j)], normal[(i, j)], normal[(j, j)]);
            let rest = Vector2::new(right[i] - normal[(i, k)] * low, right[j] - normal[(j, k)] * low);
            let others = solve_spd(&block, &rest).unwrap_or(Vector2::repeat(low));
            (a[k], a[i], a[j]) = (low, others[0].max(low), others[1].max(low));
            a
        }
        _ => {
            let k = a.imax();
            let taken = low * (normal[(k, (k + 1) % 3)] + normal[(k, (k + 2) % 3)]);
            a = Vector3::repeat(low);
            a[k] = ((right[k] - taken) / normal[(k, k)].max(1e-12)).max(low);
            a
        }
    }
}

/// The same of radius and half height, each of at least [`MIN_RATIO`] of the other.
fn bounded2(normal: &Matrix2<f64>, right: &Vector2<f64>) -> Vector2<f64> {
    let mut a = solve_spd(normal, right).unwrap_or(Vector2::repeat(0.5));
    for (small, large) in [(1, 0), (0, 1)] {
        if a[small] < MIN_RATIO * a[large] {
            a[small] = MIN_RATIO * a[large].max(MIN_RATIO);
            a[large] = ((right[large] - normal[(0, 1)] * a[small]) / normal[(large, large)].max(1e-12)).max(MIN_RATIO);
        }
    }
    a
}
