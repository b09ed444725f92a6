//! Records of a scene file: cameras, frames and detections as written. Nothing is validated here.
//!
//! Pixels are corner-based (the first pixel covers [0, 1)), camera axes are OpenCV's, angles are radians, rotations are
//! unit quaternions with w first. Unknown fields are kept in `extra`.

use std::collections::BTreeMap;
use std::fmt;

use quadlift::geometry::{Ellipse, OrientedBox, OrientedBoxError};
use quadlift_segment::Contacts;
use serde::de::value::SeqAccessDeserializer;
use serde::de::{SeqAccess, Visitor};
use serde::{Deserialize, Deserializer, Serialize};
use serde_json::{Map, Value};

use super::cue_records::{Box3dRecord, CueSourceRecord, DepthRecord};
use super::object_records::ObjectRecord;
use crate::numbers;

/// The value of `format` in a scene file.
pub const FORMAT: &str = "quadlift.scene";
/// The value of `version` that this program reads and writes.
pub const VERSION: u64 = 1;
/// The field with the place on Earth of the world's origin, as OpenSfM writes it.
pub const REFERENCE: &str = "reference_lla";
/// The field of frames with the number of the rig's frame: those with the same one were taken at one time step.
pub const RIG_FRAME: &str = "rig_frame";

/// A scene file as written: inputs (cameras, frames, detections, true objects) and outputs (estimated objects).
#[derive(Debug, Clone, PartialEq, Deserialize)]
pub struct SceneFile {
    /// Always [`FORMAT`].
    #[serde(default)]
    pub format: String,
    /// Always [`VERSION`].
    #[serde(default)]
    pub version: u64,
    /// Name of the scene.
    pub name: Option<String>,
    /// World unit ("m" for meters).
    pub length_unit: Option<String>,
    /// World direction against gravity, of any length.
    #[serde(default, deserialize_with = "numbers::optional_list")]
    pub up: Option<[f64; 3]>,
    /// Free text.
    pub notes: Option<String>,
    /// How the objects were obtained: settings and statistics of a localization.
    pub localization: Option<Value>,
    /// The cameras.
    #[serde(default)]
    pub cameras: Vec<CameraRecord>,
    /// The posed images.
    #[serde(default)]
    pub frames: Vec<FrameRecord>,
    /// What is known of the sources of depths, by name.
    #[serde(default)]
    pub cue_sources: BTreeMap<String, CueSourceRecord>,
    /// Points of the scene's surfaces in the world, as structure from motion finds them; may be empty.
    #[serde(default, deserialize_with = "numbers::lists")]
    pub points: Vec<[f64; 3]>,
    /// A file of more points, in the world.
    #[serde(default)]
    pub point_cloud: Option<Box<PointCloudRecord>>,
    /// The detections.
    #[serde(default)]
    pub detections: Vec<DetectionRecord>,
    /// Objects: the truth in an input, estimates in a result.
    #[serde(default)]
    pub objects: Vec<ObjectRecord>,
    /// Unknown fields.
    #[serde(flatten)]
    pub extra: Map<String, Value>,
}

impl Default for SceneFile {
    fn default() -> Self {
        Self {
            format: FORMAT.to_owned(),
            version: VERSION,
            name: None,
            length_unit: None,
            up: None,
            notes: None,
            localization: None,
            cameras: Vec::new(),
            frames: Vec::new(),
            cue_sources: BTreeMap::new(),
            points: Vec::new(),
            point_cloud: None,
            detections: Vec::new(),
            objects: Vec::new(),
            extra: Map::new(),
        }
    }
}

impl SceneFile {
    /// Whether the file is a result: objects of other files are the truth.
    pub fn has_estimates(&self) -> bool {
        self.localization.is_some() || self.objects.iter().any(|object| object.status.is_some())
    }

