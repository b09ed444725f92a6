//! The system `M w = 0` of *3D Pose from Detections* (PfD section 3), solved exactly in O(F) (docs/method.md, section 4.2).
//!
//! With `w = (v, beta_1 .. beta_F)`, view f contributes the six equations `G_f v - beta_f c_f = 0`. A Householder
//! reflection that maps `c_f` onto the first axis leaves one equation with beta_f, `n_f.v - d_f beta_f = 0`
//! (`d_f = |c_f|`), and five without, which go into a streaming QR with factor `R`. Hence
//!
//! `|M w|^2 = |R v|^2 + sum_f (n_f.v - d_f beta_f)^2`,
//!
//! an arrowhead. For `|v| = 1` the betas make every term of the sum vanish and v is the last singular vector of R.
//! For `|w| = 1` they are `beta_f = d_f n_f.v / (d_f^2 - theta)` with `theta` the squared smallest singular value of
//! M: the only root in `[0, min d_f^2)` of the 10x10 nonlinear eigenproblem
//!
//! `R^T R v = theta W(theta) v`,  `W = I + sum_f n_f n_f^T / (d_f^2 - theta)`.

use nalgebra::{Matrix3x4, SMatrix};

use super::singular::{EXACT, ROUGH, second_smallest_singular, smallest_singular};
use crate::geometry::linalg::cholesky;
use crate::geometry::{VECH3, VECH4};
use crate::solve::streaming_qr::{Row, StreamingQr};

/// Views whose equations go into the QR factorization at once.
const BLOCK: usize = 8;

/// Maximum number of Newton steps on theta; 2 to 8 are typical.
const MAX_ITERATIONS: usize = 60;

/// The level of rounding errors in [`Arrowhead::is_degenerate`] for systems in pixels.
///
/// Measured second singular values: at most 4e-16 for degenerate views; 1e-4 to 5e-3 for ordinary ones, 9e-8 for an
/// arc of 30 arc seconds and for a world whose origin is 5000 camera distances away.
pub(crate) const PIXEL_ROUNDING: f64 = 1e-13;

/// The same where images are centered on the object and scaled to it: there the rounding errors of the cameras' last
/// digits show.
///
/// Measured: at most 2e-13 for degenerate views near the world's origin and 7e-12 where that is 500 camera distances
/// away; 0.1 to 0.4 for ordinary views, 3e-7 for exact ones on an arc of 30 arc seconds.
pub(crate) const CONDITIONED_ROUNDING: f64 = 1e-9;

/// The system after the elimination of the betas.
#[derive(Debug, Clone)]
pub(crate) struct Arrowhead {
    qr: StreamingQr,
    /// `n_f` of every view.
    couplings: Vec<Row>,
    /// `d_f` of every view.
    norms: Vec<f64>,
}

/// A minimizer of `|M w|`.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Minimizer {
    /// `vech Q*`.
    pub(crate) v: Row,
    /// One scale for each view.
    pub(crate) betas: Vec<f64>,
    /// The smallest singular value of M (`|w| = 1`) or of R (`|v| = 1`).
    pub(crate) residual: f64,
    /// Newton steps on theta.
    pub(crate) iterations: usize,
}

impl Arrowhead {
    /// Eliminates the betas from the equations of all views, each given by its projection and `vech C*`.
    pub(crate) fn new(views: impl Iterator<Item = (Matrix3x4<f64>, [f64; 6])>) -> Self {
        let mut system =
            Self { qr: StreamingQr::new(), couplings: Vec::with_capacity(views.size_hint().0), norms: Vec::new() };
        let mut rows = [[0.0; 10]; 5 * BLOCK];
        let mut filled = 0;
        for (projection, conic) in views {
            let mut equations = projection_rows(&projection);
            system.norms.push(eliminate_beta(&conic, &mut equations));
            system.couplings.push(equations[0]);
            rows[filled..filled + 5].copy_from_slice(&equations[1..]);
            filled += 5;
            if filled == rows.len() {
                system.qr.push_rows(&mut rows);
                filled = 0;
            }
        }
        system.qr.push_rows(&mut rows[..filled]);
        system
    }

    /// The triangular factor of the equations without betas.
    pub(crate) fn r(&self) -> &[Row; 10] {
        self.qr.r()
    }

