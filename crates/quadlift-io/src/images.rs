//! Reads photographs, label images and depth images; writes PNG and JPEG (feature `images`).

#[cfg(feature = "images")]
mod codecs;
#[cfg(not(feature = "images"))]
mod left_out;

use std::sync::atomic::{AtomicU64, Ordering};

#[cfg(feature = "images")]
pub(crate) use codecs::read_image_size;
#[cfg(feature = "images")]
pub(crate) use codecs::{read_depth_image_of_size, read_image_of_size, read_label_image_of_size};
#[cfg(feature = "images")]
pub use codecs::{read_image, read_label_image, write_label_image, write_png};
#[cfg(not(feature = "images"))]
pub(crate) use left_out::{
    read_depth_image_of_size, read_image_of_size, read_image_size, read_label_image_of_size, write_label_image,
};

/// Default limit of pixels, see [`set_max_pixels`]: images of the largest cameras in use have 151 million.
pub const DEFAULT_MAX_PIXELS: u64 = 160_000_000;

static MAX_PIXELS: AtomicU64 = AtomicU64::new(DEFAULT_MAX_PIXELS);

/// Sets the maximum number of pixels of an image or mask in this process. A file of a few kilobytes can contain an
/// image that fills the memory; its size is checked before anything is decoded.
pub fn set_max_pixels(pixels: u64) {
    MAX_PIXELS.store(pixels, Ordering::Relaxed);
}

/// The maximum number of pixels of an image or mask ([`set_max_pixels`]).
pub(crate) fn max_pixels() -> u64 {
    MAX_PIXELS.load(Ordering::Relaxed)
}

/// Whether an image of this size (width, height) is read; otherwise the problem.
pub(crate) fn check_pixels([width, height]: [u32; 2]) -> Result<(), String> {
    let most = max_pixels();
    if u64::from(width) * u64::from(height) <= most {
        return Ok(());
    }
    Err(format!("the image has {width} x {height} pixels; at most {most} are read (option max-pixels)"))
}

/// A check of the size (width, height) of an image before its pixels are decoded.
type SizeCheck<'a> = &'a dyn Fn([u32; 2]) -> Result<(), String>;
