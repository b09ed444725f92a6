//! Segments one scene: options, images read one at a time, calls of `quadlift-segment`, and a result or a failure for every
//! detection. [`add_to_scene`] writes that into the scene file.

mod options;
mod result;

use std::collections::{BTreeMap, HashMap};
use std::ops::ControlFlow;
use std::path::PathBuf;

use nalgebra::Vector2;
use quadlift::geometry::Ellipse;
use quadlift::scene::{Scene, SourceError};
use quadlift_segment::{
    Contacts, Crop, CropOptions, Failure, FrameMasks, Mask, Moments, PixelTerm, SegmentError, SegmentMethod,
    SegmentOptions, SegmentStatus, ViewSegmentation, segment_objects,
};

use crate::problems::{Problem, Problems};
use crate::read::detections::numbers_of_frames;
use crate::scene_file::mask_check::mask_contradiction;
use crate::scene_file::{MaskSource, SceneFile, SceneImages};
use crate::video::file_of_image;

pub use options::SEGMENTATION;
pub use result::add_to_scene;

/// Where masks come from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Method {
    /// From the images.
    Image(SegmentMethod),
    /// The masks of the scene.
    Masks,
}

impl Default for Method {
    fn default() -> Self {
        Self::Image(SegmentMethod::GraphCut)
    }
}

impl Method {
    /// The available ones, in the order of the documentation.
    pub const ALL: [Self; 3] = [Self::Image(SegmentMethod::GraphCut), Self::Image(SegmentMethod::Sca), Self::Masks];

    /// Their names on the command line and in files.
    pub(crate) const NAMES: [&str; 3] = ["graphcut", "sca", "masks"];

    /// The name on the command line and in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Image(method) => method.name(),
            Self::Masks => "masks",
        }
    }
}

/// The counted items while a scene is segmented.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Step {
    /// Images, one after another.
    Images,
    /// Objects, afterwards and on several threads.
    Objects,
}

/// Called with the number of things done and their total, from any thread.
type Progress<'a> = &'a (dyn Fn(Step, usize, usize) -> ControlFlow<()> + Sync);

/// How frames get their images, for messages.
const HOW_TO_NAME_IMAGES: &str = "`quadlift import FORMAT ... --images DIR` names the folder of the images; `quadlift \
                                  localize` works without images";

/// Why a scene cannot be segmented at all.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum SegmentSceneError {
    /// It is not clear which detections are meant.
    #[error(transparent)]
    Source(#[from] SourceError),
    /// There is nothing to do, for this reason.
    #[error("there is nothing to {0}")]
    Nothing(&'static str),
    /// The frames name no images.
    #[error(
        "no frame has an \"image\"; expected the path of an image file, relative to the scene file ({HOW_TO_NAME_IMAGES})"
    )]
    NoImage,
    /// None of the images that the frames name exists.
    #[error(
        "{}, such as {}; paths are relative to the scene file ({HOW_TO_NAME_IMAGES})",
        if *.count == 1 { "the image that a frame names does not exist".to_owned() }
        else { format!("none of the {} images that the frames name exists", .count) },
        first.display()
    )]
    MissingImages {
        /// How many images are named.
        count: usize,
        /// The first of them.
        first: PathBuf,
    },
    /// An option is outside of its range.
    #[error(transparent)]
    Segment(#[from] SegmentError),
}

/// The choices for a segmentation.
#[derive(Debug, Clone, Default)]
pub struct Settings {
    /// Where masks come from.
    pub method: Method,
    /// The source whose detections are segmented.
    pub source: Option<String>,
    /// Seed of all random numbers.
    pub seed: u64,
    /// Whether crops are needed even if the method does not use the images: for the contact sheets.
    pub with_crops: bool,
}

/// The result of a detection.
#[derive(Debug, Clone)]
pub struct Found {
    /// The object's pixels in the image.
    pub mask: Mask,
    /// The ellipse with the mask's second moments, or the one in the box.
    pub ellipse: Ellipse,
    /// Confidence of the pixels; none for given masks.
    pub confidence: Option<f64>,
    /// Why the ellipse in the box is used, if it is.
    pub fallback: Option<Failure>,
    /// Parts of the outline that do not belong to the object.
    pub contacts: Contacts,
}

/// Detections that are segmented together: those of one object, or all without an object id, each of them alone.
#[derive(Debug, Clone)]
pub struct Group {
    /// Id of the object.
    pub object: Option<String>,
    /// Its detections in the order of the frames.
    pub detections: Vec<usize>,
}

