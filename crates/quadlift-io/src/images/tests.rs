use std::fs;
use std::path::PathBuf;

use image::{DynamicImage, GrayAlphaImage, GrayImage, Rgb, RgbaImage};
use insta::assert_snapshot;
use proptest::prelude::*;

use super::*;

/// A folder with one file.
struct File {
    folder: tempfile::TempDir,
    path: PathBuf,
}

fn file(name: &str, bytes: &[u8]) -> File {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    fs::write(&path, bytes).unwrap();
    File { folder, path }
}

fn encoded(image: impl Into<DynamicImage>, format: ImageFormat) -> Vec<u8> {
    let mut bytes = Vec::new();
    image.into().write_to(&mut Cursor::new(&mut bytes), format).unwrap();
    bytes
}

/// The problem with a file that is read as an image, and as a label image.
fn problems(bytes: &[u8]) -> (String, String) {
    let file = file("x", bytes);
    let image = read_image(&file.path).map_or_else(|error| error.problem, |_| "no error".to_owned());
    let labels = read_label_image(&file.path).map_or_else(|error| error.problem, |_| "no error".to_owned());
    (image, labels)
}

fn gradient() -> RgbImage {
    RgbImage::from_fn(40, 30, |x, y| Rgb([(6 * x) as u8, (8 * y) as u8, 100]))
}

/// A PNG file of one row with these settings and packed bytes.
fn packed_png(color: png::ColorType, depth: png::BitDepth, width: u32, bytes: &[u8]) -> Vec<u8> {
    let mut out = Vec::new();
    let mut encoder = png::Encoder::new(&mut out, width, 1);
    encoder.set_color(color);
    encoder.set_depth(depth);
    if color == png::ColorType::Indexed {
        encoder.set_palette((0..=255).flat_map(|k: u8| [k / 2, 255 - k, 7]).collect::<Vec<u8>>());
    }
    encoder.write_header().unwrap().write_image_data(bytes).unwrap();
    out
}

#[test]
fn every_kind_of_photograph_becomes_rgb() {
    let read = |bytes: &[u8]| read_image(&file("a.png", bytes).path).unwrap();
    assert_eq!(read(&encoded(gradient(), ImageFormat::Png)), gradient());
    let jpeg = read(&encoded(gradient(), ImageFormat::Jpeg));
    assert!(jpeg.as_raw().iter().zip(gradient().as_raw()).all(|(a, b)| a.abs_diff(*b) < 30));

    let gray = GrayImage::from_raw(2, 1, vec![0, 200]).unwrap();
    assert_eq!(read(&encoded(gray, ImageFormat::Png)).as_raw(), &[0, 0, 0, 200, 200, 200]);
    let deep = ImageBuffer::<Luma<u16>, _>::from_raw(3, 1, vec![0u16, 0x80FF, 0xFFFF]).unwrap();
    assert_eq!(read(&encoded(deep, ImageFormat::Png)).as_raw(), &[0, 0, 0, 0x80, 0x80, 0x80, 255, 255, 255]);
    let alpha = RgbaImage::from_raw(1, 1, vec![10, 20, 30, 0]).unwrap();
    assert_eq!(read(&encoded(alpha, ImageFormat::Png)).as_raw(), &[10, 20, 30]);
    let gray_alpha = GrayAlphaImage::from_raw(1, 1, vec![10, 99]).unwrap();
    assert_eq!(read(&encoded(gray_alpha, ImageFormat::Png)).as_raw(), &[10, 10, 10]);
    let palette = packed_png(png::ColorType::Indexed, png::BitDepth::Eight, 2, &[0, 9]);
    assert_eq!(read(&palette).as_raw(), &[0, 255, 7, 4, 246, 7]);
}

#[test]
fn cmyk_is_converted() {
    // Written by Pillow, which reads it back as these colors; `tests/fixtures/make_cmyk.py`.
    let file = file("cmyk.jpg", include_bytes!("../../tests/fixtures/cmyk.jpg"));
    let image = read_image(&file.path).unwrap();
    assert_eq!(read_image_size(&file.path).unwrap(), [32, 8]);
    for (k, expected) in [[255, 255, 255], [200, 30, 30], [30, 60, 200], [0, 0, 0]].into_iter().enumerate() {
        let found = image.get_pixel(8 * k as u32 + 4, 4).0;
        assert!((0..3).all(|c| found[c].abs_diff(expected[c]) < 6), "{found:?} {expected:?}");
    }
}

