//! The writing half of the recorder: a thread with the file, and a bounded set of buffers between it and the stream.
//!
//! A disk that stalls for a few hundred milliseconds must not hold the server's frame memory that long. A frame is
//! copied out of shared memory at once; when every buffer waits for the disk, the next frames wait in the
//! subscriber's queue, and the server's policy (skip or wait) decides.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use cosplat_ipc::client::SceneView;
use cosplat_ipc::schema::{
    ChangeSlot, ChangesHeader, FrameHeader, GaussianState, ObjectState, ObjectsHeader, Status,
};

use crate::RecordingError;
use crate::checkpoints::Checkpoint;
use crate::messages::{GapRecord, JournalEntry};
use crate::parts::Parts;

/// Memory for frames that wait for the disk [bytes].
const QUEUE_BYTES: usize = 256 << 20;
/// Fewest and most frames that may wait.
const QUEUE_FRAMES: (usize, usize) = (2, 64);
/// Longest time that a message stays in an unfinished chunk.
const FLUSH_PERIOD: Duration = Duration::from_secs(1);

/// Something to be written.
enum Job {
    Epoch(Box<SceneView>),
    Objects(ObjectsHeader, Vec<ObjectState>),
    Journal(JournalEntry),
    Gap(GapRecord),
    Checkpoint(u64, Checkpoint),
    WithoutCheckpoints,
    Frame(FrameHeader, Vec<ChangeSlot>, Option<Box<Status>>),
    Changes(ChangesHeader, Vec<ChangeSlot>, Option<Box<Status>>),
}

/// Handle of the writing thread.
pub(crate) struct Pipeline {
    jobs: Sender<Job>,
    wants_checkpoint: Arc<AtomicBool>,
    buffers: Buffers,
    thread: JoinHandle<Result<u64, RecordingError>>,
}

/// The writing thread ended early; [`Pipeline::finish`] says why.
pub(crate) struct WriterEnded;

impl Pipeline {
    /// Hands the files to a thread of its own.
    pub(crate) fn start(parts: Parts) -> std::io::Result<Self> {
        let wants_checkpoint = parts.wants_checkpoint();
        let (jobs, queue) = channel();
        let (done, spare) = channel();
        let thread = std::thread::Builder::new()
            .name("cosplat-writer".into())
            .spawn(move || write(parts, &queue, &done))?;
        Ok(Self {
            jobs,
            wants_checkpoint,
            buffers: Buffers {
                done: spare,
                spare: Vec::new(),
                waiting: 0,
                waiting_bytes: 0,
            },
            thread,
        })
    }

    pub(crate) fn epoch(&self, scene: SceneView) -> Result<(), WriterEnded> {
        self.send(Job::Epoch(Box::new(scene)))
    }

    pub(crate) fn objects(
        &self,
        header: &ObjectsHeader,
        objects: &[ObjectState],
    ) -> Result<(), WriterEnded> {
        self.send(Job::Objects(*header, objects.to_vec()))
    }

    pub(crate) fn journal(&self, entry: JournalEntry) -> Result<(), WriterEnded> {
        self.send(Job::Journal(entry))
    }

    pub(crate) fn checkpoint(&self, epoch: u64, checkpoint: Checkpoint) -> Result<(), WriterEnded> {
        self.send(Job::Checkpoint(epoch, checkpoint))
    }

    /// No checkpoint will come.
    pub(crate) fn without_checkpoints(&self) -> Result<(), WriterEnded> {
        self.send(Job::WithoutCheckpoints)
    }

    /// Whether the present part of the recording is full and waits for a checkpoint, that the next one begins with.
    pub(crate) fn wants_checkpoint(&self) -> bool {
        self.wants_checkpoint.load(Ordering::Relaxed)
    }

    pub(crate) fn gap(&self, gap: GapRecord) -> Result<(), WriterEnded> {
        self.send(Job::Gap(gap))
    }

    /// Copies a frame and queues it; waits while all buffers are in use.
    pub(crate) fn frame(
        &mut self,
        header: &FrameHeader,
        gaussians: &[GaussianState],
        status: Option<Status>,
    ) -> Result<(), WriterEnded> {
        let slots = self.buffers.copy(bytemuck::cast_slice(gaussians))?;
        self.send(Job::Frame(*header, slots, status.map(Box::new)))
    }

