//! An object during the search: its boxes, its body and the body's covariance.

use nalgebra::{Matrix3, SMatrix, Vector3};

use crate::association::input::observations::{BoxObservation, Camera, Observations};

/// The body in a camera's image.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Prediction {
    /// The tight box, pixels.
    pub edges: [f64; 4],
    /// Depth of the center.
    pub depth: f64,
}

impl Prediction {
    /// Width and height, pixels.
    pub(crate) fn size(&self) -> [f64; 2] {
        [self.edges[2] - self.edges[0], self.edges[3] - self.edges[1]]
    }
}

/// An ellipsoid and the boxes that are taken for its detections.
#[derive(Debug, Clone)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub(crate) struct Object {
    /// Indices of the boxes, ascending, hence in the order of the frames.
    #[cfg_attr(feature = "serde", serde(skip))]
    pub boxes: Vec<u32>,
    /// Center, less the origin of the observations.
    pub center: Vector3<f64>,
    /// `B` with the shape matrix `A = B B^T`; its columns are the semi-axes.
    pub root: Matrix3<f64>,
    /// Geometric mean of the semi-axes.
    pub radius: f64,
    /// Half of the minimized sum: minus the log likelihood and log prior, without their constants.
    pub cost: f64,
    /// `ln det` of the Hessian of `cost` by the center over the radius and by the six entries of D in
    /// `A <- B exp(D) B^T`.
    pub log_det_hessian: f64,
    /// The inverse of that Hessian: the covariance.
    pub covariance: SMatrix<f64, 9, 9>,
    /// Category of most of its boxes.
    pub category: usize,
    /// Views besides `boxes` that the fit does not use any more (only [`crate::online`] forgets views).
    pub forgotten: usize,
    /// Frames in which it should be seen.
    pub visible: usize,
    /// The id whose boxes it keeps, where ids are trusted.
    #[cfg_attr(feature = "serde", serde(skip))]
    pub trusted_id: Option<u32>,
}

/// Share of a predicted box inside of the image from which on a detection is expected.
const VISIBLE_SHARE: f64 = 0.3;

impl Object {
    /// The body in an image; `None` when it is not wholly in front of the camera.
    pub(crate) fn predict(&self, camera: &Camera) -> Option<Prediction> {
        let p = &camera.matrix;
        let m = p.fixed_columns::<3>(0);
        let h = m * self.center + p.column(3);
        // Rows M B: the dual conic is their Gram matrix less h h^T.
        let rows = m * self.root;
        let gram = |i: usize, j: usize| rows.row(i).dot(&rows.row(j)) - h[i] * h[j];
        let w = gram(2, 2);
        if h.z <= 0.0 || w >= -1e-9 * h.z * h.z {
            return None;
        }
        let mut edges = [0.0; 4];
        for axis in 0..2 {
            let middle = gram(axis, 2) / w;
            let reach = (middle * middle - gram(axis, axis) / w).sqrt();
            if reach.is_nan() || reach <= 0.0 {
                return None;
            }
            (edges[axis], edges[axis + 2]) = (middle - reach, middle + reach);
        }
        edges.iter().all(|e| e.is_finite()).then_some(Prediction { edges, depth: h.z })
    }

    /// Distance of each edge of a box from the edge of the body's outline, pixels; negative where the body sticks out.
    pub(crate) fn residuals_px(&self, camera: &Camera, observation: &BoxObservation) -> [f64; 4] {
        let third = camera.matrix.row(2);
        let depth = third.columns(0, 3).transpose().dot(&self.center) + third[3];
        edge_planes(camera, observation).map(|(n, d)| (n.dot(&self.center) + d - self.root.tr_mul(&n).norm()) / depth)
    }

    /// Number of its detections, also those that are forgotten.
    pub(crate) fn views(&self) -> usize {
        self.boxes.len() + self.forgotten
    }

    /// Frames in which it should be seen, for its boxes alone: where views are forgotten, their share of these frames is too.
    pub(crate) fn visible_beside_boxes(&self) -> usize {
        if self.forgotten == 0 {
            return self.visible;
        }
        (self.visible as f64 * self.boxes.len() as f64 / self.views() as f64).round() as usize
    }

    /// Length of the longest column of the root: the longest semi-axis.
    pub(crate) fn longest_semi_axis(&self) -> f64 {
        (0..3).map(|i| self.root.column(i).norm()).fold(0.0, f64::max)
    }

    /// Frames of the boxes, ascending.
    pub(crate) fn frames<'a>(&'a self, observations: &'a Observations) -> impl Iterator<Item = usize> + 'a {
        self.boxes.iter().map(|&i| observations.boxes[i as usize].frame)
    }
}

/// Whether a detection of a predicted box is expected: enough of it is inside of the image, and it is large enough.
pub(crate) fn is_visible(prediction: &Prediction, camera: &Camera, least_half_size: f64) -> bool {
    let [x0, y0, x1, y1] = prediction.edges;
    let [w, h] = prediction.size();
    let inside = (x1.min(camera.size.x) - x0.max(0.0)).max(0.0) * (y1.min(camera.size.y) - y0.max(0.0)).max(0.0);
    inside > VISIBLE_SHARE * w * h && 0.25 * (w + h) >= least_half_size
}

/// The planes through the edges of a box, `n.X + d` positive inside and in pixels times depth.
pub(crate) fn edge_planes(camera: &Camera, observation: &BoxObservation) -> [(Vector3<f64>, f64); 4] {
    std::array::from_fn(|edge| edge_plane(camera, edge, observation.edges[edge]))
}

/// The plane through the left, top, right or bottom edge of a box that is at some pixel.
pub(crate) fn edge_plane(camera: &Camera, edge: usize, at: f64) -> (Vector3<f64>, f64) {
    let p = &camera.matrix;
    let (axis, sign) = (edge % 2, if edge < 2 { 1.0 } else { -1.0 });
    let entry = |j: usize| sign * (p[(axis, j)] - at * p[(2, j)]);
    (Vector3::new(entry(0), entry(1), entry(2)), entry(3))
}