#[test]
fn wrong_files_are_named() {
    let (image, labels) = problems(b"");
    assert_eq!(image, labels);
    assert_snapshot!(image, @"the file is empty; expected a PNG or JPEG image");
    assert_snapshot!(problems(b"<!DOCTYPE html>\n<html>").0, @r#"this is not an image: expected PNG or JPEG"#);
    assert_snapshot!(problems(b"GIF89a\x01\x00\x01\x00").0, @"the file holds GIF data; expected a PNG or JPEG image");
    let png = encoded(gradient(), ImageFormat::Png);
    let (image, labels) = problems(&png[..png.len() / 2]);
    assert_snapshot!(image, @"the PNG image is damaged or cut off (unexpected end of file)");
    assert_snapshot!(labels, @"the PNG image is damaged or cut off (unexpected end of file)");
    assert_snapshot!(problems(&png[..20]).0, @"the PNG image is damaged or cut off (unexpected end of file)");
    let jpeg = encoded(gradient(), ImageFormat::Jpeg);
    let (image, labels) = problems(&jpeg[..jpeg.len() - 100]);
    assert_snapshot!(image, @"the JPEG image is cut off: it has no end marker");
    assert_snapshot!(labels, @"this is a JPEG image, whose lossy compression changes mask values; expected a PNG image");
    assert_snapshot!(problems(&jpeg[..30]).0, @"the JPEG image is cut off: it has no end marker");
    let mut broken = png.clone();
    broken[60] ^= 0xFF;
    assert_snapshot!(problems(&broken).0, @"the PNG image is damaged or cut off (Format error decoding Png: Corrupt deflate stream. InvalidCodeLengthRepeat)");
    assert_snapshot!(problems(&png).1, @"this is a color image; expected a greyscale or palette image with one value per object");

    let file = file("x.png", &png);
    let missing = file.folder.path().join("y.png");
    assert_eq!(read_image(&missing).unwrap_err().problem, "there is no such file");
    assert_eq!(read_label_image(file.folder.path()).unwrap_err().problem, "this is a folder; expected a file");
    assert_eq!(read_image(&missing).unwrap_err().path, missing);
}

#[test]
fn a_head_that_promises_too_much_takes_no_memory() {
    let mut png = packed_png(png::ColorType::Grayscale, png::BitDepth::Eight, 1, &[0]);
    // Width and height in the head, and its checksum.
    png[16..24].copy_from_slice(&[0x40, 0, 0, 0, 0x40, 0, 0, 0]);
    let crc = crc32(&png[12..29]);
    png[29..33].copy_from_slice(&crc.to_be_bytes());
    let (image, labels) = problems(&png);
    let expected = "the image has 1073741824 x 1073741824 pixels; at most 160000000 are read (option max-pixels)";
    assert_eq!(labels, expected);
    assert_eq!(image, expected);
}

#[test]
fn images_of_another_size_are_refused_before_they_are_decoded() {
    // One bit for each pixel, all 0: a few hundred bytes for 100 megapixels.
    let mut png = packed_png(png::ColorType::Grayscale, png::BitDepth::One, 8, &[0]);
    png[16..24].copy_from_slice(&[0, 0, 0x27, 0x10, 0, 0, 0x27, 0x10]);
    let crc = crc32(&png[12..29]);
    png[29..33].copy_from_slice(&crc.to_be_bytes());
    let file = file("x.png", &png);
    let check = |size: [u32; 2]| Err(format!("seen {size:?}"));
    // The pixels are missing: to decode them would be another error.
    assert_eq!(read_image_of_size(&file.path, &check).unwrap_err().problem, "seen [10000, 10000]");
    assert_eq!(read_label_image_of_size(&file.path, &check).unwrap_err().problem, "seen [10000, 10000]");
    assert!(read_image(&file.path).unwrap_err().problem.contains("damaged"));
}

fn crc32(bytes: &[u8]) -> u32 {
    !bytes.iter().fold(!0u32, |crc, byte| {
        (0..8).fold(crc ^ u32::from(*byte), |crc, _| crc >> 1 ^ if crc & 1 != 0 { 0xEDB8_8320 } else { 0 })
    })
}

#[test]
fn the_end_of_a_jpeg_is_told_from_that_of_its_thumbnail() {
    let jpeg = encoded(gradient(), ImageFormat::Jpeg);
    assert!(has_end_of_jpeg(&jpeg));
    // A segment for a thumbnail, with an end marker in it, and fill bytes before the next one.
    let mut with_thumbnail = jpeg[..2].to_vec();
    with_thumbnail.extend([0xFF, 0xE1, 0, 6, 0xFF, 0xD9, 1, 2, 0xFF, 0xFF]);
    with_thumbnail.extend(&jpeg[2..]);
    assert!(has_end_of_jpeg(&with_thumbnail));
    assert!(!has_end_of_jpeg(&with_thumbnail[..with_thumbnail.len() - 2]));
    for length in 0..jpeg.len() - 1 {
        assert!(!has_end_of_jpeg(&jpeg[..length]));
    }
    assert!(has_end_of_jpeg(&[&jpeg[..], b"trailing"].concat()));
}

#[test]
fn label_images_keep_their_numbers() {
    use png::BitDepth::{Eight, Four, One, Sixteen, Two};
    use png::ColorType::{Grayscale, GrayscaleAlpha, Indexed, Rgb, Rgba};
    let cases: [(_, _, u32, &[u8], &[u16]); 10] = [
        (Grayscale, One, 9, &[0b1010_0001, 0b1000_0000], &[1, 0, 1, 0, 0, 0, 0, 1, 1]),
        (Grayscale, Two, 5, &[0b0001_1011, 0b1100_0000], &[0, 1, 2, 3, 3]),
        (Grayscale, Four, 3, &[0x1F, 0x90], &[1, 15, 9]),
        (Grayscale, Eight, 2, &[9, 255], &[9, 255]),
        (Grayscale, Sixteen, 2, &[1, 2, 0xFF, 0xFE], &[258, 65534]),
        (Indexed, Eight, 3, &[0, 9, 200], &[0, 9, 200]),
        (Indexed, Four, 3, &[0x12, 0x30], &[1, 2, 3]),
        (GrayscaleAlpha, Eight, 2, &[9, 255, 4, 0], &[9, 4]),
        (Rgb, Eight, 2, &[9, 9, 9, 4, 4, 4], &[9, 4]),
        (Rgba, Eight, 1, &[9, 9, 9, 1], &[9]),
    ];
    for (color, depth, width, bytes, expected) in cases {
        let file = file("labels.png", &packed_png(color, depth, width, bytes));
        assert_eq!(read_label_image(&file.path).unwrap().values(), expected, "{color:?} {depth:?}");
    }
}

#[test]
fn png_files_are_written_as_a_whole() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.png");
    write_png(&path, &gradient()).unwrap();
    assert_eq!(read_image(&path).unwrap(), gradient());
    assert_eq!(read_image_size(&path).unwrap(), [40, 30]);
    let error = write_png(&folder.path().join("no/a.png"), &gradient()).unwrap_err();
    assert!(error.problem.starts_with("the folder "), "{error}");
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
}

