//! Undistorted images of frames, because outlines and measurements are in pinhole pixels.

use image::RgbImage;
use image::codecs::jpeg::JpegEncoder;
use image::imageops::thumbnail;
use nalgebra::Vector2;
use quadlift::geometry::Camera;
use quadlift::scene::Scene;
use quadlift_io::ReadError;
use quadlift_io::scene_file::SceneImages;

/// An image of a frame.
#[derive(Debug, Clone)]
pub struct FrameImage {
    /// The pixels, perhaps fewer than those of the file.
    pub image: RgbImage,
    /// Width and height of the file's image in pixels.
    pub full_size: [u32; 2],
}

/// Reads the image of a frame; downscales its long side to `long_side` pixels if it is larger.
///
/// # Errors
/// [`ReadError`] as [`SceneImages::read_image`].
pub fn frame_image(
    scene: &Scene,
    images: &SceneImages,
    frame_index: usize,
    long_side: u32,
) -> Result<FrameImage, ReadError> {
    let full = images.read_image(scene, frame_index)?;
    let full_size = [full.width(), full.height()];
    let scale = f64::from(full_size[0].max(full_size[1])) / f64::from(long_side);
    let small = if scale <= 1.0 {
        full
    } else {
        let [width, height] = full_size.map(|side| ((f64::from(side) / scale).round() as u32).max(1));
        // Means over the pixels that fall together.
        thumbnail(&full, width, height)
    };
    let lens = scene.frames.get(frame_index).and_then(|frame| frame.lens.as_ref());
    let image = match lens {
        None => small,
        Some(lens) => undistorted(&small, full_size, lens),
    };
    Ok(FrameImage { image, full_size })
}

/// The bytes of a JPEG file of [`frame_image`] with this quality (1 to 100), and width and height of the file's image.
///
/// # Errors
/// [`ReadError`] as [`frame_image`], or if the image cannot be encoded.
pub fn frame_jpeg(
    scene: &Scene,
    images: &SceneImages,
    frame_index: usize,
    long_side: u32,
    quality: u8,
) -> Result<(Vec<u8>, [u32; 2]), ReadError> {
    let FrameImage { image, full_size } = frame_image(scene, images, frame_index, long_side)?;
    let mut jpeg = Vec::new();
    JpegEncoder::new_with_quality(&mut jpeg, quality).encode_image(&image).map_err(|error| {
        ReadError::new(&images.scene_file, format!("cannot make a JPEG image: {error}"))
            .in_entry(format!("frames[{frame_index}].image"))
    })?;
    Ok((jpeg, full_size))
}

/// The undistorted image, of the same size; black where the lens has no data.
fn undistorted(image: &RgbImage, full_size: [u32; 2], lens: &Camera) -> RgbImage {
    let scale = Vector2::new(
        f64::from(full_size[0]) / f64::from(image.width()),
        f64::from(full_size[1]) / f64::from(image.height()),
    );
    RgbImage::from_fn(image.width(), image.height(), |x, y| {
        let pixel = Vector2::new(f64::from(x) + 0.5, f64::from(y) + 0.5).component_mul(&scale);
        let place = lens.distort_point(&pixel).map(|p| p.component_div(&scale));
        image::Rgb(place.and_then(|p| bilinear(image, &p)).unwrap_or_default())
    })
}

/// The color at a place in pixels; `None` outside of the image.
fn bilinear(image: &RgbImage, place: &Vector2<f64>) -> Option<[u8; 3]> {
    let (width, height) = (f64::from(image.width()), f64::from(image.height()));
    if !(place.x >= 0.0 && place.y >= 0.0 && place.x <= width && place.y <= height) {
        return None;
    }
    // Between the centers of pixels; at the border the outermost pixels go on.
    let x = (place.x - 0.5).clamp(0.0, width - 1.0);
    let y = (place.y - 0.5).clamp(0.0, height - 1.0);
    let (x0, y0) = (x.floor() as u32, y.floor() as u32);
    let (x1, y1) = ((x0 + 1).min(image.width() - 1), (y0 + 1).min(image.height() - 1));
    let (u, v) = (x.fract(), y.fract());
    Some(std::array::from_fn(|channel| {
        let at = |x, y| f64::from(image.get_pixel(x, y)[channel]);
        let (above, below) = (at(x0, y0) * (1.0 - u) + at(x1, y0) * u, at(x0, y1) * (1.0 - u) + at(x1, y1) * u);
        (above * (1.0 - v) + below * v).round() as u8
    }))
}

#[cfg(test)]
mod tests {
    use super::*;
    use quadlift::geometry::CameraModel;

    /// A white disc of radius 2 on black.
    fn disc(center: Vector2<f64>) -> RgbImage {
        RgbImage::from_fn(64, 48, |x, y| {
            let offset = Vector2::new(f64::from(x) + 0.5, f64::from(y) + 0.5) - center;
            image::Rgb([if offset.norm() < 2.0 { 255 } else { 0 }; 3])
        })
    }

    /// Mean place of the light.
    fn middle(image: &RgbImage) -> Vector2<f64> {
        let (mut sum, mut weight) = (Vector2::zeros(), 0.0);
        for (x, y, color) in image.enumerate_pixels() {
            let light = f64::from(color[0]);
            sum += Vector2::new(f64::from(x) + 0.5, f64::from(y) + 0.5) * light;
            weight += light;
        }
        sum / weight
    }

    #[test]
    fn what_the_lens_shows_moves_to_its_pinhole_pixel() {
        let lens = Camera::new(CameraModel::SimpleRadial, &[50.0, 32.0, 24.0, -0.4]).unwrap();
        let place = Vector2::new(50.0, 36.0);
        let ideal = lens.undistort_point(&place).unwrap();
        assert!((ideal - place).norm() > 1.0, "{ideal}");
        let image = undistorted(&disc(place), [64, 48], &lens);
        assert!((middle(&image) - ideal).norm() < 0.15, "{} {ideal}", middle(&image));
    }

    #[test]
    fn a_lens_without_distortion_changes_nothing() {
        let lens = Camera::new(CameraModel::SimpleRadial, &[50.0, 32.0, 24.0, 0.0]).unwrap();
        let image = disc(Vector2::new(20.0, 30.0));
        assert_eq!(undistorted(&image, [64, 48], &lens), image);
        // Neither at half the size, where a pixel of the small image covers two of the full one.
        let half = Camera::new(CameraModel::SimpleRadial, &[100.0, 64.0, 48.0, 0.0]).unwrap();
        assert_eq!(undistorted(&image, [128, 96], &half), image);
    }
}
