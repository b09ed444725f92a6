//! Reading a scene file. Valid files need one pass; after a failure the text is read again to locate the error.

use std::path::Path;

use serde::Deserialize;
use serde::de::DeserializeOwned;
use serde_json::Value;
use serde_json::error::Category;
use serde_path_to_error::Segment;

use super::expected::expected;
use super::records::{FORMAT, SceneFile, VERSION};
use super::unknown::{MAX_VALUES, check_unknown};
use crate::error::ReadError;
use crate::guard::note_named;
use crate::input::{as_utf8, line_and_column, read_bytes};
use crate::wording::plain_words;

/// Reads a scene file. References between its parts and the ranges of numbers are checked by
/// [`SceneFile::to_scene`] and [`SceneFile::to_objects`].
///
/// # Errors
/// [`ReadError`] if the file cannot be read, is not JSON, has another format or version, or if an entry has the
/// wrong type.
pub fn read_scene_file(path: &Path) -> Result<SceneFile, ReadError> {
    let scene = parse_scene_file(path, &read_bytes(path)?)?;
    note_named(scene.named_files(path));
    Ok(scene)
}

/// The scene in the bytes of a file; the path only serves for messages.
///
/// # Errors
/// As [`read_scene_file`].
pub fn parse_scene_file(path: &Path, bytes: &[u8]) -> Result<SceneFile, ReadError> {
    let text = as_utf8(path, bytes)?;
    check_unknown(text, MAX_VALUES).map_err(|problem| ReadError::new(path, problem))?;
    match serde_json::from_str::<SceneFile>(text) {
        Ok(scene) if scene.format == FORMAT && scene.version == VERSION => Ok(scene),
        _ => Err(diagnose(path, text)),
    }
}

/// A record in the bytes of one line of JSON Lines. Errors have columns and entries, no lines.
///
/// # Errors
/// [`ReadError`] without a path when the line is no UTF-8 text or no JSON, or when an entry has another shape than it should.
pub(crate) fn parse_json_line<T: DeserializeOwned>(bytes: &[u8]) -> Result<T, ReadError> {
    let path = Path::new("");
    let text = as_utf8(path, bytes)?;
    serde_json::from_str(text).map_err(|_| {
        let start = text.len() - text.trim_start().len();
        if !text[start..].starts_with('{') {
            let found = text[start..].chars().next().unwrap_or_default();
            return ReadError::new(path, format!("expected a JSON object, which starts with {{; found {found:?}"))
                .at(1, start + 1);
        }
        diagnose_records::<T>(path, text).unwrap_or_else(|| ReadError::new(path, "this is not valid JSON"))
    })
}

/// What must be right before anything else is worth a message.
#[derive(Deserialize)]
struct Header {
    format: Option<Value>,
    version: Option<Value>,
}

/// The message for a text that is not a scene of this version.
fn diagnose(path: &Path, text: &str) -> ReadError {
    let start = text.len() - text.trim_start().len();
    if !text[start..].starts_with('{') {
        let (line, column) = line_and_column(text.as_bytes(), start);
        let found = text[start..].chars().next().unwrap_or_default();
        let problem =
            format!("this is not a scene file: expected a JSON object, which starts with {{; found {found:?}");
        return ReadError::new(path, problem).at(line, column);
    }
    if let Ok(header) = serde_json::from_str::<Header>(text)
        && let Err(problem) = check_header(&header)
    {
        return ReadError::new(path, problem);
    }
    diagnose_records::<SceneFile>(path, text).unwrap_or_else(|| ReadError::new(path, "this is not a scene file"))
}

/// Says which entry of a JSON text is wrong; `None` where all are right.
fn diagnose_records<T: DeserializeOwned>(path: &Path, text: &str) -> Option<ReadError> {
    let mut deserializer = serde_json::Deserializer::from_str(text);
    match serde_path_to_error::deserialize::<_, T>(&mut deserializer) {
        Err(error) => {
            let entry = entry(error.path());
            let field = error.path().iter().filter_map(field_name).next_back();
            Some(describe(path, text, error.inner(), entry, field))
        }
        Ok(_) => deserializer.end().err().map(|error| describe(path, text, &error, None, None)),
    }
}

