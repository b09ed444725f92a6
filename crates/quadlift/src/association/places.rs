//! Frames from one place: a camera that waits, a frame that is stored twice. However often a view is seen, it is one view.
//!
//! Copies have no parallax: any two boxes from one place agree on an object, its evidence would grow with every copy, and errors that
//! copies have in common would look small. The frames of a place are therefore one frame, with the medians of the boxes that are seen
//! there.

use nalgebra::{Matrix3, Vector2, Vector3};

use super::input::observations::Camera;
use super::input::point_tree::PointTree;
use super::options::IdPolicy;
use super::result::Association;
use super::statistics::median;
use crate::geometry::BoundingBox;
use crate::optimize::matching::{Pair, greedy_pairs};
use crate::scene::{Detection, PointObservation, Scene};
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

/// By how many pixels corners of the image move between two cameras in one place.
pub(crate) fn turn_px(a: &Camera, b: &Camera) -> f64 {
    let part = |camera: &Camera| -> Matrix3<f64> { camera.matrix.fixed_columns::<3>(0).into_owned() };
    let Some(back) = part(a).try_inverse() else { return f64::INFINITY };
    let map = part(b) * back;
    let corners = [[0.0, 0.0], [a.size.x, 0.0], [0.0, a.size.y], [a.size.x, a.size.y]];
    let moved = corners.map(|[x, y]| {
        let to = map * Vector3::new(x, y, 1.0);
        if to.z > 0.0 { Vector2::new(to.x / to.z - x, to.y / to.z - y).norm() } else { f64::INFINITY }
    });
    moved.into_iter().fold(0.0, f64::max)
}

/// A scene whose frames are from different places.
#[derive(Debug)]
pub(crate) struct Places {
    /// The first frame of each place, with the medians of the boxes that are seen there.
    pub scene: Scene,
    /// The given detections that each detection of `scene` stands for, ascending.
    pub copies: Vec<Vec<usize>>,
    /// The given frames that each frame of `scene` stands for, ascending.
    pub frames: Vec<Vec<usize>>,
}

impl Places {
    /// The scene of these detections with one frame for each place; `None` if nothing is seen twice from a place.
    pub(crate) fn of(scene: &Scene, detections: &[usize], ids: IdPolicy) -> Option<Self> {
        let places = first_frames(scene)?;
        let mut by_frame: Vec<Vec<usize>> = vec![Vec::new(); places.len()];
        for &detection in detections {
            by_frame[scene.detections[detection].frame_index as usize].push(detection);
        }
        let mut frames: Vec<Vec<usize>> = vec![Vec::new(); places.len()];
        for (frame, &place) in places.iter().enumerate() {
            frames[place].push(frame);
        }
        frames.retain(|frames| !frames.is_empty());
        let mut things = Vec::new();
        for (index, frames) in frames.iter().enumerate() {
            let boxes: Vec<&[usize]> = frames.iter().map(|&frame| by_frame[frame].as_slice()).collect();
            things.extend(seen(scene, &boxes, ids).into_iter().map(|thing| (index as u32, thing)));
        }
        if things.iter().all(|(_, thing)| thing.copies.len() == 1) {
            return None;
        }
        things.stable_sort_by_key(|(_, thing)| thing.copies[0]);
        let mut parts = scene.clone().into_parts();
        parts.frames = frames.iter().map(|frames| scene.frames[frames[0]].clone()).collect();
        parts.detections = things.iter().map(|(frame, thing)| thing.detection(scene, *frame)).collect();
        for point in &mut parts.points {
            let new_index = |frame: u32| frames.binary_search_by_key(&(frame as usize), |frames| frames[0]).ok();
            point.observations = (point.observations.iter())
                .filter_map(|seen| Some(PointObservation { frame_index: new_index(seen.frame_index)? as u32, ..*seen }))
                .collect();
        }
        let copies = things.into_iter().map(|(_, thing)| thing.copies).collect();
        Some(Self { scene: Scene(parts), copies, frames })
    }

