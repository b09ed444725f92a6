//! Unknowns shared by the objects of a scene besides the noise: the ground plane, corrections of poses.

pub(crate) mod ground;
pub(crate) mod poses;
