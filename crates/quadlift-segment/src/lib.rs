//! Object masks from images by co-segmentation, and ellipses from masks.
#![forbid(unsafe_code)]

mod contacts;
mod hull;
mod label_image;
mod mask;
mod moments;
mod parallel;
mod polygon;
pub mod render;
mod rle;

pub use contacts::Contacts;
pub use hull::ConvexHull;
pub use label_image::LabelImage;
pub use mask::{Mask, MaskError};
pub use moments::{Moments, PixelTerm};
pub use polygon::{PolygonError, Polygons};
pub use rle::{Rle, RleError};
