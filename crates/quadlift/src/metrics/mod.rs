//! How good an estimate is, against the truth (docs/method.md, section 17).
//!
//! [`evaluate`] scores a list of objects, [`pairwise_clustering_scores`] associations of detections; the individual
//! measures are separate functions. O3D of the paper is [`iou3d_ellipsoids`], its theta_err is [`ObjectScore::theta_err`].

mod axes;
mod circle_ellipse;
mod iou_cuboids;
mod iou_ellipses;
mod iou_ellipsoids;
mod iou_bodies;
mod nees;
mod overlap;
mod association;
mod reprojection;
mod scores;
mod evaluate;
mod squared_errors;
mod coverage;

pub use association::{ClusteringScore, ObjectDetectionScore, pairwise_clustering_scores, score_found};
pub use axes::{axis_error, center_error};
pub use coverage::{Coverage, RegionPart};
pub use evaluate::evaluate;
pub use iou_bodies::iou3d_bodies;
pub use iou_ellipses::ellipse_iou;
pub use iou_ellipsoids::iou3d_ellipsoids;
pub use nees::nees;
pub use overlap::{OverlapPair, pair_by_overlap};
pub use reprojection::{box_reprojection_iou, ellipse_reprojection_iou};
pub use scores::{EstimatedObject, Evaluation, Mean, MeanScore, ObjectScore, PairedBy, ReprojectionScore, TruthObject};
pub use squared_errors::{SquaredErrors, squared_errors};

/// Intersection over union from the size of the intersection and of both parts; 0 when they have no size.
fn ratio_of_union(common: f64, a: f64, b: f64) -> f64 {
    let union = a + b - common;
    if common > 0.0 && union > 0.0 && union.is_finite() { (common / union).min(1.0) } else { 0.0 }
}
