//! A ROS 2 node that keeps a map of 3D objects from 2D detections, without a ROS installation (docs/ros2.md).
//!
//! What the node does is here and needs no network: [`Session`] takes messages as bytes and gives messages as bytes. [`node`] connects
//! it to DDS with `ros2-client`.
//!
//! [`arguments`] (the command line) and [`parameters`] become [`Options`]; [`estimation`] makes the messages of a map, [`status`] that of its
//! consistency; [`query`] selects objects.
#![forbid(unsafe_code)]

pub mod bytes;
pub mod parameters;
mod params_file;
pub mod arguments;
pub mod options;
pub mod estimation;
pub mod query;
pub mod status;
pub mod session;
pub mod node;

pub use options::Options;
pub use session::Session;
