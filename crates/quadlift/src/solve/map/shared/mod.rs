//! Unknowns shared by the objects of a scene besides the noise: the ground plane, corrections of poses, the scales of the sources of cues,
//! sizes of categories, surfaces on which objects stand.

pub(crate) mod cue_scales;
pub(crate) mod ground;
pub(crate) mod poses;
mod scale_system;
pub(crate) mod size_model;
pub(crate) mod surfaces;