    /// The result of a localization of this scene: its names, cameras, frames and points with the estimated objects, and where
    /// on Earth the world is (`reference_lla`).
    ///
    /// Objects of the input (ground truth), detections and notes are not copied. Image paths stay relative to the
    /// folder of the input.
    #[must_use]
    pub fn with_results(&self, objects: Vec<ObjectRecord>, localization: Value) -> Self {
        Self {
            name: self.name.clone(),
            length_unit: self.length_unit.clone(),
            up: self.up,
            localization: Some(localization),
            cameras: self.cameras.clone(),
            frames: self.frames.clone(),
            cue_sources: self.cue_sources.clone(),
            points: self.points.clone(),
            point_cloud: self.point_cloud.clone(),
            objects,
            extra: self
                .extra
                .iter()
                .filter(|(key, _)| *key == REFERENCE)
                .map(|(k, v)| (k.clone(), v.clone()))
                .collect(),
            ..Self::default()
        }
    }
}

/// A camera: intrinsics that several frames share.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct CameraRecord {
    /// Id that frames name.
    pub id: String,
    /// COLMAP's name of the model.
    pub model: String,
    /// Image width in pixels; without width and height no box edge is treated as cut off by the image border.
    #[serde(default, skip_serializing_if = "Option::is_none", serialize_with = "numbers::plain")]
    pub width: Option<f64>,
    /// Image height in pixels.
    #[serde(default, skip_serializing_if = "Option::is_none", serialize_with = "numbers::plain")]
    pub height: Option<f64>,
    /// Parameters in COLMAP's order (`PINHOLE`: fx, fy, cx, cy in pixels).
    pub params: Vec<f64>,
    /// Unknown fields.
    #[serde(flatten)]
    pub extra: Map<String, Value>,
}

/// A posed image: a camera and a pose, or a projection.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct FrameRecord {
    /// Id that detections name.
    pub id: String,
    /// Id of the camera.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub camera: Option<String>,
    /// `[R | t]` by rows: maps world points to camera points.
    #[serde(default, skip_serializing_if = "Option::is_none", deserialize_with = "numbers::optional_matrix")]
    pub cam_from_world: Option<[[f64; 4]; 3]>,
    /// 3x4 projection by rows from world points to pixels, instead of a camera and a pose.
    #[serde(default, skip_serializing_if = "Option::is_none", deserialize_with = "numbers::optional_matrix")]
    pub projection: Option<[[f64; 4]; 3]>,
    /// Image width in pixels, for frames with a projection.
    #[serde(default, skip_serializing_if = "Option::is_none", serialize_with = "numbers::plain")]
    pub width: Option<f64>,
    /// Image height in pixels, for frames with a projection.
    #[serde(default, skip_serializing_if = "Option::is_none", serialize_with = "numbers::plain")]
    pub height: Option<f64>,
    /// Path of the image, relative to the scene file.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub image: Option<String>,
    /// Depth image.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub depth: Option<Box<DepthImageRecord>>,
    /// Points of a sensor that belong to the image.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub point_cloud: Option<Box<PointCloudRecord>>,
    /// Which of the scene's points were observed in the image: their numbers from 0.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub observed_points: Option<Box<[u32]>>,
    /// The pixels in which they were observed, in the image as it is, in the order of `observed_points`.
    #[serde(default, skip_serializing_if = "Option::is_none", deserialize_with = "numbers::optional_lists")]
    pub observed_pixels: Option<Box<[[f64; 2]]>>,
    /// Time in seconds.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub time: Option<f64>,
    /// Unknown fields.
    #[serde(flatten)]
    pub extra: Map<String, Value>,
}

/// A depth image of a frame: a PNG file with 16 bits per pixel.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(expecting = "an object {...}")]
pub struct DepthImageRecord {
    /// Path of the file, relative to the scene file.
    pub path: String,
    /// World units of one count; 0.001 for millimeters in a world in meters.
    pub scale: f64,
    /// Depth network or sensor: depths of one source may share a wrong scale. `depth_image` without one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub source: Option<Box<str>>,
    /// Unknown fields.
    #[serde(flatten)]
    pub extra: Map<String, Value>,
}

