//! The watch: every step of an act, and how long it took, noise of the machine aside.
//!
//! Simulations stall on a busy machine whatever a client does. So what a server had to wait for a processor is subtracted
//! from every wait, and so is what a thread of the watch itself overslept, and the time for which the campaign stopped the
//! server by a signal. What is left is for the server to answer for.

use std::{
    sync::{
        Arc, Mutex, PoisonError,
        atomic::{AtomicBool, AtomicU32, AtomicU64, Ordering},
    },
    thread::JoinHandle,
    time::{Duration, Instant},
};

use cosplat_ipc::{
    Client,
    client::{FrameReader, StepError},
    monotonic_ns,
    schema::{self as wire, FRAME_FLAG_LAST},
};

use super::{
    act::Pace,
    troupe::{PATIENCE, Stage},
};
use crate::process::processor_time;

/// How often the noise of the machine is looked at.
const SAMPLE: Duration = Duration::from_millis(10);
/// Length of a frame of the scene [ns].
pub const FRAME_NS: u64 = 20_000_000;
/// Frames by which a step may be late.
const PATIENT_FRAMES: f64 = 2.0;
/// Frames that a reader may have in its queue.
const QUEUE: usize = 64;

/// What was seen.
#[derive(Debug, Default)]
pub struct Seen {
    /// Steps watched.
    pub steps: u64,
    /// Longest wait, noise aside [frames].
    pub longest_wait: f64,
    /// Stalls, in words.
    pub stalls: Vec<String>,
    /// Steps lost, in words.
    pub lost: Vec<String>,
    /// What the watch could not do, in words.
    pub failures: Vec<String>,
}

/// What is no fault of the server.
#[derive(Default)]
struct Noise {
    /// Time, and what the server waited for processors until then, and what the sampler overslept [ns].
    samples: Vec<[u64; 3]>,
    /// When the campaign had the server stopped, or dead [ns].
    stopped: Vec<[u64; 2]>,
}

impl Noise {
    /// What of an interval is excused [ns].
    fn within(&self, from: u64, to: u64) -> u64 {
        let stopped = self.stopped.iter();
        let overlap = |[a, b]: &[u64; 2]| b.min(&to).saturating_sub(*a.max(&from));
        let stopped: u64 = stopped.map(overlap).sum();
        let at = self.samples.partition_point(|s| s[0] <= from);
        let end = self.samples.partition_point(|s| s[0] < to);
        let before = self.samples.get(at.saturating_sub(1));
        let after = self.samples.get(end).or(self.samples.last());
        let (Some(before), Some(after)) = (before, after) else {
            return stopped;
        };
        let waited = after[1].saturating_sub(before[1]);
        let overslept = after[2].saturating_sub(before[2]);
        stopped + waited.max(overslept)
    }
}

/// What threads of a watch share.
pub struct Shared {
    noise: Mutex<Noise>,
    seen: Mutex<Seen>,
    over: AtomicBool,
    /// Process of the server; 0 while there is none.
    server: AtomicU32,
    /// Newest epoch that was seen.
    pub epoch: AtomicU64,
    /// Newest step that was seen.
    pub step: AtomicU64,
}

