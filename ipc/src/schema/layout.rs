//! The layout of every wire type as a table, checked by the compiler, and its hash.

use std::mem::{align_of, offset_of, size_of};

use super::*;

/// Where one field of a wire type lies.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FieldLayout {
    /// Wire name of the type.
    pub type_name: &'static str,
    /// Size of the type [byte].
    pub type_size: usize,
    /// Alignment of the type [byte].
    pub type_align: usize,
    /// Name of the field.
    pub field: &'static str,
    /// Rust type of the field.
    pub field_type: &'static str,
    /// Offset of the field [byte].
    pub offset: usize,
    /// Size of the field [byte].
    pub size: usize,
}

/// A type of the wire, with the table of its fields.
pub trait Wire: bytemuck::Pod {
    /// Its fields, by their offset.
    const FIELDS: &'static [FieldLayout];
}

/// States size, alignment and offsets of each type; a build with any other layout fails.
macro_rules! wire_types {
    ($($name:literal $type:ident: $size:literal align $align:literal {
        $($offset:literal $field:ident: $field_type:ty,)*
    })*) => {
        $(
            const _: () = {
                assert!(size_of::<$type>() == $size);
                assert!(align_of::<$type>() == $align);
                $(assert!(offset_of!($type, $field) == $offset);)*
                assert!(0 $(+ size_of::<$field_type>())* == $size, "padding or a missing field");
                $(let _: fn(&$type) -> &$field_type = |value| &value.$field;)*
            };

            impl Wire for $type {
                const FIELDS: &'static [FieldLayout] = &[$(FieldLayout {
                    type_name: $name,
                    type_size: $size,
                    type_align: $align,
                    field: stringify!($field),
                    field_type: stringify!($field_type),
                    offset: $offset,
                    size: size_of::<$field_type>(),
                },)*];
            }
        )*

        /// The layout of every wire type, field by field, in the order of `docs/wire-format.md`.
        pub fn layout() -> Vec<FieldLayout> {
            [$($type::FIELDS),*].concat()
        }

        #[cfg(test)]
        fn iceoryx2_names() -> Vec<(&'static str, String)> {
            use iceoryx2::service::static_config::message_type_details::{TypeDetail, TypeVariant};
            vec![$((
                $name,
                TypeDetail::new::<$type>(TypeVariant::FixedSize).type_name().to_string(),
            ),)*]
        }
    };
}

