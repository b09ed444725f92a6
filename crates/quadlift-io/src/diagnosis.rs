//! The consistency check ([`quadlift::diagnosis`]) as text, as the options that correct a mistake, and as a record.

use std::collections::BTreeMap;

use quadlift::diagnosis::{BoxFormat, Cause, CauseName, Correction, PixelMap};
use quadlift::run::Check;
use serde::{Deserialize, Serialize};

use crate::correct::RecordCorrection;
use crate::correct::assume::{option_of, short};
use crate::correct::usual_width;
use crate::scene_file::SceneFile;
use crate::wording::{count, some_of};

/// What is known about a scene file when its mistakes are reported.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Context {
    /// Width and height of the images in pixels, if known and the same for all.
    pub image_size: Option<[f64; 2]>,
    /// Size in pixels of the images in which the boxes were measured, if set by an option.
    measured_size: Option<[f64; 2]>,
    /// EXIF orientation of the pictures that an option sets.
    orientation: Option<u8>,
    /// Factor on the focal lengths that an option sets; 0 if none does.
    focal_factor: f64,
    /// Whether the scene is of several fixed cameras, whose frames repeat their poses on purpose.
    has_fixed_cameras: bool,
    /// The number that the detections give to frame 0, see [`crate::read::detections::AddedDetections::frame_offset`].
    pub frame_offset: i64,
}

impl Context {
    /// The context of a scene file.
    pub(crate) fn of(file: &SceneFile, frame_offset: i64) -> Self {
        let sizes = file.image_sizes();
        let first = sizes.first().copied().flatten();
        Self {
            image_size: first.filter(|_| sizes.iter().all(|size| *size == first)),
            has_fixed_cameras: has_fixed_cameras(file),
            frame_offset,
            ..Self::default()
        }
    }

    /// The context after options have corrected the scene; proposed options then replace the given ones.
    #[must_use]
    pub fn after(mut self, corrections: &[RecordCorrection]) -> Self {
        for correction in corrections {
            match *correction {
                RecordCorrection::ImageSize(size) => self.measured_size = Some(size),
                RecordCorrection::Known(Correction::FocalFactor(factor)) => self.focal_factor = factor,
                RecordCorrection::Known(Correction::TurnedPictures { orientation, .. }) => {
                    self.orientation = Some(orientation);
                }
                RecordCorrection::Known(Correction::FrameOffset(n)) => self.frame_offset -= i64::from(n),
                RecordCorrection::FrameOffset(offset) => self.frame_offset = self.frame_offset.saturating_add(offset),
                _ => {}
            }
        }
        self
    }

    /// The option that corrects a cause, if there is one.
    pub(crate) fn option(&self, cause: &Cause) -> Option<String> {
        match cause.correction {
            Some(Correction::FocalFactor(factor)) if self.focal_factor > 0.0 => {
                Some(option_of(&Correction::FocalFactor(factor * self.focal_factor), None, 0))
            }
            Some(Correction::TurnedPictures { orientation, fractions }) if self.orientation.is_some() => {
                let orientation = turned_twice(self.orientation.unwrap_or_default(), orientation);
                Some(option_of(&Correction::TurnedPictures { orientation, fractions }, None, 0))
            }
            Some(correction) => Some(option_of(&correction, self.measured_size.or(self.image_size), self.frame_offset)),
            None if cause.name == CauseName::ObjectIds => Some("--associate always --ids ignore".to_owned()),
            None => None,
        }
    }

    /// The correction of the scene's records for a cause, if there is one.
    pub(crate) fn correction(&self, cause: &Cause) -> Option<RecordCorrection> {
        Some(RecordCorrection::of(&cause.correction?, self.image_size))
    }
}

/// Whether there are several cameras, each with one pose in two frames or more.
fn has_fixed_cameras(file: &SceneFile) -> bool {
    let mut cameras: BTreeMap<&str, (usize, _)> = BTreeMap::new();
    for frame in &file.frames {
        let (Some(camera), Some(pose)) = (frame.camera.as_deref(), &frame.cam_from_world) else { return false };
        let (frames, first) = cameras.entry(camera).or_insert((0, pose));
        if *first != pose {
            return false;
        }
        *frames += 1;
    }
    cameras.len() > 1 && cameras.values().all(|(frames, _)| *frames > 1)
}

