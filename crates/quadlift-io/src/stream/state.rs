//! The state of a stream in a file: what is needed to go on as if it had never ended.

use std::collections::BTreeMap;
use std::io::{self, Write};
use std::path::Path;

use quadlift::online::{ObjectMap, OnlineOptions};
use quadlift::solve::{CategoryPriors, PoseNoise};
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

use super::line::AboutRecord;
use super::options::{StoredPriors, options_of};
use super::scene::StreamedScene;
use crate::error::ReadError;
use crate::input::{as_utf8, read_bytes};
use crate::options::Spelling;
use crate::priors::{builtin_priors, parse_priors, read_priors};
use crate::scene_file::{CameraRecord, FrameRecord};
use crate::wording::plain_words;

/// The value of `format` in a state file.
const STATE_FORMAT: &str = "quadlift.stream_state";
/// The value of `version` that this program reads and writes.
const STATE_VERSION: u64 = 3;

/// What goes on: the map, the scene, and where the input was.
#[derive(Debug, Clone)]
pub struct StreamState {
    /// The map.
    pub map: ObjectMap,
    /// Cameras and kept frames.
    pub scene: StreamedScene,
    /// Lines of new poses since the last frame.
    pub poses_since: u64,
}

/// The file, as it is written (with a reference to the map) and read.
#[derive(Serialize, Deserialize)]
struct StateRecord<M> {
    format: String,
    version: u64,
    /// Options that the result depends on, by the names of the command line.
    options: Map<String, Value>,
    poses_since: u64,
    about: AboutRecord,
    unnamed_cameras: Vec<CameraRecord>,
    frames: Vec<FrameRecord>,
    /// Checksums of the frames as they were given.
    given: BTreeMap<String, u32>,
    map: M,
}

/// Writes a state; [`crate::write_file`] does it as a whole or not at all. `options` are those that the result depends on
/// ([`lasting_options`]).
///
/// # Errors
/// Those of `out`.
///
/// [`lasting_options`]: super::lasting_options
pub fn write_state(
    out: &mut (impl Write + ?Sized),
    state: &StreamState,
    options: &Map<String, Value>,
) -> io::Result<()> {
    let (about, frames, given, unnamed_cameras) = state.scene.to_parts(&state.map);
    let record = StateRecord {
        format: STATE_FORMAT.to_owned(),
        version: STATE_VERSION,
        // Those that are not given are left out: programs that have other options write the same.
        options: options.iter().filter(|(_, value)| !value.is_null()).map(|(k, v)| (k.clone(), v.clone())).collect(),
        poses_since: state.poses_since,
        about,
        unnamed_cameras,
        frames,
        given,
        map: &state.map,
    };
    let text = serde_json::to_string(&record)?;
    let rest = text.trim_start_matches('{');
    writeln!(out, "{},{rest}", checksum_of(rest))
}

/// The begin of a state with this text behind its first field.
fn checksum_of(rest: &str) -> String {
    format!("{{\"checksum\":\"{:08x}\"", crc32fast::hash(rest.as_bytes()))
}

/// That a state is as it was written: numbers that were changed would lead to another map.
fn check_checksum(path: &Path, text: &str) -> Result<(), ReadError> {
    match text.split_once(',') {
        Some((first, rest)) if first == checksum_of(rest.trim_end_matches('\n')) => Ok(()),
        _ => Err(ReadError::new(path, "the state is damaged: its checksum differs from that of its text".to_owned())),
    }
}

/// Reads a state that was written with the same options.
///
/// # Errors
/// [`ReadError`] when the file cannot be read, when it is none of this version, when it is damaged, or when an option differs.
pub fn read_state_file(
    path: &Path,
    map_options: OnlineOptions,
    options: &Map<String, Value>,
) -> Result<StreamState, ReadError> {
    parse_state_file(path, &read_bytes(path)?, map_options, options)
}

