//! Small images for a report, within a budget.

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use image::codecs::jpeg::JpegEncoder;
use quadlift::scene::Scene;
use quadlift_io::ReadError;
use quadlift_io::scene_file::SceneImages;
use rayon::prelude::*;

use crate::frame_image::frame_image;

/// Long side of the images in a report, pixels.
pub const LONG_SIDE: u32 = 320;

/// Quality of the JPEG files.
const QUALITY: u8 = 75;

/// At most so many images are read; of more frames an evenly spread choice.
const MOST_IMAGES: usize = 1500;

/// The small images of some frames.
#[derive(Debug, Clone, Default)]
pub struct Thumbnails {
    /// For each frame its image as a data URL.
    pub urls: Vec<Option<String>>,
    /// For each frame width and height of the file's image in pixels, where it was read.
    pub sizes: Vec<Option<[u32; 2]>>,
    /// What was left out, in sentences.
    pub notes: Vec<String>,
}

/// Makes the images of the frames with these indices; `budget` is their size in bytes all together.
///
/// Images that do not fit are left out evenly: every second frame keeps its image, or every third, and so on.
pub fn thumbnails(scene: &Scene, images: &SceneImages, frames: &[usize], budget: usize) -> Thumbnails {
    let with_image: Vec<usize> =
        (0..frames.len()).filter(|&k| images.images.get(frames[k]).is_some_and(Option::is_some)).collect();
    let mut result = Thumbnails { urls: vec![None; frames.len()], sizes: vec![None; frames.len()], notes: Vec::new() };
    let chosen: Vec<usize> = evenly_spread(with_image.len(), MOST_IMAGES).map(|k| with_image[k]).collect();
    let read: Vec<Result<(String, [u32; 2]), ReadError>> =
        chosen.par_iter().map(|&k| data_url(scene, images, frames[k])).collect();
    let mut errors = Vec::new();
    let mut urls = Vec::new();
    for (&k, image) in chosen.iter().zip(read) {
        match image {
            Ok((url, size)) => {
                result.sizes[k] = Some(size);
                urls.push((k, url));
            }
            Err(error) => errors.push(error),
        }
    }
    let readable = urls.len();
    for (k, url) in within_budget(urls, budget) {
        result.urls[k] = Some(url);
    }
    let kept = result.urls.iter().flatten().count();
    if let Some(first) = errors.first() {
        result.notes.push(format!("{} of {} images could not be read: {first}", errors.len(), chosen.len()));
    }
    if kept < readable || chosen.len() < with_image.len() {
        let total = with_image.len();
        result.notes.push(format!("{kept} of {total} images are in the report, evenly spread, to keep it small"));
    }
    result
}

/// Every k-th of the images, with the smallest k for which they fit.
fn within_budget(urls: Vec<(usize, String)>, budget: usize) -> Vec<(usize, String)> {
    let size_with = |step: usize| urls.iter().step_by(step).map(|(_, url)| url.len()).sum::<usize>();
    match (1..=urls.len()).find(|&step| size_with(step) <= budget) {
        Some(step) => urls.into_iter().step_by(step).collect(),
        None => Vec::new(),
    }
}

/// At most `most` indices below `total`, evenly spread.
pub fn evenly_spread(total: usize, most: usize) -> impl Iterator<Item = usize> {
    let count = total.min(most);
    (0..count).map(move |k| k * total / count)
}

/// The image of a frame as a data URL, and the size of the file's image.
fn data_url(scene: &Scene, images: &SceneImages, frame_index: usize) -> Result<(String, [u32; 2]), ReadError> {
    let small = frame_image(scene, images, frame_index, LONG_SIDE)?;
    let mut jpeg = Vec::new();
    JpegEncoder::new_with_quality(&mut jpeg, QUALITY).encode_image(&small.image).map_err(|error| {
        ReadError::new(&images.scene_file, format!("cannot make a small image: {error}"))
            .in_entry(format!("frames[{frame_index}].image"))
    })?;
    Ok((format!("data:image/jpeg;base64,{}", STANDARD.encode(jpeg)), small.full_size))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn choices_are_evenly_spread() {
        assert_eq!(evenly_spread(3, 10).collect::<Vec<_>>(), [0, 1, 2]);
        assert_eq!(evenly_spread(10, 4).collect::<Vec<_>>(), [0, 2, 5, 7]);
        assert_eq!(evenly_spread(0, 4).count(), 0);
    }

    #[test]
    fn images_beyond_the_budget_are_left_out_evenly() {
        let urls = || (0..10).map(|k| (k, "x".repeat(10))).collect::<Vec<_>>();
        let kept = |budget| within_budget(urls(), budget).into_iter().map(|(k, _)| k).collect::<Vec<_>>();
        assert_eq!(kept(100).len(), 10);
        assert_eq!(kept(99), [0, 2, 4, 6, 8]);
        assert_eq!(kept(40), [0, 3, 6, 9]);
        assert_eq!(kept(10), [0]);
        assert!(kept(9).is_empty());
    }
}
