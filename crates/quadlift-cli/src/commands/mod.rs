//! The subcommands, one file each.

pub mod align;
pub mod associate;
pub mod calibrate;
pub mod completions;
pub mod evaluate;
pub mod export;
pub mod import;
pub mod info;
pub mod localize;
pub mod demo;
pub mod locate;
pub mod man;
pub mod render;
pub mod segment;
pub mod stream;
pub mod synth;
pub mod view;
