//! The names of corrections on the command line and in Python, and the options for them.

use quadlift::diagnosis::{BoxFormat, Correction};

use super::record_correction::RecordCorrection;
use super::rounding::{UNITS, nearest_unit, usual_width};

/// The values of `--pose-convention`: what the poses of the file are.
pub const POSE_CONVENTIONS: [(&str, Correction); 13] = [
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

/// The values of `--box-format`: what the four numbers of a box are.
pub const BOX_FORMATS: [(&str, Option<BoxFormat>); 7] = [
    ("xyxy", None),
    ("xywh", Some(BoxFormat::SizeReadAsCorners)),
    ("cxcywh", Some(BoxFormat::CenterSizeReadAsCorners)),
    ("yxyx", Some(BoxFormat::SwappedAxes)),
    ("xyxy-as-xywh", Some(BoxFormat::CornersReadAsSize)),
    ("cxcywh-as-xywh", Some(BoxFormat::CenterReadAsCorner)),
    ("xywh-as-cxcywh", Some(BoxFormat::CornerReadAsCenter)),
];

/// The values of `--intrinsics-format`: what the focal lengths and the principal point of the file are.
pub const INTRINSICS_FORMATS: [(&str, Correction); 2] =
    [("normalized", Correction::NormalizedIntrinsics), ("transposed", Correction::CenteredPrincipalPoint)];

/// The values of `--frame-order`: the order in which detections were given to frames.
pub const FRAME_ORDERS: [(&str, Correction); 3] = [
    ("alphabetical", Correction::AlphabeticalFrames),
    ("numeric", Correction::NumericFrames),
    ("reversed", Correction::ReversedFrames),
];

/// Reads the value of `--pose-convention`.
///
/// # Errors
/// The known names, as text.
pub fn pose_convention(text: &str) -> Result<Correction, String> {
    of_name(&POSE_CONVENTIONS, text)
}

/// Reads the value of `--box-format`; `None` for corners, which scene files have.
///
/// # Errors
/// The known names, as text.
pub fn box_format(text: &str) -> Result<Option<Correction>, String> {
    Ok(of_name(&BOX_FORMATS, text)?.map(Correction::Boxes))
}

/// Reads the value of `--intrinsics-format`.
///
/// # Errors
/// The known names, as text.
pub fn intrinsics_format(text: &str) -> Result<Correction, String> {
    of_name(&INTRINSICS_FORMATS, text)
}

/// Reads the value of `--frame-order`.
///
/// # Errors
/// The known names, as text.
pub fn frame_order(text: &str) -> Result<Correction, String> {
    of_name(&FRAME_ORDERS, text)
}

/// The correction of `--letterbox`: boxes were measured in a letterboxed image of this width and height, in pixels.
pub fn letterbox([width, height]: [f64; 2]) -> RecordCorrection {
    match width == height {
        true => RecordCorrection::Known(Correction::Letterbox(width)),
        false => RecordCorrection::Letterbox([width, height]),
    }
}

impl RecordCorrection {
    /// The correction of a program option, by its name without dashes (`pose-convention`) and its value, which is empty
    /// for a flag.
    ///
    /// # Errors
    /// The expected value, as text.
    pub fn from_option(name: &str, value: &str) -> Result<Option<Self>, String> {
        let finite = || value.trim().parse().ok().filter(|x: &f64| x.is_finite()).ok_or("expected a finite number");
        let positive = || finite().ok().filter(|x| *x > 0.0).ok_or("expected a number above 0");
        let size = || {
            let size = value.split_once('x').and_then(|(w, h)| Some([w.trim().parse().ok()?, h.trim().parse().ok()?]));
            let positive = |size: &[f64; 2]| size.iter().all(|x| x.is_finite() && *x > 0.0);
            size.filter(positive).ok_or("expected WIDTHxHEIGHT, such as 640x480")
        };
        let known = match name {
            "pose-convention" => pose_convention(value)?,
            "focal-factor" => Correction::FocalFactor(positive()?),
            "intrinsics-format" => intrinsics_format(value)?,
            "radial-distortion" => Correction::RadialDistortion(finite()?),
            "box-format" => match box_format(value)? {
                Some(correction) => correction,
                None => return Ok(None),
            },
            "normalized-boxes" => Correction::NormalizedBoxes,
            "box-scale" => Correction::ImageScale(positive()?),
            "frame-offset" => {
                let offset: i32 = value.trim().parse().map_err(|_| "expected a whole number")?;
                Correction::FrameOffset(-offset)
            }
            "frame-order" => frame_order(value)?,
            "letterbox" => return Ok(Some(letterbox(size()?))),
            "image-size" => return Ok(Some(Self::ImageSize(size()?))),
            "pose-unit" => return Ok(Some(Self::PoseUnit(pose_unit(value)?))),
            "up" => Correction::Up(up(value)?),
            _ => return Err(format!("there is no correction \"{name}\"")),
        };
        Ok(Some(Self::Known(known)))
    }
}

/// Reads the value of `--pose-unit`: the length of the unit in metres.
///
/// # Errors
/// The expected value, as text.
pub fn pose_unit(text: &str) -> Result<f64, String> {
    let length = text.parse().ok().filter(|length: &f64| length.is_finite() && *length > 0.0);
    length.map_or_else(|| of_name(&UNITS, text).map_err(|error| format!("{error}, or a length in metres")), Ok)
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

/// The program option of a correction, such as `--pose-convention opengl`.
///
/// `image_size` is that of all cameras, in pixels, if they have one; image scales are expressed as a size.
/// `frame_offset` is the number that the detections currently give to frame 0.
pub fn option_of(correction: &Correction, image_size: Option<[f64; 2]>, frame_offset: i64) -> String {
    match *correction {
        Correction::FocalFactor(factor) => format!("--focal-factor {}", short(factor)),
        Correction::RadialDistortion(coefficient) => format!("--radial-distortion {}", short(coefficient)),
        Correction::NormalizedBoxes => "--normalized-boxes".to_owned(),
        Correction::ImageScale(factor) => match RecordCorrection::of(correction, image_size) {
            RecordCorrection::ImageSize([width, height]) => format!("--image-size {width}x{height}"),
            _ => format!("--box-scale {}", short(factor)),
        },
        Correction::Letterbox(side) => format!("--letterbox {0}x{0}", usual_width(side)),
        Correction::FrameOffset(frames) => format!("--frame-offset {}", frame_offset - i64::from(frames)),
        Correction::Boxes(format) => format!("--box-format {}", name_of(&BOX_FORMATS, &Some(format))),
        Correction::NormalizedIntrinsics | Correction::CenteredPrincipalPoint => {
            format!("--intrinsics-format {}", name_of(&INTRINSICS_FORMATS, correction))
        }
        Correction::AlphabeticalFrames | Correction::NumericFrames | Correction::ReversedFrames => {
            format!("--frame-order {}", name_of(&FRAME_ORDERS, correction))
        }
        Correction::Up(direction) => {
            let axis = direction.iter().position(|x| x.abs() == 1.0);
            match axis {
                Some(k) => format!("--up {}{}", if direction[k] < 0.0 { "-" } else { "" }, ["x", "y", "z"][k]),
                None => format!("--up {}", direction.map(short).join(",")),
            }
        }
        Correction::Lengths(factor) => {
            let unit = nearest_unit(factor);
            let named = UNITS.iter().find(|(_, length)| *length == unit);
            format!("--pose-unit {}", named.map_or_else(|| short(unit), |(name, _)| (*name).to_owned()))
        }
        _ => format!("--pose-convention {}", name_of(&POSE_CONVENTIONS, correction)),
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
        assert!(pose_unit("-1").unwrap_err().contains("m, cm, mm, km, ft, in, or a length in metres"));
        for (found, meant) in [(0.9, 1.0), (0.0008, 1e-3), (0.033, 0.0254), (0.27, 0.3048), (5.123, 5.1)] {
            assert_eq!(nearest_unit(found), meant);
        }
    }

    #[test]
    fn options_name_their_corrections() {
        for (name, correction) in POSE_CONVENTIONS {
            assert_eq!(pose_convention(name), Ok(correction));
            assert_eq!(option_of(&correction, None, 0), format!("--pose-convention {name}"));
        }
        for (name, format) in BOX_FORMATS {
            assert_eq!(box_format(name), Ok(format.map(Correction::Boxes)));
        }
        assert!(pose_convention("unity").unwrap_err().starts_with("expected one of world-from-camera, opengl"));
        let option = |correction: Correction| option_of(&correction, Some([1280.0, 960.0]), 0);
        assert_eq!(option(Correction::Boxes(BoxFormat::SwappedAxes)), "--box-format yxyx");
        assert_eq!(option(Correction::ImageScale(1.9987)), "--image-size 640x480");
        assert_eq!(option(Correction::ImageScale(2.005)), "--image-size 640x480");
        assert_eq!(option(Correction::ImageScale(1.97)), "--image-size 650x488");
        assert_eq!(option_of(&Correction::ImageScale(2.0), None, 0), "--box-scale 2");
        assert_eq!(option(Correction::Letterbox(638.1)), "--letterbox 640x640");
        assert_eq!(option(Correction::Letterbox(600.0)), "--letterbox 600x600");
        assert_eq!(option(Correction::FrameOffset(2)), "--frame-offset -2");
        assert_eq!(option_of(&Correction::FrameOffset(-1), None, 1), "--frame-offset 2");
        assert_eq!(option(Correction::FocalFactor(0.49993)), "--focal-factor 0.4999");
        assert_eq!(option(Correction::FocalFactor(12.0)), "--focal-factor 12");
        assert_eq!(option(Correction::CenteredPrincipalPoint), "--intrinsics-format transposed");
        assert_eq!(option(Correction::ReversedFrames), "--frame-order reversed");
        assert_eq!(option(Correction::Up([0.0, -1.0, 0.0])), "--up -y");
        assert_eq!(option(Correction::Up([0.0, 0.6, 0.8])), "--up 0,0.6,0.8");
        assert_eq!(option(Correction::Lengths(0.0011)), "--pose-unit mm");
        assert_eq!(option(Correction::Lengths(0.000234567)), "--pose-unit 0.00023");
    }
}
