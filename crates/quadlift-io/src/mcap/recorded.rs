//! The messages of a log as they are, and messages as JSON: for programs that play a log, and for tests.

use std::io::Cursor;
use std::path::Path;

use super::cdr;
use super::container::{Item, LogReader};
use super::schema::parse_ros2msg;
use super::strict_error;
use super::value::Value;
use crate::error::ReadError;
use crate::input::read_error;

/// A message of a log.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RecordedMessage {
    /// Its topic.
    pub topic: String,
    /// Its type, such as `sensor_msgs/msg/CameraInfo`; empty if the log does not say it.
    pub kind: String,
    /// When it was recorded, in nanoseconds.
    pub log_time: u64,
    /// Its bytes.
    pub data: Vec<u8>,
}

/// The messages in the bytes of a log, in its order; the path is used in messages.
///
/// # Errors
/// [`ReadError`] if this is no MCAP file, or if a part of it is damaged.
pub fn recorded_messages(path: &Path, bytes: &[u8]) -> Result<Vec<RecordedMessage>, ReadError> {
    let reader = LogReader::new(Cursor::new(bytes), Box::new(|_| true)).map_err(|error| read_error(path, &error))?;
    let mut reader = reader.map_err(|text| ReadError::new(path, text))?;
    let mut messages = Vec::new();
    while let Some(item) = reader.next_item().map_err(|error| read_error(path, &error))? {
        match item {
            Item::Problem(problem) => return Err(strict_error(path, &problem)),
            Item::Message(message) => messages.push(RecordedMessage {
                topic: message.channel.topic.clone(),
                kind: message.channel.schema.as_ref().map_or(String::new(), |schema| schema.name.clone()),
                log_time: message.log_time,
                data: message.data.to_vec(),
            }),
        }
    }
    Ok(messages)
}

/// The content of a message in CDR as JSON, by the text of its definition (`ros2msg`). Bytes become lists of numbers.
///
/// # Errors
/// A text that names the field, or the line of the definition.
pub fn message_to_json(kind: &str, definition: &str, data: &[u8]) -> Result<serde_json::Value, String> {
    Ok(to_json(cdr::decode(&parse_ros2msg(kind, definition)?, data)?))
}

fn to_json(value: Value) -> serde_json::Value {
    match value {
        Value::Number(x) => x.into(),
        Value::Whole(x) => x.into(),
        Value::Text(text) => text.into(),
        Value::Bytes(bytes) => bytes.into(),
        Value::List(list) => list.into_iter().map(to_json).collect(),
        Value::Struct(fields) => fields.into_iter().map(|(name, value)| (name.to_string(), to_json(value))).collect(),
    }
}
