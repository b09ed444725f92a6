//! Corrections of the usual mistakes in the records of a scene file: conventions of poses, intrinsics, boxes in other
//! pixels or formats, detections in the wrong frames.
//!
//! The mathematics is that of [`quadlift::diagnose`], which finds the mistakes; here its maps are applied to the
//! records, before the scene is built, so that lenses, image borders and masks are right as well.

mod boxes;
mod cameras;
mod frames;
pub mod options;
mod poses;

#[cfg(test)]
mod tests;

use quadlift::diagnosis::Correction;

use crate::error::EntryError;
use crate::scene_file::SceneFile;
use crate::wording::count;

/// What is corrected in the records of a scene file.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum RecordCorrection {
    /// One of the usual mistakes.
    Known(Correction),
    /// The boxes were measured in images of this width and height, in pixels; they are scaled to the cameras' images.
    ImageSize([f64; 2]),
    /// The boxes were measured in letterboxed images of this width and height, in pixels, that need not be square: the
    /// image was scaled to fit, keeps its proportions and has equal margins on both sides.
    Letterbox([f64; 2]),
    /// The translations of the poses are in a unit of this length in metres; the scene is in metres afterwards.
    PoseUnit(f64),
}

impl RecordCorrection {
    /// What undoes one of the usual mistakes in a scene whose images have one size, in pixels, where that is known. Sizes
    /// of images that were found by the self-check are rounded: to a usual width where one is near, to whole pixels else.
    pub fn of(correction: &Correction, image_size: Option<[f64; 2]>) -> Self {
        match (*correction, image_size) {
            (Correction::ImageScale(factor), Some([width, height])) => {
                let measured = usual_width(width / factor);
                Self::ImageSize([measured, (height * measured / width).round().max(1.0)])
            }
            (Correction::Lengths(factor), _) => Self::PoseUnit(options::nearest_unit(factor)),
            (Correction::Letterbox(side), _) => Self::Known(Correction::Letterbox(usual_width(side))),
            (other, _) => Self::Known(other),
        }
    }

    /// The place in the order in which corrections are applied: the format of boxes before their pixels, everything that
    /// belongs to a frame before detections move to other frames.
    fn place(&self) -> u8 {
        match self {
            Self::Known(Correction::Boxes(_)) => 0,
            Self::Known(Correction::FrameOffset(_) | Correction::ReversedFrames) => 3,
            Self::Known(Correction::AlphabeticalFrames | Correction::NumericFrames) => 2,
            _ => 1,
        }
    }
}

/// Widths of images are multiples of this as a rule: networks and video codecs ask for it.
const WIDTH_STEP: f64 = 16.0;

/// Share by which a width that the self-check has found may be wrong.
const WIDTH_ERROR: f64 = 0.005;

/// The width, in pixels, that is meant by one that was found.
pub(crate) fn usual_width(found: f64) -> f64 {
    let usual = (found / WIDTH_STEP).round() * WIDTH_STEP;
    let is_near = (usual / found - 1.0).abs() < WIDTH_ERROR;
    if is_near { usual } else { found.round() }.max(1.0)
}

/// Corrects the records of a scene file; returns what was done, in words. Objects of the file are left as they are.
///
/// # Errors
/// [`EntryError`] names the first entry that cannot be corrected: a size that is needed and not known, a camera that has
/// a lens already, numbers that make no box.
pub fn correct(file: &mut SceneFile, corrections: &[RecordCorrection]) -> Result<Vec<String>, EntryError> {
    let mut corrections = corrections.to_vec();
    corrections.sort_by_key(RecordCorrection::place);
    let mut notes = Vec::new();
    for correction in &corrections {
        match *correction {
            RecordCorrection::Known(known) => notes.push(apply(file, &known)?),
            RecordCorrection::ImageSize(size) => notes.push(boxes::from_image_size(file, size)?),
            RecordCorrection::Letterbox(size) => {
                let detections = boxes::from_letterbox(file, size)?;
                notes.push(format!("the boxes of {} were corrected", count(detections, "detection")));
            }
            RecordCorrection::PoseUnit(metres) => {
                let frames = poses::scale(file, metres);
                move_points(file, &Correction::Lengths(metres));
                file.length_unit = Some("m".to_owned());
                notes.push(format!("the lengths of {} are metres now, times {metres}", count(frames, "pose")));
            }
        }
    }
    Ok(notes)
}

/// Applies one of the usual corrections; returns what was done, in words.
fn apply(file: &mut SceneFile, correction: &Correction) -> Result<String, EntryError> {
    Ok(match correction {
        Correction::FocalFactor(_) | Correction::NormalizedIntrinsics | Correction::CenteredPrincipalPoint => {
            let cameras = cameras::correct(file, correction)?;
            format!("the intrinsics of {} were corrected", count(cameras, "camera"))
        }
        Correction::RadialDistortion(coefficient) => {
            let cameras = cameras::add_lens(file, *coefficient)?;
            format!("{} got a lens with the radial coefficient {coefficient}", count(cameras, "camera"))
        }
        Correction::ImageScale(_) | Correction::Letterbox(_) | Correction::NormalizedBoxes | Correction::Boxes(_) => {
            let detections = boxes::correct(file, correction)?;
            format!("the boxes of {} were corrected", count(detections, "detection"))
        }
        Correction::FrameOffset(_)
        | Correction::AlphabeticalFrames
        | Correction::NumericFrames
        | Correction::ReversedFrames => frames::correct(file, correction),
        Correction::Up(up) => {
            file.up = Some(*up);
            format!("up is {up:?}")
        }
        _ => {
            move_points(file, correction);
            format!("{} were corrected", count(poses::correct(file, correction)?, "pose"))
        }
    })
}

/// Moves the points of the scene into the world of the corrected poses.
fn move_points(file: &mut SceneFile, correction: &Correction) {
    for point in &mut file.points {
        *point = correction.world_point(&(*point).into()).into();
    }
}