/// The EXIF orientation of pictures that still are turned by the second one after the first was undone; 1 if they are not.
fn turned_twice(first: u8, second: u8) -> u8 {
    let unit = |orientation: u8| PixelMap::from_shown(orientation, [1.0, 1.0].into(), false);
    let both = unit(first).then(&unit(second));
    (2..=8).find(|&orientation| unit(orientation) == both).unwrap_or(1)
}

/// The consistency check in a result file. Reprojection errors are typical ones ([`quadlift::diagnosis::Agreement::miss`]).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct DiagnosisRecord {
    /// The causes, the best first.
    #[serde(default)]
    pub causes: Vec<CauseRecord>,
    /// Whether boxes and poses agree.
    pub consistent: bool,
    /// The miss; `None` if nothing could be checked.
    pub score: Option<f64>,
    /// Two causes that together explain what none explains alone.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub together: Vec<CauseRecord>,
}

/// A cause in a [`DiagnosisRecord`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CauseRecord {
    /// The miss after the correction.
    pub after: f64,
    /// The miss before the correction.
    pub before: f64,
    /// The mistake.
    pub name: CauseName,
    /// The option that corrects it.
    pub option: Option<String>,
    /// Its parameter.
    pub value: Option<f64>,
    /// The ids of the frames that have the mistake; empty if all have it.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub frames: Vec<String>,
    /// The correction, which files do not hold.
    #[serde(skip)]
    pub correction: Option<Correction>,
    /// Whether the cameras are fixed, which files do not hold.
    #[serde(skip)]
    has_fixed_cameras: bool,
}

impl DiagnosisRecord {
    /// The record of a check.
    pub fn of(check: &Check, context: &Context) -> Self {
        let records = |causes: &[Cause]| causes.iter().map(|cause| CauseRecord::of(cause, context)).collect();
        Self {
            causes: records(&check.diagnosis.causes),
            consistent: check.diagnosis.consistent,
            score: check.diagnosis.agreement.map(|agreement| agreement.miss),
            together: check.together.as_ref().map_or_else(Vec::new, |two| records(two)),
        }
    }

    /// The same for commands that have no options to correct the input.
    fn without_options(mut self) -> Self {
        self.causes.iter_mut().chain(&mut self.together).for_each(|cause| cause.option = None);
        self
    }

    /// [`Self::in_words`] of the map of a stream, which is inconsistent, too, where nothing agrees, and whose commands have no options
    /// to correct it.
    pub fn of_map_in_words(&self) -> Option<String> {
        let words = self.clone().without_options().in_words();
        words.or_else(|| (!self.consistent).then(|| "no boxes of different frames agree on an object".to_owned()))
    }

    /// The problem with its evidence and the options that correct it; `None` if there is none.
    pub fn in_words(&self) -> Option<String> {
        match (&self.together[..], self.causes.first()) {
            ([first, second], _) => {
                // One key of --assume cannot say both.
                let key = |cause: &CauseRecord| cause.option.as_ref()?.split_once('=').map(|(key, _)| key.to_owned());
                let (names, fix) = match key(first).is_some() && key(first) == key(second) {
                    true => ([first.mistake(), second.mistake()], " (--fix)"),
                    false => ([first.with_option(), second.with_option()], ""),
                };
                let (before, after) = (miss_in_words(first.before), percent(second.after));
                Some(format!("two mistakes: {}: {before}, {after} after both corrections{fix}", names.join("; ")))
            }
            (_, Some(cause)) => Some(cause.with_evidence()),
            (_, None) => {
                let miss = self.score.filter(|_| !self.consistent)?;
                Some(format!(
                    "the boxes of an object contradict each other: {}; no common mistake explains it",
                    miss_in_words(miss)
                ))
            }
        }
    }
}

impl CauseRecord {
    fn of(cause: &Cause, context: &Context) -> Self {
        Self {
            after: cause.after.miss,
            before: cause.before.miss,
            name: cause.name,
            option: context.option(cause),
            value: cause.value,
            frames: cause.frames.clone(),
            correction: cause.correction,
            has_fixed_cameras: context.has_fixed_cameras,
        }
    }

