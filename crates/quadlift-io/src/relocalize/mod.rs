//! Cameras of images from a map of objects ([`quadlift::relocalize`]), in scene files.
//!
//! The objects of a result become landmarks ([`SceneFile::to_landmarks`](crate::SceneFile::to_landmarks)), the frames of another scene file without a pose
//! become queries ([`SceneFile::to_queries`](crate::SceneFile::to_queries)), and poses that were found are written into that file ([`write_locations`]).

mod landmarks;
pub(crate) mod query;
mod record;
#[cfg(test)]
mod tests;

pub use landmarks::ObjectLandmarks;
pub use query::{FrameQuery, QueryScene, UP_IN_CAMERA};
pub use record::{GIVEN_OBJECT, LOCATION, location_record, write_locations};
