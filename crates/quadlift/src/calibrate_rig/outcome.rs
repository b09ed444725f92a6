//! The answer: statuses, covariances, and the world in which it is given.

use crate::optimize::median::median;
use std::collections::{BTreeMap, BTreeSet};

use nalgebra::{Matrix3, Matrix6, Unit, Vector3};

use super::adjust::{Layout, Uncertainty, uncertainty};
use super::assemble::{MIN_SHARED, Pair, Tree};
use super::predicted::Predicted;
use super::prepared::Prepared;
use super::problem::Unknown;
use super::solution::{ARBITRARY_SD, Solution, block};
use super::{CalibratedCamera, Calibration, CameraStatus, Contradiction, Rig, RigScale, Vertical};
use crate::geometry::rigid::Pose;

/// A vertical with a smaller standard deviation (radians) turns the world.
const KNOWN_UP_SD: f64 = 0.035;

/// A pose with larger standard deviations in any direction is none: radians, and shares of the distance of the bodies.
const MAX_ROTATION_SD: f64 = 0.05;
const MAX_POSITION_SD: f64 = 0.1;

/// Edges that are off by more than this share of the half size of their boxes, in the middle, are not those of the same body.
const MAX_OFF: f64 = 0.3;

/// Nothing is calibrated but what was given.
pub(super) fn nothing(rig: &Rig, pairs: &[Pair], contradictions: &[Option<Contradiction>]) -> Calibration {
    let camera = |(index, camera): (usize, &super::RigCamera)| {
        let status = if camera.cam_from_world.is_some() { CameraStatus::Given } else { unconnected(pairs, index) };
        let cam_from_world = camera.cam_from_world;
        let unknown = CalibratedCamera {
            status,
            cam_from_world,
            covariance: None,
            time_steps: 0,
            residual_px: None,
            edge_noise: None,
            contradiction: None,
        };
        with_contradiction(unknown, contradictions[index])
    };
    Calibration {
        cameras: rig.cameras.iter().enumerate().map(camera).collect(),
        reference: None,
        scale: RigScale::Arbitrary,
        scale_sd: None,
        vertical: None,
        edge_noise: None,
    }
}

/// Why a camera hangs together with no other one: as the one with which it shares most.
fn unconnected(pairs: &[Pair], camera: usize) -> CameraStatus {
    let of_camera = pairs.iter().filter(|pair| pair.poses.is_empty() && pair.cameras.contains(&camera));
    of_camera.max_by_key(|pair| pair.shared).map_or(CameraStatus::NotConnected, |pair| pair.status)
}

/// A camera with what speaks against it: then it is inconsistent, unless its pose was given.
fn with_contradiction(camera: CalibratedCamera, known: Option<Contradiction>) -> CalibratedCamera {
    let contradiction = match (known, camera.status) {
        (None, CameraStatus::Inconsistent) => Some(Contradiction::OtherBodies),
        _ => known,
    };
    let status = match camera.status {
        CameraStatus::Given => CameraStatus::Given,
        _ if contradiction.is_some() => CameraStatus::Inconsistent,
        other => other,
    };
    CalibratedCamera { status, contradiction, ..camera }
}

/// Sums over the boxes of a camera.
#[derive(Debug, Clone, Default)]
struct Seen {
    time_steps: BTreeSet<usize>,
    squares: f64,
    edges: usize,
    /// By how much edges are off, in half sizes.
    off: Vec<f64>,
    depths: Vec<f64>,
}

