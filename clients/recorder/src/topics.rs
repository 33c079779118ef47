//! Names of a recording: topics, schemas, metadata, attachments.

use std::collections::BTreeMap;

use foxglove::messages::{FrameTransforms, PointCloud};
use foxglove::{Encode, Schema};

use crate::writer::Mcap;

/// Topic of the Gaussians, one `foxglove.PointCloud` per step.
pub const GAUSSIANS_TOPIC: &str = "/gaussians";
/// Topic of the object frames, one `foxglove.FrameTransforms` per step.
pub const TRANSFORMS_TOPIC: &str = "/objects/tf";
/// Topic of the object states, JSON, one per step.
pub const OBJECTS_TOPIC: &str = "/objects";
/// Topic of frame headers and server status, JSON, one per step.
pub const STATUS_TOPIC: &str = "/status";
/// Topic of applied commands, JSON, one per command.
pub const JOURNAL_TOPIC: &str = "/journal";
/// Topic of missing steps, JSON, one per gap.
pub const GAPS_TOPIC: &str = "/gaps";
/// Name of the metadata records that open each scene epoch.
pub const RUN_METADATA: &str = "cosplat.run";
/// Attachment: the scene at rest for splat viewers.
pub const SCENE_PLY: &str = "scene.ply";
/// Attachment: the source text of the scene.
pub const SCENE_TOML: &str = "scene.toml";
/// Attachment: `[GaussianRest]`, wire layout.
pub const SCENE_GAUSSIANS: &str = "scene/gaussians.bin";
/// Attachment: spherical harmonics `[gaussian][coefficient][rgb]` f32.
pub const SCENE_SH: &str = "scene/sh.bin";
/// Attachment: semantic features `[gaussian][feature_dim]` f32.
pub const SCENE_FEATURES: &str = "scene/features.bin";
/// Attachment: `[ObjectInfo]`, wire layout.
pub const SCENE_OBJECTS: &str = "scene/objects.bin";
/// First part of the names of attached files; hash and file name follow.
pub const FILES_PREFIX: &str = "files/";

/// JSON schema of `/status`.
pub const STATUS_SCHEMA: &str = include_str!("../schemas/status.json");
/// JSON schema of `/objects`.
pub const OBJECTS_SCHEMA: &str = include_str!("../schemas/objects.json");
/// JSON schema of `/journal`.
pub const JOURNAL_SCHEMA: &str = include_str!("../schemas/journal.json");
/// JSON schema of `/gaps`.
pub const GAPS_SCHEMA: &str = include_str!("../schemas/gaps.json");

/// Channel ids of the topics.
pub(crate) struct Channels {
    pub(crate) gaussians: u16,
    pub(crate) transforms: u16,
    pub(crate) objects: u16,
    pub(crate) status: u16,
    pub(crate) journal: u16,
    pub(crate) gaps: u16,
}

impl Channels {
    /// Declares every topic, in the same order in every file.
    pub(crate) fn add(mcap: &mut Mcap) -> Result<Self, mcap::McapError> {
        let mut protobuf = |topic: &str, schema: Option<Schema>| {
            let id = match schema {
                Some(s) => mcap.add_schema(&s.name, &s.encoding, &s.data)?,
                None => 0,
            };
            mcap.add_channel(id, topic, "protobuf", &BTreeMap::new())
        };
        let gaussians = protobuf(GAUSSIANS_TOPIC, PointCloud::get_schema())?;
        let transforms = protobuf(TRANSFORMS_TOPIC, FrameTransforms::get_schema())?;
        let mut json = |topic: &str, name: &str, schema: &str| {
            let id = mcap.add_schema(name, "jsonschema", schema.as_bytes())?;
            mcap.add_channel(id, topic, "json", &BTreeMap::new())
        };
        Ok(Self {
            gaussians,
            transforms,
            objects: json(OBJECTS_TOPIC, "cosplat.Objects", OBJECTS_SCHEMA)?,
            status: json(STATUS_TOPIC, "cosplat.Status", STATUS_SCHEMA)?,
            journal: json(JOURNAL_TOPIC, "cosplat.AppliedCommand", JOURNAL_SCHEMA)?,
            gaps: json(GAPS_TOPIC, "cosplat.Gap", GAPS_SCHEMA)?,
        })
    }
}
