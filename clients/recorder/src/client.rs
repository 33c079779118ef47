//! The recorder as a process: attach to a session, take every step, write it, carry on when the server restarts.

use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use cosplat_ipc::client::{
    ConnectError, JournalReader, Message, ObjectsReader, ReadError, SceneReader, SceneView,
    StatusReader, heartbeat_age,
};
use cosplat_ipc::schema::{
    AppliedCommand, FRAME_FLAG_LAST, FrameHeader, JournalHeader, ObjectState, ObjectsHeader,
};
use cosplat_ipc::{Client, Domain, monotonic_ns};
use serde::Serialize;

use crate::RecordingError;
use crate::checkpoints::Checkpoints;
use crate::latency::Latencies;
use crate::messages::{GapReason, GapRecord, Hex64, JournalEntry};
use crate::parts::{Parts, Split, part_path};
use crate::pipeline::{Pipeline, WriterEnded};
use crate::source::Source;
use crate::writer::WriterOptions;

/// Frames that wait in shared memory at most.
const QUEUE_DEPTH: usize = 64;
/// How often the loop looks at its stop flag.
const TICK: Duration = Duration::from_millis(100);
/// How long the scene of a restarted server may take.
const SCENE_TIMEOUT: Duration = Duration::from_secs(10);
/// A server without a heartbeat for this long is gone; it sends ten per second.
const DEAD_AFTER: Duration = Duration::from_secs(1);

/// What to record, and where.
#[derive(Clone, Debug)]
pub struct RecordOptions {
    /// Where the session is.
    pub domain: Domain,
    /// Name of the session.
    pub session: String,
    /// The recording.
    pub output: PathBuf,
    /// How it is written.
    pub writer: WriterOptions,
    /// When it goes on in another file.
    pub split: Split,
    /// Simulated time between two checkpoints in the recording [s], more than 0; `None` for none.
    pub checkpoint_every: Option<f64>,
    /// How long to wait for a server at the start, and as long for its scene.
    pub wait: Duration,
    /// Stop after this time (wall clock, from the attachment on); `None` for the end of the session.
    pub duration: Option<Duration>,
}