/// A file of points: a sweep of a LiDAR that belongs to a frame, or points of the whole scene.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(expecting = "an object {...}")]
pub struct PointCloudRecord {
    /// Path of the file, relative to the scene file.
    pub path: String,
    /// What the points are in: `camera` (x to the right, y down, z forwards; the default of a frame's) or `world` (the default, and the only
    /// one, of the scene's).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub frame: Option<Box<str>>,
    /// Three rows `[a, b, c, t]` that map points of the file to `frame`; none where they are in it.
    #[serde(default, skip_serializing_if = "Option::is_none", deserialize_with = "numbers::optional_matrix")]
    pub transform: Option<[[f64; 4]; 3]>,
    /// Sensor: depths of one source may share a wrong scale. `point_cloud` without one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub source: Option<Box<str>>,
    /// Unknown fields.
    #[serde(flatten)]
    pub extra: Map<String, Value>,
}

/// One detection of one object in one frame. There may be millions, so the record is kept small.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct DetectionRecord {
    /// Id of the frame.
    pub frame: Box<str>,
    /// Id of the object, the same in all frames, if known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub object: Option<Box<str>>,
    /// Category.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub category: Option<Box<str>>,
    /// Detector (or other source).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub source: Option<Box<str>>,
    /// Score of the detector.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub score: Option<f64>,
    /// Box `[x0, y0, x1, y1]` in pixels.
    #[serde(
        rename = "box",
        default,
        skip_serializing_if = "Option::is_none",
        deserialize_with = "numbers::optional_list"
    )]
    pub bounding_box: Option<[f64; 4]>,
    /// Ellipse in pixels.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub ellipse: Option<Box<EllipseRecord>>,
    /// Corners of the outline in pixels, a polygon.
    #[serde(default, skip_serializing_if = "Option::is_none", deserialize_with = "numbers::optional_lists")]
    pub outline: Option<Box<[[f64; 2]]>>,
    /// Oriented box.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub oriented_box: Option<Box<OrientedBoxRecord>>,
    /// Mask.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mask: Option<Box<MaskRecord>>,
    /// How far the visible surface is.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub depth: Option<Box<DepthRecord>>,
    /// A 3D box from this image alone.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub box3d: Option<Box<Box3dRecord>>,
    /// How ellipse and mask were found in the image.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub segmentation: Option<Box<SegmentationRecord>>,
    /// Occlusion level (KITTI: 0 visible, 1 partly, 2 largely, 3 unknown).
    #[serde(default, skip_serializing_if = "Option::is_none", serialize_with = "numbers::plain")]
    pub occluded: Option<f64>,
    /// Truncation level (KITTI: 0 wholly inside the image).
    #[serde(default, skip_serializing_if = "Option::is_none", serialize_with = "numbers::plain")]
    pub truncated: Option<f64>,
    /// Share of the object that is visible, in [0, 1].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub visible_fraction: Option<f64>,
    /// Unknown fields.
    #[serde(flatten)]
    pub extra: Map<String, Value>,
}

/// An ellipse in an image.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct EllipseRecord {
    /// Center in pixels.
    #[serde(deserialize_with = "numbers::list")]
    pub center: [f64; 2],
    /// Semi-axes in pixels; the first one has the direction of `angle`.
    #[serde(deserialize_with = "numbers::list")]
    pub semi_axes: [f64; 2],
    /// Direction of the first semi-axis in radians, from x towards y.
    pub angle: f64,
    /// Unknown fields.
    #[serde(flatten)]
    pub extra: Map<String, Value>,
}

impl From<Ellipse> for EllipseRecord {
    fn from(ellipse: Ellipse) -> Self {
        let (center, semi_axes, angle) = (ellipse.center(), ellipse.semi_axes(), ellipse.angle());
        Self { center: center.into(), semi_axes: semi_axes.into(), angle, extra: Map::new() }
    }
}

/// An oriented box in an image.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(expecting = "an object {...}")]
pub struct OrientedBoxRecord {
    /// Center in pixels.
    #[serde(deserialize_with = "numbers::list")]
    pub center: [f64; 2],
    /// Width and height in pixels; the width has the direction of `angle`.
    #[serde(deserialize_with = "numbers::list")]
    pub size: [f64; 2],
    /// Direction of the width in radians, from x towards y.
    pub angle: f64,
    /// Unknown fields.
    #[serde(flatten)]
    pub extra: Map<String, Value>,
}

