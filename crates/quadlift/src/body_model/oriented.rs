//! The parametrization of cuboids, cylinders and superellipsoids (docs/method.md, section 3).

use nalgebra::{Matrix3, Rotation3, SVector, Vector3};

use super::{BodyModel, MAX_ASPECT, MeasuredShape, ShapeDifference, by_length, size_differences};
use crate::geometry::{BodyKind, skew};
use crate::optimize::normal_equations::{NormalEquations, Row};

/// A cuboid, cylinder or superellipsoid: rotation, log semi-axes, and the kind with its support function. The shape matrix
/// does not determine the rotation when axes are equal (a cube).
#[derive(Debug, Clone)]
pub(crate) struct OrientedModel {
    center: Vector3<f64>,
    axes: Matrix3<f64>,
    semi_axes: Vector3<f64>,
    kind: BodyKind,
}

impl OrientedModel {
    pub(crate) fn new(center: Vector3<f64>, axes: Matrix3<f64>, semi_axes: Vector3<f64>, kind: BodyKind) -> Self {
        Self { center, axes, semi_axes, kind }
    }

    /// Kind of the body.
    pub(crate) fn kind(&self) -> BodyKind {
        self.kind
    }

    /// The magnitudes of the components of a vector, rounded where the support function has kinks, and their derivatives.
    #[inline]
    fn magnitudes(&self, u: &Vector3<f64>) -> (Vector3<f64>, Vector3<f64>) {
        let (width, kinks) = (ROUNDED * u.norm(), self.kind.kinks());
        let [x, y, z] = [0, 1, 2].map(|i| if kinks[i] { rounded(u[i], width) } else { (u[i].abs(), u[i].signum()) });
        (Vector3::new(x.0, y.0, z.0), Vector3::new(x.1, y.1, z.1))
    }
}

/// Components of a vector smaller than this share of its length have a rounded magnitude: the support function of a body with edges has
/// kinks there, at which descents end anywhere. It changes the support by at most half of it, in units of a semi-axis.
const ROUNDED: f64 = 0.004;

/// `|u|` with a parabola for its kink below `width`, and its derivative.
fn rounded(u: f64, width: f64) -> (f64, f64) {
    if u.abs() >= width { (u.abs(), u.signum()) } else { (0.5 * (u * u / width + width), u / width) }
}

/// Precision of the rotation of a cylinder about its own axis before anything is known: angles over half a circle have the
/// variance `pi^2 / 12`. A round base tells nothing more.
const SPIN_PRECISION: f64 = 1.2;

/// The axis of a body nearest to each axis of a box, and its sign: of all 24 ways to name the axes of a body that keep its
/// handedness, or of the four that only turn it by half a circle. `cosines` are those between the axes of the box (rows) and
/// those of the body.
fn nearest_axes(cosines: &Matrix3<f64>, named: bool) -> ([usize; 3], [f64; 3]) {
    const ORDERS: [([usize; 3], f64); 6] =
        [([0, 1, 2], 1.0), ([1, 2, 0], 1.0), ([2, 0, 1], 1.0), ([0, 2, 1], -1.0), ([2, 1, 0], -1.0), ([1, 0, 2], -1.0)];
    let mut best = (f64::NEG_INFINITY, [0, 1, 2], [1.0; 3]);
    for (order, handedness) in ORDERS.into_iter().take(if named { 1 } else { 6 }) {
        for (a, b) in [(1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0)] {
            let signs = [a, b, a * b * handedness];
            let agreement = (0..3).map(|k| signs[k] * cosines[(k, order[k])]).sum();
            if agreement > best.0 {
                best = (agreement, order, signs);
            }
        }
    }
    (best.1, best.2)
}

impl BodyModel for OrientedModel {
    fn center(&self) -> &Vector3<f64> {
        &self.center
    }

    fn semi_axes(&self) -> Vector3<f64> {
        self.semi_axes
    }

    fn axes(&self) -> &Matrix3<f64> {
        &self.axes
    }

    #[inline]
    fn support_gradient(&self, n: &Vector3<f64>) -> (f64, [f64; 6]) {
        let u = self.axes.tr_mul(n);
        // reach_i = a_i |u_i|, rounded; g_i = dh/du_i = share_i a_i slope_i; dh/dlog a_i = share_i reach_i; dh/dw = g x u for
        // R <- R exp[w]x.
        let (magnitudes, slopes) = self.magnitudes(&u);
        let reach = self.semi_axes.component_mul(&magnitudes);
        let (h, share) = self.kind.support_gradient(&reach);
        let w = share.component_mul(&self.semi_axes).component_mul(&slopes).cross(&u);
        let by_size = share.component_mul(&reach);
        (h, [w.x, w.y, w.z, by_size.x, by_size.y, by_size.z])
    }

