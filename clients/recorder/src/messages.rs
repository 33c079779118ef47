//! The JSON messages of a recording: `/status`, `/objects`, `/journal`, `/gaps`.
//!
//! Every number of the wire type is kept, so that a reader gets the wire type back bit for bit. Hashes and random
//! ids are written as 16 hexadecimal digits: JSON readers in other languages round integers above 2^53. JSON has no
//! infinity and no NaN: they become null, and come back as NaN.

mod twin;

use cosplat_ipc::schema as wire;
use serde::{Deserialize, Serialize};

pub use twin::{BoardRecord, MaterialRecord, ObjectRecord, Twin, is_added};

/// A 64-bit hash or random id, in JSON a string of 16 hexadecimal digits.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Hex64(pub u64);

impl Serialize for Hex64 {
    fn serialize<S: serde::Serializer>(&self, to: S) -> Result<S::Ok, S::Error> {
        to.collect_str(&format_args!("{:016x}", self.0))
    }
}

impl<'de> Deserialize<'de> for Hex64 {
    fn deserialize<D: serde::Deserializer<'de>>(from: D) -> Result<Self, D::Error> {
        let text = String::deserialize(from)?;
        u64::from_str_radix(&text, 16).map(Self).map_err(|_| {
            serde::de::Error::custom(format!("expected 16 hexadecimal digits, found {text:?}"))
        })
    }
}

/// Numbers that are null in JSON where they are not finite.
trait FromJson: Sized {
    fn from_json<'de, D: serde::Deserializer<'de>>(from: D) -> Result<Self, D::Error>;
}

impl FromJson for f64 {
    fn from_json<'de, D: serde::Deserializer<'de>>(from: D) -> Result<Self, D::Error> {
        Ok(Option::deserialize(from)?.unwrap_or(Self::NAN))
    }
}

impl<const N: usize> FromJson for [f64; N] {
    fn from_json<'de, D: serde::Deserializer<'de>>(from: D) -> Result<Self, D::Error> {
        let values = Vec::<Option<f64>>::deserialize(from)?;
        let mut array = [f64::NAN; N];
        if values.len() != N {
            let found = values.len();
            return Err(serde::de::Error::custom(format!(
                "expected {N} numbers, found {found}"
            )));
        }
        for (to, value) in array.iter_mut().zip(values) {
            *to = value.unwrap_or(f64::NAN);
        }
        Ok(array)
    }
}

/// `/status`: header of a frame, and the server's status board as it was read with the frame.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct StatusRecord {
    /// Step count.
    pub step: u64,
    /// Simulated time at the end of the step [s].
    #[serde(deserialize_with = "FromJson::from_json")]
    pub sim_time: f64,
    /// Size of the last substep [s].
    #[serde(deserialize_with = "FromJson::from_json")]
    pub dt: f64,
    /// Identifies the published scene.
    pub epoch: Hex64,
    /// Hash of the complete simulation state.
    pub state_hash: Hex64,
    /// `CLOCK_MONOTONIC` when the frame was sent [ns].
    pub publish_ns: u64,
    /// Gaussians in the frame.
    pub count: u32,
    /// Substeps in the step.
    pub substeps: u32,
    /// `FRAME_FLAG_*`.
    pub flags: u32,
    /// Step of the frame that this one's changes build on, its own where it is whole; `None` where one message of
    /// `/gaussians` has all.
    #[serde(default)]
    pub since: Option<u64>,
    /// Newest status board; it may be of a later step than the frame.
    pub board: Option<BoardRecord>,
}

impl StatusRecord {
    /// Record of a frame header and, where it could be read, the status board.
    pub fn new(header: &wire::FrameHeader, board: Option<&wire::Status>) -> Self {
        // No field is left out: one that is added has to be named here.
        let wire::FrameHeader {
            step,
            sim_time,
            dt,
            epoch,
            state_hash,
            publish_ns,
            count,
            substeps,
            flags,
            reserved: _,
        } = *header;
        Self {
            step,
            sim_time,
            dt,
            epoch: Hex64(epoch),
            state_hash: Hex64(state_hash),
            publish_ns,
            count,
            substeps,
            flags,
            since: None,
            board: board.copied().map(Twin),
        }
    }

    /// The frame header.
    pub fn header(&self) -> wire::FrameHeader {
        wire::FrameHeader {
            step: self.step,
            sim_time: self.sim_time,
            dt: self.dt,
            epoch: self.epoch.0,
            state_hash: self.state_hash.0,
            publish_ns: self.publish_ns,
            count: self.count,
            substeps: self.substeps,
            flags: self.flags,
            reserved: Default::default(),
        }
    }
}

type V3 = [f64; 3];

impl From<u64> for Hex64 {
    fn from(value: u64) -> Self {
        Self(value)
    }
}

impl From<Hex64> for u64 {
    fn from(value: Hex64) -> Self {
        value.0
    }
}

