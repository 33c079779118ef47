//! Point clouds made small for compression: what did not change becomes zero, and bytes of like meaning lie together.

use std::borrow::Cow;
use std::collections::BTreeMap;

use cosplat_ipc::schema::GaussianState;

/// Message encoding of channels with such messages.
pub(crate) const ENCODING: &str = "cosplat.packed";

/// First bytes of a point cloud as this program writes it: the field of the points.
const POINTS_KEY: u8 = 6 << 3 | 2;
const STRIDE: usize = size_of::<GaussianState>();

/// A message as it is.
const AS_IS: u8 = 0;
/// Points by themselves.
const KEY: u8 = 1;
/// Points that differ from those of the message before in the bits that are one.
const DELTA: u8 = 2;

/// Points of the newest message of each channel.
#[derive(Clone, Default)]
pub(crate) struct Points(BTreeMap<u16, Vec<u8>>);

impl Points {
    /// Forgets all, so that what follows can be read by itself.
    pub(crate) fn clear(&mut self) {
        self.0.clear();
    }

    /// The message, packed.
    pub(crate) fn pack(&mut self, channel: u16, message: &[u8]) -> Vec<u8> {
        let Some((points, description)) = split(message) else {
            self.0.remove(&channel);
            return [&[AS_IS], message].concat();
        };
        let before = self.0.get(&channel).filter(|b| b.len() == points.len());
        let mut packed = Vec::with_capacity(message.len() + 16);
        packed.push(if before.is_some() { DELTA } else { KEY });
        packed.extend_from_slice(&(points.len() as u64).to_le_bytes());
        let count = points.len() / STRIDE;
        for byte in 0..STRIDE {
            let column = (0..count).map(|n| n * STRIDE + byte);
            match before {
                Some(before) => packed.extend(column.map(|at| points[at] ^ before[at])),
                None => packed.extend(column.map(|at| points[at])),
            }
        }
        packed.extend_from_slice(description);
        self.0.insert(channel, points.to_vec());
        packed
    }

    /// The message as it was.
    ///
    /// # Errors
    /// A sentence when it was not packed by [`pack`](Self::pack), or builds on a message that was not read.
    pub(crate) fn unpack<'a>(
        &mut self,
        channel: u16,
        packed: &'a [u8],
    ) -> Result<Cow<'a, [u8]>, String> {
        let (kind, rest) = packed.split_first().ok_or("an empty packed message")?;
        if *kind == AS_IS {
            self.0.remove(&channel);
            return Ok(Cow::Borrowed(rest));
        }
        let (length, rest) = rest.split_first_chunk().ok_or("a cut packed message")?;
        let length = usize::try_from(u64::from_le_bytes(*length)).unwrap_or(usize::MAX);
        let parts = rest
            .split_at_checked(length)
            .filter(|_| length.is_multiple_of(STRIDE));
        let (columns, description) = parts.ok_or_else(|| {
            format!(
                "{length} bytes of points in a packed message of {}",
                rest.len()
            )
        })?;
        let before = match *kind {
            KEY => None,
            DELTA => Some(
                self.0
                    .get(&channel)
                    .filter(|before| before.len() == length)
                    .ok_or("a packed message builds on one that was not read")?,
            ),
            other => return Err(format!("a packed message of kind {other}, expected 0 to 2")),
        };
        let mut points = vec![0; length];
        let count = length / STRIDE;
        for (byte, column) in columns.chunks_exact(count.max(1)).enumerate() {
            for (n, value) in column.iter().enumerate() {
                points[n * STRIDE + byte] = *value;
            }
        }
        if let Some(before) = before {
            points
                .iter_mut()
                .zip(before)
                .for_each(|(to, from)| *to ^= from);
        }
        let mut message = Vec::with_capacity(packed.len() + 16);
        message.push(POINTS_KEY);
        prost::encoding::encode_varint(length as u64, &mut message);
        message.extend_from_slice(&points);
        message.extend_from_slice(description);
        self.0.insert(channel, points);
        Ok(Cow::Owned(message))
    }
}

/// Points and what follows of a point cloud that begins with them, as this program writes it.
fn split(message: &[u8]) -> Option<(&[u8], &[u8])> {
    let mut rest = message.strip_prefix(&[POINTS_KEY])?;
    let length = usize::try_from(prost::encoding::decode_varint(&mut rest).ok()?).ok()?;
    let (points, description) = rest.split_at_checked(length)?;
    // Another way to write the same length would not come back.
    let canonical = prost::encoding::encoded_len_varint(length as u64);
    let is_ours = length.is_multiple_of(STRIDE) && message.len() == 1 + canonical + rest.len();
    is_ours.then_some((points, description))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::point_cloud::{WORLD_FRAME, encode_description, encode_points};

    fn message(seed: u8, count: usize) -> Vec<u8> {
        let bytes: Vec<u8> = (0..count * STRIDE).map(|n| seed ^ (n * n) as u8).collect();
        let mut message = Vec::new();
        encode_points(&bytemuck::pod_collect_to_vec(&bytes), &mut message);
        encode_description(7, WORLD_FRAME, &mut message);
        message
    }

    #[test]
    fn packed_messages_come_back_byte_for_byte() {
        let (mut writer, mut reader) = (Points::default(), Points::default());
        let mut others = vec![vec![], vec![1, 2, 3], vec![POINTS_KEY, 0x80, 0]];
        others.push(message(1, 5));
        let messages = [
            message(1, 5),
            message(2, 5),
            message(2, 5),
            message(3, 4),
            message(3, 0),
        ];
        for (n, message) in messages.iter().chain(&others).enumerate() {
            let packed = writer.pack(3, message);
            let back = reader.unpack(3, &packed).expect("packed here");
            assert_eq!(&back[..], &message[..], "{n}");
        }
        // The same again is nothing but zeros.
        let packed = [writer.pack(3, &messages[0]), writer.pack(3, &messages[0])];
        assert!(packed[1][9..9 + 5 * STRIDE].iter().all(|byte| *byte == 0));
        assert_eq!(packed[1][0], DELTA);
    }

    #[test]
    fn a_message_without_the_one_before_is_refused() {
        let mut writer = Points::default();
        writer.pack(3, &message(1, 5));
        let delta = writer.pack(3, &message(2, 5));
        let why = Points::default().unpack(3, &delta).expect_err("a delta");
        assert!(why.contains("not read"), "{why}");
        for bad in [
            &[][..],
            &[9, 1],
            &[KEY, 1],
            &[KEY, 255, 255, 255, 255, 255, 255, 255, 255],
        ] {
            assert!(Points::default().unpack(3, bad).is_err(), "{bad:?}");
        }
        // Cut anywhere, it is refused or lacks its description; it never reads beyond its end.
        let key = Points::default().pack(3, &message(1, 5));
        for end in 0..key.len() {
            let _ = Points::default().unpack(3, &key[..end]);
        }
    }
}
