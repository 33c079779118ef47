//! A recording is played to viewers as if it were live, and goes on live from any of its steps.

use std::collections::BTreeMap;

use cosplat_ipc::{
    client::FrameReader,
    schema::{
        FRAME_FLAG_LAST, FRAME_FLAG_PAUSED, FrameHeader, GaussianState, ObjectState, SERVER_PAUSED,
    },
};
use cosplat_recorder::reader::{Event, Recording};

use crate::stage::{PATIENCE, Process, Stage, next_frame, wait_for_status, watchdog};

/// A frame with its Gaussians.
type Held = (FrameHeader, Vec<GaussianState>);

/// Records thirty steps of the small scene with a push before step 10, as `run.mcap`.
fn record(stage: &Stage) {
    let mut server = stage.serve(&[
        "--paused",
        "--pace",
        "free",
        "--lossless",
        "--duration",
        "0.6",
    ]);
    let mut recorder = Process::start(stage.cosplat(&["record", "-o", "run.mcap", "--json"]));
    wait_for_status(&stage.client(), |s| s.frame_readers >= 1);
    let push = stage.ctl(&["--at-step", "10", "push", "left", "2", "0", "0"]);
    assert!(push.status.success());
    assert!(stage.ctl(&["resume"]).status.success());
    server.result();
    recorder.result();
}

/// Frames and objects of the recording, by step.
fn recorded(stage: &Stage) -> (BTreeMap<u64, Held>, BTreeMap<u64, Vec<ObjectState>>) {
    let (mut frames, mut objects) = (BTreeMap::new(), BTreeMap::new());
    for event in Recording::open(&stage.path("run.mcap")).expect("a recording") {
        match event.expect("every checksum holds") {
            Event::Frame(frame) => {
                frames.insert(frame.header.step, (frame.header, frame.gaussians));
            }
            Event::Objects(header, states) => {
                objects.insert(header.step, states);
            }
            _ => {}
        }
    }
    (frames, objects)
}

/// Starts a replay and waits until clients can attach.
fn replay(stage: &Stage, arguments: &[&str]) -> Process {
    let all = [&["replay", "run.mcap", "--json"], arguments].concat();
    let mut process = Process::start(stage.cosplat(&all));
    stage.wait_for_server(&mut process);
    process
}

/// The next frame, copied.
fn held(reader: &mut FrameReader) -> Held {
    let frame = next_frame(reader);
    (*frame.header(), frame.gaussians().to_vec())
}

/// Fails unless `seen` is the recorded frame of its step but for what every server sets itself.
fn assert_recorded(frames: &BTreeMap<u64, Held>, seen: &Held) {
    let (header, gaussians) = &frames[&seen.0.step];
    let expected = FrameHeader {
        epoch: seen.0.epoch,
        publish_ns: seen.0.publish_ns,
        flags: seen.0.flags,
        ..*header
    };
    assert_eq!(seen.0, expected);
    assert!(
        gaussians == &seen.1,
        "Gaussians of step {} differ",
        seen.0.step
    );
}

#[test]
fn a_viewer_sees_a_replay_bit_for_bit_as_it_was_live() {
    let _watchdog = watchdog();
    let stage = Stage::new();
    record(&stage);
    let (frames, recorded_objects) = recorded(&stage);
    let mut process = replay(&stage, &["--paused", "--rate", "50", "--lossless"]);
    let client = stage.client();
    let scene = client.scene(PATIENCE).expect("a scene");
    assert_eq!(scene.objects().len(), 2);
    assert!(scene.source().contains("two blocks"));
    let mut reader = client.frames(64).expect("frames are readable");
    let mut objects = client.objects(64).expect("objects are readable");
    let mut journal = client.journal().expect("the journal is readable");
    wait_for_status(&client, |s| {
        s.frame_readers >= 1 && s.server_state == SERVER_PAUSED
    });
    assert!(stage.ctl(&["resume"]).status.success());
    let mut steps = vec![];
    loop {
        let seen = held(&mut reader);
        assert_recorded(&frames, &seen);
        steps.push(seen.0.step);
        if seen.0.flags & FRAME_FLAG_LAST != 0 {
            break;
        }
    }
    assert_eq!(steps, (0..=30).collect::<Vec<_>>());
    let pushed = journal
        .next(PATIENCE)
        .expect("readable")
        .expect("a command");
    assert_eq!((pushed.header().step, pushed.items()[0].step), (10, 10));
    let mut count = 0;
    while let Some(message) = objects.next(std::time::Duration::ZERO).expect("readable") {
        assert_eq!(recorded_objects[&message.header().step], message.items());
        count += 1;
    }
    assert!(count >= 30, "{count} messages with objects");
    let summary = process.result();
    assert_eq!(summary["frames_published"], 31, "{summary}");
}

