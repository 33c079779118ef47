//! The records of one chunk, found without trust in any length that the file gives.
//!
//! The reader of the container takes the length of a record in a chunk for granted, and sets memory aside for what a
//! chunk claims to hold. Here a length is compared with what is there, and memory grows with what comes out.

use std::io::Read;

use mcap::McapError;

use crate::error::Damage;

/// Opcode and length in front of every record [byte].
const FRAMING: usize = 9;
/// Header of a chunk before the name of the compression, and behind it [byte].
const HEADER: (usize, usize) = (32, 8);

/// Memory set aside for the first bytes of a chunk [byte].
const FIRST_STEP: usize = 64 << 10;
/// Logarithm of how far back packed data may refer [byte]: as far as the highest usual level does. A decoder holds so much.
const WINDOW_LOG: u32 = 23;

/// Records of a chunk, one after the other.
pub(crate) struct ChunkRecords {
    data: Vec<u8>,
    at: usize,
    /// Why the data end early.
    fault: Option<Damage>,
}

impl ChunkRecords {
    /// Of a chunk record's content, which may unpack to `most` bytes. A checksum that is there is verified first; without one,
    /// what can be read comes before what is wrong.
    ///
    /// # Errors
    /// When its header does not fit or claims more, the checksum does not hold, or the compression is unknown.
    pub(crate) fn of(body: &[u8], most: u64) -> Result<Self, Damage> {
        let header = Header::read(body)?;
        let available = (body.len() - header.length) as u64;
        if header.compressed > available {
            let header = header.compressed;
            return Err(McapError::BadChunkLength { header, available }.into());
        }
        let packed = &body[header.length..][..header.compressed as usize];
        if header.uncompressed > most {
            return Err(Damage::Bomb {
                packed: header.compressed,
                size: header.uncompressed,
                most,
            });
        }
        let records = Self::unpack(header.compression, packed, header.uncompressed)?;
        if header.crc != 0 {
            let calculated = crc32fast::hash(&records.data);
            if calculated != header.crc {
                let saved = header.crc;
                return Err(McapError::BadChunkCrc { saved, calculated }.into());
            }
            if let Some(fault) = records.fault {
                return Err(fault);
            }
        }
        Ok(records)
    }

    /// Of data whose end may be missing, with the name of their compression: as much as comes out of them, `most` bytes at most.
    ///
    /// # Errors
    /// When the compression is unknown.
    pub(crate) fn of_part(compression: &str, packed: &[u8], most: u64) -> Result<Self, Damage> {
        let mut records = Self::unpack(compression, packed, most)?;
        // How much it should be is unknown; whether it ends within a record shows.
        records.fault = None;
        Ok(records)
    }

    fn unpack(compression: &str, packed: &[u8], size: u64) -> Result<Self, Damage> {
        let mut data = Vec::new();
        let read = match compression {
            "" => read_up_to(packed, size, &mut data),
            "lz4" => lz4::Decoder::new(packed).and_then(|d| read_up_to(d, size, &mut data)),
            "zstd" => zstd::stream::read::Decoder::with_buffer(packed).and_then(|mut decoder| {
                decoder.window_log_max(WINDOW_LOG)?;
                read_up_to(decoder, size, &mut data)
            }),
            other => return Err(McapError::UnsupportedCompression(other.to_owned()).into()),
        };
        let fault = match read {
            Err(error) => Some(McapError::DecompressionError(error.to_string())),
            Ok(()) if (data.len() as u64) < size => Some(McapError::UnexpectedEoc),
            Ok(()) => None,
        };
        Ok(Self {
            data,
            at: 0,
            fault: fault.map(Damage::from),
        })
    }

    /// Opcode and content of the next record; `None` at the end.
    ///
    /// # Errors
    /// When it is longer than what is left of the chunk, or the chunk ends early.
    pub(crate) fn next(&mut self) -> Result<Option<(u8, &[u8])>, Damage> {
        let rest = &self.data[self.at..];
        if rest.is_empty() {
            return self.fault.take().map_or(Ok(None), Err);
        }
        let Some((&[opcode, ref length @ ..], behind)) = rest.split_first_chunk::<FRAMING>() else {
            return Err(McapError::UnexpectedEoc.into());
        };
        let length = u64::from_le_bytes(*length);
        if length > behind.len() as u64 {
            return Err(Damage::RecordLength {
                opcode,
                length,
                available: behind.len() as u64,
            });
        }
        let length = length as usize;
        self.at += FRAMING + length;
        Ok(Some((opcode, &behind[..length])))
    }
}

/// Reads as much as there is, `size` bytes at most. Memory grows with what comes, and never beyond that.
fn read_up_to(mut from: impl Read, size: u64, data: &mut Vec<u8>) -> std::io::Result<()> {
    let size = usize::try_from(size).unwrap_or(usize::MAX);
    while data.len() < size {
        let step = data.len().max(FIRST_STEP).min(size - data.len());
        data.reserve_exact(step);
        if from.by_ref().take(step as u64).read_to_end(data)? < step {
            break;
        }
    }
    Ok(())
}

/// Header of a chunk.
struct Header<'a> {
    uncompressed: u64,
    crc: u32,
    compression: &'a str,
    compressed: u64,
    /// Bytes of the header itself.
    length: usize,
}

