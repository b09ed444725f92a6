//! The search for the body of each family: an ellipsoid from spheres; from its weights the scan over rotations, whose best minima a beam
//! follows down to the noise; rounded bodies between ellipsoid and cuboid.

use std::f64::consts::{FRAC_PI_2, PI};

use nalgebra::{Matrix3, Vector3};

use super::conditions::Conditions;
use super::fit::{Fit, Termination, Workspace, log_determinant, minimize, residual_level, residuals};
use super::log_evidence::vertical_axis;
use super::rotations::{spread_axes, spread_rotations};
use super::rounded::fit_rounded;
use super::rows::Rows;
use super::scan::LinearRows;
use super::solid::{Family, Solid, level_axes};
use crate::geometry::linalg::symmetric_eigen3;

/// With so few views the ellipsoid is fitted from several spheres.
const FEW_VIEWS: usize = 5;

/// Spheres then.
const FEW_VIEW_STARTS: usize = 3;

/// Noise levels through which the first ellipsoid goes, in half sizes.
const FIRST_LEVELS: [(f64, Termination); 2] = [(0.35, Termination::new(1.0, 3)), (0.12, Termination::new(0.3, 5))];

/// From this level on in factors of [`BEAM_FACTOR`].
const LAST_FIRST_LEVEL: f64 = 0.1 / BEAM_FACTOR;

/// Axes of cylinders that the scan tries besides those of the ellipsoid.
const AXES: usize = 48;

/// Directions about the vertical that it tries: of cuboids within a quarter turn, of level cylinders within half a turn.
const YAWS: usize = 12;

/// Typical residual, in units of the noise, below which the scan's best body may start at the noise itself.
const SCAN_LEVEL: (f64, f64) = (0.3, 30.0);

/// Factor between the noise levels of the beam.
const BEAM_FACTOR: f64 = 3.0;

/// Largest decrease of the cost that is expected of a fit that has not converged.
const MAX_EXPECTED_DECREASE: f64 = 10.0;

/// How thoroughly rotations are searched.
#[derive(Debug, Clone, Copy)]
pub(super) struct Effort {
    /// Rotations of the scan.
    pub rotations: usize,
    /// Best rotations that are fitted.
    pub starts: usize,
    /// Minima that are followed.
    pub minima: usize,
    /// Cost above that of the best up to which minima are followed.
    pub margin: f64,
    /// Cost above that of the ellipsoid up to which a family is followed.
    pub family_margin: f64,
}

/// An ellipsoid from the most probable spheres.
pub(super) fn first_ellipsoid(rows: &Rows, conditions: &Conditions, work: &mut Workspace) -> Option<Fit> {
    let count = if rows.views.len() <= FEW_VIEWS { FEW_VIEW_STARTS } else { 1 };
    let mut taken: Vec<Vector3<f64>> = Vec::new();
    let mut best: Option<(f64, Fit)> = None;
    for start in &rows.starts {
        if taken.len() == count {
            break;
        }
        if taken.iter().any(|other| (other - start.center).norm() < 0.1) {
            continue;
        }
        taken.push(start.center);
        let mut body = sphere(rows, start.center, start.radius);
        for (level, termination) in FIRST_LEVELS {
            body = minimize(rows, &body, &conditions.at_least(level), termination, work).body;
        }
        // Minima of little noise are too narrow to be met from there.
        let mut level = LAST_FIRST_LEVEL;
        while level > conditions.noise[0] {
            body = minimize(rows, &body, &conditions.at_least(level), Termination::new(0.3, 4), work).body;
            level /= BEAM_FACTOR;
        }
        let fit = minimize(rows, &body, conditions, Termination::new(1e-2, 8), work);
        let score = fit.equations.cost + log_determinant(&fit.equations.hessian);
        if best.as_ref().is_none_or(|(least, _)| score < *least) {
            best = Some((score, fit));
        }
    }
    best.map(|(_, fit)| fit)
}

/// A sphere with axes that turn with the world: those of the planes' normals.
fn sphere(rows: &Rows, center: Vector3<f64>, radius: f64) -> Solid {
    let mut moments = Matrix3::zeros();
    for view in &rows.views {
        let axis = Vector3::from(view.depth_slope);
        moments += axis * axis.transpose() * 3.0;
        for edge in 0..4 {
            let n = view.normal_of(edge);
            // Unlike weights, so that no two moments are equal in a symmetric path.
            moments += n * n.transpose() * (1.0 + 0.1 * edge as f64);
        }
    }
    let axes = symmetric_eigen3(&moments).map_or_else(Matrix3::identity, |(_, axes)| axes);
    let half_extents = Vector3::repeat(radius);
    Solid { family: Family::Ellipsoid, center, axes: signed(&axes, rows), half_extents, cuboid_share: 0.0, up: None }
}

