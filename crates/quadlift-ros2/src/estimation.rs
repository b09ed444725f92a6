//! From a map to what is published of it: estimates, and their messages.

use std::collections::HashSet;
use std::io::Write;
use std::path::Path;

use quadlift::Unobserved;
use quadlift::online::ObjectMap;
use quadlift_io::mcap::CdrWriter;
use quadlift_io::run::{FileInput, run_file};
use quadlift_io::scene_file::{Detail, write_scene};
use quadlift_io::stream::StreamState;
use quadlift_io::write::mcap::MapMessages;
use quadlift_io::write::{BodyChoice, CheckedScene};
use quadlift_io::{ReadError, SceneFile};

use crate::bytes::Bytes;
use crate::options::Options;

/// A map at a time step, to be estimated on any thread.
#[derive(Debug, Clone)]
pub struct Snapshot {
    input: Result<FileInput, ReadError>,
    /// Time of the last frame in nanoseconds.
    pub stamp: i64,
}

/// The estimates of a map with their messages.
#[derive(Debug, Clone)]
pub struct Estimate {
    /// The result file.
    pub result: SceneFile,
    /// Time of the last frame in nanoseconds.
    pub stamp: i64,
    /// `vision_msgs/Detection3DArray`.
    pub detections: Bytes,
    /// `visualization_msgs/MarkerArray`.
    pub markers: Bytes,
    /// `std_msgs/String` with the objects as JSON.
    pub json: Bytes,
}

impl Snapshot {
    /// The map as it is now, settled; the stream goes on without that.
    pub fn new(stream: &StreamState) -> Self {
        let mut map: ObjectMap = stream.map.clone();
        map.settle();
        let stamp = map.last_frame().map_or(0, |(id, time)| stamp(id, time));
        Self { input: FileInput::of_map(&stream.scene, &map, Path::new("the map")), stamp }
    }

    /// The result, as `quadlift stream --map` writes it.
    ///
    /// # Errors
    /// A text if the scene of the map is not valid.
    pub fn result(&self, options: &Options) -> Result<SceneFile, String> {
        let input = self.input.clone().map_err(|error| error.to_string())?;
        let run = run_file(input, &options.estimates, &Unobserved);
        run.map(|run| run.result()).map_err(|failed| failed.1.to_string())
    }

    /// The result with its messages.
    ///
    /// # Errors
    /// As [`Self::result`].
    pub fn estimate(&self, options: &Options) -> Result<Estimate, String> {
        let result = self.result(options)?;
        let checked = checked(&result)?;
        let messages = MapMessages::new(&checked, &options.live.world_frame, self.stamp);
        let there: HashSet<&str> =
            result.objects.iter().filter(|object| !object.is_gone()).map(|object| object.id.as_str()).collect();
        let is_there = |id: &str| there.contains(id);
        let mut detections = CdrWriter::default();
        messages.add_detections(&mut detections, is_there);
        let (detections, markers) = (Bytes(detections.finish()), Bytes(messages.markers(is_there)));
        let json = text_message(&objects_json(&result)?);
        Ok(Estimate { result, stamp: self.stamp, detections, markers, json })
    }
}

/// The objects of a result with their bodies.
///
/// # Errors
/// A text if an object is not valid.
pub fn checked(result: &SceneFile) -> Result<CheckedScene<'_>, String> {
    CheckedScene::new(result, BodyChoice::Body).map_err(|error| format!("{}: {}", error.entry, error.problem))
}

/// A `std_msgs/String`.
pub fn text_message(text: &str) -> Bytes {
    let mut message = CdrWriter::default();
    message.text(text);
    Bytes(message.finish())
}

/// The objects as a scene file without frames and detections.
fn objects_json(result: &SceneFile) -> Result<String, String> {
    let mut objects = result.objects.clone();
    objects.iter_mut().for_each(|object| Detail::Compact.apply(object));
    let brief = SceneFile {
        length_unit: result.length_unit.clone(),
        up: result.up,
        localization: result.localization.clone(),
        objects,
        ..SceneFile::default()
    };
    let mut bytes = Vec::new();
    write_scene(&brief, &mut bytes as &mut dyn Write).map_err(|error| error.to_string())?;
    String::from_utf8(bytes).map_err(|error| error.to_string())
}

/// The time of a frame in nanoseconds: ids of frames of robots end with it.
pub(crate) fn stamp(id: &str, time: f64) -> i64 {
    let exact = id.rsplit('/').next().and_then(|text| {
        let (seconds, rest) = text.split_once('.').filter(|(_, rest)| rest.len() == 9)?;
        let (seconds, nanoseconds): (i64, i64) = (seconds.parse().ok()?, rest.parse().ok()?);
        seconds.checked_mul(1_000_000_000)?.checked_add(nanoseconds)
    });
    exact.unwrap_or((time * 1e9).round() as i64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_are_exact_where_the_id_is_a_time() {
        assert_eq!(stamp("front/1700000000.123456789", 1_700_000_000.123), 1_700_000_000_123_456_789);
        assert_eq!(stamp("000017", 0.5), 500_000_000);
    }
}
