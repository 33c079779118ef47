//! A running simulation is written to a file and goes on from it in another process.

use crate::stage::{PATIENCE, Stage, next_frame, wait_for_status, watchdog};

/// Hashes of the frames of a server that is resumed now, up to `last`, by step.
fn hashes(stage: &Stage, last: u64) -> Vec<(u64, u64)> {
    let client = stage.client();
    let mut frames = client.frames(64).expect("frames are readable");
    wait_for_status(&client, |s| s.frame_readers >= 1);
    assert!(stage.ctl(&["resume"]).status.success());
    let mut found = vec![];
    loop {
        let header = *next_frame(&mut frames).header();
        found.push((header.step, header.state_hash));
        if header.step >= last {
            return found;
        }
    }
}

#[test]
fn a_restored_server_goes_on_as_if_nothing_had_happened() {
    let _watchdog = watchdog();
    let stage = Stage::new();
    let mut server = stage.serve(&["--paused", "--lossless", "--duration", "0.6"]);
    // A checkpoint in the midst of the run, ordered before it begins.
    let ordered = stage.ctl(&[
        "checkpoint",
        "--at-step",
        "11",
        "--json",
        // It attaches within this time, and then waits as long for a file that comes only later.
        "--timeout",
        "2",
    ]);
    assert!(ordered.status.success(), "{ordered:?}");
    let answer: serde_json::Value = serde_json::from_slice(&ordered.stdout).expect("JSON");
    let file = answer["files"][0].as_str().expect("a path").to_owned();
    assert!(file.ends_with("default-step-10.checkpoint"), "{file}");
    let whole = hashes(&stage, 30);
    server.result();

    let mut server = stage.serve(&[
        "--paused",
        "--lossless",
        "--duration",
        "0.4",
        "--threads",
        "1",
        "--restore",
        &file,
    ]);
    let client = stage.client();
    let status = client.status().expect("status is readable").next(PATIENCE);
    assert_eq!(status.expect("readable").expect("sent").step, 10);
    let again = hashes(&stage, 30);
    server.result();
    assert!(again.len() >= 20, "{again:?}");
    for frame in &again {
        assert!(whole.contains(frame), "{frame:?} is not among {whole:?}");
    }
}

#[test]
fn checkpoints_of_another_scene_and_damaged_ones_are_refused_with_a_reason() {
    let _watchdog = watchdog();
    let stage = Stage::new();
    let mut server = stage.serve(&["--paused"]);
    let ordered = stage.ctl(&["checkpoint"]);
    assert!(ordered.status.success());
    let file = String::from_utf8(ordered.stdout)
        .expect("a path")
        .trim()
        .to_owned();
    assert!(stage.ctl(&["stop"]).status.success());
    server.result();

    let scene = stage.path("scene.toml");
    let text = std::fs::read_to_string(&scene).expect("the scene is there");
    std::fs::write(
        &scene,
        text.replace("[-0.3, 0.3, 0.0]", "[-0.3, 0.31, 0.0]"),
    )
    .expect("written");
    let refuse = || {
        let scene = scene.to_str().expect("a plain path");
        let output = stage
            .cosplat(&["serve", scene, "--restore", &file])
            .output();
        let output = output.expect("it runs");
        assert!(!output.status.success());
        String::from_utf8_lossy(&output.stderr).into_owned()
    };
    let other = refuse();
    assert!(other.contains("belongs to another scene"), "{other}");
    let mut bytes = std::fs::read(&file).expect("the checkpoint is there");
    let middle = bytes.len() / 2;
    bytes[middle] ^= 4;
    std::fs::write(&file, bytes).expect("written");
    let damaged = refuse();
    assert!(damaged.contains("damaged"), "{damaged}");
}
