//! Depth images of frames, and the depths of detections that they show.

use std::collections::BTreeMap;
use std::path::Path;

use quadlift::Observer;
use quadlift::scene::{DepthCue, Scene, SceneParts};
use quadlift_segment::{DepthImage, Mask, Patch};

use super::images::SceneImages;
use super::records::{DepthImageRecord, FrameRecord, SceneFile};
use crate::error::{EntryError, ReadError};
use crate::images::read_depth_image_of_size;

/// The source of depths from depth images without one.
const DEFAULT_SOURCE: &str = "depth_image";

impl DepthImageRecord {
    /// Refuses a scale that is none.
    pub(super) fn check(&self, entry: impl Fn(&str) -> String) -> Result<(), EntryError> {
        if self.scale > 0.0 && self.scale.is_finite() {
            return Ok(());
        }
        let problem = format!("found {}; expected a positive number, the world units of one count", self.scale);
        Err(EntryError::new(entry(".scale"), problem))
    }
}

/// What the depth images or the points of a scene gave.
#[derive(Debug, Clone, Default)]
pub struct DepthsFound {
    /// Number of detections that got a depth.
    pub detections: usize,
    /// Detections without a depth: too few pixels of theirs have one, or too few points lie on them.
    pub without: usize,
    /// Detections without a depth because another frame gives their object one from the same points.
    pub repeated: usize,
    /// Depth images, point clouds and masks that could not be read, each problem once.
    pub problems: Vec<ReadError>,
}

/// The depth of a detection, with its source.
pub(super) struct FoundDepth<'a> {
    pub detection: usize,
    pub cue: DepthCue,
    pub source: &'a str,
    /// Whether it is a length of the world: no scale is estimated.
    pub known: bool,
}

impl DepthsFound {
    pub(super) fn failed(&mut self, error: ReadError) {
        // Detections of a frame may share a mask, frames a cloud.
        if !self.problems.contains(&error) {
            self.problems.push(error);
        }
    }
}

impl SceneFile {
    /// Whether a frame has a depth image.
    pub(crate) fn has_depth_images(&self) -> bool {
        self.frames.iter().any(|frame| frame.depth.is_some())
    }

    /// The detections without a depth of one source (of all without one), by the frames that have what may give it.
    pub(super) fn without_depth(
        &self,
        scene: &Scene,
        source_index: Option<u32>,
        may_give: impl Fn(&FrameRecord) -> bool,
    ) -> BTreeMap<u32, Vec<usize>> {
        let mut frames: BTreeMap<u32, Vec<usize>> = BTreeMap::new();
        for (index, detection) in scene.detections.iter().enumerate() {
            let chosen = source_index.is_none() || detection.source_index == source_index;
            let has_depth = detection.cues.as_deref().is_some_and(|cues| cues.depth.is_some());
            if chosen && !has_depth && may_give(&self.frames[detection.frame_index as usize]) {
                frames.entry(detection.frame_index).or_default().push(index);
            }
        }
        frames
    }

    /// Reads the depth images of the frames and gives the scene's detections of one source (of all without one) the depth of
    /// their visible surface, where they have none: inside their mask if they have one, otherwise inside their box
    /// ([`DepthImage::surface`]). The scene must be that of this file ([`Self::to_scene`]), and `path` is the file's. A depth image
    /// covers the image of its frame, with as many pixels or with fewer. `observer` is called with the number of frames done
    /// and their total.
    ///
    /// # Errors
    /// As [`Self::to_images`].
    pub(crate) fn add_depths(
        &self,
        path: &Path,
        scene: &mut Scene,
        source_index: Option<u32>,
        observer: &dyn Observer,
    ) -> Result<DepthsFound, EntryError> {
        let mut found = DepthsFound::default();
        let folder = path.parent().unwrap_or(Path::new(""));
        let images = self.to_images(path)?;
        let frames = self.without_depth(scene, source_index, |frame| frame.depth.is_some());
        let named =
            || frames.keys().filter_map(|&frame| Some(folder.join(&self.frames[frame as usize].depth.as_ref()?.path)));
        if let Some(first) = named().next().filter(|_| frames.len() > 1 && !named().any(|path| path.exists())) {
            let problem = format!("none of the {} depth images exists, such as this one", frames.len());
            found.failed(ReadError::new(&first, problem));
            return Ok(found);
        }
        let mut depths: Vec<FoundDepth> = Vec::new();
        for (done, (&frame, detections)) in frames.iter().enumerate() {
            if observer.progress(done, frames.len()).is_break() {
                break;
            }
            let Some(record) = self.frames[frame as usize].depth.as_deref() else { continue };
            let check = |size| check_size(scene, frame as usize, size);
            let image = match read_depth_image_of_size(&folder.join(&record.path), record.scale, &check) {
                Ok(image) => image,
                Err(error) => {
                    found.failed(error);
                    continue;
                }
            };
            let source = record.source.as_deref().unwrap_or(DEFAULT_SOURCE);
            for (&index, mask) in detections.iter().zip(self.trusted_masks(&images, scene, detections)) {
                let mask = mask.unwrap_or_else(|error| {
                    found.failed(error);
                    None
                });
                match depth_of(scene, index, &image, mask.as_ref()) {
                    Some(cue) => depths.push(FoundDepth { detection: index, cue, source, known: false }),
                    None => found.without += 1,
                }
            }
        }
        let _ = observer.progress(frames.len(), frames.len());
        found.detections = depths.len();
        if !depths.is_empty() {
            let added = scene.edit(|parts| depths.iter().for_each(|depth| add(parts, depth)));
            added.map_err(|error| EntryError::new("frames", error))?;
        }
        Ok(found)
    }

