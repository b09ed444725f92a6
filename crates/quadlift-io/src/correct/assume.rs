//! What `--assume KEY=VALUE` says about a scene, in the program and in Python: the keys, their values, and the text that the
//! check proposes.

use std::str::FromStr;

use crate::options::{Kind, Range};
use quadlift::diagnosis::{BoxFormat, Correction};

use super::record_correction::RecordCorrection;
use super::rounding::{UNITS, nearest_unit, usual_width};

/// The values of `poses`: what the poses of the file are.
pub(crate) const POSES: [(&str, Correction); 13] = [
    ("world-from-camera", Correction::InvertPoses),
    ("opengl", Correction::OpenGlAxes),
    ("opengl-world-from-camera", Correction::InvertOpenGlPoses),
    ("body", Correction::BodyAxes),
    ("body-world-from-camera", Correction::InvertBodyPoses),
    ("left-handed", Correction::LeftHandedAxes),
    ("left-handed-world-from-camera", Correction::InvertLeftHandedPoses),
    ("camera-center", Correction::CenterAsTranslation),
    ("transposed-rotation", Correction::TransposedRotation),
    ("quaternion-wxyz", Correction::QuaternionOrder { was_wxyz: true, world_from_cam: false }),
    ("quaternion-xyzw", Correction::QuaternionOrder { was_wxyz: false, world_from_cam: false }),
    ("quaternion-wxyz-world-from-camera", Correction::QuaternionOrder { was_wxyz: true, world_from_cam: true }),
    ("quaternion-xyzw-world-from-camera", Correction::QuaternionOrder { was_wxyz: false, world_from_cam: true }),
];

/// The values of `boxes`: what the four numbers of a box are.
const BOXES: [(&str, Option<BoxFormat>); 8] = [
    ("xyxy", None),
    ("xywh", Some(BoxFormat::SizeReadAsCorners)),
    ("cxcywh", Some(BoxFormat::CenterSizeReadAsCorners)),
    ("yxyx", Some(BoxFormat::SwappedAxes)),
    ("xyxy-as-xywh", Some(BoxFormat::CornersReadAsSize)),
    ("cxcywh-as-xywh", Some(BoxFormat::CenterReadAsCorner)),
    ("xywh-as-cxcywh", Some(BoxFormat::CornerReadAsCenter)),
    ("xyxy-as-cxcywh", Some(BoxFormat::CornersReadAsCenter)),
];

/// The values of `intrinsics`: what the focal lengths and the principal point of the file are.
const INTRINSICS: [(&str, Correction); 2] =
    [("normalized", Correction::NormalizedIntrinsics), ("transposed", Correction::CenteredPrincipalPoint)];

/// The values of `frame_order`: the order in which detections were given to frames.
const FRAME_ORDERS: [(&str, Correction); 3] = [
    ("alphabetical", Correction::AlphabeticalFrames),
    ("numeric", Correction::NumericFrames),
    ("reversed", Correction::ReversedFrames),
];

/// What follows an orientation whose boxes were fractions of the turned picture.
const OF_FRACTIONS: &str = "-fractions";

/// The value of `box_scale` for boxes that are fractions of the image.
const NORMALIZED: &str = "normalized";

/// A key of `--assume`.
pub struct Key {
    /// Its name.
    pub name: &'static str,
    /// What its values are, in capitals, for the help.
    pub value: &'static str,
    /// What it says about the scene, for the help.
    pub meaning: &'static str,
    /// Reads a value; `None` where it says what holds anyway.
    read: fn(&str) -> Result<Option<RecordCorrection>, String>,
}

