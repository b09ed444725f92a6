//! Residuals of an observed ellipse: center, size, aspect and angle (docs/method.md, section 2.3).
//!
//! The image is first mapped so that the observed ellipse has its center at the origin, mean semi-axis one and its
//! first axis along x. There the predicted ellipse (center c, shape S) gives
//! - center: `c` (2), in mean semi-axes;
//! - size: `1/2 log(l1 l2)` against the observed one;
//! - aspect: `1/2 log(l1 / l2)` against the observed one;
//! - angle: `1/2 log(l1 / l2) sin(angle)`.
//!
//! Beside a box only the last two are compared: the edges tell place and size better (the ellipse of a mask's moments
//! is smaller than what its box touches), the ellipse tells the shape. They are then compared in the smooth form below.
//!
//! The last two jump where the predicted ellipse is a circle, as a start is. On the way from a start they are replaced
//! by the vector `1/2 log(l1 / l2) (cos, sin)(2 angle)` against the observed one, which is smooth everywhere but does
//! not keep errors of the angle apart from those of the aspect.

use nalgebra::{Matrix3, Matrix3x4, Vector3};

use super::row::ResidualRow;
use crate::body_model::BodyModel;
use crate::geometry::Ellipse;
use crate::optimize::normal_equations::Row;
use crate::solve::posterior::noise::groups::NoiseGroup;
use crate::solve::posterior::noise::levels::NoiseLevels;

/// Residual of every kind where the body has no outline in the view (behind the camera): ten sizes off.
const NO_OUTLINE: f64 = 10.0;

/// An observed ellipse, prepared.
#[derive(Debug, Clone)]
pub(crate) struct EllipseMeasurement {
    /// Left block and last column of the projection from the object's frame to the normalized image.
    m: Matrix3<f64>,
    offset: Vector3<f64>,
    /// Observed `1/2 log(l1 l2)` in the normalized image, and `1/2 log(l1 / l2)`.
    log_size: f64,
    log_aspect: f64,
    /// Whether only aspect and angle are compared.
    shape_only: bool,
    /// Whether the ellipse may cover only a part of the object.
    partial: bool,
}

impl EllipseMeasurement {
    /// Prepares an ellipse seen by the local projection `p`.
    pub(crate) fn new(p: &Matrix3x4<f64>, observed: &Ellipse, shape_only: bool, partial: bool) -> Self {
        let (a, b) = (observed.semi_axes.x, observed.semi_axes.y);
        // The first axis is taken as the longer one, as the predicted angle is that of the longer axis.
        let angle = if a >= b { observed.angle } else { observed.angle + std::f64::consts::FRAC_PI_2 };
        let (sin, cos) = angle.sin_cos();
        let mean = 0.5 * (a + b);
        let (x, y) = (observed.center.x, observed.center.y);
        let normalize = Matrix3::new(
            cos / mean,
            sin / mean,
            -(cos * x + sin * y) / mean,
            -sin / mean,
            cos / mean,
            (sin * x - cos * y) / mean,
            0.0,
            0.0,
            1.0,
        );
        let mapped = normalize * p;
        Self {
            m: mapped.fixed_columns::<3>(0).into_owned(),
            offset: mapped.column(3).into_owned(),
            log_size: 0.5 * (a * b / (mean * mean)).ln(),
            log_aspect: 0.5 * (a / b).ln().abs(),
            shape_only,
            partial,
        }
    }

