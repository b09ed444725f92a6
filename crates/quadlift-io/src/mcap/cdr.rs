//! CDR, in which DDS (ROS 2) encodes messages: numbers of either byte order, aligned to their size. Reads by a definition,
//! writes number by number.

use super::schema::{Count, Definitions, Field, Kind, Primitive};
use super::value::Value;

/// How deep messages can be within each other.
const DEEPEST: usize = 32;

/// The content of a message.
///
/// # Errors
/// A text that names the field.
pub(super) fn decode(definitions: &Definitions, data: &[u8]) -> Result<Value, String> {
    let [_, kind, _, _] =
        *data.first_chunk::<4>().ok_or_else(|| format!("the message has {} bytes; expected 4 or more", data.len()))?;
    let (is_big, largest) = match kind {
        0 => (true, 8),
        1 => (false, 8),
        // The second version of the encoding aligns to 4 bytes at most.
        6 => (true, 4),
        7 => (false, 4),
        2 | 3 | 8..=11 => return Err(format!("the CDR encoding {kind:#04x} (with member headers) is not supported")),
        _ => return Err(format!("the CDR encoding {kind:#04x} is unknown")),
    };
    let mut reader = Reader { bytes: &data[4..], at: 0, is_big, largest, values_left: 64 * (data.len() + 64) };
    let value = reader.message(definitions, 0, 0)?;
    // Messages are padded to a multiple of four bytes, by some to eight.
    match reader.bytes.len() - reader.at {
        0..8 => Ok(value),
        left => Err(format!("the message has {left} more bytes than its schema")),
    }
}

struct Reader<'a> {
    bytes: &'a [u8],
    at: usize,
    is_big: bool,
    /// The largest alignment.
    largest: usize,
    /// How many values can still be made: arrays of messages without content would have no end otherwise.
    values_left: usize,
}

impl<'a> Reader<'a> {
    fn take(&mut self, count: usize) -> Result<&'a [u8], String> {
        let bytes = self.at.checked_add(count).and_then(|end| self.bytes.get(self.at..end));
        let bytes =
            bytes.ok_or_else(|| format!("the message ends too early: it has {} bytes", self.bytes.len() + 4))?;
        self.at += count;
        Ok(bytes)
    }

    fn number<const N: usize>(&mut self) -> Result<[u8; N], String> {
        let to = N.min(self.largest);
        self.at = self.at.next_multiple_of(to);
        let mut bytes = [0; N];
        bytes.copy_from_slice(self.take(N)?);
        if self.is_big {
            bytes.reverse();
        }
        Ok(bytes)
    }

    fn length(&mut self) -> Result<usize, String> {
        Ok(u32::from_le_bytes(self.number()?) as usize)
    }

    fn primitive(&mut self, kind: Primitive) -> Result<Value, String> {
        Ok(match kind {
            Primitive::Bool | Primitive::U8 => Value::Whole(u8::from_le_bytes(self.number()?).into()),
            Primitive::I8 => Value::Whole(i8::from_le_bytes(self.number()?).into()),
            Primitive::I16 => Value::Whole(i16::from_le_bytes(self.number()?).into()),
            Primitive::U16 => Value::Whole(u16::from_le_bytes(self.number()?).into()),
            Primitive::I32 => Value::Whole(i32::from_le_bytes(self.number()?).into()),
            Primitive::U32 => Value::Whole(u32::from_le_bytes(self.number()?).into()),
            Primitive::I64 => Value::Whole(i64::from_le_bytes(self.number()?)),
            Primitive::U64 => {
                let number = u64::from_le_bytes(self.number()?);
                i64::try_from(number).map_or(Value::Number(number as f64), Value::Whole)
            }
            Primitive::F32 => Value::Number(f32::from_le_bytes(self.number()?).into()),
            Primitive::F64 => Value::Number(f64::from_le_bytes(self.number()?)),
            Primitive::Text => {
                let length = self.length()?;
                let bytes = self.take(length)?;
                Value::Text(String::from_utf8_lossy(bytes.strip_suffix(&[0]).unwrap_or(bytes)).into_owned())
            }
            Primitive::WideText => return Err("wide strings are not supported".to_owned()),
        })
    }

    fn message(&mut self, definitions: &Definitions, index: usize, depth: usize) -> Result<Value, String> {
        if depth > DEEPEST {
            return Err(format!("the schema has more than {DEEPEST} levels"));
        }
        let fields = &definitions.messages[index];
        if fields.is_empty() {
            // A structure has at least one member in CDR.
            self.take(1)?;
        }
        let mut values = Vec::with_capacity(fields.len());
        for field in fields {
            let value = self.field(definitions, field, depth).map_err(|problem| match problem.split_once(": ") {
                // The field of a field.
                Some((inner, rest)) if !inner.contains(' ') => format!("{}.{inner}: {rest}", field.name),
                _ => format!("{}: {problem}", field.name),
            })?;
            values.push((field.name.clone(), value));
        }
        Ok(Value::Struct(values))
    }

    fn field(&mut self, definitions: &Definitions, field: &Field, depth: usize) -> Result<Value, String> {
        let count = match field.count {
            Count::One => return self.one(definitions, &field.kind, depth),
            Count::Array(count) => count,
            Count::Sequence => self.length()?,
        };
        let left = self.bytes.len().saturating_sub(self.at);
        // Every item has a byte at least.
        if count > left {
            return Err(format!("found a list of {count} in the last {left} bytes of the message"));
        }
        if field.kind == Kind::Primitive(Primitive::U8) {
            return self.take(count).map(|bytes| Value::Bytes(bytes.to_vec()));
        }
        let items = (0..count).map(|_| self.one(definitions, &field.kind, depth));
        items.collect::<Result<_, _>>().map(Value::List)
    }

    fn one(&mut self, definitions: &Definitions, kind: &Kind, depth: usize) -> Result<Value, String> {
        self.values_left = self.values_left.checked_sub(1).ok_or("the message has more values than bytes")?;
        match kind {
            Kind::Primitive(kind) => self.primitive(*kind),
            Kind::Message(index) => self.message(definitions, *index, depth + 1),
        }
    }
}