impl From<OrientedBox> for OrientedBoxRecord {
    fn from(turned: OrientedBox) -> Self {
        Self { center: turned.center().into(), size: turned.size().into(), angle: turned.angle(), extra: Map::new() }
    }
}

impl OrientedBoxRecord {
    /// The checked box.
    pub(crate) fn oriented_box(&self) -> Result<OrientedBox, OrientedBoxError> {
        OrientedBox::new(self.center.into(), self.size.into(), self.angle)
    }
}

/// How the ellipse and the mask of a detection were found in its image (`quadlift segment`), and their quality.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(expecting = "an object {...}")]
pub struct SegmentationRecord {
    /// `graphcut`, `sca` or `masks`.
    pub method: String,
    /// `ok`; `fallback`: no reliable mask, ellipse and mask are those of the box; `failed`: the detection is
    /// unchanged.
    pub status: String,
    /// The reason for `fallback` and `failed`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reason: Option<String>,
    /// From 0 (nothing is known beyond the box) to 1 (every pixel is certain); absent for given masks.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub confidence: Option<f64>,
    /// Fraction of the mask's outline at the image border, if any: the object may be truncated.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub truncated_by_border: Option<f64>,
    /// Fraction of the mask's outline at masks of other objects, if any: one may occlude a part of the other.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub touches_other_masks: Option<f64>,
    /// Unknown fields.
    #[serde(flatten)]
    pub extra: Map<String, Value>,
}

impl SegmentationRecord {
    /// Whether ellipse and mask may be of a part of the object, see [`Contacts::is_partial`].
    pub(crate) fn is_partial(&self) -> bool {
        let share = |share: Option<f64>| share.unwrap_or(0.0);
        Contacts { border: share(self.truncated_by_border), others: share(self.touches_other_masks) }.is_partial()
    }

    /// Whether the mask was found in the box of the detection; otherwise it was given.
    pub(crate) fn found_in_box(&self) -> bool {
        self.method != "masks"
    }

    /// Whether there is no reliable mask: ellipse and mask are those of the box.
    pub(crate) fn fallback(&self) -> bool {
        self.status == "fallback"
    }
}

/// A mask in one of three forms: the pixels of an image that have one value, COCO's runs, or polygons.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(expecting = "an object {...}")]
pub struct MaskRecord {
    /// Path of a label image, relative to the scene file.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub path: Option<String>,
    /// The value of the object's pixels in the label image; every value but zero when absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub value: Option<u32>,
    /// Runs as in COCO.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rle: Option<RleRecord>,
    /// Polygons as in COCO, `[x, y, x, y, ...]` in pixels each; the mask is their union.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub polygons: Option<Vec<Vec<f64>>>,
    /// Unknown fields.
    #[serde(flatten)]
    pub extra: Map<String, Value>,
}

/// COCO's run-length encoding: runs down the columns of the image, the first one outside of the object.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(expecting = "an object {...}")]
pub struct RleRecord {
    /// Height and width of the image in pixels.
    #[serde(deserialize_with = "numbers::whole_list")]
    pub size: [u32; 2],
    /// The runs.
    pub counts: RleCounts,
    /// Unknown fields.
    #[serde(flatten)]
    pub extra: Map<String, Value>,
}

/// The runs of COCO's run-length encoding, in one of its two forms.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(untagged)]
pub enum RleCounts {
    /// Their lengths.
    Runs(Vec<u32>),
    /// The compressed text.
    Compressed(String),
}

impl Default for RleCounts {
    fn default() -> Self {
        Self::Runs(Vec::new())
    }
}

impl<'de> Deserialize<'de> for RleCounts {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(RleCountsVisitor)
    }
}

struct RleCountsVisitor;

impl<'de> Visitor<'de> for RleCountsVisitor {
    type Value = RleCounts;

    fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str("a list of whole numbers, or the text of the compressed form")
    }

    fn visit_str<E>(self, text: &str) -> Result<RleCounts, E> {
        Ok(RleCounts::Compressed(text.to_owned()))
    }

    fn visit_seq<A: SeqAccess<'de>>(self, seq: A) -> Result<RleCounts, A::Error> {
        Vec::deserialize(SeqAccessDeserializer::new(seq)).map(RleCounts::Runs)
    }
}
