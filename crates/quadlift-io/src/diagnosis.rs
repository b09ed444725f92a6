//! The self-check ([`quadlift::diagnosis`]) as text, as the options that correct a mistake, and as JSON.

use quadlift::diagnosis::{Agreement, BoxFormat, Cause, CauseName, Correction, Diagnosis};
use quadlift::run::Check;
use serde_json::{Value, json};

use crate::correct::RecordCorrection;
use crate::correct::options::{option_of, short};
use crate::correct::usual_width;
use crate::scene_file::SceneFile;

/// What is known about a scene file when its mistakes are reported.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Context {
    /// Width and height of the images in pixels, if known and the same for all.
    pub image_size: Option<[f64; 2]>,
    /// Size in pixels of the images in which the boxes were measured, if set by an option.
    measured_size: Option<[f64; 2]>,
    /// Factor on the focal lengths that an option sets; 0 if none does.
    focal_factor: f64,
    /// The number that the detections give to frame 0, see [`crate::read::detections::AddedDetections::frame_offset`].
    pub frame_offset: i64,
}

impl Context {
    /// The context of a scene file.
    pub fn of(file: &SceneFile, frame_offset: i64) -> Self {
        let sizes = file.image_sizes();
        let first = sizes.first().copied().flatten();
        Self { image_size: first.filter(|_| sizes.iter().all(|size| *size == first)), frame_offset, ..Self::default() }
    }

    /// The context after options have corrected the scene; proposed options then replace the given ones.
    #[must_use]
    pub fn after(mut self, corrections: &[RecordCorrection]) -> Self {
        for correction in corrections {
            match *correction {
                RecordCorrection::ImageSize(size) => self.measured_size = Some(size),
                RecordCorrection::Known(Correction::FocalFactor(factor)) => self.focal_factor = factor,
                RecordCorrection::Known(Correction::FrameOffset(n)) => self.frame_offset -= i64::from(n),
                _ => {}
            }
        }
        self
    }

    /// The option that corrects a cause, if there is one.
    pub fn option(&self, cause: &Cause) -> Option<String> {
        match cause.correction {
            Some(Correction::FocalFactor(factor)) if self.focal_factor > 0.0 => {
                Some(option_of(&Correction::FocalFactor(factor * self.focal_factor), None, 0))
            }
            Some(correction) => Some(option_of(&correction, self.measured_size.or(self.image_size), self.frame_offset)),
            None if cause.name == CauseName::ObjectIds => Some("--associate always --ids ignore".to_owned()),
            None => None,
        }
    }

    /// The correction of the scene's records for a cause, if there is one.
    pub fn correction(&self, cause: &Cause) -> Option<RecordCorrection> {
        Some(RecordCorrection::of(&cause.correction?, self.image_size))
    }
}

/// The diagnosis in the format of result files: `{consistent, score, causes: [{name, value, before, after, option}]}`.
/// `score`, `before` and `after` are typical misses ([`Agreement::miss`]); `score` is `null` if nothing could be
/// checked.
pub fn diagnosis_record(diagnosis: &Diagnosis, context: &Context) -> Value {
    json!({
        "consistent": diagnosis.consistent,
        "score": diagnosis.agreement.map(|agreement: Agreement| agreement.miss),
        "causes": diagnosis.causes.iter().map(|cause| cause_record(cause, context)).collect::<Vec<_>>(),
    })
}

/// One cause of a [`diagnosis_record`].
pub fn cause_record(cause: &Cause, context: &Context) -> Value {
    json!({
        "name": cause.name.name(),
        "value": cause.value,
        "before": cause.before.miss,
        "after": cause.after.miss,
        "option": context.option(cause),
    })
}

/// Describes two mistakes that together explain why a scene is inconsistent, with the options that correct them.
pub fn together_in_words([first, second]: &[Cause; 2], context: &Context) -> String {
    let with_option = |cause: &Cause| {
        let option = context.option(cause).map(|option| format!(" ({option})"));
        format!("{}{}", cause_in_words(cause), option.unwrap_or_default())
    };
    format!(
        "two mistakes: {}; {}: {}, {} after both corrections",
        with_option(first),
        with_option(second),
        miss_in_words(first.before),
        percent(second.after.miss)
    )
}

/// A check in the format of result files: [`diagnosis_record`], and two causes that explain the scene together.
pub fn check_record(check: &Check, context: &Context) -> Value {
    let mut record = diagnosis_record(&check.diagnosis, context);
    if let Some(two) = &check.together {
        record["together"] = two.iter().map(|cause| cause_record(cause, context)).collect();
    }
    record
}

/// The problem that a check found and its correction, as text; `None` if there is none.
pub fn check_in_words(check: &Check, context: &Context) -> Option<String> {
    match &check.together {
        Some(two) => Some(together_in_words(two, context)),
        None => diagnosis_in_words(&check.diagnosis, context),
    }
}

