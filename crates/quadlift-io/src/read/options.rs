//! Options of readers: what files do not contain. One table for the program and the tests of formats.

use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};

use super::import::PixelCenters;
use crate::correct::assume::image_size;
use crate::error::ReadError;
use crate::format_options::{FormatOption, list, name, one_of, path, positive, whole};

/// The options of all formats; each reads its own ([`super::format::Format::options`]).
#[derive(Debug, Clone, PartialEq, Default)]
pub struct ReadOptions {
    /// Maximum number of sparse points to keep, evenly spread.
    pub points: Option<usize>,
    /// Width and height of the images in pixels.
    pub image_size: Option<[f64; 2]>,
    /// Origin of pixel coordinates.
    pub pixel_centers: PixelCenters,
    /// File of the intrinsics.
    pub intrinsics: Option<PathBuf>,
    /// File with lines `time image`.
    pub image_list: Option<PathBuf>,
    /// Maximum difference of times in seconds.
    pub time_tolerance: Option<f64>,
    /// Name of the sequence or scene.
    pub sequence: Option<String>,
    /// First and last frame.
    pub frames: Option<RangeInclusive<usize>>,
    /// Number of the camera.
    pub camera: Option<u8>,
    /// Folder of the calibration files.
    pub calibration_folder: Option<PathBuf>,
    /// Names of cameras.
    pub channels: Vec<String>,
    /// Whether images between the key frames are read.
    pub sweeps: bool,
    /// Number of the object whose model frame is the world.
    pub world_object: Option<u64>,
    /// File with the extents of models.
    pub models: Option<PathBuf>,
    /// File of the class names.
    pub names: Option<PathBuf>,
    /// The data set that names images and categories of results.
    pub annotations: Option<PathBuf>,
    /// The column that identifies the image of a row.
    pub frame_column: Option<String>,
    /// Meaning of the columns after the coordinates.
    pub columns: Option<String>,
    /// Kind of coordinates.
    pub kind: Option<String>,
    /// Whether the first pixel has the coordinate 0 instead of 1.
    pub boxes_from_zero: bool,
    /// Topics of a log to use instead of all others of their kinds.
    pub topics: Vec<String>,
    /// The frame of a log in which objects are located.
    pub world_frame: Option<String>,
    /// The frame of the camera in a log.
    pub camera_frame: Option<String>,
    /// Longest time in seconds between two transforms that is interpolated.
    pub max_gap: Option<f64>,
    /// Whether boxes were measured in the rectified image.
    pub rectified: bool,
    /// Whether what cannot be read is left out.
    pub skip_errors: bool,
    /// Folder for the images in a log.
    pub write_images: Option<PathBuf>,
    /// Whether the boxes have another format than the file's, which a correction undoes later: they may look reversed.
    pub boxes_follow: bool,
    /// The detections that will take the place of those in the file, if there are any.
    pub detections: Option<PathBuf>,
}

impl ReadOptions {
    /// One of the values of an option that has a meaning in the format of a file.
    ///
    /// # Errors
    /// [`ReadError`] with the value and those that were expected.
    pub(super) fn choice<T: Copy + Default>(
        path: &Path,
        (name, given): (&str, Option<&String>),
        values: &[(&str, T)],
    ) -> Result<T, ReadError> {
        let Some(given) = given.filter(|given| *given != "auto") else { return Ok(T::default()) };
        let known = values.iter().find(|(value, _)| value == given).map(|(_, meaning)| *meaning);
        known.ok_or_else(|| {
            let values: Vec<&str> = values.iter().map(|(value, _)| *value).collect();
            ReadError::new(path, format!("--{name} is \"{given}\"; expected auto, {}", values.join(", ")))
        })
    }
}

type Read = FormatOption<ReadOptions>;