#[test]
fn a_replay_pauses_goes_to_any_step_and_begins_anew() {
    let _watchdog = watchdog();
    let stage = Stage::new();
    record(&stage);
    let (frames, _) = recorded(&stage);
    let mut process = replay(&stage, &["--paused", "--rate", "20", "--loop"]);
    let client = stage.client();
    let mut reader = client.frames(64).expect("frames are readable");
    assert_eq!(held(&mut reader).0.step, 0, "what a paused replay shows");
    for step in [20, 5, 30] {
        assert!(stage.ctl(&["seek", &step.to_string()]).status.success());
        let seen = held(&mut reader);
        assert_eq!((seen.0.step, seen.0.flags), (step, FRAME_FLAG_PAUSED));
        assert_recorded(&frames, &seen);
    }
    let refused = |arguments: &[&str], expected: &str| {
        let output = stage.ctl(arguments);
        let words = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(!output.status.success(), "{arguments:?}: {words}");
        assert!(words.contains(expected), "{expected:?} not in {words}");
    };
    refused(
        &["seek", "31"],
        "step 31 is not in the recording, which holds steps 0 to 30",
    );
    refused(&["push", "left", "1", "0", "0"], "replays a recording");
    refused(&["reset"], "pause, resume, stop, seek and cancel");

    // From the last step it goes on with the first.
    assert!(stage.ctl(&["resume"]).status.success());
    let mut steps = vec![];
    while steps.len() < 40 {
        let seen = held(&mut reader);
        assert_recorded(&frames, &seen);
        assert_eq!(seen.0.flags & FRAME_FLAG_LAST, 0);
        steps.push(seen.0.step);
    }
    assert_eq!(steps[0], 0, "{steps:?}");
    let follows = |w: &[u64]| w[1] == w[0] + 1 || (w[0], w[1]) == (30, 0);
    assert!(steps.windows(2).all(follows), "{steps:?}");
    assert!(stage.ctl(&["stop"]).status.success());
    process.result();
}

#[test]
fn a_server_that_simulates_goes_to_no_step() {
    let _watchdog = watchdog();
    let stage = Stage::new();
    let _server = stage.serve(&["--paused"]);
    let output = stage.ctl(&["seek", "3"]);
    let words = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(!output.status.success());
    assert!(words.contains("only a replay can"), "{words}");
}

#[test]
fn a_branch_is_what_the_run_would_have_been() {
    let _watchdog = watchdog();
    let stage = Stage::new();
    record(&stage);
    let (frames, _) = recorded(&stage);
    let arguments = [
        "branch",
        "run.mcap",
        "--at",
        "12",
        "--threads",
        "1",
        "--paused",
        "--lossless",
        "--pace",
        "free",
        "--duration",
        "0.36",
        "--json",
    ];
    let mut server = Process::start(stage.cosplat(&arguments));
    stage.wait_for_server(&mut server);
    let client = stage.client();
    let mut reader = client.frames(64).expect("frames are readable");
    let mut recorder = Process::start(stage.cosplat(&["record", "-o", "branch.mcap", "--json"]));
    wait_for_status(&client, |s| s.frame_readers >= 2);
    assert!(stage.ctl(&["resume"]).status.success());
    let mut steps = vec![];
    loop {
        let mut seen = held(&mut reader);
        if steps.is_empty() {
            // A server that begins with a state knows nothing of the substeps that led to it.
            assert_eq!((seen.0.dt, seen.0.substeps), (0.0, 0));
            let header = frames[&12].0;
            (seen.0.dt, seen.0.substeps) = (header.dt, header.substeps);
        }
        assert_recorded(&frames, &seen);
        steps.push(seen.0.step);
        if seen.0.flags & FRAME_FLAG_LAST != 0 {
            break;
        }
    }
    assert_eq!(steps, (12..=30).collect::<Vec<_>>());
    server.result();
    recorder.result();

    // The branch's own recording has what it began with.
    let output = stage
        .cosplat(&["verify", "branch.mcap"])
        .output()
        .expect("it runs");
    let words = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(output.status.success(), "{words}");
    assert!(words.contains("19 steps from 12 to 30 agree"), "{words}");

    let output = stage
        .cosplat(&["branch", "run.mcap", "--at", "31"])
        .output()
        .expect("it runs");
    let words = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(!output.status.success());
    assert!(words.contains("step 31 is not in the run"), "{words}");
    assert!(words.contains("steps 0 to 30"), "{words}");
}
