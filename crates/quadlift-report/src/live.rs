//! What changes in an object map, frame by frame, in the records of a recording (docs/formats/exports.md): the content of a live
//! view.

use std::collections::{BTreeMap, BTreeSet};
use std::ops::Bound;

use nalgebra::Vector2;
use quadlift::geometry::Body;
use quadlift::online::{Event, Frame, FrameUpdate, MapObject, ObjectId, ObjectMap, Presence};
use quadlift::scene::{NewDetection, Shape};
use quadlift_io::stream::EventRecord;
use serde::Serialize;

use crate::colors::{UNKNOWN, of_object};
use crate::data::ReportBody;
use crate::recording::{
    Owner, RecordingBody, RecordingBox, RecordingBox3d, RecordingCamera, RecordingFrame, RecordingObject,
    RecordingOutline, drawable, line, recording_camera,
};

/// Objects that a frame does not show and whose bodies are compared all the same, for each frame: a detection that changes
/// its object also changes the body that it leaves.
const COMPARED_IN_TURN: usize = 16;

/// What has changed since the record before.
#[derive(Debug, Clone, Serialize)]
pub struct LiveRecord {
    /// Number of frames that were observed before this one.
    pub index: u64,
    /// Time of the frame, seconds.
    pub time: Option<f64>,
    /// Unit world direction against gravity, if it has become known; set by who makes the record.
    pub up: Option<[f64; 3]>,
    /// The frame with its boxes; `None` where no frame was observed.
    pub frame: Option<RecordingFrame>,
    /// Confirmed objects that are new or whose body has changed.
    pub objects: Vec<RecordingObject>,
    /// Objects that are no longer shown.
    pub gone: Vec<String>,
    /// What happened.
    pub events: Vec<LiveEvent>,
}

impl LiveRecord {
    /// A record of something that has changed nothing.
    pub fn of_event(map: &ObjectMap, event: LiveEvent) -> Self {
        Self { events: vec![event], ..Self::empty(map) }
    }

    fn empty(map: &ObjectMap) -> Self {
        Self {
            index: map.frames().saturating_sub(1),
            time: map.last_frame().map(|(_, time)| time),
            up: None,
            frame: None,
            objects: Vec::new(),
            gone: Vec::new(),
            events: Vec::new(),
        }
    }
}

/// An event as text.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct LiveEvent {
    /// `INFO`, `WARN` or `ERROR`, as in Rerun.
    pub level: &'static str,
    /// What happened.
    pub text: String,
}

impl LiveEvent {
    /// An error in the input.
    pub fn error(text: String) -> Self {
        Self { level: "ERROR", text }
    }

    fn new(event: &Event, map: &ObjectMap) -> Self {
        let named = |id: &ObjectId| match map.object(*id).and_then(|object| category(&object)) {
            Some(category) => format!("{id} ({category})"),
            None => id.to_string(),
        };
        let text = match event {
            Event::New { object, .. } => format!("new {}", named(object)),
            Event::Confirmed { object } => format!("confirmed {}", named(object)),
            Event::Returned { object } => format!("returned {}", named(object)),
            Event::Reassigned { object, detections } => {
                let count = match detections.len() {
                    1 => "1 detection".to_owned(),
                    n => format!("{n} detections"),
                };
                format!("reassigned {count} to {}", object.as_ref().map_or("clutter".to_owned(), named))
            }
            Event::Merged { object, alias } => format!("merged {alias} into {}", named(object)),
            Event::Removed { object, .. } => match EventRecord::from(event) {
                EventRecord::Removed { reason, .. } => format!("removed {}: {reason}", named(object)),
                _ => format!("removed {}", named(object)),
            },
            Event::Disagrees { expected } => {
                let text = format!("the frame contradicts the map: none of {expected} expected objects is detected");
                return Self { level: "WARN", text };
            }
            _ => "an event that this version does not know".to_owned(),
        };
        Self { level: "INFO", text }
    }
}