/// Why recording failed. What was written stays readable after `recover`.
#[derive(Debug, thiserror::Error)]
pub enum RecordError {
    /// No server, or one that cannot be understood.
    #[error(transparent)]
    Connect(#[from] ConnectError),
    /// The stream broke.
    #[error(transparent)]
    Read(#[from] ReadError),
    /// The file cannot be written.
    #[error(transparent)]
    Recording(#[from] RecordingError),
    /// No thread for the writer.
    #[error("cannot start the writing thread: {0}")]
    Thread(std::io::Error),
}

/// Quantiles of the time from sending a frame to its receipt.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct LatencyUs {
    /// Median [us]; `None` without a frame.
    pub p50: Option<f64>,
    /// 99th percentile [us].
    pub p99: Option<f64>,
}

/// What was recorded.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Summary {
    /// Frames in the recording.
    pub frames_recorded: u64,
    /// Step of the first frame.
    pub first_step: Option<u64>,
    /// Step of the last frame.
    pub last_step: Option<u64>,
    /// Interruptions, each with a message in `/gaps`.
    pub gaps: u64,
    /// Steps missing in them, as far as known.
    pub missed_steps: u64,
    /// Messages and attachments [bytes].
    pub bytes: u64,
    /// From the server's send to our receipt.
    pub latency_us: LatencyUs,
    /// Applied commands recorded.
    pub journal_entries: u64,
    /// Applied commands that came too fast to be recorded.
    pub journal_missed: u64,
    /// Runs of the server seen.
    pub server_runs: u64,
    /// Checkpoints of the server in the recording.
    pub checkpoints: u64,
}

/// Records a session until its last frame, until `stop` is set, or for the given time. `progress` is called
/// after every frame, with everything but bytes and latencies up to date.
///
/// # Errors
/// When no server is found in time, a stream breaks, or the file cannot be written.
pub fn record(
    options: &RecordOptions,
    stop: &AtomicBool,
    mut progress: impl FnMut(&Summary),
) -> Result<Summary, RecordError> {
    let first = match options.split.is_on() {
        true => part_path(&options.output, 1),
        false => options.output.clone(),
    };
    if !options.writer.overwrite && first.exists() {
        let path = first;
        return Err(RecordingError::Exists { path }.into());
    }
    let (client, mut streams) = attach(options, stop)?;
    let scene = first_scene(&client, options.wait, stop)?;
    let parts = Parts::create(
        &options.output,
        &options.writer,
        options.split,
        &options.session,
        options.checkpoint_every.is_some(),
    )?;
    let checkpoints = options.checkpoint_every.map(|every| {
        let sender = client.commands()?;
        Ok::<_, ConnectError>(Checkpoints::new(sender, every))
    });
    let mut recorder = Recorder {
        epoch: scene.header().epoch,
        frame_rate: scene.header().frame_rate,
        checkpoints: checkpoints.transpose()?,
        pipeline: Pipeline::start(parts).map_err(RecordError::Thread)?,
        latencies: Latencies::default(),
        last: None,
        attached_ns: monotonic_ns(),
        summary: Summary::default(),
        is_server_silent: false,
        client,
    };
    let outcome = recorder.run(&mut streams, scene, options.duration, stop, &mut progress);
    if let Some(checkpoints) = recorder.checkpoints.take() {
        checkpoints.end();
    }
    let mut summary = recorder.summary;
    // The writer's own reason comes first: the loop only sees that the writer is gone.
    summary.bytes = recorder.pipeline.finish()?;
    match outcome {
        Ok(()) | Err(Interrupted::Writer) => {}
        Err(Interrupted::Stream(error)) => return Err(error.into()),
    }
    summary.latency_us = LatencyUs {
        p50: recorder.latencies.quantile_us(0.5),
        p99: recorder.latencies.quantile_us(0.99),
    };
    Ok(summary)
}

/// Attaches in short attempts, so that `stop` is heard. A server that goes before all its streams are open counts like none.
fn attach(options: &RecordOptions, stop: &AtomicBool) -> Result<(Client, Streams), ConnectError> {
    let deadline = Instant::now() + options.wait;
    loop {
        let left = deadline.saturating_duration_since(Instant::now());
        let (domain, session) = (&options.domain, &options.session);
        let attempt = Client::connect(domain, session, "recorder", left.min(TICK))
            .and_then(|client| Streams::open(&client).map(|streams| (client, streams)));
        match attempt {
            Err(error) if error.may_pass() && !left.is_zero() && !stop.load(Ordering::Relaxed) => {
                std::thread::sleep(TICK / 10);
            }
            settled => return settled,
        }
    }
}

/// The scene that is there when recording begins.
fn first_scene(
    client: &Client,
    patience: Duration,
    stop: &AtomicBool,
) -> Result<SceneView, ConnectError> {
    let mut scenes = SceneReader::default();
    loop {
        match scenes.any(client, patience.min(TICK)) {
            Err(ConnectError::Timeout { seconds, .. })
                if seconds < patience.as_secs_f64() && !stop.load(Ordering::Relaxed) => {}
            settled => return settled,
        }
    }
}

/// What ends the loop early.
enum Interrupted {
    Writer,
    Stream(ReadError),
}

impl From<WriterEnded> for Interrupted {
    fn from(_: WriterEnded) -> Self {
        Self::Writer
    }
}

impl From<ReadError> for Interrupted {
    fn from(error: ReadError) -> Self {
        Self::Stream(error)
    }
}

/// What a time without frames means.
enum Silence {
    /// The server pauses, or is gone and may come back.
    Pause,
    /// The session is over.
    End,
}

/// Everything that the recorder reads.
struct Streams {
    frames: Source,
    objects: ObjectsReader,
    journal: JournalReader,
    status: StatusReader,
    next_objects: Option<Message<ObjectState, ObjectsHeader>>,
    next_journal: Option<Message<AppliedCommand, JournalHeader>>,
}

impl Streams {
    fn open(client: &Client) -> Result<Self, ConnectError> {
        let mut status = client.status()?;
        Ok(Self {
            objects: client.objects(QUEUE_DEPTH)?,
            journal: client.journal()?,
            frames: Source::open(client, &mut status)?,
            status,
            next_objects: None,
            next_journal: None,
        })
    }
}

struct Recorder {
    client: Client,
    pipeline: Pipeline,
    /// Of the scene recorded last.
    epoch: u64,
    /// Its frames per simulated second [1/s].
    frame_rate: f64,
    /// None where none are wanted, or the server writes none.
    checkpoints: Option<Checkpoints>,
    /// Epoch and step of the newest frame.
    last: Option<(u64, u64)>,
    /// Frames sent before say nothing about latency: they waited for us as history.
    attached_ns: u64,
    latencies: Latencies,
    summary: Summary,
    is_server_silent: bool,
}

impl Recorder {
    fn run(
        &mut self,
        streams: &mut Streams,
        scene: SceneView,
        duration: Option<Duration>,
        stop: &AtomicBool,
        progress: &mut impl FnMut(&Summary),
    ) -> Result<(), Interrupted> {
        self.pipeline.epoch(scene)?;
        let start = Instant::now();
        let is_over =
            || stop.load(Ordering::Relaxed) || duration.is_some_and(|d| start.elapsed() >= d);
        while !is_over() {
            let step = match streams.frames.next(TICK) {
                Ok(Some(step)) => step,
                Ok(None) => match self.silence(streams)? {
                    Silence::Pause => continue,
                    Silence::End => break,
                },
                Err(error) => {
                    tolerate(error)?;
                    continue;
                }
            };
            let received_ns = monotonic_ns();
            let header = step.header();
            let is_known = self.last == Some((header.epoch, header.step));
            if is_known && header.flags & FRAME_FLAG_LAST == 0 {
                // The server told somebody else where it stands.
                continue;
            }
            if header.publish_ns >= self.attached_ns {
                self.latencies
                    .add(received_ns.saturating_sub(header.publish_ns));
            }
            if header.epoch != self.epoch {
                // What the old run left behind belongs before the new one's scene.
                self.accompany(streams, (self.epoch, u64::MAX))?;
            }
            self.gaps(&header, stop)?;
            self.accompany(streams, (header.epoch, header.step))?;
            let status = streams.status.newest().unwrap_or_default();
            step.write(&mut self.pipeline, status)?;
            self.last = Some((header.epoch, header.step));
            self.summary.frames_recorded += 1;
            self.summary.first_step.get_or_insert(header.step);
            self.summary.last_step = Some(header.step);
            self.look_after_checkpoints(header.step)?;
            progress(&self.summary);
            if header.flags & FRAME_FLAG_LAST != 0 {
                break;
            }
        }
        // Commands that took effect after the last frame, such as the one that ended the session.
        self.accompany(streams, (u64::MAX, u64::MAX))
    }

