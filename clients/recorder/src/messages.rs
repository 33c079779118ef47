//! The JSON messages of a recording: `/status`, `/objects`, `/journal`, `/gaps`.
//!
//! Every number of the wire type is kept, so that a reader gets the wire type back bit for bit. Hashes and random
//! ids are written as 16 hexadecimal digits: JSON readers in other languages round integers above 2^53. JSON has no
//! infinity and no NaN: they become null, and come back as NaN.

use cosplat_ipc::schema as wire;
use serde::{Deserialize, Serialize};

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

/// Types that are never null.
macro_rules! always_there {
    ($($kind:ty),*) => {
        $(
            impl FromJson for $kind {
                fn from_json<'de, D: serde::Deserializer<'de>>(from: D) -> Result<Self, D::Error> {
                    Self::deserialize(from)
                }
            }
        )*
    };
}
always_there!(u32, u64, Hex64);

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
    /// Newest status board; it may be of a later step than the frame.
    pub board: Option<BoardRecord>,
}

impl StatusRecord {
    /// Record of a frame header and, where it could be read, the status board.
    pub fn new(header: &wire::FrameHeader, board: Option<&wire::Status>) -> Self {
        Self {
            step: header.step,
            sim_time: header.sim_time,
            dt: header.dt,
            epoch: Hex64(header.epoch),
            state_hash: Hex64(header.state_hash),
            publish_ns: header.publish_ns,
            count: header.count,
            substeps: header.substeps,
            flags: header.flags,
            board: board.map(BoardRecord::from),
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
            ..Default::default()
        }
    }
}

