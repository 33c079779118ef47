//! What a recording holds, in numbers.

use std::{
    collections::{BTreeMap, BTreeSet},
    path::{Path, PathBuf},
};

use cosplat_ipc::schema::{FRAME_FLAG_RESET, FrameHeader, command_name};
use cosplat_recorder::{
    RecordingError,
    messages::{GapRecord, Hex64, JournalEntry},
    reader::{Event, Recording, Traffic},
    runs::{CommandCount, FileKind, Lack, RunHeader, StepCount, Untold},
    topics::{SCENE_TOML, checkpoint_of},
};
use serde::Serialize;

use crate::walk::{Beginning, Walk};

/// What a recording holds.
#[derive(Clone, Debug, Serialize)]
pub struct Survey {
    /// The file.
    pub path: PathBuf,
    /// Its size [byte].
    pub bytes: u64,
    /// Messages by topic.
    pub topics: BTreeMap<String, Traffic>,
    /// Sizes of the attachments by name [byte].
    pub attachments: BTreeMap<String, u64>,
    /// Runs of the server, in the order of the file.
    pub runs: Vec<RunSurvey>,
}

/// What a recording holds of one run of a server.
#[derive(Clone, Debug, Serialize)]
pub struct RunSurvey {
    /// Identifies the run.
    pub epoch: Hex64,
    /// Name of the session.
    pub session: String,
    /// Release of the recorder.
    pub program_version: String,
    /// Unix time of its start [ns].
    pub wall_time_ns: u64,
    /// Hash of the scene.
    pub scene_hash: Hex64,
    /// Names of the objects.
    pub objects: Vec<String>,
    /// Gaussians in a frame.
    pub gaussians: u32,
    /// Simulated particles.
    pub particles: u32,
    /// Frames per simulated second [1/s].
    pub frame_rate: f64,
    /// Names of the files that the server read.
    pub files: Vec<String>,
    /// Whether the run began with a checkpoint that is in the file.
    pub has_checkpoint: bool,
    /// Steps after which the complete state is in the file.
    pub checkpoints: Vec<u64>,
    /// Frames, each step counted once.
    pub frames: u64,
    /// First and last step of a frame.
    pub steps: Option<[u64; 2]>,
    /// Simulated time of the first and the last frame [s].
    pub sim_time: Option<[f64; 2]>,
    /// Wall time from the first to the last frame [s].
    pub wall_seconds: f64,
    /// Steps whose state hash is in the file.
    pub hashes: u64,
    /// Steps that began with a reset.
    pub resets: u64,
    /// Interruptions that the recorder noted.
    pub gaps: Vec<GapRecord>,
    /// Steps that are missing without a note.
    pub untold: Vec<Untold>,
    /// Applied commands, by sender.
    pub clients: Vec<ClientSurvey>,
    /// What is missing to simulate the run again; nothing where it can be verified.
    pub lacks: Vec<Lack>,
}

/// Commands of one sender.
#[derive(Clone, Debug, Serialize)]
pub struct ClientSurvey {
    /// The sender.
    pub client: Hex64,
    /// Its commands, by name.
    pub commands: BTreeMap<&'static str, u64>,
}

impl Survey {
    /// Reads a recording to its end.
    ///
    /// # Errors
    /// When it cannot be read, or is damaged or unfinished.
    pub fn of(path: &Path) -> Result<Self, RecordingError> {
        let file = std::fs::metadata(path).map_err(|cause| RecordingError::Open {
            path: path.to_owned(),
            cause,
        })?;
        let mut recording = Recording::open(path)?.without_gaussians();
        let mut surveyor = Surveyor::default();
        for event in &mut recording {
            surveyor.take(event?);
        }
        surveyor.close();
        Ok(Self {
            path: path.to_owned(),
            bytes: file.len(),
            topics: recording.traffic().clone(),
            attachments: surveyor.attachments,
            runs: surveyor.runs,
        })
    }
}

/// Takes the events of a recording.
#[derive(Default)]
struct Surveyor {
    walk: Walk,
    attachments: BTreeMap<String, u64>,
    /// Scenes whose text is there.
    texts: BTreeSet<u64>,
    runs: Vec<RunSurvey>,
    open: Option<OpenRun>,
}

/// A run that is being read.
struct OpenRun {
    survey: RunSurvey,
    /// `None` where the run has no metadata, or they cannot be read.
    header: Option<RunHeader>,
    steps: StepCount,
    commands: CommandCount,
    has_objects: bool,
    hashed: Option<u64>,
    sent: Option<[u64; 2]>,
}

impl Surveyor {
    fn take(&mut self, event: Event) {
        if let Some(begun) = self.walk.next(&event) {
            self.close();
            self.open = Some(OpenRun::new(begun));
        }
        if let Event::Attachment { name, data } = &event {
            self.attachments.insert(name.clone(), data.len() as u64);
        }
        let Some(run) = &mut self.open else { return };
        match event {
            Event::Attachment { name, .. } => {
                if let (SCENE_TOML, Some(header)) = (name.as_str(), &run.header) {
                    self.texts.insert(header.scene.scene_hash);
                }
                let (epoch, step) = checkpoint_of(&name).unzip();
                if epoch == Some(run.survey.epoch.0) {
                    run.survey.checkpoints.extend(step);
                }
            }
            Event::Frame(frame) => run.frame(&frame.header),
            Event::Objects(header, _) => {
                run.has_objects = true;
                if header.state_hash != 0 {
                    run.hash(header.step);
                }
            }
            Event::Journal(entry) => run.command(&entry),
            Event::Gap(gap) => run.gap(gap),
            Event::Metadata { .. } => {}
        }
    }