    /// The mistake with the option that corrects it.
    fn with_option(&self) -> String {
        let option = self.option.as_ref().map_or_else(String::new, |option| format!(" ({option})"));
        self.mistake() + &option
    }

    /// Whether boxes move although the cameras do not.
    fn is_of_moving_objects(&self) -> bool {
        self.name == CauseName::DuplicatePoses && self.has_fixed_cameras
    }

    fn mistake(&self) -> String {
        if self.is_of_moving_objects() {
            return "the objects move: the cameras are fixed and the boxes are not; objects must be static".to_owned();
        }
        let mistake = mistake_in_words(self.name, self.value, self.correction);
        if self.frames.is_empty() {
            return mistake;
        }
        if self.name == CauseName::CameraOffset {
            return format!("{mistake} ({})", some_of(&self.frames));
        }
        let share = 100.0 * self.value.unwrap_or_default();
        format!("in {:.0} % of the frames ({}) {mistake}", share, some_of(&self.frames))
    }

    /// The same with the agreement before and after the correction.
    fn with_evidence(&self) -> String {
        let mut text = self.mistake();
        // Boxes do not show the direction of gravity or the unit of length, and the others say how far the boxes are off.
        let says_it = matches!(
            self.name,
            CauseName::Up
                | CauseName::LengthUnit
                | CauseName::EdgeNoise
                | CauseName::HeldOutViews
                | CauseName::Outlines
                | CauseName::Depths
                | CauseName::Boxes3d
        ) || !self.frames.is_empty()
            || self.is_of_moving_objects();
        if !says_it {
            text.push_str(&format!(": {}", miss_in_words(self.before)));
            if self.after < self.before {
                text.push_str(&format!(", {} after correction", percent(self.after)));
            }
        }
        if let Some(option) = &self.option {
            text.push_str(&format!(" ({option})"));
        }
        text
    }
}

/// Describes how far boxes miss their object.
fn miss_in_words(miss: f64) -> String {
    format!("boxes miss their object by {}", half_sizes(miss))
}

fn half_sizes(miss: f64) -> String {
    match miss {
        // Reprojection errors are clamped at this value.
        2.5.. => "more than 250 % of their half size".to_owned(),
        _ => format!("{} of their half size", percent(miss)),
    }
}

/// A share as a percentage with two digits.
fn percent(share: f64) -> String {
    if share < 0.095 { format!("{:.1} %", 100.0 * share) } else { format!("{:.0} %", 100.0 * share) }
}

