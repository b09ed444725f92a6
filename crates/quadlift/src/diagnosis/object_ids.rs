//! Checks whether object ids persist across frames. Numbers that restart in each frame do not: association without the
//! ids then finds consistent objects that combine many ids.

use std::collections::BTreeMap;

use super::agreement::Agreement;
use super::cause::{Cause, CauseName};
use super::trials::Tried;
use crate::association::{AssociateOptions, IdPolicy};
use crate::scene::{Detection, Scene};

/// Mean fraction of an object's boxes with its most frequent id: persistent ids reach nearly one despite false boxes;
/// numbers that restart in each frame stay below this.
const MIXED: f64 = 0.7;

/// Evidence for each detection (nats) with which objects are found without ids.
const FOUND: f64 = 2.0;

/// Boxes of the associated objects miss by less than this fraction of the misses of the given objects.
const BETTER: f64 = 0.5;

/// The cause `ObjectIds`, if association without the ids shows that they switch between objects.
pub(crate) fn mixed_ids(scene: &Scene, is_used: &impl Fn(&Detection) -> bool, before: Agreement) -> Option<Cause> {
    let options = AssociateOptions { ids: IdPolicy::Ignore, ..Default::default() };
    let mut used = scene.clone().into_parts();
    used.detections.retain(is_used);
    // They are of one source already.
    used.detections.iter_mut().for_each(|d| d.source_index = None);
    used.sources.clear();
    let used = Scene(used);
    let found = Tried::new(&used, &|_| true, &options).given().ok()?;
    let mut counts: BTreeMap<u32, BTreeMap<u32, usize>> = BTreeMap::new();
    for (detection, &index) in found.named.detections.iter().zip(&found.detections) {
        let id = used.detections[index].object_index;
        if let (Some(object), Some(id)) = (detection.object_index, id) {
            *counts.entry(object).or_default().entry(id).or_default() += 1;
        }
    }
    let largest: usize = counts.values().filter_map(|ids| ids.values().max()).sum();
    let all: usize = counts.values().flat_map(|ids| ids.values()).sum();
    let agreed = found.evidence > FOUND && found.agreement.miss < BETTER * before.miss;
    (agreed && all > 0 && (largest as f64) < MIXED * all as f64)
        .then(|| Cause { after: found.agreement, ..Cause::unexplained(CauseName::ObjectIds, before) })
}
