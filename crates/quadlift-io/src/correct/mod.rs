//! Corrections of common mistakes in the records of a scene file: conventions of poses, intrinsics, boxes in other
//! pixels or formats, detections in the wrong frames.
//!
//! The mathematics is that of [`quadlift::diagnosis`], which finds the mistakes; here its maps are applied to the
//! records, before the scene is built, so that lenses, image borders and masks are right as well.

mod boxes;
mod cues;
mod frames;
mod poses;
mod cameras;
mod rounding;
mod record_correction;
pub mod assume;

#[cfg(test)]
mod tests;

use quadlift::diagnosis::Correction;
use quadlift::geometry::Similarity;

use crate::error::EntryError;
use crate::scene_file::SceneFile;
use crate::wording::count;

pub use assume::Assumption;
pub(crate) use frames::shift;
pub use record_correction::{DetectionPixels, RecordCorrection};
pub(crate) use rounding::usual_width;

/// Corrects the records of a scene file; returns descriptions. Objects of the file are not changed.
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
            RecordCorrection::FrameOffset(offset) => notes.push(frames::correct(file, &frames::shift(offset))),
            RecordCorrection::PoseUnit(meters) => {
                let frames = poses::scale(file, meters);
                move_contents(file, &Correction::Lengths(meters));
                file.length_unit = Some("m".to_owned());
                notes.push(format!(
                    "the lengths of {} were multiplied by {meters} and are now in meters",
                    count(frames, "pose")
                ));
            }
        }
    }
    Ok(notes)
}

/// Applies one of the known corrections; returns a description.
fn apply(file: &mut SceneFile, correction: &Correction) -> Result<String, EntryError> {
    Ok(match correction {
        Correction::FocalFactor(_) | Correction::NormalizedIntrinsics | Correction::CenteredPrincipalPoint => {
            let cameras = cameras::correct(file, correction)?;
            format!("the intrinsics of {} were corrected", count(cameras, "camera"))
        }
        Correction::RadialDistortion(coefficient) => {
            let cameras = cameras::add_lens(file, *coefficient)?;
            format!("{} received a lens model with the radial coefficient {coefficient}", count(cameras, "camera"))
        }
        Correction::ImageScale(_)
        | Correction::Letterbox(_)
        | Correction::NormalizedLetterbox
        | Correction::NormalizedBoxes
        | Correction::TurnedPictures { .. }
        | Correction::Boxes(_) => {
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
            move_contents(file, correction);
            format!("{} were corrected", count(poses::correct(file, correction)?, "pose"))
        }
    })
}

/// Moves cameras, points, depths and 3D boxes of a scene to another frame; `up` and objects stay.
///
/// # Errors
/// [`EntryError`], as of [`correct`].
pub(crate) fn move_world(file: &mut SceneFile, to: &Similarity) -> Result<(), EntryError> {
    cues::move_by(file, &(to.rotation.matrix() * to.scale), &to.translation);
    for point in &mut file.points {
        *point = to.point(&(*point).into()).into();
    }
    poses::change(file, |rotation, translation| {
        let turned = rotation * to.rotation.matrix().transpose();
        (turned, translation * to.scale - turned * to.translation)
    })
    .map(|_| ())
}

/// Moves the points of the scene, depths and 3D boxes into the world of the corrected poses.
fn move_contents(file: &mut SceneFile, correction: &Correction) {
    cues::move_with_world(file, correction);
    for point in &mut file.points {
        *point = correction.world_point(&(*point).into()).into();
    }
}
