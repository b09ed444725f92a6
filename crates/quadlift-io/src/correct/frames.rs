//! The frames of detections, corrected.

use std::collections::HashMap;

use quadlift::diagnosis::Correction;

use crate::scene_file::SceneFile;
use crate::wording::count;

/// The shift of detections that give this number to frame number 0. A shift by more frames than there are leaves nothing in its place,
/// whatever the number.
pub(crate) fn shift(offset: i64) -> Correction {
    Correction::FrameOffset(i32::try_from(offset.saturating_neg()).unwrap_or(i32::MAX))
}

/// Moves detections to the frames to which they belong and drops those without a frame. Returns a description.
pub(super) fn correct(file: &mut SceneFile, correction: &Correction) -> String {
    let ids: Vec<&str> = file.frames.iter().map(|frame| frame.id.as_str()).collect();
    let moves = |frames: &Vec<Option<usize>>| frames.iter().enumerate().any(|(k, frame)| *frame != Some(k));
    let Some(frames) = correction.frames(&ids).filter(moves) else { return "no detection was moved".to_owned() };
    let frame_of: HashMap<&str, Option<&str>> =
        ids.iter().zip(&frames).map(|(&id, &frame)| (id, frame.map(|frame| ids[frame]))).collect();
    let before = file.detections.len();
    file.detections.retain_mut(|record| match frame_of.get(&*record.frame) {
        Some(Some(frame)) => {
            record.frame = (*frame).into();
            true
        }
        Some(None) => false,
        // `to_scene` reports unknown frames.
        None => true,
    });
    let (after, moved) = (file.detections.len(), "moved to another frame");
    match before - after {
        0 => format!("{} were {moved}", count(after, "detection")),
        out => format!("{} were {moved}, {out} without a frame were skipped", count(after, "detection")),
    }
}
