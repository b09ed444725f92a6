//! The images of a scene's frames and the masks of its detections: where they are, and reading them.
//!
//! The scene of the library contains neither, because it does no I/O; the table here is parallel to its frames and
//! detections.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use nalgebra::Vector2;
use quadlift::geometry::BoundingBox;
use quadlift::scene::Scene;
use quadlift_segment::image::RgbImage;
use quadlift_segment::{LabelImage, Mask, Polygons, Rle};

use super::records::{DetectionRecord, FrameRecord, MaskRecord, RleCounts, SceneFile};
use crate::error::{EntryError, ReadError};
use crate::images::{check_pixels, read_image_of_size, read_label_image_of_size};
use crate::video::{VideoFrames, file_of_image, frame_of_video};

/// Most pixels of the masks that are held at once.
const MAX_MASK_PIXELS: u64 = 1 << 31;

/// With more pixels, label images are dropped from the cache before the next one is read.
const MAX_CACHED_PIXELS: u64 = 1 << 28;

/// Polygons in a frame of unknown size are cut off here, in pixels.
const MAX_IMAGE: u32 = 1 << 14;

/// Most values of a label image that a message lists.
const LISTED_VALUES: usize = 8;

/// Where the mask of a detection is.
#[derive(Debug, Clone, PartialEq)]
pub enum MaskSource {
    /// The pixels of a label image that have a value; every value but 0 without one.
    Labels {
        /// Path of the PNG file, from the working folder.
        path: PathBuf,
        /// The value of the object's pixels.
        value: Option<u16>,
    },
    /// COCO's runs, in the scene file itself.
    Rle(Rle),
    /// Polygons, in the scene file itself.
    Polygons(Polygons),
}

/// The images and masks that a scene file names.
#[derive(Debug, Clone, PartialEq)]
pub struct SceneImages {
    /// The scene file, for messages.
    pub scene_file: PathBuf,
    /// For each frame of the scene, the path of its image from the working folder.
    pub images: Vec<Option<PathBuf>>,
    /// For each detection of the scene, its mask.
    pub masks: Vec<Option<MaskSource>>,
    /// For each detection of the scene, its box in the image as it is: those of the scene are undistorted.
    pub boxes: Vec<Option<BoundingBox>>,
    /// Images that are frames of videos ([`crate::video`]).
    pub videos: VideoFrames,
}

impl SceneFile {
    /// For each frame, width and height of its image in pixels, if known from frame or camera.
    pub(crate) fn image_sizes(&self) -> Vec<Option<[f64; 2]>> {
        let size = |width: Option<f64>, height: Option<f64>| width.zip(height).map(|(width, height)| [width, height]);
        let of_camera: HashMap<&str, Option<[f64; 2]>> =
            self.cameras.iter().map(|camera| (camera.id.as_str(), size(camera.width, camera.height))).collect();
        let of_frame = |frame: &FrameRecord| {
            let camera = frame.camera.as_deref().and_then(|id| of_camera.get(id).copied().flatten());
            size(frame.width, frame.height).or(camera)
        };
        self.frames.iter().map(of_frame).collect()
    }

    /// The files that the scene refers to as images, depth images, point clouds and masks; `path` is that of the scene
    /// file, to which theirs are relative.
    pub fn named_files(&self, path: &Path) -> impl Iterator<Item = PathBuf> {
        let folder = path.parent().unwrap_or(Path::new(""));
        let images = self.frames.iter().filter_map(|frame| frame.image.as_ref());
        let depths = self.frames.iter().filter_map(|frame| Some(&frame.depth.as_ref()?.path));
        let masks = self.detections.iter().filter_map(|detection| detection.mask.as_ref()?.path.as_ref());
        let clouds = self.frames.iter().map(|frame| &frame.point_cloud).chain([&self.point_cloud]);
        let clouds = clouds.filter_map(|cloud| Some(&cloud.as_ref()?.path));
        images.chain(depths).chain(clouds).chain(masks).map(move |path| folder.join(file_of_image(Path::new(path))))
    }

