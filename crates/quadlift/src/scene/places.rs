//! The places from which a scene is seen, in the order of its frames' times and names, whatever that of the file: neighbors in time have
//! common errors, and sums depend on their order in the last digits.
//!
//! Frames from one place, such as those of a camera that waits or a frame that is stored twice, are one: copies have no parallax: any two
//! boxes from one place agree on an object, its evidence would grow with every copy, and errors that copies have in common would look
//! small. The frames of a place are therefore one frame, with the medians of the boxes that are seen there.
//!
//! Association and localization use other detections, and trust ids in other cases: each makes its own.

use nalgebra::{Matrix3x4, Vector2, Vector3};

use super::Scene;
use super::frame_names::natural_places;
use super::parts::{Detection, Frame};
use super::points::PointObservation;
use crate::geometry::BoundingBox;
use crate::geometry::point_tree::PointTree;
use crate::optimize::matching::{Pair, greedy_pairs};
use crate::optimize::median::quantile;
use crate::sorting::StableSort;

/// Two frames are from one place if nothing moves by more than this between their images, pixels: less than a shift of a frame that
/// is worth to be subtracted twice (a convention).
pub(crate) const MAX_MOTION_PX: f64 = 0.5;

/// Overlap of boxes of one thing from one place: half, as usual (edges with errors of 10 % of the half size overlap by .75).
pub(crate) const MIN_OVERLAP: f64 = 0.5;

/// A box of a place is of a thing if it is there in this share of the frames from there; a false one is not (a convention).
pub(crate) const MIN_SEEN: f64 = 1.0 / 3.0;

/// Before there are objects nothing is assumed to be nearer than this, relative to the extent of the cameras (a convention; nearer
/// objects move, and do more so between other frames).
const MIN_DISTANCE: f64 = 0.1;

/// Two centers are one if they differ by less: relative to the distance from the origin, rounding alone.
pub(crate) const MAX_ROUNDING: f64 = 1e-9;

/// Things that are seen from a place, at most: false boxes come with every frame.
const MAX_THINGS: usize = 2000;

/// By how many pixels corners of an image of this size move between two cameras (world to pixels) in one place.
pub(crate) fn turn_px(a: &Matrix3x4<f64>, b: &Matrix3x4<f64>, size: &Vector2<f64>) -> f64 {
    let Some(back) = a.fixed_columns::<3>(0).try_inverse() else { return f64::INFINITY };
    let map = b.fixed_columns::<3>(0) * back;
    let corners = [[0.0, 0.0], [size.x, 0.0], [0.0, size.y], [size.x, size.y]];
    let moved = corners.map(|[x, y]| {
        let to = map * Vector3::new(x, y, 1.0);
        if to.z > 0.0 { Vector2::new(to.x / to.z - x, to.y / to.z - y).norm() } else { f64::INFINITY }
    });
    moved.into_iter().fold(0.0, f64::max)
}

/// A scene whose frames are from different places, and in their own order.
#[derive(Debug)]
pub(crate) struct Places {
    /// The first frame of each place, with the medians of the boxes that are seen there.
    pub scene: Scene,
    /// The given detections that each detection of `scene` stands for, in the order of their frames.
    pub copies: Vec<Vec<usize>>,
    /// The given frames that each frame of `scene` stands for, in their order.
    pub frames: Vec<Vec<usize>>,
}

