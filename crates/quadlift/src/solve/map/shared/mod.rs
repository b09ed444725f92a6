//! Unknowns that the objects of a scene share besides the noise: the ground plane, corrections of poses.

pub(crate) mod ground;
pub(crate) mod poses;