    /// The images and masks of the scene; `path` is the scene file, to which their paths are relative. No other file is
    /// accessed.
    ///
    /// # Errors
    /// [`EntryError`] names the first mask that is none: in no or in several forms, runs that do not fill their image,
    /// polygons without points. The outline of a detection without a mask is its mask.
    pub fn to_images(&self, path: &Path) -> Result<SceneImages, EntryError> {
        let folder = path.parent().unwrap_or(Path::new(""));
        let mask =
            |(index, record): (usize, &DetectionRecord)| match (record.mask.as_deref(), record.outline.as_deref()) {
                (Some(mask), _) => mask_source(mask, folder, &format!("detections[{index}].mask")).map(Some),
                (None, Some(outline)) => Polygons::new(&[outline.as_flattened().to_vec()])
                    .map(|polygon| Some(MaskSource::Polygons(polygon)))
                    .map_err(|problem| EntryError::new(format!("detections[{index}].outline"), problem)),
                (None, None) => Ok(None),
            };
        Ok(SceneImages {
            scene_file: path.to_owned(),
            // `to_scene` reports invalid ones.
            boxes: self.detections.iter().map(|d| BoundingBox::new(d.bounding_box?).ok()).collect(),
            images: self.frames.iter().map(|frame| frame.image.as_ref().map(|image| folder.join(image))).collect(),
            masks: self.detections.iter().enumerate().map(mask).collect::<Result<_, _>>()?,
            videos: VideoFrames::default(),
        })
    }
}

/// A mask from its record in the entry with this name.
fn mask_source(record: &MaskRecord, folder: &Path, entry: &str) -> Result<MaskSource, EntryError> {
    let error = |field: &str, problem: String| EntryError::new(format!("{entry}{field}"), problem);
    if record.value.is_some() && record.path.is_none() {
        return Err(error("", "a \"value\" belongs to the \"path\" of a label image; there is none".to_owned()));
    }
    match (&record.path, &record.rle, &record.polygons) {
        (Some(path), None, None) => {
            let value = record.value.map(u16::try_from).transpose().map_err(|_| {
                let value = record.value.unwrap_or_default();
                error(".value", format!("{value} is above 65535, the largest value of a label image"))
            })?;
            Ok(MaskSource::Labels { path: folder.join(path), value })
        }
        (None, Some(rle), None) => {
            let [height, width] = rle.size;
            let rle = match &rle.counts {
                RleCounts::Runs(counts) => Rle::new(height, width, counts.clone()),
                RleCounts::Compressed(text) => Rle::from_compressed(height, width, text),
            };
            rle.map(MaskSource::Rle).map_err(|problem| error(".rle", problem.to_string()))
        }
        (None, None, Some(polygons)) if !polygons.is_empty() => {
            Polygons::new(polygons).map(MaskSource::Polygons).map_err(|problem| error(".polygons", problem.to_string()))
        }
        (None, None, Some(_)) => Err(error(".polygons", "there are no polygons; expected one or more".to_owned())),
        (path, rle, polygons) => {
            let given = [
                path.as_ref().map(|_| "\"path\""),
                rle.as_ref().map(|_| "\"rle\""),
                polygons.as_ref().map(|_| "\"polygons\""),
            ];
            let given: Vec<&str> = given.into_iter().flatten().collect();
            let given = if given.is_empty() { "none of them".to_owned() } else { given.join(" and ") };
            Err(error("", format!("expected one of \"path\", \"rle\" and \"polygons\"; found {given}")))
        }
    }
}

impl SceneImages {
    /// The first image or label image that lies in this folder, whose path is canonical.
    pub fn any_in(&self, folder: &Path) -> Option<&Path> {
        let masks = self.masks.iter().flatten().filter_map(|mask| match mask {
            MaskSource::Labels { path, .. } => Some(path),
            _ => None,
        });
        let mut last: Option<&Path> = None;
        for path in self.images.iter().flatten().chain(masks).map(|path| file_of_image(path)) {
            let parent = path.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."));
            // Most files lie in the folder of the one before.
            if last.replace(parent) != Some(parent) && parent.canonicalize().is_ok_and(|parent| parent == folder) {
                return Some(path);
            }
        }
        None
    }

    /// Reads the image of a frame of the scene; one that is a frame of a video with ffmpeg ([`crate::video`]).
    ///
    /// # Errors
    /// [`ReadError`] if the frame has no image, if the file cannot be read ([`crate::read_image`]), or if its size differs from
    /// the frame's camera.
    pub fn read_image(&self, scene: &Scene, frame_index: usize) -> Result<RgbImage, ReadError> {
        let Some(path) = self.images.get(frame_index).and_then(Option::as_ref) else {
            let id = scene.frames.get(frame_index).map_or("", |frame| frame.id.as_str());
            let problem = format!("the frame \"{id}\" has no \"image\"");
            return Err(ReadError::new(&self.scene_file, problem).in_entry(format!("frames[{frame_index}]")));
        };
        let check = |size| check_size(scene, frame_index, size);
        match frame_of_video(path) {
            Some(place) => {
                let file = self.videos.image(frame_index, place, &self.images)?;
                // The file is a temporary one.
                read_image_of_size(&file, &check).map_err(|error| ReadError::new(path, error.problem))
            }
            None => read_image_of_size(path, &check),
        }
    }