/// The keys, as help and errors list them; the corrections themselves know the order in which they are applied.
pub const KEYS: [Key; 12] = [
    Key {
        name: "poses",
        value: "NAME",
        meaning: "convention of the poses if it is not OpenCV's cam_from_world: world-from-camera, opengl, \
                  opengl-world-from-camera, body, left-handed (Unity), camera-center (as translation), transposed-rotation, \
                  quaternion-wxyz, quaternion-xyzw, ...",
        read: |text| known(of_name(&POSES, text)?),
    },
    Key {
        name: "focal",
        value: "F",
        meaning: "factor on the focal lengths",
        read: |text| known(Correction::FocalFactor(positive(text)?)),
    },
    Key {
        name: "intrinsics",
        value: "NAME",
        meaning: "intrinsics that are not pixels: normalized (by width and height), or transposed",
        read: |text| known(of_name(&INTRINSICS, text)?),
    },
    Key {
        name: "distortion",
        value: "K",
        meaning: "radial coefficient (k of COLMAP's SIMPLE_RADIAL) of a lens that the cameras lack",
        read: |text| known(Correction::RadialDistortion(number(Range::Finite, text)?)),
    },
    Key {
        name: "boxes",
        value: "NAME",
        meaning: "format of the boxes if not the corners xyxy: xywh, cxcywh or yxyx; or how they were misread: xyxy-as-xywh, \
                  cxcywh-as-xywh, xywh-as-cxcywh, xyxy-as-cxcywh",
        read: |text| Ok(of_name(&BOXES, text)?.map(|format| RecordCorrection::Known(Correction::Boxes(format)))),
    },
    Key {
        name: "box_scale",
        value: "F",
        meaning: "factor on the pixel coordinates of the boxes; normalized for fractions of the width and height of the image",
        read: |text| {
            known(match text {
                NORMALIZED => Correction::NormalizedBoxes,
                _ => Correction::ImageScale(positive(text).map_err(|error| format!("{error}, or {NORMALIZED}"))?),
            })
        },
    },
    Key {
        name: "letterbox",
        value: "WxH",
        meaning: "size of the letterboxed images in which the boxes were measured, such as 640x640 or 640x384; normalized for fractions of a square one",
        read: |text| {
            Ok(Some(match text {
                NORMALIZED => RecordCorrection::Known(Correction::NormalizedLetterbox),
                _ => letterbox(image_size(text).map_err(|error| format!("{error}, or {NORMALIZED}"))?),
            }))
        },
    },
    Key {
        name: "image_size",
        value: "WxH",
        meaning: "size of the images in which the boxes were measured, if not that of the cameras",
        read: |text| Ok(Some(RecordCorrection::ImageSize(image_size(text)?))),
    },
    Key {
        name: "orientation",
        value: "N",
        meaning: "EXIF orientation of the pictures, 1 to 8, which the detector's boxes follow and the cameras do not: 6 where it \
                  saw them turned by 90 degrees clockwise; such as 6-fractions for fractions of a turned picture (YOLO)",
        read: |text| Ok(orientation(text)?.map(RecordCorrection::Known)),
    },
    Key {
        name: "pose_unit",
        value: "UNIT",
        meaning: "unit of the poses' translations: mm, cm, m, km, in, ft or its length in meters; the scene is converted to meters",
        read: |text| Ok(Some(RecordCorrection::PoseUnit(pose_unit(text)?))),
    },
    Key {
        name: "frame_order",
        value: "ORDER",
        meaning: "order in which the frames were numbered for the detector: alphabetical, numeric or reversed",
        read: |text| known(of_name(&FRAME_ORDERS, text)?),
    },
    Key {
        name: "frame_offset",
        value: "N",
        meaning: "number that the detections give to frame number 0",
        read: |text| Ok(Some(RecordCorrection::FrameOffset(text.parse().map_err(|_| "expected a whole number")?))),
    },
];

/// A key with its value, read from `KEY=VALUE`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Assumption {
    /// The place of the key in [`KEYS`].
    key: usize,
    correction: Option<RecordCorrection>,
}

impl FromStr for Assumption {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (name, value) = text.split_once('=').ok_or("expected KEY=VALUE, such as poses=opengl")?;
        let (name, value) = (name.trim(), value.trim());
        let key = KEYS.iter().position(|key| key.name == name).ok_or_else(|| {
            format!("there is no key \"{name}\"; expected one of {}", KEYS.map(|key| key.name).join(", "))
        })?;
        Ok(Self { key, correction: (KEYS[key].read)(value)? })
    }
}