    /// The masks of detections, without unreliable ones of `quadlift segment`.
    pub(super) fn trusted_masks(
        &self,
        images: &SceneImages,
        scene: &Scene,
        detections: &[usize],
    ) -> Vec<Result<Option<Mask>, ReadError>> {
        let fallback = |index: usize| {
            self.detections[index].segmentation.as_ref().is_some_and(|segmentation| segmentation.fallback())
        };
        let masks = images.read_masks(scene, detections);
        masks.into_iter().zip(detections).map(|(mask, &k)| if fallback(k) { Ok(None) } else { mask }).collect()
    }
}

/// Gives a detection a depth of a source.
pub(super) fn add(parts: &mut SceneParts, found: &FoundDepth) {
    let same = parts.cue_sources.iter().position(|name| name == found.source);
    let position = same.unwrap_or_else(|| {
        parts.cue_sources.push(found.source.to_owned());
        parts.cue_sources.len() - 1
    });
    let source = u32::try_from(position).ok();
    parts.scale_known.extend(source.filter(|_| found.known));
    let cues = parts.detections[found.detection].cues.get_or_insert_default();
    cues.depth = Some(DepthCue { source, ..found.cue });
}

/// Whether a depth image of this size shows the whole image of a frame: the same sides, up to a pixel.
fn check_size(scene: &Scene, frame_index: usize, [width, height]: [u32; 2]) -> Result<(), String> {
    let frame = &scene.frames[frame_index];
    let Some(size) = frame.image_size else { return Ok(()) };
    let [wanted, found] = [size.y / size.x * f64::from(width), f64::from(height)];
    if (wanted - found).abs() <= 1.0 && f64::from(width) <= size.x.ceil() {
        return Ok(());
    }
    Err(format!(
        "the depth image has {width} x {height} pixels; the camera of frame \"{}\" has {} x {}: expected as many, or both sides \
         smaller by one factor",
        frame.id, size.x, size.y
    ))
}

/// The depth of a detection in a depth image.
fn depth_of(scene: &Scene, index: usize, image: &DepthImage, mask: Option<&Mask>) -> Option<DepthCue> {
    let surface = image.surface(&patch_of(scene, index, mask, image.size().map(f64::from))?)?;
    Some(DepthCue { median: surface.median, sd: Some(surface.sd), source: None })
}

/// Where a detection is in its image, whose size is `size` if the scene does not know it.
pub(super) fn patch_of<'a>(scene: &Scene, index: usize, mask: Option<&'a Mask>, size: [f64; 2]) -> Option<Patch<'a>> {
    let detection = &scene.detections[index];
    let frame = &scene.frames[detection.frame_index as usize];
    let outline = |ellipse: quadlift::geometry::Ellipse| ellipse.bounding_box();
    let undistorted = detection.bounding_box.or(detection.ellipse.map(outline))?;
    let half_size = 0.25 * undistorted.size().sum() / frame.projection.focal_length();
    let image_size = frame.image_size.map_or(size, Into::into);
    let bounding_box = detection.box_in_image.unwrap_or(undistorted);
    Some(Patch { bounding_box, mask, image_size, half_size })
}
