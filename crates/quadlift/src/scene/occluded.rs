//! Box edges that are probably hidden by another detection (docs/method.md, section 2.1).

use crate::tuning::MIN_OCCLUDER_OVERLAP;
use crate::tuning::OCCLUDER_MARGIN_PX;
use nalgebra::{Unit, Vector2, Vector3};

use super::Scene;
use super::parts::Detection;
use crate::geometry::{BoundingBox, Projection};
use crate::sorting::StableSort;

/// A box reaches lower by more than this many pixels.
const LOWER_PX: f64 = 1.0;

/// Frames with more boxes than this are skipped: every pair is compared, and in such crowds all boxes overlap.
const MAX_BOXES: usize = 1000;

impl Scene {
    /// For each detection, which edges of its box (left, top, right, bottom) are probably hidden by another detection
    /// of its frame: given in [`Detection::occluded_edges`], or computed by [`occluded_edges`]. Detections that `keep`
    /// rejects neither hide nor are hidden. If the scene has `up`, cameras may be rolled: each image is rotated by the
    /// multiple of 90 degrees that brings the ground closest to its lower edge.
    pub fn occluded_edges(&self, keep: impl Fn(&Detection) -> bool) -> Vec<[bool; 4]> {
        let mut side_below = vec![BELOW; self.frames.len()];
        if let Some(up) = self.up {
            let mut down = vec![Vector2::zeros(); self.frames.len()];
            for detection in self.detections.iter().filter(|detection| keep(detection)) {
                let frame = detection.frame_index as usize;
                if let Some(b) = &detection.bounding_box {
                    down[frame] += down_in_image(&self.frames[frame].projection, &up, b);
                }
            }
            side_below = down.iter().map(side_towards).collect();
        }
        let side_below = |d: &Detection| side_below[d.frame_index as usize];
        let place = |d: &Detection| Some((d.frame_index, turned(&d.bounding_box?, side_below(d))));
        let boxes: Vec<_> = self.detections.iter().map(|d| if keep(d) { place(d) } else { None }).collect();
        let mut hidden = occluded_edges(&boxes);
        for ((hidden, detection), place) in hidden.iter_mut().zip(&self.detections).zip(&boxes) {
            *hidden = turned_back(*hidden, side_below(detection));
            if let (Some(known), Some(_)) = (detection.occluded_edges, place) {
                *hidden = known;
            }
        }
        hidden
    }
}

/// The side of an upright image that is below: the index of an edge (left, top, right, bottom).
const BELOW: usize = 3;

/// The direction in the image, a unit vector, in which a point at the center of a box moves when it is moved down; zero
/// where it does not move.
fn down_in_image(projection: &Projection, up: &Unit<Vector3<f64>>, bounding_box: &BoundingBox) -> Vector2<f64> {
    let moved = projection.matrix().fixed_columns::<3>(0) * -up.into_inner();
    // Of (x / z, y / z), times the depth, which is positive in front of the camera.
    let direction = moved.xy() - bounding_box.center() * moved.z;
    direction.try_normalize(0.0).unwrap_or_default()
}

/// The side of the image (left, top, right, bottom) that a direction points to.
fn side_towards(direction: &Vector2<f64>) -> usize {
    match direction {
        d if d.x.abs() <= d.y.abs() => {
            if d.y < 0.0 {
                1
            } else {
                BELOW
            }
        }
        d => {
            if d.x < 0.0 {
                0
            } else {
                2
            }
        }
    }
}

/// A box in the image that is turned so that this side is below.
fn turned(b: &BoundingBox, below: usize) -> BoundingBox {
    let (x0, y0, x1, y1) = match below {
        0 => (b.y0, -b.x1, b.y1, -b.x0),
        1 => (-b.x1, -b.y1, -b.x0, -b.y0),
        2 => (-b.y1, b.x0, -b.y0, b.x1),
        _ => (b.x0, b.y0, b.x1, b.y1),
    };
    BoundingBox { x0, y0, x1, y1 }
}

/// What is said of the edges (left, top, right, bottom) of a box in such an image, of those of the box itself.
fn turned_back([left, top, right, bottom]: [bool; 4], below: usize) -> [bool; 4] {
    match below {
        0 => [bottom, left, top, right],
        1 => [right, bottom, left, top],
        2 => [top, right, bottom, left],
        _ => [left, top, right, bottom],
    }
}

/// For each box with its frame, which of its edges (left, top, right, bottom) lie inside another box of the frame that
/// reaches lower in the image, and is therefore nearer if objects stand on the ground. Only left and right edges are
/// detected; invalid boxes neither hide nor are hidden.
pub fn occluded_edges<F: Ord>(boxes: &[Option<(F, BoundingBox)>]) -> Vec<[bool; 4]> {
    let mut hidden = vec![[false; 4]; boxes.len()];
    let mut places: Vec<(usize, &F, &BoundingBox)> = Vec::with_capacity(boxes.len());
    places.extend(boxes.iter().enumerate().filter_map(|(k, place)| place.as_ref().map(|(frame, b)| (k, frame, b))));
    places.stable_sort_by_key(|(_, frame, _)| *frame);
    for of_frame in places.chunk_by_mut(|a, b| a.1 == b.1).filter(|of_frame| of_frame.len() <= MAX_BOXES) {
        // From the lowest to the highest bottom edge in space, so that a box is hidden by earlier ones only.
        of_frame.stable_sort_by(|(.., a), (.., b)| b.y1.total_cmp(&a.y1));
        for (k, (index, _, far)) in of_frame.iter().enumerate() {
            for (.., near) in &of_frame[..k] {
                let overlap = far.y1.min(near.y1) - far.y0.max(near.y0);
                if near.y1 <= far.y1 + LOWER_PX || overlap < MIN_OCCLUDER_OVERLAP.get() * (far.y1 - far.y0) {
                    continue;
                }
                for (edge, x) in [(0, far.x0), (2, far.x1)] {
                    hidden[*index][edge] |=
                        near.x0 - OCCLUDER_MARGIN_PX.get() < x && x < near.x1 + OCCLUDER_MARGIN_PX.get();
                }
            }
        }
    }
    hidden
}

