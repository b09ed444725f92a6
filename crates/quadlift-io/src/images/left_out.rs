//! Replaces `codecs` if the feature `images` is off: reading or writing an image fails with a message that names the
//! feature.

use std::path::Path;

use quadlift_segment::image::RgbImage;
use quadlift_segment::{DepthImage, LabelImage};

use super::SizeCheck;
use crate::error::{ReadError, WriteError};

fn left_out<T>(path: &Path) -> Result<T, ReadError> {
    Err(ReadError::left_out(path, "PNG and JPEG images", "images"))
}

pub(crate) fn read_image_of_size(path: &Path, _: SizeCheck) -> Result<RgbImage, ReadError> {
    left_out(path)
}

pub(crate) fn read_image_size(path: &Path) -> Result<[u32; 2], ReadError> {
    left_out(path)
}

pub(crate) fn read_label_image_of_size(path: &Path, _: SizeCheck) -> Result<LabelImage, ReadError> {
    left_out(path)
}

pub(crate) fn read_depth_image_of_size(path: &Path, _: f64, _: SizeCheck) -> Result<DepthImage, ReadError> {
    left_out(path)
}

pub(crate) fn write_label_image(path: &Path, _: &LabelImage) -> Result<(), WriteError> {
    Err(WriteError::new(path, ReadError::left_out(path, "PNG and JPEG images", "images").problem))
}
