//! A box and its camera, with the values that are computed once for each.

use std::ops::Range;

use nalgebra::{Matrix3, Matrix3x4, Vector2, Vector3};

use crate::geometry::Projection;

/// Lower bound of scores.
const MIN_SCORE: f64 = 1e-3;

/// A posed image.
#[derive(Debug, Clone, Default)]
pub(crate) struct Camera {
    /// World to pixels with a third row of length one, the world's origin amid the cameras.
    pub matrix: Matrix3x4<f64>,
    /// Its center.
    pub center: Vector3<f64>,
    /// Direction of view, length one.
    pub axis: Vector3<f64>,
    /// Mean focal length in pixels.
    pub focal: f64,
    /// Width and height in pixels; the extent of the boxes if the image size is unknown.
    pub size: Vector2<f64>,
    /// Its boxes, sorted by their left edges.
    pub boxes: Range<usize>,
}

/// One box.
#[derive(Debug, Clone)]
pub(crate) struct BoxObservation {
    /// Index of the detection in the scene.
    pub detection: usize,
    /// Index of the frame.
    pub frame: usize,
    /// Index of the category among those that occur; a missing category is a separate one.
    pub category: usize,
    /// Object id of the detection.
    pub id: Option<u32>,
    /// Left, top, right and bottom edge, less the frame's shift.
    pub edges: [f64; 4],
    /// Which edges the border of the image cuts off.
    pub cut: [bool; 4],
    /// Half of the sum of width and height, halved: the unit of noise.
    pub half_size: f64,
    /// Logarithms of half the width and half the height.
    pub log_half: [f64; 2],
    /// Log density of clutter at the box, over its four edges in pixels, as if there were one clutter box per frame.
    pub log_clutter: f64,
    /// Log odds of its score, if negative.
    pub score_log_odds: f64,
    /// Points on the ray through the middle are `center + depth * ray`.
    pub ray: Vector3<f64>,
    /// Radius of a sphere at depth one that fills the box.
    pub radius_per_depth: f64,
}

/// Log odds of a score (a probability) below one half; otherwise 0.
pub(crate) fn log_odds_against(score: Option<f64>) -> f64 {
    match score {
        Some(score) if (0.0..0.5).contains(&score) => {
            let score = score.max(MIN_SCORE);
            (score / (1.0 - score)).ln()
        }
        _ => 0.0,
    }
}

impl Camera {
    /// A camera whose center is at `center` (world), with the world's origin moved to `origin`.
    pub(crate) fn new(
        projection: &Projection,
        center: &Vector3<f64>,
        origin: &Vector3<f64>,
        size: Vector2<f64>,
    ) -> Self {
        let mut matrix = *projection.matrix();
        matrix /= matrix.fixed_view::<1, 3>(2, 0).norm();
        let moved = matrix.column(3) + matrix.fixed_columns::<3>(0) * origin;
        matrix.set_column(3, &moved);
        Self {
            matrix,
            center: center - origin,
            axis: matrix.fixed_view::<1, 3>(2, 0).transpose(),
            focal: projection.focal_length(),
            size,
            boxes: 0..0,
        }
    }
}

impl BoxObservation {
    /// A box (pixels) in a frame; its ray comes with [`BoxObservation::locate`].
    pub(crate) fn new(frame: usize, edges: [f64; 4], cut: [bool; 4], category: usize) -> Self {
        let half = Vector2::new(edges[2] - edges[0], edges[3] - edges[1]).map(|x| 0.5 * x.max(1e-3));
        Self {
            detection: 0,
            frame,
            category,
            id: None,
            edges,
            cut,
            half_size: 0.5 * (half.x + half.y),
            log_half: [half.x.ln(), half.y.ln()],
            log_clutter: 0.0,
            score_log_odds: 0.0,
            ray: Vector3::zeros(),
            radius_per_depth: 0.0,
        }
    }

    /// Sets the ray through the center; `inverse` is the inverse of the first three columns of the camera matrix.
    pub(crate) fn relocalize(&mut self, inverse: &Matrix3<f64>, focal: f64) {
        let center = self.center();
        self.ray = inverse * Vector3::new(center.x, center.y, 1.0);
        self.radius_per_depth = (0.5 * (self.log_half[0] + self.log_half[1])).exp() / focal;
    }

    /// The middle of the box, pixels.
    pub(crate) fn center(&self) -> Vector2<f64> {
        Vector2::new(0.5 * (self.edges[0] + self.edges[2]), 0.5 * (self.edges[1] + self.edges[3]))
    }

    /// Width and height, pixels.
    pub(crate) fn size(&self) -> Vector2<f64> {
        Vector2::new(self.edges[2] - self.edges[0], self.edges[3] - self.edges[1])
    }
}
