//! A finished recording read back in file order, every checksum verified.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{Read, Seek};
use std::path::{Path, PathBuf};

use cosplat_ipc::schema::{FrameHeader, GaussianState, ObjectState, ObjectsHeader};
use mcap::records::{MessageHeader, Record, op};
use mcap::sans_io::linear_reader::{LinearReadEvent, LinearReader, LinearReaderOptions};
use serde::Serialize;
use serde::de::DeserializeOwned;

use crate::RecordingError;
use crate::messages::{
    BoardRecord, GapRecord, JournalEntry, JournalRecord, ObjectsRecord, StatusRecord,
};
use crate::point_cloud;
use crate::records;
use crate::topics::*;

/// Largest record or chunk read [bytes]: a damaged length must not fill the memory.
pub(crate) const LENGTH_LIMIT: usize = 4 << 30;

/// Most bytes read at once: a damaged length must not reserve more than the file has.
pub(crate) const READ_LIMIT: usize = 16 << 20;

/// Records that make [`Event`]s.
pub(crate) const DECODED: [u8; 4] = [op::CHANNEL, op::MESSAGE, op::METADATA, op::ATTACHMENT];

/// One frame of a recording.
#[derive(Clone, Debug, PartialEq)]
pub struct RecordedFrame {
    /// Its header as it was published.
    pub header: FrameHeader,
    /// Its Gaussians as they were published.
    pub gaussians: Vec<GaussianState>,
    /// The status board as it was read with the frame.
    pub board: Option<BoardRecord>,
    /// Time of the frame in the file [ns].
    pub log_time: u64,
}

/// What a recording holds, in file order.
#[derive(Clone, Debug, PartialEq)]
pub enum Event {
    /// A metadata record; [`RUN_METADATA`] opens a scene epoch.
    Metadata {
        /// Name of the record.
        name: String,
        /// Its entries.
        values: BTreeMap<String, String>,
    },
    /// An attachment.
    Attachment {
        /// Its name, as in [`topics`](crate::topics).
        name: String,
        /// Its content.
        data: Vec<u8>,
    },
    /// A frame.
    Frame(Box<RecordedFrame>),
    /// The objects of a step.
    Objects(ObjectsHeader, Vec<ObjectState>),
    /// A command as it was applied.
    Journal(JournalEntry),
    /// Missing steps.
    Gap(GapRecord),
}

/// What the messages of a topic come to.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Traffic {
    /// Messages.
    pub messages: u64,
    /// Their bytes.
    pub bytes: u64,
}

/// Iterator over the [`Event`]s of a finished recording; ends after the first error.
pub struct Recording {
    path: PathBuf,
    file: File,
    reader: LinearReader,
    decoder: Decoder,
    failed: bool,
}

impl Recording {
    /// Opens a recording.
    ///
    /// # Errors
    /// When the file cannot be opened or is no MCAP file.
    pub fn open(path: &Path) -> Result<Self, RecordingError> {
        Ok(Self {
            path: path.to_owned(),
            file: open_mcap(path)?,
            reader: LinearReader::new_with_options(
                LinearReaderOptions::default()
                    .with_prevalidate_chunk_crcs(true)
                    .with_validate_data_section_crc(true)
                    .with_validate_summary_section_crc(true)
                    .with_record_length_limit(LENGTH_LIMIT),
            ),
            decoder: Decoder::default(),
            failed: false,
        })
    }

    /// Leaves the Gaussians out of [`Event::Frame`]: for those who look at headers only.
    #[must_use]
    pub fn without_gaussians(mut self) -> Self {
        self.decoder.skips_gaussians = true;
        self
    }

    /// What was read so far, by topic.
    pub fn traffic(&self) -> &BTreeMap<String, Traffic> {
        &self.decoder.traffic
    }

    fn advance(&mut self) -> Result<Option<Event>, RecordingError> {
        let damaged = |e: mcap::McapError| RecordingError::damaged(&self.path, e);
        while let Some(event) = self.reader.next_event() {
            match event.map_err(damaged)? {
                LinearReadEvent::ReadRequest(need) => {
                    let buffer = self.reader.insert(need.min(READ_LIMIT));
                    let read = self.file.read(buffer).map_err(|e| damaged(e.into()))?;
                    self.reader.notify_read(read);
                }
                LinearReadEvent::Record { data, opcode } => {
                    // What else there is indexes and sums up these.
                    if !DECODED.contains(&opcode) {
                        continue;
                    }
                    let record = records::parse(opcode, data).map_err(damaged)?;
                    if let Some(event) =
                        self.decoder.decode(record).map_err(|m| m.at(&self.path))?
                    {
                        return Ok(Some(event));
                    }
                }
            }
        }
        Ok(None)
    }
}

