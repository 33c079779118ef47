//! A finished recording made smaller without loss: point clouds packed, chunks larger and compressed.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use cosplat_files::{NewFile, keep_apart};
use mcap::records::{MessageHeader, Record, op};
use serde::Serialize;

use crate::RecordingError;
use crate::file_records::FileRecords;
use crate::packed::{ENCODING, Points};
use crate::records;
use crate::topics::{GAUSSIANS_TOPIC, PLACES_TOPIC, object_of};
use crate::writer::{Mcap, begin, existing};

/// Frames in a chunk, which can be read by itself.
const CHUNK_FRAMES: u32 = 64;
/// Bytes in a chunk, after which it ends with the frame.
const CHUNK_BYTES: u64 = 128 << 20;
/// Level of compression: what it takes is offline.
const LEVEL: u32 = 6;

/// Records that are written anew; all else indexes and sums up these.
const COPIED: [u8; 5] = [
    op::SCHEMA,
    op::CHANNEL,
    op::MESSAGE,
    op::METADATA,
    op::ATTACHMENT,
];

/// What came of it.
#[derive(Clone, Debug, Serialize)]
pub struct CompactReport {
    /// The recording.
    pub input: PathBuf,
    /// The smaller one.
    pub output: PathBuf,
    /// Size of the recording [byte].
    pub bytes_before: u64,
    /// Size of the smaller one [byte].
    pub bytes_after: u64,
    /// The former over the latter.
    pub ratio: f64,
    /// Frames.
    pub frames: u64,
    /// Messages, each compared with its original after it was read back.
    pub messages: u64,
}

/// Writes `input` smaller to `output`, reads that back and compares every message, attachment and metadata record byte for byte.
/// `progress` is told how many bytes of how many are written, then compared.
///
/// # Errors
/// When `input` is damaged or unfinished, or `output` is the same file, exists without `overwrite`, cannot be written, or does
/// not come back as it was; then what was there is as it was.
pub fn compact(
    input: &Path,
    output: &Path,
    overwrite: bool,
    mut progress: impl FnMut(u64, u64),
) -> Result<CompactReport, RecordingError> {
    keep_apart(output, [input])?;
    let size = |path: &Path| {
        std::fs::metadata(path)
            .map(|file| file.len())
            .map_err(|e| RecordingError::open(path, e))
    };
    let total = 2 * size(input)?;
    let mut source = Source::open(input)?;
    let new = NewFile::create(output, existing(overwrite))
        .map_err(|e| RecordingError::open(output, e))?;
    let (mcap, _) = begin(&new, Some((mcap::Compression::Zstd, LEVEL)), "")?;
    let mut compactor = Compactor {
        mcap,
        points: Points::default(),
        packed: BTreeMap::new(),
        frames_in_chunk: 0,
        bytes_in_chunk: 0,
        frames: 0,
    };
    let failed = |e| RecordingError::write(output, e);
    while let Some(item) = source.next()? {
        compactor.take(item).map_err(failed)?;
        progress(source.records.position, total);
    }
    compactor.mcap.finish().map_err(failed)?;
    // What does not come back as it was gets no name by which it would be taken for the recording.
    let messages = compare(input, new.path(), |at| progress(total / 2 + at, total))?;
    new.finish().map_err(|e| failed(e.into()))?;
    let (bytes_before, bytes_after) = (size(input)?, size(output)?);
    Ok(CompactReport {
        input: input.into(),
        output: output.into(),
        bytes_before,
        bytes_after,
        ratio: bytes_before as f64 / bytes_after.max(1) as f64,
        frames: compactor.frames,
        messages,
    })
}

/// Reads both files and counts messages that are the same.
fn compare(
    input: &Path,
    output: &Path,
    mut progress: impl FnMut(u64),
) -> Result<u64, RecordingError> {
    let (mut one, mut other) = (Source::open(input)?, Source::open(output)?);
    let mut messages = 0;
    loop {
        let (before, after) = (one.content()?, other.content()?);
        if before != after {
            let path = output.to_owned();
            return Err(RecordingError::NotTheSame { path, messages });
        }
        let Some(item) = before else {
            return Ok(messages);
        };
        messages += u64::from(matches!(item, Item::Message { .. }));
        progress(one.records.position);
    }
}

/// A record of a recording, with point clouds unpacked.
#[derive(PartialEq)]
enum Item {
    Schema {
        id: u16,
        name: String,
        encoding: String,
        data: Vec<u8>,
    },
    Channel(mcap::records::Channel),
    Message {
        header: MessageHeader,
        topic: String,
        data: Vec<u8>,
    },
    Metadata(mcap::records::Metadata),
    Attachment {
        header: mcap::records::AttachmentHeader,
        data: Vec<u8>,
    },
}

/// The records of a file, in its order, every checksum verified.
struct Source {
    records: FileRecords,
    /// Topic of each channel, and whether its messages are packed.
    channels: BTreeMap<u16, (String, bool)>,
    points: Points,
}