/// The result for a scene. The lists over detections run parallel to those of the scene.
#[derive(Debug, Clone)]
pub struct Segmentation {
    /// The detections of the chosen source, by object.
    pub groups: Vec<Group>,
    /// The result of each detection.
    pub found: Vec<Option<Found>>,
    /// The crops of the detections, if any.
    pub crops: Vec<Option<Crop>>,
    /// Detections of the source that have no box and so no crop.
    pub without_box: Vec<usize>,
    /// What went wrong.
    pub problems: Problems,
    /// For each detection, the index of its first problem.
    problem_of: Vec<Option<usize>>,
}

impl Segmentation {
    fn new(detections: usize) -> Self {
        Self {
            groups: Vec::new(),
            found: vec![None; detections],
            crops: vec![None; detections],
            without_box: Vec::new(),
            problems: Problems::default(),
            problem_of: vec![None; detections],
        }
    }

    /// The problem of a detection.
    pub(crate) fn problem_of(&self, detection: usize) -> Option<&Problem> {
        self.problems.list().get(self.problem_of[detection]?)
    }

    fn failed(&mut self, message: impl ToString, detections: &[usize]) {
        let problem = self.problems.add(message.to_string(), detections);
        for &index in detections {
            self.problem_of[index].get_or_insert(problem);
        }
    }
}

/// Segments the detections of a scene; those of one object together.
///
/// Images are read one at a time; only the crops around the detections are kept. Errors of single detections are in
/// [`Segmentation::problems`].
///
/// # Errors
/// [`SegmentSceneError`] if the source is ambiguous or nothing can be segmented.
pub fn segment_scene(
    scene: &Scene,
    images: &SceneImages,
    settings: &Settings,
    progress: &(dyn Fn(Step, usize, usize) -> ControlFlow<()> + Sync),
) -> Result<Segmentation, SegmentSceneError> {
    let nothing = |why| Err(SegmentSceneError::Nothing(why));
    let source = scene.source_index(settings.source.as_deref())?;
    let chosen = |index: &usize| source.is_none() || scene.detections[*index].source_index == source;
    let mut detections: Vec<usize> = (0..scene.detections.len()).filter(chosen).collect();
    if detections.is_empty() {
        return nothing("segment: the scene has no detections");
    }
    let mut segmentation = Segmentation::new(scene.detections.len());
    let reads_masks = settings.method == Method::Masks;
    if reads_masks {
        if !detections.iter().any(|&index| images.masks[index].is_some()) {
            return nothing("read: no detection has a \"mask\"");
        }
    } else {
        let has_box = |&index: &usize| images.boxes[index].is_some();
        (detections, segmentation.without_box) = detections.into_iter().partition(has_box);
        if detections.is_empty() {
            return nothing("segment: no detection has a \"box\"");
        }
    }
    if !reads_masks || settings.with_crops {
        let mut named = images.images.iter().flatten();
        let first = named.clone().next().ok_or(SegmentSceneError::NoImage)?;
        if !named.any(|path| file_of_image(path).exists()) {
            let count = images.images.iter().flatten().count();
            return Err(SegmentSceneError::MissingImages { count, first: first.clone() });
        }
    }
    let frames = by_frame(scene, &detections);
    segmentation.groups = by_object(scene, &frames);
    images.videos.want(frames.keys().copied());
    for (done, (&frame, detections)) in frames.iter().enumerate() {
        if progress(Step::Images, done, frames.len()).is_break() {
            return Err(SegmentError::Canceled.into());
        }
        if reads_masks {
            take_masks(scene, images, detections, &mut segmentation);
        }
        if !reads_masks || settings.with_crops {
            cut_crops(scene, images, frame, detections, &mut segmentation);
        }
    }
    if progress(Step::Images, frames.len(), frames.len()).is_break() {
        return Err(SegmentError::Canceled.into());
    }
    if let Method::Image(method) = settings.method {
        let options = SegmentOptions { method, seed: settings.seed, ..Default::default() };
        segment_crops(&options, &mut segmentation, progress)?;
    }
    for (&frame, detections) in &frames {
        find_contacts(scene, frame, detections, &mut segmentation);
    }
    Ok(segmentation)
}

/// The detections of each frame, in the order of the scene.
fn by_frame(scene: &Scene, detections: &[usize]) -> BTreeMap<usize, Vec<usize>> {
    let mut frames: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
    for &index in detections {
        frames.entry(scene.detections[index].frame_index as usize).or_default().push(index);
    }
    frames
}

