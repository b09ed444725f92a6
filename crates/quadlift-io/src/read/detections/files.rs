//! The types that readers of detections return, and the functions that they share.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use crate::error::ReadError;
use crate::input::{paths_below, read_bytes};
use crate::read::format::Format;
use crate::scene_file::{Box3dRecord, RleRecord};

/// A file with its bytes.
pub(super) type File<'a> = (&'a Path, &'a [u8]);

/// A format of detections.
pub type DetectionFormat = Format<DetectionFiles>;

/// The detections in a file or folder of another program.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct DetectionFiles {
    /// The file or folder, for messages.
    pub path: PathBuf,
    /// The images that it speaks of, in its order.
    pub images: Vec<DetectedImage>,
    /// Whether coordinates are fractions of image width and height instead of pixels.
    pub normalized: bool,
    /// How the images are numbered.
    pub numbering: Numbering,
    /// Notes: conversions, assumptions and skipped parts.
    pub notes: Vec<String>,
}

/// How a file numbers its images.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Numbering {
    /// With the numbers in the names of the images.
    OfNames,
    /// From this number, whatever the names of the images.
    From(i64),
    /// With the numbers of frames of a video, of which every `step`-th one from `first` to `last` was annotated.
    Sampled {
        /// The first one.
        first: i64,
        /// Frames from one to the next.
        step: i64,
        /// The last one.
        last: i64,
    },
    /// The format does not say.
    #[default]
    Unknown,
}

/// The identification of an image in a file: at least one of name, number and time.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct ImageKey {
    /// Name of the image, with folders if the file has them. Label files have the name of their image without the
    /// extension.
    pub name: Option<String>,
    /// Number, as in the file.
    pub number: Option<i64>,
    /// Time in seconds.
    pub time: Option<f64>,
    /// Width and height in pixels.
    pub size: Option<[f64; 2]>,
}

impl ImageKey {
    /// The name of the image for messages.
    pub(crate) fn words(&self) -> String {
        match (&self.name, self.number, self.time) {
            (Some(name), _, _) => name.clone(),
            (None, Some(number), _) => number.to_string(),
            (None, None, Some(time)) => format!("{time} s"),
            (None, None, None) => "an image".to_owned(),
        }
    }
}

/// An image and its detections.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct DetectedImage {
    /// Which image it is.
    pub key: ImageKey,
    /// The detections.
    pub detections: Vec<Detected>,
}

/// A detection in the coordinates of its file.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Detected {
    /// Track id.
    pub track: Option<String>,
    /// Name of the class, or its number.
    pub category: Option<String>,
    /// Score of the detector.
    pub score: Option<f64>,
    /// Box `[x0, y0, x1, y1]`; if absent, the bounding box of the outline is used.
    pub bounding_box: Option<[f64; 4]>,
    /// Additional shape information.
    pub outline: Outline,
    /// A 3D box; the only thing that some formats have.
    pub box3d: Option<Box<Box3dRecord>>,
    /// KITTI's levels of occlusion and truncation.
    pub occluded: Option<f64>,
    /// See [`Self::occluded`].
    pub truncated: Option<f64>,
    /// Share of the object that is visible, in [0, 1].
    pub visible_fraction: Option<f64>,
}

/// The outline of a detected object.
#[derive(Debug, Clone, PartialEq, Default)]
pub enum Outline {
    /// Not known.
    #[default]
    Unknown,
    /// Polygons `[x, y, x, y, ...]`; the mask is their union.
    Polygons(Vec<Vec<f64>>),
    /// A mask in COCO's runs.
    Rle(RleRecord),
    /// The corners of a rotated box in order.
    OrientedBox([[f64; 2]; 4]),
    /// Center and radius.
    Circle([f64; 3]),
}

/// Edges of a box by left, top, width and height. An error, in words, when they are no box; one of width or height 0 is
/// left for [`add_detections`], which counts it.
pub(super) fn edges_of_size([x, y, width, height]: [f64; 4]) -> Result<[f64; 4], String> {
    if width < 0.0 || height < 0.0 {
        return Err(format!("the box has the width {width} and the height {height}; expected positive numbers"));
    }
    checked_edges([x, y, x + width, y + height])
}

/// The edges of a box, if they are in order.
pub(super) fn checked_edges(edges: [f64; 4]) -> Result<[f64; 4], String> {
    let [x0, y0, x1, y1] = edges;
    if !edges.iter().all(|x| x.is_finite()) {
        return Err(format!("the box {edges:?} holds a number that is not finite"));
    }
    if x0 > x1 || y0 > y1 {
        return Err(format!("the box {edges:?} is reversed; expected [x0, y0, x1, y1] with x0 < x1 and y0 < y1"));
    }
    Ok(edges)
}

/// Smallest and largest of coordinates x, y, x, y, ...
pub(super) fn extent(coordinates: impl Iterator<Item = f64>) -> [f64; 4] {
    let mut edges = [f64::INFINITY, f64::INFINITY, f64::NEG_INFINITY, f64::NEG_INFINITY];
    for (index, x) in coordinates.enumerate() {
        let axis = index % 2;
        edges[axis] = edges[axis].min(x);
        edges[axis + 2] = edges[axis + 2].max(x);
    }
    edges
}

/// Detections in the order of the file, gathered by image.
#[derive(Debug, Default)]
pub(super) struct ByImage {
    pub(super) images: Vec<DetectedImage>,
    index_of: HashMap<String, usize>,
}

impl ByImage {
    /// The image with this key, which is added if it is new.
    pub(super) fn image(&mut self, key: ImageKey) -> &mut DetectedImage {
        let images = &mut self.images;
        let index = *self.index_of.entry(key.words()).or_insert_with(|| {
            images.push(DetectedImage { key, detections: Vec::new() });
            images.len() - 1
        });
        &mut images[index]
    }
}

/// A file that holds the detections of one image.
#[derive(Debug, Clone, PartialEq, Default)]
pub(super) struct LabelFile {
    /// Path relative to the folder that was named, with slashes.
    pub name: String,
    /// Path, for messages.
    pub path: PathBuf,
    /// Content.
    pub bytes: Vec<u8>,
}

/// A file, or the files with an extension in a folder and in those in it, sorted.
pub(super) fn label_files(path: &Path, extension: &str) -> Result<Vec<LabelFile>, ReadError> {
    if !path.is_dir() {
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        return Ok(vec![LabelFile { name, path: path.to_owned(), bytes: read_bytes(path)? }]);
    }
    let mut files = Vec::new();
    for (name, path) in paths_below(path, extension)? {
        files.push(LabelFile { name, bytes: read_bytes(&path)?, path });
    }
    if files.is_empty() {
        return Err(ReadError::new(path, format!("there is no .{extension} file in the folder")));
    }
    Ok(files)
}
