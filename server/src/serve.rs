//! The simulation process from first to last: publish the scene, step, write frames, answer, stop cleanly.

use std::{
    fs,
    path::{Path, PathBuf},
    sync::atomic::{AtomicBool, Ordering},
    time::{Duration, Instant},
};

use cosplat_ipc::{
    Domain,
    schema::{self as wire, FrameHeader},
    server::{CreateError, LoanRefused, PoolPlan, PublishError, ServerPorts},
};
use cosplat_sim_core::{CheckpointError, StepReport, World, WorldError};

use crate::{
    ingest::{CheckpointFolder, Ingest},
    load::LoadedScene,
    pace::{Pace, Pacer},
    publish::{Output, SceneBuffers},
};

/// How a scene is served.
#[derive(Clone, Debug)]
pub struct ServeOptions {
    /// Where sessions live.
    pub domain: Domain,
    /// Name of the session.
    pub session: String,
    /// How simulated time follows wall time.
    pub pace: Pace,
    /// Threads of the solver; 0 = one per core.
    pub threads: usize,
    /// Simulated seconds after which to stop; endless without.
    pub duration: Option<f64>,
    /// Begin paused, so that clients can attach before the first step.
    pub paused: bool,
    /// Wait for readers instead of skipping a frame when the pool is in use.
    pub lossless: bool,
    /// Frames in the shared pool; chosen by size without.
    pub frame_slots: Option<usize>,
    /// Folder that clients may have checkpoints written to.
    pub checkpoints: Option<PathBuf>,
    /// Checkpoint to begin with.
    pub restore: Option<PathBuf>,
}

