//! quadlift lifts 2D object detections from posed images to 3D objects.
#![forbid(unsafe_code)]

pub mod geometry;
mod localize;
pub mod metrics;
mod parallel;
pub mod scene;
pub mod solve;
pub mod synthetic;

pub use localize::{LeftOut, Localization, LocalizeError, Options, Progress, localize};
