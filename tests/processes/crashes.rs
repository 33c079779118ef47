//! `kill -9` of every kind of client, and what the others notice of it: nothing.

use std::{
    sync::atomic::{AtomicBool, AtomicU64, Ordering},
    time::Duration,
};

use cosplat_ipc::{Domain, client::Client};

use crate::stage::{PATIENCE, Process, Stage, next_frame, wait_for_status, watchdog};

/// Started by [`Stage::holder`] this plays a client that takes a frame and never lets go; as a story of its own
/// it checks what such a client relies on.
#[test]
fn a_held_frame_never_changes() {
    if let Ok(domain) = std::env::var("COSPLAT_TEST_HOLD") {
        let domain = Domain::named(&domain).expect("the parent's domain is usable");
        let client = Client::connect(&domain, "default", "holder", PATIENCE).expect("a server");
        let mut frames = client.frames(4).expect("frames are readable");
        let held = next_frame(&mut frames);
        println!("holding step {}", held.header().step);
        std::thread::sleep(PATIENCE * 2);
        return;
    }
    let _watchdog = watchdog();
    let stage = Stage::new();
    let _server = stage.serve(&["--pace", "free", "--frame-slots", "12"]);
    let client = stage.client();
    let mut frames = client.frames(1).expect("frames are readable");
    let held = next_frame(&mut frames);
    let copy = (*held.header(), held.gaussians().to_vec());
    // Many times the pool: were the slot reused, it would hold a later step by now.
    wait_for_status(&client, |s| s.step > copy.0.step + 200);
    assert_eq!((*held.header(), held.gaussians().to_vec()), copy);
}

/// Tells a thread that watches to end, also when a story fails.
struct Ending<'a>(&'a AtomicBool);

impl Drop for Ending<'_> {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Relaxed);
    }
}

/// Reads every frame in a thread of its own beside `story`, and asserts that none is missing; `story` may wait for three
/// more. A queue holds what comes in 1.3 s: on a busy machine that is less than some clients take to start.
fn with_every_step_watched(stage: &Stage, story: impl FnOnce(&dyn Fn())) {
    let (over, newest) = (AtomicBool::new(false), AtomicU64::new(0));
    std::thread::scope(|scope| {
        let ending = Ending(&over);
        let watcher = scope.spawn(|| {
            let client = stage.client();
            let mut frames = client.frames(64).expect("frames are readable");
            let mut last = None;
            while !over.load(Ordering::Relaxed) {
                let frame = frames.next(Duration::from_millis(100));
                let Some(frame) = frame.expect("frames are well-formed") else {
                    continue;
                };
                let step = frame.header().step;
                if let Some(last) = last.replace(step) {
                    assert_eq!(step, last + 1, "steps are consecutive");
                }
                newest.store(step, Ordering::Relaxed);
            }
            assert_eq!(frames.missed(), 0);
        });
        story(&|| {
            let goal = newest.load(Ordering::Relaxed) + 3;
            while newest.load(Ordering::Relaxed) < goal && !watcher.is_finished() {
                std::thread::sleep(Duration::from_millis(5));
            }
        });
        drop(ending);
    });
    let status = wait_for_status(&stage.client(), |_| true);
    assert_eq!(status.frames_skipped, 0);
}

#[test]
fn clients_killed_with_a_frame_do_not_disturb_the_steps() {
    let _watchdog = watchdog();
    let stage = Stage::new();
    let _server = stage.serve(&[]);
    with_every_step_watched(&stage, |steps_go_on| {
        for _ in 0..10 {
            let mut holder = stage.holder();
            holder.wait_for_output("holding step");
            holder.kill();
            steps_go_on();
        }
    });
}

/// Kills a client ten times, each time a little later in its work, and watches the steps meanwhile.
fn kill_ten_times(start: impl Fn(&Stage, u32) -> Process) {
    let _watchdog = watchdog();
    let stage = Stage::new();
    let _server = stage.serve(&[]);
    with_every_step_watched(&stage, |steps_go_on| {
        for round in 0..10 {
            let mut victim = start(&stage, round);
            // Different moments of attaching and working; what they are does not matter.
            std::thread::sleep(Duration::from_millis(40 + 37 * u64::from(round)));
            victim.kill();
            steps_go_on();
        }
    });
}

#[test]
fn killed_renderer_does_not_stall_the_simulation() {
    kill_ten_times(|stage, _| {
        Process::start(stage.cosplat(&["view", "--png", "frames", "--size", "160x120"]))
    });
}

#[test]
fn killed_recorder_does_not_stall_the_simulation() {
    kill_ten_times(|stage, _| {
        Process::start(stage.cosplat(&["record", "-o", "run.mcap", "--force"]))
    });
}

#[test]
fn killed_controller_does_not_stall_the_simulation() {
    kill_ten_times(|stage, round| {
        let script: String = (0..200)
            .map(|i| {
                let time = f64::from(round * 1000 + i) * 0.01;
                format!("[[order]]\ntime = {time}\naction = 'push'\nobject = 'left'\nimpulse = [0, 1e-6, 0]\n")
            })
            .collect();
        std::fs::write(stage.path("push.toml"), script).expect("the stage's folder is writable");
        Process::start(stage.cosplat(&["ctl", "script", "push.toml"]))
    });
}
