//! From pairs of cameras to all of them: a spanning tree of relative poses, and which boxes show the same body.

use std::collections::{BTreeMap, BTreeSet};

use nalgebra::{Matrix3, Vector3};

use super::CameraStatus;
use super::pairs::{Candidate, RelativePose, SAME_POINT, relative_poses};
use super::predicted::Shape;
use super::prepared::{Prepared, PreparedBox, Thing};
use crate::geometry::linalg::symmetric_eigen3;
use crate::geometry::rigid::Pose;
use crate::parallel::map_indices;
use crate::sorting::StableSort;

/// Bodies that two cameras must share.
pub(super) const MIN_SHARED: usize = 5;

/// Share of them that a motion must explain ...
const INLIER_SHARE: f64 = 0.5;

/// ... and of those that motions do not explain by chance, when the time steps of one camera are shifted.
const BEYOND_CHANCE: f64 = 1.0 / 3.0;

/// Shifts of the time steps, evenly spread over them; the second best one is what chance explains, since people may walk in circles.
const SHIFTS: usize = 5;

/// Bodies that are explained to this share, and by chance about as well, are in one place or on one line.
const WELL_EXPLAINED: f64 = 0.75;

/// Points that spread across their line by less than this share of a body's extent are on it.
const NO_SPREAD: f64 = 0.25;

/// How two cameras stand to each other: the motions that explain their boxes, the best one first.
#[derive(Debug, Clone)]
pub(super) struct Pair {
    pub cameras: [usize; 2],
    pub poses: Vec<RelativePose>,
    /// Bodies at time steps that both cameras may see.
    pub shared: usize,
    /// Why no motion is right; [`CameraStatus::Ok`] where one may be.
    pub status: CameraStatus,
}

/// All pairs of cameras whose boxes may show the same bodies.
pub(super) fn pairs(prepared: &Prepared, seed: u64) -> Vec<Pair> {
    let count = prepared.rig.cameras.len();
    let all: Vec<[usize; 2]> = (0..count).flat_map(|a| (a + 1..count).map(move |b| [a, b])).collect();
    map_indices(all.len(), |k| {
        let cameras @ [a, b] = all[k];
        let candidates = prepared.candidates(a, b, 0);
        let shared = shared(&candidates);
        let mut poses = relative_poses(&candidates, seed);
        let least = (INLIER_SHARE * shared as f64).max(MIN_SHARED as f64);
        poses.retain(|pose| pose.inliers.len() as f64 >= least);
        let score = poses.first().map_or(0.0, |best| best.score / shared as f64);
        let status = if !poses.is_empty() && explains(prepared, cameras, score, seed) {
            CameraStatus::Ok
        } else if shared < 2 * MIN_SHARED {
            CameraStatus::NotConnected
        } else if score > WELL_EXPLAINED || (0..2).any(|side| are_on_a_line(&candidates, side)) {
            CameraStatus::Undetermined
        } else {
            CameraStatus::Inconsistent
        };
        if status != CameraStatus::Ok {
            poses.clear();
        }
        Pair { cameras, poses, shared, status }
    })
}

/// Whether a motion that explains the bodies with this score, for each of them, does so beyond chance.
fn explains(prepared: &Prepared, [a, b]: [usize; 2], score: f64, seed: u64) -> bool {
    let time_steps = prepared.time_steps();
    let by_chance = |k: usize| {
        let candidates = prepared.candidates(a, b, k * time_steps / (SHIFTS + 1));
        let best = relative_poses(&candidates, seed).first().map_or(0.0, |best| best.score);
        best / shared(&candidates).max(1) as f64
    };
    let mut chance: Vec<f64> = (1..=SHIFTS).map(by_chance).collect();
    chance.stable_sort_by(|a, b| b.total_cmp(a));
    let chance = chance[1];
    score > chance + BEYOND_CHANCE * (1.0 - chance)
}