/// Which objects of a map are shown, and with which bodies.
#[derive(Debug, Clone, Default)]
pub struct LiveMap {
    shown: BTreeMap<ObjectId, (RecordingBody, Option<String>)>,
    /// Where the comparison in turn goes on.
    compared: Option<ObjectId>,
    is_begun: bool,
    in_images: bool,
}

impl LiveMap {
    /// With boxes as they were measured, for images with lens distortion; otherwise they are those of the pinhole camera.
    pub fn in_images() -> Self {
        Self { in_images: true, ..Self::default() }
    }

    /// What a frame has changed, after [`ObjectMap::observe`]. The time depends on what the frame shows, not on the size of the
    /// map, except for the first call, which lists all objects.
    pub fn frame(
        &mut self,
        map: &ObjectMap,
        frame: &Frame,
        detections: &[NewDetection],
        update: &FrameUpdate,
    ) -> LiveRecord {
        let objects = match self.is_begun {
            true => self.objects_of(map, update),
            false => self.all(map),
        };
        LiveRecord {
            frame: Some(frame_record(frame, detections, update, self.in_images)),
            ..self.record(map, update, &objects)
        }
    }

    /// What new poses or the end of a stream have changed; compares all objects.
    pub fn others(&mut self, map: &ObjectMap, update: &FrameUpdate) -> LiveRecord {
        let objects = self.all(map);
        self.record(map, update, &objects)
    }

    fn all(&self, map: &ObjectMap) -> BTreeSet<ObjectId> {
        self.shown.keys().copied().chain(map.objects().map(|object| object.id)).collect()
    }

    /// The objects that an update names, and the next ones in turn.
    fn objects_of(&mut self, map: &ObjectMap, update: &FrameUpdate) -> BTreeSet<ObjectId> {
        let mut found: BTreeSet<ObjectId> = update.objects.iter().flatten().copied().collect();
        for event in &update.events {
            match *event {
                Event::Merged { object, alias } => found.extend([object, alias]),
                Event::New { object, .. }
                | Event::Confirmed { object }
                | Event::Removed { object, .. }
                | Event::Returned { object }
                | Event::Reassigned { object: Some(object), .. } => drop(found.insert(object)),
                _ => {}
            }
        }
        let after = self.compared.map_or(Bound::Unbounded, Bound::Excluded);
        let in_turn: Vec<ObjectId> =
            self.shown.range((after, Bound::Unbounded)).map(|(&id, _)| id).take(COMPARED_IN_TURN).collect();
        self.compared = in_turn.last().copied().filter(|_| in_turn.len() == COMPARED_IN_TURN);
        found.extend(in_turn);
        // Only what the map still has, or what is shown.
        found.retain(|id| self.shown.contains_key(id) || map.object(*id).is_some());
        found
    }

    fn record(&mut self, map: &ObjectMap, update: &FrameUpdate, objects: &BTreeSet<ObjectId>) -> LiveRecord {
        self.is_begun = true;
        let (mut changed, mut gone) = (Vec::new(), Vec::new());
        for &id in objects {
            let object = map.object(id).filter(|object| object.id == id && object.presence == Presence::Confirmed);
            let body = object.as_ref().and_then(|object| drawable(&ReportBody::from(&Body::from(object.ellipsoid))));
            match (object, body) {
                (Some(object), Some(body)) => {
                    let shown = (body, category(&object));
                    if self.shown.get(&id) == Some(&shown) {
                        continue;
                    }
                    changed.push(RecordingObject {
                        id: id.to_string(),
                        category: shown.1.clone(),
                        status: None,
                        color: of_object(index(id)),
                        estimate: Some(shown.0.clone()),
                        truth: None,
                    });
                    self.shown.insert(id, shown);
                }
                _ => gone.extend(self.shown.remove(&id).map(|_| id.to_string())),
            }
        }
        let events = update.events.iter().map(|event| LiveEvent::new(event, map)).collect();
        LiveRecord { objects: changed, gone, events, ..LiveRecord::empty(map) }
    }
}