    fn look_after_checkpoints(&mut self, step: u64) -> Result<(), WriterEnded> {
        let Some(checkpoints) = &mut self.checkpoints else {
            return Ok(());
        };
        if self.pipeline.wants_checkpoint() {
            checkpoints.want_now();
        }
        match checkpoints.after(step, self.frame_rate) {
            Ok(None) => Ok(()),
            Ok(Some(checkpoint)) => {
                self.summary.checkpoints += 1;
                self.pipeline.checkpoint(self.epoch, checkpoint)
            }
            Err(refused) => {
                tracing::warn!("{refused}");
                self.checkpoints = None;
                self.pipeline.without_checkpoints()
            }
        }
    }

    /// What it means that no frame comes. The last frame of a session is lost when its memory was in use: then the
    /// status board alone says that the session is over.
    fn silence(&mut self, streams: &mut Streams) -> Result<Silence, Interrupted> {
        let newest = streams.status.newest().unwrap_or_default();
        if let Some(status) = newest
            && let Err(error) = streams.frames.follow(&self.client, status.has_changes != 0)
        {
            tracing::debug!("{error}");
        }
        let Some(status) = newest.filter(|s| heartbeat_age(s) > DEAD_AFTER) else {
            self.is_server_silent = false;
            return Ok(Silence::Pause);
        };
        if !streams.status.has_ended(self.epoch).unwrap_or_default() {
            if !self.is_server_silent {
                tracing::warn!("the server gives no sign of life; waiting for it to come back");
            }
            self.is_server_silent = true;
            return Ok(Silence::Pause);
        }
        if self
            .summary
            .last_step
            .is_some_and(|last| last < status.step)
        {
            self.gap(GapRecord {
                epoch: Hex64(self.epoch),
                from_step: self.next_step(),
                to_step: Some(status.step),
                reason: GapReason::Missed,
            })?;
        }
        Ok(Silence::End)
    }

