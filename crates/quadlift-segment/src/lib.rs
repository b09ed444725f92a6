//! Object masks from images by co-segmentation, and ellipses from masks.
//!
//! A [`Crop`] is cut for each detection of an object, one image at a time; [`segment_object`] then separates
//! object and background in all crops jointly and returns a [`Mask`] and an ellipse for each. Masks of other programs are
//! read as a [`LabelImage`], [`Rle`] or [`Polygons`]; their [`Moments`] have an ellipse too.
//!
//! ```
//! use image::{Rgb, RgbImage};
//! use quadlift::geometry::BoundingBox;
//! use quadlift_segment::{Crop, CropOptions, SegmentOptions, segment_object};
//!
//! // An orange disc that moves over a gray ground, and the detector's box in each frame.
//! let mut crops = Vec::new();
//! for frame in 0..4 {
//!     let x0 = 40 + 10 * frame;
//!     let image = RgbImage::from_fn(160, 120, |x, y| {
//!         let (dx, dy) = (f64::from(x) - f64::from(x0) - 19.5, f64::from(y) - 59.5);
//!         if dx.hypot(dy) < 20.0 { Rgb([220, 130, 40]) } else { Rgb([110, 110 + (x % 8) as u8, 115]) }
//!     });
//!     let bounding_box = BoundingBox::new([f64::from(x0), 40.0, f64::from(x0) + 40.0, 80.0])?;
//!     crops.push(Crop::cut(&image, &bounding_box, &CropOptions::default())?);
//! }
//! for view in segment_object(&crops, &SegmentOptions::default())? {
//!     assert!((view.ellipse.semi_axes().x - 20.0).abs() < 1.0 && view.mask.count() > 1000);
//! }
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
#![forbid(unsafe_code)]

mod blur;
mod box_prior;
mod cleanup;
mod color;
mod confidence;
mod graph_cut;
mod mask;
mod contacts;
mod hull;
mod frame_masks;
mod label_image;
mod moments;
mod parallel;
mod polygon;
mod resample;
mod crop;
mod rle;
mod surface;
mod depth_image;
mod projected_points;
mod vector_math;
mod palette;
mod frames;
mod sca;
mod smoothing;
mod pooled;
mod segment;

#[cfg(test)]
mod surface_shots;

pub use confidence::Failure;
pub use contacts::Contacts;
pub use crop::{Crop, CropError, CropOptions};
pub use depth_image::DepthImage;
pub use frame_masks::{FrameMasks, reach};
pub use hull::ConvexHull;
pub use image;
pub use label_image::LabelImage;
pub use mask::{Mask, MaskError};
pub use moments::{Moments, PixelTerm};
pub use polygon::{PolygonError, Polygons};
pub use projected_points::{ProjectedPoint, SurfaceOfPoints, surface_of_points};
pub use rle::{Rle, RleError};
pub use sca::ScaOptions;
pub use segment::{
    SegmentError, SegmentMethod, SegmentOptions, SegmentStatus, ViewSegmentation, segment_object, segment_objects,
};
pub use surface::{Patch, SurfaceDepth};
