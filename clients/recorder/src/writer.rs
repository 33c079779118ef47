//! A recording being written: topics, schemas, times, chunks.

pub(crate) mod changes;

use std::collections::{BTreeMap, BTreeSet};
use std::fs::File;
use std::io::BufWriter;
use std::path::{Path, PathBuf};

use cosplat_files::{Existing, NewFile};
use cosplat_ipc::monotonic_ns;
use cosplat_ipc::schema::{
    FrameHeader, GaussianState, ObjectState, ObjectsHeader, Status, TextError, WIRE_VERSION,
};
use cosplat_ipc::server::SceneBlocks;
use foxglove::messages::{FrameTransform, FrameTransforms, Quaternion, Vector3};
use mcap::records::{AttachmentHeader, MessageHeader, Metadata};
use prost::Message;
use serde::Serialize;

use crate::RecordingError;
use crate::files::{self, KeptFile};
use crate::kept::Kept;
use crate::messages::{GapRecord, JournalEntry, JournalRecord, ObjectsRecord, StatusRecord};
use crate::ply::PlyScene;
use crate::point_cloud::{self, WORLD_FRAME, timestamp};
use crate::time_line::{TimeLine, wall_offset};
use crate::topics::*;
use crate::write_behind::WriteBehind;
use changes::Chain;

/// How chunks are compressed. Moving splats shrink by 0 % (lz4) to 10 % (zstd), at a third of the speed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Compression {
    /// As they are: the fastest, and an unfinished chunk stays readable to the last message.
    #[default]
    None,
    /// LZ4.
    Lz4,
    /// Zstandard, fastest level.
    Zstd,
}

/// How a recording is written.
#[derive(Clone, Debug)]
pub struct WriterOptions {
    /// Compression of chunks.
    pub compression: Compression,
    /// A chunk is closed after the first step that brings it to this size [bytes].
    pub chunk_bytes: u64,
    /// Replace an existing file.
    pub overwrite: bool,
}

impl Default for WriterOptions {
    fn default() -> Self {
        Self {
            compression: Compression::None,
            chunk_bytes: 4 << 20,
            overwrite: false,
        }
    }
}

/// Output of every MCAP writer here. The buffer is small: frames are larger and pass it by.
pub(crate) type Mcap = mcap::Writer<BufWriter<File>>;

/// What becomes of a file that is there already.
pub(crate) fn existing(overwrite: bool) -> Existing {
    match overwrite {
        true => Existing::IsReplaced,
        false => Existing::Stays,
    }
}

/// Begins MCAP in a new file, with a level where its chunks are compressed; they end only at `flush`, after which the second half
/// of the pair may be told so.
pub(crate) fn begin(
    new: &NewFile,
    compression: Option<(mcap::Compression, u32)>,
    profile: &str,
) -> Result<(Mcap, WriteBehind), RecordingError> {
    let path = new.path();
    let file = new.file().try_clone();
    let file = file.map_err(|e| RecordingError::open(path, e))?;
    let behind = WriteBehind::of(&file).map_err(|e| RecordingError::open(path, e))?;
    let mcap = mcap::WriteOptions::new()
        .profile(profile)
        .library(concat!("cosplat ", env!("CARGO_PKG_VERSION")))
        .compression(compression.map(|(kind, _)| kind))
        .compression_level(compression.map_or(0, |(_, level)| level))
        // The recorder shares the machine with the solver: compression stays on its own thread.
        .compression_threads(0)
        .chunk_size(None)
        .create(BufWriter::with_capacity(64 << 10, file))
        .map_err(|e| RecordingError::write(path, e))?;
    Ok((mcap, behind))
}

/// Step and times of a message [ns].
#[derive(Clone, Copy)]
struct Stamp {
    step: u64,
    log_time: u64,
    publish_time: u64,
}

/// A recording being written. Call [`finish`](Self::finish) at the end; a file whose writer was killed is repaired by
/// [`recover`](crate::recover::recover). Where it is to replace another file it lies beside that one until then, and stays there.
pub struct RecordingWriter {
    new: NewFile,
    path: PathBuf,
    mcap: Mcap,
    behind: WriteBehind,
    channels: Channels,
    chunk_bytes: u64,
    /// Bytes in the open chunk.
    pending: u64,
    bytes: u64,
    time: TimeLine,
    /// Wall clock minus `CLOCK_MONOTONIC` [ns].
    wall_offset: i64,
    attached_scene: Option<u64>,
    /// Names of the file attachments there are.
    attached_files: BTreeSet<String>,
    chain: Chain,
    kept: Kept,
    /// Memory of the message that is being made.
    points: Vec<u8>,
    /// Whether the next `/objects` has all: every chunk can be read by itself.
    tells_all: bool,
}

