//! File input and output of quadlift: the scene file ([`scene_file`]), the file of size priors ([`priors`]), other programs'
//! formats in ([`read`]) and out ([`mod@write`]), and what the program and the Python package do with files: [`association`], [`evaluation`], [`coverage`],
//! [`segmentation`], [`relocalize`], [`align`], [`calibrate_rig`].
//!
//! Readers reject invalid input with a [`ReadError`] that names the file, the place in it, what was found and what
//! was expected. Writers that fail leave the existing file unchanged.
#![forbid(unsafe_code)]
#![cfg_attr(docsrs, feature(doc_cfg))]

mod destination;
mod error;
pub mod file_names;
mod format_options;
pub mod guard;
mod input;
mod numbers;
mod temporary;
mod atomic;
pub mod images;
mod text;
mod point_cloud;
pub mod video;
pub mod wording;
pub mod priors;
pub mod problems;
pub mod scene_file;
pub mod options;
pub mod association;
pub mod coverage;
pub mod correct;
pub mod diagnosis;
pub mod evaluation;
mod time_steps;
pub mod relocalize;
pub mod calibrate_rig;
pub mod read;
pub mod segmentation;
pub mod stream;
#[cfg(feature = "mcap")]
pub mod mcap;
pub mod run;
pub mod synthetic_file;
pub mod formats;
pub mod write;
pub mod align;
pub mod python;

#[cfg(test)]
mod test_data;
#[cfg(test)]
#[path = "../../quadlift/src/test_cases.rs"]
mod test_cases;

pub use atomic::{write_file, write_folder};
pub use destination::is_standard_output;
pub use error::{EntryError, ReadError, WriteError, escape};
#[cfg(feature = "images")]
pub use images::{read_image, read_label_image, write_label_image, write_png};
pub use priors::{builtin_priors, read_priors};
pub use scene_file::{SceneFile, estimates_to_objects, read_scene_file, write_scene_file};
pub use temporary::remove_temporary_files;

// The examples of the manual are tests of this crate, which sees the library and the files.
#[cfg(doctest)]
#[doc = include_str!("../../../docs/api.md")]
struct ApiPage;
