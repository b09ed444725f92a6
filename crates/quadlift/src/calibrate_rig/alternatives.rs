//! Whether other poses of the cameras explain the boxes as well.

use nalgebra::{Matrix3, Rotation3, Unit, Vector3};

use super::adjust::Adjusted;
use super::assemble::{Bodies, Pair, Tree, across_pair, place};
use super::prepared::Prepared;
use super::problem::{Problem, State};
use super::solution::{Solution, best_start, bodies};
use crate::geometry::linalg::symmetric_eigen3;
use crate::geometry::rigid::Pose;
use crate::parallel::map_indices;

/// Sites on which solutions are compared at most, evenly spread.
const MAX_SITES: usize = 80;

/// Costs that differ by less do not decide: so much, and this share of the cost. Errors of boxes last longer than a time step.
const CLEAR: f64 = 20.0;
const CLEAR_SHARE: f64 = 0.1;

/// Bodies with a spread across their line below this share of that along it may be turned about it.
const NEARLY_A_LINE: f64 = 0.35;

/// Poses that differ by less are the same: radians, share of the distance of the bodies.
const SAME_ANGLE: f64 = 0.1;
const SAME_SHARE: f64 = 0.1;

/// What was found beside a solution.
#[derive(Debug, Clone)]
pub(super) struct Alternatives {
    /// Cameras that have another pose.
    pub ambiguous: Vec<bool>,
    /// A state that explains the boxes better, with its poses.
    pub better: Option<(Vec<Pose>, Vector3<f64>)>,
}

/// The cameras that were placed over a camera, with itself.
fn subtree(tree: &Tree, pairs: &[Pair], camera: usize) -> Vec<usize> {
    let mut all = vec![camera];
    let mut next = 0;
    while next < all.len() {
        let parent = all[next];
        for (child, by) in tree.by.iter().enumerate() {
            if let Some((pair, to_second)) = by
                && pairs[*pair].cameras[usize::from(!to_second)] == parent
                && !all.contains(&child)
            {
                all.push(child);
            }
        }
        next += 1;
    }
    all
}

/// A solution on some of its sites.
fn sample(solution: &Solution) -> (Problem, State) {
    let step = solution.problem.sites.len().div_ceil(MAX_SITES).max(1);
    let mut problem = solution.problem.clone();
    problem.sites = problem.sites.into_iter().step_by(step).collect();
    let mut state = solution.state.clone();
    state.places = state.places.into_iter().step_by(step).collect();
    (problem, state)
}

/// Turns about the line on which the bodies that a camera sees are, if they are on one.
fn turns(problem: &Problem, state: &State, camera: usize) -> Vec<Pose> {
    let sees = |k: &usize| problem.sites[*k].observations.iter().any(|o| o.camera == camera);
    let places: Vec<Vector3<f64>> = (0..problem.sites.len()).filter(sees).map(|k| state.places[k]).collect();
    let middle = places.iter().sum::<Vector3<f64>>() / places.len().max(1) as f64;
    let spread: Matrix3<f64> = places.iter().map(|p| (p - middle) * (p - middle).transpose()).sum();
    let Some((values, axes)) = symmetric_eigen3(&spread) else { return Vec::new() };
    if values[1].max(0.0).sqrt() > NEARLY_A_LINE * values[0].max(0.0).sqrt() {
        return Vec::new();
    }
    let axis = Unit::new_normalize(axes.column(0).into_owned());
    let turn = |quarter: usize| {
        let rotation = *Rotation3::from_axis_angle(&axis, std::f64::consts::FRAC_PI_2 * quarter as f64).matrix();
        Pose { rotation, translation: middle - rotation * middle }
    };
    (1..4).map(turn).collect()
}

/// Searches them: for each camera the other motions of its pair, and turns about the line on which bodies are.
pub(super) fn alternatives(prepared: &Prepared, pairs: &[Pair], tree: &Tree, solution: &Solution) -> Alternatives {
    let count = prepared.rig.cameras.len();
    let mut found = Alternatives { ambiguous: vec![false; count], better: None };
    let (problem, state) = sample(solution);
    let bodies = bodies(prepared, solution);
    let Some(own) = super::adjust::adjust(&problem, state, 10) else { return found };
    let state = &own.state;
    // Lengths of pairs are those of usual sizes.
    let scale = problem.sites.first().map_or(1.0, |site| {
        let usual = prepared.shapes[problem.shapes[site.shape].category].usual();
        (state.shapes[site.shape].log_height - usual.log_height).exp()
    });
    let mut starts: Vec<(usize, Vec<Pose>)> = Vec::new();
    for camera in 0..count {
        let Some((index, to_second)) = tree.by[camera] else { continue };
        let pair = &pairs[index];
        let parent = pair.cameras[usize::from(!to_second)];
        let now = state.poses[camera];
        let others = (1..pair.poses.len()).map(|k| across_pair(pair, k, to_second, &state.poses[parent], scale));
        let turned = turns(&problem, state, camera).into_iter().map(|turn| now.after(&turn));
        for other in others.chain(turned) {
            // What hangs on the camera moves with it.
            let motion = now.inverse().after(&other);
            let mut poses = state.poses.clone();
            for child in subtree(tree, pairs, camera) {
                poses[child] = poses[child].after(&motion);
            }
            starts.push((camera, poses));
        }
    }
    let from = |k: usize| adjusted(prepared, &problem, state, &starts[k].1, &solution.placed, &bodies);
    let all: Vec<Option<Adjusted>> = map_indices(starts.len(), from);
    let mut best = own.cost;
    for ((camera, _), other) in starts.iter().zip(all) {
        let Some(other) = other.filter(|other| differs(&problem, state, &other.state, *camera)) else { continue };
        if other.cost < best {
            best = other.cost;
            found.better = Some((other.state.poses.clone(), other.state.up));
        }
        if other.cost < own.cost + CLEAR + CLEAR_SHARE * own.cost {
            for child in subtree(tree, pairs, *camera) {
                found.ambiguous[child] = true;
            }
        }
    }
    found
}

/// Another solution, from other poses.
fn adjusted(
    prepared: &Prepared,
    problem: &Problem,
    state: &State,
    poses: &[Pose],
    placed: &[bool],
    bodies: &Bodies,
) -> Option<Adjusted> {
    let mut start = State { poses: poses.to_vec(), ..state.clone() };
    let poses: Vec<Option<Pose>> = poses.iter().zip(placed).map(|(pose, &placed)| placed.then_some(*pose)).collect();
    for (site, at) in problem.sites.iter().zip(&mut start.places) {
        let boxes: Vec<usize> = site.observations.iter().map(|observation| observation.box_index).collect();
        if let Some(place) = place(prepared, &poses, &boxes, bodies) {
            *at = place;
        }
    }
    best_start(problem, &start, &poses)
}

/// Whether the pose of a camera is another one.
fn differs(problem: &Problem, a: &State, b: &State, camera: usize) -> bool {
    let depths =
        problem.sites.iter().zip(&a.places).filter(|(site, _)| site.observations.iter().any(|o| o.camera == camera));
    let mut depths: Vec<f64> = depths.map(|(_, place)| a.poses[camera].apply(place).norm()).collect();
    depths.sort_by(f64::total_cmp);
    let depth = depths.get(depths.len() / 2).copied().unwrap_or(0.0);
    let (a, b) = (&a.poses[camera], &b.poses[camera]);
    a.angle_to(b) > SAME_ANGLE || (a.center() - b.center()).norm() > SAME_SHARE * depth
}
