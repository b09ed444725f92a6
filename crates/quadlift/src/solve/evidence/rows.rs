//! The tangent planes of the boxes of one object, in its own frame.
//!
//! Each edge of a box gives a plane through the camera that touches the body: with normal n and offset d (positive on the
//! side of the body) and the support function h, `n . c + d - h(n) = 0`. Planes are divided by the depth of the frame's origin,
//! the half size s of the box and `f(s)`, `f^2 = (1 + (s_0 / s)^2) / 2`, so that a residual is the error of an edge in half
//! sizes, and small boxes have larger errors. Where both opposite edges are free, their residuals are replaced by their difference and sum
//! over the root of 2, the shift and the size of the box, which have noise levels of their own: poses that are a little wrong shift boxes,
//! and leave their sizes. The origin is the center of the first sphere ([`super::spheres`]), the unit its
//! radius; the axes are those of the world.

use std::f64::consts::FRAC_1_SQRT_2;

use nalgebra::{Point3, Vector3};

use super::box_planes::BoxPlanes;
use super::conditions::Conditions;
use super::lanes::Lanes;
use super::spheres::{Sphere, agreeing_spheres};
use crate::scene::View;

/// Factors of an edge and of the opposite one in a residual.
#[derive(Debug, Clone, Copy)]
pub(super) struct Pairing {
    own: Lanes,
    opposite: Lanes,
}

impl Pairing {
    /// What belongs to edges, as what belongs to residuals.
    #[inline(always)]
    pub(super) fn residuals(&self, of_edges: Lanes) -> Lanes {
        of_edges * self.own + of_edges.opposite() * self.opposite
    }

    /// The same with factors on the residuals.
    #[inline(always)]
    pub(super) fn times(&self, factors: Lanes) -> Self {
        Self { own: self.own * factors, opposite: self.opposite * factors }
    }

    /// The factors in one residual.
    pub(super) fn of(&self, residual: usize) -> [f64; 2] {
        [self.own.0[residual], self.opposite.0[residual]]
    }
}

/// The planes of one view.
#[derive(Debug, Clone)]
pub(super) struct ViewRows {
    /// Components of the normals of the edges.
    pub normal: [Lanes; 3],
    /// The same, and offsets, of the residuals.
    pub residual_normal: [Lanes; 3],
    pub residual_offset: Lanes,
    /// How edges become residuals.
    pub pairing: Pairing,
    /// One for the residuals that are shifts, minus one for sizes.
    shift: Lanes,
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

    /// Standard deviations of the residuals under these conditions.
    #[inline(always)]
    pub(super) fn sd(&self, conditions: &Conditions) -> Lanes {
        let [free, occluded] = conditions.noise;
        let correlated = Lanes::splat(1.0) + self.shift * conditions.opposite_correlation;
        correlated.sqrt() * free + self.occluded_lanes * (occluded - free)
    }

    /// Whether the edge is at the image border and the body, with this residual, reaches it: it says nothing then.
    #[inline(always)]
    pub(super) fn is_reached(&self, edge: usize, residual: f64) -> bool {
        self.truncated[edge] && residual <= 0.0
    }

    /// Pairs of edges whose shift and size are residuals.
    pub(super) fn pairs(&self) -> i32 {
        i32::from(self.shift.0[0] != 0.0) + i32::from(self.shift.0[1] != 0.0)
    }

    /// Whether a residual is a shift (1), a size (-1) or an edge (0).
    pub(super) fn shift_of(&self, residual: usize) -> f64 {
        self.shift.0[residual]
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
        let rows: Vec<ViewRows> = boxes.iter().filter_map(|planes| rows_of(planes, &first, pixel_noise_size)).collect();
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

/// The planes in the frame of a sphere, unless that is not in front of the camera.
fn rows_of(planes: &BoxPlanes, frame: &Sphere, pixel_noise_size: f64) -> Option<ViewRows> {
    let depth = planes.depth(&frame.center);
    if depth.is_nan() || depth <= MIN_RADII * frame.radius {
        return None;
    }
    let relative = pixel_noise_size / planes.half_size;
    let size_factor = (0.5 * (1.0 + relative * relative)).sqrt();
    let scale = 1.0 / (depth * planes.half_size * size_factor);
    let at_origin = |edge: usize| (planes.normal[edge].dot(&frame.center) + planes.offset[edge]) * scale;
    let scaled = scale * frame.radius;
    let mut two_sided = [0; 2];
    for edge in (0..4).filter(|&edge| !planes.truncated[edge]) {
        two_sided[usize::from(planes.occluded[edge])] += 1;
    }
    let is_free = |edge: usize| !planes.truncated[edge] && !planes.occluded[edge];
    let is_paired = |edge: usize| is_free(edge) && is_free((edge + 2) % 4);
    let shift: [f64; 4] = std::array::from_fn(|edge| match (is_paired(edge), edge < 2) {
        (false, _) => 0.0,
        (true, true) => 1.0,
        (true, false) => -1.0,
    });
    let pairing = Pairing {
        own: Lanes(shift.map(|shift| if shift == 0.0 { 1.0 } else { FRAC_1_SQRT_2 })),
        opposite: Lanes(shift.map(|shift| -shift * FRAC_1_SQRT_2)),
    };
    let normal = std::array::from_fn(|k| Lanes(std::array::from_fn(|edge| planes.normal[edge][k] * scaled)));
    Some(ViewRows {
        normal,
        residual_normal: normal.map(|n| pairing.residuals(n)),
        residual_offset: pairing.residuals(Lanes(std::array::from_fn(at_origin))),
        pairing,
        shift: Lanes(shift),
        length: Lanes(std::array::from_fn(|edge| planes.normal[edge].norm() * scaled)),
        depth_slope: (planes.axis * (frame.radius / depth)).into(),
        truncated: planes.truncated,
        occluded: planes.occluded,
        occluded_lanes: Lanes(planes.occluded.map(f64::from)),
        two_sided,
        size_factor,
        view: planes.view,
        frame: planes.frame,
    })
}
