//! Mistakes of the trajectory that no convention explains: frames that repeat a pose, and a scale that jumps.

use std::collections::BTreeMap;

use nalgebra::{Matrix4, Vector2, Vector3, Vector4};

use super::agreement::Improvement;
use super::misses::{ReprojectionErrors, corrected_ray, misses};
use super::rays::{Ray, meeting_point};
use super::sample::{Sample, Seen};
use crate::geometry::linalg::solve_spd;
use crate::optimize::median::median;
use crate::parallel::map_indices;

/// Boxes of one object in frames of one pose that are farther apart than this many half sizes show that something moved.
const MOVED: f64 = 0.3;

/// Minimum number of frames that repeat a pose although something moved.
const MIN_REPEATED: usize = 3;

/// Minimum number of frames to detect a jump.
const MIN_FRAMES: usize = 8;

/// Grid of jump positions.
const PLACES: usize = 12;

/// How often the distance between places is halved.
const HALVINGS: usize = 4;

/// Rounds of reweighting.
const ROUNDS: usize = 8;

/// A factor this close to one is not a jump.
const SAME_SCALE: f64 = 1.1;

/// Fraction of the frames with boxes that repeat a pose although something moved in between; `None` if there are too
/// few.
pub(crate) fn repeated_poses(sample: &Sample) -> Option<f64> {
    let mut seen_in = vec![false; sample.frames.len()];
    sample.objects.iter().flatten().for_each(|seen| seen_in[seen.frame as usize] = true);
    // The first frame of each pose.
    let mut first_of = BTreeMap::new();
    let same_pose: Vec<usize> = (sample.frames.iter().enumerate())
        .map(|(index, frame)| {
            let Some(camera) = frame.camera.filter(|_| seen_in[index]) else { return index };
            let numbers = camera.rotation.iter().chain(camera.translation.iter());
            let pose: Vec<u64> = numbers.map(|x| x.to_bits()).collect();
            *first_of.entry(pose).or_insert(index)
        })
        .collect();
    // How far the boxes of each frame are from those of the same object in the first frame of its pose.
    let mut shifts: Vec<Vec<f64>> = vec![Vec::new(); sample.frames.len()];
    for object in &sample.objects {
        let mut first: BTreeMap<usize, &Seen> = BTreeMap::new();
        for seen in object {
            let frame = seen.frame as usize;
            let earlier = first.entry(same_pose[frame]).or_insert(seen);
            if earlier.frame != seen.frame {
                let distance = (seen.bounding_box.center() - earlier.bounding_box.center()).norm();
                shifts[frame].push(distance / earlier.bounding_box.mean_half_size());
            }
        }
    }
    let mut moved = 0;
    for shifts in shifts.iter_mut().filter(|shifts| !shifts.is_empty()) {
        let middle = (shifts.len() - 1) / 2;
        moved += usize::from(*shifts.select_nth_unstable_by(middle, f64::total_cmp).1 > MOVED);
    }
    (moved >= MIN_REPEATED).then(|| moved as f64 / seen_in.iter().filter(|seen| **seen).count() as f64)
}

/// A trajectory whose scale differs from a frame on.
pub(crate) struct ScaleJump {
    /// Factor by which the trajectory from that frame on has to be multiplied.
    pub factor: f64,
    pub gain: Improvement,
}

