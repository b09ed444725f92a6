//! What remains of a view that is forgotten: the view most like it stands for both.
//!
//! Two views from almost the same place measure the same combinations of the body's parameters. The errors of the box that goes are
//! averaged into those of the box that stays, so that the estimators see the mean of many boxes in a camera that the map keeps.
//! That is the information of the forgotten views with the Jacobians of their neighbor, which is relinearized whenever a
//! body is fitted. When poses change it moves with its camera, and the motion of the forgotten frames relative to that, between those
//! of the kept frames before and after, is taken out of the mean ([`follow`]).

use std::collections::BTreeMap;

use nalgebra::{Matrix3, Vector2, Vector3};

use super::keyframes::Keyframe;
use super::views::{Absorbed, KeptView, MAX_VISITS, Visit, from_bits};
use crate::association::input::observations::Camera;
use crate::association::score::object::Object;
use crate::association::score::scene_statistics::SceneStatistics;

/// Edges that disagree more than this many standard deviations with the body are not averaged: the usual bound of outliers.
const MAX_DEVIATIONS: f64 = 3.0;

/// Frames whose keys differ by less than this belong to one visit: poses drift little between them.
const SAME_VISIT: f64 = 32.0;

/// How the poses of frames change: the motion of what their cameras see, `X_new = turn X + shift`, by the keys of the frames.
#[derive(Debug, Default)]
pub(super) struct Motions {
    pub of_frames: BTreeMap<u32, (Matrix3<f64>, Vector3<f64>)>,
}

impl Motions {
    /// The motion at a time, given as a key: between those of the frames before and after.
    fn at(&self, key: f64) -> Option<(Matrix3<f64>, Vector3<f64>)> {
        let before = self.of_frames.range(..=key.floor() as u32).next_back();
        let after = self.of_frames.range(key.ceil() as u32..).next();
        match (before, after) {
            (Some((&a, first)), Some((&b, second))) if a < b => {
                let share = (key - f64::from(a)) / f64::from(b - a);
                Some((first.0 * (1.0 - share) + second.0 * share, first.1.lerp(&second.1, share)))
            }
            (Some((_, motion)), _) | (None, Some((_, motion))) => Some(*motion),
            (None, None) => None,
        }
    }
}

/// Averages the errors of a view that is forgotten into this one. Nothing happens if the two do not measure the same
/// edges, or if an edge of the other is an outlier.
pub(super) fn absorb(
    view: &mut KeptView,
    own: &Camera,
    other: &KeptView,
    others: &Keyframe,
    object: &Object,
    statistics: &SceneStatistics,
) {
    if (view.cut, view.hidden) != (other.cut, other.hidden) {
        return;
    }
    // Shifts of frames stay in the errors: they are averaged, too.
    let errors = |view: &KeptView, camera: &Camera| {
        let prediction = object.predict(camera)?;
        let observation = view.observation(0, &Vector2::zeros());
        let edges = view.averaged(observation.edges);
        let errors: [f64; 4] = std::array::from_fn(|e| edges[e] - prediction.edges[e]);
        let [width, height] = prediction.size();
        Some((errors, statistics.sd(&observation), (width * height).sqrt()))
    };
    let (Some((mine, _, size)), Some((theirs, sd, other_size))) = (errors(view, own), errors(other, &others.camera))
    else {
        return;
    };
    let measured = from_bits(!(view.cut | view.hidden));
    let is_outlier = |e: usize| measured[e] && (theirs[e] - others.shift[e % 2]).abs() > MAX_DEVIATIONS * sd;
    if (0..4).any(is_outlier) {
        return;
    }
    let (count, other_count) = (f64::from(view.stands_for()), f64::from(other.stands_for()));
    let share = other_count / (count + other_count);
    // The same error of the body is smaller in pixels from farther away.
    let scale = size / other_size;
    let offset = std::array::from_fn(|e| {
        let before = view.absorbed.as_ref().map_or(0.0, |absorbed| f64::from(absorbed.offset[e]));
        let change = if measured[e] { share * (scale * theirs[e] - mine[e]) } else { 0.0 };
        (before + change) as f32
    });
    let mut visits = view.visits().to_vec();
    let of_other = Visit { mean_key: f64::from(other.keyframe), views: 1 };
    other.visits().iter().chain([&of_other]).for_each(|visit| add_visit(&mut visits, *visit));
    view.absorbed = Some(Box::new(Absorbed { offset, visits }));
}

/// Corrects the mean for a change of poses; `object` is the body and `old` the camera before it.
pub(super) fn follow(view: &mut KeptView, object: &Object, old: &Camera, motions: &Motions) {
    let keyframe = f64::from(view.keyframe);
    let Some(absorbed) = &mut view.absorbed else { return };
    let Some((turn, shift)) = motions.at(keyframe) else { return };
    let (Some(turn_back), Some(before)) = (turn.try_inverse(), object.predict(old)) else { return };
    let views = f64::from(absorbed.views());
    for visit in &absorbed.visits {
        let Some(others) = motions.at(visit.mean_key) else { continue };
        // The body where the forgotten frames saw it, relative to where this frame saw it.
        let turn = turn_back * others.0;
        let center = turn * object.center + turn_back * (others.1 - shift);
        let seen_by_others = Object { center, root: turn * object.root, ..object.clone() };
        let Some(after) = seen_by_others.predict(old) else { continue };
        let share = f64::from(visit.views) / views;
        for e in 0..4 {
            absorbed.offset[e] += (share * (after.edges[e] - before.edges[e])) as f32;
        }
    }
}

/// Adds views to the visit at that time, or as a new one.
fn add_visit(visits: &mut Vec<Visit>, new: Visit) {
    let apart = |a: &Visit, b: &Visit| (a.mean_key - b.mean_key).abs();
    if let Some(known) = visits.iter_mut().find(|visit| apart(visit, &new) < SAME_VISIT) {
        *known = known.and(new);
        return;
    }
    let place = visits.partition_point(|visit| visit.mean_key < new.mean_key);
    visits.insert(place, new);
    if visits.len() > MAX_VISITS {
        let nearest = (1..visits.len())
            .min_by(|&a, &b| apart(&visits[a - 1], &visits[a]).total_cmp(&apart(&visits[b - 1], &visits[b])));
        let Some(second) = nearest else { return };
        let visit = visits.remove(second);
        visits[second - 1] = visits[second - 1].and(visit);
    }
}
