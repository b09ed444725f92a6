//! What association starts from: detections that take part, boxes and cameras, near frames, density of clutter, sizes.

pub(crate) mod clutter;
pub(crate) mod context;
pub(crate) mod frame_order;
pub(crate) mod observations;
pub(crate) mod point_tree;
pub(crate) mod preselect;
pub(crate) mod sizes;
