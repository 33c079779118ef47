//! Frames by what changed in them: of most steps what moved, of some all of it.

use cosplat_ipc::assembly::rows;
use cosplat_ipc::schema::{CHANGE_PLACED, ChangeSlot, ChangesHeader, Status};
use foxglove::messages::{FrameTransform, FrameTransforms, Quaternion, Vector3};
use prost::Message;

use super::{RecordingWriter, Stamp};
use crate::RecordingError;
use crate::kept::{KeptObject, is_in_world};
use crate::messages::StatusRecord;
use crate::point_cloud::{self, WORLD_FRAME, timestamp};

/// Steps after which a frame is written whole, at the latest.
const WHOLE_EVERY: u64 = 300;
/// Bytes of changes after which one is, in sizes of a whole one: what it costs, at most a sixteenth.
const WHOLE_PER_CHANGES: u64 = 16;

/// When a frame was written whole, and what was written since.
#[derive(Default)]
pub(super) struct Chain {
    /// Epoch and step of the newest frame.
    last: Option<(u64, u64)>,
    /// Whether the next one has to be whole.
    is_cut: bool,
    steps: u64,
    bytes: u64,
    whole_bytes: u64,
}

impl Chain {
    /// Whether the next frame is to be written whole.
    pub(super) fn is_due(&self) -> bool {
        self.is_cut
            || self.last.is_none()
            || self.steps >= WHOLE_EVERY
            || self.bytes >= WHOLE_PER_CHANGES * self.whole_bytes
    }

    /// The next frame is to be written whole.
    pub(super) fn cut(&mut self) {
        self.is_cut = true;
    }

    fn wrote(&mut self, (epoch, step): (u64, u64), is_whole: bool, bytes: u64) {
        self.last = Some((epoch, step));
        self.is_cut = false;
        if is_whole {
            (self.steps, self.bytes, self.whole_bytes) = (0, 0, bytes);
        } else {
            (self.steps, self.bytes) = (self.steps + 1, self.bytes + bytes);
        }
    }
}

impl RecordingWriter {
    /// Records what changed in a step, or where that is due all of it, and ends the chunk when it is large enough. A message
    /// that builds on another than the newest one is left out: a complete one has to come first.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn changes(
        &mut self,
        header: &ChangesHeader,
        slots: &[ChangeSlot],
        status: Option<&Status>,
    ) -> Result<(), RecordingError> {
        let rows = rows(header, slots);
        if header.is_complete() {
            self.kept.retain(rows);
        } else if self.chain.last != Some((header.epoch, header.since)) {
            return Ok(());
        }
        rows.iter().for_each(|row| self.kept.take(row, slots));
        let is_whole = self.chain.is_due();
        let stamp = Stamp {
            step: header.step,
            log_time: self.time.at(header.sim_time),
            publish_time: header.publish_ns.saturating_add_signed(self.wall_offset),
        };
        let before = self.bytes;
        let since = match self.chain.last {
            Some((_, last)) if !is_whole => last,
            _ => header.step,
        };
        let record = StatusRecord {
            since: Some(since),
            ..StatusRecord::new(&header.frame(), status)
        };
        self.json(self.channels.status, stamp, &record)?;
        let told: Vec<(u32, bool)> = match is_whole {
            true => self.kept.ids().into_iter().map(|id| (id, true)).collect(),
            false => rows
                .iter()
                .map(|row| (row.object, row.kind != CHANGE_PLACED))
                .collect(),
        };
        let mut places = Vec::new();
        // Lent for as long as they are written.
        let mut kept = std::mem::take(&mut self.kept);
        for (object, has_gaussians) in told {
            if let Some(kept) = kept.get_mut(object) {
                places.extend(self.object(stamp, kept, has_gaussians)?);
            }
        }
        self.kept = kept;
        let message = FrameTransforms { transforms: places }.encode_to_vec();
        self.put(self.channels.places, stamp, &message)?;
        let position = (header.epoch, header.step);
        self.chain.wrote(position, is_whole, self.bytes - before);
        match self.pending >= self.chunk_bytes {
            true => self.flush(),
            false => Ok(()),
        }
    }

    /// Records the Gaussians of an object, where they are told, and says where they are, if they are not in the world frame.
    fn object(
        &mut self,
        stamp: Stamp,
        kept: &mut KeptObject,
        has_gaussians: bool,
    ) -> Result<Option<FrameTransform>, RecordingError> {
        let (row, is_in_world) = (kept.row, is_in_world(&kept.row));
        let frame = match is_in_world {
            true => WORLD_FRAME.to_owned(),
            false => form_frame(row.object),
        };
        if has_gaussians && row.count > 0 {
            let channel = self
                .channels
                .object(&mut self.mcap, row.object)
                .map_err(|e| RecordingError::write(&self.path, e))?;
            let length = kept.points.len();
            point_cloud::encode_description(stamp.log_time, &frame, &mut kept.points);
            let written = self.put(channel, stamp, &kept.points);
            kept.points.truncate(length);
            written?;
        }
        let ([x, y, z], [qx, qy, qz, qw]) = (row.position, row.rotation);
        Ok((!is_in_world).then(|| FrameTransform {
            timestamp: Some(timestamp(stamp.log_time)),
            parent_frame_id: WORLD_FRAME.to_owned(),
            child_frame_id: frame,
            translation: Some(Vector3 { x, y, z }),
            rotation: Some(Quaternion {
                x: qx,
                y: qy,
                z: qz,
                w: qw,
            }),
        }))
    }
}

/// Name of an object's own frame.
pub(crate) fn form_frame(object: u32) -> String {
    format!("form/{object}")
}
