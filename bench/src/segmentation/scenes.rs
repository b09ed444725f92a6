//! Scenes with images: for every detection its crop, its true mask and how much of the object is visible.

use std::collections::BTreeMap;
use std::path::Path;

use crate::render::{RenderOptions, RenderedScene, render};
use quadlift::geometry::Ellipse;
use quadlift::metrics::TruthObject;
use quadlift::scene::{Scene, SceneError};
use quadlift_io::{ReadError, read_scene_file};
use quadlift_segment::{
    Crop, CropOptions, FrameMasks, Mask, Moments, PixelTerm, SegmentOptions, SegmentStatus, ViewSegmentation,
    segment_object,
};
use rayon::prelude::*;

use super::errors::ViewErrors;
use crate::data::TrueScene;
use crate::error::Error;

/// Masks are scored if at least this fraction of the object is visible; otherwise the ellipse covers only a part.
const MIN_VISIBLE: f64 = 0.7;
/// Masks of fewer pixels are not scored either, nor objects with fewer such views.
const MIN_PIXELS: usize = 50;
const MIN_VIEWS: usize = 3;

/// Noise of the rendered boxes' edges in mean half sizes: 5 % of the side, as in the prototype.
const BOX_NOISE: f64 = 0.1;

/// A detection in its image.
#[derive(Debug, Clone)]
pub(super) struct Seen {
    /// Index of the detection in the scene.
    pub detection: usize,
    /// Its crop.
    pub crop: Crop,
    /// The pixels that are the object's.
    pub truth: Mask,
    /// Whether enough of the object is visible to score its mask.
    pub counts: bool,
}

/// A scene whose images have been looked at.
#[derive(Debug, Clone)]
pub(super) struct ImageScene {
    /// The scene and its true objects; nothing but boxes is detected.
    pub scene: TrueScene,
    /// The detections of each object in the order of the frames.
    pub objects: Vec<Vec<Seen>>,
}

impl ImageScene {
    /// Reads a scene of the real data with the detections of one source. One image is held at a time.
    ///
    /// # Errors
    /// [`Error::Read`] if the scene, an image or a mask cannot be read.
    pub(super) fn read(data: &Path, file: &str, source: &str) -> Result<Self, Error> {
        let path = data.join("scenes").join(format!("{file}.json"));
        let mut content = read_scene_file(&path)?;
        content.detections.retain(|detection| detection.source.as_deref() == Some(source));
        let truth = TrueScene::of_file(&content, &path, file)?;
        let images = content.to_images(&path).map_err(|error| error.in_file(&path))?;
        let mut seen = Vec::new();
        for frame in 0..truth.scene.frames.len() {
            let in_frame = |index: &usize| truth.scene.detections[*index].frame_index as usize == frame;
            let detections: Vec<usize> = (0..truth.scene.detections.len()).filter(in_frame).collect();
            if detections.is_empty() {
                continue;
            }
            let image = images.read_image(&truth.scene, frame)?;
            for (&index, mask) in detections.iter().zip(images.read_masks(&truth.scene, &detections)) {
                let wrong = |problem: String| ReadError::new(&path, problem).in_entry(format!("detections[{index}]"));
                let mask = mask?.ok_or_else(|| wrong("there is no \"mask\"".to_owned()))?;
                let bounding_box = truth.scene.detections[index].bounding_box;
                let bounding_box = bounding_box.ok_or_else(|| wrong("there is no \"box\"".to_owned()))?;
                let crop = Crop::cut(&image, &bounding_box, &CropOptions::default());
                let crop = crop.map_err(|error| wrong(error.to_string()))?;
                let visible = content.detections[index].visible_fraction.unwrap_or(1.0);
                seen.push((index, crop, mask, visible));
            }
        }
        Ok(Self::new(truth, seen))
    }

    /// Renders a scene of four objects in 20 views: that of `quadlift-bench render --box-noise 0.1 --seed N`.
    ///
    /// # Errors
    /// [`Error::Synthetic`], [`Error::Crop`].
    pub(super) fn rendered(seed: u64) -> Result<Self, Error> {
        let RenderedScene { synthetic, images, labels, values, visible_fractions, .. } =
            render(&RenderOptions { seed, box_noise: BOX_NOISE, ..Default::default() })?;
        let truth = synthetic.truth.iter().map(|(id, body)| TruthObject {
            id: id.clone(),
            ellipsoid: Some(body.closest_ellipsoid()),
            cuboid: None,
        });
        let truth =
            TrueScene { sequence: format!("rendered {seed}"), scene: synthetic.scene.clone(), truth: truth.collect() };
        let mut seen = Vec::new();
        for (index, detection) in synthetic.scene.detections.iter().enumerate() {
            let frame = detection.frame_index as usize;
            let Some(bounding_box) = &detection.bounding_box else { continue };
            let crop = Crop::cut(&images[frame], bounding_box, &CropOptions::default())?;
            seen.push((index, crop, labels[frame].mask(values[index]), visible_fractions[index]));
        }
        Ok(Self::new(truth, seen))
    }