fn seen(prepared: &Prepared, solution: &Solution) -> Vec<Seen> {
    let Solution { problem, state, .. } = solution;
    let mut all = vec![Seen::default(); state.poses.len()];
    for (site, place) in problem.sites.iter().zip(&state.places) {
        for observation in &site.observations {
            let of_camera = &mut all[observation.camera];
            let pose = &state.poses[observation.camera];
            let Some(predicted) = Predicted::new(pose, place, &state.up, state.shapes[site.shape]) else { continue };
            of_camera.time_steps.insert(prepared.boxes[observation.box_index].taken_at);
            of_camera.depths.push(predicted.depth());
            for edge in (0..4).filter(|&edge| !observation.measured.cut_off[edge]) {
                let off = predicted.edges[edge] - observation.measured.edges[edge];
                of_camera.squares += (off / observation.measured.pixel[edge % 2]).powi(2);
                of_camera.edges += 1;
                of_camera.off.push(off.abs() / observation.measured.size[edge % 2]);
            }
        }
    }
    all
}

/// The world of the answer, from that of the solution: z upwards and the origin on the floor below the reference camera.
fn turned_world(solution: &Solution, up: &Vector3<f64>, reference: &Pose) -> Pose {
    let viewing = reference.rotation.row(2).transpose();
    let over_image = -reference.rotation.row(1).transpose();
    let horizontal = |v: Vector3<f64>| v - up * up.dot(&v);
    let forwards = horizontal(viewing);
    let y = if forwards.norm() > 0.1 { forwards } else { horizontal(over_image) }.normalize();
    let rotation = Matrix3::from_rows(&[y.cross(up).transpose(), y.transpose(), up.transpose()]);
    let shapes = solution.state.shapes.iter().zip(&solution.state.heights).enumerate();
    let walks = |shape: usize| solution.problem.sites.iter().any(|site| site.shape == shape && site.walks);
    // Heights are along the vertical of the solution, which has two directions.
    let sign = solution.state.up.dot(up);
    let feet = shapes.filter(|(k, _)| walks(*k)).map(|(_, (shape, height))| sign * height - shape.log_height.exp());
    let center = reference.center();
    let floor = median(&mut feet.collect::<Vec<f64>>()).unwrap_or(up.dot(&center));
    let origin = horizontal(center) + up * floor;
    Pose { rotation, translation: -(rotation * origin) }
}

/// The direction of a vertical that is upwards: that of the images, or from the bodies to cameras that look down.
fn upwards(solution: &Solution) -> Vector3<f64> {
    let up = solution.state.up;
    let placed =
        || solution.state.poses.iter().zip(&solution.placed).filter(|(_, placed)| **placed).map(|(pose, _)| pose);
    let count = placed().count().max(1) as f64;
    let of_images = placed().map(|pose| -pose.rotation.row(1).transpose().dot(&up)).sum::<f64>() / count;
    let middle = solution.state.places.iter().sum::<Vector3<f64>>() / solution.state.places.len().max(1) as f64;
    let above = placed().map(|pose| (pose.center() - middle).dot(&up)).sum::<f64>();
    let sign = if of_images.abs() > 0.3 { of_images } else { above };
    if sign < 0.0 { -up } else { up }
}

/// The covariance of a camera: its errors in its own axes are turns, and positions, which shifts move the other way.
fn of_camera(found: &Uncertainty, layout: &Layout, camera: usize, inflation: f64) -> Option<Matrix6<f64>> {
    let mut covariance: Matrix6<f64> = block::<6>(&found.covariance, layout.camera(camera)?) * inflation;
    for i in 0..3 {
        for j in 3..6 {
            covariance[(i, j)] = -covariance[(i, j)];
            covariance[(j, i)] = -covariance[(j, i)];
        }
    }
    Some(covariance)
}

fn largest(covariance: &Matrix6<f64>, first: usize) -> f64 {
    let part = covariance.fixed_view::<3, 3>(first, first).into_owned();
    part.symmetric_eigenvalues().max().max(0.0).sqrt()
}

