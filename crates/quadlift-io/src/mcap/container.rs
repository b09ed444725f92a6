//! The records of an MCAP file (mcap.dev, "MCAP Format Specification", version 0): one after another, a chunk at a time in memory.
//!
//! What is damaged is a [`Problem`] with its place, and reading goes on behind it: after a damaged chunk with the next record,
//! after a record whose length cannot be true with the next chunk that the index at the end of the file lists.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt;
use std::io::{self, Read, Seek, SeekFrom};
use std::sync::Arc;

/// The first and the last bytes of every file.
pub(super) const MAGIC: &[u8; 8] = b"\x89MCAP0\r\n";

/// The largest chunk or message that is read, in bytes. Recorders make chunks of a few megabytes.
const MAX_CHUNK: u64 = 1 << 28;

/// Opcodes of the records that are read or written.
pub(super) mod opcode {
    pub(crate) const HEADER: u8 = 0x01;
    pub(crate) const FOOTER: u8 = 0x02;
    pub(crate) const SCHEMA: u8 = 0x03;
    pub(crate) const CHANNEL: u8 = 0x04;
    pub(crate) const MESSAGE: u8 = 0x05;
    pub(crate) const CHUNK: u8 = 0x06;
    pub(crate) const MESSAGE_INDEX: u8 = 0x07;
    pub(crate) const CHUNK_INDEX: u8 = 0x08;
    pub(crate) const STATISTICS: u8 = 0x0B;
    pub(crate) const DATA_END: u8 = 0x0F;
    pub(crate) const SUMMARY_OFFSET: u8 = 0x0E;
}

/// Where a record is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Place {
    /// Offset in the file: of the record, or of the chunk that holds it.
    pub offset: u64,
    /// Offset in the decompressed chunk.
    pub in_chunk: Option<u64>,
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.in_chunk {
            Some(at) => write!(f, "byte {at} of the chunk at byte {}", self.offset),
            None => write!(f, "byte {}", self.offset),
        }
    }
}

/// Something in a log that cannot be used.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Problem {
    /// Where it is; `None` for the log as a whole.
    pub place: Option<Place>,
    /// The topic, if it is about a message.
    pub topic: Option<String>,
    /// What was found and what was expected.
    pub text: String,
}

impl fmt::Display for Problem {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(place) = &self.place {
            write!(f, "{place}: ")?;
        }
        if let Some(topic) = &self.topic {
            write!(f, "{topic}: ")?;
        }
        f.write_str(&self.text)
    }
}

/// The definition of a type of messages.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct SchemaRecord {
    /// Its name, such as `sensor_msgs/msg/CameraInfo`.
    pub name: String,
    /// What the definition is written in, such as `ros2msg`.
    pub encoding: String,
    /// The definition.
    pub data: Vec<u8>,
}

/// A topic.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Channel {
    /// The number by which messages name it.
    pub id: u16,
    /// Its name.
    pub topic: String,
    /// How messages are encoded, such as `cdr`.
    pub encoding: String,
    /// The type of its messages; `None` if it has none.
    pub schema: Option<Arc<SchemaRecord>>,
}

/// A message.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Message {
    /// The topic.
    pub channel: Arc<Channel>,
    /// Where it is.
    pub place: Place,
    /// When it was recorded, in nanoseconds.
    pub log_time: u64,
    /// Its content.
    pub data: Vec<u8>,
}

/// What comes next in a log.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Item {
    /// A message of a channel that is wanted.
    Message(Message),
    /// Something that cannot be used.
    Problem(Problem),
}

/// Whether the messages of a channel are wanted.
pub(super) type Filter = Box<dyn FnMut(&Channel) -> bool + Send>;

/// Reads the records of a log.
pub(super) struct LogReader<R> {
    input: R,
    /// Of the next record.
    offset: u64,
    length: u64,
    chunk: Option<Chunk>,
    schemas: BTreeMap<u16, Arc<SchemaRecord>>,
    channels: BTreeMap<u16, Known>,
    /// Ids that messages name and that no channel has, so that each is reported once.
    unknown: BTreeSet<u16>,
    filter: Filter,
    is_over: bool,
}

/// A channel, whether its messages are wanted, and how many there were.
struct Known {
    channel: Arc<Channel>,
    is_wanted: bool,
    messages: u64,
}

/// A chunk without its compression.
struct Chunk {
    offset: u64,
    bytes: Vec<u8>,
    at: usize,
}

