//! Records of a file that nobody vouches for, parsed only when the lengths in them fit.
//!
//! The parser takes these lengths for granted: it sets memory aside for what they claim, up to 4 GiB a string, and reads
//! before the start of an attachment that is too short.

use mcap::records::{Record, op};
use mcap::{McapError, McapResult};

/// Content of a record.
///
/// # Errors
/// When a length in it says more than there is, or as [`mcap::parse_record`] says.
pub(crate) fn parse(opcode: u8, body: &[u8]) -> McapResult<Record<'_>> {
    match lengths_fit(opcode, body) {
        Some(()) => mcap::parse_record(opcode, body),
        None => Err(McapError::UnexpectedEof),
    }
}

/// `None` when a string of the record, or what must follow its strings, is longer than the record.
fn lengths_fit(opcode: u8, body: &[u8]) -> Option<()> {
    // Bytes of numbers in front, strings, bytes of numbers behind: layouts of the MCAP specification.
    let (front, strings, behind) = match opcode {
        op::HEADER => (0, 2, 0),
        op::SCHEMA => (2, 2, 4),
        op::CHANNEL => (4, 2, 4),
        op::METADATA => (0, 1, 4),
        op::ATTACHMENT => (16, 2, 12),
        _ => return Some(()),
    };
    let mut rest = body.get(front..)?;
    for _ in 0..strings {
        (_, rest) = counted(rest)?;
    }
    if matches!(opcode, op::CHANNEL | op::METADATA) {
        let (mut map, _) = counted(rest)?;
        while !map.is_empty() {
            // Of a key without a value the parser would look behind the map.
            for _key_and_value in 0..2 {
                (_, map) = counted(map)?;
            }
        }
    }
    (rest.len() >= behind).then_some(())
}

/// What a length of four bytes counts, and what follows.
fn counted(bytes: &[u8]) -> Option<(&[u8], &[u8])> {
    let (length, rest) = bytes.split_first_chunk()?;
    rest.split_at_checked(u32::from_le_bytes(*length) as usize)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn string(text: &str) -> Vec<u8> {
        [&(text.len() as u32).to_le_bytes()[..], text.as_bytes()].concat()
    }

    /// A sound record of each kind that has lengths, and where they are.
    fn sound() -> Vec<(u8, Vec<u8>, Vec<usize>)> {
        let (a, b) = (string("name"), string("text"));
        let entries = [a.clone(), b.clone()].concat();
        let map = [&(entries.len() as u32).to_le_bytes()[..], &entries].concat();
        let sizes = [&[0; 8][..], &[0; 4]].concat();
        vec![
            (op::HEADER, [a.clone(), b.clone()].concat(), vec![0, 8]),
            (
                op::SCHEMA,
                [&[1, 0][..], &a, &b, &[0; 4]].concat(),
                vec![2, 10],
            ),
            (
                op::CHANNEL,
                [&[1, 0, 0, 0][..], &a, &b, &map].concat(),
                vec![4, 12, 20, 24, 32],
            ),
            (op::METADATA, [a.clone(), map].concat(), vec![0, 8, 12, 20]),
            (
                op::ATTACHMENT,
                [&[0; 16][..], &a, &b, &sizes].concat(),
                vec![16, 24],
            ),
        ]
    }

    #[test]
    fn a_key_without_a_value_is_refused() {
        let key = string("name");
        let map = [&(key.len() as u32).to_le_bytes()[..], &key].concat();
        let behind = [0xff; 8];
        for (opcode, front) in [
            (op::CHANNEL, [&[1, 0, 0, 0][..], &key, &key].concat()),
            (op::METADATA, key.clone()),
        ] {
            let body = [&front[..], &map, &behind].concat();
            assert!(parse(opcode, &body).is_err());
            assert_eq!(lengths_fit(opcode, &body), None, "{opcode}");
        }
    }

    #[test]
    fn a_length_beyond_its_record_is_refused_before_it_is_used() {
        for (opcode, body, lengths) in sound() {
            parse(opcode, &body).unwrap_or_else(|error| panic!("{opcode}: {error}"));
            for at in lengths {
                for length in [1_u32 << 31, u32::MAX, body.len() as u32] {
                    let mut body = body.clone();
                    body[at..at + 4].copy_from_slice(&length.to_le_bytes());
                    assert_eq!(lengths_fit(opcode, &body), None, "{opcode} at {at}");
                }
            }
            for end in 0..body.len() {
                assert_eq!(lengths_fit(opcode, &body[..end]), None, "{opcode} to {end}");
            }
        }
    }
}
