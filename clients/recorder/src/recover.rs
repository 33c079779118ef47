//! Repair of a recording whose writer was killed, whose disk filled up, or whose bytes were damaged.
//!
//! Finished chunks are kept when their checksum holds. Of a chunk that was cut off every complete message is kept.
//! Index and summary are written anew.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use cosplat_files::{NewFile, keep_apart};
use foxglove::messages::FrameTransforms;
use mcap::records::{MessageHeader, Record, op};
use prost::Message;
use serde::Serialize;

use crate::RecordingError;
use crate::chunk_records::ChunkRecords;
use crate::messages::{GapReason, GapRecord, StatusRecord};
use crate::packed::{ENCODING, Points};
use crate::point_cloud;
use crate::reader::{most_unpacked, open_mcap};
use crate::records;
use crate::segments::{Segment, segments};
use crate::topics::*;
use crate::write_behind::WriteBehind;
use crate::writer::{Mcap, begin, existing};

/// What a recovery kept and what it lost.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct RecoverReport {
    /// The damaged file.
    pub input: PathBuf,
    /// The repaired file.
    pub output: PathBuf,
    /// Whether the input was a finished recording without damage.
    pub was_intact: bool,
    /// Frames kept.
    pub frames: u64,
    /// First step kept.
    pub first_step: Option<u64>,
    /// Last step kept.
    pub last_step: Option<u64>,
    /// Steps lost between the first and the last one kept; each has a record in `/gaps`.
    pub lost_steps: Vec<GapRecord>,
    /// Messages kept.
    pub messages: u64,
    /// Messages among them that no checksum covers: those of a chunk that was cut off.
    pub messages_unverified: u64,
    /// Chunks kept whole.
    pub chunks: u64,
    /// Chunks dropped because their checksum does not hold.
    pub chunks_damaged: u64,
    /// Attachments kept.
    pub attachments: u64,
    /// Attachments dropped because they are cut off or their checksum does not hold.
    pub attachments_damaged: u64,
    /// Metadata records kept.
    pub metadata: u64,
    /// Bytes of the input that could not be used.
    pub lost_bytes: u64,
}

/// Writes what is readable of `input` to `output`, a valid MCAP file with index and summary.
///
/// # Errors
/// When `input` is no MCAP file or cannot be read, or `output` is the same file, exists without `overwrite`, or cannot
/// be written; then what was there is as it was.
pub fn recover(
    input: &Path,
    output: &Path,
    overwrite: bool,
) -> Result<RecoverReport, RecordingError> {
    let mut file = open_mcap(input)?;
    keep_apart(output, [input])?;
    let map = segments(&mut file).map_err(|e| RecordingError::open(input, e))?;
    let profile = match read_body(
        &mut file,
        map.records.iter().find(|s| s.opcode == op::HEADER),
    ) {
        Some(body) => match records::parse(op::HEADER, &body) {
            Ok(Record::Header(header)) => header.profile,
            _ => String::new(),
        },
        None => String::new(),
    };
    let new = NewFile::create(output, existing(overwrite))
        .map_err(|e| RecordingError::open(output, e))?;
    let (mcap, behind) = begin(&new, compression(&map.records), &profile)?;
    let mut recovery = Recovery {
        mcap,
        behind,
        topics: BTreeMap::new(),
        points: Points::default(),
        open: None,
        whole: None,
        is_founded: true,
        was_lost: false,
        report: RecoverReport {
            input: input.into(),
            output: output.into(),
            was_intact: map.is_finished,
            lost_bytes: map.skipped,
            ..Default::default()
        },
    };
    recovery
        .run(&mut file, &map.records)
        .map_err(|e| RecordingError::write(output, e))?;
    new.finish().map_err(|e| RecordingError::write(output, e))?;
    let mut report = recovery.report;
    report.was_intact &= report.lost_bytes == 0;
    Ok(report)
}

/// Compression of the first chunk, which the output keeps.
fn compression(segments: &[Segment]) -> Option<(mcap::Compression, u32)> {
    let first = segments.iter().find_map(|s| s.chunk.as_ref())?;
    match first.compression {
        "lz4" => Some((mcap::Compression::Lz4, 1)),
        "zstd" => Some((mcap::Compression::Zstd, 1)),
        _ => None,
    }
}

/// Content of a whole record.
fn read_body(file: &mut File, segment: Option<&Segment>) -> Option<Vec<u8>> {
    let segment = segment.filter(|s| s.is_whole)?;
    file.seek(SeekFrom::Start(segment.offset + 9)).ok()?;
    let mut body = Vec::new();
    let read = file.take(segment.length).read_to_end(&mut body).ok()?;
    (read as u64 == segment.length).then_some(body)
}

struct Recovery {
    mcap: Mcap,
    behind: WriteBehind,
    /// Topics of channels, and whether their messages are packed.
    topics: BTreeMap<u16, (String, bool)>,
    points: Points,
    /// Epoch and step of the frame that is being copied, and of the newest one that was to its end.
    open: Option<(u64, u64)>,
    whole: Option<(u64, u64)>,
    /// Whether the frame that is being copied builds on one that is there.
    is_founded: bool,
    /// Whether something was lost since the newest frame.
    was_lost: bool,
    report: RecoverReport,
}

