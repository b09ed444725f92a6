//! The whitened residuals of one view with their derivatives.

use super::measurements::{Measurements, Plane};
use super::row::ResidualRow;
use crate::body_model::BodyModel;
use crate::solve::map::noise::levels::NoiseLevels;

/// Depths below this (in object sizes) are taken as this: the object is at or behind the camera, and its residuals
/// are very large.
pub(crate) const SMALLEST_DEPTH: f64 = 1e-3;

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
    let (depth, axis) = if depth > SMALLEST_DEPTH { (depth, view.axis) } else { (SMALLEST_DEPTH, view.axis * 0.0) };
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
}
