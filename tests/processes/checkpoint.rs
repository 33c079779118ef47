//! A running simulation is written to a file and goes on from it in another process.

use crate::stage::{PATIENCE, Process, Stage, next_frame, wait_for_status, watchdog};

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

/// Orders a checkpoint of a paused server and waits until the order is taken; the answer may take longer.
fn order_checkpoint(stage: &Stage, arguments: &[&str]) -> Process {
    let client = stage.client();
    let before = wait_for_status(&client, |_| true).commands_accepted;
    let words = [&["ctl", "checkpoint", "--json"], arguments].concat();
    let ordered = Process::start(stage.cosplat(&words));
    wait_for_status(&client, |s| s.commands_accepted > before);
    ordered
}

#[test]
fn a_restored_server_goes_on_as_if_nothing_had_happened() {
    let _watchdog = watchdog();
    let stage = Stage::new();
    let mut server = stage.serve(&["--paused", "--lossless", "--duration", "0.6"]);
    // A checkpoint in the midst of the run, ordered before it begins.
    let mut ordered = order_checkpoint(&stage, &["--at-step", "11", "--timeout", "60"]);
    let whole = hashes(&stage, 30);
    server.result();
    let answer = ordered.result();
    let file = answer["files"][0].as_str().expect("a path").to_owned();
    assert!(file.ends_with("default-step-10.checkpoint"), "{file}");

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

/// With a reason; foreign ones are those of another scene.
#[test]
fn foreign_and_damaged_checkpoints_are_refused() {
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

#[test]
fn a_checkpoint_that_never_comes_is_no_success() {
    let _watchdog = watchdog();
    let stage = Stage::new();
    let folder = stage.path("states");
    std::fs::create_dir(&folder).expect("a folder");
    let folder = folder.to_str().expect("a plain path");
    let mut server = stage.serve(&["--paused", "--checkpoints", folder]);
    let refused = |order: &[&str]| {
        let output = stage.ctl(order);
        let words = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(!output.status.success(), "{order:?}: {words}");
        words
    };
    // Nobody resumes the server while this one waits.
    let words = refused(&["--at-step", "50", "--timeout", "3", "checkpoint"]);
    assert!(words.contains("no checkpoint was written"), "{words}");
    // The folder goes while the server runs.
    std::fs::remove_dir(folder).expect("an empty folder");
    let words = refused(&["checkpoint"]);
    let file = format!("cannot write {folder}/default-step-0.checkpoint");
    assert!(words.contains(&file), "{words}");
    // The server ends before the step comes.
    let mut ordered = order_checkpoint(&stage, &["--at-step", "70", "--timeout", "60"]);
    assert!(stage.ctl(&["stop"]).status.success());
    assert!(!ordered.wait().success());
    let words = ordered.words();
    assert!(words.contains("ended before step 70"), "{words}");
    server.result();
}
