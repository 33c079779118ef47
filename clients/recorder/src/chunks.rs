//! A recording read from any of its chunks on: to jump to a step, and to look into a chunk that is damaged.

use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use mcap::records::op;

use crate::chunk_records::ChunkRecords;
use crate::decoder::Decoder;
use crate::reader::{DECODED, Event, most_unpacked, open_mcap};
use crate::records;
use crate::segments::{Segment, segments};
use crate::{Damage, RecordingError};

/// Opcode and length in front of a record [byte].
const FRAMING: usize = 9;
/// Where the checksum of a chunk lies, from the opcode on [byte]: behind length, two times and a size.
const CRC: std::ops::Range<usize> = 33..37;

/// The chunks of a finished recording.
pub struct Chunks {
    path: PathBuf,
    file: File,
    chunks: Vec<Segment>,
    /// Metadata and attachments.
    matter: Vec<Segment>,
    decoder: Decoder,
}

/// What a chunk holds.
pub struct Content {
    /// Its messages, up to the first one that cannot be read.
    pub events: Vec<Event>,
    /// Why it ends early, or what is wrong with it as a whole.
    pub damage: Option<RecordingError>,
}

impl Content {
    /// The messages, if nothing is wrong.
    ///
    /// # Errors
    /// What is wrong.
    pub fn sound(self) -> Result<Vec<Event>, RecordingError> {
        match self.damage {
            Some(damage) => Err(damage),
            None => Ok(self.events),
        }
    }
}

impl Chunks {
    /// Finds the chunks of a recording.
    ///
    /// # Errors
    /// When the file cannot be opened, is no MCAP file, or was not finished.
    pub fn open(path: &Path) -> Result<Self, RecordingError> {
        let mut file = open_mcap(path)?;
        let map = segments(&mut file).map_err(|e| RecordingError::open(path, e))?;
        if !map.is_finished {
            return Err(RecordingError::damaged(
                path,
                mcap::McapError::UnexpectedEof,
            ));
        }
        let mut this = Self {
            path: path.to_owned(),
            file,
            chunks: Vec::new(),
            matter: Vec::new(),
            decoder: Decoder::default(),
        };
        for segment in map.records {
            match segment.opcode {
                op::CHUNK => this.chunks.push(segment),
                op::METADATA | op::ATTACHMENT => this.matter.push(segment),
                // The summary repeats the channels, so that no chunk depends on the first one.
                op::CHANNEL => drop(this.record(&segment)?),
                _ => {}
            }
        }
        Ok(this)
    }

    /// How many there are.
    pub fn count(&self) -> usize {
        self.chunks.len()
    }

    /// Metadata and attachments, in the order of the file.
    ///
    /// # Errors
    /// When one of them cannot be read.
    pub fn matter(&mut self) -> Result<Vec<Event>, RecordingError> {
        let mut events = Vec::new();
        for segment in self.matter.clone() {
            events.extend(self.record(&segment)?);
        }
        Ok(events)
    }

    /// The messages of a chunk without the Gaussians of its frames, or what is wrong with it.
    ///
    /// # Errors
    /// When the chunk cannot be read or is damaged.
    ///
    /// # Panics
    /// When there is no such chunk, like slice indexing.
    pub fn headers(&mut self, chunk: usize) -> Result<Vec<Event>, RecordingError> {
        self.decoder.skips_gaussians = true;
        let content = self.read(chunk);
        self.decoder.skips_gaussians = false;
        content?.sound()
    }

    /// The messages of a chunk; of a damaged one as far as they can be read.
    ///
    /// # Errors
    /// When the file cannot be read.
    ///
    /// # Panics
    /// When there is no such chunk, like slice indexing.
    pub fn read(&mut self, chunk: usize) -> Result<Content, RecordingError> {
        let segment = self.chunks[chunk].clone();
        let mut bytes = self.bytes(&segment)?;
        let before = self.decoder.clone();
        let whole = self.decode(&bytes[FRAMING..]);
        if whole.damage.is_none() || bytes.len() < CRC.end {
            return Ok(whole);
        }
        // Once more without its checksum: what can be read of it tells where the damage is.
        bytes[CRC].fill(0);
        self.decoder = before;
        let part = self.decode(&bytes[FRAMING..]);
        Ok(Content {
            events: part.events,
            damage: whole.damage,
        })
    }

    /// The first chunk whose checksum does not hold, or that cannot be read.
    ///
    /// # Errors
    /// When the file cannot be read.
    pub fn first_damaged(&mut self) -> Result<Option<Content>, RecordingError> {
        for chunk in 0..self.count() {
            let content = self.read(chunk)?;
            if content.damage.is_some() {
                return Ok(Some(content));
            }
        }
        Ok(None)
    }

    /// Decodes a record outside of chunks.
    fn record(&mut self, segment: &Segment) -> Result<Option<Event>, RecordingError> {
        let bytes = self.bytes(segment)?;
        let record = records::parse(segment.opcode, &bytes[FRAMING..])
            .map_err(|e| RecordingError::damaged(&self.path, e))?;
        self.decoder.decode(record).map_err(|m| m.at(&self.path))
    }

    /// A record with its opcode and length.
    fn bytes(&mut self, segment: &Segment) -> Result<Vec<u8>, RecordingError> {
        let failed = |e| RecordingError::open(&self.path, e);
        let start = SeekFrom::Start(segment.offset);
        self.file.seek(start).map_err(failed)?;
        let mut bytes = Vec::new();
        let length = segment.available + FRAMING as u64;
        (&self.file)
            .take(length)
            .read_to_end(&mut bytes)
            .map_err(failed)?;
        match bytes.len() as u64 == length {
            true => Ok(bytes),
            false => Err(RecordingError::damaged(
                &self.path,
                mcap::McapError::UnexpectedEof,
            )),
        }
    }

    /// The messages of a chunk record, up to the first fault.
    fn decode(&mut self, body: &[u8]) -> Content {
        let mut events = Vec::new();
        let outcome = self.decode_into(body, &mut events);
        Content {
            events,
            damage: outcome.err(),
        }
    }

    fn decode_into(&mut self, body: &[u8], events: &mut Vec<Event>) -> Result<(), RecordingError> {
        let damaged = |e: Damage| RecordingError::damaged(&self.path, e);
        let mut records = ChunkRecords::of(body, most_unpacked(&self.file)).map_err(damaged)?;
        while let Some((opcode, data)) = records.next().map_err(damaged)? {
            if DECODED.contains(&opcode) {
                let record = records::parse(opcode, data).map_err(|e| damaged(e.into()))?;
                let event = self.decoder.decode(record);
                events.extend(event.map_err(|m| m.at(&self.path))?);
            }
        }
        Ok(())
    }
}