/// Declares the JSON twin of a wire type: same names, same numbers, conversions both ways.
macro_rules! twin {
    ($(#[$doc:meta])* $twin:ident of $wire:ident { $($field:ident: $kind:ty,)* }) => {
        $(#[$doc])*
        #[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
        pub struct $twin {
            $(
                #[doc = concat!("See [`", stringify!($wire), "::", stringify!($field), "`](wire::", stringify!($wire), "::", stringify!($field), ").")]
                #[serde(deserialize_with = "FromJson::from_json")]
                pub $field: $kind,
            )*
        }

        impl From<&wire::$wire> for $twin {
            fn from(w: &wire::$wire) -> Self {
                Self { $($field: <$kind>::from(w.$field),)* }
            }
        }

        impl From<&$twin> for wire::$wire {
            // Some wire types have reserved fields, some have none.
            #[allow(clippy::needless_update)]
            fn from(t: &$twin) -> Self {
                Self { $($field: t.$field.into(),)* ..Default::default() }
            }
        }
    };
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

twin! {
    /// The server's status board.
    BoardRecord of Status {
        step: u64,
        sim_time: f64,
        heartbeat_ns: u64,
        epoch: Hex64,
        steps_per_second: f64,
        real_time_factor: f64,
        modelled_fraction: f64,
        dt: f64,
        kinetic_energy: f64,
        elastic_energy: f64,
        potential_energy: f64,
        linear_momentum: V3,
        angular_momentum: V3,
        frames_published: u64,
        frames_skipped: u64,
        rollbacks: u64,
        particles_left: u64,
        particles_quarantined: u64,
        commands_accepted: u64,
        commands_refused: u64,
        state_hash: Hex64,
        dt_limit: u32,
        dt_object: u32,
        server_state: u32,
        pid: u32,
    }
}

twin! {
    /// One object of `/objects`.
    ObjectRecord of ObjectState {
        id: u32,
        fidelity: u32,
        mass: f64,
        com: V3,
        rotation: [f64; 4],
        linear_velocity: V3,
        angular_velocity: V3,
        inertia: [f64; 6],
        radius: f64,
        kinetic_energy: f64,
        elastic_energy: f64,
        contact_impulse: V3,
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
    /// The objects, in the server's order.
    pub objects: Vec<ObjectRecord>,
}

impl ObjectsRecord {
    /// Record of one `objects` message.
    pub fn new(header: &wire::ObjectsHeader, objects: &[wire::ObjectState]) -> Self {
        Self {
            step: header.step,
            sim_time: header.sim_time,
            epoch: Hex64(header.epoch),
            objects: objects.iter().map(ObjectRecord::from).collect(),
        }
    }

    /// The objects as wire types.
    pub fn states(&self) -> Vec<wire::ObjectState> {
        self.objects.iter().map(Into::into).collect()
    }
}

twin! {
    /// Material of a journal entry.
    MaterialRecord of MaterialSpec {
        law: u32,
        region: u32,
        youngs_modulus: f64,
        poisson_ratio: f64,
        parameters: [f64; 4],
    }
}

/// `/journal`: a command as it was applied.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct JournalRecord {
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

impl From<&wire::AppliedCommand> for JournalRecord {
    fn from(entry: &wire::AppliedCommand) -> Self {
        let command = &entry.command;
        Self {
            step: entry.step,
            client: Hex64(entry.client),
            name: command_name(command.kind).to_owned(),
            kind: command.kind,
            object: command.object,
            sequence: command.sequence,
            apply_at_step: command.apply_at_step,
            vector: command.vector,
            point: command.point,
            radius: command.radius,
            material: (&command.material).into(),
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
                material: (&record.material).into(),
            },
        }
    }
}

/// Name of a command kind.
fn command_name(kind: u32) -> &'static str {
    match kind {
        wire::COMMAND_IMPULSE => "impulse",
        wire::COMMAND_IMPULSE_AT => "impulse_at",
        wire::COMMAND_SET_VELOCITY => "set_velocity",
        wire::COMMAND_SET_MATERIAL => "set_material",
        wire::COMMAND_SET_GRAVITY => "set_gravity",
        wire::COMMAND_PAUSE => "pause",
        wire::COMMAND_RESUME => "resume",
        wire::COMMAND_RESET => "reset",
        wire::COMMAND_STOP => "stop",
        wire::COMMAND_MOVE_COLLIDER => "move_collider",
        wire::COMMAND_PIN => "pin",
        wire::COMMAND_RELEASE => "release",
        _ => "unknown",
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
mod tests {
    use super::*;

    /// Numbers whose shortest decimal form is long, very large, very small, or negative zero.
    fn awkward(i: usize) -> f64 {
        [
            0.1,
            -0.0,
            5e-324,
            f64::MAX,
            1.0 / 3.0,
            123_456_789.123_456_79,
            -2.5e-17,
        ][i % 7]
    }

    #[test]
    fn objects_come_back_bit_for_bit() {
        let v = |o: usize| [awkward(o), awkward(o + 1), awkward(o + 2)];
        let object = wire::ObjectState {
            id: 7,
            fidelity: 2,
            mass: awkward(0),
            com: v(1),
            rotation: [awkward(2), awkward(3), awkward(4), awkward(5)],
            linear_velocity: v(3),
            angular_velocity: v(4),
            inertia: std::array::from_fn(awkward),
            radius: awkward(6),
            kinetic_energy: awkward(2),
            elastic_energy: awkward(4),
            contact_impulse: v(5),
        };
        let json = serde_json::to_vec(&ObjectRecord::from(&object)).unwrap();
        let back: ObjectRecord = serde_json::from_slice(&json).unwrap();
        assert_eq!(
            bytemuck::bytes_of(&wire::ObjectState::from(&back)),
            bytemuck::bytes_of(&object)
        );
    }

    #[test]
    fn journal_and_status_come_back_bit_for_bit() {
        let entry = wire::AppliedCommand {
            step: u64::MAX >> 12,
            client: u64::MAX - 1,
            command: wire::Command {
                kind: wire::COMMAND_SET_MATERIAL,
                object: 3,
                sequence: 9,
                apply_at_step: 12,
                vector: [awkward(0), awkward(1), awkward(2)],
                point: [awkward(4), awkward(5), awkward(6)],
                radius: awkward(4),
                material: wire::MaterialSpec {
                    law: 6,
                    region: 2,
                    youngs_modulus: 1e6 / 3.0,
                    poisson_ratio: 0.3,
                    parameters: [awkward(3), awkward(1), 0.4, 0.0],
                },
            },
        };
        let json = serde_json::to_vec(&JournalRecord::from(&entry)).unwrap();
        let back: JournalRecord = serde_json::from_slice(&json).unwrap();
        assert_eq!(
            bytemuck::bytes_of(&wire::AppliedCommand::from(&back)),
            bytemuck::bytes_of(&entry)
        );

        let header = wire::FrameHeader {
            step: 5,
            sim_time: 5.0 / 60.0,
            dt: 1.0 / 777.0,
            epoch: u64::MAX,
            state_hash: 0xdead_beef_dead_beef,
            publish_ns: 77,
            count: 4,
            substeps: 13,
            flags: wire::FRAME_FLAG_LAST,
            ..Default::default()
        };
        let status = wire::Status {
            state_hash: u64::MAX - 5,
            kinetic_energy: awkward(4),
            ..Default::default()
        };
        let json = serde_json::to_vec(&StatusRecord::new(&header, Some(&status))).unwrap();
        let back: StatusRecord = serde_json::from_slice(&json).unwrap();
        assert_eq!(
            bytemuck::bytes_of(&back.header()),
            bytemuck::bytes_of(&header)
        );
        let board = wire::Status::from(back.board.as_ref().unwrap());
        assert_eq!(bytemuck::bytes_of(&board), bytemuck::bytes_of(&status));
    }

    #[test]
    fn numbers_that_are_not_finite_do_not_make_a_message_unreadable() {
        let status = wire::Status {
            kinetic_energy: f64::INFINITY,
            linear_momentum: [1.0, f64::NAN, 3.0],
            ..Default::default()
        };
        let header = wire::FrameHeader {
            dt: f64::NAN,
            ..Default::default()
        };
        let json = serde_json::to_vec(&StatusRecord::new(&header, Some(&status))).unwrap();
        let back: StatusRecord = serde_json::from_slice(&json).unwrap();
        assert!(back.dt.is_nan());
        let board = back.board.unwrap();
        assert!(board.kinetic_energy.is_nan() && board.linear_momentum[1].is_nan());
        assert_eq!(
            (board.linear_momentum[0], board.linear_momentum[2]),
            (1.0, 3.0)
        );
        let short = r#"{"law": 1, "youngs_modulus": null}"#;
        assert!(serde_json::from_str::<MaterialRecord>(short).is_err());
    }

    #[test]
    fn every_schema_names_exactly_the_fields_that_are_written() {
        let board = BoardRecord::from(&wire::Status::default());
        let status = StatusRecord {
            board: Some(board),
            ..StatusRecord::new(&wire::FrameHeader::default(), None)
        };
        let objects = ObjectsRecord::new(&wire::ObjectsHeader::default(), &[Default::default()]);
        let journal = JournalRecord::from(&wire::AppliedCommand::default());
        let gap = GapRecord {
            epoch: Hex64(1),
            from_step: 2,
            to_step: Some(3),
            reason: GapReason::Missed,
        };
        check(&status, crate::topics::STATUS_SCHEMA);
        check(&objects, crate::topics::OBJECTS_SCHEMA);
        check(&journal, crate::topics::JOURNAL_SCHEMA);
        check(&gap, crate::topics::GAPS_SCHEMA);

        fn check(value: &impl Serialize, schema: &str) {
            let schema: serde_json::Value = serde_json::from_str(schema).unwrap();
            same_shape(&serde_json::to_value(value).unwrap(), &schema, "");
        }

        fn same_shape(value: &serde_json::Value, schema: &serde_json::Value, at: &str) {
            use serde_json::Value;
            let kinds = match &schema["type"] {
                Value::String(one) => vec![one.as_str()],
                Value::Array(many) => many.iter().filter_map(Value::as_str).collect(),
                other => panic!("{at}: schema type is {other}"),
            };
            let kind = match value {
                Value::Object(_) => "object",
                Value::Array(_) => "array",
                Value::String(_) => "string",
                Value::Number(n) if n.is_f64() => "number",
                Value::Number(_) => "integer",
                other => panic!("{at}: unexpected value {other}"),
            };
            assert!(
                kinds.contains(&kind),
                "{at}: value is {kind}, schema {kinds:?}"
            );
            if let Value::Object(map) = value {
                let properties = schema["properties"].as_object().unwrap();
                let names: Vec<_> = properties.keys().collect();
                assert_eq!(map.keys().collect::<Vec<_>>(), names, "fields at {at}");
                for (name, inner) in map {
                    same_shape(inner, &properties[name], &format!("{at}/{name}"));
                }
            }
            if let Value::Array(items) = value {
                same_shape(&items[0], &schema["items"], &format!("{at}[]"));
            }
        }
    }
}