impl RecordingWriter {
    /// Starts the file `path`.
    ///
    /// # Errors
    /// When the file exists and may not be overwritten, or cannot be created or written.
    pub fn create(path: &Path, options: &WriterOptions) -> Result<Self, RecordingError> {
        let compression = match options.compression {
            Compression::None => None,
            Compression::Lz4 => Some((mcap::Compression::Lz4, 1)),
            Compression::Zstd => Some((mcap::Compression::Zstd, 1)),
        };
        let new = NewFile::stream(path, existing(options.overwrite))
            .map_err(|e| RecordingError::open(path, e))?;
        let path = new.path().to_owned();
        let (mut mcap, behind) = begin(&new, compression, "")?;
        let channels = Channels::add(&mut mcap).map_err(|e| RecordingError::write(&path, e))?;
        Ok(Self {
            new,
            path,
            mcap,
            behind,
            channels,
            chunk_bytes: options.chunk_bytes,
            pending: 0,
            bytes: 0,
            time: TimeLine::default(),
            wall_offset: wall_offset(),
            attached_scene: None,
            attached_files: BTreeSet::new(),
            chain: Chain::default(),
            kept: Kept::default(),
            points: Vec::new(),
            tells_all: true,
        })
    }

    /// Ends this file and goes on in the file `path`: what was told last is told there first, once the epoch is begun there as
    /// well. Returns the bytes of messages and attachments in this one.
    ///
    /// # Errors
    /// When a file cannot be written.
    pub fn go_on_in(
        mut self,
        path: &Path,
        options: &WriterOptions,
    ) -> Result<(u64, Self), RecordingError> {
        let mut next = Self::create(path, options)?;
        next.time = std::mem::take(&mut self.time);
        next.kept = std::mem::take(&mut self.kept);
        next.chain = std::mem::take(&mut self.chain);
        Ok((self.finish()?, next))
    }

    /// Bytes of messages and attachments so far.
    pub fn bytes(&self) -> u64 {
        self.bytes
    }

