//! The self-check: does a scene agree with itself, and if not, which of the usual mistakes explains it (ours)?
//!
//! 1. `sample`: some objects with their boxes, those that the border of the image cuts left out.
//! 2. `rays`, `misses`, `agreement`: how far the rays through the middles of an object's boxes miss each other, in half sizes of the
//!    boxes.
//! 3. `correction`, `hypotheses`, `search`: the usual mistakes are undone one by one; the one that makes the scene agree
//!    much better is its cause.
//! 4. `trajectory`, `object_ids`: where no correction explains it, whether poses repeat, the scale jumps, or ids do not
//!    stay with their objects.
//! 5. `with_ids`: all of that, for a scene whose detections name their objects. `without_ids`, `trials`: where no objects are known, they are sought under each hypothesis.
//! 6. `upright`, `lengths`: what boxes and poses alone do not tell, against the cameras and against priors on sizes.

mod agreement;
mod apply;
mod camera;
mod cause;
mod correction;
mod frame_order;
mod hypotheses;
mod lengths;
mod misses;
mod object_ids;
mod rays;
mod sample;
mod search;
#[cfg(test)]
mod tests;
mod trajectory;
mod trials;
mod upright;
mod verdict;
mod with_ids;
mod without_ids;

pub use agreement::Agreement;
pub use camera::CameraParts;
pub use cause::{Cause, CauseName};
pub use correction::{BoxFormat, Correction, Mistake};
pub use verdict::Diagnosis;
pub use with_ids::diagnose;
pub use without_ids::diagnose_association;
