//! Closed form from tangent planes (docs/method.md, section 4.4): a box edge is an image line that touches the outline, so its plane
//! `pi = P^T l` touches the body: `pi^T Q* pi = 0`, linear in the dual quadric, with no scale factor per view.
//!
//! Unlike an ellipse inscribed in the box this is not biased: exact boxes of ellipsoids give the exact answer from
//! three views. Needs three views with at least nine edges that are not on the image border.

use nalgebra::Vector4;

use super::lfd::ConditionedSolution;
use crate::geometry::{DualQuadric, VECH4, edge_plane, support_plane};
use crate::scene::{BORDER_TOLERANCE_PX, View, edges_at_border};
use crate::solve::conditioning::ObjectFrame;
use crate::solve::estimate::Status;
use crate::solve::streaming_qr::StreamingQr;

/// Number of rows per update of the factorization.
const ROWS_PER_BLOCK: usize = 40;

/// A pivot smaller than this share of the largest one is zero: the planes do not determine a quadric.
const SINGULAR: f64 = 1e-13;

/// Minimum number of tangent planes that determine a quadric.
pub(crate) const MIN_PLANES: usize = 9;

/// Solves for the quadric that the planes of the views' box edges touch best.
///
/// Rows are scaled to unit depth and unit box size, so that a residual is an edge's error relative to its box.
///
/// # Errors
/// [`Status::TooFewViews`] below three views with boxes or nine edges, [`Status::Degenerate`] when the planes do not
/// determine a quadric.
pub(crate) fn planes(views: &[View]) -> Result<ConditionedSolution, Status> {
    if views.len() < 3 {
        return Err(Status::TooFewViews);
    }
    let frame = ObjectFrame::from_views(views).ok_or(Status::Degenerate)?;
    let (center, shape) = planes_in_frame(views, &frame)?.center_and_shape().ok_or(Status::Degenerate)?;
    Ok(ConditionedSolution {
        center: frame.point_in_world(&center.coords),
        shape: frame.axes * shape * frame.axes.transpose() * (frame.unit * frame.unit),
    })
}

/// The same in an object frame, with the result in that frame.
pub(crate) fn planes_in_frame(views: &[View], frame: &ObjectFrame) -> Result<DualQuadric, Status> {
    if views.iter().filter(|view| view.bounding_box.is_some()).count() < 3 {
        return Err(Status::TooFewViews);
    }
    let mut rows = Vec::with_capacity(4 * views.len());
    for view in views {
        let Some(bounding_box) = &view.bounding_box else { continue };
        let p = frame.local_projection(&view.projection);
        // Depth of the frame's origin; its sign must not matter, a row may be multiplied by anything.
        let depth = p[(2, 3)].abs().max(f64::MIN_POSITIVE);
        if let Some(lines) = &view.tangent_lines {
            let half = depth * lines.mean_half_size();
            let free = lines.lines().filter(|line| !line.end.is_open());
            rows.extend(free.map(|line| tangency_row(&(support_plane(&p, &line) / half))));
            continue;
        }
        let half = bounding_box.size() * 0.5;
        let cut = edges_at_border(&view.in_image(bounding_box), view.image_size, BORDER_TOLERANCE_PX);
        for edge in (0..4).filter(|&edge| !cut[edge]) {
            let plane = edge_plane(&p, bounding_box, edge) / (depth * half[edge % 2]);
            rows.push(tangency_row(&plane));
        }
    }
    if rows.len() < MIN_PLANES {
        return Err(Status::TooFewViews);
    }
    quadric_tangent_to(&mut rows).ok_or(Status::Degenerate)
}

/// The row of `pi^T Q* pi = 0` in the ten entries of `vech Q*`.
pub(crate) fn tangency_row(plane: &Vector4<f64>) -> [f64; 10] {
    VECH4.map(|(i, j)| plane[i] * plane[j] * if i == j { 1.0 } else { 2.0 })
}

/// The dual quadric with last entry -1 that satisfies the rows best; `None` if they do not determine it.
pub(crate) fn quadric_tangent_to(rows: &mut [[f64; 10]]) -> Option<DualQuadric> {
    let mut qr = StreamingQr::new();
    for block in rows.chunks_mut(ROWS_PER_BLOCK) {
        qr.push_rows(block);
    }
    let r = qr.r();
    let largest = (0..9).map(|i| r[i][i].abs()).fold(0.0, f64::max);
    let mut v = [0.0; 10];
    v[9] = -1.0;
    for i in (0..9).rev() {
        let sum: f64 = (i + 1..10).map(|j| r[i][j] * v[j]).sum();
        if r[i][i].abs() <= SINGULAR * largest {
            return None;
        }
        v[i] = -sum / r[i][i];
    }
    v.iter().all(|x| x.is_finite()).then(|| DualQuadric::from_vech(&v.into()))
}
