//! What a demo measured: one object out of what its processes printed.

use std::path::PathBuf;

use serde::{Deserialize, Serialize};

/// Last line of `cosplat demo --json`.
#[derive(Debug, Serialize)]
pub struct Outcome {
    /// Session name.
    pub session: String,
    /// Visible Gaussians.
    pub gaussians: u64,
    /// Simulated particles.
    pub particles: u64,
    /// Objects, static ones included.
    pub objects: u64,
    /// Frames the server published, the initial state included.
    pub frames_published: u64,
    /// Frames in the recording.
    pub frames_recorded: u64,
    /// Frames of the run, the initial state included, that the recording lacks: skipped by the server because readers
    /// held its memory, or lost by the recorder.
    pub frames_dropped: u64,
    /// Frames drawn beside the run.
    pub frames_rendered: u64,
    /// Frames of the video, drawn from the recording.
    pub video_frames: u64,
    /// Simulated seconds.
    pub sim_seconds: f64,
    /// Wall seconds that took.
    pub wall_seconds: f64,
    /// `sim_seconds / wall_seconds`.
    pub real_time_factor: f64,
    /// From publishing to the recorder's receipt [us].
    pub latency_us: Latency,
    /// Commands the server accepted from the controller.
    pub commands_acknowledged: u64,
    /// The recording.
    pub recording: PathBuf,
    /// A picture from the middle of the run.
    pub picture: PathBuf,
    /// The video.
    pub video: PathBuf,
    /// State hash of the last frame.
    pub state_hash: String,
}

/// Percentiles of a latency [us].
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
pub struct Latency {
    /// Median.
    pub p50: f64,
    /// 99th percentile.
    pub p99: f64,
}

/// Last line of `cosplat serve --json`, as far as it is used here.
#[derive(Debug, Deserialize)]
pub(crate) struct Served {
    pub(crate) steps: u64,
    pub(crate) gaussians: u64,
    pub(crate) particles: u64,
    pub(crate) objects: u64,
    pub(crate) frames_published: u64,
    pub(crate) sim_seconds: f64,
    pub(crate) wall_seconds: f64,
    pub(crate) real_time_factor: f64,
    pub(crate) state_hash: String,
}

/// Last line of `cosplat record --json`, as far as it is used here.
#[derive(Debug, Deserialize)]
pub(crate) struct Recorded {
    pub(crate) frames_recorded: u64,
    pub(crate) latency_us: Latency,
}

/// Last line of `cosplat view --json`, as far as it is used here.
#[derive(Debug, Deserialize)]
pub(crate) struct Viewed {
    pub(crate) frames_rendered: u64,
}

/// Last line of `cosplat ctl script --json`, as far as it is used here.
#[derive(Debug, Deserialize)]
pub(crate) struct Controlled {
    pub(crate) acknowledged: u64,
}

impl Outcome {
    /// The same for people.
    pub fn sentence(&self) -> String {
        format!(
            "{gaussians} Gaussians on {particles} particles in {objects} objects: {sim:.2} s simulated in {wall:.2} s \
             ({factor:.2} x real time)\n\
             {published} frames published, {recorded} recorded, {dropped} dropped, {rendered} drawn meanwhile, \
             {film} in the video; {commands} commands acknowledged\n\
             publish to receive: {p50:.0} us median, {p99:.0} us at the 99th percentile\n\
             recording {recording}\npicture   {picture}\nvideo     {video}\nstate     {hash}",
            gaussians = self.gaussians,
            particles = self.particles,
            objects = self.objects,
            sim = self.sim_seconds,
            wall = self.wall_seconds,
            factor = self.real_time_factor,
            published = self.frames_published,
            recorded = self.frames_recorded,
            dropped = self.frames_dropped,
            rendered = self.frames_rendered,
            film = self.video_frames,
            commands = self.commands_acknowledged,
            p50 = self.latency_us.p50,
            p99 = self.latency_us.p99,
            recording = self.recording.display(),
            picture = self.picture.display(),
            video = self.video.display(),
            hash = self.state_hash,
        )
    }
}
