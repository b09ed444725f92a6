//! Object memory: objects from detections that arrive frame by frame.
//!
//! [`ObjectMap::observe`] takes a posed frame with its detections and returns the object of each detection, and which objects are
//! new, confirmed, merged or gone. It uses the likelihoods of [`crate::associate()`] (docs/method.md, section 15), but
//! assigns a box only while its frame is recent: the time for a frame does not grow with the map.
//!
//! The order of a frame (`observe`):
//! 1. `matching`: the objects that the camera may see (`visibility`) predict their boxes; the pairs with the largest total log
//!    likelihood ratio are made. The pose error of the frame is estimated as a shift of its boxes.
//! 2. `births`: unassigned boxes form new objects with those of the last frames.
//! 3. `recent`: the boxes of some of the last frames are assigned again, because the objects are known better.
//! 4. `lifecycle`: evidence confirms objects; clear views without a detection remove them.
//! 5. `merging`: objects that overlap in the image are merged if they are one.
//! 6. `learning`: noise, clutter and sizes are estimated from a sample of the objects (`running`).
//! 7. `consistency`: from time to time the last frames with all their boxes are checked as the scene of a run is.
//!
//! A frame from the place of a recent one adds no view (`standstill`).
//!
//! An object keeps a bounded number of views (`views`); the others are forgotten and only counted. `poses` moves keyframes after
//! a loop closure, and `scene` makes a [`crate::scene::Scene`] of the kept views for the estimators, reports and files.
//!
//! `memory` is what the map knows; the steps are functions of its parts, and `map` is the interface. `state` is how it is stored.
//!
//! Nothing is random, and the only clock is the times of the frames: the same frames give the same map.

mod input;
mod kept_shape;
mod keyframes;
mod names;
mod options;
#[cfg(feature = "serde")]
mod pairs;
mod running;
mod update;
mod views;
mod recent_frames;
mod windows;
mod current;
mod summary;
mod tracked;
mod visibility;
mod objects;
mod memory;
#[cfg(feature = "serde")]
mod state;
mod removal;
mod own_views;
mod lifecycle;
mod matching;
mod births;
mod recent;
mod standstill;
mod merging;
mod exchange;
mod learning;
mod consistency;
mod observe;
mod poses;
mod relocalize;
mod scene;
mod map;

#[cfg(test)]
mod cue_tests;
#[cfg(test)]
mod tests;

pub use input::{Frame, ObserveError};
pub use kept_shape::MapShape;
pub use map::{MapObject, ObjectMap};
pub use options::OnlineOptions;
pub use poses::PoseUpdate;
pub use relocalize::MapRelocalization;
pub use tracked::Presence;
pub use update::{DetectionRef, Event, FrameUpdate, ObjectId, Removal};

/// Maximum number of detections of a frame; matching more takes seconds.
pub const MAX_DETECTIONS: usize = 20_000;

/// Maximum number of categories of a map.
pub const MAX_CATEGORIES: usize = 4096;

/// Maximum number of sources of depths and 3D boxes of a map.
pub const MAX_CUE_SOURCES: usize = 4096;
