//! A camera of a rig whose detections are of another time step than those of the other cameras (ours).
//!
//! The other cameras say where the objects are. The boxes of a camera that is late miss them, and meet them again where each box is
//! moved to the camera's frame some time steps before or after. What only that camera sees says nothing.

use std::collections::{BTreeMap, BTreeSet};

use nalgebra::Vector3;

use super::agreement::{Agreement, Improvement};
use super::cause::{Cause, CauseName};
use super::misses::{AGREES, ReprojectionErrors, corrected_ray, point_of, size};
use super::rays::MAX_MISS;
use super::sample::{Sample, Seen};
use crate::scene::{Detection, RigCamera, Scene};

/// Time steps by which detections may be late or early; as they are comes first.
const OFFSETS: [i64; 5] = [0, 1, -1, 2, -2];

/// Boxes of the sample.
const MAX_BOXES: usize = 3_000;

/// A box is of an object whose size it shows but for this factor (a logarithm). A convention: boxes show bodies that are up to this much
/// longer than high.
const SAME_SIZE: f64 = 0.7;

/// An object as other cameras see it.
struct Place {
    point: Vector3<f64>,
    size: f64,
}

/// Looks for a camera of a rig whose boxes meet the objects of the other cameras at another time step only. `by_object` says that a
/// box is of the object whose number it has, not of any.
pub(crate) fn of_scene(
    scene: &Scene,
    is_used: impl Fn(&Detection) -> bool,
    by_object: bool,
    before: Agreement,
) -> Option<Cause> {
    if scene.frames.iter().all(|frame| frame.rig.is_none()) {
        return None;
    }
    let rigs: Vec<Option<RigCamera>> = scene.frames.iter().map(|frame| frame.rig).collect();
    late_camera(&Sample::with_at_most(scene, is_used, MAX_BOXES), &rigs, by_object, before)
}

/// The same in a sample; `rigs` are those of the scene's frames.
fn late_camera(sample: &Sample, rigs: &[Option<RigCamera>], by_object: bool, before: Agreement) -> Option<Cause> {
    let frame_at: BTreeMap<(u32, i64), usize> = rigs
        .iter()
        .enumerate()
        .filter_map(|(frame, rig)| Some(((rig.as_ref()?.camera?, rig.as_ref()?.time_step as i64), frame)))
        .collect();
    let cameras: BTreeSet<u32> = frame_at.keys().map(|(camera, _)| *camera).collect();
    if cameras.len() < 2 {
        return None;
    }
    let late = |&camera: &u32| {
        let of_camera = OfCamera { sample, rigs, frame_at: &frame_at, camera };
        of_camera.offset(by_object).map(|(steps, gain)| (camera, steps, gain))
    };
    // The first of equals.
    let found = cameras.iter().rev().filter_map(late).max_by(|a, b| a.2.gain.total_cmp(&b.2.gain));
    let (camera, steps, gain) = found?;
    let frames = (0..rigs.len()).filter(|&k| rigs[k].is_some_and(|rig| rig.camera == Some(camera)));
    Some(Cause {
        value: Some(steps as f64),
        frames: frames.map(|k| sample.frame_ids[k].to_owned()).collect(),
        after: gain.after,
        ..Cause::unexplained(CauseName::CameraOffset, before)
    })
}

/// A camera of a rig.
struct OfCamera<'a> {
    sample: &'a Sample<'a>,
    rigs: &'a [Option<RigCamera>],
    /// The frame of each camera at each time step.
    frame_at: &'a BTreeMap<(u32, i64), usize>,
    camera: u32,
}

impl OfCamera<'_> {
    fn has(&self, seen: &Seen) -> bool {
        self.rigs[seen.frame as usize].is_some_and(|rig| rig.camera == Some(self.camera))
    }

    /// The objects as the other cameras see them; `None` for those that fewer than two of their boxes show.
    fn places(&self) -> Vec<Option<Place>> {
        let place = |object: &Vec<Seen>| {
            let others: Vec<Seen> = object.iter().filter(|seen| !self.has(seen)).copied().collect();
            let point = point_of(self.sample, &others).filter(|_| others.len() >= 2)?;
            Some(Place { point, size: size(self.sample, &others)? })
        };
        self.sample.objects.iter().map(place).collect()
    }

    /// By how much a box misses a place if it is of another time step.
    fn miss(&self, seen: &Seen, steps: i64, place: &Place) -> Option<f64> {
        let rig = self.rigs[seen.frame as usize]?;
        let frame = *self.frame_at.get(&(self.camera, rig.time_step as i64 + steps))?;
        let ray = corrected_ray(self.sample, &Seen { frame: frame as u32, ..*seen }, None, None)?;
        let shown = ray.half_size() * ray.depth(&place.point);
        ((shown / place.size).ln().abs() < SAME_SIZE).then(|| ray.miss(&place.point))
    }

    /// The time steps by which the boxes are off, if an offset explains them.
    fn offset(&self, by_object: bool) -> Option<(i64, Improvement)> {
        let places = self.places();
        let mut values: [Vec<f64>; OFFSETS.len()] = Default::default();
        let mut ends = Vec::new();
        for (own, object) in self.sample.objects.iter().enumerate() {
            for seen in object.iter().filter(|seen| self.has(seen)) {
                let misses = OFFSETS.map(|steps| {
                    let met = (0..places.len()).filter(|&k| !by_object || k == own);
                    let met = met.filter_map(|k| self.miss(seen, steps, places[k].as_ref()?));
                    met.fold(MAX_MISS, f64::min)
                });
                // What only this camera sees.
                if misses.iter().all(|miss| *miss > AGREES) {
                    continue;
                }
                values.iter_mut().zip(misses).for_each(|(values, miss)| values.push(miss));
            }
            if ends.last().copied().unwrap_or(0) < values[0].len() {
                ends.push(values[0].len());
            }
        }
        let boxes = values[0].len();
        let [given, others @ ..] = values.map(|values| ReprojectionErrors::new(values, ends.clone()));
        let gains = OFFSETS[1..].iter().zip(&others).map(|(&steps, after)| (steps, given.gain_of(after)));
        let best = gains.max_by(|a, b| a.1.gain.total_cmp(&b.1.gain).then(b.0.abs().cmp(&a.0.abs())))?;
        best.1.explains(boxes, ends.len()).then_some(best)
    }
}
