//! All objects of a scene together: rounds of noise levels and refits ([`scene_fit`]), upright objects ([`upright`]), the kind of
//! body of each object ([`body_evidence`], [`body_selection`]), sizes of categories ([`learned_sizes`]), scales of cues ([`scene_scales`]).

pub(crate) mod body_evidence;
pub(crate) mod body_selection;
pub(crate) mod learned_sizes;
mod scene_scales;
pub(crate) mod upright;
pub(crate) mod scene_fit;

#[cfg(test)]
mod scenes_of_tests;