#[cfg(test)]
mod tests {
    use super::super::{NewDetection, SceneBuilder};
    use super::*;
    use crate::geometry::Projection;

    #[test]
    fn the_farther_box_loses_the_edge_behind_the_nearer_one() {
        let mut builder = SceneBuilder::new("test");
        let projection = Projection::from_matrix(nalgebra::Matrix3x4::identity()).unwrap();
        for frame in ["a", "b"] {
            builder.add_frame(frame, projection, None).unwrap();
        }
        let mut add = |frame, edges| {
            let bounding_box = BoundingBox::new(edges).ok();
            builder.add_detection(&NewDetection { frame, bounding_box, ..Default::default() }).unwrap();
        };
        add("a", [100.0, 50.0, 200.0, 100.0]); // far
        add("a", [180.0, 40.0, 300.0, 150.0]); // near, over the right edge of the first
        add("a", [190.0, 10.0, 260.0, 52.0]); // high above: overlaps the near one, a third of its height
        add("b", [100.0, 50.0, 200.0, 100.0]); // alone in its frame
        let mut scene = builder.build();
        let hidden = scene.occluded_edges(|_| true);
        assert_eq!(hidden[0], [false, false, true, false]);
        assert_eq!(hidden[1], [false; 4]);
        assert_eq!(hidden[2], [false; 4], "less than 30 % of its height lies beside the near box");
        assert_eq!(hidden[3], [false; 4]);
        assert_eq!(scene.occluded_edges(|_| false), vec![[false; 4]; 4]);
        scene.0.detections[0].occluded_edges = Some([true, false, false, false]);
        assert_eq!(scene.occluded_edges(|_| true)[0], [true, false, false, false], "what is known counts");
    }

    /// Cameras that look along x, upright and rolled by quarter turns: the same two edges of the same object are hidden.
    #[test]
    fn rolled_cameras_hide_the_same_edges() {
        let up = Unit::new_unchecked(Vector3::z());
        let far = BoundingBox::new([100.0, 50.0, 200.0, 100.0]).unwrap();
        let near = BoundingBox::new([180.0, 40.0, 300.0, 150.0]).unwrap();
        // Where the right edge of an upright image is after the roll: x to the right is -y of the world, y is down.
        for (below, (right, down)) in [
            (3, (-Vector3::y(), -Vector3::z())),
            (2, (-Vector3::z(), Vector3::y())),
            (1, (Vector3::y(), Vector3::z())),
            (0, (Vector3::z(), -Vector3::y())),
        ] {
            let rows = nalgebra::Matrix3::from_rows(&[right.transpose(), down.transpose(), Vector3::x().transpose()]);
            let focal = nalgebra::Matrix3::new(500.0, 0.0, 200.0, 0.0, 500.0, 100.0, 0.0, 0.0, 1.0);
            let matrix = (focal * rows).insert_column(3, 0.0);
            let projection = Projection::from_matrix(matrix).unwrap();
            let mut builder = SceneBuilder::new("test");
            builder.add_frame("a", projection, None).unwrap();
            // The boxes as this camera sees them: the inverse of the turn is that to the opposite side, or itself.
            let seen = |b: &BoundingBox| turned(b, [2, 1, 0, 3][below]);
            for b in [&far, &near] {
                let bounding_box = Some(seen(b));
                builder.add_detection(&NewDetection { frame: "a", bounding_box, ..Default::default() }).unwrap();
            }
            let mut scene = builder.build();
            scene.0.up = Some(up);
            let expected = turned_back([false, false, true, false], below);
            assert_eq!(scene.occluded_edges(|_| true), [expected, [false; 4]], "below is side {below}");
            assert_eq!(expected.iter().position(|&hidden| hidden), Some([3, 0, 1, 2][below]));
        }
    }

    #[test]
    fn turns_are_undone() {
        let b = BoundingBox { x0: 1.0, y0: 2.0, x1: 4.0, y1: 7.0 };
        let edges = |b: &BoundingBox| [b.x0.abs(), b.y0.abs(), b.x1.abs(), b.y1.abs()];
        for below in 0..4 {
            let there = turned(&b, below);
            assert!(there.x0 < there.x1 && there.y0 < there.y1);
            // Each edge keeps its coordinate, up to the sign.
            for k in 0..4 {
                let marked = turned_back(std::array::from_fn(|i| i == k), below);
                let of_box = marked.iter().position(|&edge| edge).unwrap();
                assert_eq!(edges(&there)[k], edges(&b)[of_box], "{below} {k}");
            }
        }
    }
}
