//! A finished recording read back in file order, every checksum verified.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{Read, Seek};
use std::path::Path;

use cosplat_ipc::schema::{FrameHeader, GaussianState, ObjectState, ObjectsHeader};
use mcap::records::op;
use serde::Serialize;

use crate::RecordingError;
use crate::decoder::Decoder;
use crate::file_records::FileRecords;
use crate::messages::{BoardRecord, GapRecord, JournalEntry};
use crate::records;
#[cfg(doc)]
use crate::topics::RUN_METADATA;

/// Largest record or chunk read [bytes]: a damaged length must not fill the memory.
pub(crate) const LENGTH_LIMIT: usize = 4 << 30;

/// Most bytes read at once: a damaged length must not reserve more than the file has.
pub(crate) const READ_LIMIT: usize = 16 << 20;

/// Most bytes of a chunk by itself, and by each byte of its file. `docs/faults.md` allows a reader 64 MiB and 1 KiB per byte; what is
/// made of a chunk is up to six times as large. What a recorder packs best is a scene at rest, 64 frames of 64 bytes a Gaussian in
/// a chunk: that is 35 times what the scene itself has in the file, 116 bytes a Gaussian, which is not packed.
const MOST_UNPACKED: (u64, u64) = (8 << 20, 160);

/// Most bytes that a chunk of a file may unpack to.
pub(crate) fn most_unpacked(file: &File) -> u64 {
    let length = file.metadata().map_or(0, |file| file.len());
    let (least, each) = MOST_UNPACKED;
    length
        .saturating_mul(each)
        .saturating_add(least)
        .min(LENGTH_LIMIT as u64)
}

/// Records that make [`Event`]s.
pub(crate) const DECODED: [u8; 4] = [op::CHANNEL, op::MESSAGE, op::METADATA, op::ATTACHMENT];

/// One frame of a recording.
#[derive(Clone, Debug, PartialEq)]
pub struct RecordedFrame {
    /// Its header as it was published.
    pub header: FrameHeader,
    /// Its Gaussians as they were published.
    pub gaussians: Vec<GaussianState>,
    /// Whether it can be read without those before it.
    pub is_whole: bool,
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
    records: FileRecords,
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
            records: FileRecords::open(path)?,
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
        let (decoder, path) = (&mut self.decoder, self.records.path.clone());
        self.records.find(|opcode, data| {
            // What else there is indexes and sums up these.
            if !DECODED.contains(&opcode) {
                return Ok(None);
            }
            let record =
                records::parse(opcode, data).map_err(|e| RecordingError::damaged(&path, e))?;
            decoder.decode(record).map_err(|m| m.at(&path))
        })
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
    let mut file = cosplat_files::reading::open(path, u64::MAX).map_err(open)?;
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
    pub(crate) fn new(topic: String, sequence: u32, why: String) -> Self {
        Self {
            topic,
            sequence,
            why,
        }
    }

    pub(crate) fn at(self, path: &Path) -> RecordingError {
        RecordingError::Message {
            path: path.into(),
            topic: self.topic,
            sequence: self.sequence,
            why: self.why,
        }
    }
}
