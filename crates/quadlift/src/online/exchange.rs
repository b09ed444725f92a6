//! Views that an object gives to another one nearby after poses have changed.

use super::memory::Memory;
use super::own_views::{add_late, refit, take_back};
use super::recent_frames::{detections_of, set_owner};
use super::tracked::Tracked;
use super::update::{DetectionRef, Event, FrameUpdate};
use super::views::KeptView;
use crate::association::score::fit::Start;
use crate::association::score::log_likelihood_ratio::LogLikelihoodRatios;

/// Views are tried with another object whose center is nearer than this many times the sum of the radii. Tuned on the
/// loop closures of `quadlift-bench online`, six scenes each, after a drift of 10 degrees: with 3, 6, 12 F1 is .972, .977, .985 along the street
/// (.992 with exact poses from the beginning) and .992, .995, .997 around the objects. More costs more fits.
pub(super) const REACH: f64 = 12.0;

/// A view is tried with the other object if its log likelihood ratio there is lower by at most this, nats. Tuned likewise: with 2,
/// 4, 8, 16 F1 along the street is .966, .977, .978, .977 (reach 6).
const MAX_LOG_LIKELIHOOD_LOSS: f64 = 8.0;

/// Gives views to another object, all that fit it nearly as well, where that increases the evidence of both together.
///
/// Each of these views alone would stay, since the body has been fitted to all of them.
pub(super) fn reassign_views(memory: &mut Memory, from: u32, to: u32, update: &mut FrameUpdate) {
    let (Some(giver), Some(taker)) = (memory.objects.get(from), memory.objects.get(to)) else { return };
    let given = views_that_fit(memory, giver, taker);
    if given.is_empty() || giver.views.len() - given.len() < 2 {
        return;
    }
    let (mut fewer, mut more) = (giver.clone(), taker.clone());
    for view in &given {
        fewer.views.retain(|v| !v.is_same(view));
        more.add_view(view.clone(), None);
    }
    fewer.renumber();
    let Some(after) = refitted_evidence(memory, &fewer).zip(refitted_evidence(memory, &more)) else { return };
    if after.0 + after.1 <= memory.evidence_of(giver) + memory.evidence_of(taker) {
        return;
    }
    let object = Some(taker.id);
    let detections: Vec<DetectionRef> =
        given.iter().flat_map(|view| detections_of(&memory.recent, &memory.keyframes, view)).collect();
    for view in given {
        memory.keyframes.hold(view.keyframe);
        let repeats = set_owner(&mut memory.recent, &view, object);
        take_back(memory, from, &view, None, repeats);
        let key = view.keyframe;
        add_late(memory, to, view, None, repeats);
        memory.keyframes.release(key);
    }
    update.events.push(Event::Reassigned { object, detections });
    refit(memory, from, update);
    refit(memory, to, update);
}

/// Views of an object that fit another one nearly as well, in frames in which that has none.
fn views_that_fit(memory: &Memory, giver: &Tracked, taker: &Tracked) -> Vec<KeptView> {
    let (observations, statistics) = memory.gather(&giver.views);
    let ratios = LogLikelihoodRatios::new(&observations, &statistics);
    let gain = |tracked: &Tracked, index| ratios.predicted_gain(&tracked.object, index).map(|ratio| ratio.value);
    let fits = |index: &usize| {
        let own = gain(giver, *index).unwrap_or(0.0);
        gain(taker, *index).is_some_and(|other| other > (own - MAX_LOG_LIKELIHOOD_LOSS).max(0.0))
    };
    let is_new = |index: &usize| !taker.is_seen_in(giver.views[*index].keyframe);
    (0..giver.views.len()).filter(is_new).filter(fits).map(|index| giver.views[index].clone()).collect()
}

/// Evidence of an object fitted to its views.
fn refitted_evidence(memory: &Memory, tracked: &Tracked) -> Option<f64> {
    let mut fitted = tracked.clone();
    fitted.replace_fit(memory.fit_views(tracked, &[Start::body(&tracked.object)])?);
    fitted.object.visible = fitted.object.visible.max(fitted.object.views());
    Some(memory.evidence_of(&fitted))
}