    /// Whether the views leave the quadric open, to within rounding errors.
    ///
    /// Either two different quadrics satisfy the equations without betas: their second smallest singular value
    /// vanishes (all cameras at one point). Or the best quadric projects to nothing, all betas vanish: the pair of
    /// the two camera centers, where there are only two.
    ///
    /// Both are compared with `rounding` after the columns were scaled to unit length, which takes out the unit of
    /// the world. See [`PIXEL_ROUNDING`] and [`CONDITIONED_ROUNDING`].
    pub(crate) fn is_degenerate(&self, rounding: f64) -> bool {
        let mut r = *self.r();
        let norm: Row = std::array::from_fn(|j| (0..=j).map(|i| r[i][j] * r[i][j]).sum::<f64>().sqrt());
        for row in &mut r {
            for j in 0..10 {
                row[j] /= norm[j];
            }
        }
        let Some(smallest) = smallest_singular(&r, None, ROUGH) else { return true };
        if second_smallest_singular(&r, &smallest).is_none_or(|second| second < rounding) {
            return true;
        }
        let v: Row = std::array::from_fn(|j| smallest.vector[j] / norm[j]);
        let size = |n: &Row| n.iter().zip(&v).map(|(x, y)| (x * y).abs()).sum::<f64>();
        self.couplings.iter().all(|n| dot(n, &v).abs() < rounding * size(n))
    }

    /// The minimizer with `|w| = 1`; `None` when it has no quadric (v = 0) or a number is not finite.
    pub(crate) fn minimize_unit_w(&self) -> Option<Minimizer> {
        // A view with n_f = 0 has no part in the eigenproblem: its beta is 0, or all of w. The latter would leave v =
        // 0, which is rejected at the end.
        let squared = |f: usize| self.norms[f] * self.norms[f];
        let coupled = |f: &usize| self.couplings[*f].iter().any(|&x| x != 0.0);
        let views = 0..self.norms.len();
        let (mut low, mut high) = (0.0, views.clone().filter(coupled).map(squared).fold(f64::MAX, f64::min));
        let mut theta = 0.0;
        let mut iterations = 0;
        let mut guess = None;
        let mut v = loop {
            iterations += 1;
            // In the metric W = L L^T the eigenproblem is a singular value problem of B = R L^-T.
            let lower = cholesky(&self.metric(theta))?;
            let smallest = smallest_singular(&right_divide(self.r(), &lower), guess.as_ref(), EXACT)?;
            guess = Some(smallest.vector);
            let v = left_divide_transposed(&lower, &smallest.vector);
            let mu = smallest.value * smallest.value;
            if mu >= theta {
                low = f64::max(low, theta)
            } else {
                high = f64::min(high, theta)
            }
            let mut next = theta + (mu - theta) / (1.0 + mu * self.metric_slope(theta, &v));
            if !(low..=high).contains(&next) {
                next = 0.5 * (low + high);
            }
            let step = (next - theta).abs();
            if step <= 8.0 * f64::EPSILON * theta || iterations == MAX_ITERATIONS {
                break v;
            }
            theta = next;
        };
        if views.clone().any(|f| !coupled(&f) && squared(f) <= theta) {
            return None;
        }
        let mut betas = self.betas(&v, theta);
        let norm = v.iter().chain(&betas).map(|x| x * x).sum::<f64>().sqrt();
        if !norm.is_finite() || norm == 0.0 {
            return None;
        }
        v.iter_mut().chain(&mut betas).for_each(|x| *x /= norm);
        Some(Minimizer { v, betas, residual: theta.sqrt(), iterations })
    }

    /// The betas that fit a given v best: `n_f.v / d_f`.
    pub(crate) fn best_betas(&self, v: &Row) -> Vec<f64> {
        self.betas(v, 0.0)
    }

    /// `beta_f = d_f n_f.v / (d_f^2 - theta)`.
    fn betas(&self, v: &Row, theta: f64) -> Vec<f64> {
        let beta = |(n, d): (&Row, &f64)| {
            let along = dot(n, v);
            if along == 0.0 { 0.0 } else { d * along / (d * d - theta) }
        };
        self.couplings.iter().zip(&self.norms).map(beta).collect()
    }

