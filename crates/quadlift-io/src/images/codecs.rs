//! PNG and JPEG: photographs, label images and depth images.

use std::io::Cursor;
use std::path::Path;

use image::{EncodableLayout, ImageBuffer, ImageError, ImageFormat, ImageReader, Luma, PixelWithColorType, RgbImage};
use quadlift_segment::{DepthImage, LabelImage};

use super::{SizeCheck, check_pixels, max_pixels};
use crate::atomic::write_file;
use crate::error::{ReadError, WriteError};
use crate::input::read_bytes;

/// Maximum size of image files in bytes: no image within the limit of pixels is larger.
const MAX_BYTES_PER_PIXEL: u64 = 16;

/// How many bytes an image file may have, and its pixels once they are decoded.
fn max_bytes() -> u64 {
    max_pixels().saturating_mul(MAX_BYTES_PER_PIXEL)
}

/// Reads a PNG or JPEG file as 8-bit RGB.
///
/// Gray images become RGB with equal channels, 16 bits are scaled to 8, palettes are looked up, transparency is
/// ignored, CMYK is converted. The pixels are those of the file: an orientation tag is not applied, because cameras are
/// calibrated on the pixels as they are stored.
///
/// # Errors
/// [`ReadError`] if the file cannot be read, is not PNG or JPEG, is damaged or truncated, or has more pixels than
/// `max_pixels`.
pub fn read_image(path: &Path) -> Result<RgbImage, ReadError> {
    read_image_of_size(path, &|_| Ok(()))
}

/// [`read_image`] with a check of the image size.
pub(crate) fn read_image_of_size(path: &Path, check: SizeCheck) -> Result<RgbImage, ReadError> {
    let bytes = read_image_bytes(path)?;
    let format = format(path, &bytes)?;
    if format == ImageFormat::Jpeg && !has_end_of_jpeg(&bytes) {
        return Err(ReadError::new(path, "the JPEG image is cut off: it has no end marker"));
    }
    let reader = || {
        let mut reader = ImageReader::with_format(Cursor::new(&bytes), format);
        // Its own limit on memory counts other things, and is lower.
        let mut limits = image::Limits::default();
        limits.max_alloc = Some(max_bytes());
        reader.limits(limits);
        reader
    };
    let failed = |error: ImageError| image_error(path, format, &error);
    let size = reader().into_dimensions().map_err(failed)?.into();
    check(size).and_then(|()| check_pixels(size)).map_err(|problem| ReadError::new(path, problem))?;
    Ok(reader().decode().map_err(failed)?.into_rgb8())
}

/// The bytes of an image file.
fn read_image_bytes(path: &Path) -> Result<Vec<u8>, ReadError> {
    let most = max_bytes();
    match std::fs::metadata(path) {
        Ok(metadata) if metadata.is_file() && metadata.len() > most => {
            let found = metadata.len();
            Err(ReadError::new(path, format!("the file has {found} bytes; expected an image of at most {most} bytes")))
        }
        _ => read_bytes(path),
    }
}

/// Width and height of a PNG or JPEG file; reads only its header.
///
/// # Errors
/// [`ReadError`] if the file cannot be read or is not PNG or JPEG.
pub(crate) fn read_image_size(path: &Path) -> Result<[u32; 2], ReadError> {
    let bytes = read_image_bytes(path)?;
    let format = format(path, &bytes)?;
    let size = ImageReader::with_format(Cursor::new(&bytes), format).into_dimensions();
    size.map(Into::into).map_err(|error| image_error(path, format, &error))
}

/// Reads a label image: a PNG file with one number per pixel, greyscale with up to 16 bits or with a palette (using the
/// indices, not the colors). A color image is accepted if its three channels are equal. Transparency is ignored.
///
/// # Errors
/// [`ReadError`] as [`read_image`]; also for JPEG, whose compression changes the numbers, and for colors.
pub fn read_label_image(path: &Path) -> Result<LabelImage, ReadError> {
    read_label_image_of_size(path, &|_| Ok(()))
}

/// [`read_label_image`] with a check of the image size.
pub(crate) fn read_label_image_of_size(path: &Path, check: SizeCheck) -> Result<LabelImage, ReadError> {
    let expected = "this is a JPEG image, whose lossy compression changes mask values; expected a PNG image";
    let ([width, height], values) = read_values(path, check, expected, |_, _| Ok(()))?;
    LabelImage::new(width, height, values).map_err(|error| ReadError::new(path, error.to_string()))
}