/// Whether the bodies that a camera sees are in one place or on one line.
fn are_on_a_line(candidates: &[Candidate], side: usize) -> bool {
    let points = || candidates.iter().map(|candidate| candidate.points[side]);
    let count = candidates.len().max(1) as f64;
    let middle = points().map(|point| point.place).sum::<Vector3<f64>>() / count;
    let extent = points().map(|point| point.extent).sum::<f64>() / count;
    let spread: Matrix3<f64> =
        points().map(|point| (point.place - middle) * (point.place - middle).transpose() / count).sum();
    symmetric_eigen3(&spread).is_none_or(|(values, _)| values[1].max(0.0).sqrt() < NO_SPREAD * extent)
}

/// Bodies that both cameras may see: at each time step as many as the camera with fewer boxes has.
fn shared(candidates: &[Candidate]) -> usize {
    let mut sum = 0;
    for group in candidates.chunk_by(|a, b| a.time_step == b.time_step) {
        let distinct = |side: usize| group.iter().map(|c| c.boxes[side]).collect::<BTreeSet<_>>().len();
        sum += distinct(0).min(distinct(1));
    }
    sum
}

/// How a camera was placed: over which pair, and whether it is the second one of it.
pub(super) type By = (usize, bool);

/// Cameras that are connected, and where they are.
#[derive(Debug, Clone)]
pub(super) struct Tree {
    /// The camera in whose frame the others are; none if poses were given.
    pub reference: Option<usize>,
    /// Poses of the cameras that are connected.
    pub poses: Vec<Option<Pose>>,
    /// Of each camera that was placed over another one.
    pub by: Vec<Option<By>>,
    /// By how much the usual sizes of bodies are multiplied: by given poses.
    pub scale: f64,
}

/// A motion, with lengths multiplied.
fn scaled(pose: &Pose, by: f64) -> Pose {
    Pose { translation: pose.translation * by, ..*pose }
}

/// The pose of a camera of a pair from that of the other one; `chosen` is which of the pair's motions.
pub(super) fn across_pair(pair: &Pair, chosen: usize, to_second: bool, other: &Pose, scale: f64) -> Pose {
    let motion = scaled(&pair.poses[chosen].second_from_first, scale);
    if to_second { motion.after(other) } else { motion.inverse().after(other) }
}

/// Places cameras one by one, each over the pair with the best score to a camera that has its place.
fn grow(pairs: &[Pair], mut poses: Vec<Option<Pose>>, scale: f64) -> (Vec<Option<Pose>>, Vec<Option<By>>) {
    let mut by = vec![None; poses.len()];
    loop {
        let useful = pairs.iter().enumerate().filter(|(_, pair)| {
            !pair.poses.is_empty() && pair.cameras.iter().filter(|&&camera| poses[camera].is_some()).count() == 1
        });
        let best = useful.max_by(|a, b| a.1.poses[0].score.total_cmp(&b.1.poses[0].score).then(b.0.cmp(&a.0)));
        let Some((index, pair)) = best else { return (poses, by) };
        let [first, second] = pair.cameras;
        let (known, sought, to_second) =
            if poses[first].is_some() { (first, second, true) } else { (second, first, false) };
        let Some(other) = poses[known] else { return (poses, by) };
        poses[sought] = Some(across_pair(pair, 0, to_second, &other, scale));
        by[sought] = Some((index, to_second));
    }
}