/// By how much variances grow because the errors of a body's boxes in a camera last longer than a time step: the variance of means of
/// consecutive residuals, over that of independent ones.
pub(super) fn inflation_of(solution: &Solution, found: &Uncertainty) -> f64 {
    let mut series: BTreeMap<(usize, usize, (usize, usize)), Vec<f64>> = BTreeMap::new();
    for (site, rows) in solution.problem.sites.iter().zip(&found.rows) {
        for (row, weight, _) in rows {
            if let (Some(camera), Some(level)) = (row.camera, row.level) {
                series.entry((site.shape, camera, level)).or_default().push(row.residual * weight.sqrt());
            }
        }
    }
    let mean_square = |values: &[f64]| values.iter().map(|x| x * x).sum::<f64>() / values.len().max(1) as f64;
    let all: Vec<f64> = series.values().flatten().copied().collect();
    let single = mean_square(&all);
    let growth = |length: usize| {
        let block = |values: &[f64]| values.iter().sum::<f64>() / (length as f64).sqrt();
        let blocks: Vec<f64> = series.values().flat_map(|values| values.chunks_exact(length)).map(block).collect();
        let growth = mean_square(&blocks) / single;
        // Chance makes as much of few blocks.
        growth - growth * (2.0 / blocks.len().max(1) as f64).sqrt()
    };
    let lengths = [2, 4, 8, 16, 32, 64];
    if single > 0.0 { lengths.into_iter().map(growth).filter(|x| x.is_finite()).fold(1.0, f64::max) } else { 1.0 }
}

/// Places of bodies that are farther from each other than half their height.
fn distinct(solution: &Solution, camera: usize) -> usize {
    let mut kept: Vec<Vector3<f64>> = Vec::new();
    for (site, place) in solution.problem.sites.iter().zip(&solution.state.places) {
        let near = solution.state.shapes[site.shape].log_height.exp();
        let sees = site.observations.iter().any(|observation| observation.camera == camera);
        if sees && kept.len() < MIN_SHARED && kept.iter().all(|other| (other - place).norm() > near) {
            kept.push(*place);
        }
    }
    kept.len()
}