impl Recovery {
    fn run(&mut self, file: &mut File, segments: &[Segment]) -> mcap::McapResult<()> {
        // The summary repeats schemas and channels: they help where the chunk that had them is damaged.
        for segment in segments {
            if matches!(segment.opcode, op::SCHEMA | op::CHANNEL)
                && let Some(body) = read_body(file, Some(segment))
            {
                self.record(segment.opcode, &body, true)?;
            }
        }
        for segment in segments {
            match segment.opcode {
                op::CHUNK if segment.is_whole => self.whole_chunk(file, segment)?,
                op::CHUNK => self.cut_chunk(file, segment)?,
                op::MESSAGE | op::METADATA | op::ATTACHMENT => {
                    match read_body(file, Some(segment)) {
                        Some(body) => drop(self.record(segment.opcode, &body, true)?),
                        None => self.lose(segment),
                    }
                }
                _ => {}
            }
        }
        self.mcap.finish()?;
        Ok(())
    }

    fn lose(&mut self, segment: &Segment) {
        self.was_lost = true;
        self.report.lost_bytes += segment.available;
        if segment.opcode == op::ATTACHMENT {
            self.report.attachments_damaged += 1;
        }
    }

    fn whole_chunk(&mut self, file: &mut File, segment: &Segment) -> mcap::McapResult<()> {
        // What the input's disk no longer gives is lost like a cut-off end.
        let body = read_body(file, Some(segment)).unwrap_or_default();
        let outcome = match ChunkRecords::of(&body, most_unpacked(file)) {
            Ok(records) => self.chunk(records, true)?,
            Err(_) => ChunkOutcome::default(),
        };
        match outcome.is_sound {
            true => self.report.chunks += 1,
            false => {
                self.report.chunks_damaged += 1;
                self.lose(segment);
            }
        }
        // One chunk in, one chunk out.
        self.end_chunk()
    }

    /// Reads a chunk whose end is missing: its sizes and checksum say nothing.
    fn cut_chunk(&mut self, file: &mut File, segment: &Segment) -> mcap::McapResult<()> {
        self.was_lost = true;
        // A length in the file may say less than the header before it takes.
        let whole = segment.chunk.as_ref();
        let whole = whole.and_then(|c| Some((c, segment.available.checked_sub(c.header_len)?)));
        let Some((chunk, length)) = whole else {
            self.lose(segment);
            return Ok(());
        };
        let start = segment.offset + 9 + chunk.header_len;
        let mut data = Vec::new();
        // As much as the input's disk gives.
        let _ = file
            .seek(SeekFrom::Start(start))
            .and_then(|_| file.take(length).read_to_end(&mut data));
        let before = self.report.messages;
        let outcome = match ChunkRecords::of_part(chunk.compression, &data, most_unpacked(file)) {
            Ok(records) => self.chunk(records, false)?,
            Err(_) => ChunkOutcome::default(),
        };
        self.report.messages_unverified += self.report.messages - before;
        self.report.lost_bytes += match chunk.compression.is_empty() {
            true => length - outcome.used,
            false => 0,
        };
        self.end_chunk()
    }

    fn end_chunk(&mut self) -> mcap::McapResult<()> {
        self.mcap.flush()?;
        self.behind.advance();
        Ok(())
    }

    /// Copies the records of one chunk until its end or the first one that cannot be read.
    fn chunk(
        &mut self,
        mut records: ChunkRecords,
        is_verified: bool,
    ) -> mcap::McapResult<ChunkOutcome> {
        let mut outcome = ChunkOutcome::default();
        loop {
            match records.next() {
                Ok(Some((opcode, data))) => {
                    let is_copied = matches!(opcode, op::SCHEMA | op::CHANNEL | op::MESSAGE)
                        && self.record(opcode, data, is_verified)?;
                    if !is_copied {
                        return Ok(outcome);
                    }
                    outcome.used += 9 + data.len() as u64;
                }
                Ok(None) => {
                    outcome.is_sound = true;
                    return Ok(outcome);
                }
                Err(_) => return Ok(outcome),
            }
        }
    }