/// Cameras that hang together with the given ones, or else the most cameras that hang together.
pub(super) fn tree(prepared: &Prepared, pairs: &[Pair]) -> Tree {
    let count = prepared.rig.cameras.len();
    let given: Vec<Option<Pose>> = prepared
        .rig
        .cameras
        .iter()
        .map(|camera| camera.cam_from_world.as_ref().map(|pose| Pose::from(pose).orthonormal()))
        .collect();
    let alone = |camera: usize, pose: Pose| {
        let mut poses = vec![None; count];
        poses[camera] = Some(pose);
        poses
    };
    let Some((root, root_pose)) = given.iter().enumerate().find_map(|(k, pose)| Some((k, (*pose)?))) else {
        let mut best: Option<Tree> = None;
        let mut placed = vec![false; count];
        for camera in 0..count {
            if placed[camera] {
                continue;
            }
            let (poses, by) = grow(pairs, alone(camera, Pose::identity()), 1.0);
            poses.iter().enumerate().for_each(|(k, pose)| placed[k] |= pose.is_some());
            let size = |poses: &[Option<Pose>]| poses.iter().flatten().count();
            if best.as_ref().is_none_or(|other| size(&poses) > size(&other.poses)) {
                best = Some(Tree { reference: Some(camera), poses, by, scale: 1.0 });
            }
        }
        return best.unwrap_or(Tree { reference: None, poses: Vec::new(), by: Vec::new(), scale: 1.0 });
    };
    // Distances from the first given camera to the other ones, as given and by the sizes of bodies.
    let (by_sizes, _) = grow(pairs, alone(root, root_pose), 1.0);
    let ratio = |(a, b): (&Option<Pose>, &Option<Pose>)| {
        let [true_length, found] = [(*a)?, (*b)?].map(|pose| (pose.center() - root_pose.center()).norm());
        (true_length > 0.0 && found > 0.0).then_some(true_length / found)
    };
    let mut ratios: Vec<f64> = given.iter().zip(&by_sizes).filter_map(ratio).collect();
    ratios.sort_by(f64::total_cmp);
    let scale = ratios.get(ratios.len() / 2).copied().unwrap_or(1.0);
    let (poses, by) = grow(pairs, given, scale);
    Tree { reference: None, poses, by, scale }
}

/// What is known of the bodies while boxes are grouped.
#[derive(Debug, Clone)]
pub(super) struct Bodies {
    pub up: Option<Vector3<f64>>,
    /// Usual shapes of the categories.
    pub shapes: Vec<Shape>,
    /// Relative standard deviation of depths from sizes.
    pub depth_sd: f64,
}

/// Boxes that show one body at one time step, and where that is.
#[derive(Debug, Clone)]
pub(super) struct Group {
    pub thing: Thing,
    pub category: usize,
    pub time_step: Option<usize>,
    /// Indices of boxes.
    pub boxes: Vec<usize>,
    pub place: Vector3<f64>,
}

/// A box's body in the world: place and information.
fn in_world(prepared: &Prepared, pose: &Pose, index: usize, bodies: &Bodies) -> Option<(Vector3<f64>, Matrix3<f64>)> {
    let of_box = &prepared.boxes[index];
    let mut point = of_box.point?;
    let (prior, shape) = (&prepared.shapes[of_box.category], bodies.shapes[of_box.category]);
    let usual = prior.extent(prior.usual());
    let mut factor = prior.extent(shape) / usual;
    if let (Some(up), false) = (&bodies.up, prior.is_wide()) {
        // The trace of the shape less its part along the ray is what a box shows of it.
        let ray = point.place.normalize();
        let along = (pose.rotation * up).dot(&ray);
        let [radius, height] = [shape.log_radius, shape.log_height].map(|log| (2.0 * log).exp());
        factor = (radius + height - along * along * (height - radius)).sqrt() / usual;
    }
    point.place *= factor;
    point.extent = prior.extent(shape);
    point.depth_sd = bodies.depth_sd;
    let covariance = pose.rotation.tr_mul(&point.covariance()) * pose.rotation;
    Some((pose.inverse().apply(&point.place), covariance))
}

/// The mean of places, each weighted by what it tells.
fn mean(places: &[(Vector3<f64>, Matrix3<f64>)]) -> Option<Vector3<f64>> {
    let mut information = Matrix3::zeros();
    let mut sum = Vector3::zeros();
    for (place, covariance) in places {
        let of_place = covariance.try_inverse()?;
        information += of_place;
        sum += of_place * place;
    }
    Some(information.cholesky()?.solve(&sum))
}

/// Where the body of some boxes is; `None` where none of them is whole.
pub(super) fn place(
    prepared: &Prepared,
    poses: &[Option<Pose>],
    boxes: &[usize],
    bodies: &Bodies,
) -> Option<Vector3<f64>> {
    let of_box = |&index: &usize| in_world(prepared, &poses[prepared.boxes[index].camera]?, index, bodies);
    mean(&boxes.iter().filter_map(of_box).collect::<Vec<_>>())
}