    /// The association of the given detections; `found` is that of `scene`.
    pub(crate) fn spread(&self, mut found: Association, scene: &Scene, detections: usize) -> Association {
        let mut object_of_detection = vec![None; scene.detections.len()];
        let mut assigned = 0;
        for (copies, object) in self.copies.iter().zip(&found.object_of_detection) {
            let Some(object) = *object else { continue };
            assigned += copies.len();
            let known = &mut found.objects[object as usize];
            known.views += copies.len() - 1;
            known.expected_views += copies.len() - 1;
            for &copy in copies {
                object_of_detection[copy] = Some(object);
            }
        }
        Association { object_of_detection, clutter: detections - assigned, ..found }
    }
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
        let of_edge = |edge: usize| median(&mut boxes.iter().map(|edges| edges[edge]).collect::<Vec<f64>>());
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

/// The first frame from the place of each frame; `None` if each is its own.
fn first_frames(scene: &Scene) -> Option<Vec<usize>> {
    let centers: Vec<_> = scene.frames.iter().map(|f| f.projection.center_in_world().map(|c| c.coords)).collect();
    let known = || centers.iter().flatten();
    let low = known().copied().reduce(|a, b| a.inf(&b))?;
    let high = known().copied().reduce(|a, b| a.sup(&b))?;
    let cameras: Vec<Option<Camera>> = scene
        .frames
        .iter()
        .zip(&centers)
        .map(|(frame, center)| {
            let size = frame.image_size.unwrap_or_else(|| Vector2::repeat(frame.projection.focal_length()));
            center.map(|center| Camera::new(&frame.projection, &center, &low, size))
        })
        .collect();
    let tree = PointTree::new(centers.iter().map(|c| c.map_or_else(Vector3::zeros, |c| c - low)).collect());
    let nearest = MIN_DISTANCE * (high - low).norm();
    let mut first: Vec<usize> = (0..cameras.len()).collect();
    for (index, camera) in cameras.iter().enumerate() {
        let Some(camera) = camera else { continue };
        let tolerance =
            (MAX_MOTION_PX * nearest / camera.focal).max(MAX_ROUNDING * (1.0 + (camera.center + low).norm()));
        let is_same = |other: usize| {
            first[other] == other
                && cameras[other].as_ref().is_some_and(|known| {
                    known.size == camera.size
                        && (known.center - camera.center).norm() <= tolerance
                        && turn_px(known, camera) <= MAX_MOTION_PX
                })
        };
        // A camera that waits: the place of the frame before.
        let before = index.checked_sub(1).map(|before| first[before]).filter(|&place| is_same(place));
        let place = before.or_else(|| {
            let near = tree.within(&camera.center, tolerance).into_iter().map(|other| other as usize);
            near.filter(|&other| other < index && is_same(other)).min()
        });
        first[index] = place.unwrap_or(index);
    }
    first.iter().enumerate().any(|(index, &place)| place != index).then_some(first)
}

/// The things that are seen from a place, in frames with these detections.
fn seen(scene: &Scene, frames: &[&[usize]], ids: IdPolicy) -> Vec<Seen> {
    let trusted = |detection: usize| scene.detections[detection].object_index.filter(|_| ids == IdPolicy::Trust);
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
    use crate::association::{AssociateOptions, associate};
    use crate::metrics::pairwise_clustering_scores;
    use crate::synthetic::{Detector, Noise, Observations, SyntheticIds, SyntheticOptions, SyntheticScene, generate};

    /// Ten objects in six views.
    fn once(ids: SyntheticIds) -> SyntheticScene {
        let make = SyntheticOptions {
            objects: 10,
            views: 6,
            observations: Observations::Boxes,
            noise: vec![Noise::BoxEdges(0.03)],
            detector: Detector { misses: 0.0, false_boxes: 0.0, ..Default::default() },
            ids,
            ..Default::default()
        };
        generate(&make).unwrap()
    }

    /// The scene with every frame so many times; the copies of a frame follow it.
    fn repeated(scene: &Scene, times: usize) -> Scene {
        let mut parts = scene.clone().into_parts();
        let (frames, detections) = (std::mem::take(&mut parts.frames), std::mem::take(&mut parts.detections));
        for frame in &frames {
            for copy in 0..times {
                parts.frames.push(crate::scene::Frame { id: format!("{} {copy}", frame.id), ..frame.clone() });
            }
        }
        for detection in detections {
            for copy in 0..times {
                let frame_index = detection.frame_index * times as u32 + copy as u32;
                parts.detections.push(Detection { frame_index, ..detection.clone() });
            }
        }
        Scene::from_parts(parts).unwrap()
    }

    #[test]
    fn copies_of_frames_change_nothing_but_the_counts() {
        for ids in [SyntheticIds::Absent, SyntheticIds::True] {
            let synthetic = once(ids);
            let options = AssociateOptions::default();
            let found = associate(&synthetic.scene, &options).unwrap();
            let again = associate(&repeated(&synthetic.scene, 10), &options).unwrap();
            assert_eq!(found.objects.len(), again.objects.len());
            let copied: Vec<_> = found.object_of_detection.iter().flat_map(|&object| [object; 10]).collect();
            assert_eq!(pairwise_clustering_scores(&copied, &again.object_of_detection).f1, 1.0);
            assert_eq!(again.clutter, 10 * found.clutter);
            for (one, ten) in found.objects.iter().zip(&again.objects) {
                assert_eq!((10 * one.views, &one.id), (ten.views, &ten.id));
                assert!((one.evidence.unwrap() - ten.evidence.unwrap()).abs() < 1e-6, "{one:?} {ten:?}");
            }
        }
    }

    #[test]
    fn frames_from_different_places_stay_as_they_are() {
        let scene = once(SyntheticIds::Absent).scene;
        assert!(Places::of(&scene, &[0, 1], IdPolicy::Ignore).is_none());
    }

    #[test]
    fn a_box_that_comes_and_goes_is_no_thing_of_its_place() {
        let mut scene = repeated(&once(SyntheticIds::Absent).scene, 10);
        let all = scene.detections.len();
        let shown_once = BoundingBox::new([1.0, 1.0, 20.0, 20.0]).unwrap();
        let new = Detection { frame_index: 3, bounding_box: Some(shown_once), ..scene.detections[0].clone() };
        scene.edit(|parts| parts.detections.push(new)).unwrap();
        let detections: Vec<usize> = (0..scene.detections.len()).collect();
        let places = Places::of(&scene, &detections, IdPolicy::Ignore).unwrap();
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
        let places = Places::of(&scene, &detections, IdPolicy::Trust).unwrap();
        for copies in &places.copies {
            assert_eq!(copies.len(), 4);
            let id = scene.detections[copies[0]].object_index;
            assert!(copies.iter().all(|&copy| scene.detections[copy].object_index == id));
        }
    }
}
