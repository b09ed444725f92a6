//! Readers of other programs' files, one format each: cameras and poses become a [`crate::SceneFile`] in the scene file's
//! convention (OpenCV axes, `cam_from_world`, pixels measured from the corner of the image), to which [`detections`] are
//! added.

mod bytes;
mod import;
pub(crate) mod json;
mod image_names;
mod options;
mod poses;
mod time_units;
mod kitti_geometry;
pub(crate) mod kitti_labels;
mod probe;
mod unread;
mod format;
mod arkit;
mod colmap;
mod nerfstudio;
mod nuscenes;
mod opensfm;
mod projections;
mod static_objects;
mod bop;
pub mod kitti;
mod tum;
mod xml;
pub mod detections;
mod kitti_raw;

#[cfg(test)]
mod real_data_tests;

pub use crate::format_options::FormatOption;
pub use detections::DetectionFormat;
pub(crate) use format::{CAMERA, recognize};
pub use format::{Format, PoseFormat};
pub use image_names::find_images;
pub use import::{Import, PixelCenters};
pub use options::{READ, ReadOptions};
#[cfg(feature = "mcap")]
pub(crate) use poses::from_rows;
pub use probe::{Found, Probe};
pub use unread::UNREAD;

/// The formats of cameras and poses in this folder, in the order of recognition.
pub(crate) const POSES: &[PoseFormat] = &[
    colmap::FORMAT,
    nerfstudio::FORMAT,
    opensfm::FORMAT,
    bop::FORMAT,
    nuscenes::FORMAT,
    arkit::FORMAT,
    kitti_raw::FORMAT,
    kitti::FORMAT,
    tum::FORMAT,
    projections::FORMAT,
];
