//! An image's boxes in the coordinates of its camera, and which objects of the map they may show.

use nalgebra::{Vector2, Vector3};

use super::{CameraHeight, Gravity, LandmarkMap, LocateOptions, Query};
use crate::geometry::rigid::Pose;
use crate::optimize::median::median;
use crate::scene::{BORDER_TOLERANCE_PX, edges_at_border};

/// By how much a depth may lie outside of the range that the size of the box and of the body allow: errors of both.
const SLACK: f64 = 1.25;

/// Poses are the same when their rotations differ by less than this, radians ...
const SAME_ANGLE: f64 = 0.05;
/// ... and their centers by less than this share of the median distance of the objects.
const SAME_SHARE: f64 = 0.05;

/// A box, in coordinates (X / Z, Y / Z) of the camera's frame: left, top, right, bottom.
#[derive(Debug, Clone)]
pub(super) struct MeasuredBox {
    pub edges: [f64; 4],
    /// Standard deviation of an edge.
    pub sd: [f64; 4],
    /// Whether the image ends there.
    pub cut_off: [bool; 4],
    /// Logarithm of the density of false boxes of its size and category.
    pub log_clutter: f64,
}

impl MeasuredBox {
    pub(super) fn center(&self) -> Vector2<f64> {
        Vector2::new(self.edges[0] + self.edges[2], self.edges[1] + self.edges[3]) * 0.5
    }

    pub(super) fn half_size(&self) -> Vector2<f64> {
        Vector2::new(self.edges[2] - self.edges[0], self.edges[3] - self.edges[1]) * 0.5
    }
}

/// A box that may show a landmark, and how far that is then.
#[derive(Debug, Clone)]
pub(super) struct Candidate {
    pub query_box: usize,
    pub landmark: usize,
    /// Through the center of the box, with Z = 1.
    pub ray: Vector3<f64>,
    /// Smallest, probable, and largest depth.
    pub depths: [f64; 3],
}

/// An image, prepared.
#[derive(Debug)]
pub(super) struct PreparedQuery<'a> {
    pub map: &'a LandmarkMap,
    pub boxes: Vec<MeasuredBox>,
    /// Ordered by their boxes.
    pub candidates: Vec<Candidate>,
    /// Which landmarks each box may show by its category, also where it is cut off.
    pub alike: Vec<Vec<usize>>,
    pub gravity: Option<Gravity>,
    pub height: Option<CameraHeight>,
    /// Left, top, right and bottom of the image.
    pub image: Option<[f64; 4]>,
    /// Half size (geometric mean) of the smallest box.
    pub smallest: f64,
    /// Median depth of the candidates.
    distance: f64,
}

