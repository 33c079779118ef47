//! The top-level records of an MCAP file, found without trust in any of its bytes.

use std::fs::File;
use std::io::{self, Seek, SeekFrom};
use std::os::unix::fs::FileExt;

use mcap::records::op;

/// Opcode and length in front of every record [bytes].
const FRAMING: u64 = 9;

/// Chunk header without the name of the compression [bytes].
const CHUNK_HEADER: u64 = 40;

/// Where a record lies.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Segment {
    pub(crate) opcode: u8,
    /// Of its opcode, from the start of the file [bytes].
    pub(crate) offset: u64,
    /// Of its body as the file says [bytes].
    pub(crate) length: u64,
    /// Of its body that is there [bytes].
    pub(crate) available: u64,
    /// Whether all of it is there, and a chunk was finished.
    pub(crate) is_whole: bool,
    /// For chunks whose header can be read.
    pub(crate) chunk: Option<ChunkInfo>,
}

/// What a chunk's header says.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct ChunkInfo {
    /// Name of the compression, empty for none.
    pub(crate) compression: &'static str,
    /// Size of the header [bytes].
    pub(crate) header_len: u64,
    /// Size of the data after the header as the header says [bytes].
    data_len: u64,
}

impl ChunkInfo {
    /// Whether header and data make up a record of `length` bytes.
    fn fills(&self, length: u64) -> bool {
        self.header_len.checked_add(self.data_len) == Some(length)
    }
}

/// All records of a file.
pub(crate) struct Segments {
    pub(crate) records: Vec<Segment>,
    /// Whether the file ends with footer and magic bytes.
    pub(crate) is_finished: bool,
    /// Bytes that belong to no record.
    pub(crate) skipped: u64,
}

/// A file read at places that lie mostly one behind the other.
struct Ahead<'f> {
    file: &'f File,
    /// Bytes from `start` on, as far as they were read.
    bytes: Vec<u8>,
    start: u64,
}

impl Ahead<'_> {
    /// Bytes read at once: headers of small records beside each other, little beside a chunk.
    const COUNT: u64 = 4 << 10;

    /// `N` bytes at `at`, `None` where the file ends before.
    fn read<const N: usize>(&mut self, at: u64, end: u64) -> io::Result<Option<[u8; N]>> {
        let behind = at.saturating_add(N as u64);
        if behind > end {
            return Ok(None);
        }
        if at < self.start || behind > self.start + self.bytes.len() as u64 {
            let count = Self::COUNT.max(N as u64).min(end - at);
            self.bytes.resize(count as usize, 0);
            self.start = at;
            let read = self.file.read_exact_at(&mut self.bytes, at);
            read.inspect_err(|_| self.bytes.clear())?;
        }
        let from = (at - self.start) as usize;
        let mut bytes = [0; N];
        bytes.copy_from_slice(&self.bytes[from..from + N]);
        Ok(Some(bytes))
    }
}

/// Walks the file; where the chain of records breaks, it goes on at the next thing that looks like a chunk.
pub(crate) fn segments(file: &mut File) -> io::Result<Segments> {
    let end = file.seek(SeekFrom::End(0))?;
    let file = &mut Ahead {
        file,
        bytes: Vec::new(),
        start: 0,
    };
    let mut found = Segments {
        records: Vec::new(),
        is_finished: false,
        skipped: 0,
    };
    let mut at = mcap::MAGIC.len() as u64;
    while at < end {
        let segment = segment_at(file, at, end)?;
        let breaks = match &segment {
            Some(s) => !s.is_whole,
            None => true,
        };
        let next = match breaks {
            true => next_chunk(file, at + 1, end)?.unwrap_or(end),
            false => at + FRAMING + segment.as_ref().map_or(0, |s| s.length),
        };
        match segment {
            Some(mut segment) => {
                // The next chunk may begin within what looks like opcode and length.
                let between = (next - at).saturating_sub(FRAMING);
                segment.available = segment.available.min(between);
                if segment.opcode == op::FOOTER && segment.is_whole {
                    found.is_finished = ends_with_magic(file, next, end)?;
                    found.records.push(segment);
                    found.skipped += match found.is_finished {
                        true => 0,
                        false => end - next,
                    };
                    break;
                }
                found.records.push(segment);
            }
            None => found.skipped += next - at,
        }
        at = next;
    }
    Ok(found)
}

