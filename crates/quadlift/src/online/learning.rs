//! Noise, clutter and sizes, estimated from a sample of the objects whenever the map has grown.

use super::memory::Memory;
use super::objects::Objects;
use super::tracked::{Presence, Tracked};
use crate::association::score::evidence::evidence;
use crate::association::score::fit::{Start, fit};
use crate::association::score::object::Object;
use crate::association::score::scene_statistics::volume_of;
use crate::association::search::passes::PIXEL_SDS;
use crate::tuning::MIN_EVIDENCE_SHARE;

/// Growth of the number of assigned boxes at which statistics are estimated again.
const LEARNING_GROWTH: f64 = 1.1;

/// Growth of the number of assigned boxes at which the slack of edges is selected again.
const SLACK_GROWTH: f64 = 2.0;

/// Maximum number of objects used for noise and sizes, and for the slack; evenly over the map.
const SAMPLE: usize = 128;
const SLACK_SAMPLE: usize = 24;

/// Estimates the statistics of the map if it has grown enough.
pub(super) fn learn_if_due(memory: &mut Memory) {
    memory.running.learn_clutter();
    if memory.running.assigned < memory.running.next_learning {
        return;
    }
    memory.running.next_learning = (LEARNING_GROWTH * memory.running.assigned as f64) as i64 + 1;
    learn(memory);
    if memory.options.edge_noise_px.is_none() && memory.running.assigned >= memory.running.next_slack {
        memory.running.next_slack = (SLACK_GROWTH * memory.running.assigned as f64) as i64;
        choose_slack(memory);
    }
}

/// At most `most` objects with enough views, evenly over the map, and the number of all of them.
fn sample(objects: &Objects, min_views: usize, most: usize) -> (Vec<&Tracked>, usize) {
    let enough = |t: &&Tracked| t.object.views() >= min_views;
    let all: Vec<&Tracked> = objects.tracked().filter(enough).collect();
    let step = all.len().div_ceil(most).max(1);
    let count = all.len();
    (all.into_iter().step_by(step).collect(), count)
}

/// Estimates the statistics from a sample of the objects.
pub(super) fn learn(memory: &mut Memory) {
    let (sample, count) = sample(&memory.objects, memory.options.min_views, SAMPLE);
    let (observations, statistics) = memory.gather(sample.iter().flat_map(|t| &t.views));
    let objects: Vec<Object> =
        in_one_list(sample.iter().copied()).map(|(t, boxes)| Object { boxes, ..t.object.clone() }).collect();
    let mut learned = statistics;
    learned.learn_edge_sd(&observations, &objects);
    learned.learn_sizes(&memory.running.given_sizes, objects.iter());
    if let Some(volume) = volume_of(&observations, &objects) {
        learned.volume = volume;
    }
    learned.objects = count as f64;
    learned.hidden.clear();
    memory.running.statistics = learned;
}

/// Selects the slack of edges as in batch: the largest that costs little evidence.
fn choose_slack(memory: &mut Memory) {
    let sample: Vec<Tracked> = sample(&memory.objects, memory.options.min_views, SLACK_SAMPLE)
        .0
        .into_iter()
        .filter(|t| t.presence == Presence::Confirmed)
        .cloned()
        .collect();
    if sample.is_empty() {
        return;
    }
    let (mut chosen, mut best) = (PIXEL_SDS[0], evidence_with_slack(memory, &sample, PIXEL_SDS[0]));
    for slack in &PIXEL_SDS[1..] {
        let evidence = evidence_with_slack(memory, &sample, *slack);
        if evidence < MIN_EVIDENCE_SHARE.get() * best {
            break;
        }
        (chosen, best) = (*slack, evidence);
    }
    if chosen != memory.running.statistics.edge_noise_px {
        memory.running.statistics.edge_noise_px = chosen;
        learn(memory);
    }
}

/// Evidence of objects after a fit with this slack of edges.
fn evidence_with_slack(memory: &Memory, sample: &[Tracked], slack: f64) -> f64 {
    let (observations, mut statistics) = memory.gather(sample.iter().flat_map(|t| &t.views));
    statistics.edge_noise_px = slack;
    let fitted: Vec<Object> = in_one_list(sample)
        .filter_map(|(t, boxes)| {
            let fitted = fit(&observations, &statistics, boxes, &[Start::body(&t.object)])?;
            Some(Object { forgotten: t.object.forgotten, visible: t.object.visible, ..fitted })
        })
        .collect();
    statistics.learn_edge_sd(&observations, &fitted);
    fitted.iter().map(|o| evidence(&memory.rate, &observations, &statistics, o).max(0.0)).sum()
}

/// Objects with the indices of their views in the list of the views of all of them.
fn in_one_list<'a>(sample: impl IntoIterator<Item = &'a Tracked>) -> impl Iterator<Item = (&'a Tracked, Vec<u32>)> {
    sample.into_iter().scan(0, |next, tracked| {
        let first = *next;
        *next += tracked.views.len() as u32;
        Some((tracked, (first..*next).collect()))
    })
}
