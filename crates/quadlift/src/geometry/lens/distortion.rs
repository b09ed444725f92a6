//! From the ideal image plane to the distorted one and back, both at focal length one about the principal point.
//!
//! The formulas are COLMAP's (`src/colmap/sensor/models`), which has those of the radial, tangential and rational models
//! from OpenCV, FOV from Devernay and Faugeras (2001), division from Fitzgibbon (2001), EUCM from Khomutenko et al.
//! (2016), thin prisms from Weng et al. (1992) and Project Aria. Inversion is Newton's method with safeguards where no
//! closed form exists (ours).

use std::f64::consts::{FRAC_PI_2, PI};

use nalgebra::{Matrix2, Vector2};

use crate::geometry::camera_model::CameraModel as M;

/// Most steps of Newton's method; it needs three to six.
const MAX_STEPS: usize = 50;

/// A residual below this, at focal length one, is zero: 1e-12 px at 1000 px.
const CONVERGED: f64 = 1e-15;

/// A residual below this is accepted where rounding stops the iteration: 1e-9 px at 1000 px.
const ACCEPTED: f64 = 1e-12;

/// Directions and steps in which a lens is searched for the place where it folds the image over.
const FOLD_DIRECTIONS: usize = 8;
const FOLD_STEPS: usize = 80;

/// The distorted point of an ideal one `(x / z, y / z)`; `None` where the model has none. `k` are the parameters after
/// focal lengths and principal point.
pub(super) fn distort(model: M, k: &[f64], q: &Vector2<f64>) -> Option<Vector2<f64>> {
    let r2 = q.norm_squared();
    let p = match model {
        M::Fov => q * fov_factor(k[0], r2.sqrt()),
        M::SimpleDivision | M::Division => {
            let discriminant = 1.0 - 4.0 * r2 * k[0];
            if discriminant < 0.0 {
                return None;
            }
            q * (2.0 / (1.0 + discriminant.sqrt()))
        }
        M::Eucm => {
            let (alpha, beta) = (k[0], k[1]);
            q / (alpha * (beta * r2 + 1.0).sqrt() + 1.0 - alpha)
        }
        M::Equirectangular => {
            let (azimuth, elevation) = (q.x.atan(), (-q.y).atan2(q.x.hypot(1.0)));
            Vector2::new(azimuth, -elevation)
        }
        _ if model.is_fisheye() => bend(model, k, &to_fisheye(q)),
        _ => bend(model, k, q),
    };
    p.iter().all(|x| x.is_finite()).then_some(p)
}

/// The ideal point of a distorted one; `None` where the lens sends no ray in front of the camera there. `reach` is
/// [`fold_radius`].
pub(super) fn undistort(model: M, k: &[f64], reach: f64, p: &Vector2<f64>) -> Option<Vector2<f64>> {
    let r2 = p.norm_squared();
    let q = match model {
        M::Fov => {
            let (r, omega) = (r2.sqrt(), k[0]);
            if (r * omega).abs() >= FRAC_PI_2 {
                return None;
            }
            p * inverse_fov_factor(omega, r)
        }
        M::SimpleDivision | M::Division => {
            // Beyond |k| r^2 = 1 the ray points backwards (k < 0) or the image folds over (k > 0).
            if k[0].abs() * r2 >= 1.0 {
                return None;
            }
            p / (1.0 + k[0] * r2)
        }
        M::Eucm => {
            let (alpha, beta) = (k[0], k[1]);
            let radicand = 1.0 - (2.0 * alpha - 1.0) * beta * r2;
            if radicand < 0.0 {
                return None;
            }
            let depth = (1.0 - alpha * alpha * beta * r2) / (alpha * radicand.sqrt() + 1.0 - alpha);
            if depth.is_nan() || depth <= 0.0 {
                return None;
            }
            p / depth
        }
        M::Equirectangular => {
            if p.x.abs() >= FRAC_PI_2 || p.y.abs() >= FRAC_PI_2 {
                return None;
            }
            Vector2::new(p.x.tan(), p.y.tan() / p.x.cos())
        }
        M::SimplePinhole | M::Pinhole => *p,
        M::SimpleFisheye | M::Fisheye => from_fisheye(p)?,
        _ => {
            let unbent = unbend(model, k, reach, p)?;
            if model.is_fisheye() { from_fisheye(&unbent)? } else { unbent }
        }
    };
    q.iter().all(|x| x.is_finite()).then_some(q)
}

/// `atan(2 r tan(w / 2)) / (r w)`.
fn fov_factor(omega: f64, r: f64) -> f64 {
    let slope = 2.0 * (0.5 * omega).tan();
    match (omega.abs() < 1e-8, r < 1e-8) {
        (true, _) => 1.0,
        (false, true) => slope / omega,
        (false, false) => (r * slope).atan() / (r * omega),
    }
}

/// `tan(r w) / (2 r tan(w / 2))`.
fn inverse_fov_factor(omega: f64, r: f64) -> f64 {
    let slope = 2.0 * (0.5 * omega).tan();
    match (omega.abs() < 1e-8, r < 1e-8) {
        (true, _) => 1.0,
        (false, true) => omega / slope,
        (false, false) => (r * omega).tan() / (r * slope),
    }
}

/// From tangents to angles: `theta` in the direction of `q`, `tan(theta) = |q|`.
fn to_fisheye(q: &Vector2<f64>) -> Vector2<f64> {
    let r = q.norm();
    if r < 1e-9 { *q } else { q * (r.atan() / r) }
}