    fn new(scene: TrueScene, seen: Vec<(usize, Crop, Mask, f64)>) -> Self {
        let mut objects: Vec<Vec<Seen>> = vec![Vec::new(); scene.scene.object_ids.len()];
        for (detection, crop, truth, visible) in seen {
            let counts = visible >= MIN_VISIBLE && truth.count() >= MIN_PIXELS;
            if let Some(object) = scene.scene.detections[detection].object_index {
                objects[object as usize].push(Seen { detection, crop, truth, counts });
            }
        }
        for object in &mut objects {
            object.sort_by_key(|seen| scene.scene.detections[seen.detection].frame_index);
        }
        Self { scene, objects }
    }

    /// Number of scored views of each object that has enough of them.
    pub(super) fn scored_counts(&self) -> impl Iterator<Item = usize> {
        let counts = self.objects.iter().map(|views| views.iter().filter(|seen| seen.counts).count());
        counts.filter(|&count| count >= MIN_VIEWS)
    }

    /// The same with the views only whose masks are scored.
    pub(super) fn scored_views(&self) -> Self {
        let scored = |views: &Vec<Seen>| views.iter().filter(|seen| seen.counts).cloned().collect();
        Self { scene: self.scene.clone(), objects: self.objects.iter().map(scored).collect() }
    }

    /// Segments every object, all of its views together, as `quadlift segment` does: for each object its views.
    ///
    /// # Errors
    /// [`Error::Segment`] when an option is out of its range.
    pub(super) fn segment(&self, options: &SegmentOptions) -> Result<Vec<Vec<ViewSegmentation>>, Error> {
        let object = |views: &Vec<Seen>| {
            let crops: Vec<Crop> = views.iter().map(|seen| seen.crop.clone()).collect();
            segment_object(&crops, options)
        };
        Ok(self.objects.par_iter().map(object).collect::<Result<_, _>>()?)
    }

    /// The errors of what was found, of each object with enough scored views.
    pub(super) fn errors(&self, found: &[Vec<ViewSegmentation>]) -> Vec<Vec<ViewErrors>> {
        let of_object = |(views, found): (&Vec<Seen>, &Vec<ViewSegmentation>)| {
            let scored = views.iter().zip(found).filter(|(seen, _)| seen.counts);
            scored.filter_map(|(seen, view)| ViewErrors::of(view, &seen.truth)).collect()
        };
        let errors = self.objects.iter().zip(found).map(of_object);
        errors.filter(|views: &Vec<ViewErrors>| views.len() >= MIN_VIEWS).collect()
    }

    /// The scene with what was found beside the boxes, as `quadlift localize` takes it from what `quadlift segment`
    /// writes: nothing where no mask could be trusted.
    pub(super) fn with_found(&self, found: &[Vec<ViewSegmentation>]) -> Result<TrueScene, SceneError> {
        let masks = found.iter().flatten().map(|view| {
            let trusted = !matches!(view.status, SegmentStatus::Fallback(_));
            trusted.then(|| (view.mask.clone(), view.ellipse))
        });
        self.with_masks(masks, true)
    }

    /// The scene with the true masks and their ellipses.
    pub(super) fn with_true_masks(&self) -> Result<TrueScene, SceneError> {
        let masks = self.objects.iter().flatten().map(|seen| {
            let ellipse = Moments::of_mask(&seen.truth, PixelTerm::Centers)?.ellipse()?;
            Some((seen.truth.clone(), ellipse))
        });
        self.with_masks(masks, false)
    }

    /// The scene with masks and ellipses, in the order of the objects and their views.
    /// `found_in_box` says that the masks were found in the boxes.
    fn with_masks(
        &self,
        masks: impl Iterator<Item = Option<(Mask, Ellipse)>>,
        found_in_box: bool,
    ) -> Result<TrueScene, SceneError> {
        let mut scene = self.scene.scene.clone().into_parts();
        let mut frames: BTreeMap<u32, Vec<(usize, Mask, Ellipse)>> = BTreeMap::new();
        for (seen, found) in self.objects.iter().flatten().zip(masks) {
            let frame = scene.detections[seen.detection].frame_index;
            frames.entry(frame).or_default().extend(found.map(|(mask, ellipse)| (seen.detection, mask, ellipse)));
        }
        for (frame, masks) in frames {
            let all = FrameMasks::new(masks.iter().map(|(_, mask, _)| mask));
            let size = scene.frames[frame as usize].image_size;
            for (index, mask, ellipse) in &masks {
                let detection = &mut scene.detections[*index];
                detection.ellipse = Some(*ellipse);
                let lines = all.tangent_lines(mask, size, None);
                let lines = match detection.bounding_box.filter(|_| found_in_box) {
                    Some(around) => lines.map(|lines| lines.beside_box(&around)),
                    None => lines,
                };
                detection.tangent_lines = lines.map(Box::new);
                let whole = size.map_or([u32::MAX; 2], |size| [size.x as u32, size.y as u32]);
                detection.partial = all.contacts(mask, whole).is_partial();
            }
        }
        Ok(TrueScene { scene: Scene::from_parts(scene)?, ..self.scene.clone() })
    }
}
