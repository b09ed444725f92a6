//! Protobuf, by the descriptor in the log (a `FileDescriptorSet`): no code is generated for any type.

use std::collections::BTreeMap;
use std::sync::Arc;

use super::value::Value;

/// How deep messages can be within each other.
const DEEPEST: usize = 32;

/// The types of a descriptor.
#[derive(Debug, Clone, PartialEq, Default)]
pub(super) struct Descriptors {
    messages: Vec<BTreeMap<u64, Field>>,
}

#[derive(Debug, Clone, PartialEq)]
struct Field {
    name: Arc<str>,
    kind: u64,
    is_repeated: bool,
    /// Of a message.
    message: Option<usize>,
}

/// A field as it is encoded.
enum Wire<'a> {
    Varint(u64),
    Fixed64([u8; 8]),
    Bytes(&'a [u8]),
    Fixed32([u8; 4]),
}

/// The fields of a message, in their order; an error if it is damaged.
struct Fields<'a>(&'a [u8]);

const DAMAGED: &str = "the message is no valid protobuf";

impl<'a> Fields<'a> {
    fn varint(&mut self) -> Result<u64, String> {
        let mut number = 0;
        for shift in (0..64).step_by(7) {
            let (&byte, rest) = self.0.split_first().ok_or(DAMAGED)?;
            self.0 = rest;
            number |= u64::from(byte & 0x7F) << shift;
            if byte < 0x80 {
                return Ok(number);
            }
        }
        Err(DAMAGED.to_owned())
    }

    fn bytes(&mut self, count: usize) -> Result<&'a [u8], String> {
        let (bytes, rest) = self.0.split_at_checked(count).ok_or(DAMAGED)?;
        self.0 = rest;
        Ok(bytes)
    }

    fn array<const N: usize>(&mut self) -> Result<[u8; N], String> {
        self.bytes(N)?.try_into().map_err(|_| DAMAGED.to_owned())
    }

    fn next(&mut self) -> Result<Option<(u64, Wire<'a>)>, String> {
        if self.0.is_empty() {
            return Ok(None);
        }
        let tag = self.varint()?;
        let wire = match tag & 7 {
            0 => Wire::Varint(self.varint()?),
            1 => Wire::Fixed64(self.array()?),
            2 => {
                let length = usize::try_from(self.varint()?).map_err(|_| DAMAGED)?;
                Wire::Bytes(self.bytes(length)?)
            }
            5 => Wire::Fixed32(self.array()?),
            _ => return Err(DAMAGED.to_owned()),
        };
        Ok(Some((tag >> 3, wire)))
    }
}

/// Numbers of the types in a descriptor.
mod kind {
    pub(super) const DOUBLE: u64 = 1;
    pub(super) const FLOAT: u64 = 2;
    pub(super) const INT64: u64 = 3;
    pub(super) const UINT64: u64 = 4;
    pub(super) const INT32: u64 = 5;
    pub(super) const FIXED64: u64 = 6;
    pub(super) const FIXED32: u64 = 7;
    pub(super) const BOOL: u64 = 8;
    pub(super) const STRING: u64 = 9;
    pub(super) const MESSAGE: u64 = 11;
    pub(super) const BYTES: u64 = 12;
    pub(super) const UINT32: u64 = 13;
    pub(super) const ENUM: u64 = 14;
    pub(super) const SFIXED32: u64 = 15;
    pub(super) const SFIXED64: u64 = 16;
    pub(super) const SINT32: u64 = 17;
    pub(super) const SINT64: u64 = 18;
}

impl Descriptors {
    /// The types that a message of this name consists of.
    ///
    /// # Errors
    /// A text that says what is missing.
    pub(super) fn new(name: &str, set: &[u8]) -> Result<Self, String> {
        let damaged = |_| "the schema is no valid FileDescriptorSet".to_owned();
        let mut raw = BTreeMap::new();
        let mut files = Fields(set);
        while let Some((number, wire)) = files.next().map_err(damaged)? {
            if let (1, Wire::Bytes(file)) = (number, wire) {
                let (mut package, mut messages) = (String::new(), Vec::new());
                let mut fields = Fields(file);
                while let Some((number, wire)) = fields.next().map_err(damaged)? {
                    match (number, wire) {
                        (2, Wire::Bytes(name)) => package = String::from_utf8_lossy(name).into_owned(),
                        (4, Wire::Bytes(message)) => messages.push(message),
                        _ => {}
                    }
                }
                let prefix = if package.is_empty() { String::new() } else { format!(".{package}") };
                for message in messages {
                    collect(message, &prefix, 0, &mut raw).map_err(damaged)?;
                }
            }
        }
        let mut names = vec![format!(".{name}")];
        let mut messages: Vec<BTreeMap<u64, Field>> = Vec::new();
        while messages.len() < names.len() {
            let current = names[messages.len()].clone();
            let Some(fields) = raw.get(&current) else {
                return Err(format!("the schema does not define {}", current.trim_start_matches('.')));
            };
            let mut resolved = BTreeMap::new();
            for field in fields {
                let message = (field.kind == kind::MESSAGE).then(|| {
                    names.iter().position(|known| *known == field.type_name).unwrap_or_else(|| {
                        names.push(field.type_name.clone());
                        names.len() - 1
                    })
                });
                let name = field.name.as_str().into();
                resolved
                    .insert(field.number, Field { name, kind: field.kind, is_repeated: field.is_repeated, message });
            }
            messages.push(resolved);
        }
        Ok(Self { messages })
    }