impl Places {
    /// The scene of these detections with one frame for each place; with `trusts_ids` only those with the same id are one. `None` if
    /// nothing is seen twice from a place, and the frames are in their order.
    pub(crate) fn of(scene: &Scene, detections: &[usize], trusts_ids: bool) -> Option<Self> {
        let mut by_frame: Vec<Vec<usize>> = vec![Vec::new(); scene.frames.len()];
        for &detection in detections {
            by_frame[scene.detections[detection].frame_index as usize].push(detection);
        }
        let things_of = |frames: &[Vec<usize>]| -> Vec<(u32, Seen)> {
            let of_place = |(place, frames): (usize, &Vec<usize>)| {
                let boxes: Vec<&[usize]> = frames.iter().map(|&frame| by_frame[frame].as_slice()).collect();
                seen(scene, &boxes, trusts_ids).into_iter().map(move |thing| (place as u32, thing))
            };
            frames.iter().enumerate().flat_map(of_place).collect()
        };
        let order = order_of_frames(&scene.frames);
        let mut frames = by_place(scene, &order);
        let mut things = things_of(&frames);
        if things.iter().all(|(_, thing)| thing.copies.len() == 1) {
            if order.is_sorted() {
                return None;
            }
            frames = order.into_iter().map(|frame| vec![frame]).collect();
            things = things_of(&frames);
        }
        things.stable_sort_by_key(|(_, thing)| thing.copies[0]);
        let mut place_of: Vec<Option<u32>> = vec![None; scene.frames.len()];
        frames.iter().zip(0..).for_each(|(frames, place)| place_of[frames[0]] = Some(place));
        let mut parts = scene.clone().into_parts();
        parts.frames = frames.iter().map(|frames| scene.frames[frames[0]].clone()).collect();
        parts.detections = things.iter().map(|(frame, thing)| thing.detection(scene, *frame)).collect();
        for point in &mut parts.points {
            let placed = |seen: &PointObservation| {
                Some(PointObservation { frame_index: place_of[seen.frame_index as usize]?, ..*seen })
            };
            point.observations = point.observations.iter().filter_map(placed).collect();
            point.observations.stable_sort_by_key(|seen| seen.frame_index);
        }
        let copies = things.into_iter().map(|(_, thing)| thing.copies).collect();
        Some(Self { scene: Scene(parts), copies, frames })
    }
}

/// Frames in the order of their times and cameras, others in that of their names, in which numbers count as numbers.
fn order_of_frames(frames: &[Frame]) -> Vec<usize> {
    let ids: Vec<&str> = frames.iter().map(|frame| frame.id.as_str()).collect();
    let names = natural_places(&ids);
    let time = |frame: &Frame| frame.rig.map(|rig| (rig.time_step, rig.camera));
    let mut order: Vec<usize> = (0..frames.len()).collect();
    order.stable_sort_by_key(|&index| (time(&frames[index]), names[index]));
    order
}

/// A thing that is seen from a place.
struct Seen {
    copies: Vec<usize>,
    /// The sums of the edges of its boxes.
    sum: [f64; 4],
    measured: usize,
}

impl Seen {
    fn new(scene: &Scene, detection: usize) -> Self {
        let mut new = Self { copies: Vec::new(), sum: [0.0; 4], measured: 0 };
        new.add(scene, detection);
        new
    }

    fn add(&mut self, scene: &Scene, detection: usize) {
        self.copies.push(detection);
        if let Some(found) = scene.detections[detection].measured_box() {
            self.measured += 1;
            for (sum, edge) in self.sum.iter_mut().zip(found.edges()) {
                *sum += edge;
            }
        }
    }

    fn mean(&self) -> Option<BoundingBox> {
        BoundingBox::new(self.sum.map(|sum| sum / self.measured as f64)).ok()
    }

    /// The medians of the edges of its boxes: one wrong box among them changes little.
    fn median(&self, scene: &Scene) -> Option<BoundingBox> {
        let boxes: Vec<[f64; 4]> =
            self.copies.iter().filter_map(|&copy| Some(scene.detections[copy].bounding_box?.edges())).collect();
        let of_edge = |edge: usize| quantile(&mut boxes.iter().map(|edges| edges[edge]).collect::<Vec<f64>>(), 0.5);
        let [left, top, right, bottom] = [0, 1, 2, 3].map(of_edge);
        BoundingBox::new([left?, top?, right?, bottom?]).ok()
    }

    /// The first copy as a detection of a frame, with the median box.
    fn detection(&self, scene: &Scene, frame_index: u32) -> Detection {
        let first = &scene.detections[self.copies[0]];
        let bounding_box = first.bounding_box.and_then(|_| self.median(scene));
        Detection { frame_index, bounding_box, ..first.clone() }
    }
}