/// Levels of nesting that are shown of an entry; none of ours is deeper.
const SHOWN_LEVELS: usize = 6;

/// The entry that a path leads to, such as `detections[17].box`; `None` for the outermost one.
fn entry(path: &serde_path_to_error::Path) -> Option<String> {
    let mut entry = String::new();
    for (level, segment) in path.iter().enumerate() {
        if level == SHOWN_LEVELS {
            entry.push_str("...");
            break;
        }
        match segment {
            Segment::Map { key } if entry.is_empty() => entry.push_str(key),
            Segment::Map { key } => entry.extend([".", key]),
            Segment::Seq { index } => entry.push_str(&format!("[{index}]")),
            // The reader was between two fields.
            Segment::Enum { .. } | Segment::Unknown => {}
        }
    }
    (!entry.is_empty()).then_some(entry)
}

fn field_name(segment: &Segment) -> Option<&str> {
    match segment {
        Segment::Map { key } => Some(key),
        _ => None,
    }
}

/// Checks format and version.
fn check_header(header: &Header) -> Result<(), String> {
    match &header.format {
        Some(Value::String(format)) if format == FORMAT => {}
        Some(found) => {
            return Err(format!("this is not a scene file: \"format\" is {found}; expected \"{FORMAT}\""));
        }
        None => {
            return Err(format!("this is not a scene file: it has no \"format\"; expected \"format\": \"{FORMAT}\""));
        }
    }
    match &header.version {
        Some(found) if found.as_u64() == Some(VERSION) => Ok(()),
        Some(Value::Number(found)) => {
            Err(format!("the file has version {found} of the scene format; this program reads version {VERSION}"))
        }
        Some(found) => Err(format!("\"version\" is {found}; expected the number {VERSION}")),
        None => Err(format!("the file has no \"version\"; expected \"version\": {VERSION}")),
    }
}

/// A message for a person from an error of the JSON reader.
fn describe(
    path: &Path,
    text: &str,
    error: &serde_json::Error,
    entry: Option<String>,
    field: Option<&str>,
) -> ReadError {
    let (line, column) = (error.line(), error.column());
    let message = error.to_string();
    let message = message.strip_suffix(&format!(" at line {line} column {column}")).unwrap_or(&message);
    let problem = match error.classify() {
        Category::Eof => format!("the file ends too early, it may be cut off ({message})"),
        Category::Syntax | Category::Io => match foreign_value(text, line, column) {
            Some(found) => format!("{found} is not JSON; leave the field out when there is no value ({message})"),
            None if message == "recursion limit exceeded" => "the entries are nested too deeply".to_owned(),
            None => format!("this is not valid JSON: {}", plain_words(message)),
        },
        Category::Data => match field.and_then(expected) {
            Some(expected) => format!("{} ({expected})", plain_words(message)),
            None => plain_words(message),
        },
    };
    let read_error = ReadError::new(path, problem).at(line, column);
    match entry {
        Some(entry) => read_error.in_entry(entry),
        None => read_error,
    }
}

/// The word at a place of the text, where it is one that other languages write for "no value".
fn foreign_value(text: &str, line: usize, column: usize) -> Option<&str> {
    let text = text.lines().nth(line.checked_sub(1)?)?;
    let is_word = |b: u8| b.is_ascii_alphanumeric() || b == b'-';
    let at = column.checked_sub(1)?;
    let before = text.as_bytes().get(..at)?.iter().rev().take_while(|&&b| is_word(b)).count();
    let after = text.as_bytes().get(at..)?.iter().take_while(|&&b| is_word(b)).count();
    let word = text.get(at - before..at + after)?;
    ["NaN", "nan", "Infinity", "-Infinity", "inf", "-inf", "None", "undefined"].contains(&word).then_some(word)
}