    /// Reads the masks of detections of the scene, by their indices; `None` for one that has no mask. A label image that
    /// several of them share, as those of one frame do, is read once.
    ///
    /// # Errors
    /// One per mask: [`ReadError`] if a label image cannot be read ([`crate::read_label_image`]), if the size of the
    /// mask's image differs from the frame's camera, or if the mask is empty.
    pub fn read_masks(&self, scene: &Scene, detections: &[usize]) -> Vec<Result<Option<Mask>, ReadError>> {
        let mut label_images = HashMap::new();
        let mut pixels = 0;
        let mut read = |&index: &usize| {
            let cached = |labels: &LabelImage| u64::from(labels.width()) * u64::from(labels.height());
            if label_images.values().flatten().map(cached).sum::<u64>() > MAX_CACHED_PIXELS {
                label_images.clear();
            }
            let mask = self.read_mask(scene, index, &mut label_images)?;
            pixels += mask.as_ref().map_or(0, |mask| mask.inside.len() as u64);
            if pixels > MAX_MASK_PIXELS {
                let problem = format!("the masks of a frame have more than {MAX_MASK_PIXELS} pixels in all");
                return Err(ReadError::new(&self.scene_file, problem).in_entry(format!("detections[{index}].mask")));
            }
            Ok(mask)
        };
        detections.iter().map(&mut read).collect()
    }

    fn read_mask<'a>(
        &'a self,
        scene: &Scene,
        index: usize,
        label_images: &mut HashMap<&'a Path, Result<LabelImage, ReadError>>,
    ) -> Result<Option<Mask>, ReadError> {
        let (Some(source), Some(detection)) =
            (self.masks.get(index).and_then(Option::as_ref), scene.detections.get(index))
        else {
            return Ok(None);
        };
        let frame_index = detection.frame_index as usize;
        let here =
            |problem: String| ReadError::new(&self.scene_file, problem).in_entry(format!("detections[{index}].mask"));
        let mask = match source {
            MaskSource::Labels { path, value } => {
                let check = |size| check_size(scene, frame_index, size);
                let read = || read_label_image_of_size(path, &check);
                let labels = label_images.entry(path).or_insert_with(read).as_ref().map_err(Clone::clone)?;
                check([labels.width(), labels.height()]).map_err(|problem| ReadError::new(path, problem))?;
                let mask = value.map_or_else(|| labels.foreground(), |value| labels.mask(value));
                if mask.count() == 0 {
                    return Err(ReadError::new(path, missing_value(labels, *value, index)));
                }
                mask
            }
            MaskSource::Rle(rle) => {
                let [height, width] = rle.size();
                let size = [width, height];
                check_size(scene, frame_index, size).and_then(|()| check_pixels(size)).map_err(here)?;
                rle.to_mask()
            }
            MaskSource::Polygons(polygons) => {
                let size = scene.frames[frame_index].image_size.map_or(Vector2::repeat(MAX_IMAGE), |size| {
                    // Casts saturate; pixels are counted as far as they begin inside of the image.
                    size.map(|x| (x.ceil() as u32).min(MAX_IMAGE))
                });
                let [x0, y0, x1, y1] = polygons.window(size.x, size.y);
                check_pixels([x1.saturating_sub(x0), y1.saturating_sub(y0)]).map_err(here)?;
                polygons.to_mask(size.x, size.y).map_err(|error| here(error.to_string()))?
            }
        };
        if mask.count() == 0 {
            return Err(here("no pixel of the image lies in the mask".to_owned()));
        }
        Ok(Some(mask))
    }
}

/// Whether a size in pixels (width, height) is that of a frame's camera, where this is known; otherwise the problem.
fn check_size(scene: &Scene, frame_index: usize, found: [u32; 2]) -> Result<(), String> {
    let Some(frame) = scene.frames.get(frame_index) else { return Ok(()) };
    match frame.image_size {
        Some(size) if size != Vector2::from(found.map(f64::from)) => Err(format!(
            "the image has {} x {} pixels; the camera of frame \"{}\" has {} x {}",
            found[0], found[1], frame.id, size.x, size.y
        )),
        _ => Ok(()),
    }
}

/// What to say of a label image without the value of a detection.
fn missing_value(labels: &LabelImage, value: Option<u16>, detection: usize) -> String {
    let Some(value) = value else {
        return format!("every pixel is 0; expected the mask of detections[{detection}]");
    };
    let present: Vec<String> = labels.masks().keys().take(LISTED_VALUES + 1).map(u16::to_string).collect();
    let present = match present.len() {
        0 => "every pixel is 0".to_owned(),
        n if n > LISTED_VALUES => format!("its values are {}, ...", present[..LISTED_VALUES].join(", ")),
        _ => format!("its values are {}", present.join(", ")),
    };
    format!("no pixel has the value {value} of detections[{detection}].mask; {present}")
}