/// Why serving ended badly.
#[derive(Debug, thiserror::Error)]
pub enum ServeError {
    /// The scene cannot be simulated.
    #[error("the scene cannot be simulated: {0}")]
    World(#[from] WorldError),
    /// The session cannot be made.
    #[error(transparent)]
    Create(#[from] CreateError),
    /// Nothing can be sent any more.
    #[error(transparent)]
    Publish(#[from] PublishError),
    /// A frame cannot be loaned for a reason that waiting does not cure.
    #[error(transparent)]
    Loan(#[from] LoanRefused),
    /// A checkpoint cannot be read.
    #[error("cannot read checkpoint {}: {source}", path.display())]
    ReadCheckpoint {
        /// The file.
        path: PathBuf,
        /// What the system says.
        source: std::io::Error,
    },
    /// A checkpoint cannot be used.
    #[error("cannot restore {}: {source}", path.display())]
    Restore {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        source: CheckpointError,
    },
    /// The thread pool cannot be made.
    #[error("cannot start {threads} threads: {reason}")]
    Threads {
        /// Threads asked for.
        threads: usize,
        /// What the system says.
        reason: String,
    },
}

/// What a session amounted to.
#[derive(Clone, Debug, Default)]
pub struct ServeSummary {
    /// Visible Gaussians.
    pub gaussians: usize,
    /// Simulated particles.
    pub particles: usize,
    /// Objects.
    pub objects: usize,
    /// Steps made.
    pub steps: u64,
    /// Frames published, the initial state included.
    pub frames_published: u64,
    /// Frames not published because the pool was in use.
    pub frames_skipped: u64,
    /// Frames undone because particles would have left a domain with the policy to stop.
    pub stops: u64,
    /// Simulated time at the end [s].
    pub sim_seconds: f64,
    /// Wall time spent running, pauses left out [s].
    pub wall_seconds: f64,
    /// Part of `wall_seconds` spent stepping [s].
    pub step_seconds: f64,
    /// Part of `wall_seconds` spent writing and sending [s].
    pub publish_seconds: f64,
    /// Commands accepted.
    pub commands_accepted: u64,
    /// Commands refused.
    pub commands_refused: u64,
    /// Hash of the last state.
    pub state_hash: u64,
}

/// How long a paused server sleeps between looks at its clients; a request wakes it at once.
const IDLE: Duration = Duration::from_millis(20);
/// How long a lossless server waits for memory before it looks at commands and signals again.
const LOSSLESS_WAIT: Duration = Duration::from_millis(50);

/// Serves `scene` until its duration is over, a client or `stop` ends it.
///
/// `started` is called once when clients can attach.
///
/// # Errors
/// See [`ServeError`]. Whatever clients do is no error.
pub fn serve(
    scene: LoadedScene,
    options: &ServeOptions,
    stop: &AtomicBool,
    started: impl FnOnce(&ServeSummary),
) -> Result<ServeSummary, ServeError> {
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(options.threads)
        .thread_name(|i| format!("solver-{i}"))
        .build()
        .map_err(|error| ServeError::Threads {
            threads: options.threads,
            reason: error.to_string(),
        })?;
    let buffers = SceneBuffers::new(&scene);
    let blocks = buffers.blocks(&scene);
    let output = Output::new(&scene.scene);
    let mut world = pool.install(|| World::new(scene.scene.clone()))?;
    if let Some(path) = &options.restore {
        let bytes = fs::read(path).map_err(|source| ServeError::ReadCheckpoint {
            path: path.clone(),
            source,
        })?;
        let restored = pool.install(|| world.restore(&bytes));
        restored.map_err(|source| ServeError::Restore {
            path: path.clone(),
            source,
        })?;
    }
    let plan = PoolPlan {
        frame_slots: options.frame_slots,
        ..PoolPlan::new(&blocks)
    };
    let mut ports = ServerPorts::create(&options.domain, &options.session, &plan)?;
    ports.publish_scene(&blocks)?;
    let checkpoints = options.checkpoints.clone().map(|folder| CheckpointFolder {
        folder,
        session: options.session.clone(),
    });
    let mut server = Server {
        output,
        frame_dt: 1.0 / scene.scene.frame_rate,
        pacer: Pacer::new(options.pace, scene.scene.frame_rate, Instant::now()),
        ingest: Ingest::new(options.paused, checkpoints),
        summary: ServeSummary {
            gaussians: scene.scene.gaussians.len(),
            particles: scene.scene.particles.position.len(),
            objects: scene.scene.objects.len(),
            ..ServeSummary::default()
        },
        pool,
        world,
        ports,
        options,
        stop,
        last_sent: false,
    };
    started(&server.summary);
    server.run()?;
    Ok(server.summary)
}

struct Server<'a> {
    world: World,
    ports: ServerPorts,
    output: Output,
    ingest: Ingest,
    pacer: Pacer,
    pool: rayon::ThreadPool,
    options: &'a ServeOptions,
    stop: &'a AtomicBool,
    frame_dt: f64,
    summary: ServeSummary,
    last_sent: bool,
}

impl Server<'_> {
    fn run(&mut self) -> Result<(), ServeError> {
        self.publish(0)?;
        while !self.done() {
            self.answer();
            if self.stopping() {
                break;
            }
            if self.ingest.paused {
                self.idle()?;
                continue;
            }
            let begin = Instant::now();
            self.step()?;
            self.pacer.frame_done(Instant::now());
            self.wait_until_due();
            self.summary.wall_seconds += begin.elapsed().as_secs_f64();
        }
        if !self.last_sent {
            // The state of the last step once more, so that readers learn that nothing follows.
            self.publish(wire::FRAME_FLAG_LAST)?;
        }
        self.output.state = wire::SERVER_STOPPING;
        self.update_status()
    }

    /// Steps in the requested duration.
    fn steps_to_do(&self) -> Option<u64> {
        let steps = self.options.duration? / self.frame_dt;
        Some((steps - 1e-6).ceil().max(0.0) as u64)
    }

    fn done(&self) -> bool {
        self.steps_to_do()
            .is_some_and(|steps| self.summary.steps >= steps)
    }

    fn stopping(&self) -> bool {
        self.ingest.stop || self.stop.load(Ordering::Relaxed)
    }

    fn answer(&mut self) {
        let next_step = self.world.report().step + 1;
        let (world, ingest) = (&self.world, &mut self.ingest);
        self.ports.poll_commands(|header, commands| {
            ingest.accept(header.client, commands, next_step, &|action| {
                world.check(action)
            })
        });
        if let Some(path) = self.ingest.take_checkpoint(next_step) {
            // A client asked for it and waits for the file: failing to write it must not end the simulation.
            if let Err(error) = write_checkpoint(&path, &self.world.checkpoint()) {
                tracing::warn!("cannot write checkpoint {}: {error}", path.display());
            }
        }
        self.summary.commands_accepted = self.ingest.accepted;
        self.summary.commands_refused = self.ingest.refused;
    }

    /// One turn of a paused server.
    fn idle(&mut self) -> Result<(), ServeError> {
        if self.output.state != wire::SERVER_PAUSED {
            self.output.state = wire::SERVER_PAUSED;
            self.update_status()?;
        }
        self.ports.maintain();
        self.ports.wait(IDLE);
        self.pacer.restart(Instant::now());
        Ok(())
    }

    fn step(&mut self) -> Result<(), ServeError> {
        let begin = Instant::now();
        self.output.state = wire::SERVER_RUNNING;
        let step = self.world.report().step + 1;
        let due = self.ingest.take_due(step);
        let commands: Vec<_> = due.iter().map(|p| p.command.clone()).collect();
        let (world, frame_dt) = (&mut self.world, self.frame_dt);
        let report = self.pool.install(|| world.step(frame_dt, &commands));
        if report.stopped {
            // Nothing will change until a command does something about it.
            self.ingest.paused = true;
            self.summary.stops += 1;
            tracing::warn!(
                "paused at {:.6} s: {} particles would leave the domain, whose policy is to stop",
                report.sim_time,
                report.left_domain.len()
            );
        }
        self.summary.steps += 1;
        let stepped = Instant::now();
        let applied: Vec<_> = due.iter().map(|p| p.applied).collect();
        if !applied.is_empty() {
            self.ports.publish_journal(step, &applied)?;
        }
        let mut flags = 0;
        if commands
            .iter()
            .any(|c| c.action == cosplat_sim_core::Action::Reset)
        {
            flags |= wire::FRAME_FLAG_RESET;
        }
        if self.done() || self.stopping() {
            flags |= wire::FRAME_FLAG_LAST;
        }
        self.publish(flags)?;
        self.summary.step_seconds += (stepped - begin).as_secs_f64();
        self.summary.publish_seconds += stepped.elapsed().as_secs_f64();
        Ok(())
    }

    /// Sends the current state: frame, objects, status.
    fn publish(&mut self, flags: u32) -> Result<(), ServeError> {
        self.last_sent = flags & wire::FRAME_FLAG_LAST != 0;
        let report = self.world.report();
        match loan(&self.ports, self.summary.gaussians, self.options, self.stop) {
            Ok(mut loan) => {
                let (world, output) = (&self.world, &self.output);
                self.pool
                    .install(|| output.write_frame(world, loan.gaussians_mut()));
                loan.send(&frame_header(report, flags))?;
                self.summary.frames_published += 1;
            }
            Err(LoanRefused::PoolInUse { .. }) => self.summary.frames_skipped += 1,
            Err(other) => return Err(other.into()),
        }
        let objects = self.output.objects(&self.world);
        self.ports.publish_objects(
            &wire::ObjectsHeader {
                step: report.step,
                sim_time: report.sim_time,
                ..Default::default()
            },
            &objects,
        )?;
        self.summary.sim_seconds = report.sim_time;
        self.summary.state_hash = report.state_hash;
        self.output.count(report);
        self.update_status()?;
        self.ports.maintain();
        Ok(())
    }

    fn update_status(&mut self) -> Result<(), ServeError> {
        let status = self.output.status(self.world.report(), &self.summary);
        Ok(self.ports.update_status(&status)?)
    }

    /// Sleeps until the next frame is due; requests are answered meanwhile.
    fn wait_until_due(&mut self) {
        loop {
            let left = self.pacer.left(Instant::now());
            if left.is_zero() || self.stop.load(Ordering::Relaxed) || self.ingest.paused {
                return;
            }
            if self.ports.wait(left) {
                self.answer();
            }
        }
    }
}

/// Writes a file that is either complete or not there.
fn write_checkpoint(path: &Path, bytes: &[u8]) -> std::io::Result<()> {
    let unfinished = path.with_extension("unfinished");
    fs::write(&unfinished, bytes)?;
    fs::rename(&unfinished, path)
}

/// Memory for the next frame: at once, or as soon as readers give some back when nothing may be lost.
fn loan(
    ports: &ServerPorts,
    count: usize,
    options: &ServeOptions,
    stop: &AtomicBool,
) -> Result<cosplat_ipc::server::FrameLoan, LoanRefused> {
    loop {
        let loan = if options.lossless {
            ports.loan_frame_within(count, LOSSLESS_WAIT)
        } else {
            ports.loan_frame(count)
        };
        let again = options.lossless && !stop.load(Ordering::Relaxed);
        match loan {
            Err(LoanRefused::PoolInUse { .. }) if again => continue,
            other => return other,
        }
    }
}

fn frame_header(report: &StepReport, flags: u32) -> FrameHeader {
    FrameHeader {
        step: report.step,
        sim_time: report.sim_time,
        dt: report.dt,
        state_hash: report.state_hash,
        substeps: report.substeps,
        flags,
        ..FrameHeader::default()
    }
}
