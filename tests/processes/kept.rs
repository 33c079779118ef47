//! No command destroys what it reads, and what was there stays until something complete takes its place.

use std::{fs, path::PathBuf, process::Command, time::Duration};

use cosplat_ipc::schema::SERVER_PAUSED;
use serde_json::Value;

use crate::stage::{Process, SMALL_SCENE, Stage, wait_for_status, watchdog};

/// A stage with a scene and a recording of it.
fn recorded() -> Stage {
    let stage = Stage::new();
    let mut server = stage.serve(&["--paused", "--duration", "0.1", "--pace", "free"]);
    let client = stage.client();
    let mut recorder = Process::start(stage.cosplat(&["record", "-o", "run.mcap"]));
    wait_for_status(&client, |s| {
        s.frame_readers >= 1 && s.server_state == SERVER_PAUSED
    });
    assert!(stage.ctl(&["resume"]).status.success());
    server.result();
    assert!(recorder.wait().success());
    stage
}

/// Commands that write `OUT`, and what they read.
const COMMANDS: [(&str, &str); 8] = [
    ("run.mcap", "recover run.mcap -o OUT --force"),
    ("run.mcap", "compact run.mcap -o OUT --force"),
    ("run.mcap", "export run.mcap --glb OUT"),
    ("run.mcap", "export run.mcap --usd OUT"),
    ("run.mcap", "view run.mcap --size 64x48 --mp4 OUT"),
    (
        "scene.toml",
        "simulate scene.toml --duration 0.1 --report OUT",
    ),
    ("scene.toml", "explain scene.toml --ply OUT"),
    ("scene.toml", "explain scene.toml --picture OUT"),
];

#[test]
fn no_command_writes_onto_what_it_reads() {
    let _watchdog = watchdog();
    let stage = recorded();
    for (input, words) in COMMANDS {
        let input = stage.path(input);
        let (hard, soft) = (stage.path("hard.usda"), stage.path("soft.usda"));
        fs::hard_link(&input, &hard).expect("a link");
        std::os::unix::fs::symlink(&input, &soft).expect("a link");
        let before = fs::read(&input).expect("a file");
        for output in [&input, &hard, &soft] {
            let words = words.replace("OUT", output.to_str().expect("text"));
            let words: Vec<&str> = words.split(' ').collect();
            let ended = stage.cosplat(&words).output().expect("it runs");
            let said = String::from_utf8_lossy(&ended.stderr).into_owned();
            assert_eq!(ended.status.code(), Some(1), "{words:?}: {said}");
            assert!(said.contains("the same file"), "{words:?}: {said}");
            assert!(fs::read(&input).expect("a file") == before, "{words:?}");
        }
        fs::remove_file(&hard).expect("removed");
        fs::remove_file(&soft).expect("removed");
    }
}

#[test]
fn a_full_disk_leaves_the_file_that_was_there() {
    let _watchdog = watchdog();
    let stage = recorded();
    let others = fs::read_dir(stage.path(".")).expect("a folder").count();
    // USD is written by another program, and tested beside it.
    for (_, words) in COMMANDS
        .iter()
        .filter(|(_, words)| !words.contains("--usd"))
    {
        let old = stage.path("old");
        fs::write(&old, "precious").expect("written");
        let line = words.replace("OUT", "old");
        // No file may grow beyond a block, which to a program is a full disk.
        let ended = Command::new("sh")
            .args(["-c", &format!("ulimit -f 1 && exec \"$0\" {line}")])
            .arg(env!("CARGO_BIN_EXE_cosplat"))
            .current_dir(stage.path("."))
            .output()
            .expect("a shell");
        let said = String::from_utf8_lossy(&ended.stderr).into_owned();
        assert_eq!(ended.status.code(), Some(1), "{line}: {said}");
        assert_eq!(fs::read(&old).expect("a file"), b"precious", "{line}");
        fs::remove_file(&old).expect("removed");
        // Frames of a report are of use before it is complete.
        let left = fs::read_dir(stage.path(".")).expect("a folder");
        let left = left.map(|entry| entry.expect("an entry").path());
        let left = left.filter(|path| path.extension().is_some_and(|end| end == "unfinished"));
        let count = left
            .map(|path| fs::remove_file(path).expect("removed"))
            .count();
        assert_eq!(count, usize::from(line.contains("--report")), "{line}");
        assert_eq!(
            fs::read_dir(stage.path(".")).expect("a folder").count(),
            others
        );
    }
    // With room, all of them replace it.
    for (_, words) in COMMANDS
        .iter()
        .filter(|(_, words)| !words.contains("--usd"))
    {
        fs::write(stage.path("old"), "precious").expect("written");
        let line = words.replace("OUT", "old");
        let words: Vec<&str> = line.split(' ').collect();
        let ended = stage.cosplat(&words).output().expect("it runs");
        assert!(ended.status.success(), "{line}: {ended:?}");
        assert!(
            fs::read(stage.path("old")).expect("a file") != b"precious",
            "{line}"
        );
    }
}

#[test]
fn a_recorder_that_replaces_a_file_is_recovered_from_beside_it() {
    let _watchdog = watchdog();
    let stage = Stage::new();
    let _server = stage.serve_scene(SMALL_SCENE, &[]);
    fs::write(stage.path("run.mcap"), "precious").expect("written");
    let mut recorder = Process::start(stage.cosplat(&["record", "-o", "run.mcap", "--force"]));
    let is_part = |path: &PathBuf| path.extension().is_some_and(|end| end == "unfinished");
    let part = loop {
        let entries = fs::read_dir(stage.path(".")).expect("a folder");
        let mut paths = entries.map(|entry| entry.expect("an entry").path());
        match paths.find(is_part) {
            Some(part) => break part,
            None => std::thread::sleep(Duration::from_millis(5)),
        }
    };
    let part = part.to_str().expect("text");
    // How far it is shows in what can be saved of it; that is written beside an old one, too.
    let saved = || {
        let words = ["recover", part, "-o", "whole.mcap", "--force", "--json"];
        let ended = stage.cosplat(&words).output().expect("it runs");
        let report: Value = serde_json::from_slice(&ended.stdout).unwrap_or_default();
        report["frames"].as_u64().unwrap_or_default()
    };
    while saved() == 0 {
        std::thread::sleep(Duration::from_millis(50));
    }
    recorder.kill();
    assert_eq!(
        fs::read(stage.path("run.mcap")).expect("a file"),
        b"precious"
    );
    assert!(saved() > 0);
}
