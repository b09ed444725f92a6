//! Scores of hypotheses, all as log likelihood ratios: a box and an object, a sphere from two boxes, an object against
//! clutter. Also the fit of an object's body.

pub(crate) mod object;
pub(crate) mod input_ids;
pub(crate) mod range_tree;
pub(crate) mod free_boxes;
pub(crate) mod rays;
pub(crate) mod scene_statistics;
pub(crate) mod fit;
pub(crate) mod log_likelihood_ratio;
pub(crate) mod evidence;
pub(crate) mod sphere_score;
