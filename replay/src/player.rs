//! A recording published as a session: viewers attach to it as to a live run.

use std::{
    path::Path,
    sync::atomic::{AtomicBool, Ordering},
    time::{Duration, Instant},
};

use cosplat_ipc::{
    Domain,
    schema::{self as wire, Ack, Command, FrameHeader, GaussianRest, ObjectInfo, Status},
    server::{Asked, FrameLoan, LoanRefused, PoolPlan, Reply, SceneBlocks, ServerPorts},
};
use cosplat_pacing::{
    pace::{Pace, Pacer},
    steering::{Permission, Steering},
    waiting,
};
use cosplat_recorder::{
    chunks::Chunks,
    reader::RecordedFrame,
    tape::{Tape, TapeStep},
    topics::{SCENE_FEATURES, SCENE_GAUSSIANS, SCENE_OBJECTS, SCENE_SH},
};
use cosplat_server::convert::{Order, order_from_wire};
use serde::Serialize;

use crate::{ReplayError, rerun::take};

/// How a recording is played.
#[derive(Clone, Debug)]
pub struct PlayOptions {
    /// Where sessions are.
    pub domain: Domain,
    /// Name under which clients find it.
    pub session: String,
    /// Simulated seconds per wall second, more than 0.
    pub rate: f64,
    /// Whether it begins anew at the end.
    pub endless: bool,
    /// Whether it shows the first step and waits.
    pub paused: bool,
    /// Whether it waits for slow readers instead of skipping a frame.
    pub lossless: bool,
}

/// What a replay has published.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Played {
    /// Frames that were sent.
    pub frames_published: u64,
    /// Frames that had no memory.
    pub frames_skipped: u64,
}

/// How long a paused replay sleeps between looks at its clients; a request wakes it at once.
const IDLE: Duration = Duration::from_millis(20);
/// How often a lossless replay that waits for memory looks at its clients and signals.
const LOSSLESS_WAIT: Duration = Duration::from_millis(1);

/// A step that was published.
struct Shown {
    frame: Box<RecordedFrame>,
    status: Status,
    is_last: bool,
}

/// Publishes one step after the other.
pub struct Player<'a> {
    tape: Tape,
    ports: ServerPorts,
    range: [u64; 2],
    steering: Steering,
    pacer: Pacer,
    options: &'a PlayOptions,
    stop: &'a AtomicBool,
    /// What was published last, and whether it was marked as the last of all.
    shown: Option<Shown>,
    played: Played,
}

