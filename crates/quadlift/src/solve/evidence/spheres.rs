//! Spheres that agree with the boxes of an object: where its fit starts, and its frame.

use nalgebra::{Matrix3, Vector3};

use super::box_planes::BoxPlanes;
use super::conditions::{CLUTTER_RANGE, DOF, FIRST_WRONG_SHARE};
use crate::geometry::linalg::solve_spd;
use crate::optimize::median::median;

/// A sphere, and the logarithm of the likelihood of the boxes under it.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sphere {
    pub center: Vector3<f64>,
    pub radius: f64,
    pub score: f64,
}

/// Maximum number of pairs of views that give a sphere each.
const MAX_PAIRS: usize = 24;

/// Maximum number of views by which spheres are compared.
const MAX_SCORED: usize = 32;

/// Noise of an edge in half sizes: bodies are no spheres.
const SPHERE_NOISE: f64 = 0.35;

/// Rounds of the triangulation of all centers; the first ones without weights.
const ROUNDS: usize = 5;

/// Scale of Cauchy's weights in that, in half sizes.
const CENTER_NOISE: f64 = 0.15;

/// Rays with a squared sine below this have no crossing.
const MIN_SQUARED_SINE: f64 = 1e-8;

/// Spheres from pairs of views and from all of them, the most probable first.
pub(super) fn agreeing_spheres(boxes: &[BoxPlanes]) -> Vec<Sphere> {
    let whole: Vec<&BoxPlanes> = boxes.iter().filter(|planes| !planes.truncated.contains(&true)).collect();
    let whole = if whole.len() >= 2 { whole } else { boxes.iter().collect() };
    let mut found: Vec<Sphere> = of_all(boxes, &whole).into_iter().collect();
    found.extend(pairs(whole.len()).filter_map(|(i, j)| of_pair(whole[i], whole[j])));
    found.retain(|sphere| {
        sphere.radius > 0.0 && sphere.radius.is_finite() && sphere.center.iter().all(|x| x.is_finite())
    });
    let stride = (boxes.len() / MAX_SCORED).max(1);
    for sphere in &mut found {
        sphere.score = boxes.iter().step_by(stride).map(|planes| log_likelihood(planes, sphere)).sum();
    }
    found.sort_by(|a, b| b.score.total_cmp(&a.score));
    found
}

/// Pairs of so many views: first those half of them apart, then a third, a quarter and a sixth.
fn pairs(count: usize) -> impl Iterator<Item = (usize, usize)> {
    let step = (count / 12).max(1);
    let parts = if count < 4 { 1 } else { 4 };
    [2, 3, 4, 6]
        .into_iter()
        .take(parts)
        .flat_map(move |part| {
            let apart = (count / part).max(1);
            (0..count.saturating_sub(apart)).step_by(step).map(move |i| (i, i + apart))
        })
        .take(MAX_PAIRS)
}

/// The radius of a sphere at this point that fills the box.
fn radius_at(point: &Vector3<f64>, planes: &BoxPlanes) -> f64 {
    planes.half_size * planes.depth(point) / planes.focal_length
}

/// About the point nearest to all rays, with the median radius.
fn of_all(boxes: &[BoxPlanes], whole: &[&BoxPlanes]) -> Option<Sphere> {
    let mut center: Option<Vector3<f64>> = None;
    for round in 0..ROUNDS {
        let (mut normal, mut right) = (Matrix3::zeros(), Vector3::zeros());
        for planes in boxes {
            let depth = center.map_or(1.0, |x| planes.depth(&x).abs().max(1e-9));
            for (k, (n, d)) in planes.middle.iter().enumerate() {
                if (planes.truncated[k] || planes.truncated[k + 2]) && whole.len() >= 2 {
                    continue;
                }
                let mut weight = (planes.half_size * depth).powi(-2);
                if let Some(x) = center.filter(|_| round > 1) {
                    let error = n.dot(&x) + d;
                    weight /= 1.0 + error * error * weight / (CENTER_NOISE * CENTER_NOISE);
                }
                normal += n * n.transpose() * weight;
                right -= n * (d * weight);
            }
        }
        normal += Matrix3::identity() * (1e-12 * (1.0 + normal.trace()));
        center = solve_spd(&normal, &right).or(center);
    }
    let center = center?;
    let mut radii: Vec<f64> = whole.iter().map(|planes| radius_at(&center, planes)).filter(|r| *r > 0.0).collect();
    Some(Sphere { center, radius: median(&mut radii)?, score: 0.0 })
}

/// About the point between two rays.
fn of_pair(a: &BoxPlanes, b: &BoxPlanes) -> Option<Sphere> {
    let cosine = a.ray.dot(&b.ray);
    let squared_sine = 1.0 - cosine * cosine;
    if squared_sine < MIN_SQUARED_SINE {
        return None;
    }
    let between = b.camera - a.camera;
    let (p, q) = (between.dot(&a.ray), between.dot(&b.ray));
    let (s, t) = ((p - cosine * q) / squared_sine, (cosine * p - q) / squared_sine);
    if s <= 0.0 || t <= 0.0 {
        return None;
    }
    let center = (a.camera + a.ray * s + b.camera + b.ray * t) * 0.5;
    let (first, second) = (radius_at(&center, a), radius_at(&center, b));
    (first > 0.0 && second > 0.0).then(|| Sphere { center, radius: (first * second).sqrt(), score: 0.0 })
}

/// By the likelihood of [`super::fit`] for one view.
fn log_likelihood(planes: &BoxPlanes, sphere: &Sphere) -> f64 {
    let clutter = FIRST_WRONG_SHARE * (std::f64::consts::TAU.sqrt() * SPHERE_NOISE / CLUTTER_RANGE).powi(4);
    let depth = planes.depth(&sphere.center);
    if depth <= 0.0 {
        return clutter.ln();
    }
    let scale = 1.0 / (depth * planes.half_size * SPHERE_NOISE);
    let mut tails = 1.0;
    for edge in 0..4 {
        let normal = &planes.normal[edge];
        let distance = normal.dot(&sphere.center) + planes.offset[edge] - sphere.radius * normal.norm();
        let residual = distance * scale;
        let residual = if planes.truncated[edge] { residual.max(0.0) } else { residual };
        tails *= 1.0 + residual * residual / DOF;
    }
    ((1.0 - FIRST_WRONG_SHARE) / tails.powi(5) + clutter).ln()
}
