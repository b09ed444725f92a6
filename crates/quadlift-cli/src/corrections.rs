//! Options that correct common mistakes in a scene, shared by `localize`, `associate`, `segment` and `info`.

use std::path::Path;

use quadlift::diagnosis::Correction;
use quadlift_io::correct::{RecordCorrection, options};
use quadlift_io::read_scene_file;
use quadlift_io::run::FileInput;

use crate::args;
use crate::files::with_hint;
use crate::output::one_line;

/// Corrections of conventions in the scene. The options have the names and values that the self-check proposes.
#[derive(clap::Args)]
#[command(next_help_heading = "Corrections of the scene")]
pub struct Corrections {
    /// Convention of the poses if it is not OpenCV's cam_from_world: world-from-camera, opengl, opengl-world-from-camera, body,
    /// left-handed (Unity), camera-center (as translation), transposed-rotation, quaternion-wxyz, quaternion-xyzw, ...
    #[arg(long, value_name = "NAME", value_parser = options::pose_convention)]
    pose_convention: Option<Correction>,

    /// Unit of the poses' translations: mm, cm, m, km, in, ft or its length in metres; the scene is converted to metres
    #[arg(long, value_name = "UNIT", value_parser = options::pose_unit)]
    pose_unit: Option<f64>,

    /// World direction against gravity: x, y, z, -x, -y, -z or X,Y,Z
    #[arg(long, value_name = "AXIS", value_parser = up, allow_hyphen_values = true)]
    up: Option<Up>,

    /// Multiply the focal lengths by this factor
    #[arg(long, value_name = "F", value_parser = args::positive)]
    focal_factor: Option<f64>,

    /// Format of the intrinsics if not pixels: normalized (by width and height) or transposed
    #[arg(long, value_name = "NAME", value_parser = options::intrinsics_format)]
    intrinsics_format: Option<Correction>,

    /// Add lens distortion with this radial coefficient (k of COLMAP's SIMPLE_RADIAL) to the cameras
    #[arg(long, value_name = "K", value_parser = args::finite, allow_negative_numbers = true)]
    radial_distortion: Option<f64>,

    /// Format of the boxes if not the corners xyxy: xywh, cxcywh or yxyx; or how they were misread:
    /// xyxy-as-xywh, cxcywh-as-xywh, xywh-as-cxcywh
    #[arg(long, value_name = "NAME", value_parser = box_format)]
    box_format: Option<BoxNumbers>,

    /// The boxes are normalized by the width and height of the image
    #[arg(long)]
    normalized_boxes: bool,

    /// Multiply the pixel coordinates of the boxes by this factor
    #[arg(long, value_name = "F", value_parser = args::positive)]
    box_scale: Option<f64>,

    /// The boxes were measured in a letterboxed image of this size, such as 640x640 or 640x384
    #[arg(long, value_name = "WxH", value_parser = letterbox)]
    letterbox: Option<RecordCorrection>,

    /// Order in which the frames were numbered for the detector: alphabetical, numeric or reversed
    #[arg(long, value_name = "ORDER", value_parser = options::frame_order)]
    frame_order: Option<Correction>,
}

/// The same options for commands without those of `quadlift import-detections`.
#[derive(clap::Args)]
pub struct SceneCorrections {
    #[command(flatten)]
    corrections: Corrections,

    /// Size of the images in which the boxes were measured, if it is not that of the cameras
    #[arg(long, value_name = "WxH", value_parser = args::image_size, help_heading = "Corrections of the scene")]
    image_size: Option<[f64; 2]>,

    /// The detections of frame number N belong to frame number 0, and so on
    #[arg(long, value_name = "N", allow_negative_numbers = true, help_heading = "Corrections of the scene")]
    frame_offset: Option<i64>,
}

/// A direction, as one value of an option.
#[derive(Debug, Clone, Copy)]
struct Up([f64; 3]);

fn up(text: &str) -> Result<Up, String> {
    options::up(text).map(Up)
}

/// The format of boxes, as one value of an option.
#[derive(Debug, Clone, Copy)]
struct BoxNumbers(Option<Correction>);

fn box_format(text: &str) -> Result<BoxNumbers, String> {
    options::box_format(text).map(BoxNumbers)
}

fn letterbox(text: &str) -> Result<RecordCorrection, String> {
    Ok(options::letterbox(args::image_size(text)?))
}

impl Corrections {
    /// The requested corrections, without the image size of the detections and the frame offset, which are separate
    /// options.
    pub fn list(&self, image_size: Option<[f64; 2]>, frame_offset: Option<i64>) -> Vec<RecordCorrection> {
        let known = [
            self.pose_convention,
            self.focal_factor.map(Correction::FocalFactor),
            self.intrinsics_format,
            self.radial_distortion.map(Correction::RadialDistortion),
            self.box_format.and_then(|format| format.0),
            self.normalized_boxes.then_some(Correction::NormalizedBoxes),
            self.box_scale.map(Correction::ImageScale),
            self.frame_order,
            self.up.map(|up| Correction::Up(up.0)),
            // A shift by more frames than there are leaves nothing in its place, whatever the number.
            frame_offset
                .filter(|offset| *offset != 0)
                .map(|offset| Correction::FrameOffset(i32::try_from(-offset).unwrap_or(i32::MAX))),
        ];
        let mut list: Vec<RecordCorrection> = known.into_iter().flatten().map(RecordCorrection::Known).collect();
        list.extend(self.letterbox);
        list.extend(image_size.map(RecordCorrection::ImageSize));
        list.extend(self.pose_unit.map(RecordCorrection::PoseUnit));
        list
    }
}

impl SceneCorrections {
    /// The requested corrections.
    pub fn list(&self) -> Vec<RecordCorrection> {
        self.corrections.list(self.image_size, self.frame_offset)
    }
}

/// Descriptions of the corrections, one per line.
pub fn corrected_in_words(notes: &[String]) -> String {
    notes.iter().map(|note| format!("corrected: {}\n", one_line(note))).collect()
}

/// Reads a scene file, corrects it and checks it.
pub fn read_input(path: &Path, corrections: &[RecordCorrection]) -> anyhow::Result<FileInput> {
    let file = read_scene_file(path).map_err(|error| with_hint(path, error))?;
    Ok(FileInput::from_file(file, path, corrections)?)
}