wire_types! {
    "cosplat.Hello" Hello: 64 align 8 {
        0 wire_version: u32,
        4 pid: u32,
        8 schema_hash: u64,
        16 epoch: u64,
        24 server_version: [u8; 24],
        48 recorded_first: u64,
        56 recorded_last: u64,
    }
    "cosplat.v1.GaussianState" GaussianState: 64 align 64 {
        0 position: [f32; 3],
        12 color: [u8; 4],
        16 covariance: [f32; 6],
        40 object: u32,
        44 index: u32,
        48 rotation: [f32; 4],
    }
    "cosplat.v1.FrameHeader" FrameHeader: 80 align 8 {
        0 step: u64,
        8 sim_time: f64,
        16 dt: f64,
        24 epoch: u64,
        32 state_hash: u64,
        40 publish_ns: u64,
        48 count: u32,
        52 substeps: u32,
        56 flags: u32,
        60 reserved: [u32; 5],
    }
    "cosplat.v1.ChangeSlot" ChangeSlot: 64 align 64 {
        0 words: [u64; 8],
    }
    "cosplat.v1.ObjectChange" ObjectChange: 80 align 8 {
        0 object: u32,
        4 kind: u32,
        8 first: u32,
        12 count: u32,
        16 slot: u32,
        20 reserved: u32,
        24 position: [f64; 3],
        48 rotation: [f64; 4],
    }
    "cosplat.v1.ChangesHeader" ChangesHeader: 80 align 8 {
        0 step: u64,
        8 sim_time: f64,
        16 dt: f64,
        24 epoch: u64,
        32 state_hash: u64,
        40 publish_ns: u64,
        48 since: u64,
        56 count: u32,
        60 objects: u32,
        64 gaussians: u32,
        68 substeps: u32,
        72 flags: u32,
        76 reserved: u32,
    }
    "cosplat.v1.ObjectState" ObjectState: 216 align 8 {
        0 id: u32,
        4 fidelity: u32,
        8 mass: f64,
        16 com: [f64; 3],
        40 rotation: [f64; 4],
        72 linear_velocity: [f64; 3],
        96 angular_velocity: [f64; 3],
        120 inertia: [f64; 6],
        168 radius: f64,
        176 kinetic_energy: f64,
        184 elastic_energy: f64,
        192 contact_impulse: [f64; 3],
    }
    "cosplat.v1.ObjectsHeader" ObjectsHeader: 40 align 8 {
        0 step: u64,
        8 sim_time: f64,
        16 epoch: u64,
        24 count: u32,
        28 reserved: u32,
        32 state_hash: u64,
    }
    "cosplat.v1.Contact" Contact: 88 align 8 {
        0 object: u32,
        4 other: u32,
        8 kind: u32,
        12 reserved: u32,
        16 point: [f64; 3],
        40 normal: [f64; 3],
        64 impulse: [f64; 3],
    }
    "cosplat.v1.ContactsHeader" ContactsHeader: 32 align 8 {
        0 step: u64,
        8 sim_time: f64,
        16 epoch: u64,
        24 count: u32,
        28 total: u32,
    }
    "cosplat.v1.GaussianRest" GaussianRest: 48 align 4 {
        0 position: [f32; 3],
        12 opacity: f32,
        16 scale: [f32; 3],
        28 object: u32,
        32 rotation: [f32; 4],
    }
    "cosplat.v1.ObjectInfo" ObjectInfo: 144 align 8 {
        0 id: u32,
        4 fidelity: u32,
        8 particle_count: u32,
        12 gaussian_first: u32,
        16 gaussian_count: u32,
        20 law: u32,
        24 youngs_modulus: f64,
        32 poisson_ratio: f64,
        40 density: f64,
        48 name: [u8; 64],
        112 material: [u8; 32],
    }
    "cosplat.v1.SceneFile" SceneFile: 8216 align 8 {
        0 kind: u32,
        4 reserved: u32,
        8 length: u64,
        16 hash: u64,
        24 name: [u8; 4096],
        4120 path: [u8; 4096],
    }
    "cosplat.v1.SceneHeader" SceneHeader: 104 align 8 {
        0 epoch: u64,
        8 scene_hash: u64,
        16 frame_rate: f64,
        24 dx: f64,
        32 gravity: [f64; 3],
        56 bounds_min: [f32; 3],
        68 bounds_max: [f32; 3],
        80 gaussian_count: u32,
        84 particle_count: u32,
        88 object_count: u32,
        92 sh_degree: u32,
        96 feature_dim: u32,
        100 reserved: u32,
    }
    "cosplat.v1.MaterialSpec" MaterialSpec: 56 align 8 {
        0 law: u32,
        4 region: u32,
        8 youngs_modulus: f64,
        16 poisson_ratio: f64,
        24 parameters: [f64; 4],
    }
    "cosplat.v1.Command" Command: 136 align 8 {
        0 kind: u32,
        4 object: u32,
        8 sequence: u64,
        16 apply_at_step: u64,
        24 vector: [f64; 3],
        48 point: [f64; 3],
        72 radius: f64,
        80 material: MaterialSpec,
    }
    "cosplat.v1.CommandHeader" CommandHeader: 16 align 8 {
        0 client: u64,
        8 pid: u32,
        12 count: u32,
    }
    "cosplat.v1.Ack" Ack: 192 align 8 {
        0 sequence: u64,
        8 applied_at_step: u64,
        16 status: u32,
        20 reserved: u32,
        24 reason: [u8; 168],
    }
    "cosplat.v1.StepRequest" StepRequest: 96 align 8 {
        0 client: u64,
        8 pid: u32,
        12 count: u32,
        16 kind: u32,
        20 frames: u32,
        24 until: u32,
        28 pair_kind: u32,
        32 pair: [u32; 2],
        40 timeout_ns: u64,
        48 participant: [u8; 48],
    }
    "cosplat.v1.StepDone" StepDone: 192 align 8 {
        0 step: u64,
        8 sim_time: f64,
        16 epoch: u64,
        24 state_hash: u64,
        32 step_ns: u64,
        40 frames: u32,
        44 cause: u32,
        48 count: u32,
        52 contact_kind: u32,
        56 contact: [u32; 2],
        64 reason: [u8; 128],
    }
    "cosplat.v1.AppliedCommand" AppliedCommand: 152 align 8 {
        0 step: u64,
        8 client: u64,
        16 command: Command,
    }
    "cosplat.v1.JournalHeader" JournalHeader: 32 align 8 {
        0 step: u64,
        8 epoch: u64,
        16 first: u64,
        24 count: u32,
        28 reserved: u32,
    }
    "cosplat.v1.Status" Status: 448 align 8 {
        0 step: u64,
        8 sim_time: f64,
        16 heartbeat_ns: u64,
        24 epoch: u64,
        32 steps_per_second: f64,
        40 real_time_factor: f64,
        48 modelled_fraction: f64,
        56 dt: f64,
        64 kinetic_energy: f64,
        72 elastic_energy: f64,
        80 potential_energy: f64,
        88 linear_momentum: [f64; 3],
        112 angular_momentum: [f64; 3],
        136 frames_published: u64,
        144 frames_skipped: u64,
        152 rollbacks: u64,
        160 particles_left: u64,
        168 particles_quarantined: u64,
        176 commands_accepted: u64,
        184 commands_refused: u64,
        192 state_hash: u64,
        200 dt_limit: u32,
        204 dt_object: u32,
        208 server_state: u32,
        212 pid: u32,
        216 frame_readers: u32,
        220 has_changes: u32,
        224 spring_work: f64,
        232 edit_energy: f64,
        240 edit_mass: f64,
        248 step_seconds: f64,
        256 phase_shares: [f64; 10],
        336 cost_shares: [f64; 3],
        360 cost_substeps: [f64; 3],
        384 cost_dt: [f64; 3],
        408 cost_objects: [u32; 3],
        420 cost_limits: [u32; 3],
        432 cost_points: [u32; 3],
        444 reserved: u32,
    }
}

/// 64-bit FNV-1a hash of [`layout`], one line per field; equal hashes mean equal layouts.
pub fn schema_hash() -> u64 {
    let mut hash = 0xcbf2_9ce4_8422_2325_u64;
    for row in layout() {
        let line = format!(
            "{} {} {} {} {} {} {}\n",
            row.type_name,
            row.type_size,
            row.type_align,
            row.field,
            row.field_type,
            row.offset,
            row.size
        );
        for byte in line.bytes() {
            hash = (hash ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01b3);
        }
    }
    hash
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_table_uses_the_names_that_services_compare() {
        for (ours, theirs) in iceoryx2_names() {
            assert_eq!(ours, theirs);
        }
    }
}