impl Iterator for Recording {
    type Item = Result<Event, RecordingError>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.failed {
            return None;
        }
        let event = self.advance().transpose();
        self.failed = matches!(event, None | Some(Err(_)));
        event
    }
}

/// Opens `path` at its first byte, after a look at the magic bytes.
pub(crate) fn open_mcap(path: &Path) -> Result<File, RecordingError> {
    let open = |e| RecordingError::open(path, e);
    let mut file = File::open(path).map_err(open)?;
    let mut start = Vec::new();
    (&file)
        .take(mcap::MAGIC.len() as u64)
        .read_to_end(&mut start)
        .map_err(open)?;
    if start != mcap::MAGIC {
        let mut expected = [0; 8];
        expected.copy_from_slice(mcap::MAGIC);
        return Err(RecordingError::NotMcap {
            path: path.into(),
            found: start,
            expected,
        });
    }
    file.rewind().map_err(open)?;
    Ok(file)
}

/// A message that is not what its topic promises.
pub(crate) struct BadMessage {
    topic: String,
    sequence: u32,
    why: String,
}

impl BadMessage {
    pub(crate) fn at(self, path: &Path) -> RecordingError {
        RecordingError::Message {
            path: path.into(),
            topic: self.topic,
            sequence: self.sequence,
            why: self.why,
        }
    }
}

/// Turns records into events.
#[derive(Default)]
pub(crate) struct Decoder {
    topics: BTreeMap<u16, String>,
    traffic: BTreeMap<String, Traffic>,
    pub(crate) skips_gaussians: bool,
    /// Newest `/status`, which precedes the Gaussians of its step.
    status: Option<StatusRecord>,
}

impl Decoder {
    pub(crate) fn decode(&mut self, record: Record) -> Result<Option<Event>, BadMessage> {
        match record {
            Record::Channel(channel) => {
                self.topics.insert(channel.id, channel.topic);
                Ok(None)
            }
            Record::Metadata(record) => Ok(Some(Event::Metadata {
                name: record.name,
                values: record.metadata,
            })),
            Record::Attachment { header, data, .. } => Ok(Some(Event::Attachment {
                name: header.name,
                data: data.into_owned(),
            })),
            Record::Message { header, data } => {
                let topic = self
                    .topics
                    .get(&header.channel_id)
                    .cloned()
                    .unwrap_or_default();
                let traffic = self.traffic.entry(topic.clone()).or_default();
                traffic.messages += 1;
                traffic.bytes += data.len() as u64;
                self.message(&topic, &header, &data)
                    .map_err(|why| BadMessage {
                        topic,
                        sequence: header.sequence,
                        why,
                    })
            }
            _ => Ok(None),
        }
    }

    fn message(
        &mut self,
        topic: &str,
        header: &MessageHeader,
        data: &[u8],
    ) -> Result<Option<Event>, String> {
        Ok(Some(match topic {
            STATUS_TOPIC => {
                self.status = Some(json(data)?);
                return Ok(None);
            }
            GAUSSIANS_TOPIC => {
                let gaussians = match self.skips_gaussians {
                    true => Vec::new(),
                    false => point_cloud::decode(data)?,
                };
                let status = self
                    .status
                    .take()
                    .filter(|s| s.step as u32 == header.sequence)
                    .ok_or("the /status of the same step does not precede it")?;
                let header_of_frame = status.header();
                if !self.skips_gaussians && gaussians.len() != header_of_frame.count as usize {
                    return Err(format!(
                        "{} Gaussians, but the /status of the same step says {}",
                        gaussians.len(),
                        header_of_frame.count
                    ));
                }
                Event::Frame(Box::new(RecordedFrame {
                    header: header_of_frame,
                    gaussians,
                    board: status.board,
                    log_time: header.log_time,
                }))
            }
            OBJECTS_TOPIC => {
                let record: ObjectsRecord = json(data)?;
                Event::Objects(record.header(), record.states())
            }
            JOURNAL_TOPIC => Event::Journal((&json::<JournalRecord>(data)?).into()),
            GAPS_TOPIC => Event::Gap(json(data)?),
            _ => return Ok(None),
        }))
    }
}

fn json<T: DeserializeOwned>(data: &[u8]) -> Result<T, String> {
    serde_json::from_slice(data).map_err(|e| e.to_string())
}
