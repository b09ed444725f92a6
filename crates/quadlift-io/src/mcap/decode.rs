//! From the bytes of a message to its content, by the encoding of its channel.

use std::collections::BTreeMap;

use super::cdr;
use super::container::Channel;
use super::protobuf::Descriptors;
use super::schema::{Definitions, parse_ros2idl, parse_ros2msg};
use super::value::Value;

/// How deep JSON can be.
const DEEPEST: usize = 32;

/// How the messages of a channel are read.
#[derive(Debug)]
pub(super) enum Decoder {
    Cdr(Definitions),
    Json,
    Protobuf(Descriptors),
}

impl Decoder {
    /// How the messages of this channel are read.
    ///
    /// # Errors
    /// A text that names encodings or parts of the schema that are not supported.
    pub(super) fn new(channel: &Channel) -> Result<Self, String> {
        let Some(schema) = &channel.schema else {
            return Err("it has no schema: its messages cannot be read".to_owned());
        };
        let text =
            || std::str::from_utf8(&schema.data).map_err(|_| format!("the schema of {} is no UTF-8 text", schema.name));
        let in_schema = |problem: String| format!("{} ({}): {problem}", schema.name, schema.encoding);
        match (&*channel.encoding, &*schema.encoding) {
            ("cdr", "ros2msg") => parse_ros2msg(&schema.name, text()?).map(Self::Cdr).map_err(in_schema),
            ("cdr", "ros2idl") => parse_ros2idl(&schema.name, text()?).map(Self::Cdr).map_err(in_schema),
            ("json", _) => Ok(Self::Json),
            ("protobuf", "protobuf") => {
                Descriptors::new(&schema.name, &schema.data).map(Self::Protobuf).map_err(in_schema)
            }
            ("ros1", _) => {
                Err("its messages are of ROS 1, which is not supported; `rosbags-convert` converts the bag to \
                 ROS 2"
                    .to_owned())
            }
            (encoding, schema) => Err(format!(
                "its messages have the encoding \"{encoding}\" with a schema in \"{schema}\", which is not supported; \
                 expected cdr (ros2msg or ros2idl), json or protobuf"
            )),
        }
    }

    /// The content of a message.
    ///
    /// # Errors
    /// A text that names the field.
    pub(super) fn decode(&self, data: &[u8]) -> Result<Value, String> {
        match self {
            Self::Cdr(definitions) => cdr::decode(definitions, data),
            Self::Protobuf(descriptors) => descriptors.decode(data),
            Self::Json => {
                let value = serde_json::from_slice(data).map_err(|error| format!("this is not valid JSON: {error}"))?;
                from_json(value, 0)
            }
        }
    }
}

fn from_json(value: serde_json::Value, depth: usize) -> Result<Value, String> {
    use serde_json::Value as Json;
    if depth > DEEPEST {
        return Err(format!("the JSON has more than {DEEPEST} levels"));
    }
    Ok(match value {
        Json::Null => Value::Struct(Vec::new()),
        Json::Bool(x) => Value::Whole(x.into()),
        Json::Number(x) => x.as_i64().map_or(Value::Number(x.as_f64().unwrap_or(f64::NAN)), Value::Whole),
        Json::String(text) => Value::Text(text),
        Json::Array(list) => {
            Value::List(list.into_iter().map(|item| from_json(item, depth + 1)).collect::<Result<_, _>>()?)
        }
        Json::Object(map) => {
            let fields = map.into_iter().filter(|(_, value)| !value.is_null());
            let fields = fields.map(|(name, value)| Ok((name.as_str().into(), from_json(value, depth + 1)?)));
            Value::Struct(fields.collect::<Result<_, String>>()?)
        }
    })
}

/// The decoders of the channels, which are made once.
#[derive(Debug, Default)]
pub(super) struct Decoders {
    by_channel: BTreeMap<u16, (std::sync::Arc<Channel>, Result<Decoder, String>)>,
}

impl Decoders {
    /// The decoder of a channel, and whether it is asked for the first time.
    pub(super) fn of(&mut self, channel: &std::sync::Arc<Channel>) -> (Result<&Decoder, &String>, bool) {
        let is_new = self.by_channel.get(&channel.id).is_none_or(|(known, _)| known != channel);
        if is_new {
            self.by_channel.insert(channel.id, (channel.clone(), Decoder::new(channel)));
        }
        let (_, decoder) = &self.by_channel[&channel.id];
        (decoder.as_ref(), is_new)
    }
}