/// Describes a mistake with its parameter; the correction tells the formats of boxes apart.
pub fn mistake_in_words(name: CauseName, parameter: Option<f64>, correction: Option<Correction>) -> String {
    let value = |digits: usize| parameter.map_or(String::new(), |x| format!("{x:.digits$}"));
    match name {
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
            "the translations are camera centers, not the translations of cam_from_world".to_owned()
        }
        CauseName::TransposedRotation => "the rotations of the poses are transposed".to_owned(),
        CauseName::QuaternionOrder => {
            "the quaternions were read in the wrong order (xyzw instead of wxyz, or the reverse)".to_owned()
        }
        CauseName::FocalLength => format!("the focal length is wrong: it should be {} times as long", value(3)),
        CauseName::NormalizedIntrinsics => {
            "the intrinsics are normalized (fractions of image width and height), not in pixels".to_owned()
        }
        CauseName::PrincipalPoint => {
            "the principal point is far from the image center, as if K had been read transposed".to_owned()
        }
        CauseName::MissingDistortion => {
            format!("the lens distortion is missing: the radial coefficient is about {}", value(3))
        }
        CauseName::ImageSize => {
            format!("the boxes were measured at another image size: multiply their coordinates by {}", value(3))
        }
        CauseName::Letterbox => match parameter.map(usual_width) {
            Some(side) => format!("the boxes were measured in a letterboxed image of {side} x {side} pixels"),
            None => "the boxes are fractions of a letterboxed square image, not of the camera's".to_owned(),
        },
        CauseName::NormalizedBoxes => {
            "the boxes are normalized (fractions of image width and height), not in pixels".to_owned()
        }
        CauseName::BoxFormat => format!("the box coordinates are not x0, y0, x1, y1: {}", box_format(correction)),
        CauseName::SwappedXy => "x and y of the boxes are swapped".to_owned(),
        CauseName::FrameOffset => frame_offset(parameter.unwrap_or_default()),
        CauseName::FrameOrder => "the detections and the poses are in different frame orders".to_owned(),
        CauseName::ObjectIds => "the object ids switch between objects".to_owned(),
        CauseName::PictureOrientation => {
            let turn = match parameter.unwrap_or_default() as u8 {
                2 => "mirrored",
                3 => "turned by 180 degrees",
                4 => "mirrored top to bottom",
                5 => "mirrored along the diagonal",
                6 => "turned by 90 degrees clockwise",
                7 => "mirrored along the other diagonal",
                _ => "turned by 90 degrees counterclockwise",
            };
            format!(
                "the boxes were measured in pictures that are {turn} against the cameras', as by their EXIF orientation"
            )
        }
        CauseName::CameraOffset => camera_offset(parameter.unwrap_or_default()),
        CauseName::ContradictingFrames => "the boxes contradict those of the other frames: correct the poses of these frames, or leave them out".to_owned(),
        CauseName::EdgeNoise => format!(
            "the objects do not explain the boxes: their edges are off by {:.0} % of the half size; poses, boxes, depths or ids contradict \
             each other, and no common mistake explains it",
            100.0 * parameter.unwrap_or_default()
        ),
        CauseName::HeldOutViews => format!(
            "boxes are not where the other views predict them: their IoU is {} on average, with right poses, boxes and ids about 0.9",
            value(2)
        ),
        CauseName::Outlines => {
            "the outlines contradict the boxes and were left out: pixels of another image size, y before x, or fractions?".to_owned()
        }
        CauseName::Depths => {
            "the depths contradict the boxes and were left out: another unit, or distances of another frame?".to_owned()
        }
        CauseName::Boxes3d => "the 3D boxes contradict the boxes and were left out: in the world's frame instead of the camera's, another \
             unit, or angles in degrees?"
            .to_owned(),
        CauseName::DuplicatePoses => {
            let share = parameter.unwrap_or_default();
            format!("{:.0} % of the frames repeat the pose of another frame but show different boxes", 100.0 * share)
        }
        CauseName::ScaleJump => {
            format!("the scale of the trajectory changes: the later part should be {} times as large", value(2))
        }
        CauseName::Up => "\"up\" is not the direction in which the cameras are upright".to_owned(),
        CauseName::LengthUnit => format!(
            "the lengths contradict the known object sizes: they should be {} times as long",
            parameter.map_or_else(String::new, short)
        ),
        other => other.name().replace('_', " "),
    }
}

fn box_format(correction: Option<Correction>) -> &'static str {
    let Some(Correction::Boxes(format)) = correction else { return "they are in a different order" };
    match format {
        BoxFormat::SizeReadAsCorners => "they are x, y, width, height",
        BoxFormat::CenterSizeReadAsCorners => "they are center x, center y, width, height",
        BoxFormat::CornersReadAsSize => "two corners were read as a corner and a size",
        BoxFormat::CenterReadAsCorner => "center and size were read as corner and size",
        BoxFormat::CornerReadAsCenter => "corner and size were read as center and size",
        BoxFormat::CornersReadAsCenter => "two corners were read as a center and a size",
        BoxFormat::SwappedAxes => "they are y0, x0, y1, x1",
    }
}

fn camera_offset(steps: f64) -> String {
    let (n, way) = of_own(steps, "time step");
    format!("the detections of one camera of the rig are assigned to frames {n} {way} than their own")
}

/// How much earlier or later detections are assigned than where they belong.
fn of_own(offset: f64, thing: &str) -> (String, &'static str) {
    (count(offset.abs() as usize, thing), if offset > 0.0 { "earlier" } else { "later" })
}

fn frame_offset(frames: f64) -> String {
    let (frames, way) = of_own(frames, "frame");
    format!("the frame order is off by {frames}: the detections are assigned to frames {frames} {way} than their own")
}