impl<R: Read + Seek> LogReader<R> {
    /// Reads from the beginning. The error is a text if this is no MCAP file.
    pub(super) fn new(mut input: R, filter: Filter) -> io::Result<Result<Self, String>> {
        let length = input.seek(SeekFrom::End(0))?;
        input.seek(SeekFrom::Start(0))?;
        let mut magic = Vec::new();
        (&mut input).take(8).read_to_end(&mut magic)?;
        if magic != MAGIC {
            return Ok(Err(match &*magic {
                [] => "the file is empty".to_owned(),
                _ if magic.starts_with(b"#ROSBAG") => {
                    "this is a ROS 1 bag; `rosbags-convert --src LOG.bag --dst log --dst-storage mcap` converts it"
                        .to_owned()
                }
                _ if magic.starts_with(b"SQLite") => {
                    "this is a ROS 2 bag in SQLite (.db3); `rosbags-convert --src BAG --dst log \
                     --dst-storage mcap` converts it"
                        .to_owned()
                }
                _ if magic.starts_with(&MAGIC[..5]) => {
                    "this version of MCAP is not supported; expected version 0".to_owned()
                }
                _ => "this is no MCAP file: it does not begin with \\x89MCAP0".to_owned(),
            }));
        }
        Ok(Ok(Self {
            input,
            offset: 8,
            length,
            chunk: None,
            schemas: BTreeMap::new(),
            channels: BTreeMap::new(),
            unknown: BTreeSet::new(),
            filter,
            is_over: false,
        }))
    }

    /// The channels so far, with the numbers of their messages.
    pub(super) fn channels(&self) -> impl Iterator<Item = (&Channel, u64)> {
        self.channels.values().map(|known| (&*known.channel, known.messages))
    }

    /// The next message or problem; `None` at the end.
    ///
    /// # Errors
    /// What the system says.
    pub(super) fn next_item(&mut self) -> io::Result<Option<Item>> {
        loop {
            if let Some(mut chunk) = self.chunk.take() {
                if let Some(item) = self.in_chunk(&mut chunk) {
                    self.chunk = Some(chunk);
                    return Ok(Some(item));
                }
                continue;
            }
            if self.is_over {
                return Ok(None);
            }
            if let Some(item) = self.top_level()? {
                return Ok(Some(item));
            }
        }
    }

    /// The next item of a chunk; `None` at its end.
    fn in_chunk(&mut self, chunk: &mut Chunk) -> Option<Item> {
        loop {
            let start = chunk.at;
            let rest = chunk.bytes.get(start..)?;
            if rest.is_empty() {
                return None;
            }
            let place = Place { offset: chunk.offset, in_chunk: Some(start as u64) };
            let mut fields = Fields(rest);
            let record = (fields.u8()).zip(fields.u64()).and_then(|(opcode, length)| {
                let length = usize::try_from(length).ok()?;
                Some((opcode, fields.bytes(length)?, 9 + length))
            });
            let Some((opcode, content, size)) = record else {
                chunk.at = chunk.bytes.len();
                let text = "the record does not end with its chunk; the rest of the chunk is left out";
                return Some(problem(place, text));
            };
            chunk.at = start + size;
            if let Some(item) = self.record(opcode, content, place) {
                return Some(item);
            }
        }
    }

    /// Reads the next record of the file.
    fn top_level(&mut self) -> io::Result<Option<Item>> {
        let place = Place { offset: self.offset, in_chunk: None };
        let left = self.length.saturating_sub(self.offset);
        let mut head = [0; 9];
        if left < 9 {
            self.is_over = true;
            return Ok(Some(problem(place, "the file ends without an end record: its recording was cut off")));
        }
        self.input.seek(SeekFrom::Start(self.offset))?;
        self.input.read_exact(&mut head)?;
        let mut fields = Fields(&head);
        let (opcode, size) = (fields.u8().unwrap_or_default(), fields.u64().unwrap_or_default());
        if opcode == 0 || size > left - 9 {
            return self.recover(place, opcode, size, left - 9);
        }
        self.offset += 9 + size;
        if size > MAX_CHUNK && matches!(opcode, opcode::SCHEMA..=opcode::CHUNK) {
            let text = format!("the record has {size} bytes, more than {MAX_CHUNK}; it is left out");
            return Ok(Some(problem(place, text)));
        }
        match opcode {
            opcode::DATA_END | opcode::FOOTER => {
                self.is_over = true;
                Ok(None)
            }
            opcode::CHUNK => {
                let content = self.content(size)?;
                match chunk(&content) {
                    Ok(bytes) => {
                        self.chunk = Some(Chunk { offset: place.offset, bytes, at: 0 });
                        Ok(None)
                    }
                    Err(text) => Ok(Some(problem(place, text))),
                }
            }
            opcode::SCHEMA | opcode::CHANNEL | opcode::MESSAGE => {
                let content = self.content(size)?;
                Ok(self.record(opcode, &content, place))
            }
            // Indices, attachments, metadata, and what future versions add.
            _ => Ok(None),
        }
    }

