//! What is recorded is what was published, and a killed recorder leaves a file that can be repaired.

use std::{path::Path, time::Duration};

use cosplat_ipc::schema::{FRAME_FLAG_LAST, FrameHeader, GaussianState};
use cosplat_recorder::reader::{Event, Recording};

use crate::stage::{Process, Stage, next_frame, wait_for_status, watchdog};

/// Frames and journal entries of a recording, every checksum verified.
fn read(path: &Path) -> (Vec<(FrameHeader, Vec<GaussianState>)>, usize) {
    let mut frames = Vec::new();
    let mut commands = 0;
    for event in Recording::open(path).expect("a recording") {
        match event.expect("every checksum holds") {
            Event::Frame(frame) => frames.push((frame.header, frame.gaussians)),
            Event::Journal(_) => commands += 1,
            _ => {}
        }
    }
    (frames, commands)
}

#[test]
fn a_recording_holds_every_published_frame_bit_for_bit() {
    let _watchdog = watchdog();
    let stage = Stage::new();
    let mut server = stage.serve(&["--paused", "--pace", "realtime", "--duration", "1"]);
    let client = stage.client();
    let mut observer = client.frames(64).expect("frames are readable");
    let mut recorder = Process::start(stage.cosplat(&["record", "-o", "run.mcap", "--json"]));
    wait_for_status(&client, |s| s.frame_readers >= 2);
    let push = stage.ctl(&["--at-step", "5", "push", "left", "2", "0", "0"]);
    assert!(push.status.success());
    assert!(stage.ctl(&["resume"]).status.success());

    let mut published = Vec::new();
    loop {
        let frame = next_frame(&mut observer);
        published.push((*frame.header(), frame.gaussians().to_vec()));
        if frame.header().flags & FRAME_FLAG_LAST != 0 {
            break;
        }
    }
    server.result();
    let summary = recorder.result();
    assert_eq!(summary["frames_recorded"], 51, "{summary}");

    let (recorded, commands) = read(&stage.path("run.mcap"));
    assert_eq!(commands, 1);
    let steps: Vec<_> = recorded.iter().map(|(header, _)| header.step).collect();
    assert_eq!(steps, (0..=50).collect::<Vec<_>>(), "every step once");
    assert_eq!(recorded, published);
}

#[test]
fn a_killed_recorder_loses_at_most_the_open_chunk() {
    let _watchdog = watchdog();
    let stage = Stage::new();
    let _server = stage.serve(&["--paused"]);
    let client = stage.client();
    assert!(stage.ctl(&["resume"]).status.success());
    for round in 0..5_u64 {
        let name = format!("run{round}.mcap");
        let mut recorder = Process::start(stage.cosplat(&["record", "-o", &name]));
        wait_for_status(&client, |s| s.frame_readers >= 1);
        let attached = wait_for_status(&client, |_| true).step;
        std::thread::sleep(Duration::from_millis(600 + 83 * round));
        recorder.kill();
        let killed = wait_for_status(&client, |_| true).step;

        let repaired = format!("repaired{round}.mcap");
        let output = stage
            .cosplat(&["recover", &name, "-o", &repaired, "--json"])
            .output()
            .expect("cosplat can be run");
        let words = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(output.status.success(), "{words}");
        let (frames, _) = read(&stage.path(&repaired));
        let steps: Vec<_> = frames.iter().map(|(header, _)| header.step).collect();
        assert!(steps.windows(2).all(|w| w[1] == w[0] + 1), "{steps:?}");
        // A chunk is closed at the first frame that makes it 4 MiB: of this small scene it holds fewer frames
        // than that size has room for.
        let frame_bytes = frames.first().map_or(1, |(_, g)| size_of_val(g.as_slice()));
        let chunk_frames = ((4 << 20) / frame_bytes) as u64 + 2;
        let last = steps.last().copied().unwrap_or(attached);
        assert!(
            last + chunk_frames >= killed,
            "recorded up to {last}, killed at {killed}, {chunk_frames} frames per chunk"
        );
    }
}