#[cfg(test)]
mod tests {
    use super::*;
    use quadlift::diagnosis::{Agreement, Diagnosis};

    fn cause(correction: Correction) -> Cause {
        let miss = |miss: f64| Agreement { miss, share: 0.5, boxes: 100 };
        Cause {
            name: correction.cause(),
            value: correction.value(),
            correction: Some(correction),
            frames: Vec::new(),
            before: miss(0.8),
            after: miss(0.021),
        }
    }

    fn in_words(diagnosis: Diagnosis, context: &Context) -> Option<String> {
        DiagnosisRecord::of(&Check { diagnosis, ..Check::default() }, context).in_words()
    }

    #[test]
    fn causes_are_named_with_evidence_and_option() {
        let context = Context { image_size: Some([1280.0, 960.0]), ..Default::default() };
        let text = |correction: Correction| {
            let diagnosis = Diagnosis { consistent: false, agreement: None, causes: vec![cause(correction)] };
            in_words(diagnosis, &context).unwrap()
        };
        assert_eq!(
            text(Correction::InvertPoses),
            "the poses are camera-to-world, not cam_from_world: boxes miss their object by 80 % of their half size, \
             2.1 % after correction (--assume poses=world-from-camera)"
        );
        for (correction, words) in [
            (Correction::OpenGlAxes, "OpenGL axes"),
            (Correction::ImageScale(2.0), "image size"),
            (Correction::Letterbox(640.0), "letterboxed image of 640 x 640"),
            (Correction::NormalizedLetterbox, "fractions of a letterboxed square image"),
            (Correction::FocalFactor(0.5), "focal length is wrong: it should be 0.500 times"),
            (Correction::FrameOffset(-2), "frame order is off by 2 frames"),
            (Correction::NumericFrames, "frame order"),
            (Correction::NormalizedBoxes, "boxes are normalized"),
            (Correction::NormalizedIntrinsics, "intrinsics are normalized"),
            (Correction::Boxes(BoxFormat::SizeReadAsCorners), "x, y, width, height"),
            (Correction::TurnedPictures { orientation: 6, fractions: true }, "turned by 90 degrees clockwise"),
        ] {
            assert!(text(correction).contains(words), "{}", text(correction));
        }
    }

    #[test]
    fn a_mistake_of_some_frames_names_them() {
        let frames = ["000001", "000003"].map(str::to_owned).to_vec();
        let some = Cause { value: Some(0.5), frames, correction: None, ..cause(Correction::BodyAxes) };
        let diagnosis = Diagnosis { consistent: false, agreement: None, causes: vec![some] };
        assert_eq!(
            in_words(diagnosis, &Context::default()).unwrap(),
            "in 50 % of the frames (000001, 000003) the camera axes are a robot's body axes (x forward, y left, z up)"
        );
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
        assert_eq!(option(Correction::ImageScale(0.96875)), "--assume image_size=640x480");
        assert_eq!(option(Correction::FocalFactor(0.75)), "--assume focal=1.5");
        assert_eq!(option(Correction::FrameOffset(-1)), "--assume frame_offset=2");
        // Turned clockwise where they should have been turned the other way: they stand upside down.
        let turned = |orientation| Correction::TurnedPictures { orientation, fractions: false };
        let context = Context::default().after(&[RecordCorrection::Known(turned(6))]);
        assert_eq!(context.option(&cause(turned(3))).unwrap(), "--assume orientation=8");
    }

    #[test]
    fn every_cause_has_its_words() {
        for name in CauseName::ALL {
            let words = mistake_in_words(name, Some(2.0), None);
            assert_eq!(serde_json::to_value(name).unwrap(), name.name());
            assert!(words.len() > 15 && words != name.name().replace('_', " "), "{words}");
        }
        let agreement = Agreement { miss: 0.7, share: 0.1, boxes: 9 };
        let unknown = Diagnosis { consistent: false, agreement: Some(agreement), causes: Vec::new() };
        let words = in_words(unknown, &Context::default()).unwrap();
        assert!(words.contains("70 % of their half size; no common"), "{words}");
        assert_eq!(in_words(Diagnosis::default(), &Context::default()), None);
    }
}
