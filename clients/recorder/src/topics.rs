//! Names of a recording: topics, schemas, metadata, attachments.

use std::collections::BTreeMap;

use foxglove::messages::{FrameTransforms, PointCloud};
use foxglove::{Encode, Schema};

use crate::writer::Mcap;

/// Topic of whole frames, one `foxglove.PointCloud` per step.
pub const GAUSSIANS_TOPIC: &str = "/gaussians";
/// First part of the topics of one object's Gaussians, `foxglove.PointCloud` where they changed; its id follows.
pub const OBJECT_GAUSSIANS: &str = "/gaussians/";
/// Topic of the places of bodies' own frames, one `foxglove.FrameTransforms` per step, behind its Gaussians.
pub const PLACES_TOPIC: &str = "/places";
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
/// First part of the names of attached checkpoints; epoch and step follow, see [`checkpoint_name`].
const CHECKPOINTS_PREFIX: &str = "checkpoints/";

/// Name of the attachment with the complete state after a step of a run.
pub fn checkpoint_name(epoch: u64, step: u64) -> String {
    format!("{CHECKPOINTS_PREFIX}{epoch:016x}/{step}")
}

/// Epoch and step of the checkpoint in the attachment of this name, if it is one.
pub fn checkpoint_of(name: &str) -> Option<(u64, u64)> {
    let (epoch, step) = name.strip_prefix(CHECKPOINTS_PREFIX)?.split_once('/')?;
    Some((u64::from_str_radix(epoch, 16).ok()?, step.parse().ok()?))
}

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
    pub(crate) places: u16,
    /// Gaussians of single objects.
    objects_gaussians: BTreeMap<u32, u16>,
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
        let places = protobuf(PLACES_TOPIC, FrameTransforms::get_schema())?;
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
            places,
            objects_gaussians: BTreeMap::new(),
        })
    }

    /// The channel of an object's Gaussians.
    pub(crate) fn object(&mut self, mcap: &mut Mcap, object: u32) -> Result<u16, mcap::McapError> {
        if let Some(channel) = self.objects_gaussians.get(&object) {
            return Ok(*channel);
        }
        let schema = match PointCloud::get_schema() {
            Some(s) => mcap.add_schema(&s.name, &s.encoding, &s.data)?,
            None => 0,
        };
        let topic = format!("{OBJECT_GAUSSIANS}{object}");
        let channel = mcap.add_channel(schema, &topic, "protobuf", &BTreeMap::new())?;
        self.objects_gaussians.insert(object, channel);
        Ok(channel)
    }
}

/// The object that a topic of Gaussians is of.
pub(crate) fn object_of(topic: &str) -> Option<u32> {
    topic.strip_prefix(OBJECT_GAUSSIANS)?.parse().ok()
}