    /// Copies one record. False when it is malformed; errors are those of the output.
    fn record(&mut self, opcode: u8, body: &[u8], is_verified: bool) -> mcap::McapResult<bool> {
        let Ok(record) = records::parse(opcode, body) else {
            self.was_lost = true;
            self.report.lost_bytes += body.len() as u64;
            self.report.attachments_damaged += u64::from(opcode == op::ATTACHMENT);
            return Ok(false);
        };
        match record {
            Record::Schema { header, data } => {
                let same =
                    self.mcap
                        .add_schema_with_id(header.id, &header.name, &header.encoding, &data);
                accept(same)
            }
            Record::Channel(channel) => {
                let added = self.mcap.add_channel_with_id(
                    channel.id,
                    channel.schema_id,
                    &channel.topic,
                    &channel.message_encoding,
                    &channel.metadata,
                );
                let is_added = accept(added)?;
                if is_added {
                    let is_packed = channel.message_encoding == ENCODING;
                    self.topics.insert(channel.id, (channel.topic, is_packed));
                }
                Ok(is_added)
            }
            Record::Message { header, data } => self.message(&header, &data, is_verified),
            Record::Metadata(record) => {
                self.report.metadata += 1;
                self.mcap.write_metadata(&record).map(|()| true)
            }
            Record::Attachment { header, data, .. } => {
                self.report.attachments += 1;
                self.mcap.start_attachment(data.len() as u64, header)?;
                self.mcap.put_attachment_bytes(&data)?;
                self.mcap.finish_attachment().map(|()| true)
            }
            _ => Ok(true),
        }
    }

    fn message(
        &mut self,
        header: &MessageHeader,
        data: &[u8],
        is_verified: bool,
    ) -> mcap::McapResult<bool> {
        let Some((topic, is_packed)) = self.topics.get(&header.channel_id).cloned() else {
            return Ok(false);
        };
        let is_cloud = |points: &mut Points| match is_packed {
            true => {
                let message = points.unpack(header.channel_id, data);
                message.is_ok_and(|message| point_cloud::decode(&message).is_ok())
            }
            false => point_cloud::decode(data).is_ok(),
        };
        match topic.as_str() {
            STATUS_TOPIC => {
                let Ok(status) = serde_json::from_slice::<StatusRecord>(data) else {
                    return Ok(false);
                };
                if !self.begin_frame(&status) {
                    return Ok(true);
                }
                self.advance(&status, header)?;
            }
            GAUSSIANS_TOPIC => {
                if !is_verified && !is_cloud(&mut self.points) {
                    return Ok(false);
                }
                self.end_frame();
            }
            PLACES_TOPIC => {
                if !is_verified && FrameTransforms::decode(data).is_err() {
                    return Ok(false);
                }
                if !self.is_founded {
                    return Ok(true);
                }
                self.end_frame();
            }
            topic if object_of(topic).is_some() => {
                if !is_verified && !is_cloud(&mut self.points) {
                    return Ok(false);
                }
                if !self.is_founded {
                    return Ok(true);
                }
            }
            OBJECTS_TOPIC | JOURNAL_TOPIC | GAPS_TOPIC
                if !is_verified && serde_json::from_slice::<serde_json::Value>(data).is_err() =>
            {
                return Ok(false);
            }
            _ => {}
        }
        self.report.messages += 1;
        self.mcap
            .write_to_known_channel(header, data)
            .map(|()| true)
    }

    /// Whether a frame that begins can be read: what it builds on is there.
    fn begin_frame(&mut self, status: &StatusRecord) -> bool {
        let epoch = status.epoch.0;
        self.is_founded = match status.since {
            Some(since) if since != status.step => self.whole == Some((epoch, since)),
            _ => true,
        };
        self.was_lost |= !self.is_founded;
        if self.is_founded {
            self.open = Some((epoch, status.step));
        }
        self.is_founded
    }

    /// A frame is there to its end.
    fn end_frame(&mut self) {
        self.whole = self.open.take();
        self.report.frames += 1;
        let step = self.whole.map(|(_, step)| step);
        self.report.first_step = self.report.first_step.or(step);
        self.report.last_step = step;
    }

    /// Follows the steps, and notes those that were lost to damage.
    fn advance(&mut self, status: &StatusRecord, header: &MessageHeader) -> mcap::McapResult<()> {
        let epoch = status.epoch;
        if let Some((last_epoch, last)) = self.whole
            && self.was_lost
            && last_epoch == epoch.0
            && status.step > last + 1
        {
            let gap = GapRecord {
                epoch,
                from_step: last + 1,
                to_step: Some(status.step - 1),
                reason: GapReason::Damaged,
            };
            let id = self
                .mcap
                .add_schema("cosplat.Gap", "jsonschema", GAPS_SCHEMA.as_bytes())?;
            let channel_id = self
                .mcap
                .add_channel(id, GAPS_TOPIC, "json", &BTreeMap::new())?;
            let data = serde_json::to_vec(&gap).map_err(std::io::Error::other)?;
            let header = MessageHeader {
                channel_id,
                sequence: gap.from_step as u32,
                ..*header
            };
            self.mcap.write_to_known_channel(&header, &data)?;
            self.report.lost_steps.push(gap);
        }
        self.was_lost = false;
        Ok(())
    }
}

/// How the reading of a chunk ended.
#[derive(Default)]
struct ChunkOutcome {
    /// Bytes of the records copied.
    used: u64,
    /// Whether it was read to its end.
    is_sound: bool,
}

/// Tells a record that contradicts an earlier one (malformed) from an output that cannot be written.
fn accept(result: mcap::McapResult<u16>) -> mcap::McapResult<bool> {
    match result {
        Ok(_) => Ok(true),
        Err(e @ mcap::McapError::Io(_)) => Err(e),
        Err(_) => Ok(false),
    }
}