    /// Notes what is missing before a frame; opens a new epoch where the server was started anew.
    fn gaps(&mut self, header: &FrameHeader, stop: &AtomicBool) -> Result<(), Interrupted> {
        if let Some((epoch, last)) = self.last {
            let next = last.saturating_add(1);
            if epoch != header.epoch {
                self.gap(GapRecord {
                    epoch: Hex64(epoch),
                    from_step: next,
                    to_step: None,
                    reason: GapReason::ServerRestarted,
                })?;
            } else if header.step > next {
                self.gap(GapRecord {
                    epoch: Hex64(epoch),
                    from_step: next,
                    to_step: Some(header.step - 1),
                    reason: GapReason::Missed,
                })?;
            }
        }
        if self.last.is_none_or(|(epoch, _)| epoch != header.epoch) {
            self.summary.server_runs += 1;
        }
        if header.epoch != self.epoch {
            self.epoch = header.epoch;
            if let Some(checkpoints) = &mut self.checkpoints {
                checkpoints.begin_anew();
            }
            match self.scene_of(header.epoch, stop) {
                Some(scene) => {
                    self.frame_rate = scene.header().frame_rate;
                    self.pipeline.epoch(scene)?;
                }
                None => tracing::warn!(
                    "the restarted server published no scene: its frames are recorded without"
                ),
            }
        }
        Ok(())
    }

    fn gap(&mut self, gap: GapRecord) -> Result<(), WriterEnded> {
        self.summary.gaps += 1;
        self.summary.missed_steps += gap.to_step.map_or(0, |to| to - gap.from_step + 1);
        self.pipeline.gap(gap)
    }

    /// The step after the last one recorded.
    fn next_step(&self) -> u64 {
        self.summary
            .last_step
            .map_or(0, |step| step.wrapping_add(1))
    }

    /// The scene of `epoch`, once it is published.
    fn scene_of(&self, epoch: u64, stop: &AtomicBool) -> Option<SceneView> {
        let mut scenes = SceneReader::default();
        while !stop.load(Ordering::Relaxed) {
            match scenes.of(&self.client, epoch, TICK) {
                Ok(scene) => return scene,
                Err(ConnectError::Timeout { seconds, .. })
                    if seconds < SCENE_TIMEOUT.as_secs_f64() => {}
                Err(error) => {
                    tracing::warn!("{error}");
                    break;
                }
            }
        }
        None
    }

    /// Takes the commands and objects that belong to the steps up to `until` (epoch, step).
    fn accompany(&mut self, streams: &mut Streams, until: (u64, u64)) -> Result<(), Interrupted> {
        let Streams {
            journal,
            objects,
            next_journal,
            next_objects,
            ..
        } = streams;
        while let Some(message) = take(
            next_journal,
            || journal.next(Duration::ZERO),
            |m| (m.header().epoch, m.header().step) <= until,
        )? {
            self.summary.journal_missed += message.missed();
            let header = *message.header();
            for (applied, place) in message.items().iter().zip(0..) {
                self.pipeline.journal(JournalEntry {
                    applied: *applied,
                    epoch: Some(header.epoch),
                    index: Some(header.first.saturating_add(place)),
                })?;
                self.summary.journal_entries += 1;
            }
        }
        while let Some(message) = take(
            next_objects,
            || objects.next(Duration::ZERO),
            |m| (m.header().epoch, m.header().step) <= until,
        )? {
            self.pipeline.objects(message.header(), message.items())?;
        }
        Ok(())
    }
}

/// The next message if it is due; otherwise it waits in `next`.
fn take<M>(
    next: &mut Option<M>,
    receive: impl FnOnce() -> Result<Option<M>, ReadError>,
    is_due: impl FnOnce(&M) -> bool,
) -> Result<Option<M>, Interrupted> {
    if next.is_none() {
        match receive() {
            Ok(message) => *next = message,
            Err(error) => tolerate(error)?,
        }
    }
    Ok(next.take_if(|message| is_due(message)))
}

/// A malformed message is dropped and named; anything else ends the recording.
fn tolerate(error: ReadError) -> Result<(), ReadError> {
    match error {
        ReadError::Malformed { .. } => {
            tracing::warn!("{error}");
            Ok(())
        }
        other => Err(other),
    }
}
