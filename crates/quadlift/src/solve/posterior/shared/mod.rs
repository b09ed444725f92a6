//! Unknowns shared by the objects of a scene besides the noise: the ground plane, corrections of poses, the scales of the sources of cues,
//! sizes of categories.

mod envelope;
pub(crate) mod ground;
pub(crate) mod pose_terms;
pub(crate) mod pose_unknowns;
mod point_tracks;
pub(crate) mod pose_prior;
mod pose_system;
pub(crate) mod pose_evidence;
pub(crate) mod poses;
pub(crate) mod pose_points;
mod point_check;
mod scale_system;
pub(crate) mod cue_scales;
pub(crate) mod found_scales;
pub(crate) mod size_model;

use self::cue_scales::CueScales;
use self::poses::PoseCorrections;

/// What the objects share whose errors are part of their covariances.
#[derive(Debug, Clone, Copy)]
pub(crate) struct SharedErrors<'a> {
    pub scales: &'a CueScales,
    pub poses: &'a PoseCorrections,
}