proptest! {
    #![proptest_config(crate::test_cases::cases(32))]
    #[test]
    fn label_images_round_trip(width in 1..12u32, height in 1..12u32, high in prop_oneof![1..256u32, 1..65536u32], seed: u32) {
        let values = (0..width * height).map(|k| (seed.wrapping_mul(k + 1) % high) as u16).collect();
        let labels = LabelImage::new(width, height, values).unwrap();
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("labels.png");
        write_label_image(&path, &labels).unwrap();
        prop_assert_eq!(read_label_image(&path).unwrap(), labels);
    }

    #[test]
    fn no_bytes_make_the_readers_panic(start in 0..4usize, at in 0..400usize, byte: u8, length in 0..2000usize) {
        let mut bytes = match start {
            0 => encoded(gradient(), ImageFormat::Png),
            1 => encoded(gradient(), ImageFormat::Jpeg),
            2 => packed_png(png::ColorType::Indexed, png::BitDepth::Four, 3, &[0x12, 0x30]),
            _ => include_bytes!("../../tests/fixtures/cmyk.jpg").to_vec(),
        };
        let at = at % bytes.len();
        bytes[at] = byte;
        bytes.truncate(length.max(at));
        problems(&bytes);
    }
}

#[test]
fn label_images_can_be_looked_at_and_keep_their_values() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("labels.png");
    let values: Vec<u16> = (0..256).collect();
    let labels = LabelImage::new(16, 16, values.clone()).unwrap();
    write_label_image(&path, &labels).unwrap();
    assert_eq!(read_label_image(&path).unwrap().values(), &values[..]);
    // As people see it: the background is black, objects are bright and differ from their neighbors in number.
    let seen = image::open(&path).unwrap().to_rgb8();
    let colors: Vec<[u8; 3]> = seen.pixels().map(|pixel| pixel.0).collect();
    assert_eq!(colors[0], [0; 3]);
    for pair in colors[1..].windows(2) {
        let apart: i32 = (0..3).map(|c| (i32::from(pair[0][c]) - i32::from(pair[1][c])).abs()).sum();
        assert!(pair[0].iter().max() >= Some(&120) && apart > 60, "{pair:?}");
    }
    // Many objects: values above 255 need 16 bits.
    let labels = LabelImage::new(2, 1, vec![0, 300]).unwrap();
    write_label_image(&path, &labels).unwrap();
    assert_eq!(read_label_image(&path).unwrap().values(), [0, 300]);
}
