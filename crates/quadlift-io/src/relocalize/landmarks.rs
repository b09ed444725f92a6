//! The objects of a scene file as landmarks.

use quadlift::relocalize::Landmark;
use quadlift::solve::Status;

use crate::error::EntryError;
use crate::scene_file::{ObjectBodies, SceneFile};

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
    ///
    /// # Errors
    /// [`EntryError`], as of [`SceneFile::to_objects`].
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
        Ok(found)
    }
}

fn landmark(object: &ObjectBodies) -> Option<Landmark> {
    if object.status.is_some_and(|status| status != Status::Ok) {
        return None;
    }
    Some(Landmark { body: object.body()?, covariance: object.covariance, category: object.category.clone() })
}
