//! From masks to the supporting lines of detections, for `map` and `planes`.

use std::collections::BTreeMap;
use std::path::Path;

use nalgebra::Vector2;
use quadlift::geometry::{OutlineEnd, SupportLines};
use quadlift::scene::Scene;
use quadlift_segment::{ConvexHull, Mask};

use super::images::SceneImages;
use super::records::SceneFile;
use crate::error::{EntryError, ReadError};

/// Pixels from the border of the image, or from another object's mask, at which an outline still touches it.
const REACH: f64 = 2.0;

impl SceneFile {
    /// Reads the masks of the detections of one source (of all without one) and gives the scene's detections their
    /// supporting lines, undistorted where there is a lens. The scene must be that of this file ([`Self::to_scene`]), and
    /// `path` is the file's. A line is hidden where it touches another object's mask. Masks that `quadlift segment` did
    /// not trust (`fell_back`) are left out. `progress` is called with the number of frames done and their total.
    ///
    /// Returns what could not be read, with the index of the detection; all others are done.
    ///
    /// # Errors
    /// As [`Self::to_images`].
    pub fn add_support_lines(
        &self,
        path: &Path,
        scene: &mut Scene,
        source_index: Option<u32>,
        progress: &dyn Fn(usize, usize),
    ) -> Result<Vec<(usize, ReadError)>, EntryError> {
        let images = self.to_images(path)?;
        let trusted = |index: usize| {
            self.detections[index].segmentation.as_ref().is_none_or(|segmentation| segmentation.status != "fell_back")
        };
        let mut frames: BTreeMap<u32, Vec<usize>> = BTreeMap::new();
        for (index, detection) in scene.detections.iter().enumerate() {
            let chosen = source_index.is_none() || detection.source_index == source_index;
            if chosen && images.masks[index].is_some() && trusted(index) {
                frames.entry(detection.frame_index).or_default().push(index);
            }
        }
        let mut problems = Vec::new();
        let total = frames.len();
        for (done, (&frame, detections)) in frames.iter().enumerate() {
            progress(done, total);
            let masks = read(&images, scene, detections, &mut problems);
            let covered = Covered::by(&masks);
            for (index, mask) in &masks {
                scene.detections[*index].support_lines = support_lines(scene, frame, mask, &covered).map(Box::new);
            }
        }
        progress(total, total);
        Ok(problems)
    }
}

/// The masks that can be read.
fn read(
    images: &SceneImages,
    scene: &Scene,
    detections: &[usize],
    problems: &mut Vec<(usize, ReadError)>,
) -> Vec<(usize, Mask)> {
    let mut masks = Vec::with_capacity(detections.len());
    for (&index, mask) in detections.iter().zip(images.read_masks(scene, detections)) {
        match mask {
            Ok(mask) => masks.extend(mask.map(|mask| (index, mask))),
            Err(error) => problems.push((index, error)),
        }
    }
    masks
}

/// How many masks cover each pixel.
struct Covered {
    width: u32,
    counts: Vec<u32>,
}

impl Covered {
    fn by(masks: &[(usize, Mask)]) -> Self {
        let extents = masks.iter().filter_map(|(_, mask)| mask.extent());
        let [width, height] = extents.fold([0, 0], |[w, h], [.., x, y]| [w.max(x), h.max(y)]);
        let mut counts = vec![0; width as usize * height as usize];
        for (_, mask) in masks {
            mask.pixels().for_each(|[x, y]| counts[y as usize * width as usize + x as usize] += 1);
        }
        Self { width, counts }
    }

    /// Whether another mask than this one covers a pixel within reach of a point.
    fn others_near(&self, mask: &Mask, point: &Vector2<f64>) -> bool {
        // Casts saturate: what lies above or to the left of the image is at its border.
        let range = |x: f64| (x - REACH).floor() as u32..(x + REACH).ceil() as u32;
        range(point.y).any(|y| {
            range(point.x).filter(|&x| x < self.width).any(|x| {
                let count = self.counts.get(y as usize * self.width as usize + x as usize);
                count.is_some_and(|&count| count > u32::from(mask.contains(x, y)))
            })
        })
    }
}

fn support_lines(scene: &Scene, frame: u32, mask: &Mask, covered: &Covered) -> Option<SupportLines> {
    let frame = &scene.frames[frame as usize];
    let hull = ConvexHull::of_mask(mask)?;
    let at_border = |point: &Vector2<f64>| {
        let beyond = frame.image_size.is_some_and(|size| (size - point).min() <= REACH);
        frame.image_size.is_some() && point.min() <= REACH || beyond
    };
    let ends = hull
        .vertices()
        .iter()
        .map(|point| OutlineEnd { cut_off: at_border(point), hidden: covered.others_near(mask, point) });
    let points = match &frame.lens {
        Some(lens) => lens.undistort_outline(hull.vertices())?,
        None => hull.vertices().to_vec(),
    };
    SupportLines::of_outline(&points.into_iter().zip(ends).collect::<Vec<_>>())
}