    /// The content of a message. Numbers, texts and lists that it leaves out are zero and empty, messages are not there.
    ///
    /// # Errors
    /// A text that names the field.
    pub(super) fn decode(&self, data: &[u8]) -> Result<Value, String> {
        let mut values_left = 64 * (data.len() + 64);
        self.message(0, data, 0, &mut values_left)
    }

    /// `values_left`: how many values can still be made, for two bytes can be a message of many fields.
    fn message(&self, index: usize, data: &[u8], depth: usize, values_left: &mut usize) -> Result<Value, String> {
        if depth > DEEPEST {
            return Err(format!("the message has more than {DEEPEST} levels"));
        }
        let definition = &self.messages[index];
        let left = values_left.checked_sub(definition.len()).ok_or("the message has many more values than bytes")?;
        *values_left = left;
        let mut found: BTreeMap<u64, Value> = BTreeMap::new();
        let mut fields = Fields(data);
        while let Some((number, wire)) = fields.next()? {
            let Some(field) = definition.get(&number) else { continue };
            let in_field = |problem: String| format!("{}: {problem}", field.name);
            if !field.is_repeated {
                found.insert(number, self.value(field, wire, depth, values_left).map_err(in_field)?);
                continue;
            }
            let Value::List(list) = found.entry(number).or_insert_with(|| Value::List(Vec::new())) else { continue };
            match wire {
                Wire::Bytes(packed) if !matches!(field.kind, kind::STRING | kind::BYTES | kind::MESSAGE) => {
                    let mut packed = Fields(packed);
                    while !packed.0.is_empty() {
                        let wire = match field.kind {
                            kind::DOUBLE | kind::FIXED64 | kind::SFIXED64 => Wire::Fixed64(packed.array()?),
                            kind::FLOAT | kind::FIXED32 | kind::SFIXED32 => Wire::Fixed32(packed.array()?),
                            _ => Wire::Varint(packed.varint()?),
                        };
                        list.push(self.value(field, wire, depth, values_left).map_err(in_field)?);
                    }
                }
                wire => list.push(self.value(field, wire, depth, values_left).map_err(in_field)?),
            }
        }
        let values = definition.iter().filter_map(|(number, field)| {
            let value = found.remove(number).or_else(|| default(field))?;
            Some((field.name.clone(), value))
        });
        Ok(Value::Struct(values.collect()))
    }

    fn value(&self, field: &Field, wire: Wire, depth: usize, values_left: &mut usize) -> Result<Value, String> {
        let unsigned = |x: u64| i64::try_from(x).map_or(Value::Number(x as f64), Value::Whole);
        Ok(match (field.kind, wire) {
            (kind::DOUBLE, Wire::Fixed64(bytes)) => Value::Number(f64::from_le_bytes(bytes)),
            (kind::FLOAT, Wire::Fixed32(bytes)) => Value::Number(f32::from_le_bytes(bytes).into()),
            (kind::UINT64 | kind::UINT32 | kind::BOOL, Wire::Varint(x)) => unsigned(x),
            (kind::SINT32 | kind::SINT64, Wire::Varint(x)) => Value::Whole((x >> 1) as i64 ^ -((x & 1) as i64)),
            (kind::FIXED64, Wire::Fixed64(bytes)) => unsigned(u64::from_le_bytes(bytes)),
            (kind::SFIXED64, Wire::Fixed64(bytes)) => Value::Whole(i64::from_le_bytes(bytes)),
            (kind::FIXED32, Wire::Fixed32(bytes)) => Value::Whole(u32::from_le_bytes(bytes).into()),
            (kind::SFIXED32, Wire::Fixed32(bytes)) => Value::Whole(i32::from_le_bytes(bytes).into()),
            // Negative numbers of 32 bits, too, have 64 bits here.
            (kind::INT64 | kind::INT32 | kind::ENUM, Wire::Varint(x)) => Value::Whole(x as i64),
            (kind::STRING, Wire::Bytes(bytes)) => Value::Text(String::from_utf8_lossy(bytes).into_owned()),
            (kind::BYTES, Wire::Bytes(bytes)) => Value::Bytes(bytes.to_vec()),
            (kind::MESSAGE, Wire::Bytes(bytes)) => match field.message {
                Some(message) => self.message(message, bytes, depth + 1, values_left)?,
                None => return Err(DAMAGED.to_owned()),
            },
            _ => return Err("the field has another type than its schema says".to_owned()),
        })
    }
}

