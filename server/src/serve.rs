//! The simulation process from first to last: publish the scene, step, write frames, answer, stop cleanly.

mod participants;
mod publishing;

use std::{
    fs,
    io::Write,
    os::unix::fs::PermissionsExt,
    path::{Path, PathBuf},
    sync::{
        Mutex,
        atomic::{AtomicBool, Ordering},
    },
    time::{Duration, Instant},
};

use cosplat_files::reading;
use cosplat_ipc::{
    Domain, schema as wire,
    server::{CreateError, LoanRefused, PoolPlan, PublishError, Reply, ServerPorts},
};
use cosplat_pacing::{
    allowance::Allowance,
    late::{Answers, CheckpointFolder},
    lockstep::{Lockstep, LockstepOptions},
    pace::{Pace, Pacer},
    steering::Permission,
};
use cosplat_scene::{
    load::LoadedScene,
    sources::{SourceFile, SourceKind},
};
use cosplat_sim_core::{
    Action, CheckpointError, Command, Interruption, StepReport, World, WorldError, notices::Notices,
};

use crate::{
    changes::Told,
    ingest::Ingest,
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
    /// Who takes part, with [`Pace::Lockstep`].
    pub lockstep: LockstepOptions,
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
    World(WorldError),
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
    #[error("cannot read checkpoint {}: {cause}", path.display())]
    ReadCheckpoint {
        /// The file.
        path: PathBuf,
        /// What the system says.
        cause: std::io::Error,
    },
    /// A checkpoint cannot be used.
    #[error("cannot restore {}: {cause}", path.display())]
    Restore {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        cause: CheckpointError,
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
/// How often it is looked amid a frame whether the session is to end.
const LOOK: Duration = Duration::from_millis(50);

/// Serves `scene` until its duration is over, a client or `stop` ends it.
///
/// `started` is called once when clients can attach.
///
/// The calling thread becomes one of the solver's for as long as it lives: a thread serves once.
///
/// # Errors
/// See [`ServeError`]. Whatever clients do is no error.
pub fn serve(
    mut scene: LoadedScene,
    options: &ServeOptions,
    stop: &AtomicBool,
    started: impl FnOnce(&ServeSummary),
) -> Result<ServeSummary, ServeError> {
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(options.threads)
        .thread_name(|i| format!("solver-{i}"))
        // A step would otherwise be handed to another thread and back several times, by a wake-up each.
        .use_current_thread()
        .build()
        .map_err(|error| ServeError::Threads {
            threads: options.threads,
            reason: error.to_string(),
        })?;
    let output = Output::new(&scene.scene);
    let mut world = pool
        .install(|| World::new(scene.scene.clone()))
        .map_err(ServeError::World)?;
    if let Some(path) = &options.restore {
        scene
            .sources
            .push(pool.install(|| restore(&mut world, path))?);
    }
    let buffers = SceneBuffers::new(&scene);
    let blocks = buffers.blocks(&scene);
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
    let frame_dt = 1.0 / scene.scene.frame_rate;
    let lockstep = match options.pace {
        Pace::Lockstep => Some(Lockstep::new(&options.lockstep, Instant::now())),
        Pace::Realtime | Pace::Free => None,
    };
    let objects = scene.scene.objects.iter().map(|o| o.name.clone());
    let colliders = scene.scene.colliders.iter().map(|c| c.name.clone());
    let mut server = Server {
        lockstep,
        names: (objects.collect(), colliders.collect()),
        contacts: vec![],
        output,
        told: Told::default(),
        flags: 0,
        frame_dt,
        allowance: Allowance::new(frame_dt),
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
        notices: Notices::new(&scene.scene),
    };
    started(&server.summary);
    server.run()?;
    Ok(server.summary)
}

/// Has `world` begin with the checkpoint at `path`.
fn restore(world: &mut World, path: &Path) -> Result<SourceFile, ServeError> {
    let content = reading::read(path, reading::LARGEST_DATA);
    let bytes = content.map_err(|cause| ServeError::ReadCheckpoint {
        path: path.into(),
        cause,
    })?;
    world.restore(&bytes).map_err(|cause| ServeError::Restore {
        path: path.into(),
        cause,
    })?;
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let kind = SourceKind::Checkpoint;
    Ok(SourceFile::of(kind, &name, path, &bytes))
}

struct Server<'a> {
    world: World,
    ports: ServerPorts,
    output: Output,
    /// What readers of `changes` know.
    told: Told,
    /// `FRAME_FLAG_*` of the last frame.
    flags: u32,
    ingest: Ingest,
    lockstep: Option<Lockstep>,
    /// Names of objects and colliders.
    names: (Vec<String>, Vec<String>),
    /// Contacts of the last step, where somebody wants to know.
    contacts: Vec<wire::Contact>,
    allowance: Allowance,
    pacer: Pacer,
    pool: rayon::ThreadPool,
    options: &'a ServeOptions,
    stop: &'a AtomicBool,
    frame_dt: f64,
    summary: ServeSummary,
    last_sent: bool,
    notices: Notices,
}

impl Server<'_> {
    fn run(&mut self) -> Result<(), ServeError> {
        self.publish(0)?;
        loop {
            let news = self.answer();
            self.watch_participants(self.held_up() == Permission::Wait);
            match self.permission() {
                Permission::End => break,
                Permission::Wait => self.idle(news)?,
                Permission::Step => {
                    let begin = Instant::now();
                    self.step()?;
                    self.pacer.frame_done(Instant::now());
                    self.wait_until_due();
                    self.summary.wall_seconds += begin.elapsed().as_secs_f64();
                }
            }
        }
        if !self.last_sent {
            // The state of the last step once more, so that readers learn that nothing follows.
            self.publish(0)?;
        }
        let unmet = self.ingest.late.give_up();
        self.answer_late(unmet);
        self.dismiss_participants();
        self.output.state = wire::SERVER_STOPPING;
        self.update_status()?;
        Ok(self.ports.check_place()?)
    }

    /// Whether a step may be made: the one place that says so. Steering may hold it up, and so may participants; what
    /// is left is a matter of time.
    fn permission(&self) -> Permission {
        let waits = |lockstep: &Lockstep| !lockstep.permits();
        match self.held_up() {
            Permission::Step if self.lockstep.as_ref().is_some_and(waits) => Permission::Wait,
            other => other,
        }
    }

    /// Whether the session has ended or is paused.
    fn held_up(&self) -> Permission {
        let is_stopped = self.lockstep.as_ref().is_some_and(Lockstep::is_stopped);
        let is_lost = self.ports.check_place().is_err();
        if self.done() || is_stopped || is_lost || self.stop.load(Ordering::Relaxed) {
            Permission::End
        } else {
            self.ingest.steering.permission()
        }
    }

    fn answer_late(&mut self, answers: Vec<Answers>) {
        for (ticket, acks) in answers {
            self.ports.answer(ticket, acks);
        }
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

    /// Whether somebody told the server to end.
    fn told_to_stop(&self) -> bool {
        !self.done() && self.held_up() == Permission::End
    }

    /// Looks at what clients ask for, as far as there is time for it, and writes the checkpoint that is due; says
    /// whether there was anything.
    fn answer(&mut self) -> bool {
        let heard = self.hear_participants();
        let next_step = self.world.report().step + 1;
        let begin = Instant::now();
        let (world, ingest, allowance) = (&self.world, &mut self.ingest, &mut self.allowance);
        let before = ingest.waiting();
        let mut asked = 0;
        self.ports.poll_commands(|request| {
            let seconds = begin.elapsed().as_secs_f64();
            // Fewer than before, where some were cancelled.
            if !allowance.covers(seconds, ingest.waiting().saturating_sub(before)) {
                // Charged for being put off, requests would never get their turn.
                return Reply::NotYet;
            }
            asked += 1;
            ingest.accept(&request, next_step, &|action| world.check(action))
        });
        if asked > 0 {
            let seconds = begin.elapsed().as_secs_f64();
            allowance.answered(seconds, ingest.waiting().saturating_sub(before));
        }
        for departed in self.ports.departed() {
            self.ingest.depart(departed);
        }
        let cancelled = self.ingest.take_answers();
        self.answer_late(cancelled);
        self.summary.commands_accepted = self.ingest.accepted;
        self.summary.commands_refused = self.ingest.refused;
        if let Some(path) = self.ingest.late.file_due(next_step) {
            // Clients wait for the file: failing to write it must not end the simulation.
            let name = path.display();
            let outcome = match write_checkpoint(&path, &self.world.checkpoint()) {
                Ok(()) => Ok(name.to_string()),
                Err(error) => Err(format!("cannot write {name}: {error}")),
            };
            let answers = self.ingest.late.written(next_step, &outcome);
            self.answer_late(answers);
        }
        heard || asked > 0
    }

    /// One turn of a server that is paused or waits for participants; `news` says whether the status has changed.
    fn idle(&mut self, news: bool) -> Result<(), ServeError> {
        self.greet_readers()?;
        if self.held_up() == Permission::Step {
            // Mostly they ask at once: who then waits for a status to be sent waits for nothing.
            let woken = self.ports.wait(IDLE);
            if !woken && (news || self.output.state != wire::SERVER_WAITING) {
                self.output.state = wire::SERVER_WAITING;
                self.update_status()?;
            }
            // In any case: requests that wait for their share of the time keep it awake.
            self.allowance.grant(IDLE.as_secs_f64());
            self.pacer.restart(Instant::now());
            return Ok(());
        }
        if news || self.output.state != wire::SERVER_PAUSED {
            self.output.state = wire::SERVER_PAUSED;
            self.update_status()?;
        }
        self.ports.maintain();
        self.allowance.grant(IDLE.as_secs_f64());
        self.ports.wait(IDLE);
        self.pacer.restart(Instant::now());
        Ok(())
    }

    /// Makes a step of the world, unless somebody ends the session meanwhile: signals are looked at all the time, clients where it takes
    /// long.
    fn make_step(&mut self, step: u64, commands: &[Command]) -> Option<StepReport> {
        let (world, frame_dt, stop) = (&mut self.world, self.frame_dt, self.stop);
        let clients = Mutex::new((&mut self.ports, &mut self.ingest, Instant::now()));
        let asks = || {
            if stop.load(Ordering::Relaxed) {
                return true;
            }
            // Another thread may be looking.
            let Ok(mut clients) = clients.try_lock() else {
                return false;
            };
            let (ports, ingest, looked) = &mut *clients;
            if looked.elapsed() < LOOK {
                return false;
            }
            *looked = Instant::now();
            let ends = |commands: &[wire::Command]| {
                commands.iter().all(|c| c.kind == wire::COMMAND_STOP) && !commands.is_empty()
            };
            // Orders to the server are not judged by the world.
            ports.poll_urgent(ends, |asked| ingest.accept(&asked, step, &|_| Ok(())));
            ingest.steering.permission() == Permission::End
        };
        let interruption = Interruption::when(&asks);
        self.pool
            .install(|| world.step_unless(&interruption, frame_dt, commands))
    }

    fn step(&mut self) -> Result<(), ServeError> {
        let begin = Instant::now();
        self.output.state = wire::SERVER_RUNNING;
        let step = self.world.report().step + 1;
        let due = self.ingest.take_due(step);
        let commands: Vec<_> = due.iter().map(|p| p.command.clone()).collect();
        let Some(report) = self.make_step(step, &commands) else {
            return Ok(());
        };
        if report.stopped {
            // Nothing will change until a command does something about it.
            self.ingest.steering.pause();
            self.summary.stops += 1;
            tracing::warn!(
                "paused at {:.6} s: {} particles would leave the domain, whose policy is to stop",
                report.sim_time,
                report.left_domain.len()
            );
        }
        let notices = self.notices.of(self.world.scene(), &report);
        for notice in &notices {
            tracing::warn!("{notice}");
        }
        let events = participants::events(notices, &report, &commands);
        self.ingest.steering.made_step(step + 1);
        self.summary.steps += 1;
        let stepped = Instant::now();
        let applied: Vec<_> = due.iter().map(|p| p.applied).collect();
        if !applied.is_empty() {
            self.ports.publish_journal(step, &applied)?;
            let seconds = report.timings.commands + stepped.elapsed().as_secs_f64();
            self.allowance.applied(seconds, applied.len());
        }
        self.allowance.grant(match self.options.pace {
            Pace::Realtime => report.timings.total.max(self.frame_dt),
            Pace::Lockstep if !self.is_locked() => report.timings.total.max(self.frame_dt),
            Pace::Free | Pace::Lockstep => report.timings.total,
        });
        let flags = commands.iter().fold(0, |flags, c| match c.action {
            Action::Reset => flags | wire::FRAME_FLAG_RESET,
            Action::Restore { .. } | Action::Undo | Action::Redo => {
                flags | wire::FRAME_FLAG_RESTORED
            }
            _ => flags,
        });
        self.publish(flags)?;
        let answers = match report.stopped {
            true => self
                .ingest
                .late
                .cancel_steps("the server paused itself: particles would leave the domain"),
            false => self.ingest.late.sent(step),
        };
        self.answer_late(answers);
        self.tell_participants(&report, events, begin.elapsed());
        self.summary.step_seconds += (stepped - begin).as_secs_f64();
        self.summary.publish_seconds += stepped.elapsed().as_secs_f64();
        Ok(())
    }

    /// Whether a participant is to be answered when a pair touches.
    fn awaits_contact(&self) -> bool {
        let lockstep = self.lockstep.as_ref();
        lockstep.is_some_and(Lockstep::awaits_contact)
    }

    /// Sleeps until the next frame is due; requests are answered meanwhile, as far as there is time for them.
    fn wait_until_due(&mut self) {
        loop {
            let left = self.pacer.left(Instant::now());
            if left.is_zero() || self.is_locked() || self.held_up() != Permission::Step {
                return;
            }
            if self.allowance.covers(0.0, 0) {
                if self.ports.wait(left) {
                    self.answer();
                }
            } else if self.lockstep.is_none() {
                std::thread::sleep(left.min(IDLE));
            } else if self.ports.wait_for_participants(left) {
                self.hear_participants();
            }
        }
    }
}

/// Writes a file that is either complete or not there. While it is written it has a name that nobody can foretell: where others
/// may write to the folder too, a link of theirs at a known name would lead the writing elsewhere.
fn write_checkpoint(path: &Path, bytes: &[u8]) -> std::io::Result<()> {
    let (Some(folder), Some(name)) = (path.parent(), path.file_stem()) else {
        return Err(std::io::ErrorKind::InvalidFilename.into());
    };
    let mut prefix = name.to_owned();
    prefix.push(".");
    // Made anew, never opened; dropped, it is removed.
    let mut unfinished = tempfile::Builder::new()
        .prefix(&prefix)
        .suffix(".unfinished")
        .permissions(fs::Permissions::from_mode(0o666))
        .tempfile_in(folder)?;
    unfinished.write_all(bytes)?;
    unfinished.persist(path).map_err(|error| error.error)?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use std::os::unix::fs::{MetadataExt, symlink};

    use super::*;

    #[test]
    fn a_checkpoint_follows_no_link() {
        let folder = tempfile::tempdir().expect("a folder");
        let at = |name: &str| folder.path().join(name);
        fs::write(at("victim"), "as it was").expect("written");
        for name in ["demo-step-7.unfinished", "demo-step-7.checkpoint"] {
            symlink(at("victim"), at(name)).expect("linked");
        }
        let path = at("demo-step-7.checkpoint");
        write_checkpoint(&path, b"state").expect("written");
        assert_eq!(fs::read(at("victim")).expect("readable"), b"as it was");
        let found = fs::symlink_metadata(&path).expect("there");
        assert!(found.is_file() && found.len() == 5);
        // What others may read is a matter of the umask, as of any file.
        assert_eq!(
            found.mode() & 0o777,
            fs::metadata(at("victim")).expect("there").mode() & 0o777
        );
        let left = fs::read_dir(folder.path()).expect("a folder").count();
        assert_eq!(left, 3, "nothing unfinished is left");
    }

    #[test]
    fn a_checkpoint_that_cannot_be_written_leaves_nothing() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("demo-step-7.checkpoint");
        fs::create_dir(&path).expect("made");
        write_checkpoint(&path, b"state").expect_err("a folder is in the way");
        assert_eq!(fs::read_dir(folder.path()).expect("a folder").count(), 1);
    }
}
