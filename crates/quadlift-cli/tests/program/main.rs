//! The program as its users run it. One binary for all files: each would link the whole program.

#![allow(clippy::unwrap_used, clippy::panic, clippy::print_stdout)]

mod align;
mod associate;
mod bad_inputs;
mod calibrate_rig;
mod coverage;
mod commands;
mod common;
mod cross_validation;
mod depth_images;
mod detections;
mod diagnosis;
mod documentation;
mod export;
mod field;
mod import;
mod relocalize;
mod logs;
mod method;
#[cfg(unix)]
mod outputs;
mod page_commands;
mod points;
mod python_options;
mod real_data;
mod render;
mod report;
mod segment;
mod stream;
mod stream_hostile;
mod stream_schema;
mod troubleshooting;
