//! `cosplat replay`: publishes a recording as a session, so that viewers attach to it as to a live run.

use std::{
    path::PathBuf,
    sync::atomic::{AtomicBool, Ordering},
    time::{Duration, Instant},
};

use anyhow::{Context, ensure};
use bytemuck::{Pod, pod_collect_to_vec};
use cosplat_ipc::{
    Domain,
    schema::{self as wire, Ack, Command, FrameHeader, GaussianRest, ObjectInfo, Status},
    server::{Asked, FrameLoan, LoanRefused, PoolPlan, Reply, SceneBlocks, ServerPorts},
};
use cosplat_recorder::{
    chunks::Chunks,
    reader::RecordedFrame,
    tape::{Tape, TapeStep},
    topics::{SCENE_FEATURES, SCENE_GAUSSIANS, SCENE_OBJECTS, SCENE_SH},
};
use cosplat_server::{
    convert::{Order, order_from_wire},
    pace::{Pace, Pacer},
    steering::{Permission, Scheduled, Steering},
};
use serde_json::json;

use crate::{
    note, progress,
    resimulate::{Take, take},
    say, signals,
};

/// Publish a recording as a session, so that viewers attach to it as to a live run.
///
/// It takes the orders pause, resume, stop and seek (`cosplat ctl seek STEP`) and refuses all others.
#[derive(clap::Args)]
pub struct Args {
    /// The recording.
    recording: PathBuf,
    /// Name under which clients find it.
    #[arg(long, default_value = "default")]
    session: String,
    /// How fast: simulated seconds per wall second, 0.001 to 1e6.
    #[arg(long, default_value_t = 1.0, value_parser = rate)]
    rate: f64,
    /// Begin anew at the end.
    #[arg(long = "loop")]
    endless: bool,
    /// Show the first step and wait (`cosplat ctl resume` starts it).
    #[arg(long)]
    paused: bool,
    /// Wait for slow readers instead of skipping a frame when shared memory is used up.
    #[arg(long)]
    lossless: bool,
    /// Which run of the server, counted from 1; needed where the recording holds several.
    #[arg(long, value_name = "N")]
    run: Option<usize>,
    /// Print one JSON object when done.
    #[arg(long)]
    json: bool,
}

fn rate(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(value) if (1e-3..=1e6).contains(&value) => Ok(value),
        _ => Err("expected simulated seconds per wall second, 0.001 to 1e6".into()),
    }
}

/// How long a paused replay sleeps between looks at its clients; a request wakes it at once.
const IDLE: Duration = Duration::from_millis(20);
/// How often a lossless replay that waits for memory looks at its clients and signals.
const LOSSLESS_WAIT: Duration = Duration::from_millis(1);

/// Runs the command.
///
/// # Errors
/// When the recording cannot be read, or the session cannot be made.
pub fn run(args: &Args) -> anyhow::Result<()> {
    let stop = signals::stop_flag()?;
    let mut chunks = Chunks::open(&args.recording)?;
    let Take {
        header,
        kept,
        scene,
    } = take(&mut chunks, &args.recording, args.run)?;
    let bar = progress::bar("looking through", chunks.count() as u64);
    let tape = Tape::open(chunks, header.scene.epoch, |done, _| {
        bar.set_position(done as u64);
    })?;
    bar.finish_and_clear();
    let range = tape.range();
    let range = range.with_context(|| format!("{} has no frames", args.recording.display()))?;

    let block = |name: &str| scene.get(name).map_or(&[][..], Vec::as_slice);
    let gaussians = items::<GaussianRest>(SCENE_GAUSSIANS, block(SCENE_GAUSSIANS))?;
    let sh = items::<f32>(SCENE_SH, block(SCENE_SH))?;
    let objects = items::<ObjectInfo>(SCENE_OBJECTS, block(SCENE_OBJECTS))?;
    let features = items::<f32>(SCENE_FEATURES, block(SCENE_FEATURES))?;
    let text = String::from_utf8_lossy(kept.text(&header).unwrap_or_default());
    let blocks = SceneBlocks {
        header: header.scene,
        gaussians: &gaussians,
        sh: &sh,
        objects: &objects,
        features: &features,
        source: &text,
        // What a replay publishes is not simulated.
        files: &[],
    };
    let domain = Domain::from_env().context("cannot use the session folder")?;
    let mut ports = ServerPorts::create(&domain, &args.session, &PoolPlan::new(&blocks))?;
    ports.publish_scene(&blocks)?;
    note!(
        "replaying steps {} to {} as session {:?}{}",
        range[0],
        range[1],
        args.session,
        if args.paused { ", paused" } else { "" }
    );
    let period = header.scene.frame_rate * args.rate;
    ensure!(
        period.is_finite() && period > 0.0,
        "the recording has the frame rate {}, expected a positive number",
        header.scene.frame_rate
    );
    let mut player = Player {
        tape,
        ports,
        range,
        steering: Steering::new(args.paused),
        pacer: Pacer::new(Pace::Realtime, period, Instant::now()),
        args,
        stop: &stop,
        shown: None,
        frames: 0,
        skipped: 0,
    };
    player.run()?;
    if args.json {
        let (frames, skipped) = (player.frames, player.skipped);
        say!(
            "{}",
            json!({ "frames_published": frames, "frames_skipped": skipped })
        )?;
    }
    Ok(())
}

