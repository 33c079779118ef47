//! `kill -9` of every kind of client, and what the others notice of it: nothing.

use std::time::Duration;

use cosplat_ipc::{
    Domain,
    client::{Client, Frame, FrameReader},
};

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

/// Reads all frames that wait and three more, and asserts that none is missing; `last` is the step read last.
fn assert_consecutive(frames: &mut FrameReader, last: &mut Option<u64>) {
    let mut follows = |frame: &Frame| {
        let step = frame.header().step;
        if let Some(last) = last.replace(step) {
            assert_eq!(step, last + 1, "steps are consecutive");
        }
    };
    while let Some(frame) = frames.next(Duration::ZERO).expect("frames are well-formed") {
        follows(&frame);
    }
    for _ in 0..3 {
        follows(&next_frame(frames));
    }
    assert_eq!(frames.missed(), 0);
}

#[test]
fn clients_killed_while_holding_a_frame_do_not_disturb_the_steps() {
    let _watchdog = watchdog();
    let stage = Stage::new();
    let _server = stage.serve(&[]);
    let client = stage.client();
    let mut frames = client.frames(64).expect("frames are readable");
    let mut last = None;
    for _ in 0..10 {
        let mut holder = stage.holder();
        holder.wait_for_output("holding step");
        holder.kill();
        assert_consecutive(&mut frames, &mut last);
    }
    let status = wait_for_status(&client, |_| true);
    assert_eq!(status.frames_skipped, 0);
}

/// Kills a client ten times, each time a little later in its work, and watches the steps meanwhile.
fn kill_ten_times(start: impl Fn(&Stage, u32) -> Process) {
    let _watchdog = watchdog();
    let stage = Stage::new();
    let _server = stage.serve(&[]);
    let client = stage.client();
    let mut frames = client.frames(64).expect("frames are readable");
    let mut last = None;
    for round in 0..10 {
        let mut victim = start(&stage, round);
        // Different moments of attaching and working; what they are does not matter.
        std::thread::sleep(Duration::from_millis(40 + 37 * u64::from(round)));
        victim.kill();
        assert_consecutive(&mut frames, &mut last);
    }
    assert_eq!(wait_for_status(&client, |_| true).frames_skipped, 0);
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
