//! Times of frames in whole nanoseconds.

use super::CheckedScene;
use crate::scene_file::FrameRecord;
use crate::time_steps::time_steps;

/// Nanoseconds of a second.
pub(super) const SECOND: i64 = 1_000_000_000;

/// The times of the frames in nanoseconds.
pub(super) fn stamps(scene: &CheckedScene, notes: &mut Vec<String>) -> Vec<i64> {
    let frames = &scene.file.frames;
    // ROS counts seconds in 32 bits.
    let is_valid = |time: f64| (-2e9..2e9).contains(&time);
    if !frames.iter().all(|frame| frame.time.is_some_and(is_valid)) {
        if !frames.is_empty() {
            notes.push("not every frame has a time: they are a second apart, from 0 on".to_owned());
        }
        return time_steps(frames).into_iter().map(|time_step| time_step as i64 * SECOND).collect();
    }
    let stamp = |frame: &FrameRecord| {
        let time = frame.time.unwrap_or_default();
        // Doubles hold the times of this century to a quarter of a microsecond; ids of imported logs have all digits.
        let exact = frame.id.rsplit('/').next().and_then(|id| {
            let (seconds, nanoseconds) = id.split_once('.').filter(|(_, rest)| rest.len() == 9)?;
            let seconds: i64 = seconds.parse().ok().filter(|seconds| (0..i64::from(i32::MAX)).contains(seconds))?;
            let nanoseconds: u32 = nanoseconds.parse().ok()?;
            Some(seconds * SECOND + i64::from(nanoseconds))
        });
        let rounded = (time.floor() as i64) * SECOND + ((time - time.floor()) * 1e9).round() as i64;
        exact.filter(|exact| (exact - rounded).abs() < 1000).unwrap_or(rounded)
    };
    frames.iter().map(stamp).collect()
}