fn locked<T>(mutex: &Mutex<T>) -> std::sync::MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Shared {
    /// The campaign stops or kills the server for a while.
    pub fn disturb<T>(&self, deed: impl FnOnce() -> T) -> T {
        let from = monotonic_ns();
        // Open until it is over: a wait that is judged meanwhile is excused.
        locked(&self.noise).stopped.push([from, u64::MAX]);
        let result = deed();
        if let Some(last) = locked(&self.noise).stopped.last_mut() {
            last[1] = monotonic_ns();
        }
        result
    }

    /// Whose waits for processors are no fault.
    pub fn serves(&self, pid: u32) {
        self.server.store(pid, Ordering::Relaxed);
    }

    fn is_over(&self) -> bool {
        self.over.load(Ordering::Relaxed)
    }

    /// Judges a wait for a step; `allowed` is what it may take [ns].
    fn wait(&self, from: u64, to: u64, allowed: u64, step: u64) {
        let wait = to.saturating_sub(from);
        let own = match wait > allowed {
            true => {
                // The sample behind it is on its way.
                std::thread::sleep(2 * SAMPLE);
                wait.saturating_sub(locked(&self.noise).within(from, to))
            }
            false => wait,
        };
        let frames = own.saturating_sub(allowed) as f64 / FRAME_NS as f64;
        let mut seen = locked(&self.seen);
        seen.steps += 1;
        seen.longest_wait = seen.longest_wait.max(frames);
        if frames > PATIENT_FRAMES {
            let words = format!(
                "step {step} came {frames:.1} frames late, {:.1} with the noise of the machine",
                wait as f64 / FRAME_NS as f64
            );
            seen.stalls.push(words);
        }
    }

    fn fail(&self, words: String) {
        locked(&self.seen).failures.push(words);
    }
}

/// A running watch.
pub struct Watch {
    pub shared: Arc<Shared>,
    threads: Vec<JoinHandle<()>>,
}

impl Watch {
    /// Begins to watch a session in some pace.
    pub fn begin(stage: &Stage, pace: Pace, server: u32) -> anyhow::Result<Self> {
        let shared = Arc::new(Shared {
            noise: Mutex::default(),
            seen: Mutex::default(),
            over: AtomicBool::new(false),
            server: AtomicU32::new(server),
            epoch: AtomicU64::new(0),
            step: AtomicU64::new(0),
        });
        let mut threads = Vec::new();
        let (sampler, stepper) = (shared.clone(), shared.clone());
        threads.push(std::thread::spawn(move || sample(&sampler)));
        let client = stage.client("watch")?;
        match pace {
            Pace::Realtime | Pace::Free => {
                let frames = client.frames(QUEUE)?;
                threads.push(std::thread::spawn(move || {
                    watch_frames(&stepper, frames, pace);
                }));
            }
            Pace::Lockstep => {
                let domain = stage.domain.clone();
                threads.push(std::thread::spawn(move || {
                    let connect =
                        || Client::connect(&domain, super::troupe::SESSION, "beat", PATIENCE);
                    take_part(&stepper, &connect);
                }));
            }
            Pace::Paused => {
                threads.push(std::thread::spawn(move || order_steps(&stepper, &client)));
            }
        }
        Ok(Self { shared, threads })
    }

    /// Ends the watch.
    pub fn end(self) -> Seen {
        self.shared.over.store(true, Ordering::Relaxed);
        for thread in self.threads {
            if thread.join().is_err() {
                self.shared.fail("a thread of the watch panicked".into());
            }
        }
        std::mem::take(&mut *locked(&self.shared.seen))
    }
}

/// Takes note of the noise.
fn sample(shared: &Shared) {
    let (mut overslept, mut delay, mut last) = (0, 0, (0, 0));
    let mut before = monotonic_ns();
    while !shared.is_over() {
        std::thread::sleep(SAMPLE);
        let now = monotonic_ns();
        overslept += (now - before).saturating_sub(SAMPLE.as_nanos() as u64);
        before = now;
        let pid = shared.server.load(Ordering::Relaxed);
        let (known, newest) = (last, processor_time(pid).map_or(0, |[_, waited]| waited));
        // Another server begins anew, and threads that end take their share with them.
        if known.0 == pid {
            delay += newest.saturating_sub(known.1);
        }
        last = (pid, newest);
        locked(&shared.noise).samples.push([now, delay, overslept]);
    }
}

