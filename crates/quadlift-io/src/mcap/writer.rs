//! Writes MCAP: messages in chunks with lz4, indices and statistics at the end.

use std::collections::BTreeMap;

use super::container::{MAGIC, opcode};

/// Bytes of messages after which a chunk is written.
const CHUNK: usize = 1 << 20;

/// Quality of service of topics whose last message late subscribers get, by the numbers that all versions of rosbag2 read:
/// keep last, reliable, transient local, no deadlines.
const LATCHED: &str = "- history: 1\n  depth: 1\n  reliability: 1\n  durability: 1\n  \
    deadline:\n    sec: 9223372036\n    nsec: 854775807\n  lifespan:\n    sec: 9223372036\n    nsec: 854775807\n  \
    liveliness: 1\n  liveliness_lease_duration:\n    sec: 9223372036\n    nsec: 854775807\n  \
    avoid_ros_namespace_conventions: false\n";

/// Writes a log into memory. Messages are given in the order of their times.
#[derive(Debug)]
pub(crate) struct LogWriter {
    bytes: Vec<u8>,
    /// Contents of the schema records, by their ids from 1.
    schemas: Vec<(String, Vec<u8>)>,
    /// Contents of the channel records, by their ids from 0, and numbers of messages.
    channels: Vec<(Vec<u8>, u64)>,
    chunk: Vec<u8>,
    /// For each channel the times and places of its messages in the chunk.
    in_chunk: BTreeMap<u16, Vec<(u64, u64)>>,
    /// Contents of the chunk index records.
    indices: Vec<Vec<u8>>,
    times: Option<[u64; 2]>,
    chunk_times: Option<[u64; 2]>,
}

fn text(text: &str) -> Vec<u8> {
    [&(text.len() as u32).to_le_bytes(), text.as_bytes()].concat()
}

fn record(out: &mut Vec<u8>, opcode: u8, content: &[u8]) {
    out.push(opcode);
    out.extend((content.len() as u64).to_le_bytes());
    out.extend(content);
}

fn widen(times: &mut Option<[u64; 2]>, time: u64) {
    let [first, last] = times.unwrap_or([time; 2]);
    *times = Some([first.min(time), last.max(time)]);
}

impl LogWriter {
    /// A log of ROS 2.
    pub(crate) fn new() -> Self {
        let mut bytes = MAGIC.to_vec();
        record(&mut bytes, opcode::HEADER, &[text("ros2"), text("quadlift")].concat());
        Self {
            bytes,
            schemas: Vec::new(),
            channels: Vec::new(),
            chunk: Vec::new(),
            in_chunk: BTreeMap::new(),
            indices: Vec::new(),
            times: None,
            chunk_times: None,
        }
    }

    /// A topic of CDR messages of a type with this definition (`ros2msg`); `latched`: late subscribers get the last message.
    pub(crate) fn channel(&mut self, topic: &str, schema: &str, definition: &str, latched: bool) -> u16 {
        let known = self.schemas.iter().position(|(name, _)| name == schema);
        let index = known.unwrap_or_else(|| {
            let id = self.schemas.len() as u16 + 1;
            let content = [&id.to_le_bytes()[..], &text(schema), &text("ros2msg"), &text(definition)].concat();
            record(&mut self.chunk, opcode::SCHEMA, &content);
            self.schemas.push((schema.to_owned(), content));
            self.schemas.len() - 1
        });
        let id = self.channels.len() as u16;
        let metadata = if latched { [text("offered_qos_profiles"), text(LATCHED)].concat() } else { Vec::new() };
        let mut content = [id.to_le_bytes(), (index as u16 + 1).to_le_bytes()].concat();
        content.extend([text(topic), text("cdr"), (metadata.len() as u32).to_le_bytes().to_vec(), metadata].concat());
        record(&mut self.chunk, opcode::CHANNEL, &content);
        self.channels.push((content, 0));
        id
    }

    /// Adds a message, with its time in nanoseconds.
    pub(crate) fn message(&mut self, channel: u16, time: u64, data: &[u8]) {
        let Some((_, messages)) = self.channels.get_mut(usize::from(channel)) else { return };
        let sequence = *messages as u32;
        *messages += 1;
        widen(&mut self.times, time);
        widen(&mut self.chunk_times, time);
        self.in_chunk.entry(channel).or_default().push((time, self.chunk.len() as u64));
        let head = [&channel.to_le_bytes()[..], &sequence.to_le_bytes(), &time.to_le_bytes(), &time.to_le_bytes()];
        record(&mut self.chunk, opcode::MESSAGE, &[&head.concat(), data].concat());
        if self.chunk.len() >= CHUNK {
            self.end_chunk();
        }
    }