/// Axes with signs that turn with the world: the first two away from the first camera.
fn signed(axes: &Matrix3<f64>, rows: &Rows) -> Matrix3<f64> {
    let (away, right) = (Vector3::from(rows.views[0].depth_slope), rows.views[0].normal_of(0));
    let away_from_camera = |axis: Vector3<f64>| {
        let along = away.dot(&axis);
        let side = if along.abs() > 1e-3 * away.norm() { along } else { right.dot(&axis) };
        if side < 0.0 { -axis } else { axis }
    };
    let (x, y) = (away_from_camera(axes.column(0).into()), away_from_camera(axes.column(1).into()));
    Matrix3::from_columns(&[x, y, x.cross(&y)])
}

/// The axes of an ellipsoid, the longest first.
fn sorted_axes(ellipsoid: &Solid, rows: &Rows) -> Matrix3<f64> {
    let mut order = [0, 1, 2];
    order.sort_by(|&a, &b| ellipsoid.half_extents[b].total_cmp(&ellipsoid.half_extents[a]));
    signed(&Matrix3::from_columns(&order.map(|k| ellipsoid.axes.column(k).into_owned())), rows)
}

/// The best minima of cuboids or cylinders, the best first; none where the family fits worse than the ellipsoid by more than the
/// margin.
pub(super) fn search_angular(
    rows: &Rows,
    family: Family,
    ellipsoid: &Solid,
    up: Option<Vector3<f64>>,
    conditions: &Conditions,
    effort: &Effort,
    work: &mut Workspace,
) -> Vec<Fit> {
    // The scan takes the weights of the ellipsoid under the noise that it leaves itself.
    residuals(rows, ellipsoid, conditions, work);
    let own = residual_level(work).min(0.3 / conditions.noise[0]).max(1.0);
    let level = conditions.times(own);
    if own > 1.0 {
        residuals(rows, ellipsoid, &level, work);
    }
    let linear = LinearRows::new(rows, ellipsoid, &level, work);
    let mut scanned = scan(&linear, family, &sorted_axes(ellipsoid, rows), up, effort);
    scanned.retain(|(cost, _)| cost.is_finite());
    scanned.sort_by(|a, b| a.0.total_cmp(&b.0));
    let Some((least, _)) = scanned.first() else { return Vec::new() };
    let left = (least.max(0.0) / (4.0 * rows.views.len() as f64)).sqrt().clamp(SCAN_LEVEL.0, SCAN_LEVEL.1);
    let mut factor = (own * left).max(1.0);
    scanned.truncate(effort.starts);
    let start = |body: &Solid, work: &mut Workspace| {
        minimize(rows, body, &conditions.times(factor), Termination::new(0.5, 3), work)
    };
    let mut beam: Vec<Fit> = scanned.iter().map(|(_, body)| start(body, work)).collect();
    sort_by_cost(&mut beam);
    if effort.family_margin.is_finite() {
        let of_ellipsoid = -2.0 * residuals(rows, ellipsoid, &conditions.times(factor), work) * conditions.view_weight;
        if expected_cost(&beam[0]) > of_ellipsoid + effort.family_margin {
            return Vec::new();
        }
    }
    // Down to the noise, with fewer minima at each level.
    let mut minima = effort.minima;
    loop {
        keep_distinct(&mut beam, minima, effort.margin);
        let last = factor <= 1.5 * BEAM_FACTOR;
        factor /= BEAM_FACTOR;
        let descend = |fit: &Fit, work: &mut Workspace| match last {
            true => minimize(rows, &fit.body, conditions, Termination::new(3e-2, 40), work),
            false => minimize(rows, &fit.body, &conditions.times(factor), Termination::new(0.3, 4), work),
        };
        beam = beam.iter().map(|fit| descend(fit, work)).collect();
        sort_by_cost(&mut beam);
        if last {
            return beam;
        }
        minima = (minima * 3 / 5).max(effort.minima.min(4));
    }
}