/// Reads a depth image: a PNG file in greyscale with 16 bits, `scale` world units each, 0 where the depth is unknown.
///
/// # Errors
/// [`ReadError`] as [`read_image`]; also for JPEG, for colors, and for 8 bits, which are too few for depths.
pub(crate) fn read_depth_image_of_size(path: &Path, scale: f64, check: SizeCheck) -> Result<DepthImage, ReadError> {
    let expected = "this is a JPEG image, which cannot hold depths; expected a PNG image in greyscale with 16 bits";
    let is_depth = |depth: png::BitDepth, color: png::ColorType| match (depth, color) {
        (png::BitDepth::Sixteen, png::ColorType::Grayscale) => Ok(()),
        (_, color) => {
            let bits = depth as u8;
            let color = match color {
                png::ColorType::Grayscale | png::ColorType::GrayscaleAlpha => "in greyscale",
                png::ColorType::Indexed => "with a palette",
                png::ColorType::Rgb | png::ColorType::Rgba => "in color",
            };
            Err(format!("the image is {color} with {bits} bits; expected a depth image in greyscale with 16 bits"))
        }
    };
    let ([width, height], values) = read_values(path, check, expected, is_depth)?;
    DepthImage::new(width, height, values, scale).map_err(|error| ReadError::new(path, error.to_string()))
}

/// Size and values, row by row, of a PNG file with one number per pixel. `jpeg` is the message for a JPEG file; `accepts` checks bits
/// and colors.
fn read_values(
    path: &Path,
    check: SizeCheck,
    jpeg: &str,
    accepts: impl Fn(png::BitDepth, png::ColorType) -> Result<(), String>,
) -> Result<([u32; 2], Vec<u16>), ReadError> {
    let bytes = read_image_bytes(path)?;
    if format(path, &bytes)? == ImageFormat::Jpeg {
        return Err(ReadError::new(path, jpeg));
    }
    let failed = |error: png::DecodingError| match error {
        png::DecodingError::LimitsExceeded => ReadError::new(path, "the PNG image is too large to read"),
        error => ReadError::new(path, format!("the PNG image is damaged or cut off ({error})")),
    };
    let most_bytes = usize::try_from(max_bytes()).unwrap_or(usize::MAX);
    let limits = png::Limits { bytes: most_bytes };
    let mut decoder = png::Decoder::new_with_limits(Cursor::new(&bytes), limits);
    decoder.set_transformations(png::Transformations::IDENTITY);
    let mut reader = decoder.read_info().map_err(failed)?;
    let size = [reader.info().width, reader.info().height];
    let kind = || accepts(reader.info().bit_depth, reader.info().color_type);
    check(size)
        .and_then(|()| check_pixels(size))
        .and_then(|()| kind())
        .map_err(|problem| ReadError::new(path, problem))?;
    let size = reader.output_buffer_size().filter(|&size| size <= most_bytes);
    let size = size.ok_or_else(|| failed(png::DecodingError::LimitsExceeded))?;
    let mut buffer = vec![0; size];
    let frame = reader.next_frame(&mut buffer).map_err(failed)?;
    let (width, channels) = (frame.width as usize, frame.color_type.samples());
    let mut values = Vec::with_capacity(width * frame.height as usize);
    for row in buffer.chunks_exact(frame.line_size.max(1)) {
        for x in 0..width {
            let sample = |channel| sample(row, x * channels + channel, frame.bit_depth);
            let value = sample(0);
            if channels >= 3 && (sample(1) != value || sample(2) != value) {
                let problem = "this is a color image; expected a greyscale or palette image with one value per \
                               object";
                return Err(ReadError::new(path, problem));
            }
            values.push(value);
        }
    }
    Ok(([frame.width, frame.height], values))
}

/// Writes a PNG file as a whole or not at all.
///
/// # Errors
/// [`WriteError`] if the system reports an error (see [`write_file`]).
pub fn write_png<P>(path: &Path, image: &ImageBuffer<P, Vec<P::Subpixel>>) -> Result<(), WriteError>
where
    P: PixelWithColorType,
    [P::Subpixel]: EncodableLayout,
{
    let mut bytes = Vec::new();
    let encoded = image.write_to(&mut Cursor::new(&mut bytes), ImageFormat::Png);
    encoded.map_err(|error| WriteError::new(path, error))?;
    write_file(path, |out| out.write_all(&bytes))
}