    fn content(&mut self, size: u64) -> io::Result<Vec<u8>> {
        let mut content = Vec::new();
        (&mut self.input).take(size).read_to_end(&mut content)?;
        Ok(content)
    }

    /// Goes on with the next chunk of the index at the end of the file.
    fn recover(&mut self, place: Place, opcode: u8, size: u64, left: u64) -> io::Result<Option<Item>> {
        let next = self.chunk_offsets()?.into_iter().find(|&offset| offset > place.offset);
        let mut text = match opcode {
            0 => "the record has the type 0, which does not exist".to_owned(),
            _ => format!("the record (type {opcode:#04x}) should have {size} bytes; the file has {left} more"),
        };
        match next {
            Some(next) => {
                text.push_str(&format!("; reading goes on with the chunk at byte {next}"));
                self.offset = next;
            }
            None => {
                text.push_str("; the file was cut off or is damaged, and the rest of it is left out");
                self.is_over = true;
            }
        }
        Ok(Some(problem(place, text)))
    }

    /// Where the chunks begin, as the index says; none if there is no index.
    fn chunk_offsets(&mut self) -> io::Result<Vec<u64>> {
        // Footer: opcode, length, start of the summary, start of the offsets, checksum; then the magic.
        const FOOTER: u64 = 9 + 20 + 8;
        let Some(footer) = self.length.checked_sub(FOOTER) else { return Ok(Vec::new()) };
        self.input.seek(SeekFrom::Start(footer))?;
        let bytes = self.content(FOOTER)?;
        let mut fields = Fields(&bytes);
        let start = match (fields.u8(), fields.u64(), fields.u64()) {
            (Some(opcode::FOOTER), Some(20), Some(start)) if start > 0 && start < footer => start,
            _ => return Ok(Vec::new()),
        };
        self.input.seek(SeekFrom::Start(start))?;
        let summary = self.content(footer - start)?;
        let mut fields = Fields(&summary);
        let mut offsets = Vec::new();
        while let (Some(opcode), Some(size)) = (fields.u8(), fields.u64()) {
            let Some(content) = usize::try_from(size).ok().and_then(|size| fields.bytes(size)) else { break };
            let mut content = Fields(content);
            if opcode == opcode::CHUNK_INDEX
                && let (Some(_), Some(_), Some(offset)) = (content.u64(), content.u64(), content.u64())
            {
                offsets.push(offset);
            }
        }
        offsets.sort_unstable();
        Ok(offsets)
    }

    /// Takes in a record; what is to be told of it.
    fn record(&mut self, opcode: u8, content: &[u8], place: Place) -> Option<Item> {
        let mut fields = Fields(content);
        match opcode {
            opcode::SCHEMA => match schema(&mut fields) {
                Some((0, _)) => Some(problem(place, "the schema has the number 0, which means none")),
                Some((id, schema)) => {
                    self.schemas.insert(id, Arc::new(schema));
                    None
                }
                None => Some(problem(place, "the schema record ends too early")),
            },
            opcode::CHANNEL => self.channel(&mut fields, place),
            opcode::MESSAGE => self.message(&mut fields, place),
            _ => None,
        }
    }

    fn channel(&mut self, fields: &mut Fields, place: Place) -> Option<Item> {
        let record = (|| {
            let (id, schema) = (fields.u16()?, fields.u16()?);
            Some((id, schema, fields.text()?, fields.text()?))
        })();
        let Some((id, schema_id, topic, encoding)) = record else {
            return Some(problem(place, "the channel record ends too early"));
        };
        let schema = self.schemas.get(&schema_id).cloned();
        let is_missing = schema.is_none() && schema_id != 0;
        let channel = Channel { id, topic, encoding, schema };
        if self.channels.get(&id).is_some_and(|known| *known.channel == channel) {
            return None;
        }
        let item = is_missing.then(|| {
            let text = format!("its schema, number {schema_id}, is missing in the file: its messages cannot be read");
            Item::Problem(Problem { place: Some(place), topic: Some(channel.topic.clone()), text })
        });
        let is_wanted = (self.filter)(&channel);
        self.channels.insert(id, Known { channel: Arc::new(channel), is_wanted, messages: 0 });
        item
    }

