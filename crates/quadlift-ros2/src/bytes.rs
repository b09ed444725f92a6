//! Messages as bytes, for a DDS library that encodes messages through serde.

use std::fmt;

use serde::de::{SeqAccess, Visitor};
use serde::ser::SerializeTuple;
use serde::{Deserialize, Deserializer, Serialize, Serializer};

/// A message in CDR, with the four bytes that name the encoding (always little endian, 0 1 0 0). Sent and received as they are.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Bytes(pub Vec<u8>);

/// The encoding: CDR, little endian.
const ENCODING: [u8; 4] = [0, 1, 0, 0];

impl ros2_client::Message for Bytes {}

impl Serialize for Bytes {
    /// A tuple of bytes has neither a length nor gaps in CDR.
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let body = self.0.get(ENCODING.len()..).unwrap_or_default();
        let mut tuple = serializer.serialize_tuple(body.len())?;
        for byte in body {
            tuple.serialize_element(byte)?;
        }
        tuple.end()
    }
}

impl<'de> Deserialize<'de> for Bytes {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_tuple(usize::MAX, BytesVisitor)
    }
}

struct BytesVisitor;

impl<'de> Visitor<'de> for BytesVisitor {
    type Value = Bytes;

    fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str("bytes")
    }

    /// Takes all bytes: the first error is the end of the message.
    fn visit_seq<A: SeqAccess<'de>>(self, mut bytes: A) -> Result<Bytes, A::Error> {
        let mut message = ENCODING.to_vec();
        while let Ok(Some(byte)) = bytes.next_element::<u8>() {
            message.push(byte);
        }
        Ok(Bytes(message))
    }
}
