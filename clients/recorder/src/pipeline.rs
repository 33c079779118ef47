//! The writing half of the recorder: a thread with the file, and a bounded set of buffers between it and the stream.
//!
//! A disk that stalls for a few hundred milliseconds must not hold the server's frame memory that long. A frame is
//! copied out of shared memory at once; when every buffer waits for the disk, the next frames wait in the
//! subscriber's queue, and the server's policy (skip or wait) decides.

use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use cosplat_ipc::client::SceneView;
use cosplat_ipc::schema::{FrameHeader, GaussianState, ObjectState, ObjectsHeader, Status};
use cosplat_ipc::server::SceneBlocks;

use crate::RecordingError;
use crate::messages::{GapRecord, JournalEntry};
use crate::point_cloud;
use crate::writer::RecordingWriter;

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
    Frame(FrameHeader, Vec<u8>, Option<Box<Status>>),
}

/// Handle of the writing thread.
pub(crate) struct Pipeline {
    jobs: Sender<Job>,
    /// Buffers that the writer is done with.
    spare: Receiver<Vec<u8>>,
    buffers: usize,
    thread: JoinHandle<Result<u64, RecordingError>>,
}

/// The writing thread ended early; [`Pipeline::finish`] says why.
pub(crate) struct WriterEnded;

impl Pipeline {
    /// Hands `writer` to a thread of its own.
    pub(crate) fn start(writer: RecordingWriter, session: &str) -> std::io::Result<Self> {
        let (jobs, queue) = channel();
        let (done, spare) = channel();
        let session = session.to_owned();
        let thread = std::thread::Builder::new()
            .name("cosplat-writer".into())
            .spawn(move || write(writer, &session, &queue, &done))?;
        Ok(Self {
            jobs,
            spare,
            buffers: 0,
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
        let mut points = self.buffer(size_of_val(gaussians))?;
        point_cloud::encode_points(gaussians, &mut points);
        self.send(Job::Frame(*header, points, status.map(Box::new)))
    }

    fn buffer(&mut self, frame_bytes: usize) -> Result<Vec<u8>, WriterEnded> {
        let (fewest, most) = QUEUE_FRAMES;
        let limit = (QUEUE_BYTES / frame_bytes.max(1)).clamp(fewest, most);
        let mut buffer = match self.spare.try_recv() {
            Ok(buffer) => buffer,
            Err(_) if self.buffers < limit => {
                self.buffers += 1;
                Vec::new()
            }
            Err(_) => self.spare.recv().map_err(|_| WriterEnded)?,
        };
        buffer.clear();
        Ok(buffer)
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

/// Body of the writing thread.
fn write(
    mut writer: RecordingWriter,
    session: &str,
    queue: &Receiver<Job>,
    done: &Sender<Vec<u8>>,
) -> Result<u64, RecordingError> {
    let mut flushed = Instant::now();
    loop {
        match queue.recv_timeout(FLUSH_PERIOD) {
            Ok(Job::Epoch(scene)) => {
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
                writer.begin_epoch(session, &blocks)?;
            }
            Ok(Job::Objects(header, objects)) => writer.objects(&header, &objects)?,
            Ok(Job::Journal(entry)) => writer.journal(&entry)?,
            Ok(Job::Gap(gap)) => writer.gap(&gap)?,
            Ok(Job::Frame(header, mut points, status)) => {
                writer.encoded_frame(&header, &mut points, status.as_deref())?;
                // The other end may be gone already.
                let _ = done.send(points);
            }
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => return writer.finish(),
        }
        if flushed.elapsed() >= FLUSH_PERIOD {
            writer.flush()?;
            flushed = Instant::now();
        }
    }
}
