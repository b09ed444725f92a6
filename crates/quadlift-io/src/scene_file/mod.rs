//! The scene file: `quadlift.scene`, version 1, a JSON document for inputs and results.
//!
//! [`read_scene_file`] gives a [`SceneFile`] (plain records, as written); [`SceneFile::to_scene`] and
//! [`SceneFile::to_objects`] check it and give the library's types; [`estimates_to_objects`],
//! [`SceneFile::with_results`] and [`write_scene_file`] go the other way. [`SceneFile::to_images`] finds the images of
//! the frames and the masks of the detections, `SceneFile::add_support_lines` the lines that bound the masks,
//! `SceneFile::add_depths` the depths of detections in depth images, [`SceneFile::add_depths_of_points`] those of points.

mod cue_records;
mod expected;
pub(crate) mod object_records;
mod records;
mod frame_pose;
mod bodies;
mod images;
mod depth_images;
mod paths;
mod point_clouds;
mod results;
mod run;
mod suggest;
mod detection_cues;
mod convert;
pub(crate) mod mask_check;
mod tangent_lines;
mod unknown;
mod read;
mod write;

#[cfg(test)]
mod tests;

pub use bodies::{ObjectBodies, coordinates_name};
pub use cue_records::{Box3dRecord, Box3dSdRecord, CueSourceRecord, DepthRecord};
pub use depth_images::DepthsFound;
pub use images::{MaskSource, SceneImages};
pub use object_records::{
    AlternativeRecord, BodyRecord, BoundsRecord, CovarianceRecord, CrossValidationRecord, CuboidRecord, CylinderRecord,
    EllipsoidRecord, GoodnessOfFitRecord, ObjectRecord, SuperellipsoidRecord, ViewRecord,
};
pub use paths::way_to_file;
pub(crate) use read::parse_json_line;
pub use read::{parse_scene_file, read_scene_file};
pub use records::{
    CameraRecord, DepthImageRecord, DetectionRecord, EllipseRecord, FORMAT, FrameRecord, MaskRecord, OrientedBoxRecord,
    PointCloudRecord, REFERENCE, RIG_FRAME, RleCounts, RleRecord, SceneFile, SegmentationRecord, VERSION,
};
pub use results::{Detail, cross_validation_of_object, estimates_to_objects};
pub use run::{count_localized, fitted_body_name};
pub(crate) use suggest::known_names;
pub(crate) use write::write_localized_file;
pub use write::{write_scene, write_scene_file};