/// Reads every frame: how long each took, and whether one is missing.
fn watch_frames(shared: &Shared, mut frames: FrameReader, pace: Pace) {
    let mut last: Option<wire::FrameHeader> = None;
    let mut looked = Instant::now();
    while !shared.is_over() {
        let frame = match frames.next(Duration::from_millis(50)) {
            Ok(frame) => frame,
            Err(error) => return shared.fail(format!("frames: {error}")),
        };
        let away = std::mem::replace(&mut looked, Instant::now()).elapsed();
        let Some(frame) = frame else { continue };
        let header = *frame.header();
        drop(frame);
        shared.epoch.store(header.epoch, Ordering::Relaxed);
        shared.step.store(header.step, Ordering::Relaxed);
        let before = last.replace(header).filter(|b| b.epoch == header.epoch);
        let Some(before) = before else { continue };
        if header.step == before.step || header.flags & FRAME_FLAG_LAST != 0 {
            continue;
        }
        shared.wait(before.publish_ns, header.publish_ns, FRAME_NS, header.step);
        // In free pace a reader need not keep up; the server's own count tells of frames without a slot.
        let kept_up = away < Duration::from_nanos(FRAME_NS * QUEUE as u64 / 2);
        if pace == Pace::Realtime && kept_up && header.step != before.step + 1 {
            let words = format!("step {} follows step {}", header.step, before.step);
            locked(&shared.seen).lost.push(words);
        }
    }
}

/// Takes part in lock-step, one step after the other.
fn take_part(
    shared: &Shared,
    connect: &dyn Fn() -> Result<Client, cosplat_ipc::client::ConnectError>,
) {
    while !shared.is_over() {
        let attached = connect().map_err(StepError::from);
        let attached = attached.and_then(|client| client.participate("beat", PATIENCE));
        let Ok(mut participant) = attached else {
            // A server that was killed while it was asked: the act waits for a step of the next.
            std::thread::sleep(SAMPLE);
            continue;
        };
        let mut last: Option<(u64, u64)> = None;
        while !shared.is_over() {
            let from = monotonic_ns();
            let Ok(stepped) = participant.step(1, &[]) else {
                break;
            };
            let to = monotonic_ns();
            if !stepped.is_complete() {
                break;
            }
            let step = stepped.done.step;
            if let Some((before, since)) = last.replace((step, to)) {
                shared.wait(from.max(since), to, FRAME_NS, step);
                if step != before + 1 {
                    let words = format!("step {step} follows step {before} in lock-step");
                    locked(&shared.seen).lost.push(words);
                }
            }
            shared.step.store(step, Ordering::Relaxed);
            std::thread::sleep(Duration::from_millis(2));
        }
        shared.epoch.fetch_add(1, Ordering::Relaxed);
    }
}

/// Orders single steps of a paused server.
fn order_steps(shared: &Shared, client: &Client) {
    let mut sender = match client.commands() {
        Ok(sender) => sender,
        Err(error) => return shared.fail(format!("commands: {error}")),
    };
    let step = wire::Command {
        kind: wire::COMMAND_STEP,
        object: 1,
        ..Default::default()
    };
    let mut last: Option<u64> = None;
    while !shared.is_over() {
        let from = monotonic_ns();
        match sender.send(&[step], PATIENCE) {
            Ok(acks) if acks.iter().all(wire::Ack::is_accepted) => {
                let done = acks.first().map_or(0, |ack| ack.applied_at_step);
                if last.replace(done).is_some_and(|last| done > last) {
                    shared.wait(from, monotonic_ns(), FRAME_NS, done);
                }
                shared.step.store(done, Ordering::Relaxed);
                shared.epoch.fetch_add(1, Ordering::Relaxed);
            }
            // The server was killed with the order in hand, or has many waiting.
            Ok(_) | Err(_) => last = None,
        }
        std::thread::sleep(Duration::from_millis(10));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn noise_is_what_was_stopped_and_the_larger_of_two_waits() {
        let noise = Noise {
            samples: vec![[0, 0, 0], [10, 1, 5], [20, 3, 5], [30, 9, 5], [40, 9, 6]],
            stopped: vec![[12, 15], [28, u64::MAX]],
        };
        assert_eq!(noise.within(0, 10), 5);
        assert_eq!(noise.within(10, 20), 3 + 2);
        assert_eq!(noise.within(20, 30), 2 + 6);
        assert_eq!(noise.within(35, 50), 15 + 1);
    }
}