/// Describes the problem in a record written by [`diagnosis_record`]; `None` if there is none, or if it is not such a
/// record.
pub fn record_in_words(record: &Value) -> Option<String> {
    if record.get("consistent")?.as_bool()? {
        return None;
    }
    let agreement = |miss: &Value| Some(Agreement { miss: miss.as_f64()?, share: 0.0, boxes: 0 });
    let Some(first) = record.get("causes")?.get(0) else {
        let agreement = agreement(record.get("score")?);
        return diagnosis_in_words(&Diagnosis { consistent: false, agreement, causes: vec![] }, &Context::default());
    };
    let name = first.get("name")?.as_str()?;
    let (before, after) = (agreement(first.get("before")?)?, agreement(first.get("after")?)?);
    let name = CauseName::ALL.into_iter().find(|known| known.name() == name)?;
    let cause = Cause { name, value: first.get("value")?.as_f64(), correction: None, before, after };
    Some(cause_with_evidence(&cause, first.get("option")?.as_str()))
}

/// Describes the problem with its evidence and the option that corrects it; `None` if there is none.
pub fn diagnosis_in_words(diagnosis: &Diagnosis, context: &Context) -> Option<String> {
    let Some(cause) = diagnosis.causes.first() else {
        let agreement = diagnosis.agreement.filter(|_| !diagnosis.consistent)?;
        return Some(format!(
            "the boxes of an object contradict each other: {}; no common mistake explains it",
            miss_in_words(agreement)
        ));
    };
    Some(cause_with_evidence(cause, context.option(cause).as_deref()))
}

/// A cause with the agreement before and after its correction, and the option that applies the correction.
fn cause_with_evidence(cause: &Cause, option: Option<&str>) -> String {
    let mut text = cause_in_words(cause);
    // Boxes do not show the direction of gravity or the unit of length.
    if !matches!(cause.name, CauseName::Up | CauseName::LengthUnit) {
        text.push_str(&format!(": {}", miss_in_words(cause.before)));
    }
    if cause.after.miss < cause.before.miss {
        text.push_str(&format!(", {} after correction", percent(cause.after.miss)));
    }
    if let Some(option) = option {
        text.push_str(&format!(" ({option})"));
    }
    text
}

/// Describes how far boxes miss their object.
fn miss_in_words(agreement: Agreement) -> String {
    format!("boxes miss their object by {}", half_sizes(agreement.miss))
}

fn half_sizes(miss: f64) -> String {
    match miss {
        // Misses are clamped at this value.
        2.5.. => "more than 250 % of their half size".to_owned(),
        _ => format!("{} of their half size", percent(miss)),
    }
}

/// A share as a percentage with two digits.
fn percent(share: f64) -> String {
    if share < 0.095 { format!("{:.1} %", 100.0 * share) } else { format!("{:.0} %", 100.0 * share) }
}

/// Describes a cause.
pub fn cause_in_words(cause: &Cause) -> String {
    let value = |digits: usize| cause.value.map_or(String::new(), |x| format!("{x:.digits$}"));
    match cause.name {
        CauseName::CameraToWorld => "the poses are camera-to-world, not cam_from_world".to_owned(),
        CauseName::OpenGlAxes => "the cameras have OpenGL axes (y up, z backwards), not OpenCV's".to_owned(),
        CauseName::OpenGlCameraToWorld => {
            "the poses are camera-to-world with OpenGL axes, as nerfstudio and Blender write them".to_owned()
        }
        CauseName::BodyAxes => "the camera axes are a robot's body axes (x forward, y left, z up)".to_owned(),
        CauseName::BodyToWorld => {
            "the poses are body-to-world with a robot's body axes (x forward, y left, z up)".to_owned()
        }
        CauseName::LeftHandedAxes => "the axes are left-handed, as in Unity".to_owned(),
        CauseName::LeftHandedCameraToWorld => {
            "the poses are camera-to-world with left-handed axes, as in Unity".to_owned()
        }
        CauseName::CenterAsTranslation => {
            "the translations are camera centres, not the translations of cam_from_world".to_owned()
        }
        CauseName::TransposedRotation => "the rotations of the poses are transposed".to_owned(),
        CauseName::QuaternionOrder => {
            "the quaternions were read in the wrong order (xyzw instead of wxyz, or the reverse)".to_owned()
        }
        CauseName::FocalLength => format!("the focal length is wrong: it should be {} times as long", value(3)),
        CauseName::NormalizedIntrinsics => {
            "the intrinsics are normalised (fractions of image width and height), not in pixels".to_owned()
        }
        CauseName::PrincipalPoint => {
            "the principal point is far from the image centre, as if K had been read transposed".to_owned()
        }
        CauseName::MissingDistortion => {
            format!("the lens distortion is missing: the radial coefficient is about {}", value(3))
        }
        CauseName::ImageSize => {
            format!("the boxes were measured at another image size: multiply their coordinates by {}", value(3))
        }
        CauseName::Letterbox => {
            let side = cause.value.map_or(0.0, usual_width);
            format!("the boxes were measured in a letterboxed image of {side} x {side} pixels")
        }
        CauseName::NormalizedBoxes => {
            "the boxes are normalised (fractions of image width and height), not in pixels".to_owned()
        }
        CauseName::BoxFormat => format!("the box coordinates are not x0, y0, x1, y1: {}", box_format(cause)),
        CauseName::SwappedXy => "x and y of the boxes are swapped".to_owned(),
        CauseName::FrameOffset => frame_offset(cause.value.unwrap_or_default()),
        CauseName::FrameOrder => "the detections and the poses are in different frame orders".to_owned(),
        CauseName::ObjectIds => "the object ids switch between objects".to_owned(),
        CauseName::DuplicatePoses => {
            let share = cause.value.unwrap_or_default();
            format!("{:.0} % of the frames repeat the pose of another frame but show different boxes", 100.0 * share)
        }
        CauseName::ScaleJump => {
            format!("the scale of the trajectory changes: the later part should be {} times as large", value(2))
        }
        CauseName::Up => "\"up\" is not the direction in which the cameras are upright".to_owned(),
        CauseName::LengthUnit => format!(
            "the lengths contradict the known object sizes: they should be {} times as long",
            cause.value.map_or_else(String::new, short)
        ),
        other => other.name().replace('_', " "),
    }
}