    /// Opens a scene epoch: run parameters as metadata, and the scene and the files it was made of as attachments, each
    /// unless the recording has it already. A file that is no longer what the server read is left out, with a warning.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn begin_epoch(
        &mut self,
        session: &str,
        scene: &SceneBlocks,
    ) -> Result<(), RecordingError> {
        let header = &scene.header;
        self.chain.cut();
        self.tells_all = true;
        if header.frame_rate > 0.0 {
            self.time.period = (1e9 / header.frame_rate) as u64;
        }
        let is_new = self.attached_scene != Some(header.scene_hash);
        let mut metadata = BTreeMap::new();
        let mut put = |key: &str, value: String| metadata.insert(key.to_owned(), value);
        put("session", session.to_owned());
        put("epoch", format!("{:016x}", header.epoch));
        put("scene_hash", format!("{:016x}", header.scene_hash));
        put("scene_attached", is_new.to_string());
        put("frame_rate", header.frame_rate.to_string());
        put("dx", header.dx.to_string());
        put("gravity", format!("{:?}", header.gravity));
        put("bounds_min", format!("{:?}", header.bounds_min));
        put("bounds_max", format!("{:?}", header.bounds_max));
        put("gaussian_count", header.gaussian_count.to_string());
        put("particle_count", header.particle_count.to_string());
        put("object_count", header.object_count.to_string());
        put("sh_degree", header.sh_degree.to_string());
        put("feature_dim", header.feature_dim.to_string());
        put("wire_version", WIRE_VERSION.to_string());
        put("program_version", env!("CARGO_PKG_VERSION").to_owned());
        put("log_time_ns", self.time.now().to_string());
        put("wall_time_ns", self.wall_now().to_string());
        for object in scene.objects {
            put(&format!("object.{}.name", object.id), name(object.name()));
            put(
                &format!("object.{}.material", object.id),
                name(object.material()),
            );
        }
        let kept: Vec<_> = scene
            .files
            .iter()
            .map(|file| KeptFile::read(file, &self.attached_files))
            .collect();
        files::describe(&kept, &mut metadata);
        let record = Metadata {
            name: RUN_METADATA.to_owned(),
            metadata,
        };
        self.mcap
            .write_metadata(&record)
            .map_err(|e| RecordingError::write(&self.path, e))?;
        if is_new {
            self.attach_scene(scene)?;
            self.attached_scene = Some(header.scene_hash);
        }
        for file in &kept {
            let Ok(content) = &file.content else { continue };
            if self.attached_files.insert(file.attachment.clone()) {
                let binary = "application/octet-stream";
                self.attach_always(&file.attachment, binary, content)?;
            }
        }
        self.flush()
    }

    fn attach_scene(&mut self, scene: &SceneBlocks) -> Result<(), RecordingError> {
        let ply = PlyScene {
            gaussians: scene.gaussians,
            sh_degree: scene.header.sh_degree,
            sh: scene.sh,
        };
        let header = self.attachment(SCENE_PLY, "application/octet-stream");
        self.mcap
            .start_attachment(ply.encoded_len(), header)
            .and_then(|()| ply.encode(|piece| self.mcap.put_attachment_bytes(piece)))
            .and_then(|()| self.mcap.finish_attachment())
            .map_err(|e| RecordingError::write(&self.path, e))?;
        self.bytes += ply.encoded_len();
        self.attach(SCENE_TOML, "application/toml", scene.source.as_bytes())?;
        let binary = "application/octet-stream";
        self.attach(
            SCENE_GAUSSIANS,
            binary,
            bytemuck::cast_slice(scene.gaussians),
        )?;
        self.attach(SCENE_SH, binary, bytemuck::cast_slice(scene.sh))?;
        self.attach(SCENE_FEATURES, binary, bytemuck::cast_slice(scene.features))?;
        self.attach(SCENE_OBJECTS, binary, bytemuck::cast_slice(scene.objects))
    }

    /// Attaches the complete state after a step of the run `epoch`.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn checkpoint(&mut self, epoch: u64, step: u64, data: &[u8]) -> Result<(), RecordingError> {
        // An attachment ends the chunk before it.
        self.flush()?;
        let name = checkpoint_name(epoch, step);
        self.attach_always(&name, "application/octet-stream", data)
    }

    fn attach(&mut self, name: &str, media_type: &str, data: &[u8]) -> Result<(), RecordingError> {
        match data.is_empty() {
            true => Ok(()),
            false => self.attach_always(name, media_type, data),
        }
    }

    fn attach_always(
        &mut self,
        name: &str,
        media_type: &str,
        data: &[u8],
    ) -> Result<(), RecordingError> {
        let header = self.attachment(name, media_type);
        self.bytes += data.len() as u64;
        self.mcap
            .start_attachment(data.len() as u64, header)
            .and_then(|()| self.mcap.put_attachment_bytes(data))
            .and_then(|()| self.mcap.finish_attachment())
            .map_err(|e| RecordingError::write(&self.path, e))
    }

    fn attachment(&self, name: &str, media_type: &str) -> AttachmentHeader {
        AttachmentHeader {
            log_time: self.time.now(),
            create_time: self.wall_now(),
            name: name.to_owned(),
            media_type: media_type.to_owned(),
        }
    }

    /// Records one whole frame in one message, `/status` first, and ends the chunk when it is large enough.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn frame(
        &mut self,
        header: &FrameHeader,
        gaussians: &[GaussianState],
        status: Option<&Status>,
    ) -> Result<(), RecordingError> {
        let stamp = Stamp {
            step: header.step,
            log_time: self.time.at(header.sim_time),
            publish_time: header.publish_ns.saturating_add_signed(self.wall_offset),
        };
        self.json(
            self.channels.status,
            stamp,
            &StatusRecord::new(header, status),
        )?;
        self.cloud(self.channels.gaussians, stamp, gaussians, WORLD_FRAME)?;
        match self.pending >= self.chunk_bytes {
            true => self.flush(),
            false => Ok(()),
        }
    }

    /// Writes Gaussians that are in the coordinate frame of that name.
    fn cloud(
        &mut self,
        channel: u16,
        stamp: Stamp,
        gaussians: &[GaussianState],
        frame: &str,
    ) -> Result<(), RecordingError> {
        let mut points = std::mem::take(&mut self.points);
        points.clear();
        point_cloud::encode_points(gaussians, &mut points);
        point_cloud::encode_description(stamp.log_time, frame, &mut points);
        let written = self.put(channel, stamp, &points);
        self.points = points;
        written
    }

    /// Records the objects of one step that are not as they were, and their coordinate frames.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn objects(
        &mut self,
        header: &ObjectsHeader,
        objects: &[ObjectState],
    ) -> Result<(), RecordingError> {
        let stamp = Stamp {
            step: header.step,
            log_time: self.time.at(header.sim_time),
            publish_time: self.wall_now(),
        };
        let all = std::mem::take(&mut self.tells_all) || self.chain.is_due();
        let objects = self.kept.changed(objects, all);
        let record = ObjectsRecord::new(header, &objects);
        self.json(self.channels.objects, stamp, &record)?;
        let transforms = objects
            .iter()
            .map(|object| {
                let [x, y, z] = object.com;
                let [qx, qy, qz, qw] = object.rotation;
                FrameTransform {
                    timestamp: Some(timestamp(stamp.log_time)),
                    parent_frame_id: WORLD_FRAME.to_owned(),
                    child_frame_id: format!("object/{}", object.id),
                    translation: Some(Vector3 { x, y, z }),
                    rotation: Some(Quaternion {
                        x: qx,
                        y: qy,
                        z: qz,
                        w: qw,
                    }),
                }
            })
            .collect();
        let message = FrameTransforms { transforms }.encode_to_vec();
        self.put(self.channels.transforms, stamp, &message)
    }

    /// Records a command as it was applied. Its time is that of the newest step written before.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn journal(&mut self, entry: &JournalEntry) -> Result<(), RecordingError> {
        let stamp = self.stamp_now(entry.applied.step);
        self.json(self.channels.journal, stamp, &JournalRecord::from(entry))
    }

    /// Records that steps are missing.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn gap(&mut self, gap: &GapRecord) -> Result<(), RecordingError> {
        let stamp = self.stamp_now(gap.from_step);
        self.chain.cut();
        self.json(self.channels.gaps, stamp, gap)
    }

    /// Ends the open chunk and hands everything to the operating system: from here on the death of this process
    /// loses none of it.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn flush(&mut self) -> Result<(), RecordingError> {
        self.pending = 0;
        self.tells_all = true;
        self.mcap
            .flush()
            .map_err(|e| RecordingError::write(&self.path, e))?;
        self.behind.advance();
        Ok(())
    }

    /// Writes index and summary, gives the file its name, and returns the bytes of messages and attachments.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn finish(mut self) -> Result<u64, RecordingError> {
        self.mcap
            .finish()
            .map_err(|e| RecordingError::write(&self.path, e))?;
        self.new
            .finish()
            .map_err(|e| RecordingError::write(&self.path, e))?;
        Ok(self.bytes)
    }

    fn json(
        &mut self,
        channel: u16,
        stamp: Stamp,
        record: &impl Serialize,
    ) -> Result<(), RecordingError> {
        let message = serde_json::to_vec(record)
            .map_err(|e| RecordingError::write(&self.path, std::io::Error::other(e)))?;
        self.put(channel, stamp, &message)
    }

    fn put(&mut self, channel_id: u16, stamp: Stamp, message: &[u8]) -> Result<(), RecordingError> {
        let header = MessageHeader {
            channel_id,
            sequence: stamp.step as u32,
            log_time: stamp.log_time,
            publish_time: stamp.publish_time,
        };
        self.pending += message.len() as u64;
        self.bytes += message.len() as u64;
        self.mcap
            .write_to_known_channel(&header, message)
            .map_err(|e| RecordingError::write(&self.path, e))
    }

    /// For messages that have no time of their own.
    fn stamp_now(&self, step: u64) -> Stamp {
        Stamp {
            step,
            log_time: self.time.now(),
            publish_time: self.wall_now(),
        }
    }

    fn wall_now(&self) -> u64 {
        monotonic_ns().saturating_add_signed(self.wall_offset)
    }
}

/// Text from another process; what is no text is left out.
fn name(text: Result<&str, TextError>) -> String {
    text.unwrap_or_default().to_owned()
}
