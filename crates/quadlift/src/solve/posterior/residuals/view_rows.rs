//! The whitened residuals of one view with their derivatives.

use super::harmonics::to_harmonics;
use super::measurements::{Measurements, Plane};
use super::row::{MIN_DEPTH, ResidualRow};
use crate::body_model::BodyModel;
use crate::solve::posterior::noise::levels::NoiseLevels;

/// Whitened residual of a line, in absolute value, from which on the lines of its outline are compared one by one: something hides a
/// part of the object there, and the harmonics would spread it over all of them.
const MAX_LINE: f64 = 3.0;

/// Chooses, for each outline, whether it is compared by harmonics: where all its lines are near those of a body.
pub(crate) fn choose_harmonics(measurements: &mut Measurements, body: &impl BodyModel, noise: &NoiseLevels) {
    let mut rows = Vec::with_capacity(16);
    for index in (0..measurements.views.len()).filter(|&k| measurements.views[k].outline).collect::<Vec<_>>() {
        measurements.views[index].harmonics = false;
        view_rows(measurements, index, body, noise, false, &mut rows);
        measurements.views[index].harmonics = rows.iter().all(|row| row.residual.abs() < MAX_LINE);
    }
}

/// Fills `rows` with the residuals of one view; edges keep their places, those that do not count are zero. `smooth` is
/// for the way from a start (see [`super::ellipse`]).
#[inline]
pub(crate) fn view_rows(
    measurements: &Measurements,
    index: usize,
    body: &impl BodyModel,
    noise: &NoiseLevels,
    smooth: bool,
    rows: &mut Vec<ResidualRow>,
) {
    rows.clear();
    let view = &measurements.views[index];
    if let Some(ellipse) = &view.ellipse {
        ellipse.push_rows(body, noise, smooth, rows);
    }
    if view.edges.is_empty() {
        return;
    }
    let depth = view.axis.dot(body.center()) + view.offset;
    let (depth, axis) = if depth > MIN_DEPTH { (depth, view.axis) } else { (MIN_DEPTH, view.axis * 0.0) };
    let inverse = 1.0 / depth;
    // (n.t + d - h) / depth: for small errors the distance between measured and predicted edge in half sizes.
    let edge = |plane: &Plane| {
        let (distance, mut row) = body.distance_to_plane(&plane.n, plane.d);
        let residual = distance * inverse;
        for k in 0..3 {
            row[k] -= residual * axis[k];
        }
        (residual, row.map(|x| x * inverse))
    };
    let inverse_size = 1.0 / noise.size_factor(view.half_size);
    for measured in &measurements.edges[view.edges.clone()] {
        let (residual, row) = edge(&measured.plane);
        // A body that reaches beyond an edge at the image border agrees with it.
        let agrees = measured.one_sided && residual <= 0.0;
        let scale = if agrees { 0.0 } else { inverse_size / noise.of(measured.group) };
        let (residual, row) = (residual * scale, row.map(|x| x * scale));
        rows.push(ResidualRow { residual, row, group: measured.group, counts: !agrees });
    }
    if view.harmonics {
        let first = rows.len() - view.edges.len();
        to_harmonics(rows, first);
    }
}