/// The detections of each object in the order of the frames, then those without an object id.
fn by_object(scene: &Scene, frames: &BTreeMap<usize, Vec<usize>>) -> Vec<Group> {
    let mut objects: Vec<Vec<usize>> = vec![Vec::new(); scene.object_ids.len() + 1];
    for &index in frames.values().flatten() {
        let object = scene.detections[index].object_index.map_or(scene.object_ids.len(), |object| object as usize);
        objects[object].push(index);
    }
    let group = |(object, detections)| Group { object: scene.object_ids.get(object).cloned(), detections };
    objects.into_iter().enumerate().map(group).filter(|group| !group.detections.is_empty()).collect()
}

/// Most pixels of the masks that are held at once.
const MAX_MASK_PIXELS: u64 = 1 << 32;

/// Reads the masks of a frame's detections.
fn take_masks(scene: &Scene, images: &SceneImages, detections: &[usize], segmentation: &mut Segmentation) {
    let held = segmentation.found.iter().flatten().map(|found| found.mask.inside.len() as u64);
    if held.sum::<u64>() > MAX_MASK_PIXELS {
        let problem = format!("the masks of the scene have more than {MAX_MASK_PIXELS} pixels in all");
        return segmentation.failed(format!("{}: {problem}", images.scene_file.display()), detections);
    }
    for (&index, mask) in detections.iter().zip(images.read_masks(scene, detections)) {
        match mask {
            Ok(Some(mask)) => {
                // Polygons have moments of their own, finer than those of their pixels.
                let moments = match &images.masks[index] {
                    Some(MaskSource::Polygons(polygons)) => polygons.moments(),
                    _ => Moments::of_mask(&mask, PixelTerm::Centers),
                };
                match moments.and_then(|moments| moments.ellipse()) {
                    Some(ellipse) => {
                        if let Some(reason) = mask_contradiction(&mask, index, detections, (scene, images)) {
                            let place = images.scene_file.display();
                            segmentation.failed(format!("{place}: the mask does not meet its box: {reason}"), &[index]);
                            continue;
                        }
                        let contacts = Contacts::default();
                        segmentation.found[index] =
                            Some(Found { mask, ellipse, confidence: None, fallback: None, contacts });
                    }
                    None => {
                        let place = format!("{}: detections[{index}].mask", images.scene_file.display());
                        segmentation.failed(format!("{place}: a point or a line has no ellipse"), &[index]);
                    }
                }
            }
            Ok(None) => {
                segmentation.failed(format!("{}: there is no \"mask\"", images.scene_file.display()), &[index]);
            }
            Err(error) => segmentation.failed(error, &[index]),
        }
    }
}

/// Reads the image of a frame, cuts the crops of its detections and drops the image.
fn cut_crops(scene: &Scene, images: &SceneImages, frame: usize, detections: &[usize], segmentation: &mut Segmentation) {
    let image = match images.read_image(scene, frame) {
        Ok(image) => image,
        Err(error) => return segmentation.failed(error, detections),
    };
    for &index in detections {
        let of_mask = || segmentation.found[index].as_ref().and_then(|found| found.mask.bounding_box());
        let Some(bounding_box) = images.boxes[index].or_else(of_mask) else { continue };
        match Crop::cut(&image, &bounding_box, &CropOptions::default()) {
            Ok(crop) => segmentation.crops[index] = Some(crop),
            Err(error) => {
                let place = format!("{}: detections[{index}].box", images.scene_file.display());
                segmentation.failed(format!("{place}: {error}"), &[index]);
            }
        }
    }
}

/// Segments the crops, those of one object together.
fn segment_crops(
    options: &SegmentOptions,
    segmentation: &mut Segmentation,
    progress: Progress,
) -> Result<(), SegmentError> {
    let with_crop = |index: &usize| segmentation.crops[*index].is_some();
    let mut together: Vec<Vec<usize>> = Vec::new();
    for group in &segmentation.groups {
        let detections: Vec<usize> = group.detections.iter().copied().filter(with_crop).collect();
        match group.object {
            Some(_) => together.push(detections),
            None => together.extend(detections.into_iter().map(|index| vec![index])),
        }
    }
    let mut take = |index: &usize| segmentation.crops[*index].take();
    let crops: Vec<Vec<Crop>> = together.iter().map(|list| list.iter().filter_map(&mut take).collect()).collect();
    let results = segment_objects(&crops, options, &|done: usize, total: usize| progress(Step::Objects, done, total));
    for ((list, crops), views) in together.iter().zip(crops).zip(results) {
        for ((&index, crop), view) in list.iter().zip(crops).zip(views?) {
            segmentation.crops[index] = Some(crop);
            segmentation.found[index] = Some(found(view));
        }
    }
    Ok(())
}

