//! The records of a finished file in its order, those of chunks among them, every checksum verified.

use std::fs::File;
use std::io::{BufReader, Read};
use std::path::{Path, PathBuf};

use mcap::records::op;
use mcap::sans_io::linear_reader::{LinearReadEvent, LinearReader, LinearReaderOptions};

use crate::RecordingError;
use crate::chunk_records::ChunkRecords;
use crate::reader::{LENGTH_LIMIT, READ_LIMIT, most_unpacked, open_mcap};

/// Bytes read ahead: most records are shorter, and chunks pass the buffer by.
const BUFFER: usize = 16 << 10;

/// A file that is read from its beginning to its end.
pub(crate) struct FileRecords {
    pub(crate) path: PathBuf,
    file: BufReader<File>,
    reader: LinearReader,
    /// The chunk that is being read.
    chunk: Option<ChunkRecords>,
    /// Most bytes that it may unpack to.
    most: u64,
    /// Bytes read.
    pub(crate) position: u64,
}

impl FileRecords {
    /// Opens a file.
    ///
    /// # Errors
    /// When it cannot be opened or is no MCAP file.
    pub(crate) fn open(path: &Path) -> Result<Self, RecordingError> {
        let file = open_mcap(path)?;
        Ok(Self {
            path: path.to_owned(),
            most: most_unpacked(&file),
            file: BufReader::with_capacity(BUFFER, file),
            reader: LinearReader::new_with_options(
                LinearReaderOptions::default()
                    .with_emit_chunks(true)
                    .with_validate_data_section_crc(true)
                    .with_validate_summary_section_crc(true)
                    .with_record_length_limit(LENGTH_LIMIT),
            ),
            chunk: None,
            position: 0,
        })
    }

    /// Gives records, as opcode and content, to `take` until that returns something; `None` at the end of the file.
    ///
    /// # Errors
    /// When the file is damaged or unfinished, or the error of `take`.
    pub(crate) fn find<T>(
        &mut self,
        mut take: impl FnMut(u8, &[u8]) -> Result<Option<T>, RecordingError>,
    ) -> Result<Option<T>, RecordingError> {
        loop {
            if let Some(chunk) = &mut self.chunk {
                let next = chunk.next();
                match next.map_err(|e| RecordingError::damaged(&self.path, e))? {
                    None => self.chunk = None,
                    Some((opcode, data)) => {
                        if let Some(found) = take(opcode, data)? {
                            return Ok(Some(found));
                        }
                    }
                }
                continue;
            }
            let Some(event) = self.reader.next_event() else {
                return Ok(None);
            };
            match event.map_err(|e| RecordingError::damaged(&self.path, e))? {
                LinearReadEvent::ReadRequest(need) => {
                    let buffer = self.reader.insert(need.min(READ_LIMIT));
                    let read = self.file.read(buffer);
                    let read = read.map_err(|e| RecordingError::damaged(&self.path, e))?;
                    self.position += read as u64;
                    self.reader.notify_read(read);
                }
                LinearReadEvent::Record {
                    data,
                    opcode: op::CHUNK,
                } => {
                    let chunk = ChunkRecords::of(data, self.most);
                    self.chunk = Some(chunk.map_err(|e| RecordingError::damaged(&self.path, e))?);
                }
                LinearReadEvent::Record { data, opcode } => {
                    if let Some(found) = take(opcode, data)? {
                        return Ok(Some(found));
                    }
                }
            }
        }
    }
}