    fn root_transposed(&self) -> Option<&Matrix3<f64>> {
        None
    }

    fn retract(&self, step: &SVector<f64, 9>) -> Option<Self> {
        let turn = Rotation3::new(Vector3::new(step[3], step[4], step[5]));
        let axes = self.axes * turn.matrix();
        let semi_axes = Vector3::from_fn(|i, _| self.semi_axes[i] * step[6 + i].exp());
        let sensible = semi_axes.min() > 0.0 && semi_axes.max() < semi_axes.min() * MAX_ASPECT;
        sensible.then(|| Self { center: self.center + step.fixed_rows::<3>(0), axes, semi_axes, kind: self.kind })
    }

    fn add_shape_prior(&self, weight: f64, equations: &mut NormalEquations) {
        let log = self.semi_axes.map(f64::ln);
        let mean = log.sum() / 3.0;
        for i in 0..3 {
            let mut row = [0.0; 9];
            for k in 0..3 {
                row[6 + k] = weight * (f64::from(i == k) - 1.0 / 3.0);
            }
            equations.add_quadratic(weight * (log[i] - mean), &row);
        }
        self.add_spin_prior(equations);
    }

    fn log_shape_along(&self, _: &Matrix3<f64>) -> Option<[(f64, Row); 6]> {
        None
    }

    fn add_spin_prior(&self, equations: &mut NormalEquations) {
        if self.kind.has_axis() {
            let mut row = [0.0; 9];
            row[5] = 1.0;
            equations.add_row(0.0, &row, SPIN_PRECISION);
        }
    }

    fn log_axes_gradient(&self) -> [Row; 3] {
        std::array::from_fn(|i| {
            let mut row = [0.0; 9];
            row[6 + i] = 1.0;
            row
        })
    }

    fn near_side(&self, ray: &Vector3<f64>) -> (f64, [f64; 6]) {
        // 1 / n with a norm n of x_i = |v_i| / a_i; g_i = dn/dx_i.
        let v = self.axes.tr_mul(ray);
        let (magnitudes, slopes) = self.magnitudes(&v);
        let x = magnitudes.component_div(&self.semi_axes);
        let (n, g) = self.kind.inverse_depth(&x);
        let near = 1.0 / n;
        // d near = -near^2 dn; dx_i/dlog a_i = -x_i; dv = v x w.
        let by_size = g.component_mul(&x) * (near * near);
        let slope = Vector3::from_fn(|i, _| -near * near * g[i] / self.semi_axes[i] * slopes[i]);
        let by_turn = slope.cross(&v);
        (near, [by_turn.x, by_turn.y, by_turn.z, by_size.x, by_size.y, by_size.z])
    }

    fn compare(&self, measured: &MeasuredShape) -> ShapeDifference {
        let Some(axes) = &measured.axes else {
            let size = |log: Vector3<f64>| {
                let named = if measured.named { [0, 1, 2] } else { by_length(&self.semi_axes, &log) };
                size_differences(self, &log, named)
            };
            return ShapeDifference { size: measured.log_half_extents.map(size), rotation: None };
        };
        let cosines = axes.tr_mul(&self.axes);
        let (order, signs) = nearest_axes(&cosines, measured.named);
        // The sine of the rotation from the body to the box times its axis: 1/2 sum b_k x m_k, along the axes of the box.
        let body = Matrix3::from_fn(|i, k| self.axes[(i, order[k])] * signs[k]);
        let sine = (0..3).fold(Vector3::zeros(), |sum: Vector3<f64>, k| {
            sum + body.column(k).into_owned().cross(&axes.column(k).into_owned()) * 0.5
        });
        let products = body * axes.transpose();
        let turned = (products - Matrix3::identity() * products.trace()) * 0.5 * self.axes;
        let (sine, turned) = (axes.tr_mul(&sine), axes.tr_mul(&turned));
        let rotation = std::array::from_fn(|i| {
            let mut row = [0.0; 9];
            (0..3).for_each(|k| row[3 + k] = turned[(i, k)]);
            (sine[i], row)
        });
        let size = measured.log_half_extents.map(|log| size_differences(self, &log, order));
        ShapeDifference { size, rotation: Some(rotation) }
    }

    fn add_upright_prior(&self, up: &Vector3<f64>, weight: f64, equations: &mut NormalEquations) {
        // The components of `up` along the two axes that are not the vertical one; d(R^T up) = (R^T up) x w.
        let local = self.axes.transpose() * up;
        let vertical = local.iamax();
        let turn = skew(&local);
        for i in (0..3).filter(|&i| i != vertical) {
            let mut row = [0.0; 9];
            for k in 0..3 {
                row[3 + k] = weight * turn[(i, k)];
            }
            equations.add_quadratic(weight * local[i], &row);
        }
    }
}