/// The elements of an attachment.
fn items<T: Pod>(name: &str, bytes: &[u8]) -> anyhow::Result<Vec<T>> {
    ensure!(
        bytes.len().is_multiple_of(size_of::<T>()),
        "attachment {name} has {} bytes, expected a multiple of {}",
        bytes.len(),
        size_of::<T>()
    );
    Ok(pod_collect_to_vec(bytes))
}

/// A step that was published.
struct Shown {
    frame: Box<RecordedFrame>,
    status: Status,
    is_last: bool,
}

/// Publishes one step after the other.
struct Player<'a> {
    tape: Tape,
    ports: ServerPorts,
    range: [u64; 2],
    steering: Steering,
    pacer: Pacer,
    args: &'a Args,
    stop: &'a AtomicBool,
    /// What was published last, and whether it was marked as the last of all.
    shown: Option<Shown>,
    frames: u64,
    skipped: u64,
}

impl Player<'_> {
    fn run(&mut self) -> anyhow::Result<()> {
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
        self.status(wire::SERVER_STOPPING)
    }

    /// What comes next: a step, nothing just now, or the end.
    fn permission(&mut self) -> Permission {
        if self.stop.load(Ordering::Relaxed) {
            return Permission::End;
        }
        match self.steering.permission() {
            Permission::Step if self.tape.next_step().is_none() => {
                let begins_anew = self.args.endless && self.tape.seek(0).is_some();
                match begins_anew {
                    true => Permission::Step,
                    false => Permission::End,
                }
            }
            other => other,
        }
    }

    /// Publishes the next step.
    fn show(&mut self) -> anyhow::Result<()> {
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
        let ends = self.tape.next_step().is_none() && !self.args.endless;
        let (flags, state) = match self.steering.permission() {
            Permission::Wait => (wire::FRAME_FLAG_PAUSED, wire::SERVER_PAUSED),
            Permission::Step if !ends => (0, wire::SERVER_RUNNING),
            Permission::Step | Permission::End => (wire::FRAME_FLAG_LAST, wire::SERVER_RUNNING),
        };
        self.send(&frame, flags)?;
        let board = frame.board.as_ref().map(Status::from).unwrap_or_default();
        let status = Status {
            step: number,
            sim_time: frame.header.sim_time,
            state_hash: frame.header.state_hash,
            server_state: 0,
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
    fn send(&mut self, frame: &RecordedFrame, flags: u32) -> anyhow::Result<()> {
        match self.loan(frame.gaussians.len()) {
            Ok(mut loan) => {
                loan.gaussians_mut().copy_from_slice(&frame.gaussians);
                loan.send(&FrameHeader {
                    flags: frame.header.flags & wire::FRAME_FLAG_RESET | flags,
                    ..frame.header
                })?;
                self.frames += 1;
            }
            Err(LoanRefused::PoolInUse { .. }) => self.skipped += 1,
            Err(other) => return Err(other.into()),
        }
        Ok(())
    }

    /// Memory for a frame: at once, or as soon as readers give some back when nothing may be lost.
    fn loan(&mut self, count: usize) -> Result<FrameLoan, LoanRefused> {
        loop {
            let loan = self.ports.loan_frame(count);
            let waits = self.args.lossless && !self.stop.load(Ordering::Relaxed);
            if !waits || !matches!(loan, Err(LoanRefused::PoolInUse { .. })) {
                return loan;
            }
            std::thread::sleep(LOSSLESS_WAIT);
            self.ports.maintain();
        }
    }

    /// Says how the replay goes: the recorded figures of the newest step, and what it does now.
    fn status(&mut self, state: u32) -> anyhow::Result<()> {
        let Some(Shown { status, .. }) = &mut self.shown else {
            return Ok(());
        };
        if status.server_state != state {
            status.server_state = state;
            status.frames_published = self.frames;
            status.frames_skipped = self.skipped;
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
                 header, commands, ..
             }| {
                let acks = commands.iter().map(|command| {
                    let outcome = obey(tape, steering, range, header.client, command);
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
        sought
    }
}

/// Obeys one command and returns the step at which it takes effect, or says why not.
fn obey(
    tape: &mut Tape,
    steering: &mut Steering,
    range: [u64; 2],
    client: u64,
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
    let Ok(Order::Server(control)) = order_from_wire(command) else {
        return Err(
            "this session replays a recording: it takes pause, resume, stop and seek".into(),
        );
    };
    let step = command.apply_at_step.max(next_step);
    let order = Scheduled {
        step,
        client,
        sequence: command.sequence,
        control,
    };
    steering.order(order, next_step)?;
    Ok(step)
}