impl Assumption {
    /// The name of the key.
    pub fn name(&self) -> &'static str {
        KEYS[self.key].name
    }

    /// The corrections of the records, in the order of the keys.
    ///
    /// # Errors
    /// The key that is given twice.
    pub fn corrections(list: &[Self]) -> Result<Vec<RecordCorrection>, String> {
        let mut sorted = list.to_vec();
        sorted.sort_by_key(|assumption| assumption.key);
        match sorted.windows(2).find(|pair| pair[0].key == pair[1].key) {
            Some(pair) => Err(format!("{} is given twice", pair[0].name())),
            None => Ok(sorted.iter().filter_map(|assumption| assumption.correction).collect()),
        }
    }
}

fn known(correction: Correction) -> Result<Option<RecordCorrection>, String> {
    Ok(Some(RecordCorrection::Known(correction)))
}

fn number(range: Range, text: &str) -> Result<f64, String> {
    let kind = Kind::Number(range);
    kind.read(text)?.number().ok_or_else(|| kind.expected())
}

fn positive(text: &str) -> Result<f64, String> {
    number(Range::Positive, text)
}

/// Reads a width and a height in pixels, such as 640x480.
///
/// # Errors
/// The expected value, as text.
pub fn image_size(text: &str) -> Result<[f64; 2], String> {
    let sides = text.split_once('x').and_then(|(w, h)| Some([positive(w).ok()?, positive(h).ok()?]));
    sides.ok_or_else(|| "expected WIDTHxHEIGHT, such as 640x480".to_owned())
}

/// The correction of `letterbox`: boxes were measured in a letterboxed image of this width and height, in pixels.
fn letterbox([width, height]: [f64; 2]) -> RecordCorrection {
    match width == height {
        true => RecordCorrection::Known(Correction::Letterbox(width)),
        false => RecordCorrection::Letterbox([width, height]),
    }
}

/// Reads an EXIF orientation, such as `6` or `6-fractions`; `None` for 1, that of pictures that are not turned.
fn orientation(text: &str) -> Result<Option<Correction>, String> {
    let (number, fractions) = text.strip_suffix(OF_FRACTIONS).map_or((text, false), |number| (number, true));
    match number.parse() {
        Ok(1) => Ok(None),
        Ok(orientation @ 2..=8) => Ok(Some(Correction::TurnedPictures { orientation, fractions })),
        _ => Err(format!(
            "expected an EXIF orientation from 1 to 8, or one with {OF_FRACTIONS}, such as 6{OF_FRACTIONS}"
        )),
    }
}

/// The length of a unit in meters.
fn pose_unit(text: &str) -> Result<f64, String> {
    let length = text.parse().ok().filter(|length: &f64| length.is_finite() && *length > 0.0);
    length.map_or_else(|| of_name(&UNITS, text).map_err(|error| format!("{error}, or a length in meters")), Ok)
}

/// Reads the value of `--up`: an axis such as `-y`, or a direction X,Y,Z.
///
/// # Errors
/// The expected value, as text.
pub fn up(text: &str) -> Result<[f64; 3], String> {
    let (sign, axis) =
        text.strip_prefix('-').map_or((1.0, text.strip_prefix('+').unwrap_or(text)), |axis| (-1.0, axis));
    let place = ["x", "y", "z"].iter().position(|known| *known == axis);
    if let Some(place) = place {
        let mut up = [0.0; 3];
        up[place] = sign;
        return Ok(up);
    }
    let numbers: Option<Vec<f64>> = text.split(',').map(|x| x.trim().parse().ok()).collect();
    match numbers.as_deref() {
        Some(&[x, y, z]) if [x, y, z].iter().all(|x: &f64| x.is_finite()) && [x, y, z] != [0.0; 3] => Ok([x, y, z]),
        _ => Err("expected x, y, z, -x, -y, -z or three numbers X,Y,Z that are not all 0".to_owned()),
    }
}