impl<'a> Player<'a> {
    /// Opens run number `run` of a recording, counted from 1, or the only one, and makes its session. `progress` is told
    /// how many chunks of how many were looked through.
    ///
    /// # Errors
    /// When the recording cannot be read, or the session cannot be made.
    pub fn open(
        path: &Path,
        run: Option<usize>,
        options: &'a PlayOptions,
        stop: &'a AtomicBool,
        progress: impl FnMut(usize, usize),
    ) -> Result<Player<'a>, ReplayError> {
        let mut chunks = Chunks::open(path)?;
        let take = take(&mut chunks, path, run)?;
        let header = take.header.scene;
        let tape = Tape::open(chunks, header.epoch, progress)?;
        let range = tape.range().ok_or_else(|| ReplayError::NoFrames {
            path: path.to_owned(),
        })?;
        let found = header.frame_rate;
        let frame_rate = found * options.rate;
        if !(frame_rate.is_finite() && frame_rate > 0.0) {
            return Err(ReplayError::FrameRate { found });
        }
        let blocks = SceneBlocks {
            header,
            gaussians: &take.items::<GaussianRest>(SCENE_GAUSSIANS)?,
            sh: &take.items::<f32>(SCENE_SH)?,
            objects: &take.items::<ObjectInfo>(SCENE_OBJECTS)?,
            features: &take.items::<f32>(SCENE_FEATURES)?,
            source: &String::from_utf8_lossy(take.kept.text(&take.header).unwrap_or_default()),
            // What a replay publishes is not simulated.
            files: &[],
        };
        let plan = PoolPlan::new(&blocks);
        let mut ports =
            ServerPorts::create_replay(&options.domain, &options.session, &plan, range)?;
        ports.publish_scene(&blocks)?;
        Ok(Player {
            tape,
            ports,
            range,
            steering: Steering::new(options.paused),
            pacer: Pacer::new(Pace::Realtime, frame_rate, Instant::now()),
            options,
            stop,
            shown: None,
            played: Played::default(),
        })
    }

    /// First and last step of the run.
    pub fn range(&self) -> [u64; 2] {
        self.range
    }

    /// Plays to the end, or until a client or the stop flag ends it.
    ///
    /// # Errors
    /// When a step cannot be read or published.
    pub fn run(mut self) -> Result<Played, ReplayError> {
        // So that who attaches to a paused replay sees something.
        self.show()?;
        loop {
            let sought = self.answer();
            match self.permission() {
                Permission::End => break,
                Permission::Wait if sought => self.show()?,
                Permission::Wait => {
                    self.status(wire::SERVER_PAUSED)?;
                    self.ports.maintain();
                    self.ports.wait(IDLE);
                    self.pacer.restart(Instant::now());
                }
                Permission::Step => {
                    self.show()?;
                    self.pacer.frame_done(Instant::now());
                    self.wait_until_due();
                }
            }
        }
        if let Some(Shown {
            frame,
            is_last: false,
            ..
        }) = self.shown.as_ref()
        {
            // Once more, so that readers learn that nothing follows.
            let frame = frame.clone();
            self.send(&frame, wire::FRAME_FLAG_LAST)?;
        }
        self.status(wire::SERVER_STOPPING)?;
        self.ports.check_place()?;
        Ok(self.played)
    }

    /// What comes next: a step, nothing just now, or the end.
    fn permission(&mut self) -> Permission {
        if self.stop.load(Ordering::Relaxed) || self.ports.check_place().is_err() {
            return Permission::End;
        }
        match self.steering.permission() {
            Permission::Step if self.tape.next_step().is_none() => {
                let begins_anew = self.options.endless && self.tape.seek(0).is_some();
                match begins_anew {
                    true => Permission::Step,
                    false => Permission::End,
                }
            }
            other => other,
        }
    }

    /// Publishes the next step.
    fn show(&mut self) -> Result<(), ReplayError> {
        let Some(step) = self.tape.advance()? else {
            return Ok(());
        };
        let TapeStep {
            frame,
            objects,
            journal,
        } = step;
        let number = frame.header.step;
        if !journal.is_empty() {
            self.ports.publish_journal(number, &journal)?;
        }
        if let Some((header, states)) = &objects {
            self.ports.publish_objects(header, states)?;
        }
        let next = self.tape.next_step().unwrap_or(number + 1);
        self.steering.reach(next);
        let ends = self.tape.next_step().is_none() && !self.options.endless;
        let (flags, state) = match self.steering.permission() {
            Permission::Wait => (wire::FRAME_FLAG_PAUSED, wire::SERVER_PAUSED),
            Permission::Step if !ends => (0, wire::SERVER_RUNNING),
            Permission::Step | Permission::End => (wire::FRAME_FLAG_LAST, wire::SERVER_RUNNING),
        };
        self.send(&frame, flags)?;
        let board = frame.board.map(|board| board.0).unwrap_or_default();
        let status = Status {
            step: number,
            sim_time: frame.header.sim_time,
            state_hash: frame.header.state_hash,
            server_state: 0,
            // What was so of the recorded server: a replay sends whole frames.
            has_changes: 0,
            ..board
        };
        self.shown = Some(Shown {
            frame,
            status,
            is_last: flags == wire::FRAME_FLAG_LAST,
        });
        self.status(state)?;
        self.ports.maintain();
        Ok(())
    }

    /// Publishes a frame with its own flags and these.
    fn send(&mut self, frame: &RecordedFrame, flags: u32) -> Result<(), ReplayError> {
        match self.loan(frame.gaussians.len()) {
            Ok(mut loan) => {
                loan.gaussians_mut().copy_from_slice(&frame.gaussians);
                loan.send(&FrameHeader {
                    flags: frame.header.flags & wire::FRAME_FLAG_RESET | flags,
                    ..frame.header
                })?;
                self.played.frames_published += 1;
            }
            Err(LoanRefused::PoolInUse { .. }) => self.played.frames_skipped += 1,
            Err(other) => return Err(other.into()),
        }
        Ok(())
    }

    /// Memory for a frame: at once, or as soon as readers give some back when nothing may be lost.
    fn loan(&mut self, count: usize) -> Result<FrameLoan, LoanRefused> {
        loop {
            let loan = self.ports.loan_frame(count);
            let waits = self.options.lossless && !self.stop.load(Ordering::Relaxed);
            if !waits || !matches!(loan, Err(LoanRefused::PoolInUse { .. })) {
                return loan;
            }
            std::thread::sleep(LOSSLESS_WAIT);
            self.ports.maintain();
        }
    }

    /// Says how the replay goes: the recorded figures of the newest step, and what it does now.
    fn status(&mut self, state: u32) -> Result<(), ReplayError> {
        let Some(Shown { status, .. }) = &mut self.shown else {
            return Ok(());
        };
        if status.server_state != state {
            status.server_state = state;
            status.frames_published = self.played.frames_published;
            status.frames_skipped = self.played.frames_skipped;
            self.ports.update_status(status)?;
        }
        Ok(())
    }

    /// Sleeps until the next step is due; requests are answered meanwhile.
    fn wait_until_due(&mut self) {
        loop {
            let left = self.pacer.left(Instant::now());
            let goes_on = self.steering.permission() == Permission::Step;
            if left.is_zero() || !goes_on || self.stop.load(Ordering::Relaxed) {
                return;
            }
            if self.ports.wait(left.min(IDLE)) && self.answer() {
                return;
            }
        }
    }

    /// Answers what clients ask for; says whether one of them had the replay go elsewhere.
    fn answer(&mut self) -> bool {
        let mut sought = false;
        let (tape, steering, range) = (&mut self.tape, &mut self.steering, self.range);
        self.ports.poll_commands(
            |Asked {
                 port,
                 ticket,
                 header,
                 commands,
             }| {
                let acks = commands.iter().map(|command| {
                    let origin = waiting::Order {
                        client: header.client,
                        sequence: command.sequence,
                        port,
                        ticket,
                        step: 0,
                    };
                    let outcome = obey(tape, steering, range, origin, command);
                    match outcome {
                        Ok(step) => {
                            sought |= command.kind == wire::COMMAND_SEEK;
                            Ack::accepted(command.sequence, step)
                        }
                        Err(reason) => Ack::refused(command.sequence, &reason),
                    }
                });
                Reply::Now(acks.collect())
            },
        );
        self.ports.poll_steps(|Asked { commands, .. }| {
            let reason = "a replay waits for no participant: what it shows has happened";
            let refused = commands.iter().map(|c| Ack::refused(c.sequence, reason));
            let done = wire::StepDone::of_cause(wire::RETURN_REFUSED, reason);
            Reply::Now((done, refused.collect()))
        });
        for departed in self.ports.departed() {
            let later = self.steering.later();
            match departed.died {
                true => later.call_off(|order, _| order.port == departed.port),
                false => later.leave(departed.port),
            };
        }
        sought
    }
}