    /// Writes the messages so far as a chunk.
    pub(crate) fn end_chunk(&mut self) {
        let records = std::mem::take(&mut self.chunk);
        if records.is_empty() {
            return;
        }
        let mut encoder = lz4_flex::frame::FrameEncoder::new(Vec::new());
        // Into memory: nothing that could fail.
        let _ = std::io::Write::write_all(&mut encoder, &records);
        let compressed = encoder.finish().unwrap_or_default();
        let [first, last] = self.chunk_times.take().unwrap_or_default();
        let times = [first.to_le_bytes(), last.to_le_bytes()].concat();
        let sizes = [compressed.len() as u64, records.len() as u64].map(u64::to_le_bytes);
        let head = [&times[..], &sizes[1], &crc32fast::hash(&records).to_le_bytes(), &text("lz4"), &sizes[0]].concat();
        let start = self.bytes.len() as u64;
        record(&mut self.bytes, opcode::CHUNK, &[head, compressed].concat());
        let end = self.bytes.len() as u64;
        let mut places = Vec::new();
        for (channel, messages) in std::mem::take(&mut self.in_chunk) {
            places.extend(channel.to_le_bytes());
            places.extend((self.bytes.len() as u64).to_le_bytes());
            let entries: Vec<u8> =
                messages.iter().flat_map(|(time, at)| [time.to_le_bytes(), at.to_le_bytes()].concat()).collect();
            let content = [&channel.to_le_bytes()[..], &(entries.len() as u32).to_le_bytes(), &entries].concat();
            record(&mut self.bytes, opcode::MESSAGE_INDEX, &content);
        }
        let index_length = self.bytes.len() as u64 - end;
        let index = [
            &times[..],
            &start.to_le_bytes(),
            &(end - start).to_le_bytes(),
            &(places.len() as u32).to_le_bytes(),
            &places,
            &index_length.to_le_bytes(),
            &text("lz4"),
            &sizes[0],
            &sizes[1],
        ];
        self.indices.push(index.concat());
    }

    /// The file.
    pub(crate) fn finish(mut self) -> Vec<u8> {
        self.end_chunk();
        let Self { mut bytes, schemas, channels, indices, times, .. } = self;
        record(&mut bytes, opcode::DATA_END, &0_u32.to_le_bytes());
        let summary = bytes.len() as u64;
        let [first, last] = times.unwrap_or_default();
        let counts: Vec<u8> = (0_u16..)
            .zip(&channels)
            .flat_map(|(id, (_, messages))| [&id.to_le_bytes()[..], &messages.to_le_bytes()].concat())
            .collect();
        let statistics = [
            &channels.iter().map(|(_, messages)| messages).sum::<u64>().to_le_bytes()[..],
            &(schemas.len() as u16).to_le_bytes(),
            &(channels.len() as u32).to_le_bytes(),
            &0_u32.to_le_bytes(),
            &0_u32.to_le_bytes(),
            &(indices.len() as u32).to_le_bytes(),
            &first.to_le_bytes(),
            &last.to_le_bytes(),
            &(counts.len() as u32).to_le_bytes(),
            &counts,
        ];
        let groups = [
            (opcode::SCHEMA, schemas.into_iter().map(|(_, content)| content).collect()),
            (opcode::CHANNEL, channels.into_iter().map(|(content, _)| content).collect()),
            (opcode::STATISTICS, vec![statistics.concat()]),
            (opcode::CHUNK_INDEX, indices),
        ];
        let mut offsets = Vec::new();
        for (opcode, contents) in groups {
            let start = bytes.len() as u64;
            contents.iter().for_each(|content: &Vec<u8>| record(&mut bytes, opcode, content));
            let length = bytes.len() as u64 - start;
            if length > 0 {
                let content = [&[opcode][..], &start.to_le_bytes(), &length.to_le_bytes()].concat();
                record(&mut offsets, opcode::SUMMARY_OFFSET, &content);
            }
        }
        let offsets_start = bytes.len() as u64;
        bytes.extend(offsets);
        // The checksum is that of the summary and of the footer's first fields.
        let head = [&[opcode::FOOTER][..], &20_u64.to_le_bytes(), &summary.to_le_bytes(), &offsets_start.to_le_bytes()];
        bytes.extend(head.concat());
        let checksum = bytes.get(summary as usize..).map_or(0, crc32fast::hash);
        bytes.extend(checksum.to_le_bytes());
        bytes.extend(MAGIC);
        bytes
    }
}
