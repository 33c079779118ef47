//! What is recorded is what was published, and a killed recorder leaves a file that can be repaired.

use std::{path::Path, time::Duration};

use cosplat_ipc::schema::{FRAME_FLAG_LAST, FrameHeader, GaussianState, SERVER_PAUSED};
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
    for ((header, gaussians), (then, live)) in recorded.iter().zip(&published) {
        let sent = FrameHeader {
            // The recorder reads what changed, which is sent just before the frame.
            publish_ns: header.publish_ns,
            ..*then
        };
        assert_eq!(*header, sent);
        let bits = |g: &[GaussianState]| bytemuck::cast_slice::<_, u64>(g).to_vec();
        assert!(bits(gaussians) == bits(live), "step {}", header.step);
    }
}

/// Steps of what `cosplat recover` saves of a recording, which must be without a gap, and the frames of a chunk.
fn recovered(stage: &Stage, name: &str) -> (Vec<u64>, u64) {
    let output = stage
        .cosplat(&["recover", name, "-o", "repaired.mcap", "--force", "--json"])
        .output()
        .expect("cosplat can be run");
    let words = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.success(), "{words}");
    let (frames, _) = read(&stage.path("repaired.mcap"));
    let steps: Vec<_> = frames.iter().map(|(header, _)| header.step).collect();
    assert!(steps.windows(2).all(|w| w[1] == w[0] + 1), "{steps:?}");
    // A chunk is closed at the first frame that makes it 4 MiB: of this small scene it holds fewer frames than
    // that size has room for.
    let frame_bytes = frames.first().map_or(1, |(_, g)| size_of_val(g.as_slice()));
    (steps, ((4 << 20) / frame_bytes) as u64 + 2)
}

#[test]
fn a_killed_recorder_loses_at_most_the_open_chunk() {
    let _watchdog = watchdog();
    let stage = Stage::new();
    let _server = stage.serve(&["--paused"]);
    let client = stage.client();
    for round in 0..5_u64 {
        let name = format!("run{round}.mcap");
        let mut recorder = Process::start(stage.cosplat(&["record", "-o", &name]));
        assert!(stage.ctl(&["resume"]).status.success());
        let written = || std::fs::metadata(stage.path(&name)).map_or(0, |m| m.len());
        while written() < (4 << 20) {
            std::thread::sleep(Duration::from_millis(20));
        }
        assert!(stage.ctl(&["pause"]).status.success());
        let published = wait_for_status(&client, |s| s.server_state == SERVER_PAUSED).step;
        // A file is at every instant what a kill at that instant would leave. Frames may still wait in the
        // recorder's queue, longer on a busy machine; once it has caught up, only the open chunk may be missing.
        let caught_up = loop {
            std::fs::copy(stage.path(&name), stage.path("instant.mcap")).expect("a copy");
            let (steps, chunk_frames) = recovered(&stage, "instant.mcap");
            match steps.last() {
                Some(&last) if last + chunk_frames >= published => break last,
                _ => std::thread::sleep(Duration::from_millis(50)),
            }
        };

        assert!(stage.ctl(&["resume"]).status.success());
        std::thread::sleep(Duration::from_millis(83 * round));
        recorder.kill();
        let (steps, _) = recovered(&stage, &name);
        assert!(steps.last() >= Some(&caught_up), "{steps:?}, {caught_up}");
    }
}
