//! Readers of other programs' files, one format each: cameras and poses become a [`crate::SceneFile`] in the scene file's
//! convention (OpenCV axes, `cam_from_world`, pixels measured from the corner of the image), to which [`detections`] are
//! added.

pub mod arkit;
pub mod bop;
mod bytes;
pub mod colmap;
pub mod detections;
mod import;
pub(crate) mod json;
pub mod kitti;
mod kitti_geometry;
pub(crate) mod kitti_labels;
pub mod kitti_raw;
pub mod nerfstudio;
pub mod nuscenes;
pub mod opensfm;
pub(crate) mod point_cloud;
mod poses;
pub mod projections;
mod static_objects;
mod text;
pub mod tum;
mod xml;

#[cfg(test)]
mod real_data_tests;

pub use import::{Import, PixelCenters};
#[cfg(feature = "mcap")]
pub(crate) use poses::from_rows;