    /// `W(theta)`.
    fn metric(&self, theta: f64) -> SMatrix<f64, 10, 10> {
        let mut w = [[0.0; 10]; 10];
        // A few views at a time, so that they stay in the cache while the rows of W stay in registers.
        for (n, d) in self.couplings.chunks(32).zip(self.norms.chunks(32)) {
            let mut weight = [0.0; 32];
            for (weight, d) in weight.iter_mut().zip(d) {
                *weight = 1.0 / (d * d - theta);
            }
            for i in 0..10 {
                match i {
                    0..=3 => add_products::<0>(i, n, &weight, &mut w[i]),
                    4..=7 => add_products::<4>(i, n, &weight, &mut w[i]),
                    _ => add_products::<8>(i, n, &weight, &mut w[i]),
                }
            }
        }
        SMatrix::from_fn(|i, j| w[i.min(j)][i.max(j)] + if i == j { 1.0 } else { 0.0 })
    }

    /// `v^T W'(theta) v`.
    fn metric_slope(&self, theta: f64, v: &Row) -> f64 {
        let term = |(n, d): (&Row, &f64)| {
            let x = dot(n, v) / (d * d - theta);
            x * x
        };
        self.couplings.iter().zip(&self.norms).map(term).sum()
    }
}

/// Adds row `i` of `sum_f weight_f n_f n_f^T`, from column `FIRST` on.
#[inline(always)]
fn add_products<const FIRST: usize>(i: usize, n: &[Row], weight: &[f64; 32], row: &mut Row) {
    for (n, weight) in n.iter().zip(weight) {
        let x = n[i] * weight;
        for j in FIRST..10 {
            row[j] += x * n[j];
        }
    }
}

/// The matrix G (6x10) with `vech(P Q P^T) = G vech(Q)` for every symmetric Q (PfD section 3), by rows.
fn projection_rows(p: &Matrix3x4<f64>) -> [Row; 6] {
    let p: [[f64; 4]; 3] = std::array::from_fn(|i| std::array::from_fn(|j| p[(i, j)]));
    std::array::from_fn(|row| {
        let (a, b) = (p[VECH3[row].0], p[VECH3[row].1]);
        std::array::from_fn(|column| {
            let (k, l) = VECH4[column];
            if k == l { a[k] * b[k] } else { a[k] * b[l] + a[l] * b[k] }
        })
    })
}

/// Reflects the six equations `G v - beta c` of a view so that beta stays in the first one only, as `n.v - d beta`;
/// returns `d = |c|`.
fn eliminate_beta(c: &[f64; 6], equations: &mut [Row; 6]) -> f64 {
    let d = c.iter().map(|x| x * x).sum::<f64>().sqrt();
    let sign = 1f64.copysign(c[0]);
    let mut u = *c;
    u[0] += sign * d;
    let factor = 1.0 / (d * u[0].abs());
    let mut along = [0.0; 10];
    for (u, row) in u.iter().zip(equations.iter()) {
        for j in 0..10 {
            along[j] += u * row[j];
        }
    }
    for (u, row) in u.iter().zip(equations.iter_mut()) {
        let u = u * factor;
        for j in 0..10 {
            row[j] -= u * along[j];
        }
    }
    // The reflection maps c to -sign d e1; turn the first equation round where that is +d.
    for x in &mut equations[0] {
        *x *= -sign;
    }
    d
}

/// `R L^-T` for upper triangular R and lower triangular L: upper triangular.
fn right_divide(r: &[Row; 10], lower: &SMatrix<f64, 10, 10>) -> [Row; 10] {
    let mut b = *r;
    for i in 0..10 {
        for j in i..10 {
            let sum: f64 = (i..j).map(|k| b[i][k] * lower[(j, k)]).sum();
            b[i][j] = (b[i][j] - sum) / lower[(j, j)];
        }
    }
    b
}

/// `L^-T y`.
fn left_divide_transposed(lower: &SMatrix<f64, 10, 10>, y: &Row) -> Row {
    let mut x = *y;
    for i in (0..10).rev() {
        let sum: f64 = (i + 1..10).map(|k| lower[(k, i)] * x[k]).sum();
        x[i] = (x[i] - sum) / lower[(i, i)];
    }
    x
}