fn found(view: ViewSegmentation) -> Found {
    let fallback = match view.status {
        SegmentStatus::Fallback(failure) => Some(failure),
        SegmentStatus::Ok => None,
    };
    let (mask, ellipse, contacts) = (view.mask, view.ellipse, Contacts::default());
    Found { mask, ellipse, confidence: Some(view.confidence), fallback, contacts }
}

/// Finds where the masks of a frame touch each other and the border of the image.
fn find_contacts(scene: &Scene, frame: usize, detections: &[usize], segmentation: &mut Segmentation) {
    let image = image_size(scene, frame, detections, segmentation).unwrap_or([u32::MAX; 2]);
    let trusted = |found: &&Found| found.fallback.is_none();
    let masks = detections.iter().filter_map(|&index| segmentation.found[index].as_ref().filter(trusted));
    let all = FrameMasks::new(masks.map(|found| &found.mask));
    for &index in detections {
        if let Some(found) = segmentation.found[index].as_mut().filter(|found| found.fallback.is_none()) {
            found.contacts = all.contacts(&found.mask, image);
        }
    }
}

/// Width and height of a frame's image in pixels, if known.
fn image_size(scene: &Scene, frame: usize, detections: &[usize], segmentation: &Segmentation) -> Option<[u32; 2]> {
    let of_crops = detections.iter().find_map(|&index| Some(segmentation.crops[index].as_ref()?.image_size()));
    // Images and masks of another size have been refused, so that the camera's is a whole number where there is one.
    of_crops.or_else(|| scene.frames[frame].image_size.map(|size: Vector2<f64>| [size.x as u32, size.y as u32]))
}

/// Sets the images of a scene to the frames of a video, which is named by its path as seen from the scene file. Frames with
/// numbers in their names are those frames of the video, from 0, or from 1 if that is the first number; without numbers
/// they are its frames in their order. Returns the first pair, in words.
pub fn set_video(scene: &mut SceneFile, video: &str) -> Option<String> {
    let numbers = numbers_of_frames(&scene.frames);
    let first = numbers.as_ref().and_then(|numbers| numbers.keys().next().copied()).unwrap_or_default();
    let offset = if first == 1 { 1 } else { 0 };
    let number_of: HashMap<usize, i64> =
        numbers.iter().flatten().map(|(number, frame)| (*frame, number - offset)).collect();
    for (index, frame) in scene.frames.iter_mut().enumerate() {
        let number = number_of.get(&index).copied().unwrap_or(index as i64);
        frame.image = Some(format!("{video}#frame={number}"));
    }
    let frame = scene.frames.first()?;
    let kind = if numbers.is_some() { "the numbers in their names" } else { "their places in the scene" };
    let image = frame.image.as_deref()?;
    Some(format!("images were taken from the video by {kind}: frame \"{}\" is {image}", frame.id))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene_file::FrameRecord;

    #[test]
    fn frames_of_a_scene_are_those_of_their_numbers() {
        let images = |ids: &[&str]| {
            let frames = ids.iter().map(|id| FrameRecord { id: (*id).to_owned(), ..FrameRecord::default() });
            let mut scene = SceneFile { frames: frames.collect(), ..SceneFile::default() };
            let note = set_video(&mut scene, "d.mp4").unwrap();
            (scene.frames.into_iter().map(|frame| frame.image.unwrap()).collect::<Vec<_>>(), note)
        };
        assert_eq!(images(&["a", "b"]).0, ["d.mp4#frame=0", "d.mp4#frame=1"]);
        assert_eq!(images(&["f_0001.png", "f_0003.png"]).0, ["d.mp4#frame=0", "d.mp4#frame=2"]);
        assert_eq!(images(&["000090", "000092"]).0, ["d.mp4#frame=90", "d.mp4#frame=92"]);
        insta::assert_snapshot!(images(&["f_0001.png"]).1, @r#"images were taken from the video by the numbers in their names: frame "f_0001.png" is d.mp4#frame=0"#);
    }
}
