//! Which camera the others contradict: one that needs far more noise than they do, whose focal length they would change, or that would
//! be below the floor.

use super::adjust::{log_focal, uncertainty};
use super::outcome::inflation_of;
use super::solution::Solution;
use super::{CalibratedCamera, Contradiction};
use crate::optimize::median::median;

/// A camera whose edges are off by more than this many times as much as those of the others does not see what they see.
const MAX_NOISE_RATIO: f64 = 3.0;

/// Standard deviation of edges, in half sizes, that shapes of bodies leave in exact boxes: no camera has less to be compared with.
const MIN_EDGE_SD: f64 = 0.01;

/// Standard deviation of edges, in half sizes, beyond which boxes say nothing.
const MAX_EDGE_SD: f64 = 0.5;

/// A focal length is wrong if the one that fits best, less so many standard deviations, differs from it by this (logarithm) more than
/// those of the others do.
const FOCAL_SDS: f64 = 3.0;
const WRONG_LOG_FOCAL: f64 = 0.05;

/// The same of two cameras, where no others show by how much noise alone changes it.
const FOCAL_SDS_OF_TWO: f64 = 5.0;
const WRONG_LOG_FOCAL_OF_TWO: f64 = 0.1;

/// Cosine of the angle between the vertical and that of an image, from which on the image has an upper side.
const HAS_UPPER_SIDE: f64 = 0.3;

/// The cameras that contradict the others most: one, or more where it cannot be said which. `answers`: what is said of them otherwise.
pub(super) fn contradictions(solution: &Solution, answers: &[CalibratedCamera]) -> Vec<(usize, Contradiction)> {
    let Solution { problem, placed, .. } = solution;
    let cameras: Vec<usize> = (0..placed.len()).filter(|&camera| placed[camera]).collect();
    let noise = |camera: usize| problem.edge_noise(camera).unwrap_or(0.0);
    let over_others = |camera: usize| {
        let others = cameras.iter().filter(|&&other| other != camera).map(|&other| noise(other));
        noise(camera) / median(&mut others.collect::<Vec<f64>>()).unwrap_or(f64::INFINITY).max(MIN_EDGE_SD)
    };
    let worst = |value: &dyn Fn(usize) -> f64| cameras.iter().copied().max_by(|&a, &b| value(a).total_cmp(&value(b)));
    let Some(noisiest) = worst(&over_others) else { return Vec::new() };
    let inflation = uncertainty(problem, &solution.state).map_or(1.0, |found| inflation_of(solution, &found));
    let focal = log_focal(problem, &solution.state).unwrap_or_default();
    // Noise makes all focal lengths look too short.
    let of_others = |camera: usize| {
        let others = cameras.iter().filter(|&&other| other != camera && cameras.len() > 2);
        let mut logs: Vec<f64> = others.filter_map(|&other| Some(focal.get(other)?[0])).collect();
        logs.sort_by(f64::total_cmp);
        let middle = |at: usize| logs.get(at).copied().unwrap_or(0.0);
        0.5 * (middle(logs.len().saturating_sub(1) / 2) + middle(logs.len() / 2))
    };
    let of_camera = |camera: usize| {
        let [log, sd] = focal.get(camera).copied().unwrap_or([0.0, 1.0]);
        // That of the others has an error, too.
        let variance = sd * sd * inflation * (1.0 + 1.0 / (cameras.len().max(2) - 1) as f64);
        (log - of_others(camera), variance.sqrt())
    };
    let (sds, least) = match cameras.len() {
        0..=2 => (FOCAL_SDS_OF_TWO, WRONG_LOG_FOCAL_OF_TWO),
        _ => (FOCAL_SDS, WRONG_LOG_FOCAL),
    };
    // By how much it is wrong at least.
    let excess = |camera: usize| {
        let (log, sd) = of_camera(camera);
        log.abs() - sds * sd
    };
    if over_others(noisiest) > MAX_NOISE_RATIO {
        // A focal length far from the right one leaves noise, too.
        let contradiction = if excess(noisiest) > least && noise(noisiest) <= MAX_EDGE_SD {
            Contradiction::FocalLength(of_camera(noisiest).0.exp())
        } else {
            Contradiction::Noise(over_others(noisiest))
        };
        return vec![(noisiest, contradiction)];
    }
    if let Some(off) = worst(&noise).filter(|&camera| noise(camera) > MAX_EDGE_SD) {
        return vec![(off, Contradiction::OtherBodies)];
    }
    let wrong = cameras.iter().copied().filter(|&camera| answers[camera].status.has_pose() && excess(camera) > least);
    if let Some(camera) = wrong.max_by(|&a, &b| excess(a).total_cmp(&excess(b))) {
        return vec![(camera, Contradiction::FocalLength(of_camera(camera).0.exp()))];
    }
    mirrored(solution, &cameras).into_iter().map(|camera| (camera, Contradiction::Mirrored)).collect()
}

/// Cameras on the other side of the plane in which the centers of walking bodies are, upside down: bodies look alike from below, and their
/// mirror images on a plane are as they would be seen from there. Those of the smaller group, or all.
fn mirrored(solution: &Solution, cameras: &[usize]) -> Vec<usize> {
    let Solution { problem, state, .. } = solution;
    let places = || problem.sites.iter().zip(&state.places).filter(|(site, _)| site.walks).map(|(_, place)| place);
    let count = places().count();
    if count == 0 {
        return Vec::new();
    }
    let middle = places().map(|place| state.up.dot(place)).sum::<f64>() / count as f64;
    let side = |camera: usize| {
        let pose = &state.poses[camera];
        let upper_side = -pose.rotation.row(1).transpose().dot(&state.up);
        let above = state.up.dot(&pose.center()) - middle;
        (upper_side.abs() > HAS_UPPER_SIDE && upper_side * above > 0.0).then_some(above > 0.0)
    };
    let of_side = |wanted: bool| -> Vec<usize> {
        cameras.iter().copied().filter(|&camera| side(camera) == Some(wanted)).collect()
    };
    let (above, below) = (of_side(true), of_side(false));
    match above.len().cmp(&below.len()) {
        _ if above.is_empty() || below.is_empty() => Vec::new(),
        std::cmp::Ordering::Less => above,
        std::cmp::Ordering::Greater => below,
        std::cmp::Ordering::Equal => [above, below].concat(),
    }
}