fn box_format(cause: &Cause) -> &'static str {
    let Some(Correction::Boxes(format)) = cause.correction else { return "they are in a different order" };
    match format {
        BoxFormat::SizeReadAsCorners => "they are x, y, width, height",
        BoxFormat::CenterSizeReadAsCorners => "they are centre x, centre y, width, height",
        BoxFormat::CornersReadAsSize => "two corners were read as a corner and a size",
        BoxFormat::CenterReadAsCorner => "centre and size were read as corner and size",
        BoxFormat::CornerReadAsCenter => "corner and size were read as centre and size",
        BoxFormat::SwappedAxes => "they are y0, x0, y1, x1",
    }
}

fn frame_offset(frames: f64) -> String {
    let (n, way) = (frames.abs(), if frames > 0.0 { "earlier" } else { "later" });
    let frames = if n == 1.0 { "1 frame".to_owned() } else { format!("{n} frames") };
    format!("the frame order is off by {frames}: the detections are assigned to frames {frames} {way} than their own")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cause(correction: Correction) -> Cause {
        let miss = |miss: f64| Agreement { miss, share: 0.5, boxes: 100 };
        Cause {
            name: correction.cause(),
            value: correction.value(),
            correction: Some(correction),
            before: miss(0.8),
            after: miss(0.021),
        }
    }

    #[test]
    fn causes_are_named_with_evidence_and_option() {
        let context = Context { image_size: Some([1280.0, 960.0]), ..Default::default() };
        let text = |correction: Correction| {
            let diagnosis = Diagnosis { consistent: false, agreement: None, causes: vec![cause(correction)] };
            diagnosis_in_words(&diagnosis, &context).unwrap()
        };
        assert_eq!(
            text(Correction::InvertPoses),
            "the poses are camera-to-world, not cam_from_world: boxes miss their object by 80 % of their half size, \
             2.1 % after correction (--pose-convention world-from-camera)"
        );
        for (correction, words) in [
            (Correction::OpenGlAxes, "OpenGL axes"),
            (Correction::ImageScale(2.0), "image size"),
            (Correction::Letterbox(640.0), "letterboxed image of 640 x 640"),
            (Correction::FocalFactor(0.5), "focal length is wrong: it should be 0.500 times"),
            (Correction::FrameOffset(-2), "frame order is off by 2 frames"),
            (Correction::NumericFrames, "frame order"),
            (Correction::NormalizedBoxes, "boxes are normalised"),
            (Correction::NormalizedIntrinsics, "intrinsics are normalised"),
            (Correction::Boxes(BoxFormat::SizeReadAsCorners), "x, y, width, height"),
        ] {
            assert!(text(correction).contains(words), "{}", text(correction));
        }
    }

    #[test]
    fn proposals_take_the_place_of_options_that_were_given() {
        let context = Context { image_size: Some([1280.0, 960.0]), ..Default::default() };
        let context = context.after(&[
            RecordCorrection::ImageSize([620.0, 465.0]),
            RecordCorrection::Known(Correction::FocalFactor(2.0)),
            RecordCorrection::Known(Correction::FrameOffset(-1)),
        ]);
        let option = |correction: Correction| context.option(&cause(correction)).unwrap();
        assert_eq!(option(Correction::ImageScale(0.96875)), "--image-size 640x480");
        assert_eq!(option(Correction::FocalFactor(0.75)), "--focal-factor 1.5");
        assert_eq!(option(Correction::FrameOffset(-1)), "--frame-offset 2");
    }

    #[test]
    fn every_cause_has_its_words() {
        for name in CauseName::ALL {
            let words = cause_in_words(&Cause { name, ..cause(Correction::InvertPoses) });
            assert!(words.len() > 15 && words != name.name().replace('_', " "), "{words}");
        }
        let agreement = Agreement { miss: 0.7, share: 0.1, boxes: 9 };
        let unknown = Diagnosis { consistent: false, agreement: Some(agreement), causes: Vec::new() };
        assert!(
            diagnosis_in_words(&unknown, &Context::default()).unwrap().contains("70 % of their half size; no common")
        );
        assert_eq!(diagnosis_in_words(&Diagnosis::default(), &Context::default()), None);
    }
}