fn dot(a: &Row, b: &Row) -> f64 {
    a.iter().zip(b).map(|(x, y)| x * y).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{DualQuadric, vech3};
    use rand::{RngExt, SeedableRng};

    /// A random system of `count` views with coupling strength `coupling`, and its dense matrix [R 0; N -D].
    fn random_system(count: usize, coupling: f64, seed: u64) -> Arrowhead {
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(seed);
        let mut row = |scale: f64| -> Row { std::array::from_fn(|_| scale * rng.random_range(-1.0..1.0)) };
        let mut qr = StreamingQr::new();
        qr.push_rows(&mut (0..14).map(|_| row(1.0)).collect::<Vec<_>>());
        let couplings = (0..count).map(|_| row(coupling)).collect();
        Arrowhead { qr, couplings, norms: (0..count).map(|f| 1.5 + 0.1 * f as f64).collect() }
    }

    fn dense_minimizer(system: &Arrowhead) -> (Vec<f64>, f64) {
        let count = system.norms.len();
        let m =
            nalgebra::DMatrix::from_fn(10 + count, 10 + count, |i, j| match (i.checked_sub(10), j.checked_sub(10)) {
                (None, None) => system.r()[i][j],
                (Some(f), None) => system.couplings[f][j],
                (Some(f), Some(g)) if f == g => -system.norms[f],
                _ => 0.0,
            });
        let svd = m.svd(false, true);
        (svd.v_t.unwrap().row(9 + count).iter().copied().collect(), svd.singular_values[9 + count])
    }

    fn assert_same(system: &Arrowhead) {
        let (w, sigma) = dense_minimizer(system);
        let found = system.minimize_unit_w().unwrap();
        assert!((found.residual - sigma).abs() < 1e-13, "{} {sigma}", found.residual);
        // Ten or so are bisections, where the root lies within a thousandth of the pole d_f^2.
        assert!(found.iterations <= 20, "{}", found.iterations);
        let along: f64 = found.v.iter().chain(&found.betas).zip(&w).map(|(a, b)| a * b).sum();
        for (a, b) in found.v.iter().chain(&found.betas).zip(&w) {
            assert!((a * along.signum() - b).abs() < 1e-11);
        }
    }

    #[test]
    fn the_root_is_the_smallest_singular_value_whatever_the_coupling() {
        for (seed, coupling) in [0.01, 0.3, 1.0, 10.0].into_iter().enumerate() {
            for norm in [0.02, 0.3, 1.5] {
                let mut system = random_system(9, coupling, seed as u64);
                system.norms[4] = norm;
                assert_same(&system);
            }
        }
    }

    #[test]
    fn a_view_without_coupling_is_left_out() {
        let mut system = random_system(9, 0.3, 8);
        let sigma = dense_minimizer(&system).1;
        // Its own singular value above the others': its beta is zero. Below: it is the whole minimizer.
        system.couplings[2] = [0.0; 10];
        system.norms[2] = 1.2 * sigma;
        assert_same(&system);
        assert_eq!(system.minimize_unit_w().unwrap().betas[2], 0.0);
        system.norms[2] = 0.5 * sigma;
        assert_eq!(system.minimize_unit_w(), None);
    }

    #[test]
    fn the_elimination_keeps_the_cost() {
        // |M w|^2 from its definition and from the arrowhead, for any w.
        let p = Matrix3x4::from_fn(|i, j| ((3 * i + 5 * j) % 7) as f64 - 2.5);
        for conic in [[-3.0, 1.0, -0.5, -2.0, 0.7, -1.0], [0.0, 1.0, -0.5, -2.0, 0.7, -1.0]] {
            let system = Arrowhead::new(std::iter::once((p, conic)));
            let v: Row = std::array::from_fn(|k| 0.3 * k as f64 - 1.0);
            let beta = 0.8;
            let expected: f64 =
                projection_rows(&p).iter().zip(conic).map(|(g, c)| (dot(g, &v) - beta * c).powi(2)).sum();
            let free: f64 = system.r().iter().map(|row| dot(row, &v).powi(2)).sum();
            let coupled = (dot(&system.couplings[0], &v) - system.norms[0] * beta).powi(2);
            assert!((free + coupled - expected).abs() < 1e-10 * expected);
        }
    }

    #[test]
    fn g_maps_vech_of_the_quadric_to_vech_of_its_projection() {
        let p = Matrix3x4::from_fn(|i, j| 0.3 * i as f64 - 0.7 * j as f64 + (i * j) as f64 + 0.1);
        let v: Row = std::array::from_fn(|k| (k as f64 - 4.0) * 0.37);
        let direct = vech3(&(p * DualQuadric::from_vech(&v.into()).matrix() * p.transpose()));
        for (row, expected) in projection_rows(&p).iter().zip(&direct) {
            assert!((dot(row, &v) - expected).abs() < 1e-12);
        }
    }
}