/// The answer.
pub(super) fn calibration(
    prepared: &Prepared,
    pairs: &[Pair],
    tree: &Tree,
    solution: &Solution,
    ambiguous: &[bool],
    contradictions: &[Option<Contradiction>],
) -> Calibration {
    let rig = prepared.rig;
    let Solution { problem, state, .. } = solution;
    // A scale that sizes tell moves all cameras together: it has a standard deviation of its own.
    let most = most_seen(solution);
    let scale_sd = match solution.scale {
        RigScale::Sizes => uncertainty(problem, state).map(|found| height_sd(&found, most)),
        _ => None,
    };
    let found = match solution.scale {
        RigScale::Sizes => {
            let mut pinned = problem.clone();
            pinned.shapes[most].log_height = Some([state.shapes[most].log_height, ARBITRARY_SD]);
            uncertainty(&pinned, state)
        }
        _ => uncertainty(problem, state),
    };
    let inflation = found.as_ref().map_or(1.0, |found| inflation_of(solution, found));
    let seen = seen(prepared, solution);
    let layout = Layout::new(problem);
    let upwards = upwards(solution);
    let up_sd = found
        .as_ref()
        .zip(layout.up())
        .map(|(found, first)| (0.5 * inflation * block::<2>(&found.covariance, first).trace()).max(0.0).sqrt());
    let given = rig.cameras.iter().any(|camera| camera.cam_from_world.is_some());
    let known_up = up_sd.filter(|&sd| sd < KNOWN_UP_SD);
    let reference = tree.reference.map(|camera| state.poses[camera]);
    let world = match (&reference, known_up) {
        (Some(reference), Some(_)) => turned_world(solution, &upwards, reference),
        _ => Pose::identity(),
    };
    let up = if reference.is_some() { Vector3::z_axis() } else { Unit::new_normalize(upwards) };
    let vertical = known_up.map(|sd| Vertical { up, sd });
    let camera = |index: usize| {
        let of_camera_seen = &seen[index];
        let mut answer = CalibratedCamera {
            status: CameraStatus::Ok,
            cam_from_world: None,
            covariance: None,
            time_steps: of_camera_seen.time_steps.len(),
            residual_px: (of_camera_seen.edges > 0)
                .then(|| (of_camera_seen.squares / of_camera_seen.edges as f64).sqrt()),
            edge_noise: solution.placed[index].then(|| problem.edge_noise(index)).flatten(),
            contradiction: None,
        };
        if let Some(given) = rig.cameras[index].cam_from_world {
            answer.status = CameraStatus::Given;
            answer.cam_from_world = Some(given);
            return answer;
        }
        if !solution.placed[index] {
            answer.status = unconnected(pairs, index);
            return answer;
        }
        let covariance = found.as_ref().and_then(|found| of_camera(found, &found.layout, index, inflation));
        let depth = median(&mut of_camera_seen.depths.clone()).unwrap_or(0.0);
        let determined = |c: &Matrix6<f64>| {
            largest(c, 0) < MAX_ROTATION_SD
                && largest(c, 3) < MAX_POSITION_SD * depth
                && c.iter().all(|x| x.is_finite())
        };
        answer.status = match &covariance {
            _ if median(&mut of_camera_seen.off.clone()).is_none_or(|off| off > MAX_OFF) => CameraStatus::Inconsistent,
            _ if Some(index) == tree.reference => CameraStatus::Ok,
            _ if distinct(solution, index) < MIN_SHARED => CameraStatus::Undetermined,
            _ if ambiguous[index] => CameraStatus::Ambiguous,
            Some(c) if determined(c) => CameraStatus::Ok,
            _ => CameraStatus::Undetermined,
        };
        if answer.status == CameraStatus::Ok {
            answer.cam_from_world = state.poses[index].after(&world.inverse()).checked();
            answer.covariance = covariance;
        }
        answer
    };
    let mut cameras: Vec<CalibratedCamera> =
        (0..rig.cameras.len()).map(|index| with_contradiction(camera(index), contradictions[index])).collect();
    // A reference alone says nothing.
    if let Some(reference) = tree.reference
        && !given
        && cameras.iter().filter(|camera| camera.status == CameraStatus::Ok).count() < 2
    {
        let others = cameras.iter().enumerate().filter(|(k, _)| *k != reference && solution.placed[*k]);
        let status = others.map(|(_, camera)| camera.status).next().unwrap_or(CameraStatus::NotConnected);
        let alone = CalibratedCamera { status, cam_from_world: None, ..cameras[reference].clone() };
        cameras[reference] = with_contradiction(alone, None);
    }
    let edge_noise = problem.sites.first().map(|site| problem.levels[problem.shapes[site.shape].category].0[0]);
    Calibration { cameras, reference: tree.reference, scale: solution.scale, scale_sd, vertical, edge_noise }
}

/// An answer without the poses of two cameras alone: the sizes of bodies are their only source of scale and lens, and a wrong height and a
/// wrong focal length explain each other.
pub(super) fn without_two_alone(rig: &Rig, solution: &Solution, mut answer: Calibration) -> Calibration {
    let given = rig.cameras.iter().any(|camera| camera.cam_from_world.is_some());
    if rig.cameras.len() == 2 && !given && solution.scale != RigScale::Baselines {
        for camera in answer.cameras.iter_mut().filter(|camera| camera.status == CameraStatus::Ok) {
            camera.status = CameraStatus::Undetermined;
            camera.cam_from_world = None;
            camera.covariance = None;
        }
    }
    answer
}

/// The shape that is seen most.
fn most_seen(solution: &Solution) -> usize {
    let mut counts = vec![0; solution.problem.shapes.len()];
    solution.problem.sites.iter().for_each(|site| counts[site.shape] += 1);
    (0..counts.len()).max_by_key(|&k| (counts[k], std::cmp::Reverse(k))).unwrap_or(0)
}

/// Relative standard deviation of the height of a shape.
fn height_sd(found: &Uncertainty, shape: usize) -> f64 {
    let at = found.layout.unknown(Unknown::Shape(shape, 1)).unwrap_or(0);
    found.covariance[(at, at)].max(0.0).sqrt()
}