/// Obeys one command and returns the step at which it takes effect, or says why not.
fn obey(
    tape: &mut Tape,
    steering: &mut Steering,
    range: [u64; 2],
    origin: waiting::Order,
    command: &Command,
) -> Result<u64, String> {
    let [first, last] = range;
    let next_step = tape.next_step().unwrap_or(last + 1);
    if command.kind == wire::COMMAND_SEEK {
        let wanted = command.apply_at_step;
        let found = tape.seek(wanted).filter(|_| wanted >= first);
        return found.ok_or_else(|| {
            format!("step {wanted} is not in the recording, which holds steps {first} to {last}")
        });
    }
    let step = command.apply_at_step.max(next_step);
    match order_from_wire(origin.client, command) {
        Ok(Order::Server(control)) => {
            let order = waiting::Order { step, ..origin };
            steering.order(order, control, next_step)?;
            Ok(step)
        }
        Ok(Order::Cancel { of_all }) => {
            waiting::check_cancel(step, next_step)?;
            let is_off = |order: &waiting::Order| of_all || order.client == origin.client;
            steering.later().call_off(|order, _| is_off(order));
            Ok(next_step)
        }
        _ => Err(
            "this session replays a recording: it takes pause, resume, stop, seek and cancel"
                .into(),
        ),
    }
}
