//! All objects of a scene together: rounds of noise levels and refits (`scene_fit`), which objects stand upright
//! (`upright`), which body each object is (`body_evidence`, `body_selection`).

pub(crate) mod body_evidence;
pub(crate) mod body_selection;
pub(crate) mod scene_fit;
pub(crate) mod upright;
