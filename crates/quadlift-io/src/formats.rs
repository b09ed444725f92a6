//! All formats that are read, a row each, and recognition of their files. Docs: `docs/formats/cameras.md` and
//! `docs/formats/detections.md`, whose examples are tested against these tables.

use std::path::{Path, PathBuf};

use crate::error::ReadError;
use crate::read::detections::{DETECTIONS, DetectionFiles};
use crate::read::{CAMERA, DetectionFormat, Format, Import, POSES, PoseFormat, ReadOptions, recognize};
use crate::scene_file::read_scene_file;

/// Scene files, where cameras are expected.
const SCENE: &[PoseFormat] = &[Format {
    name: "scene file",
    title: "a scene file",
    about: "",
    looks: "a scene file",
    options: &[],
    finds: |probe| probe.when(probe.keys().is_ok_and(|keys| keys.object_has("format"))),
    read: |path, _| Ok(Import { scene: read_scene_file(path)?, is_scene: true, ..Import::default() }),
}];

/// Logs of robots.
#[cfg(feature = "mcap")]
const LOGS: &[PoseFormat] = &[crate::mcap::FORMAT];
#[cfg(not(feature = "mcap"))]
const LOGS: &[PoseFormat] = &[];

/// The formats of cameras and poses.
pub fn poses() -> impl Iterator<Item = &'static PoseFormat> + Clone {
    LOGS.iter().chain(POSES)
}

/// The formats of detections.
pub fn detections() -> impl Iterator<Item = &'static DetectionFormat> + Clone {
    DETECTIONS.iter()
}

/// The format of cameras and poses, and the path at which its reader begins.
///
/// # Errors
/// [`ReadError`] if the path cannot be read, or if it matches no format; the message lists the formats.
pub fn find_cameras(path: &Path) -> Result<(&'static PoseFormat, PathBuf), ReadError> {
    recognize(SCENE.iter().chain(poses()), CAMERA, path)
}

/// The format of detections.
///
/// # Errors
/// [`ReadError`] if the path cannot be read, or if it matches no format; the message lists the formats.
pub fn find_detections(path: &Path) -> Result<&'static DetectionFormat, ReadError> {
    recognize(detections(), "detection", path).map(|(format, _)| format)
}

/// Reads cameras and poses of any format.
///
/// # Errors
/// As [`find_cameras`], and as the reader of the format.
pub fn read_cameras(path: &Path, options: &ReadOptions) -> Result<Import, ReadError> {
    let (format, path) = find_cameras(path)?;
    (format.read)(&path, options)
}

/// Reads detections of any format.
///
/// # Errors
/// As [`find_detections`], and as the reader of the format.
pub fn read_detections(path: &Path, options: &ReadOptions) -> Result<DetectionFiles, ReadError> {
    (find_detections(path)?.read)(path, options)
}

#[cfg(test)]
mod tests;
