//! The subcommands, one file each.

pub(crate) mod align;
pub(crate) mod associate;
pub(crate) mod calibrate_rig;
pub(crate) mod completions;
pub(crate) mod evaluate;
pub(crate) mod export;
pub(crate) mod import;
pub(crate) mod info;
pub(crate) mod localize;
pub(crate) mod demo;
pub(crate) mod relocalize;
pub(crate) mod man;
pub(crate) mod render;
pub(crate) mod segment;
pub(crate) mod stream;
pub(crate) mod synth;
pub(crate) mod view;