/// The scale jump that explains a sample best, if any.
///
/// The objects are located from the frames before the jump; the factor and the shift that align the rays of the later
/// frames with them follow from a linear system.
pub(crate) fn scale_jump(sample: &Sample, given: &ReprojectionErrors) -> Option<ScaleJump> {
    let mut used: Vec<u32> = sample.objects.iter().flatten().map(|seen| seen.frame).collect();
    used.sort_unstable();
    used.dedup();
    if used.len() < MIN_FRAMES {
        return None;
    }
    let try_one = |place: usize| {
        let (factor, jump) = rescaled(sample, *used.get(place)?)?;
        let gain = given.gain_of(&misses(&jump, None, Some(given))?);
        Some((ScaleJump { factor, gain }, place))
    };
    let best_of = |places: &[usize]| {
        let found = map_indices(places.len(), |k| try_one(places[k]));
        found.into_iter().flatten().max_by(|(a, _), (b, _)| a.gain.gain.total_cmp(&b.gain.gain))
    };
    let step = (used.len() as f64 / (PLACES + 1) as f64).max(1.0);
    let places: Vec<usize> = (1..=PLACES).map(|k| (k as f64 * step) as usize).collect();
    let (mut best, mut place) = best_of(&places)?;
    let mut reach = step;
    for _ in 0..HALVINGS {
        reach *= 0.5;
        let by = reach.round().max(1.0) as usize;
        let neighbors = [place.saturating_sub(by).max(1), place + by];
        if let Some((better, at)) = best_of(&neighbors).filter(|(found, _)| found.gain.gain > best.gain.gain) {
            (best, place) = (better, at);
        }
    }
    Some(best).filter(|jump| jump.factor.ln().abs() > SAME_SCALE.ln())
}

/// The sample with the part of its trajectory from a frame on multiplied by the factor, and moved by the shift, with which
/// it agrees best with the part before.
fn rescaled<'a>(sample: &Sample<'a>, from: u32) -> Option<(f64, Sample<'a>)> {
    // Rays of later frames, each with the place of its object.
    let mut later: Vec<(Ray, Vector3<f64>)> = Vec::new();
    for object in &sample.objects {
        let rays = |is_later: bool| -> Vec<Ray> {
            let part = object.iter().filter(|seen| (seen.frame >= from) == is_later);
            part.filter_map(|seen| corrected_ray(sample, seen, None, None)).collect()
        };
        let Some(place) = meeting_point(&rays(false)) else { continue };
        later.extend(rays(true).into_iter().map(|ray| (ray, place)));
    }
    // Least squares of normal . (place - shift - factor center), in half sizes; with decreasing weights for large ones.
    let mut solution = Vector4::new(0.0, 0.0, 0.0, 1.0);
    for round in 0..ROUNDS {
        let residuals: Vec<[(Vector4<f64>, f64); 2]> = later
            .iter()
            .map(|(ray, place)| {
                let center = ray.center();
                let depth = ray.depth(&(place - solution.xyz() - center * (solution.w - 1.0))).abs().max(1e-12);
                let unit = (depth * ray.half_size()).recip();
                [0, 1].map(|axis| {
                    let normal = ray.normal(axis) * unit;
                    (normal.push(normal.dot(&center)), normal.dot(place))
                })
            })
            .collect();
        let miss = |rows: &[(Vector4<f64>, f64); 2]| rows.map(|(row, value)| row.dot(&solution) - value);
        let mut misses: Vec<f64> = residuals.iter().map(|rows| Vector2::from(miss(rows)).norm()).collect();
        let weight_of = misses.clone();
        let scale = (2.0 * median(&mut misses)?).max(0.02);
        let (mut normal, mut right) = (Matrix4::zeros(), Vector4::zeros());
        for (rows, miss) in residuals.iter().zip(weight_of) {
            let weight = if round == 0 { 1.0 } else { (1.0 + (miss / scale).powi(2)).powi(-2) };
            for (row, value) in rows {
                normal += row * row.transpose() * weight;
                right += row * (value * weight);
            }
        }
        solution = solve_spd(&normal, &right)?;
    }
    let factor = solution.w;
    if factor.is_nan() || factor <= 0.0 {
        return None;
    }
    let mut changed = sample.clone();
    for camera in changed.frames.iter_mut().skip(from as usize).filter_map(|frame| frame.camera.as_mut()) {
        // R (x - shift - factor c) instead of R (x - c).
        camera.translation = camera.translation * factor - camera.rotation * solution.xyz();
    }
    Some((factor, changed))
}