/// The frames of each place, in this order of all frames.
fn by_place(scene: &Scene, order: &[usize]) -> Vec<Vec<usize>> {
    let frames: Vec<&Frame> = order.iter().map(|&frame| &scene.frames[frame]).collect();
    let centers: Vec<_> = frames.iter().map(|f| f.projection.center_in_world().map(|c| c.coords)).collect();
    let known = || centers.iter().flatten().copied();
    let bounds = known().reduce(|a, b| a.inf(&b)).zip(known().reduce(|a, b| a.sup(&b)));
    let nearest = MIN_DISTANCE * bounds.map_or(0.0, |(low, high)| (high - low).norm());
    let tree = PointTree::new(centers.iter().map(|center| center.unwrap_or_default()).collect());
    let size = |frame: &Frame| frame.image_size.unwrap_or_else(|| Vector2::repeat(frame.projection.focal_length()));
    let mut place_of: Vec<usize> = Vec::with_capacity(frames.len());
    let mut places: Vec<Vec<usize>> = Vec::new();
    // The number in the order of the first frame of each place.
    let mut first: Vec<usize> = Vec::new();
    for (index, (frame, center)) in frames.iter().zip(&centers).enumerate() {
        let place = center.and_then(|center| {
            let tolerance =
                (MAX_MOTION_PX * nearest / frame.projection.focal_length()).max(MAX_ROUNDING * (1.0 + center.norm()));
            let is_same = |place: &usize| {
                let known = frames[first[*place]];
                let turn = || turn_px(known.projection.matrix(), frame.projection.matrix(), &size(frame));
                size(known) == size(frame)
                    && centers[first[*place]].is_some_and(|known| (known - center).norm() <= tolerance)
                    && turn() <= MAX_MOTION_PX
            };
            // A camera that waits: the place of the frame before.
            place_of.last().copied().filter(is_same).or_else(|| {
                let near = tree.within(&center, tolerance).into_iter().map(|other| other as usize);
                near.filter_map(|other| first.binary_search(&other).ok()).find(is_same)
            })
        });
        place_of.push(place.unwrap_or(places.len()));
        match place {
            Some(place) => places[place].push(order[index]),
            None => {
                places.push(vec![order[index]]);
                first.push(index);
            }
        }
    }
    places
}

/// The things that are seen from a place, in frames with these detections.
fn seen(scene: &Scene, frames: &[&[usize]], trusts_ids: bool) -> Vec<Seen> {
    let trusted = |detection: usize| scene.detections[detection].object_index.filter(|_| trusts_ids);
    let mut known: Vec<Seen> = Vec::new();
    for detections in frames {
        let mut pairs = Vec::new();
        for (thing, seen) in known.iter().enumerate() {
            for (index, &detection) in detections.iter().enumerate() {
                let (first, own) = (seen.copies[0], trusted(detection));
                let overlap = match own {
                    Some(_) if own == trusted(first) => 1.0,
                    None if trusted(first).is_none() => overlap(scene, seen, detection),
                    _ => 0.0,
                };
                if overlap >= MIN_OVERLAP {
                    pairs.push(Pair { row: thing as u32, column: index as u32, gain: overlap });
                }
            }
        }
        let mut is_known = vec![false; detections.len()];
        for Pair { row, column, .. } in greedy_pairs(&pairs).into_iter().map(|k| pairs[k]) {
            is_known[column as usize] = true;
            known[row as usize].add(scene, detections[column as usize]);
        }
        let new = detections
            .iter()
            .zip(&is_known)
            .filter(|&(&d, &is_known)| !is_known && (known.len() < MAX_THINGS || trusted(d).is_some()));
        let new: Vec<Seen> = new.map(|(&detection, _)| Seen::new(scene, detection)).collect();
        known.extend(new);
    }
    let least = MIN_SEEN * frames.len() as f64;
    known.retain(|seen| seen.copies.len() as f64 >= least || trusted(seen.copies[0]).is_some());
    known
}

