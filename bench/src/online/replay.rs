//! A scene observed frame by frame.

use std::collections::HashMap;

use quadlift::online::{Event, Frame, FrameUpdate, ObjectId, ObjectMap, Removal};
use quadlift::scene::{NewDetection, Scene};

/// The detections of a scene with their objects, as the updates of a map tell.
#[derive(Debug, Default)]
pub(crate) struct Labels {
    /// For each detection of the scene, the object that it was last said to be of.
    objects: Vec<Option<ObjectId>>,
    /// Detections by frame id and place in the frame.
    places: HashMap<(String, usize), usize>,
    /// Merged objects.
    aliases: HashMap<ObjectId, ObjectId>,
    /// Objects that were removed because their boxes are clutter.
    removed: Vec<ObjectId>,
}

/// The detections of each frame of a scene that have a box, in their order.
pub(super) fn by_frame(scene: &Scene) -> Vec<Vec<usize>> {
    let mut detections = vec![Vec::new(); scene.frames.len()];
    for (index, detection) in scene.detections.iter().enumerate() {
        if detection.bounding_box.is_some() {
            detections[detection.frame_index as usize].push(index);
        }
    }
    detections
}

/// A detection of a scene as a map observes it; `None` without a box.
pub(super) fn observed(scene: &Scene, index: usize) -> Option<NewDetection<'_>> {
    let detection = &scene.detections[index];
    Some(NewDetection {
        category: detection.category_index.map(|c| scene.categories[c as usize].as_str()),
        score: detection.score,
        object: detection.object_index.map(|o| scene.object_ids[o as usize].as_str()),
        cues: detection.cues.as_deref().copied().unwrap_or_default(),
        ..NewDetection::from_box(detection.bounding_box?)
    })
}

impl Labels {
    /// Before anything is observed of a scene.
    pub(super) fn new(scene: &Scene) -> Self {
        Self { objects: vec![None; scene.detections.len()], ..Default::default() }
    }

    /// Takes in what a frame has changed; `detections` are those of the frame in the scene.
    pub(super) fn apply(&mut self, frame: &str, detections: &[usize], update: &FrameUpdate) {
        for (place, (&detection, object)) in detections.iter().zip(&update.objects).enumerate() {
            self.places.insert((frame.to_owned(), place), detection);
            self.objects[detection] = *object;
        }
        for event in &update.events {
            let (object, of) = match event {
                Event::New { object, detections } => (Some(*object), detections),
                Event::Reassigned { object, detections } => (*object, detections),
                Event::Merged { object, alias } => {
                    self.aliases.insert(*alias, *object);
                    continue;
                }
                Event::Removed { object, reason } if *reason != Removal::Gone => {
                    self.removed.push(*object);
                    continue;
                }
                _ => continue,
            };
            for detection in of {
                if let Some(&index) = self.places.get(&(detection.frame.clone(), detection.detection)) {
                    self.objects[index] = object;
                }
            }
        }
    }

    /// For each detection the number of its object among those of the map; `None` for clutter and for objects that the map is
    /// not certain of.
    pub(super) fn division(&self, map: &ObjectMap) -> Vec<Option<u32>> {
        let place: HashMap<ObjectId, u32> = map.objects().map(|o| o.id).zip(0..).collect();
        let resolve = |mut id: ObjectId| {
            while let Some(&older) = self.aliases.get(&id) {
                id = older;
            }
            id
        };
        self.objects.iter().map(|object| place.get(&resolve((*object)?)).copied()).collect()
    }
}

/// Observes all frames of a scene in their order; `after` is called after each with the number of frames so far.
pub(crate) fn replay(map: &mut ObjectMap, scene: &Scene, mut after: impl FnMut(usize, &ObjectMap, &Labels)) -> Labels {
    let mut labels = Labels::new(scene);
    for (index, (frame, indices)) in scene.frames.iter().zip(by_frame(scene)).enumerate() {
        let detections: Vec<NewDetection> = indices.iter().filter_map(|&d| observed(scene, d)).collect();
        let frame = Frame::of_scene(scene, frame, index as f64);
        if let Ok(update) = map.observe(&frame, &detections) {
            labels.apply(&frame.id, &indices, &update);
        }
        after(index + 1, map, &labels);
    }
    labels.apply("", &[], &map.settle());
    labels
}
