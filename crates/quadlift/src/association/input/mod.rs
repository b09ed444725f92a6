//! Input of association: the selected detections, their boxes and cameras, neighboring frames, clutter densities,
//! sizes.

pub(crate) mod box_observation;
pub(crate) mod clutter;
pub(crate) mod observations;
pub(crate) mod frame_order;
pub(crate) mod preselect;
pub(crate) mod sizes;
pub(crate) mod context;