    /// Copies what changed and queues it; waits while all buffers are in use.
    pub(crate) fn changes(
        &mut self,
        header: &ChangesHeader,
        slots: &[ChangeSlot],
        status: Option<Status>,
    ) -> Result<(), WriterEnded> {
        let slots = self.buffers.copy(slots)?;
        self.send(Job::Changes(*header, slots, status.map(Box::new)))
    }

    fn send(&self, job: Job) -> Result<(), WriterEnded> {
        self.jobs.send(job).map_err(|_| WriterEnded)
    }

    /// Waits until everything is written and the file is complete; returns the bytes recorded.
    pub(crate) fn finish(self) -> Result<u64, RecordingError> {
        drop(self.jobs);
        match self.thread.join() {
            Ok(outcome) => outcome,
            Err(panic) => std::panic::resume_unwind(panic),
        }
    }
}

/// Memory for what waits for the disk, used again and again.
struct Buffers {
    /// Those that the writer is done with.
    done: Receiver<Vec<ChangeSlot>>,
    spare: Vec<Vec<ChangeSlot>>,
    waiting: usize,
    waiting_bytes: usize,
}

impl Buffers {
    /// A copy of `slots`; waits for the writer while too much waits for it.
    fn copy(&mut self, slots: &[ChangeSlot]) -> Result<Vec<ChangeSlot>, WriterEnded> {
        let (fewest, most) = QUEUE_FRAMES;
        let need = size_of_val(slots);
        loop {
            while let Ok(buffer) = self.done.try_recv() {
                self.take_back(buffer);
            }
            let has_room =
                self.waiting < most && self.waiting_bytes.saturating_add(need) <= QUEUE_BYTES;
            if self.waiting < fewest || has_room {
                break;
            }
            let buffer = self.done.recv().map_err(|_| WriterEnded)?;
            self.take_back(buffer);
        }
        // The smallest that will do; what all of them hold together stays bounded.
        self.spare.sort_by_key(Vec::capacity);
        let fits = self.spare.iter().position(|b| bytes_of(b) >= need);
        let mut buffer = fits.map_or_else(Vec::new, |n| self.spare.remove(n));
        let spare = |spare: &[Vec<ChangeSlot>]| spare.iter().map(bytes_of).sum::<usize>();
        while self.waiting_bytes + need + spare(&self.spare) > QUEUE_BYTES
            && self.spare.pop().is_some()
        {}
        buffer.clear();
        buffer.extend_from_slice(slots);
        self.waiting += 1;
        self.waiting_bytes += bytes_of(&buffer);
        Ok(buffer)
    }

    fn take_back(&mut self, buffer: Vec<ChangeSlot>) {
        self.waiting -= 1;
        self.waiting_bytes -= bytes_of(&buffer);
        self.spare.push(buffer);
    }
}

/// Memory of a buffer [byte].
fn bytes_of(buffer: &Vec<ChangeSlot>) -> usize {
    buffer.capacity() * size_of::<ChangeSlot>()
}

/// Body of the writing thread.
fn write(
    mut parts: Parts,
    queue: &Receiver<Job>,
    done: &Sender<Vec<ChangeSlot>>,
) -> Result<u64, RecordingError> {
    let mut flushed = Instant::now();
    loop {
        match queue.recv_timeout(FLUSH_PERIOD) {
            Ok(Job::Epoch(scene)) => parts.epoch(scene)?,
            Ok(Job::Objects(header, objects)) => parts.writer()?.objects(&header, &objects)?,
            Ok(Job::Journal(entry)) => parts.journal(entry)?,
            Ok(Job::Checkpoint(epoch, checkpoint)) => parts.checkpoint(epoch, &checkpoint)?,
            Ok(Job::WithoutCheckpoints) => parts.without_checkpoints(),
            Ok(Job::Gap(gap)) => parts.writer()?.gap(&gap)?,
            Ok(Job::Frame(header, slots, status)) => {
                let gaussians = bytemuck::cast_slice(&slots);
                parts
                    .writer()?
                    .frame(&header, gaussians, status.as_deref())?;
                parts.wrote_frame(header.sim_time);
                // The other end may be gone already.
                let _ = done.send(slots);
            }
            Ok(Job::Changes(header, slots, status)) => {
                parts
                    .writer()?
                    .changes(&header, &slots, status.as_deref())?;
                parts.wrote_frame(header.sim_time);
                let _ = done.send(slots);
            }
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => return parts.finish(),
        }
        if flushed.elapsed() >= FLUSH_PERIOD {
            parts.flush()?;
            flushed = Instant::now();
        }
    }
}