impl<'a> Header<'a> {
    fn read(body: &'a [u8]) -> Result<Self, Damage> {
        let short = |header: usize| McapError::BadChunkLength {
            header: header as u64,
            available: body.len() as u64,
        };
        let (front, behind) = HEADER;
        let (fixed, rest) = body
            .split_first_chunk::<{ HEADER.0 }>()
            .ok_or_else(|| short(front + behind))?;
        let name = le(&fixed[28..32]) as usize;
        let length = front.saturating_add(name).saturating_add(behind);
        let (Some(compression), Some(compressed)) =
            (rest.get(..name), body.get(front + name..length))
        else {
            return Err(short(length).into());
        };
        Ok(Self {
            uncompressed: le(&fixed[16..24]),
            crc: le(&fixed[24..28]) as u32,
            compression: std::str::from_utf8(compression).map_err(|_| {
                let name = String::from_utf8_lossy(compression).into_owned();
                McapError::UnsupportedCompression(name)
            })?,
            compressed: le(compressed),
            length,
        })
    }
}

/// A little-endian number of at most eight bytes.
fn le(bytes: &[u8]) -> u64 {
    let mut number = [0; 8];
    number[..bytes.len()].copy_from_slice(bytes);
    u64::from_le_bytes(number)
}

#[cfg(test)]
mod tests {
    use super::*;

    const MOST: u64 = 1 << 32;

    /// A chunk of these data, whose header claims `uncompressed` bytes.
    fn chunk(compression: &str, packed: &[u8], uncompressed: u64, crc: u32) -> Vec<u8> {
        let mut body = vec![0; 16];
        body.extend(uncompressed.to_le_bytes());
        body.extend(crc.to_le_bytes());
        body.extend((compression.len() as u32).to_le_bytes());
        body.extend(compression.as_bytes());
        body.extend((packed.len() as u64).to_le_bytes());
        body.extend(packed);
        body
    }

    fn record(opcode: u8, length: u64, content: &[u8]) -> Vec<u8> {
        [&[opcode], &length.to_le_bytes()[..], content].concat()
    }

    fn packed(compression: &str, data: &[u8]) -> Vec<u8> {
        match compression {
            "zstd" => zstd::encode_all(data, 1).expect("packed"),
            "lz4" => {
                let mut encoder = lz4::EncoderBuilder::new().build(Vec::new()).expect("lz4");
                std::io::copy(&mut &data[..], &mut encoder).expect("packed");
                let (packed, outcome) = encoder.finish();
                outcome.expect("packed");
                packed
            }
            _ => data.to_vec(),
        }
    }

    /// Length of the records before the fault, and the fault.
    fn walk(body: &[u8]) -> (Vec<usize>, Option<Damage>) {
        let mut lengths = Vec::new();
        let mut records = match ChunkRecords::of(body, MOST) {
            Ok(records) => records,
            Err(fault) => return (lengths, Some(fault)),
        };
        loop {
            match records.next() {
                Ok(Some((_, content))) => lengths.push(content.len()),
                Ok(None) => return (lengths, None),
                Err(fault) => return (lengths, Some(fault)),
            }
        }
    }

    #[test]
    fn a_record_longer_than_its_chunk_is_refused() {
        for compression in ["", "lz4", "zstd"] {
            for claimed in [4, 5, 1 << 40, u64::MAX] {
                let data = [record(5, 2, b"ok"), record(5, claimed, b"abc")].concat();
                let size = data.len() as u64;
                let body = chunk(compression, &packed(compression, &data), size, 0);
                let (lengths, fault) = walk(&body);
                assert_eq!(lengths, [2]);
                let Some(Damage::RecordLength {
                    opcode: 5,
                    length,
                    available: 3,
                }) = fault
                else {
                    panic!("{compression}: {fault:?}");
                };
                assert_eq!(length, claimed);
                // A checksum that holds makes it no better.
                let body = chunk(
                    compression,
                    &packed(compression, &data),
                    size,
                    crc32fast::hash(&data),
                );
                let (_, fault) = walk(&body);
                assert!(matches!(fault, Some(Damage::RecordLength { .. })));
            }
        }
    }

    #[test]
    fn what_unpacks_to_too_much_is_refused_before_it_does() {
        let zeros = vec![0; 16 << 20];
        for compression in ["lz4", "zstd"] {
            let packed = packed(compression, &zeros);
            let size = zeros.len() as u64;
            let body = chunk(compression, &packed, size, 0);
            assert!(ChunkRecords::of(&body, size).is_ok());
            match ChunkRecords::of(&body, size - 1) {
                Err(Damage::Bomb { size: found, .. }) => assert_eq!(found, size),
                _ => panic!("{compression}: taken"),
            }
            // A claim that is too small holds.
            let body = chunk(compression, &packed, 1000, 0);
            let records = ChunkRecords::of(&body, 1000).expect("a part");
            assert_eq!((records.data.len(), records.data.capacity()), (1000, 1000));
            let part = ChunkRecords::of_part(compression, &packed, 5000).expect("a part");
            assert_eq!((part.data.len(), part.data.capacity()), (5000, 5000));
        }
    }

    #[test]
    fn claims_of_a_chunk_reserve_no_memory_and_are_told() {
        for compression in ["", "lz4", "zstd"] {
            let data = record(5, 3, b"abc");
            let packed = packed(compression, &data);
            for claimed in [13, 1 << 31, u64::MAX] {
                let (_, fault) = walk(&chunk(compression, &packed, claimed, 0));
                assert!(fault.is_some(), "{compression} {claimed}");
            }
            let sound = chunk(compression, &packed, 12, crc32fast::hash(&data));
            assert!(walk(&sound).1.is_none());
            for end in 0..sound.len() {
                assert!(walk(&sound[..end]).1.is_some(), "{compression} to {end}");
            }
        }
        let other = chunk("brotli", b"x", 1, 0);
        let (_, fault) = walk(&other);
        let words = fault.expect("unknown").to_string();
        assert!(words.contains("brotli"), "{words}");
    }
}
