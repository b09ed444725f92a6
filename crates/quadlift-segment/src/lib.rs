//! Object masks from images by co-segmentation, and ellipses from masks.
#![forbid(unsafe_code)]

mod mask;
mod moments;
mod rle;

pub use mask::{Mask, MaskError};
pub use moments::{Moments, PixelTerm};
pub use rle::{Rle, RleError};