    /// Appends the five whitened residuals, or the last two; `as_vector` chooses the smooth form of the last two.
    pub(crate) fn push_rows(
        &self,
        body: &impl BodyModel,
        noise: &NoiseLevels,
        as_vector: bool,
        rows: &mut Vec<ResidualRow>,
    ) {
        let [center, size, aspect, angle] = match (self.partial, self.shape_only) {
            (true, _) => [NoiseGroup::PartialEllipse; 4],
            (false, true) => [NoiseGroup::Shape; 4],
            (false, false) => [
                NoiseGroup::EllipseCenter,
                NoiseGroup::EllipseSize,
                NoiseGroup::EllipseAspect,
                NoiseGroup::EllipseAngle,
            ],
        }
        .map(|group| (group, 1.0 / noise.of(group)));
        let as_vector = as_vector || self.shape_only;
        let mut push = |residual: f64, row: Row, (group, weight): (NoiseGroup, f64)| {
            rows.push(ResidualRow { residual: residual * weight, row: row.map(|x| x * weight), group, counts: true });
        };
        let Some(outline) = Outline::new(&self.m, &self.offset, body) else {
            let first = if self.shape_only { 3 } else { 0 };
            for group in &[center, center, size, aspect, angle][first..] {
                push(NO_OUTLINE, [0.0; 9], *group);
            }
            return;
        };
        let [s11, s12, s22] = outline.s;
        let [ds11, ds12, ds22] = &outline.ds;
        let determinant = s11 * s22 - s12 * s12;
        if !self.shape_only {
            push(outline.c[0], outline.dc[0], center);
            push(outline.c[1], outline.dc[1], center);
            let row =
                std::array::from_fn(|k| 0.25 * (ds11[k] * s22 + s11 * ds22[k] - 2.0 * s12 * ds12[k]) / determinant);
            push(0.25 * determinant.ln() - self.log_size, row, size);
        }
        // m +- rho are the eigenvalues of S; g = log(l1 / l2) = atanh(rho / m); phi = g / rho is smooth at rho = 0.
        let (m, d) = (0.5 * (s11 + s22), 0.5 * (s11 - s22));
        let rho = d.hypot(s12);
        let q = rho / m;
        let (g, phi, slope) = if q > 1e-3 {
            let g = q.atanh();
            let slope = 1.0 / (1.0 - q * q);
            (g, g / rho, slope)
        } else {
            (q, (1.0 + q * q / 3.0) / m, 1.0 + q * q)
        };
        // (x, y) = g (cos, sin) of twice the angle to the observed ellipse.
        let (x, y) = (phi * d, phi * s12);
        let mut rows = [[0.0; 9]; 2];
        // g sin(angle), from 2 sin^2 = 1 - cos; its sign is that of y. Zero only where the axes agree.
        let sine = (0.5 * g * (g - x)).max(0.0).sqrt().copysign(y);
        for k in 0..9 {
            let dm = 0.5 * (ds11[k] + ds22[k]);
            let dd = 0.5 * (ds11[k] - ds22[k]);
            let drho = if rho > 0.0 { (d * dd + s12 * ds12[k]) / rho } else { 0.0 };
            let dq = (drho - q * dm) / m;
            let dg = slope * dq;
            let dphi = if q > 1e-3 { (dg - phi * drho) / rho } else { (2.0 / 3.0 * q * dq) / m - phi * dm / m };
            let (dx, dy) = (phi * dd + d * dphi, phi * ds12[k] + s12 * dphi);
            if as_vector {
                rows[0][k] = 0.5 * dx;
                rows[1][k] = 0.5 * dy;
            } else {
                rows[0][k] = 0.5 * dg;
                // Near agreement the square root is not differentiable as it stands; there g sin = y / (2 cos).
                rows[1][k] = if x > 0.9 * g {
                    let cosine = (0.5 * (1.0 + x / g)).sqrt();
                    // y = 2 g s c  =>  dy = 2 (c dS + S dc) with S = g s, dc from x / g.
                    let dc = 0.25 * (dx - x / g * dg) / (g * cosine);
                    0.5 * (dy / (2.0 * cosine) - y * dc / (2.0 * cosine * cosine))
                } else if sine != 0.0 {
                    0.5 * 0.25 * (dg * (g - x) + g * (dg - dx)) / sine
                } else {
                    0.0
                };
            }
        }
        if as_vector {
            push(0.5 * x - self.log_aspect, rows[0], aspect);
            push(0.5 * y, rows[1], angle);
        } else {
            push(0.5 * g - self.log_aspect, rows[0], aspect);
            push(0.5 * sine, rows[1], angle);
        }
    }
}

/// Center and shape of the projected outline in the normalized image, with derivatives.
struct Outline {
    c: [f64; 2],
    dc: [Row; 2],
    /// S11, S12, S22.
    s: [f64; 3],
    ds: [Row; 3],
}

impl Outline {
    fn new(m: &Matrix3<f64>, offset: &Vector3<f64>, body: &impl BodyModel) -> Option<Self> {
        let root_transposed = body.root_transposed()?;
        let h = m * body.center() + offset;
        // Rows of N = M B: C = N N^T - h h^T; dC_ij = N_i^T D N_j.
        let n: [Vector3<f64>; 3] = std::array::from_fn(|i| root_transposed * m.row(i).transpose());
        let entry = |i: usize, j: usize| n[i].dot(&n[j]) - h[i] * h[j];
        let derivative = |i: usize, j: usize| -> Row {
            let (a, b) = (&n[i], &n[j]);
            [
                -(m[(i, 0)] * h[j] + h[i] * m[(j, 0)]),
                -(m[(i, 1)] * h[j] + h[i] * m[(j, 1)]),
                -(m[(i, 2)] * h[j] + h[i] * m[(j, 2)]),
                a.x * b.x,
                a.y * b.x + a.x * b.y,
                a.z * b.x + a.x * b.z,
                a.y * b.y,
                a.z * b.y + a.y * b.z,
                a.z * b.z,
            ]
        };
        let w = entry(2, 2);
        if h.z <= 0.0 || w >= -1e-9 * h.z * h.z {
            return None;
        }
        let inverse = 1.0 / w;
        let dw = derivative(2, 2);
        let c = [entry(0, 2) * inverse, entry(1, 2) * inverse];
        let d02 = [derivative(0, 2), derivative(1, 2)];
        let dc = std::array::from_fn(|i| std::array::from_fn(|k| (d02[i][k] - c[i] * dw[k]) * inverse));
        let indices = [(0, 0), (0, 1), (1, 1)];
        let s = indices.map(|(i, j)| c[i] * c[j] - entry(i, j) * inverse);
        let dc: [Row; 2] = dc;
        let ds = std::array::from_fn(|e| {
            let (i, j) = indices[e];
            let dij = derivative(i, j);
            std::array::from_fn(|k| {
                dc[i][k] * c[j] + c[i] * dc[j][k] - (dij[k] + (s[e] - c[i] * c[j]) * dw[k]) * inverse
            })
        });
        (s[0] > 0.0 && s[0] * s[2] > s[1] * s[1]).then_some(Self { c, dc, s, ds })
    }
}