    fn message(&mut self, fields: &mut Fields, place: Place) -> Option<Item> {
        let head = (|| {
            let (id, _sequence, log_time, _publish_time) = (fields.u16()?, fields.u32()?, fields.u64()?, fields.u64()?);
            Some((id, log_time))
        })();
        let Some((id, log_time)) = head else { return Some(problem(place, "the message record ends too early")) };
        match self.channels.get_mut(&id) {
            Some(known) => {
                known.messages += 1;
                known.is_wanted.then(|| {
                    let (channel, data) = (known.channel.clone(), fields.0.to_vec());
                    Item::Message(Message { channel, place, log_time, data })
                })
            }
            None => {
                let text = format!("messages name the channel {id}, which the file does not have");
                self.unknown.insert(id).then(|| problem(place, text))
            }
        }
    }
}

fn problem(place: Place, text: impl Into<String>) -> Item {
    Item::Problem(Problem { place: Some(place), topic: None, text: text.into() })
}

fn schema(fields: &mut Fields) -> Option<(u16, SchemaRecord)> {
    let (id, name, encoding) = (fields.u16()?, fields.text()?, fields.text()?);
    let length = fields.u32()? as usize;
    Some((id, SchemaRecord { name, encoding, data: fields.bytes(length)?.to_vec() }))
}

/// The records of a chunk, or what is wrong with it.
fn chunk(content: &[u8]) -> Result<Vec<u8>, String> {
    let mut fields = Fields(content);
    let head = (|| {
        let (_start, _end, size, checksum) = (fields.u64()?, fields.u64()?, fields.u64()?, fields.u32()?);
        let compression = fields.text()?;
        let length = usize::try_from(fields.u64()?).ok()?;
        Some((size, checksum, compression, fields.bytes(length)?))
    })();
    let Some((size, checksum, compression, bytes)) = head else {
        return Err("the chunk record ends too early; the chunk is left out".to_owned());
    };
    if size > MAX_CHUNK {
        return Err(format!("the chunk should have {size} bytes, more than {MAX_CHUNK}; it is left out"));
    }
    let damaged = |what: &dyn fmt::Display| format!("the chunk is damaged ({compression}: {what}); it is left out");
    // One byte more than promised, which tells that the promise is wrong.
    let mut records = Vec::new();
    let mut read = |input: &mut dyn Read| input.take(size + 1).read_to_end(&mut records).map(drop);
    match &*compression {
        "" => records.extend_from_slice(bytes),
        "lz4" => read(&mut lz4_flex::frame::FrameDecoder::new(bytes)).map_err(|error| damaged(&error))?,
        "zstd" => {
            let decoder = ruzstd::decoding::StreamingDecoder::new(bytes);
            read(&mut decoder.map_err(|error| damaged(&error))?).map_err(|error| damaged(&error))?;
        }
        other => {
            return Err(format!(
                "the chunk has the compression \"{other}\"; expected lz4, zstd or none; it is left out"
            ));
        }
    }
    if records.len() as u64 != size {
        let found = if records.len() as u64 > size { "more" } else { &*records.len().to_string() };
        return Err(format!("the chunk should have {size} bytes, and {found} were found; it is left out"));
    }
    if checksum != 0 && crc32fast::hash(&records) != checksum {
        return Err("the chunk is damaged: its checksum is wrong; it is left out".to_owned());
    }
    Ok(records)
}

/// The fields of a record that are still to be read.
struct Fields<'a>(&'a [u8]);

impl<'a> Fields<'a> {
    fn bytes(&mut self, count: usize) -> Option<&'a [u8]> {
        let (taken, rest) = self.0.split_at_checked(count)?;
        self.0 = rest;
        Some(taken)
    }

    fn array<const N: usize>(&mut self) -> Option<[u8; N]> {
        self.bytes(N)?.try_into().ok()
    }

    fn u8(&mut self) -> Option<u8> {
        self.array::<1>().map(|[byte]| byte)
    }

    fn u16(&mut self) -> Option<u16> {
        self.array().map(u16::from_le_bytes)
    }

    fn u32(&mut self) -> Option<u32> {
        self.array().map(u32::from_le_bytes)
    }

    fn u64(&mut self) -> Option<u64> {
        self.array().map(u64::from_le_bytes)
    }

    fn text(&mut self) -> Option<String> {
        let length = self.u32()? as usize;
        self.bytes(length).map(|bytes| String::from_utf8_lossy(bytes).into_owned())
    }
}