/// Groups the boxes of placed cameras: those of an object at a time step belong together; those without ids, where they may be at the same
/// place. Groups of one camera are left out.
pub(super) fn groups(prepared: &Prepared, poses: &[Option<Pose>], bodies: &Bodies) -> Vec<Group> {
    let mut of_time_step: BTreeMap<(Option<usize>, Thing), Vec<usize>> = BTreeMap::new();
    for (index, b) in prepared.boxes.iter().enumerate().filter(|(_, b)| poses[b.camera].is_some()) {
        of_time_step.entry((b.time_step, b.thing)).or_default().push(index);
    }
    let mut all = Vec::new();
    for ((time_step, thing), boxes) in of_time_step {
        let place = |&index: &usize| -> Option<(usize, Vector3<f64>, Matrix3<f64>)> {
            let pose = poses[prepared.boxes[index].camera]?;
            let (place, covariance) = in_world(prepared, &pose, index, bodies)?;
            Some((index, place, covariance))
        };
        let placed: Vec<_> = boxes.iter().filter_map(place).collect();
        let parts: Vec<Vec<usize>> = match thing {
            Thing::Object(_) => vec![(0..placed.len()).collect()],
            Thing::Category(_) => matched(prepared, &placed),
        };
        for part in parts {
            let camera = |k: usize| prepared.boxes[placed[k].0].camera;
            if part.iter().all(|&k| camera(k) == camera(part[0])) {
                continue;
            }
            let places: Vec<_> = part.iter().map(|&k| (placed[k].1, placed[k].2)).collect();
            let Some(place) = mean(&places) else { continue };
            let mut members: Vec<usize> = part.iter().map(|&k| placed[k].0).collect();
            if let Thing::Object(_) = thing {
                // Also boxes that the image cuts off.
                members.clone_from(&boxes);
            }
            members.retain(|&index| {
                let in_front = |pose: &Pose| pose.apply(&place).z > 0.0;
                poses[prepared.boxes[index].camera].as_ref().is_some_and(in_front)
            });
            let category = prepared.boxes[placed[part[0]].0].category;
            all.push(Group { thing, category, time_step, boxes: members, place });
        }
    }
    all
}

/// Boxes without ids that may show the same body, at most one of each camera; the nearest ones first.
fn matched(prepared: &Prepared, placed: &[(usize, Vector3<f64>, Matrix3<f64>)]) -> Vec<Vec<usize>> {
    let camera = |k: usize| prepared.boxes[placed[k].0].camera;
    let apart = |k: usize, l: usize| {
        let off = placed[k].1 - placed[l].1;
        (placed[k].2 + placed[l].2).cholesky().map_or(f64::INFINITY, |cholesky| off.dot(&cholesky.solve(&off)))
    };
    let mut near: Vec<(f64, usize, usize)> = Vec::new();
    for k in 0..placed.len() {
        for l in k + 1..placed.len() {
            let squared = if camera(k) == camera(l) { f64::INFINITY } else { apart(k, l) };
            if squared < SAME_POINT {
                near.push((squared, k, l));
            }
        }
    }
    near.stable_sort_by(|a, b| a.0.total_cmp(&b.0).then((a.1, a.2).cmp(&(b.1, b.2))));
    let mut part_of: Vec<usize> = (0..placed.len()).collect();
    let mut parts: Vec<Vec<usize>> = (0..placed.len()).map(|k| vec![k]).collect();
    for (_, k, l) in near {
        let (a, b) = (part_of[k], part_of[l]);
        let fit = a != b
            && parts[a].iter().all(|&i| parts[b].iter().all(|&j| camera(i) != camera(j) && apart(i, j) < SAME_POINT));
        if fit {
            let moved = std::mem::take(&mut parts[b]);
            moved.iter().for_each(|&index| part_of[index] = a);
            parts[a].extend(moved);
        }
    }
    parts.retain(|part| part.len() > 1);
    parts
}

impl PreparedBox {
    /// Whether the box is that of an object with an id.
    pub(super) fn has_id(&self) -> bool {
        matches!(self.thing, Thing::Object(_))
    }
}