/// All options of readers.
pub const READ: &[Read] = &[
    Read::new("class_names", "FILE", "Class names: one per line, or the `names` of a .yaml file", |o, text| {
        path(&mut o.names, text)
    }),
    Read::new(
        "annotations",
        "FILE.json",
        "COCO: the data set that names images and categories of results",
        |o, text| path(&mut o.annotations, text),
    ),
    Read::new("frame_column", "NAME", "Column of a table that identifies the image (default: by name)", |o, text| {
        name(&mut o.frame_column, text)
    }),
    Read::new(
        "columns",
        "WHAT",
        "Columns after the box. MOT: auto, det (confidence), gt (flag, class, visibility), class (confidence, class). \
         YOLO: auto, none, score, track, score+track",
        |o, text| {
            name(
                &mut o.columns,
                one_of(text, &["auto", "det", "gt", "class", "none", "score", "track", "score+track"])?,
            )
        },
    ),
    Read::new("kind", "WHAT", "YOLO, what follows the class: auto, box, polygon or obb (a rotated box)", |o, text| {
        name(&mut o.kind, one_of(text, &["auto", "box", "polygon", "obb"])?)
    }),
    Read::new(
        "box_origin",
        "0|1",
        "MOT: coordinate of the left edge of the first pixel, 1 as in MOTChallenge, 0 as in many trackers [default: 1]",
        |o, text| {
            o.boxes_from_zero = one_of(text, &["0", "1"])? == "0";
            Ok(())
        },
    ),
    Read::new(
        "pixel_centers",
        "WHERE",
        "Position of the center of the first pixel: 0 (integer) or 0.5 (half) [default: half]",
        |o, text| {
            let is_integer = one_of(text, &["integer", "half"])? == "integer";
            o.pixel_centers = if is_integer { PixelCenters::Integer } else { PixelCenters::Half };
            Ok(())
        },
    ),
    Read::new(
        "image_size",
        "WxH",
        "Width and height of the images in pixels, such as 640x480, if the files do not contain them",
        |o, text| {
            o.image_size = Some(image_size(text)?);
            Ok(())
        },
    ),
    Read::new(
        "points",
        "N",
        "Maximum number of sparse points to keep, evenly spread; 0 for none [default: 5000]",
        |o, text| whole(&mut o.points, text),
    ),
    Read::new(
        "sequence",
        "NAME",
        "KITTI: the sequence, such as 0001 (default: that of the detections); nuScenes: the scene, such as scene-0061",
        |o, text| name(&mut o.sequence, text),
    ),
    Read::new(
        "frames",
        "FIRST-LAST",
        "KITTI: first and last frame, from 0, such as 90-106 (default: all)",
        |o, text| {
            let range = text.split_once('-').and_then(|(a, b)| Some(a.trim().parse().ok()?..=b.trim().parse().ok()?));
            o.frames = range.filter(|range| !range.is_empty());
            o.frames.as_ref().map(|_| ()).ok_or_else(|| "expected FIRST-LAST, such as 90-106".to_owned())
        },
    ),
    Read::new(
        "intrinsics",
        "FILE",
        "TUM: a line fx fy cx cy [k1 k2 p1 p2 [k3]], or MODEL WIDTH HEIGHT PARAMS",
        |o, text| path(&mut o.intrinsics, text),
    ),
    Read::new("image_list", "FILE", "TUM: lines `time image`; each image gets the pose nearest in time", |o, text| {
        path(&mut o.image_list, text)
    }),
    Read::new(
        "time_tolerance",
        "SECONDS",
        "Maximum difference of the times of an image and its pose or frame, in seconds [default: 0.02]",
        |o, text| positive(&mut o.time_tolerance, text),
    ),
    Read::new("camera", "N", "KITTI raw: number of the camera, 0, 1 (gray), 2 or 3 (color) [default: 2]", |o, text| {
        o.camera = one_of(text, &["0", "1", "2", "3"])?.parse().ok();
        Ok(())
    }),
    Read::new(
        "calibration_folder",
        "DIR",
        "KITTI raw: folder of the calibration (default: above the drive)",
        |o, text| path(&mut o.calibration_folder, text),
    ),
    Read::new("channels", "NAME,...", "nuScenes: cameras, such as CAM_FRONT,CAM_BACK (default: all)", |o, text| {
        o.channels = list(text);
        Ok(())
    }),
    Read::new("sweeps", "", "nuScenes: also read the images between the key frames", |o, _| {
        o.sweeps = true;
        Ok(())
    }),
    Read::new(
        "world_object",
        "ID",
        "BOP: number of the object whose model frame becomes the world frame",
        |o, text| whole(&mut o.world_object, text),
    ),
    Read::new("models", "FILE", "BOP: models_info.json (default: in `models` of the parent folders)", |o, text| {
        path(&mut o.models, text)
    }),
    Read::new("topics", "NAME,...", "Topics to use instead of all others of their kinds", |o, text| {
        o.topics = list(text);
        Ok(())
    }),
    Read::new(
        "world_frame",
        "NAME",
        "The frame in which objects are located [default: root of the transforms]",
        |o, text| name(&mut o.world_frame, text),
    ),
    Read::new(
        "camera_frame",
        "NAME",
        "The frame of the camera [default: the frame_id of its calibration]",
        |o, text| name(&mut o.camera_frame, text),
    ),
    Read::new(
        "max_gap",
        "SECONDS",
        "Longest time between two transforms that is interpolated, in seconds [default: 1]",
        |o, text| positive(&mut o.max_gap, text),
    ),
    Read::new("rectified", "", "The boxes were measured in the rectified image: use P and R, not K and D", |o, _| {
        o.rectified = true;
        Ok(())
    }),
    Read::new("skip_errors", "", "Leave out what is damaged or cannot be read, and use the rest", |o, _| {
        o.skip_errors = true;
        Ok(())
    }),
    Read::new("write_images", "DIR", "Write the compressed images of the log into this folder", |o, text| {
        path(&mut o.write_images, text)
    }),
];
