//! The objects of a scene file as those of a map.

use quadlift::align::MapObject;
use quadlift::solve::Status;

use crate::error::EntryError;
use crate::scene_file::{ObjectBodies, SceneFile};

/// The objects of a map whose bodies are known.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct MapObjects {
    /// Their ids.
    pub ids: Vec<String>,
    /// The objects, in the order of the ids.
    pub objects: Vec<MapObject>,
    /// Number of objects that are left out: not localized, or gone.
    pub left_out: usize,
}

impl SceneFile {
    /// The objects with their covariances: estimates with the status `ok`, or true objects. An object that is no ellipsoid has
    /// the ellipsoid of its estimate, or the one of the same reach. Those that a map of a stream calls gone are left out.
    ///
    /// # Errors
    /// [`EntryError`], as of [`SceneFile::to_objects`].
    pub fn to_map_objects(&self) -> Result<MapObjects, EntryError> {
        let mut found = MapObjects::default();
        for (record, bodies) in self.objects.iter().zip(self.to_objects()?) {
            match map_object(&bodies).filter(|_| !record.is_gone()) {
                Some(object) => {
                    found.objects.push(object);
                    found.ids.push(bodies.id);
                }
                None => found.left_out += 1,
            }
        }
        Ok(found)
    }
}

fn map_object(object: &ObjectBodies) -> Option<MapObject> {
    if object.status.is_some_and(|status| status != Status::Ok) {
        return None;
    }
    Some(MapObject {
        ellipsoid: object.ellipsoid().or_else(|| Some(object.body()?.closest_ellipsoid()))?,
        covariance: object.covariance,
        category: object.category.clone(),
    })
}