/// The value of a field that a message leaves out.
fn default(field: &Field) -> Option<Value> {
    Some(match field.kind {
        _ if field.is_repeated => Value::List(Vec::new()),
        kind::MESSAGE => return None,
        kind::STRING => Value::Text(String::new()),
        kind::BYTES => Value::Bytes(Vec::new()),
        kind::DOUBLE | kind::FLOAT => Value::Number(0.0),
        _ => Value::Whole(0),
    })
}

struct RawField {
    name: String,
    number: u64,
    kind: u64,
    type_name: String,
    is_repeated: bool,
}

/// Collects a message and those that are defined in it.
fn collect(message: &[u8], scope: &str, depth: usize, raw: &mut BTreeMap<String, Vec<RawField>>) -> Result<(), String> {
    if depth > DEEPEST {
        return Err(DAMAGED.to_owned());
    }
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    let (mut name, mut nested, mut found) = (String::new(), Vec::new(), Vec::new());
    let mut fields = Fields(message);
    while let Some((number, wire)) = fields.next()? {
        match (number, wire) {
            (1, Wire::Bytes(bytes)) => name = text(bytes),
            (2, Wire::Bytes(bytes)) => {
                let mut field =
                    RawField { name: String::new(), number: 0, kind: 0, type_name: String::new(), is_repeated: false };
                let mut members = Fields(bytes);
                while let Some((number, wire)) = members.next()? {
                    match (number, wire) {
                        (1, Wire::Bytes(bytes)) => field.name = text(bytes),
                        (3, Wire::Varint(x)) => field.number = x,
                        (4, Wire::Varint(x)) => field.is_repeated = x == 3,
                        (5, Wire::Varint(x)) => field.kind = x,
                        (6, Wire::Bytes(bytes)) => field.type_name = text(bytes),
                        _ => {}
                    }
                }
                found.push(field);
            }
            (3, Wire::Bytes(bytes)) => nested.push(bytes),
            _ => {}
        }
    }
    let full = format!("{scope}.{name}");
    for message in nested {
        collect(message, &full, depth + 1, raw)?;
    }
    raw.insert(full, found);
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::super::value::At;
    use super::*;

    fn tagged(number: u8, bytes: &[u8]) -> Vec<u8> {
        [&[number << 3 | 2, bytes.len() as u8], bytes].concat()
    }

    fn field(name: &str, number: u8, label: u8, kind: u8, type_name: &str) -> Vec<u8> {
        let numbers = [3 << 3, number, 4 << 3, label, 5 << 3, kind];
        tagged(2, &[tagged(1, name.as_bytes()), numbers.to_vec(), tagged(6, type_name.as_bytes())].concat())
    }

    #[test]
    fn messages_are_read_by_their_descriptor() {
        let time = [tagged(1, b"Time"), field("seconds", 1, 1, 3, ""), field("nanos", 2, 1, 5, "")].concat();
        let message = [
            tagged(1, b"A"),
            field("time", 1, 1, 11, ".p.A.Time"),
            field("k", 2, 3, 1, ""),
            field("name", 3, 1, 9, ""),
            field("x", 4, 1, 2, ""),
            tagged(3, &time),
        ]
        .concat();
        let set = tagged(1, &[tagged(2, b"p"), tagged(4, &message)].concat());
        let descriptors = Descriptors::new("p.A", &set).unwrap();
        let mut data = tagged(1, &[8, 5, 16, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 1]);
        data.extend(tagged(2, &[1.5_f64.to_le_bytes(), 2.5_f64.to_le_bytes()].concat()));
        // One more, not packed, and a field that the descriptor does not have.
        data.push(2 << 3 | 1);
        data.extend(3.5_f64.to_le_bytes());
        data.extend(tagged(15, b"new"));
        let value = descriptors.decode(&data).unwrap();
        let root = At::root(&value);
        let time = root.field(&["time"]).unwrap();
        assert_eq!(time.coordinates(["seconds", "nanos"]), Ok([5.0, -1.0]));
        assert_eq!(root.field(&["k"]).unwrap().numbers(), Ok(vec![1.5, 2.5, 3.5]));
        assert_eq!(root.field(&["name"]).unwrap().text(), Ok(""));
        assert_eq!(root.field(&["x"]).unwrap().number(), Ok(0.0));
        assert!(At::root(&descriptors.decode(&[]).unwrap()).optional(&["time"]).is_none());
        assert_eq!(descriptors.decode(&data[..9]).unwrap_err(), DAMAGED);
        assert_eq!(descriptors.decode(&tagged(3, b"a")[..2]).unwrap_err(), DAMAGED);
        assert!(descriptors.decode(&[8, 1]).unwrap_err().starts_with("time: the field has another type"));
        assert_eq!(Descriptors::new("p.B", &set).unwrap_err(), "the schema does not define p.B");
    }
}
