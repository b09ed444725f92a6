//! The objects of a scene file as landmarks.

use std::collections::{HashMap, HashSet};

use quadlift::relocalize::{Landmark, correct};
use quadlift::solve::Status;

use crate::error::EntryError;
use crate::scene_file::{DetectionRecord, FrameRecord, ObjectBodies, SceneFile};

/// The objects of a map whose bodies are known, as landmarks.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct ObjectLandmarks {
    /// Their ids.
    pub ids: Vec<String>,
    /// The landmarks, in the order of the ids.
    pub landmarks: Vec<Landmark>,
    /// Number of objects that are left out: not localized, or gone.
    pub left_out: usize,
}

impl SceneFile {
    /// The objects as landmarks: estimates with the status `ok`, or true objects. Those that a map of a stream calls gone are left out.
    /// The supports of estimates are corrected by the residuals of their detections in the file ([`correct`]).
    ///
    /// # Errors
    /// [`EntryError`], as of [`SceneFile::to_objects`] and [`SceneFile::to_scene`].
    pub fn to_landmarks(&self) -> Result<ObjectLandmarks, EntryError> {
        let mut found = ObjectLandmarks::default();
        for (record, bodies) in self.objects.iter().zip(self.to_objects()?) {
            match landmark(&bodies).filter(|_| !record.is_gone()) {
                Some(landmark) => {
                    found.landmarks.push(landmark);
                    found.ids.push(bodies.id);
                }
                None => found.left_out += 1,
            }
        }
        let views = self.used_views();
        if !views.detections.is_empty() {
            let scene = views.to_scene()?;
            let places: HashMap<&String, usize> = scene.object_ids.iter().zip(0..).collect();
            let place = |id: &String| places.get(id).copied().unwrap_or(usize::MAX);
            let objects: Vec<usize> = found.ids.iter().map(place).collect();
            correct(&mut found.landmarks, &scene, &objects);
        }
        Ok(found)
    }

    /// The detections that estimates rest on, with their frames and cameras.
    fn used_views(&self) -> Self {
        let source = self.localization.as_ref().and_then(|about| about["settings"]["source"].as_str());
        let estimates = self.objects.iter().filter(|object| object.status.is_some());
        let rejected: HashMap<&str, &[String]> =
            estimates.map(|object| (&*object.id, &*object.views_rejected)).collect();
        let posed = |frame: &&FrameRecord| frame.cam_from_world.is_some() || frame.projection.is_some();
        let frames: HashSet<&str> = self.frames.iter().filter(posed).map(|frame| &*frame.id).collect();
        let is_used = |detection: &&DetectionRecord| {
            let rejected = detection.object.as_deref().and_then(|id| rejected.get(id));
            let is_chosen = source.is_none() || detection.source.as_deref() == source;
            is_chosen
                && frames.contains(&*detection.frame)
                && rejected.is_some_and(|rejected| !rejected.iter().any(|frame| **frame == *detection.frame))
        };
        Self {
            up: self.up,
            cameras: self.cameras.clone(),
            frames: self.frames.iter().filter(posed).cloned().collect(),
            points: self.points.clone(),
            detections: self.detections.iter().filter(is_used).cloned().collect(),
            ..Self::default()
        }
    }
}

fn landmark(object: &ObjectBodies) -> Option<Landmark> {
    if object.status.is_some_and(|status| status != Status::Ok) {
        return None;
    }
    let (covariance, category) = (object.covariance, object.category.clone());
    Some(Landmark { body: object.body()?, covariance, category, correction: None })
}