/// From angles to tangents; `None` from a right angle on.
fn from_fisheye(p: &Vector2<f64>) -> Option<Vector2<f64>> {
    let theta = p.norm();
    if theta < 1e-9 {
        return Some(*p);
    }
    (theta < FRAC_PI_2).then(|| p * (theta.tan() / theta))
}

/// The polynomial (or rational) part of a model; of the fisheye models, on angles. The identity for models that have
/// none.
fn bend(model: M, k: &[f64], p: &Vector2<f64>) -> Vector2<f64> {
    let r2 = p.norm_squared();
    match model {
        M::SimpleRadial | M::SimpleRadialFisheye => p * (1.0 + r2 * k[0]),
        M::Radial | M::RadialFisheye => p * (1.0 + r2 * (k[0] + r2 * k[1])),
        M::OpenCv => p * (1.0 + r2 * (k[0] + r2 * k[1])) + tangential(p, k[2], k[3]),
        M::OpenCvFisheye => p * (1.0 + r2 * (k[0] + r2 * (k[1] + r2 * (k[2] + r2 * k[3])))),
        M::FullOpenCv => {
            let numerator = 1.0 + r2 * (k[0] + r2 * (k[1] + r2 * k[4]));
            let denominator = 1.0 + r2 * (k[5] + r2 * (k[6] + r2 * k[7]));
            p * (numerator / denominator) + tangential(p, k[2], k[3])
        }
        M::ThinPrismFisheye => {
            let radial = 1.0 + r2 * (k[0] + r2 * (k[1] + r2 * (k[4] + r2 * k[5])));
            p * radial + tangential(p, k[2], k[3]) + Vector2::new(k[6], k[7]) * r2
        }
        M::RadTanThinPrismFisheye => {
            let radial = k[..6].iter().rev().fold(0.0, |sum, coefficient| (sum + coefficient) * r2);
            let p = p * (1.0 + radial);
            let r2 = p.norm_squared();
            // The order of the tangential coefficients is that of Project Aria, the reverse of OpenCV's.
            p + tangential(&p, k[7], k[6]) + (Vector2::new(k[8], k[10]) + Vector2::new(k[9], k[11]) * r2) * r2
        }
        _ => *p,
    }
}

/// Tangential distortion, with OpenCV's p1 and p2.
fn tangential(p: &Vector2<f64>, p1: f64, p2: f64) -> Vector2<f64> {
    let (r2, xy) = (p.norm_squared(), p.x * p.y);
    Vector2::new(2.0 * p1 * xy + p2 * (r2 + 2.0 * p.x * p.x), 2.0 * p2 * xy + p1 * (r2 + 2.0 * p.y * p.y))
}

/// Derivative of [`bend`], by central differences: good to ten digits, which only costs Newton's method its last step.
fn bend_jacobian(model: M, k: &[f64], p: &Vector2<f64>) -> Matrix2<f64> {
    let step = 1e-5 * (1.0 + p.norm());
    let column =
        |axis: Vector2<f64>| (bend(model, k, &(p + axis * step)) - bend(model, k, &(p - axis * step))) / (2.0 * step);
    Matrix2::from_columns(&[column(Vector2::x()), column(Vector2::y())])
}

/// How far from the axis [`bend`] can be inverted: the smallest radius at which it folds the image over (the determinant
/// of its derivative is no longer positive) or is not finite, searched out to `farthest`.
pub(super) fn fold_radius(model: M, k: &[f64], farthest: f64) -> f64 {
    let mut reach = farthest;
    for direction in 0..FOLD_DIRECTIONS {
        let (sin, cos) = (2.0 * PI * direction as f64 / FOLD_DIRECTIONS as f64).sin_cos();
        let good = |r: f64| {
            let determinant = bend_jacobian(model, k, &Vector2::new(r * cos, r * sin)).determinant();
            determinant > 0.0 && determinant.is_finite()
        };
        let step = farthest / FOLD_STEPS as f64;
        let Some(first_bad) = (0..=FOLD_STEPS).map(|i| i as f64 * step).find(|&r| r > reach || !good(r)) else {
            continue;
        };
        let (mut low, mut high) = ((first_bad - step).max(0.0), first_bad);
        for _ in 0..40 {
            let middle = 0.5 * (low + high);
            if good(middle) { low = middle } else { high = middle }
        }
        reach = reach.min(low);
    }
    reach
}

/// Inverts [`bend`] by Newton's method from the point itself, within `reach` of the axis; a step that does not lessen
/// the residual is halved. `None` where there is no answer within `reach`.
fn unbend(model: M, k: &[f64], reach: f64, p: &Vector2<f64>) -> Option<Vector2<f64>> {
    let within = |q: Vector2<f64>| if q.norm() > reach { q * (reach / q.norm()) } else { q };
    let residual = |q: &Vector2<f64>| bend(model, k, q) - p;
    let mut q = within(*p);
    let mut error = residual(&q);
    for _ in 0..MAX_STEPS {
        if error.norm() <= CONVERGED * (1.0 + p.norm()) {
            break;
        }
        let step = bend_jacobian(model, k, &q).try_inverse()? * error;
        let next = (0..10).map(|halvings| within(q - step * 0.5f64.powi(halvings))).find_map(|next| {
            let next_error = residual(&next);
            (next_error.norm() < error.norm()).then_some((next, next_error))
        });
        // Rounding, or the border of the invertible part: no step helps.
        let Some(better) = next else { break };
        (q, error) = better;
    }
    (error.norm() <= ACCEPTED * (1.0 + p.norm())).then_some(q)
}