/// Overlap of a detection and a thing of its category.
fn overlap(scene: &Scene, seen: &Seen, detection: usize) -> f64 {
    let (own, first) = (&scene.detections[detection], &scene.detections[seen.copies[0]]);
    if own.category_index != first.category_index {
        return 0.0;
    }
    seen.mean().zip(own.measured_box()).map_or(0.0, |(mean, own)| mean.iou(&own))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::association::test_scenes::{once, repeated};
    use crate::synthetic::SyntheticIds;

    #[test]
    fn frames_from_different_places_stay_as_they_are() {
        let scene = once(SyntheticIds::Absent).scene;
        assert!(Places::of(&scene, &[0, 1], false).is_none());
    }

    #[test]
    fn a_box_that_comes_and_goes_is_no_thing_of_its_place() {
        let mut scene = repeated(&once(SyntheticIds::Absent).scene, 10);
        let all = scene.detections.len();
        let shown_once = BoundingBox::new([1.0, 1.0, 20.0, 20.0]).unwrap();
        let new = Detection { frame_index: 3, bounding_box: Some(shown_once), ..scene.detections[0].clone() };
        scene.edit(|parts| parts.detections.push(new)).unwrap();
        let detections: Vec<usize> = (0..scene.detections.len()).collect();
        let places = Places::of(&scene, &detections, false).unwrap();
        assert_eq!((places.scene.frames.len(), places.scene.detections.len()), (6, all / 10));
        assert!(places.copies.iter().all(|copies| copies.len() == 10));
    }

    #[test]
    fn trusted_ids_are_things_of_their_own() {
        let mut scene = repeated(&once(SyntheticIds::True).scene, 4);
        // Two things change their places in one copy.
        scene
            .edit(|parts| {
                let in_frame: Vec<usize> =
                    (0..parts.detections.len()).filter(|&d| parts.detections[d].frame_index == 1).collect();
                let (a, b) = (in_frame[0], in_frame[1]);
                let box_of_a = parts.detections[a].bounding_box;
                parts.detections[a].bounding_box = parts.detections[b].bounding_box;
                parts.detections[b].bounding_box = box_of_a;
            })
            .unwrap();
        let detections: Vec<usize> = (0..scene.detections.len()).collect();
        let places = Places::of(&scene, &detections, true).unwrap();
        for copies in &places.copies {
            assert_eq!(copies.len(), 4);
            let id = scene.detections[copies[0]].object_index;
            assert!(copies.iter().all(|&copy| scene.detections[copy].object_index == id));
        }
    }

    #[test]
    fn frames_and_observations_of_points_are_in_the_order_of_the_names() {
        let mut scene = once(SyntheticIds::True).scene;
        let names: Vec<String> = scene.frames.iter().map(|frame| frame.id.clone()).collect();
        scene
            .edit(|parts| {
                let last = parts.frames.len() as u32 - 1;
                parts.frames.reverse();
                parts.detections.iter_mut().for_each(|d| d.frame_index = last - d.frame_index);
                let seen = |frame_index| PointObservation { frame_index, pixel: Vector2::zeros(), stretch: 1.0 };
                let observations = vec![seen(0), seen(2)];
                parts.points.push(crate::scene::TrackedPoint { position: Default::default(), observations });
            })
            .unwrap();
        let detections: Vec<usize> = (0..scene.detections.len()).collect();
        let places = Places::of(&scene, &detections, true).unwrap();
        assert_eq!(places.scene.frames.iter().map(|frame| frame.id.clone()).collect::<Vec<_>>(), names);
        assert_eq!(places.frames, [[5], [4], [3], [2], [1], [0]]);
        assert_eq!(places.copies, detections.iter().map(|&detection| vec![detection]).collect::<Vec<_>>());
        let observed: Vec<u32> = places.scene.points[0].observations.iter().map(|seen| seen.frame_index).collect();
        assert_eq!(observed, [3, 5]);
        assert!(Scene::from_parts(places.scene.into_parts()).is_ok());
    }
}