/// Writes a message in little-endian CDR.
#[derive(Debug, Clone)]
pub struct Writer {
    bytes: Vec<u8>,
}

impl Default for Writer {
    fn default() -> Self {
        Self { bytes: vec![0, 1, 0, 0] }
    }
}

impl Writer {
    fn number<const N: usize>(&mut self, bytes: [u8; N]) -> &mut Self {
        self.bytes.resize(4 + (self.bytes.len() - 4).next_multiple_of(N), 0);
        self.bytes.extend(bytes);
        self
    }

    /// A byte, or a truth value.
    pub fn u8(&mut self, x: u8) -> &mut Self {
        self.number([x])
    }

    /// A signed number of four bytes.
    pub fn i32(&mut self, x: i32) -> &mut Self {
        self.number(x.to_le_bytes())
    }

    /// An unsigned number of four bytes; also the length of a sequence.
    pub fn u32(&mut self, x: u32) -> &mut Self {
        self.number(x.to_le_bytes())
    }

    /// A number of single precision.
    pub(crate) fn f32(&mut self, x: f32) -> &mut Self {
        self.number(x.to_le_bytes())
    }

    /// A number of double precision.
    pub fn f64(&mut self, x: f64) -> &mut Self {
        self.number(x.to_le_bytes())
    }

    /// Several numbers, an array.
    pub fn f64s(&mut self, numbers: impl IntoIterator<Item = f64>) -> &mut Self {
        for x in numbers {
            self.f64(x);
        }
        self
    }

    /// A text.
    pub fn text(&mut self, text: &str) -> &mut Self {
        self.u32(text.len() as u32 + 1);
        self.bytes.extend(text.as_bytes());
        self.bytes.push(0);
        self
    }

    /// The message.
    pub fn finish(self) -> Vec<u8> {
        self.bytes
    }
}

#[cfg(test)]
mod tests {
    use super::super::schema::parse_ros2msg;
    use super::super::value::At;
    use super::*;

    const TEXT: &str =
        "uint8 a\nfloat64 b\nstring c\nP[] d\nbool[3] e\nint64[] f\n===\nMSG: t/P\nuint16 x\nfloat32 y\n";

    fn message() -> Vec<u8> {
        let mut writer = Writer::default();
        writer.u8(7).f64(0.1).text("cup").u32(2);
        for x in [1_u16, 2] {
            writer.number(x.to_le_bytes()).f32(0.5);
        }
        writer.u8(1).u8(0).u8(1).u32(1).number((-3_i64).to_le_bytes());
        writer.finish()
    }

    #[test]
    fn what_is_written_is_read_in_both_byte_orders() {
        let definitions = parse_ros2msg("t/msg/T", TEXT).unwrap();
        let little = decode(&definitions, &message()).unwrap();
        let root = At::root(&little);
        assert_eq!(root.field(&["b"]).unwrap().number(), Ok(0.1));
        assert_eq!(root.field(&["c"]).unwrap().text(), Ok("cup"));
        assert_eq!(root.field(&["e"]).unwrap().text().unwrap_err(), "e: found a list of 3; expected text");
        assert_eq!(root.field(&["f"]).unwrap().numbers(), Ok(vec![-3.0]));
        // The same by hand: 07, 7 of padding, 0.1, ...
        let mut big = vec![0, 0, 0, 0, 7, 0, 0, 0, 0, 0, 0, 0];
        big.extend(0.1_f64.to_be_bytes());
        big.extend([0, 0, 0, 4, b'c', b'u', b'p', 0, 0, 0, 0, 2, 0, 1, 0, 0]);
        big.extend(0.5_f32.to_be_bytes());
        big.extend([0, 2, 0, 0]);
        big.extend(0.5_f32.to_be_bytes());
        big.extend([1, 0, 1, 0, 0, 0, 0, 1]);
        // Up to a multiple of eight.
        big.resize(4 + (big.len() - 4).next_multiple_of(8), 0);
        big.extend((-3_i64).to_be_bytes());
        assert_eq!(decode(&definitions, &big).unwrap(), little);
    }

    #[test]
    fn the_field_that_is_wrong_is_named() {
        let definitions = parse_ros2msg("t/msg/T", TEXT).unwrap();
        let message = message();
        assert_eq!(decode(&definitions, &message[..3]).unwrap_err(), "the message has 3 bytes; expected 4 or more");
        let error = decode(&definitions, &message[..40]).unwrap_err();
        assert_eq!(error, "d.x: the message ends too early: it has 40 bytes");
        let mut long = message.clone();
        long.extend([0; 9]);
        assert_eq!(decode(&definitions, &long).unwrap_err(), "the message has 9 more bytes than its schema");
        let mut many = message.clone();
        many[28] = 255;
        assert!(decode(&definitions, &many).unwrap_err().starts_with("d: found a list of 255 in the last"));
        let mut other = message;
        other[1] = 3;
        assert!(decode(&definitions, &other).unwrap_err().contains("0x03"));
        let endless = parse_ros2msg("t/msg/T", "T a\n").unwrap();
        assert!(decode(&endless, &[0, 1, 0, 0]).unwrap_err().contains("more than 32 levels"));
    }
}
