//! Two maps of one place, aligned by their objects ([`quadlift::align`]), in scene files.
//!
//! The objects of a result become those of a map ([`SceneFile::to_map_objects`](crate::SceneFile::to_map_objects)); with the transform that was found, the second file
//! is moved into the frame of the first one (`SceneFile::move_by`) and added to it ([`merge`]).

mod map_objects;
mod assumptions;
mod merge;
mod moved;
mod record;
#[cfg(test)]
mod tests;

pub use assumptions::{Contradiction, MapScale, align_checked, options_of, scale_of_units};
pub use map_objects::MapObjects;
pub use merge::{Merged, merge};
pub use record::{ALIGNMENT, alignment_record, transform_record};