    fn close(&mut self) {
        let Some(mut run) = self.open.take() else {
            return;
        };
        let lacks = match &run.header {
            Some(header) => {
                let has_text = self.texts.contains(&header.scene.scene_hash);
                header.lacks(has_text, |name| self.attachments.contains_key(name))
            }
            None => vec![Lack::Metadata {
                epoch: run.survey.epoch.0,
            }],
        };
        let count = run.header.as_ref().map_or(0, |h| h.scene.object_count);
        if run.survey.frames == 0 {
            run.survey.lacks.push(Lack::Frames);
        } else if count > 0 && !run.has_objects {
            run.survey.lacks.push(Lack::Objects { count });
        }
        if !run.survey.checkpoints.is_empty() {
            // The run is taken up from the first of them.
            let is_early = |lack: &Lack| matches!(lack, Lack::Commands { first: 0, .. });
            run.survey.lacks.retain(|lack| !is_early(lack));
        }
        run.survey.lacks.splice(0..0, lacks);
        run.survey.lacks.dedup();
        if let Some([first, last]) = run.sent {
            run.survey.wall_seconds = last.saturating_sub(first) as f64 * 1e-9;
        }
        self.runs.push(run.survey);
    }
}

impl OpenRun {
    fn new(Beginning { epoch, header }: Beginning) -> Self {
        let header = header.ok();
        let known = header.as_ref();
        let files = known.and_then(|h| h.files.as_deref()).unwrap_or_default();
        let survey = RunSurvey {
            epoch: Hex64(epoch),
            session: known.map(|h| h.session.clone()).unwrap_or_default(),
            program_version: known.map(|h| h.program_version.clone()).unwrap_or_default(),
            wall_time_ns: known.map_or(0, |h| h.wall_time_ns),
            scene_hash: Hex64(known.map_or(0, |h| h.scene.scene_hash)),
            objects: known.map(|h| h.objects.clone()).unwrap_or_default(),
            gaussians: known.map_or(0, |h| h.scene.gaussian_count),
            particles: known.map_or(0, |h| h.scene.particle_count),
            frame_rate: known.map_or(0.0, |h| h.scene.frame_rate),
            files: files.iter().map(|file| file.name.clone()).collect(),
            has_checkpoint: files
                .iter()
                .any(|f| f.kind == FileKind::Checkpoint && f.attachment.is_ok()),
            checkpoints: Vec::new(),
            frames: 0,
            steps: None,
            sim_time: None,
            wall_seconds: 0.0,
            hashes: 0,
            resets: 0,
            gaps: Vec::new(),
            untold: Vec::new(),
            clients: Vec::new(),
            lacks: Vec::new(),
        };
        Self {
            survey,
            header,
            steps: StepCount::default(),
            commands: CommandCount::default(),
            has_objects: false,
            hashed: None,
            sent: None,
        }
    }

    fn frame(&mut self, header: &FrameHeader) {
        self.survey.untold.extend(self.steps.frame(header.step));
        self.hash(header.step);
        let [first, last] = self.survey.steps.unwrap_or([header.step; 2]);
        // The last frame of a session may come twice.
        self.survey.frames += u64::from(self.survey.frames == 0 || last != header.step);
        self.survey.steps = Some([first, header.step]);
        let [start, _] = self.survey.sim_time.unwrap_or([header.sim_time; 2]);
        self.survey.sim_time = Some([start, header.sim_time]);
        let [sent, _] = self.sent.unwrap_or([header.publish_ns; 2]);
        self.sent = Some([sent, header.publish_ns]);
        self.survey.resets += u64::from(header.flags & FRAME_FLAG_RESET != 0);
    }

    fn hash(&mut self, step: u64) {
        if self.hashed.is_none_or(|last| step > last) {
            self.hashed = Some(step);
            self.survey.hashes += 1;
        }
    }

    fn command(&mut self, entry: &JournalEntry) {
        if let Err(lack) = self.commands.take(entry) {
            self.survey.lacks.push(lack);
        }
        let client = Hex64(entry.applied.client);
        let clients = &mut self.survey.clients;
        let at = clients.iter().position(|c| c.client == client);
        let at = at.unwrap_or_else(|| {
            clients.push(ClientSurvey {
                client,
                commands: BTreeMap::new(),
            });
            clients.len() - 1
        });
        let name = command_name(entry.applied.command.kind);
        *clients[at].commands.entry(name).or_default() += 1;
    }

    fn gap(&mut self, gap: GapRecord) {
        if let Some(last) = gap.to_step {
            self.steps.gap(last);
        }
        self.survey.gaps.push(gap);
    }
}
