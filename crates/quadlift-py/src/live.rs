//! What a viewer shows of an object map: gathered while frames arrive, logged in Python.

use std::collections::BTreeSet;

use nalgebra::Vector3;
use quadlift::online::{FrameUpdate, ObjectMap};
use quadlift_io::stream::CheckedFrame;
use quadlift_report::{LiveMap, LiveRecord};

/// Events that wait to be logged, at most; older ones are dropped.
const MAX_EVENTS: usize = 10_000;

/// What a viewer shows, and what has changed since it was logged.
#[derive(Default)]
pub(crate) struct Live {
    /// What is shown; none before it is asked for.
    map: Option<LiveMap>,
    /// The last frame, as long as nothing is shown.
    last: Option<(CheckedFrame, FrameUpdate)>,
    changed: Option<LiveRecord>,
}

impl Live {
    /// Takes in a frame that the map has observed.
    pub(crate) fn frame(&mut self, map: &ObjectMap, checked: &CheckedFrame, update: &FrameUpdate) {
        match &mut self.map {
            Some(live) => {
                let record = record_of(live, map, checked, update);
                self.add(record);
            }
            None => self.last = Some((checked.clone(), update.clone())),
        }
    }

    /// Takes in other changes of the map.
    pub(crate) fn others(&mut self, map: &ObjectMap, update: &FrameUpdate) {
        if let Some(live) = &mut self.map {
            let record = live.others(map, update);
            self.add(record);
        }
    }

    /// What has changed since this was called before; all objects and the last frame the first time.
    ///
    /// `up` is the direction against gravity.
    pub(crate) fn take(&mut self, map: &ObjectMap, up: Option<[f64; 3]>) -> LiveRecord {
        let is_first = self.map.is_none();
        // Images are shown as they are.
        let live = self.map.get_or_insert_with(LiveMap::in_images);
        let mut record = match (self.changed.take(), self.last.take()) {
            (Some(changed), _) => changed,
            (None, Some((checked, update))) => record_of(live, map, &checked, &update),
            (None, None) => live.others(map, &FrameUpdate::default()),
        };
        record.up = up.filter(|_| is_first).and_then(|up| Some(Vector3::from(up).try_normalize(0.0)?.into()));
        record
    }

    /// Adds a record to those that wait.
    fn add(&mut self, record: LiveRecord) {
        let Some(mut waiting) = self.changed.take() else {
            self.changed = Some(record);
            return;
        };
        let LiveRecord { index, time, up, frame, objects, gone, events } = record;
        let new: BTreeSet<&str> =
            objects.iter().map(|o| o.id.as_str()).chain(gone.iter().map(String::as_str)).collect();
        waiting.objects.retain(|object| !new.contains(object.id.as_str()));
        waiting.gone.retain(|id| !new.contains(id.as_str()));
        waiting.objects.extend(objects);
        waiting.gone.extend(gone);
        waiting.events.extend(events);
        let surplus = waiting.events.len().saturating_sub(MAX_EVENTS);
        waiting.events.drain(..surplus);
        let (up, frame) = (up.or(waiting.up), frame.or(waiting.frame.take()));
        self.changed = Some(LiveRecord { index, time, up, frame, ..waiting });
    }
}

/// The record of a frame, with the path of its image.
fn record_of(live: &mut LiveMap, map: &ObjectMap, checked: &CheckedFrame, update: &FrameUpdate) -> LiveRecord {
    let mut record = live.frame(map, &checked.frame, &checked.detections(), update);
    if let Some(frame) = &mut record.frame {
        frame.image = checked.image().map(str::to_owned);
    }
    record
}