/// `/objects`: the state of every object after a step.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ObjectsRecord {
    /// Step count, as in `/status`.
    pub step: u64,
    /// Simulated time [s].
    #[serde(deserialize_with = "FromJson::from_json")]
    pub sim_time: f64,
    /// Identifies the published scene.
    pub epoch: Hex64,
    /// Hash of the complete simulation state; recorders before it was told wrote none.
    pub state_hash: Option<Hex64>,
    /// How many objects there are; `None` where all are told.
    #[serde(default)]
    pub count: Option<u32>,
    /// The objects that are not as they were, in the server's order.
    pub objects: Vec<ObjectRecord>,
}

impl ObjectsRecord {
    /// Record of one `objects` message with those of its objects that are told.
    pub fn new(header: &wire::ObjectsHeader, objects: &[wire::ObjectState]) -> Self {
        let wire::ObjectsHeader {
            step,
            sim_time,
            epoch,
            count,
            reserved: _,
            state_hash,
        } = *header;
        Self {
            count: (count as usize != objects.len()).then_some(count),
            step,
            sim_time,
            epoch: Hex64(epoch),
            state_hash: Some(Hex64(state_hash)),
            objects: objects.iter().copied().map(Twin).collect(),
        }
    }

    /// The header as wire type; a hash that was not recorded is 0.
    pub fn header(&self) -> wire::ObjectsHeader {
        wire::ObjectsHeader {
            step: self.step,
            sim_time: self.sim_time,
            epoch: self.epoch.0,
            count: self.count.unwrap_or(self.objects.len() as u32),
            state_hash: self.state_hash.map_or(0, u64::from),
            reserved: 0,
        }
    }

    /// The objects that are told as wire types.
    pub fn states(&self) -> Vec<wire::ObjectState> {
        self.objects.iter().map(|object| object.0).collect()
    }
}

/// A command as it was applied, and its place among those of its run.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct JournalEntry {
    /// The command.
    pub applied: wire::AppliedCommand,
    /// Epoch of the run; `None` in recordings of older recorders.
    pub epoch: Option<u64>,
    /// Commands that the run applied before; `None` in recordings of older recorders.
    pub index: Option<u64>,
}

/// `/journal`: a command as it was applied.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct JournalRecord {
    /// Epoch of the run.
    pub epoch: Option<Hex64>,
    /// Commands that the run applied before: a jump shows that some are missing.
    pub index: Option<u64>,
    /// Step at whose start it took effect.
    pub step: u64,
    /// Who sent it.
    pub client: Hex64,
    /// Name of `kind`, for people.
    pub name: String,
    /// `COMMAND_*`.
    pub kind: u32,
    /// Object id.
    pub object: u32,
    /// The sender's running number.
    pub sequence: u64,
    /// Step the sender asked for.
    pub apply_at_step: u64,
    /// Main vector; its meaning depends on `kind`.
    #[serde(deserialize_with = "FromJson::from_json")]
    pub vector: V3,
    /// Point [m] or second vector.
    #[serde(deserialize_with = "FromJson::from_json")]
    pub point: V3,
    /// Radius [m].
    #[serde(deserialize_with = "FromJson::from_json")]
    pub radius: f64,
    /// For `COMMAND_SET_MATERIAL`.
    pub material: MaterialRecord,
}

impl From<&JournalEntry> for JournalRecord {
    fn from(entry: &JournalEntry) -> Self {
        let JournalEntry {
            applied,
            epoch,
            index,
        } = entry;
        let command = &applied.command;
        Self {
            epoch: epoch.map(Hex64),
            index: *index,
            step: applied.step,
            client: Hex64(applied.client),
            name: wire::command_name(command.kind).to_owned(),
            kind: command.kind,
            object: command.object,
            sequence: command.sequence,
            apply_at_step: command.apply_at_step,
            vector: command.vector,
            point: command.point,
            radius: command.radius,
            material: Twin(command.material),
        }
    }
}

impl From<&JournalRecord> for JournalEntry {
    fn from(record: &JournalRecord) -> Self {
        Self {
            applied: record.into(),
            epoch: record.epoch.map(u64::from),
            index: record.index,
        }
    }
}

impl From<&JournalRecord> for wire::AppliedCommand {
    fn from(record: &JournalRecord) -> Self {
        Self {
            step: record.step,
            client: record.client.0,
            command: wire::Command {
                kind: record.kind,
                object: record.object,
                sequence: record.sequence,
                apply_at_step: record.apply_at_step,
                vector: record.vector,
                point: record.point,
                radius: record.radius,
                material: record.material.0,
            },
        }
    }
}

/// `/gaps`: steps that are not in the recording.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct GapRecord {
    /// Scene epoch of the missing steps.
    pub epoch: Hex64,
    /// First missing step.
    pub from_step: u64,
    /// Last missing step; `None` when the server ended and how far it got is unknown.
    pub to_step: Option<u64>,
    /// Why.
    pub reason: GapReason,
}

/// Why steps are missing.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum GapReason {
    /// The server did not publish them, or the recorder was too slow to take them.
    Missed,
    /// The server was started anew; steps after the last recorded one may have happened.
    ServerRestarted,
    /// The file was damaged there; written by the recovery.
    Damaged,
}

#[cfg(test)]
mod tests;
