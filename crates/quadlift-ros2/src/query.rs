//! Objects that match conditions: the service `quadlift_msgs/QueryObjects`.

use std::collections::{HashMap, HashSet};

use quadlift_io::SceneFile;
use quadlift_io::mcap::{CdrWriter, message_to_json};
use quadlift_io::write::mcap::MapMessages;
use serde_json::Value;

use crate::bytes::Bytes;
use crate::estimation::checked;

/// The definition of the service, as ROS installations build it.
pub const DEFINITION: &str = include_str!("../quadlift_msgs/srv/QueryObjects.srv");

/// Types of the request.
const TYPES: &str = "\n================\nMSG: geometry_msgs/Point\nfloat64 x\nfloat64 y\nfloat64 z\n";

/// What is asked for. All conditions that are given must hold.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Query {
    /// The category.
    pub category: Option<String>,
    /// Two corners of a box in the world: the centers of the objects are inside.
    pub corners: Option<[[f64; 3]; 2]>,
    /// Whether the objects are at least partly in the last image.
    pub in_view: bool,
    /// The camera of that image, by its id; of any if it is not given.
    pub camera: Option<String>,
}

impl Query {
    /// Reads a request in CDR.
    ///
    /// # Errors
    /// A text that names the field.
    pub fn read(data: &[u8]) -> Result<Self, String> {
        let (request, _) = DEFINITION.split_once("\n---").unwrap_or_default();
        let json = message_to_json("quadlift_msgs/QueryObjects_Request", &format!("{request}{TYPES}"), data)?;
        let text = |name: &str| json[name].as_str().filter(|text| !text.is_empty()).map(str::to_owned);
        let corner = |name: &str| ["x", "y", "z"].map(|axis| json[name][axis].as_f64().unwrap_or(f64::NAN));
        let corners = [corner("min"), corner("max")];
        if corners.iter().flatten().any(|x| !x.is_finite()) {
            return Err("a corner of the box is not a finite number".to_owned());
        }
        if (0..3).any(|axis| corners[0][axis] > corners[1][axis]) {
            return Err(format!("the box goes from {:?} to {:?}; expected min below max", corners[0], corners[1]));
        }
        Ok(Self {
            category: text("category"),
            corners: Some(corners).filter(|corners| *corners != [[0.0; 3]; 2]),
            in_view: json["in_view"].as_i64().is_some_and(|x| x != 0),
            camera: text("camera"),
        })
    }

    /// The request in CDR.
    pub fn write(&self) -> Bytes {
        let mut message = CdrWriter::default();
        message.text(self.category.as_deref().unwrap_or_default());
        message.f64s(self.corners.unwrap_or_default().into_iter().flatten());
        message.u8(self.in_view.into()).text(self.camera.as_deref().unwrap_or_default());
        Bytes(message.finish())
    }

    /// The answer in CDR: the matching objects of a result at a time. `views` are the last images with the ids of their cameras.
    pub fn answer(
        &self,
        result: &SceneFile,
        views: &[(String, quadlift::scene::Frame)],
        (world_frame, stamp): (&str, i64),
    ) -> Result<Bytes, String> {
        let checked = checked(result)?;
        let objects: HashMap<&str, _> = result.objects.iter().map(|object| (object.id.as_str(), object)).collect();
        let mut wanted: HashSet<&str> = HashSet::new();
        for (id, center) in checked.centers() {
            let Some(object) = objects.get(id) else { continue };
            let is_inside =
                |[min, max]: [[f64; 3]; 2]| (0..3).all(|axis| (min[axis]..=max[axis]).contains(&center[axis]));
            if !object.is_gone()
                && self.category.as_ref().is_none_or(|category| object.category.as_ref() == Some(category))
                && self.corners.is_none_or(is_inside)
            {
                wanted.insert(id);
            }
        }
        if self.in_view {
            let views: Vec<_> =
                views.iter().filter(|(id, _)| self.camera.as_ref().is_none_or(|camera| camera == id)).collect();
            if views.is_empty() {
                return Err(match &self.camera {
                    Some(camera) => format!("there is no image of the camera \"{camera}\""),
                    None => "there is no image".to_owned(),
                });
            }
            let seen: HashSet<&str> = views.iter().flat_map(|(_, frame)| checked.objects_in_view(frame)).collect();
            wanted.retain(|id| seen.contains(id));
        }
        let mut message = CdrWriter::default();
        message.u8(1).text(&format!("{} of {} objects", wanted.len(), checked.bodies()));
        MapMessages::new(&checked, world_frame, stamp).add_detections(&mut message, |id| wanted.contains(id));
        Ok(Bytes(message.finish()))
    }
}

/// The answer to a request that cannot be answered.
pub fn refusal(problem: &str) -> Bytes {
    let mut message = CdrWriter::default();
    // No objects, at no time.
    message.u8(0).text(problem).i32(0).u32(0).text("").u32(0);
    Bytes(message.finish())
}

/// An answer as JSON: `success`, `message`, `objects`.
///
/// # Errors
/// A text that names the field.
pub fn read_answer(data: &[u8]) -> Result<Value, String> {
    let (_, answer) = DEFINITION.split_once("\n---\n").unwrap_or_default();
    let array = "vision_msgs/Detection3DArray";
    let types = format!("{answer}\n{}\nMSG: {array}\n{}", "=".repeat(16), quadlift_io::mcap::definition(array));
    message_to_json("quadlift_msgs/QueryObjects_Response", &types, data)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn requests_are_read_as_they_were_written() {
        let corners = Some([[-1.0, 0.0, 0.0], [1.0, 2.0, 0.5]]);
        let full = Query { category: Some("cup".into()), corners, in_view: true, camera: Some("front".into()) };
        for query in [Query::default(), full] {
            assert_eq!(Query::read(&query.write().0), Ok(query));
        }
        let turned = Query { corners: Some([[1.0; 3], [0.0; 3]]), ..Query::default() };
        assert!(Query::read(&turned.write().0).unwrap_err().contains("expected min below max"));
        assert!(Query::read(&[0, 1, 0, 0, 9]).unwrap_err().starts_with("category: "));
    }

    #[test]
    fn refusals_are_answers() {
        let answer = read_answer(&refusal("no").0).unwrap();
        assert_eq!((answer["success"].as_i64(), answer["message"].as_str()), (Some(0), Some("no")));
        assert_eq!(answer["objects"]["detections"].as_array().map(Vec::len), Some(0));
    }
}
