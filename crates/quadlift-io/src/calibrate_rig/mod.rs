//! Rigs of fixed cameras from what stands or walks by ([`quadlift::calibrate_rig`]), in scene files.
//!
//! Cameras, frames and detections of a scene file become a rig ([`SceneFile::to_rig`](crate::SceneFile::to_rig)), and the poses that
//! were found are written into that file ([`RigScene::write`]).

mod rig;
mod record;
#[cfg(test)]
mod tests;

pub use record::{CALIBRATION, calibration_record, contradictions_in_words};
pub use rig::{RigOptions, RigScene};