fn of_name<T: Copy>(table: &[(&str, T)], text: &str) -> Result<T, String> {
    let names: Vec<&str> = table.iter().map(|(name, _)| *name).collect();
    let found = table.iter().find(|(name, _)| *name == text);
    found.map(|(_, value)| *value).ok_or_else(|| format!("expected one of {}", names.join(", ")))
}

fn name_of<T: PartialEq>(table: &[(&'static str, T)], value: &T) -> &'static str {
    table.iter().find(|(_, known)| known == value).map_or("", |(name, _)| name)
}

/// The program option of a correction, such as `--assume poses=opengl`.
///
/// `image_size` is that of all cameras, in pixels, if they have one; image scales are expressed as a size.
/// `frame_offset` is the number that the detections currently give to frame 0.
pub(crate) fn option_of(correction: &Correction, image_size: Option<[f64; 2]>, frame_offset: i64) -> String {
    let (key, value) = match *correction {
        Correction::Up(direction) => return format!("--up {}", axis(direction)),
        Correction::FocalFactor(factor) => ("focal", short(factor)),
        Correction::RadialDistortion(coefficient) => ("distortion", short(coefficient)),
        Correction::NormalizedBoxes => ("box_scale", NORMALIZED.to_owned()),
        Correction::ImageScale(factor) => match RecordCorrection::of(correction, image_size) {
            RecordCorrection::ImageSize([width, height]) => ("image_size", format!("{width}x{height}")),
            _ => ("box_scale", short(factor)),
        },
        Correction::Letterbox(side) => ("letterbox", format!("{0}x{0}", usual_width(side))),
        Correction::NormalizedLetterbox => ("letterbox", NORMALIZED.to_owned()),
        Correction::TurnedPictures { orientation, fractions } => {
            ("orientation", format!("{orientation}{}", if fractions { OF_FRACTIONS } else { "" }))
        }
        Correction::FrameOffset(frames) => ("frame_offset", (frame_offset - i64::from(frames)).to_string()),
        Correction::Boxes(format) => ("boxes", name_of(&BOXES, &Some(format)).to_owned()),
        Correction::NormalizedIntrinsics | Correction::CenteredPrincipalPoint => {
            ("intrinsics", name_of(&INTRINSICS, correction).to_owned())
        }
        Correction::AlphabeticalFrames | Correction::NumericFrames | Correction::ReversedFrames => {
            ("frame_order", name_of(&FRAME_ORDERS, correction).to_owned())
        }
        Correction::Lengths(factor) => {
            let unit = nearest_unit(factor);
            let named = UNITS.iter().find(|(_, length)| *length == unit);
            ("pose_unit", named.map_or_else(|| short(unit), |(name, _)| (*name).to_owned()))
        }
        _ => ("poses", name_of(&POSES, correction).to_owned()),
    };
    format!("--assume {key}={value}")
}

/// A direction as a value of `--up`.
fn axis(direction: [f64; 3]) -> String {
    match direction.iter().position(|x| x.abs() == 1.0) {
        Some(k) => format!("{}{}", if direction[k] < 0.0 { "-" } else { "" }, ["x", "y", "z"][k]),
        None => direction.map(short).join(","),
    }
}

/// A number with four significant digits.
pub(crate) fn short(x: f64) -> String {
    let digits = if x == 0.0 { 0 } else { (3 - x.abs().log10().floor() as i32).clamp(0, 9) };
    let text = format!("{x:.*}", digits as usize);
    if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_owned() } else { text }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lengths_are_those_of_units_or_numbers() {
        assert_eq!(pose_unit("mm"), Ok(1e-3));
        assert_eq!(pose_unit("0.27"), Ok(0.27));
        assert!(pose_unit("-1").unwrap_err().contains("m, cm, mm, km, ft, in, or a length in meters"));
        for (found, meant) in [(0.9, 1.0), (0.0008, 1e-3), (0.033, 0.0254), (0.27, 0.3048), (5.123, 5.1)] {
            assert_eq!(nearest_unit(found), meant);
        }
    }

    fn read(text: &str) -> Result<Vec<RecordCorrection>, String> {
        Assumption::corrections(&text.split(',').map(str::parse).collect::<Result<Vec<_>, _>>()?)
    }

    #[test]
    fn values_name_their_corrections() {
        for (name, correction) in POSES {
            assert_eq!(read(&format!("poses={name}")), Ok(vec![RecordCorrection::Known(correction)]));
            assert_eq!(option_of(&correction, None, 0), format!("--assume poses={name}"));
        }
        for (name, format) in BOXES {
            let correction = format.map(|format| RecordCorrection::Known(Correction::Boxes(format)));
            assert_eq!(read(&format!("boxes={name}")), Ok(Vec::from_iter(correction)));
        }
        let option = |correction: Correction| {
            let option = option_of(&correction, Some([1280.0, 960.0]), 0);
            option.strip_prefix("--assume ").map(ToOwned::to_owned).unwrap_or(option)
        };
        assert_eq!(option(Correction::Boxes(BoxFormat::SwappedAxes)), "boxes=yxyx");
        assert_eq!(option(Correction::NormalizedBoxes), "box_scale=normalized");
        assert_eq!(option(Correction::ImageScale(1.9987)), "image_size=640x480");
        assert_eq!(option(Correction::ImageScale(2.005)), "image_size=640x480");
        assert_eq!(option(Correction::ImageScale(1.97)), "image_size=650x488");
        assert_eq!(option_of(&Correction::ImageScale(2.0), None, 0), "--assume box_scale=2");
        assert_eq!(option(Correction::Letterbox(638.1)), "letterbox=640x640");
        assert_eq!(option(Correction::Letterbox(600.0)), "letterbox=600x600");
        assert_eq!(option(Correction::NormalizedLetterbox), "letterbox=normalized");
        assert_eq!(option(Correction::FrameOffset(2)), "frame_offset=-2");
        assert_eq!(option_of(&Correction::FrameOffset(-1), None, 1), "--assume frame_offset=2");
        assert_eq!(option(Correction::FocalFactor(0.49993)), "focal=0.4999");
        assert_eq!(option(Correction::FocalFactor(12.0)), "focal=12");
        assert_eq!(option(Correction::CenteredPrincipalPoint), "intrinsics=transposed");
        assert_eq!(option(Correction::ReversedFrames), "frame_order=reversed");
        assert_eq!(option(Correction::Up([0.0, -1.0, 0.0])), "--up -y");
        assert_eq!(option(Correction::Up([0.0, 0.6, 0.8])), "--up 0,0.6,0.8");
        assert_eq!(option(Correction::Lengths(0.0011)), "pose_unit=mm");
        assert_eq!(option(Correction::Lengths(0.000234567)), "pose_unit=0.00023");
    }

    #[test]
    fn wrong_keys_and_values_are_told() {
        let error = |text: &str| read(text).unwrap_err();
        assert_eq!(error("opengl"), "expected KEY=VALUE, such as poses=opengl");
        assert!(error("pose=opengl").starts_with("there is no key \"pose\"; expected one of poses, focal, intrinsics"));
        assert!(error("poses=unity").starts_with("expected one of world-from-camera, opengl"));
        assert_eq!(error("focal=0"), "expected a number above 0");
        assert_eq!(error("box_scale=-1"), "expected a number above 0, or normalized");
        assert_eq!(error("distortion=nan"), "expected a finite number");
        assert_eq!(error("letterbox=640"), "expected WIDTHxHEIGHT, such as 640x480, or normalized");
        assert_eq!(error("frame_offset=0.5"), "expected a whole number");
        assert_eq!(error("boxes=xywh,poses=opengl,boxes=xywh"), "boxes is given twice");
    }

    #[test]
    fn the_order_of_the_text_does_not_matter() {
        assert_eq!(read("pose_unit=mm, poses=opengl"), read("poses=opengl,pose_unit=mm"));
        // Numbers of frames may be times.
        for offset in [i64::MIN, -1, 1_700_000_000_000] {
            assert_eq!(read(&format!("frame_offset={offset}")), Ok(vec![RecordCorrection::FrameOffset(offset)]));
        }
    }
}