/// The record at `at`, whole or cut off; `None` where there is none.
fn segment_at(file: &mut Ahead<'_>, at: u64, end: u64) -> io::Result<Option<Segment>> {
    let Some(framing) = file.read::<{ FRAMING as usize }>(at, end)? else {
        return Ok(None);
    };
    let opcode = framing[0];
    let is_known = (op::HEADER..=op::DATA_END).contains(&opcode) || opcode >= 0x80;
    if !is_known {
        return Ok(None);
    }
    let length = le64(&framing[1..]);
    let available = length.min(end - at - FRAMING);
    let chunk = match opcode {
        op::CHUNK => chunk_at(file, at, end)?,
        _ => None,
    };
    // A chunk's sizes are filled in when it is finished, its record's length first.
    let is_finished = opcode != op::CHUNK || chunk.as_ref().is_some_and(|c| c.fills(length));
    Ok(Some(Segment {
        opcode,
        offset: at,
        length,
        available,
        is_whole: available == length && is_finished,
        chunk,
    }))
}

/// The chunk header of the record at `at`.
fn chunk_at(file: &mut Ahead<'_>, at: u64, end: u64) -> io::Result<Option<ChunkInfo>> {
    let Some(fixed) = file.read::<32>(at + FRAMING, end)? else {
        return Ok(None);
    };
    let name_len = u32::from_le_bytes([fixed[28], fixed[29], fixed[30], fixed[31]]);
    let name = at + FRAMING + 32;
    let known = match name_len {
        0 => Some(""),
        3 => file
            .read::<3>(name, end)?
            .filter(|n| n == b"lz4")
            .map(|_| "lz4"),
        4 => file
            .read::<4>(name, end)?
            .filter(|n| n == b"zstd")
            .map(|_| "zstd"),
        _ => None,
    };
    let Some(compression) = known else {
        return Ok(None);
    };
    let header_len = CHUNK_HEADER + u64::from(name_len);
    let size = file.read::<8>(at + FRAMING + header_len - 8, end)?;
    Ok(size.map(|size| ChunkInfo {
        compression,
        header_len,
        data_len: le64(&size),
    }))
}

/// Offset of the first whole chunk at or after `from`. Two lengths and a name that agree make a chance hit within
/// other data unlikely, and its checksum settles it.
fn next_chunk(file: &mut Ahead<'_>, from: u64, end: u64) -> io::Result<Option<u64>> {
    const WINDOW: usize = 1 << 20;
    let mut window = vec![0; WINDOW.min(end.saturating_sub(from) as usize)];
    let mut start = from;
    while start < end {
        let count = file.file.read_at(&mut window, start)?;
        if count == 0 {
            break;
        }
        for i in (0..count).filter(|&i| window[i] == op::CHUNK) {
            let at = start + i as u64;
            if let Some(segment) = segment_at(file, at, end)?
                && segment.is_whole
            {
                return Ok(Some(at));
            }
        }
        start += count as u64;
    }
    Ok(None)
}

fn ends_with_magic(file: &mut Ahead<'_>, at: u64, end: u64) -> io::Result<bool> {
    let magic = file.read::<8>(at, end)?;
    Ok(end - at == 8 && magic.is_some_and(|m| m == mcap::MAGIC))
}

/// Little-endian number in the first 8 of `bytes`.
fn le64(bytes: &[u8]) -> u64 {
    let mut number = [0; 8];
    number.copy_from_slice(&bytes[..8]);
    u64::from_le_bytes(number)
}