/// Writes a label image as a PNG file with a palette, whose indices are the values and whose colors are for viewing: 0
/// is black, neighboring values have distinct colors. If a value is above 255, writes 16-bit greyscale.
///
/// # Errors
/// As [`write_png`].
pub fn write_label_image(path: &Path, labels: &LabelImage) -> Result<(), WriteError> {
    if let Some(image) = labels.to_8_bit() {
        let mut bytes = Vec::new();
        let mut encoder = png::Encoder::new(&mut bytes, image.width(), image.height());
        encoder.set_color(png::ColorType::Indexed);
        encoder.set_depth(png::BitDepth::Eight);
        encoder.set_palette(label_palette());
        let written = encoder.write_header().and_then(|mut writer| {
            writer.write_image_data(image.as_raw())?;
            writer.finish()
        });
        written.map_err(|error| WriteError::new(path, error))?;
        return write_file(path, |out| out.write_all(&bytes));
    }
    let image = ImageBuffer::<Luma<u16>, _>::from_raw(labels.width(), labels.height(), labels.values().to_vec());
    image.map_or_else(|| Err(WriteError::new(path, "the image has no pixels")), |image| write_png(path, &image))
}

/// Colors of the values of a label image, three bytes each: black, then hues that follow each other in golden sections, in
/// three degrees of brightness.
fn label_palette() -> Vec<u8> {
    let color = |value: u16| -> [u8; 3] {
        if value == 0 {
            return [0; 3];
        }
        let hue = 6.0 * (f32::from(value) * 0.618_034).fract();
        let bright = [255.0, 200.0, 150.0][usize::from(value) % 3];
        // How much of red, green and blue there is at a hue, from 0.2 to 1.
        [0.0, 2.0, 4.0].map(|offset: f32| {
            let away = ((hue + offset) % 6.0 - 3.0).abs() - 1.0;
            (bright * (0.2 + 0.8 * away.clamp(0.0, 1.0))) as u8
        })
    };
    (0..=255).flat_map(color).collect()
}

/// The number with an index in a row of numbers of a PNG image, as they are packed.
fn sample(row: &[u8], index: usize, depth: png::BitDepth) -> u16 {
    let byte = |index: usize| u16::from(row.get(index).copied().unwrap_or(0));
    // Small numbers are packed from the highest bits down.
    let packed = |bits: usize| {
        let (per_byte, mask) = (8 / bits, (1 << bits) - 1);
        (byte(index / per_byte) >> (8 - bits - index % per_byte * bits)) & mask
    };
    match depth {
        png::BitDepth::One => packed(1),
        png::BitDepth::Two => packed(2),
        png::BitDepth::Four => packed(4),
        png::BitDepth::Eight => byte(index),
        png::BitDepth::Sixteen => byte(2 * index) << 8 | byte(2 * index + 1),
    }
}

/// The format by the content of the file; its name does not matter.
fn format(path: &Path, bytes: &[u8]) -> Result<ImageFormat, ReadError> {
    if bytes.is_empty() {
        return Err(ReadError::new(path, "the file is empty; expected a PNG or JPEG image"));
    }
    match image::guess_format(bytes) {
        Ok(format @ (ImageFormat::Png | ImageFormat::Jpeg)) => Ok(format),
        Ok(other) => {
            let name = other.extensions_str().first().map_or_else(|| format!("{other:?}"), |e| e.to_uppercase());
            Err(ReadError::new(path, format!("the file holds {name} data; expected a PNG or JPEG image")))
        }
        Err(_) => {
            // The content is not quoted: an untrusted scene may refer to any file.
            Err(ReadError::new(path, "this is not an image: expected PNG or JPEG"))
        }
    }
}

/// A readable message for an error of the image reader.
fn image_error(path: &Path, format: ImageFormat, error: &ImageError) -> ReadError {
    let format = if format == ImageFormat::Png { "PNG" } else { "JPEG" };
    let problem = match error {
        ImageError::Limits(_) => format!("the {format} image is too large to read ({error})"),
        ImageError::Unsupported(_) => format!("this kind of {format} image is not supported ({error})"),
        _ => format!("the {format} image is damaged or cut off ({error})"),
    };
    ReadError::new(path, problem)
}

/// Whether a JPEG file has its end marker after the compressed pixels; readers fill missing parts with gray.
fn has_end_of_jpeg(bytes: &[u8]) -> bool {
    // Segments up to the pixels: a marker, and a length that counts itself. A thumbnail in one of them has markers too.
    let mut at = 2;
    while let Some(&[0xFF, marker, high, low]) = bytes.get(at..at + 4) {
        // Between segments there may be any number of bytes 0xFF.
        if marker == 0xFF {
            at += 1;
            continue;
        }
        at += 2 + usize::from(u16::from_be_bytes([high, low]));
        if marker == 0xDA {
            break;
        }
    }
    // Among the compressed pixels, 0xFF is never followed by the end marker's second byte.
    bytes.get(at..).is_some_and(|pixels| pixels.windows(2).any(|pair| pair == [0xFF, 0xD9]))
}

#[cfg(test)]
#[path = "tests.rs"]
mod tests;