impl Source {
    fn open(path: &Path) -> Result<Self, RecordingError> {
        Ok(Self {
            records: FileRecords::open(path)?,
            channels: BTreeMap::new(),
            points: Points::default(),
        })
    }

    /// The next record that is no schema and no channel.
    fn content(&mut self) -> Result<Option<Item>, RecordingError> {
        loop {
            match self.next()? {
                Some(Item::Schema { .. } | Item::Channel(_)) => {}
                other => return Ok(other),
            }
        }
    }

    fn next(&mut self) -> Result<Option<Item>, RecordingError> {
        let path = self.records.path.clone();
        let (channels, points) = (&mut self.channels, &mut self.points);
        self.records.find(|opcode, data| {
            if !COPIED.contains(&opcode) {
                return Ok(None);
            }
            let record =
                records::parse(opcode, data).map_err(|e| RecordingError::damaged(&path, e))?;
            item(record, channels, points).map_err(|why| RecordingError::Message {
                path: path.clone(),
                topic: GAUSSIANS_TOPIC.into(),
                sequence: 0,
                why,
            })
        })
    }
}

fn item(
    record: Record,
    channels: &mut BTreeMap<u16, (String, bool)>,
    points: &mut Points,
) -> Result<Option<Item>, String> {
    Ok(Some(match record {
        Record::Schema { header, data } => Item::Schema {
            id: header.id,
            name: header.name,
            encoding: header.encoding,
            data: data.into_owned(),
        },
        Record::Channel(channel) => {
            let is_packed = channel.message_encoding == ENCODING;
            channels.insert(channel.id, (channel.topic.clone(), is_packed));
            Item::Channel(channel)
        }
        Record::Message { header, data } => {
            let (topic, is_packed) = channels
                .get(&header.channel_id)
                .cloned()
                .unwrap_or_default();
            let data = match is_packed {
                true => points.unpack(header.channel_id, &data)?.into_owned(),
                false => data.into_owned(),
            };
            Item::Message {
                header,
                topic,
                data,
            }
        }
        Record::Metadata(record) => Item::Metadata(record),
        Record::Attachment { header, data, .. } => Item::Attachment {
            header,
            data: data.into_owned(),
        },
        _ => return Ok(None),
    }))
}

struct Compactor {
    mcap: Mcap,
    points: Points,
    /// Channels whose messages are packed.
    packed: BTreeMap<u16, bool>,
    frames_in_chunk: u32,
    bytes_in_chunk: u64,
    frames: u64,
}

impl Compactor {
    fn take(&mut self, item: Item) -> mcap::McapResult<()> {
        match item {
            Item::Schema {
                id,
                name,
                encoding,
                data,
            } => self
                .mcap
                .add_schema_with_id(id, &name, &encoding, &data)
                .map(drop),
            Item::Channel(channel) => {
                let is_packed =
                    channel.topic == GAUSSIANS_TOPIC || object_of(&channel.topic).is_some();
                let encoding = if is_packed {
                    ENCODING
                } else {
                    &channel.message_encoding
                };
                self.packed.insert(channel.id, is_packed);
                let added = self.mcap.add_channel_with_id(
                    channel.id,
                    channel.schema_id,
                    &channel.topic,
                    encoding,
                    &channel.metadata,
                );
                added.map(drop)
            }
            Item::Message {
                header,
                topic,
                data,
            } => self.message(&header, &topic, &data),
            Item::Metadata(record) => {
                self.end_chunk()?;
                self.mcap.write_metadata(&record)
            }
            Item::Attachment { header, data } => {
                self.end_chunk()?;
                self.mcap.start_attachment(data.len() as u64, header)?;
                self.mcap.put_attachment_bytes(&data)?;
                self.mcap.finish_attachment()
            }
        }
    }

    fn message(
        &mut self,
        header: &MessageHeader,
        topic: &str,
        data: &[u8],
    ) -> mcap::McapResult<()> {
        let id = header.channel_id;
        let data = match self.packed.get(&id) {
            Some(true) => Cow::Owned(self.points.pack(id, data)),
            _ => Cow::Borrowed(data),
        };
        self.bytes_in_chunk += data.len() as u64;
        self.mcap.write_to_known_channel(header, &data)?;
        if topic == GAUSSIANS_TOPIC || topic == PLACES_TOPIC {
            self.frames += 1;
            self.frames_in_chunk += 1;
            if self.frames_in_chunk >= CHUNK_FRAMES || self.bytes_in_chunk >= CHUNK_BYTES {
                self.end_chunk()?;
            }
        }
        Ok(())
    }

    /// The next chunk can be read by itself.
    fn end_chunk(&mut self) -> mcap::McapResult<()> {
        self.points.clear();
        (self.frames_in_chunk, self.bytes_in_chunk) = (0, 0);
        self.mcap.flush()
    }
}