/// All rotations of the scan, with their costs.
fn scan(
    linear: &LinearRows,
    family: Family,
    axes: &Matrix3<f64>,
    up: Option<Vector3<f64>>,
    effort: &Effort,
) -> Vec<(f64, Solid)> {
    let solid = |center, axes, half_extents| Solid { family, center, axes, half_extents, cuboid_share: 1.0, up };
    let level = up.map(|up| (up, level_axes(&up, axes)));
    let yaw = |angle: f64, [x, y]: [Vector3<f64>; 2]| x * angle.cos() + y * angle.sin();
    if family == Family::Cylinder {
        let about = |axis: Vector3<f64>| {
            let found = linear.cylinder(&axis);
            let [radius, half_height] = found.half_extents;
            // Any two axes across.
            let across = axes.column(axes.tr_mul(&axis).iamin()).cross(&axis).normalize();
            let axes = Matrix3::from_columns(&[across, axis.cross(&across), axis]);
            (found.cost, solid(found.center, axes, Vector3::new(radius, radius, half_height)))
        };
        let of_ellipsoid = (0..3).map(|k| axes.column(k).into_owned());
        return match level {
            Some((up, level)) => {
                let yaws = level.into_iter().flat_map(|level| (0..YAWS).map(move |k| yaw(PI * fraction(k), level)));
                std::iter::once(up).chain(yaws).map(about).collect()
            }
            None => of_ellipsoid.chain(spread_axes(AXES).map(|axis| axes * axis)).map(about).collect(),
        };
    }
    let with = |axes: Matrix3<f64>| {
        let found = linear.cuboid(&axes);
        (found.cost, solid(found.center, axes, found.half_extents.into()))
    };
    match level {
        Some((up, level)) => {
            let yaws = level.into_iter().flat_map(|level| (0..YAWS).map(move |k| yaw(FRAC_PI_2 * fraction(k), level)));
            yaws.map(|x| with(Matrix3::from_columns(&[x, up.cross(&x), up]))).collect()
        }
        None => spread_rotations(effort.rotations).iter().map(|rotation| with(axes * rotation)).collect(),
    }
}

fn fraction(yaw: usize) -> f64 {
    yaw as f64 / YAWS as f64
}

fn sort_by_cost(fits: &mut [Fit]) {
    fits.sort_by(|a, b| a.equations.cost.total_cmp(&b.equations.cost));
}

/// The cost that a fit may still reach.
fn expected_cost(fit: &Fit) -> f64 {
    fit.equations.cost - fit.remaining.clamp(0.0, MAX_EXPECTED_DECREASE)
}

/// The best minima that are unlike each other.
fn keep_distinct(fits: &mut Vec<Fit>, count: usize, margin: f64) {
    let least = fits[0].equations.cost;
    let mut kept: Vec<Fit> = Vec::with_capacity(count);
    for fit in fits.iter() {
        let is_near = fit.equations.cost <= least + margin;
        if kept.len() < count && is_near && !kept.iter().any(|other| other.body.is_like(&fit.body)) {
            kept.push(*fit);
        }
    }
    if kept.is_empty() {
        fits.truncate(1);
    } else {
        *fits = kept;
    }
}

/// A rounded body, from the fits of ellipsoid and cuboid, if it can be better than both.
pub(super) fn search_rounded(
    rows: &Rows,
    ellipsoid: &Fit,
    cuboids: &[Fit],
    up: Option<Vector3<f64>>,
    conditions: &Conditions,
    margin: f64,
    work: &mut Workspace,
) -> Vec<Fit> {
    let [share, _] = conditions.cuboid_share;
    let as_rounded = |body: &Solid, scale: f64| {
        let half_extents = body.half_extents * scale;
        Solid { family: Family::Rounded, half_extents, cuboid_share: share, up, ..*body }
    };
    // As large as the ellipsoid, whose support the cuboid's part exceeds; and as the cuboids.
    let mut starts = vec![with_vertical_last(as_rounded(&ellipsoid.body, 1.0 - 0.4 * share))];
    starts.extend(cuboids.iter().map(|fit| as_rounded(&fit.body, 1.25)));
    let costs = cuboids.iter().map(|fit| fit.equations.cost);
    let least = costs.fold(ellipsoid.equations.cost, f64::min);
    let started = starts.iter().map(|start| minimize(rows, start, conditions, Termination::new(0.5, 2), work));
    let started: Vec<Fit> = started.collect();
    let may_be = started.iter().filter(|fit| expected_cost(fit) <= least + margin);
    let mut fits: Vec<Fit> = may_be.map(|fit| fit_rounded(rows, &fit.body, conditions, 3, work)).collect();
    sort_by_cost(&mut fits);
    fits
}

/// The same body with its most vertical axis as the third, if it is upright.
fn with_vertical_last(body: Solid) -> Solid {
    let Some(up) = body.up else { return body };
    let k = vertical_axis(&body, &up);
    let order = [(k + 1) % 3, (k + 2) % 3, k];
    Solid {
        axes: Matrix3::from_columns(&order.map(|k| body.axes.column(k).into_owned())),
        half_extents: Vector3::from(order.map(|k| body.half_extents[k])),
        ..body
    }
}
