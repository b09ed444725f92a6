//! Small images for a report, within a budget.

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use quadlift::scene::Scene;
use quadlift_io::ReadError;
use quadlift_io::scene_file::SceneImages;
use rayon::prelude::*;

use crate::frame_image::frame_jpeg;

/// Long sides of the images in a report, pixels: number of images, and how large they are up to that many. The image is
/// what one looks at; a few hundred small ones make a page of the size of a few dozen large ones.
const LONG_SIDES: [(usize, u32); 3] = [(80, 800), (160, 640), (320, 480)];

/// Long side of the images if there are more.
const MIN_LONG_SIDE: u32 = 320;

/// Quality of the JPEG files.
const QUALITY: u8 = 75;

/// At most so many images are read; of more frames an evenly spread choice.
const MAX_IMAGES: usize = 1500;

/// The small images of some frames.
#[derive(Debug, Clone, Default)]
pub(crate) struct Thumbnails {
    /// For each frame its image as a data URL.
    pub urls: Vec<Option<String>>,
    /// For each frame width and height of its image file in pixels, if it was read.
    pub sizes: Vec<Option<[u32; 2]>>,
    /// Notes about omitted parts, in sentences.
    pub notes: Vec<String>,
}

/// Makes the images of the frames with these indices; `budget` is their size in bytes all together.
///
/// As many frames keep their images as fit; they are evenly spread.
pub(crate) fn thumbnails(scene: &Scene, images: &SceneImages, frames: &[usize], budget: usize) -> Thumbnails {
    let with_image: Vec<usize> =
        (0..frames.len()).filter(|&k| images.images.get(frames[k]).is_some_and(Option::is_some)).collect();
    let mut result = Thumbnails { urls: vec![None; frames.len()], sizes: vec![None; frames.len()], notes: Vec::new() };
    let chosen: Vec<usize> = evenly_spread(with_image.len(), MAX_IMAGES).map(|k| with_image[k]).collect();
    let long_side = long_side(chosen.len());
    images.videos.want(chosen.iter().map(|&k| frames[k]));
    let read: Vec<Result<(String, [u32; 2]), ReadError>> =
        chosen.par_iter().map(|&k| data_url(scene, images, frames[k], long_side)).collect();
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

/// As many of the images as fit, evenly spread.
fn within_budget(urls: Vec<(usize, String)>, budget: usize) -> Vec<(usize, String)> {
    let sizes: Vec<usize> = urls.iter().map(|(_, url)| url.len()).collect();
    let size_of = |count: usize| evenly_spread(sizes.len(), count).map(|k| sizes[k]).sum::<usize>();
    let total = sizes.iter().sum::<usize>().max(1);
    // Images are about equally large.
    let mut count = sizes.len().min((budget as u128 * sizes.len() as u128 / total as u128) as usize);
    while size_of(count) > budget {
        count -= 1;
    }
    let mut urls: Vec<Option<(usize, String)>> = urls.into_iter().map(Some).collect();
    evenly_spread(sizes.len(), count).filter_map(|k| urls[k].take()).collect()
}

/// At most `most` indices below `total`, evenly spread.
pub(crate) fn evenly_spread(total: usize, most: usize) -> impl Iterator<Item = usize> {
    let count = total.min(most);
    (0..count).map(move |k| k * total / count)
}

/// Length of the longer side for this number of images, pixels.
fn long_side(images: usize) -> u32 {
    LONG_SIDES.iter().find(|(most, _)| images <= *most).map_or(MIN_LONG_SIDE, |(_, side)| *side)
}

/// The image of a frame as a data URL, and the size of the file's image.
fn data_url(
    scene: &Scene,
    images: &SceneImages,
    frame_index: usize,
    long_side: u32,
) -> Result<(String, [u32; 2]), ReadError> {
    let (jpeg, full_size) = frame_jpeg(scene, images, frame_index, long_side, QUALITY)?;
    Ok((format!("data:image/jpeg;base64,{}", STANDARD.encode(jpeg)), full_size))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn few_images_are_large() {
        assert_eq!([1, 80, 81, 320, 321].map(long_side), [800, 800, 640, 480, 320]);
    }

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
        assert_eq!(kept(99), [0, 1, 2, 3, 4, 5, 6, 7, 8]);
        assert_eq!(kept(45), [0, 2, 5, 7]);
        assert_eq!(kept(10), [0]);
        assert!(kept(9).is_empty());
        // One that is larger than the others.
        let uneven = vec![(0, "x".repeat(50)), (1, "x".repeat(10)), (2, "x".repeat(10))];
        assert!(within_budget(uneven.clone(), 49).is_empty());
        assert_eq!(within_budget(uneven, 60).len(), 2);
    }
}