impl<'a> PreparedQuery<'a> {
    pub(super) fn new(map: &'a LandmarkMap, query: &Query, options: &LocateOptions) -> Self {
        let k = &query.intrinsics;
        let normalized = |x: f64, axis: usize| if axis == 0 { (x - k.cx) / k.fx } else { (x - k.cy) / k.fy };
        let focal = [k.fx, k.fy];
        let image = query
            .image_size
            .map(|size| [normalized(0.0, 0), normalized(0.0, 1), normalized(size.x, 0), normalized(size.y, 1)]);
        // Where the image has no size its boxes say about how large it is.
        let area = image.map_or_else(
            || {
                let all = || query.boxes.iter().map(|b| &b.bounding_box);
                let reach =
                    |of: fn(&crate::geometry::BoundingBox) -> f64| all().map(of).fold(f64::NEG_INFINITY, f64::max);
                let width = (reach(|b| b.x1) + reach(|b| -b.x0)) / k.fx;
                let height = (reach(|b| b.y1) + reach(|b| -b.y0)) / k.fy;
                (width * height).max(1e-6)
            },
            |i| (i[2] - i[0]) * (i[3] - i[1]),
        );
        let boxes: Vec<MeasuredBox> = query
            .boxes
            .iter()
            .map(|query_box| {
                let b = &query_box.bounding_box;
                let pixels = [b.x0, b.y0, b.x1, b.y1];
                let sd = (options.edge_noise * b.mean_half_size()).hypot(options.edge_noise_px);
                let in_image = query_box.box_in_image.as_ref().unwrap_or(b);
                let cut_off = edges_at_border(in_image, query.image_size, BORDER_TOLERANCE_PX);
                let edges = std::array::from_fn(|e| normalized(pixels[e], e % 2));
                let size = (b.x1 - b.x0) / k.fx * (b.y1 - b.y0) / k.fy;
                // Perhaps all boxes of the category are false: the image may be of another place.
                let alike = query.boxes.iter().filter(|other| other.category == query_box.category).count() as f64;
                MeasuredBox {
                    edges,
                    sd: std::array::from_fn(|e| sd / focal[e % 2]),
                    cut_off,
                    log_clutter: (alike / (area * size * LOG_SIZES * LOG_SIZES)).ln(),
                }
            })
            .collect();
        let alike: Vec<Vec<usize>> = query
            .boxes
            .iter()
            .map(|query_box| {
                let may_be = |landmark: usize| map.landmarks[landmark].may_be(query_box.category.as_deref());
                (0..map.landmarks.len()).filter(|&landmark| may_be(landmark)).collect()
            })
            .collect();
        let mut candidates = Vec::new();
        for (index, measured) in boxes.iter().enumerate() {
            if measured.cut_off.contains(&true) {
                continue;
            }
            candidates.extend(alike[index].iter().filter_map(|&landmark| candidate(map, index, landmark, measured)));
        }
        let size = |b: &MeasuredBox| (b.half_size().x * b.half_size().y).sqrt();
        let smallest = boxes.iter().map(size).fold(f64::INFINITY, f64::min);
        let distance = median_depth(&candidates);
        Self {
            map,
            distance,
            boxes,
            candidates,
            alike,
            gravity: options.gravity,
            height: options.height,
            image,
            smallest,
        }
    }

    /// Number of boxes that may show something.
    pub(super) fn boxes_with_candidates(&self) -> usize {
        let mut boxes: Vec<usize> = self.candidates.iter().map(|candidate| candidate.query_box).collect();
        boxes.dedup();
        boxes.len()
    }

    /// Whether two poses differ by less than what matters.
    pub(super) fn same_pose(&self, a: &Pose, b: &Pose) -> bool {
        a.angle_to(b) < SAME_ANGLE && (a.center() - b.center()).norm() < SAME_SHARE * self.distance
    }
}

/// The median depth of the candidates.
fn median_depth(candidates: &[Candidate]) -> f64 {
    median(&mut candidates.iter().map(|candidate| candidate.depths[1]).collect::<Vec<f64>>()).unwrap_or(0.0)
}

/// Logarithm of the ratio of the largest to the smallest width (and height) of false boxes.
const LOG_SIZES: f64 = 4.0;

/// Of an ellipsoid at depth Z the squared half sizes of its box add up to the trace of its shape without the variance along the
/// viewing direction, over Z squared (near the optical axis, seen from afar): whichever way it is turned, that lies between the sums of the two
/// smaller and the two larger squared semi-axes. Other bodies reach about as far as their closest ellipsoids.
fn candidate(map: &LandmarkMap, index: usize, landmark: usize, measured: &MeasuredBox) -> Option<Candidate> {
    let squares = map.squared_axes[landmark];
    let size = measured.half_size().norm();
    let depth = |square: f64| square.sqrt() / size;
    let depths = [
        depth(squares[0] + squares[1]) / SLACK,
        depth(2.0 / 3.0 * squares.iter().sum::<f64>()),
        depth(squares[1] + squares[2]) * SLACK,
    ];
    let center = measured.center();
    let usable = depths.iter().all(|d| d.is_finite() && *d > 0.0) && map.center(landmark).iter().all(|x| x.is_finite());
    usable.then(|| Candidate { query_box: index, landmark, ray: Vector3::new(center.x, center.y, 1.0), depths })
}

impl LandmarkMap {
    pub(super) fn center(&self, landmark: usize) -> Vector3<f64> {
        self.landmarks[landmark].body.center.coords
    }

    pub(super) fn extent(&self) -> f64 {
        self.extent
    }
}
