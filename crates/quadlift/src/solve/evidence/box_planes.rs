//! The planes of one box in the world: what the rows of a view are made of.

use nalgebra::Vector3;

use crate::geometry::edge_plane;
use crate::scene::View;

/// The planes of one box in the world.
pub(super) struct BoxPlanes {
    pub normal: [Vector3<f64>; 4],
    pub offset: [f64; 4],
    pub truncated: [bool; 4],
    pub occluded: [bool; 4],
    /// Mean half size of the box, pixels.
    pub half_size: f64,
    /// Focal length, pixels.
    pub focal_length: f64,
    /// Unit viewing axis and offset: the depth of a point x is `axis . x + depth_offset`.
    pub axis: Vector3<f64>,
    pub depth_offset: f64,
    /// The two planes through the center of the box.
    pub middle: [(Vector3<f64>, f64); 2],
    /// Direction from the camera through the center of the box.
    pub ray: Vector3<f64>,
    pub camera: Vector3<f64>,
    edges: [f64; 4],
    /// Index of the view among those of the object, and of its frame.
    pub view: usize,
    pub frame: usize,
}

impl BoxPlanes {
    /// Of a view with a box; `None` where its numbers make no planes.
    pub(super) fn new(view: &View, index: usize) -> Option<Self> {
        let bounding_box = view.bounding_box?;
        let p = view.projection.matrix();
        let p = p / p.fixed_view::<1, 3>(2, 0).norm();
        let planes: [_; 4] = std::array::from_fn(|edge| edge_plane(&p, &bounding_box, edge));
        let center = bounding_box.center();
        let middle = [0, 1].map(|k| {
            let plane = p.row(k) - p.row(2) * center[k];
            (plane.fixed_columns::<3>(0).transpose(), plane[3])
        });
        let axis = p.fixed_view::<1, 3>(2, 0).transpose();
        let ray = middle[0].0.cross(&middle[1].0).try_normalize(0.0)?;
        let camera = view.projection.center_in_world()?;
        let half_size = bounding_box.mean_half_size();
        Some(Self {
            normal: planes.map(|plane| plane.xyz()),
            offset: planes.map(|plane| plane.w),
            truncated: view.cut_off,
            occluded: view.occluded_edges,
            half_size,
            focal_length: view.projection.focal_length(),
            axis,
            depth_offset: p[(2, 3)],
            middle,
            ray: if ray.dot(&axis) < 0.0 { -ray } else { ray },
            camera: camera.coords,
            edges: bounding_box.edges(),
            view: index,
            frame: view.frame_index,
        })
        .filter(|planes| half_size > 0.0 && planes.normal.iter().all(|n| n.iter().all(|x| x.is_finite())))
    }

    /// By frame, then by place in the image: the same whatever the order of the detections.
    pub(super) fn order(&self) -> (usize, [f64; 4]) {
        (self.frame, self.edges)
    }

    /// Depth of a point.
    pub(super) fn depth(&self, point: &Vector3<f64>) -> f64 {
        self.axis.dot(point) + self.depth_offset
    }
}
