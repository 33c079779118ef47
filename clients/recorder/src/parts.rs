//! A recording in parts: numbered files of which each can be read by itself.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use cosplat_ipc::client::SceneView;
use cosplat_ipc::server::SceneBlocks;

use crate::RecordingError;
use crate::checkpoints::Checkpoint;
use crate::messages::JournalEntry;
use crate::writer::{RecordingWriter, WriterOptions};

/// When a recording goes on in another file.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Split {
    /// After the step that brings a file to this many bytes.
    pub bytes: Option<u64>,
    /// After this much simulated time [s].
    pub seconds: Option<f64>,
}

impl Split {
    /// Whether it ever does.
    pub fn is_on(&self) -> bool {
        *self != Self::default()
    }
}

/// Name of part number `number` of the recording `base`: `run.mcap` is `run-0001.mcap`, `run-0002.mcap` and so on.
pub fn part_path(base: &Path, number: u32) -> PathBuf {
    let stem = base.file_stem().unwrap_or_default().to_string_lossy();
    let name = match base.extension() {
        Some(extension) => format!("{stem}-{number:04}.{}", extension.to_string_lossy()),
        None => format!("{stem}-{number:04}"),
    };
    base.with_file_name(name)
}

/// Files of a recording, one after the other.
pub(crate) struct Parts {
    writer: Option<RecordingWriter>,
    base: PathBuf,
    options: WriterOptions,
    split: Split,
    session: String,
    /// The scene that every part begins with.
    scene: Option<Box<SceneView>>,
    number: u32,
    /// Simulated time at which the part began, and of its newest frame [s].
    span: Option<[f64; 2]>,
    /// Bytes of the parts that are finished.
    finished: u64,
    /// Whether the next part begins with a checkpoint, and so waits for it.
    awaits_checkpoint: bool,
    /// Whether one is waited for.
    wants_checkpoint: Arc<AtomicBool>,
    /// Commands since then: those behind the checkpoint are told again in the part that begins with it.
    since_full: Vec<JournalEntry>,
}

impl Parts {
    /// Starts the first file.
    pub(crate) fn create(
        base: &Path,
        options: &WriterOptions,
        split: Split,
        session: &str,
        awaits_checkpoint: bool,
    ) -> Result<Self, RecordingError> {
        let first = match split.is_on() {
            true => part_path(base, 1),
            false => base.to_owned(),
        };
        Ok(Self {
            writer: Some(RecordingWriter::create(&first, options)?),
            base: base.to_owned(),
            options: options.clone(),
            split,
            session: session.to_owned(),
            scene: None,
            number: 1,
            span: None,
            finished: 0,
            awaits_checkpoint,
            wants_checkpoint: Arc::default(),
            since_full: Vec::new(),
        })
    }

    /// Set while a part is full that goes on until a checkpoint comes.
    pub(crate) fn wants_checkpoint(&self) -> Arc<AtomicBool> {
        self.wants_checkpoint.clone()
    }

    /// The file to be written to. Where the present one has enough, that is the next one, unless a checkpoint is waited for.
    pub(crate) fn writer(&mut self) -> Result<&mut RecordingWriter, RecordingError> {
        let is_full = self.is_full();
        let waits = is_full && self.awaits_checkpoint;
        self.wants_checkpoint.store(waits, Ordering::Relaxed);
        self.open(is_full && !waits)
    }

    /// The present file, or the next one.
    fn open(&mut self, is_full: bool) -> Result<&mut RecordingWriter, RecordingError> {
        let path = part_path(&self.base, self.number + 1);
        let options = &self.options;
        let writer = match self.writer.take() {
            Some(writer) if is_full => {
                let (bytes, mut next) = writer.go_on_in(&path, options)?;
                self.finished += bytes;
                self.number += 1;
                self.span = None;
                if let Some(scene) = &self.scene {
                    begin(&mut next, &self.session, scene)?;
                }
                next
            }
            Some(writer) => writer,
            // What failed before fails again with its own reason.
            None => RecordingWriter::create(&path, options)?,
        };
        Ok(self.writer.insert(writer))
    }

    /// No checkpoint will come: parts wait for none.
    pub(crate) fn without_checkpoints(&mut self) {
        self.awaits_checkpoint = false;
        self.since_full.clear();
    }

    /// Writes a command down.
    pub(crate) fn journal(&mut self, entry: JournalEntry) -> Result<(), RecordingError> {
        self.writer()?.journal(&entry)?;
        if self.wants_checkpoint.load(Ordering::Relaxed) {
            self.since_full.push(entry);
        }
        Ok(())
    }

    /// Attaches a checkpoint of the run `epoch`. A part that waits for one ends before it.
    pub(crate) fn checkpoint(
        &mut self,
        epoch: u64,
        checkpoint: &Checkpoint,
    ) -> Result<(), RecordingError> {
        let ends = self.is_full() && self.wants_checkpoint.swap(false, Ordering::Relaxed);
        let again = std::mem::take(&mut self.since_full);
        let writer = self.open(ends)?;
        writer.checkpoint(epoch, checkpoint.step, &checkpoint.data)?;
        let is_behind = |entry: &&JournalEntry| entry.applied.step > checkpoint.step;
        for entry in again.iter().filter(|_| ends).filter(is_behind) {
            writer.journal(entry)?;
        }
        Ok(())
    }

    fn is_full(&self) -> bool {
        let Some([begin, end]) = self.span else {
            return false;
        };
        let bytes = self.writer.as_ref().map_or(0, RecordingWriter::bytes);
        self.split.bytes.is_some_and(|most| bytes >= most)
            || self.split.seconds.is_some_and(|most| end - begin >= most)
    }

    /// Opens a scene epoch.
    pub(crate) fn epoch(&mut self, scene: Box<SceneView>) -> Result<(), RecordingError> {
        let session = self.session.clone();
        self.since_full.clear();
        begin(self.writer()?, &session, &scene)?;
        self.scene = Some(scene);
        Ok(())
    }

    /// Takes note of a frame of the simulated time `sim_time` [s].
    pub(crate) fn wrote_frame(&mut self, sim_time: f64) {
        let begin = self.span.map_or(sim_time, |[begin, _]| begin);
        self.span = Some([begin.min(sim_time), sim_time]);
    }

    /// Completes the last file; returns the bytes of all.
    pub(crate) fn finish(mut self) -> Result<u64, RecordingError> {
        let last = self.writer.take().map_or(Ok(0), RecordingWriter::finish)?;
        Ok(self.finished + last)
    }

    /// Hands everything to the operating system.
    pub(crate) fn flush(&mut self) -> Result<(), RecordingError> {
        self.writer.as_mut().map_or(Ok(()), RecordingWriter::flush)
    }
}

fn begin(
    writer: &mut RecordingWriter,
    session: &str,
    scene: &SceneView,
) -> Result<(), RecordingError> {
    let source = scene.source();
    let blocks = SceneBlocks {
        header: *scene.header(),
        gaussians: scene.gaussians(),
        sh: scene.sh(),
        objects: scene.objects(),
        features: scene.features(),
        source: &source,
        files: scene.files(),
    };
    writer.begin_epoch(session, &blocks)
}