/// The index of an object, from 0.
fn index(id: ObjectId) -> usize {
    usize::try_from(id.0.saturating_sub(1)).unwrap_or_default()
}

/// The most frequent category of an object's detections.
fn category(object: &MapObject) -> Option<String> {
    object.categories.first().and_then(|(category, _)| category.clone())
}

/// The corners of an outline or an oriented box, and the first one again.
fn closed_shape(shape: &Shape) -> Option<Vec<Vector2<f64>>> {
    let mut corners: Vec<Vector2<f64>> = match (shape.outline, &shape.oriented_box) {
        (Some(outline), _) => outline.iter().copied().map(Vector2::from).collect(),
        (None, turned) => turned.as_ref()?.corners().to_vec(),
    };
    corners.extend(corners.first().copied());
    Some(corners)
}

fn frame_record(frame: &Frame, detections: &[NewDetection], update: &FrameUpdate, in_image: bool) -> RecordingFrame {
    let (mut boxes, mut detected_outlines, mut boxes3d) = (Vec::new(), Vec::new(), Vec::new());
    for (detection, object) in detections.iter().zip(&update.objects) {
        let owner = Owner {
            object: object.map(|id| id.to_string()),
            category: detection.category.map(str::to_owned),
            inlier: None,
            color: object.map_or(UNKNOWN, |id| of_object(index(id))),
        };
        let measured = detection.cues.box3d;
        boxes3d.extend(measured.and_then(|measured| RecordingBox3d::new(&measured, &frame.projection, &owner)));
        let lens = frame.lens.as_ref().filter(|_| !in_image);
        // Corners are not undistorted: their sides would be curves.
        if let Some(border) = closed_shape(&detection.shape()).filter(|_| lens.is_none()) {
            detected_outlines.push(RecordingOutline { lines: vec![line(&border)], owner: owner.clone() });
        }
        let measured = detection.box_or_around();
        let shown = match lens {
            Some(lens) => measured.and_then(|measured| lens.undistort_box(&measured)),
            None => measured,
        };
        boxes.extend(shown.map(|shown| RecordingBox { edges: shown.edges(), owner }));
    }
    let camera = recording_camera(&frame.projection);
    // Of unknown size: the principal point is its center.
    let around_center = |camera: &RecordingCamera| [0, 1].map(|row| (2.0 * camera.intrinsics[row][2]).max(1.0));
    let size = frame.image_size.map(Into::into).or_else(|| camera.as_ref().map(around_center));
    RecordingFrame {
        frame_index: 0,
        id: frame.id.clone(),
        time: Some(frame.time),
        size: size.unwrap_or([1.0; 2]),
        image: None,
        camera,
        boxes,
        ellipses: Vec::new(),
        detected_outlines,
        boxes3d,
        outlines: Vec::new(),
        true_outlines: Vec::new(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Matrix3x4;
    use quadlift::geometry::{BoundingBox, Camera, CameraModel, Projection};
    use quadlift::online::OnlineOptions;

    /// A camera moves along two rows of cups, which are so far apart that few of them are seen at once.
    fn frame(k: u32) -> (Frame, Vec<BoundingBox>) {
        let x = 0.25 * f64::from(k);
        let p = Matrix3x4::new(500.0, 0.0, 320.0, -500.0 * x, 0.0, 500.0, 240.0, 0.0, 0.0, 0.0, 1.0, 0.0);
        let image_size = Some([640.0, 480.0].into());
        let projection = Projection::from_matrix(p).unwrap();
        let frame = Frame { image_size, ..Frame::new(format!("{k}.jpg"), f64::from(k) / 10.0, projection) };
        let edges = (0..20).filter_map(|cup| {
            let u = 320.0 + 100.0 * (3.0 * f64::from(cup) - x);
            (60.0..580.0).contains(&u).then(|| BoundingBox::new([u - 50.0, 190.0, u + 50.0, 290.0]).unwrap())
        });
        (frame, edges.collect())
    }

    fn bodies(map: &ObjectMap) -> BTreeMap<String, RecordingBody> {
        let confirmed = map.objects().filter(|object| object.presence == Presence::Confirmed);
        confirmed
            .map(|object| (object.id.to_string(), drawable(&ReportBody::from(&Body::from(object.ellipsoid))).unwrap()))
            .collect()
    }

    #[test]
    fn the_records_add_up_to_the_map_and_are_short() {
        let mut map = ObjectMap::new(OnlineOptions::default()).unwrap();
        let (mut live, mut shown) = (LiveMap::default(), BTreeMap::new());
        let mut longest = 0;
        let mut take = |record: &LiveRecord| {
            for object in &record.objects {
                shown.insert(object.id.clone(), object.estimate.clone().unwrap());
            }
            record.gone.iter().for_each(|id| assert!(shown.remove(id).is_some(), "{id} was shown"));
            shown.clone()
        };
        for k in 0..200 {
            let (frame, boxes) = frame(k);
            let detections: Vec<NewDetection> =
                boxes.iter().map(|&b| NewDetection { category: Some("cup"), ..NewDetection::from_box(b) }).collect();
            let update = map.observe(&frame, &detections).unwrap();
            let record = live.frame(&map, &frame, &detections, &update);
            assert_eq!((record.index, record.time), (u64::from(k), Some(frame.time)));
            let of_frame = record.frame.as_ref().unwrap();
            assert_eq!((of_frame.boxes.len(), of_frame.size), (boxes.len(), [640.0, 480.0]));
            assert_eq!(record.events.len(), update.events.len());
            longest = longest.max(record.objects.len());
            take(&record);
        }
        assert!(map.objects().count() > 10 && longest < 8, "{} objects, {longest} in a record", map.objects().count());
        let update = map.settle();
        assert_eq!(take(&live.others(&map, &update)), bodies(&map));
        let gone = map.objects().next().unwrap().id;
        assert!(map.remove(gone));
        let record = live.others(&map, &FrameUpdate::default());
        assert_eq!((&record.gone, record.objects.len()), (&vec![gone.to_string()], 0));
        // What goes on with a map that has objects begins with all of them.
        let (frame, _) = frame(400);
        let update = map.observe(&frame, &[]).unwrap();
        let mut again = LiveMap::default();
        assert_eq!(again.frame(&map, &frame, &[], &update).objects.len(), bodies(&map).len());
    }

    #[test]
    fn a_box_has_the_color_of_its_object() {
        let (frame, boxes) = frame(0);
        let detections: Vec<NewDetection> = boxes.iter().map(|&b| NewDetection::from_box(b)).collect();
        assert_eq!(detections.len(), 1);
        for (object, color) in [(None, UNKNOWN), (Some(ObjectId(12)), of_object(1))] {
            let update = FrameUpdate { objects: vec![object], events: Vec::new() };
            assert_eq!(frame_record(&frame, &detections, &update, false).boxes[0].owner.color, color);
        }
    }

    #[test]
    fn boxes_are_those_of_the_pinhole_camera_or_of_the_image() {
        let (mut frame, boxes) = frame(0);
        let lens = Camera::new(CameraModel::SimpleRadial, &[500.0, 320.0, 240.0, -0.1]).unwrap();
        frame.lens = Some(lens);
        let update = FrameUpdate { objects: vec![None], events: Vec::new() };
        let shown =
            |in_image| frame_record(&frame, &[NewDetection::from_box(boxes[0])], &update, in_image).boxes[0].edges;
        assert_eq!(shown(true), boxes[0].edges());
        assert_eq!(shown(false), lens.undistort_box(&boxes[0]).unwrap().edges());
        assert_ne!(shown(false), shown(true));
    }
}
