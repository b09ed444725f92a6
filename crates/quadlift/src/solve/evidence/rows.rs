//! The tangent planes of the boxes of one object, in its own frame.
//!
//! Each edge of a box gives a plane through the camera that touches the body: with normal n and offset d (positive on the
//! side of the body) and the support function h, `n . c + d - h(n) = 0`. Planes are divided by the depth of the frame's origin,
//! the half size s of the box and `f(s)`, `f^2 = (1 + (s_0 / s)^2) / 2`, so that a residual is the error of an edge in half
//! sizes, and small boxes have larger errors. The origin is the center of the first sphere ([`super::spheres`]), the unit its
//! radius; the axes are those of the world.

use nalgebra::{Point3, Vector3};

use super::lanes::Lanes;
use super::spheres::{Sphere, agreeing_spheres};
use crate::geometry::edge_plane;
use crate::scene::View;

/// The planes of one view.
#[derive(Debug, Clone)]
pub(super) struct ViewRows {
    /// Components of the normals.
    pub normal: [Lanes; 3],
    pub offset: Lanes,
    /// Lengths of the normals.
    pub length: Lanes,
    /// The depth of a point x is `1 + depth_slope . x` times that of the origin.
    pub depth_slope: [f64; 3],
    /// Edges at the image border, which only bound the body from inside.
    pub truncated: [bool; 4],
    /// Edges that another box probably hides: they have a noise level of their own.
    pub occluded: [bool; 4],
    /// One for occluded edges.
    occluded_lanes: Lanes,
    /// Number of edges with two sides: not occluded, occluded.
    pub two_sided: [u8; 2],
    /// `f(s)`.
    pub size_factor: f64,
    /// Index of the view among those of the object.
    pub view: usize,
    /// Index of its frame.
    pub frame: usize,
}

impl ViewRows {
    /// Noise group of an edge.
    pub(super) fn group(&self, edge: usize) -> usize {
        usize::from(self.occluded[edge])
    }

    /// Standard deviations of the edges under these noise levels.
    #[inline(always)]
    pub(super) fn sd(&self, noise: &[f64; 2]) -> Lanes {
        Lanes::splat(noise[0]) + self.occluded_lanes * (noise[1] - noise[0])
    }

    /// The factor from residuals at the origin to residuals at `center`.
    #[inline(always)]
    pub(super) fn inverse_depth(&self, center: &[f64; 3]) -> f64 {
        let m = &self.depth_slope;
        1.0 / (1.0 + m[0] * center[0] + m[1] * center[1] + m[2] * center[2]).max(MIN_DEPTH)
    }

    /// The normal of one edge.
    pub(super) fn normal_of(&self, edge: usize) -> Vector3<f64> {
        Vector3::from_fn(|k, _| self.normal[k].0[edge])
    }
}

/// Depth in units of that of the frame's origin below which it no longer falls: a body that passes through the camera.
const MIN_DEPTH: f64 = 0.02;

/// Depth in radii below which a view does not see the first sphere.
const MIN_RADII: f64 = 0.05;

/// The planes of one object.
#[derive(Debug, Clone)]
pub(super) struct Rows {
    /// The views in the order of their frames.
    pub views: Vec<ViewRows>,
    /// Origin of the frame in the world.
    pub origin: Point3<f64>,
    /// Unit of the frame in world units.
    pub unit: f64,
    /// Spheres to start from in this frame, the most probable first.
    pub starts: Vec<Sphere>,
}

impl Rows {
    /// Prepares the views of an object. `pixel_noise_size` is the half size at which the constant part of the noise of an edge
    /// equals the part that grows with the size. `None` where fewer than two boxes show the same place in front of their cameras.
    pub(super) fn new(views: &[View], pixel_noise_size: f64) -> Option<Self> {
        let boxes: Vec<BoxPlanes> = (0..views.len()).filter_map(|index| BoxPlanes::new(&views[index], index)).collect();
        let mut boxes = boxes;
        boxes.sort_by(|a, b| a.order().partial_cmp(&b.order()).unwrap_or(std::cmp::Ordering::Equal));
        let spheres = agreeing_spheres(&boxes);
        let first = *spheres.first()?;
        let rows: Vec<ViewRows> = boxes.iter().filter_map(|planes| planes.rows(&first, pixel_noise_size)).collect();
        if rows.len() < 2 {
            return None;
        }
        let starts = spheres.iter().map(|sphere| Sphere {
            center: (sphere.center - first.center) / first.radius,
            radius: sphere.radius / first.radius,
            ..*sphere
        });
        Some(Self { views: rows, origin: first.center.into(), unit: first.radius, starts: starts.collect() })
    }
}

/// The planes of one box in the world.
pub(super) struct BoxPlanes {
    pub normal: [Vector3<f64>; 4],
    pub offset: [f64; 4],
    pub truncated: [bool; 4],
    occluded: [bool; 4],
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
    view: usize,
    frame: usize,
}

impl BoxPlanes {
    fn new(view: &View, index: usize) -> Option<Self> {
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
    fn order(&self) -> (usize, [f64; 4]) {
        (self.frame, self.edges)
    }

    /// Depth of a point.
    pub(super) fn depth(&self, point: &Vector3<f64>) -> f64 {
        self.axis.dot(point) + self.depth_offset
    }

    /// The planes in the frame of a sphere, unless that is not in front of the camera.
    fn rows(&self, frame: &Sphere, pixel_noise_size: f64) -> Option<ViewRows> {
        let depth = self.depth(&frame.center);
        if depth.is_nan() || depth <= MIN_RADII * frame.radius {
            return None;
        }
        let relative = pixel_noise_size / self.half_size;
        let size_factor = (0.5 * (1.0 + relative * relative)).sqrt();
        let scale = 1.0 / (depth * self.half_size * size_factor);
        let at_origin = |edge: usize| (self.normal[edge].dot(&frame.center) + self.offset[edge]) * scale;
        let scaled = scale * frame.radius;
        let mut two_sided = [0; 2];
        for edge in (0..4).filter(|&edge| !self.truncated[edge]) {
            two_sided[usize::from(self.occluded[edge])] += 1;
        }
        Some(ViewRows {
            normal: std::array::from_fn(|k| Lanes(std::array::from_fn(|edge| self.normal[edge][k] * scaled))),
            offset: Lanes(std::array::from_fn(at_origin)),
            length: Lanes(std::array::from_fn(|edge| self.normal[edge].norm() * scaled)),
            depth_slope: (self.axis * (frame.radius / depth)).into(),
            truncated: self.truncated,
            occluded: self.occluded,
            occluded_lanes: Lanes(self.occluded.map(f64::from)),
            two_sided,
            size_factor,
            view: self.view,
            frame: self.frame,
        })
    }
}
