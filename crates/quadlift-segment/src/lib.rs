//! Object masks from images by co-segmentation, and ellipses from masks.
#![forbid(unsafe_code)]

mod blur;
mod box_prior;
mod cleanup;
mod color;
mod confidence;
mod crop;
mod frames;
mod graph_cut;
mod mask;
mod moments;
mod palette;
mod parallel;
mod pooled;
mod resample;
mod sca;
mod segment;
mod smoothing;
mod vector_math;

pub use color::scaled_lab;
pub use confidence::Failure;
pub use crop::{Crop, CropError, CropOptions};
pub use mask::{Mask, MaskError};
pub use moments::{Moments, PixelTerm};
pub use sca::ScaOptions;
pub use segment::{
    Progress, SegmentError, SegmentMethod, SegmentOptions, SegmentStatus, ViewSegmentation, segment_object,
    segment_objects,
};