/// The state in the bytes of a file; the path only serves for messages.
///
/// # Errors
/// As [`read_state_file`].
fn parse_state_file(
    path: &Path,
    bytes: &[u8],
    map_options: OnlineOptions,
    options: &Map<String, Value>,
) -> Result<StreamState, ReadError> {
    let error = |problem: String| ReadError::new(path, problem);
    let text = as_utf8(path, bytes)?;
    header(path, text)?;
    check_checksum(path, text)?;
    let record: StateRecord<ObjectMap> = serde_json::from_str(text).map_err(|problem| json_error(path, &problem))?;
    for (name, now) in options {
        let before = record.options.get(name).unwrap_or(&Value::Null);
        if before != now {
            return Err(error(format!(
                "the state was made with {} {before}, and now it is {now}; go on with the same options",
                Spelling::Flag.option(name)
            )));
        }
    }
    let map = record.map.with_options(map_options).map_err(|problem| error(problem.to_string()))?;
    let scene = StreamedScene::from_parts(record.about, record.frames, record.given, record.unnamed_cameras)
        .map_err(|problem| problem.in_file(path))?;
    Ok(StreamState { map, scene, poses_since: record.poses_since })
}

/// A state with the options that it was written with.
#[derive(Debug, Clone)]
pub struct StoredStream {
    /// The state.
    pub state: StreamState,
    /// The options as they stand in the state, to write it again.
    pub options: Map<String, Value>,
    /// Standard deviations of the poses of frames without their own.
    pub pose_noise: Option<PoseNoise>,
}

/// Reads a state with the options that it was written with; priors of a file are read from there again.
///
/// # Errors
/// [`ReadError`] when the state or the file of its priors cannot be read.
pub fn read_stored_stream(path: &Path) -> Result<StoredStream, ReadError> {
    parse_stored_stream(path, &read_bytes(path)?)
}

/// As [`read_stored_stream`], from the bytes of a file; the path only serves for messages.
///
/// # Errors
/// As [`read_stored_stream`].
pub fn parse_stored_stream(path: &Path, bytes: &[u8]) -> Result<StoredStream, ReadError> {
    let options = header(path, as_utf8(path, bytes)?)?.options.unwrap_or_default();
    let (mut of_map, priors, pose_noise) = options_of(&options).map_err(|problem| ReadError::new(path, problem))?;
    of_map.priors = match priors {
        None => CategoryPriors::default(),
        Some(StoredPriors::Name(name)) if name == "builtin" => builtin_priors(),
        Some(StoredPriors::Name(name)) => read_priors(name.as_ref())?,
        Some(StoredPriors::Text { text }) => parse_priors("priors".as_ref(), &text)?,
    };
    let state = parse_state_file(path, bytes, of_map, &options)?;
    Ok(StoredStream { state, options, pose_noise })
}

/// What tells a state of this version from other files.
#[derive(Deserialize)]
struct Header {
    format: Option<Value>,
    version: Option<Value>,
    options: Option<Map<String, Value>>,
}

/// Checks that a text is a state of this version.
fn header(path: &Path, text: &str) -> Result<Header, ReadError> {
    let error = |problem: String| ReadError::new(path, problem);
    let header: Header = serde_json::from_str(text).map_err(|problem| json_error(path, &problem))?;
    if header.format.as_ref().and_then(Value::as_str) != Some(STATE_FORMAT) {
        let found = header.format.map_or("none".to_owned(), |found| found.to_string());
        return Err(error(format!("this is no state of a stream: \"format\" is {found}; expected \"{STATE_FORMAT}\"")));
    }
    if header.version.as_ref().and_then(Value::as_u64) != Some(STATE_VERSION) {
        let found = header.version.map_or("none".to_owned(), |found| found.to_string());
        return Err(error(format!("the state has version {found}; this program reads version {STATE_VERSION}")));
    }
    Ok(header)
}

fn json_error(path: &Path, problem: &serde_json::Error) -> ReadError {
    ReadError::new(path, format!("the state cannot be read: {}", plain_words(&problem.to_string())))
}

#[cfg(test)]
#[path = "state_tests.rs"]
mod tests;
