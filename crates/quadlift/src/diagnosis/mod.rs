//! The consistency check: whether a scene is consistent, and if not, which common mistake explains it (docs/method.md, section
//! 16).
//!
//! 1. `sample`: some objects with their boxes, without boxes cut by the image border.
//! 2. `rays`, `misses`, `agreement`: how far the rays through the centers of an object's boxes miss each other, in half sizes
//!    of the boxes.
//! 3. `correction`, `hypotheses`, `search`: undo common mistakes one by one; the correction after which the scene
//!    agrees much better is its cause.
//! 4. `trajectory`, `object_ids`: if no correction explains it, whether poses repeat, the scale jumps, or ids change between objects.
//! 5. `with_ids` combines these for scenes with object ids. Without ids, `without_ids` and `trials` associate the detections under
//!    each hypothesis.
//! 6. `upright`, `lengths`: `up` against the cameras, lengths against priors on sizes, which boxes and poses do not determine.

mod agreement;
mod camera;
mod pixel_map;
mod correction;
mod apply;
mod cause;
mod hypotheses;
mod rays;
mod sample;
pub(crate) mod misses;
mod search;
mod some_frames;
mod rig_time;
mod trajectory;
mod upright;
mod verdict;
mod fit;
mod lengths;
mod trials;
mod object_ids;
mod with_ids;
mod without_ids;

#[cfg(test)]
mod tests;

pub use agreement::Agreement;
pub use camera::CameraParts;
pub use cause::{Cause, CauseName};
pub use correction::{BoxFormat, Correction, Mistake};
pub use pixel_map::PixelMap;
pub use upright::corrected_up;
pub use verdict::Diagnosis;
pub use with_ids::diagnose;
pub(crate) use with_ids::diagnose_refined;
pub use without_ids::diagnose_association;
pub(crate) use without_ids::is_convincing;
