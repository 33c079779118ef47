//! What commands say, that it makes sense, and that they live on when nobody listens.

use std::process::{Command, Stdio};

use rustix::process::{Pid, Resource, Rlimit, prlimit};

use crate::{
    stage::{Process, SMALL_SCENE, Stage, has_bytes, wait_for_status, watchdog},
    verify::{record, verify},
};

/// An output that nobody reads.
fn closed() -> Stdio {
    let (reader, writer) = std::io::pipe().expect("a pipe");
    drop(reader);
    writer.into()
}

/// Starts a command of which nobody reads a word.
fn unheard(stage: &Stage, arguments: &[&str]) -> Process {
    Process::start_with(stage.cosplat(arguments), closed(), closed())
}

#[test]
fn a_running_session_says_what_takes_its_time() {
    let _watchdog = watchdog();
    let stage = Stage::new();
    let _server = stage.serve(&["--pace", "realtime"]);
    wait_for_status(&stage.client(), |s| s.step >= 3);
    let output = stage.ctl(&["status"]);
    let said = String::from_utf8_lossy(&output.stdout);
    assert!(
        said.contains("a step takes ") && said.contains("solids "),
        "{said}"
    );
    for name in ["left", "right"] {
        assert!(
            said.contains(&format!(" % of the time of objects: `{name}`, ")),
            "{said}"
        );
    }
    let output = stage.ctl(&["status", "--json"]);
    let said: serde_json::Value = serde_json::from_slice(&output.stdout).expect("JSON");
    assert!(
        said["step_seconds"].as_f64().is_some_and(|s| s > 0.0),
        "{said}"
    );
    assert!(
        said["phases"]["solids"].as_f64().is_some_and(|s| s > 0.0),
        "{said}"
    );
    let costs = said["costs"].as_array().expect("costs");
    assert_eq!(costs.len(), 2, "{said}");
    for cost in costs {
        assert!(
            cost["substeps"].as_f64().is_some_and(|n| n >= 1.0),
            "{cost}"
        );
        assert!(cost["dt_min"].as_f64().is_some_and(|dt| dt > 0.0), "{cost}");
    }
}

#[test]
fn shells_and_manual_pages_know_every_command() {
    let _watchdog = watchdog();
    let stage = Stage::new();
    let run = |arguments: &[&str]| {
        let output = stage.cosplat(arguments).output().expect("cosplat runs");
        let words = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "{arguments:?}: {words}");
        String::from_utf8(output.stdout).expect("text")
    };
    for shell in ["bash", "elvish", "fish", "powershell", "zsh"] {
        let script = run(&["completions", shell]);
        for word in ["simulate", "participants", "lockstep"] {
            assert!(script.contains(word), "{shell}: {word}");
        }
    }
    let pages = stage.path("man/man1");
    assert_eq!(run(&["manual", pages.to_str().expect("a plain path")]), "");
    let page = std::fs::read_to_string(pages.join("cosplat-serve.1")).expect("a page");
    assert!(
        page.contains("\\-\\-pace") && page.contains("participants"),
        "{page}"
    );
    assert!(pages.join("cosplat-ctl-status.1").exists());
    // A file is no folder.
    let file = stage.path("a file");
    std::fs::write(&file, "").expect("written");
    let refused = stage
        .cosplat(&["manual", file.to_str().expect("a plain path")])
        .output();
    let refused = refused.expect("cosplat runs");
    assert_eq!(refused.status.code(), Some(1));
    assert!(String::from_utf8_lossy(&refused.stderr).contains("a file"));
}

#[test]
fn values_given_to_a_server_are_in_the_recording() {
    let _watchdog = watchdog();
    let stage = Stage::new();
    let given = ["--set", "objects.0.name=west", "--set", "gravity=[0, 0, 0]"];
    record(&stage, SMALL_SCENE, 5, &given);
    let recording = stage.path("run.mcap");
    let (is_same, outcome) = verify(&stage, &recording, "1");
    assert!(is_same, "{outcome}");
    let inspect = ["inspect", recording.to_str().expect("a plain path")];
    let output = stage.cosplat(&inspect).output().expect("cosplat runs");
    let said = String::from_utf8_lossy(&output.stdout);
    assert!(said.contains("west") && !said.contains("left"), "{said}");
    let wrong = ["serve", "scene.toml", "--set", "objects.9.name=east"];
    let output = stage.cosplat(&wrong).output().expect("cosplat runs");
    assert_eq!(output.status.code(), Some(2));
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(said.contains("objects.9.name"), "{said}");
}

#[test]
fn commands_live_on_when_nobody_reads_what_they_print() {
    let _watchdog = watchdog();
    let stage = Stage::new();
    std::fs::write(stage.path("scene.toml"), SMALL_SCENE).expect("writable");
    std::fs::create_dir(stage.path("kept")).expect("writable");
    let mut server = unheard(
        &stage,
        &[
            "serve",
            "scene.toml",
            "--paused",
            "--duration=0.1",
            "--checkpoints=kept",
            "--json",
        ],
    );
    let client = stage.client();
    let mut recorder = unheard(&stage, &["record", "-o", "run.mcap"]);
    let mut viewer = unheard(&stage, &["view", "--png", "pictures", "--size", "64x48"]);
    wait_for_status(&client, |s| s.frame_readers >= 2);
    // A checkpoint that has no place is something to warn of.
    std::fs::remove_dir(stage.path("kept")).expect("empty");
    unheard(&stage, &["ctl", "checkpoint", "--timeout", "1"]).wait();
    for words in [
        &["ctl", "list"][..],
        &["ctl", "list", "--json"],
        &["ctl", "status"],
        &["ctl", "status", "--json"],
        &["explain", "scene.toml"],
        &["explain", "scene.toml", "--json"],
        &["simulate", "scene.toml", "--duration", "0.02"],
        &["ctl", "resume"],
    ] {
        let status = unheard(&stage, words).wait();
        assert_eq!(status.code(), Some(0), "{words:?}");
    }
    for process in [&mut server, &mut recorder, &mut viewer] {
        assert_eq!(process.wait().code(), Some(0));
    }
    let status = unheard(&stage, &["recover", "run.mcap"]).wait();
    assert_eq!(status.code(), Some(0));
    assert!(has_bytes(&stage.path("run.recovered.mcap")));
    // How the work went is still told.
    let status = unheard(&stage, &["ctl", "pause", "--timeout", "0"]).wait();
    assert_eq!(status.code(), Some(1), "no server any more");
}

#[test]
fn times_that_no_clock_tells_are_refused_in_a_sentence() {
    let stage = Stage::new();
    std::fs::write(stage.path("scene.toml"), SMALL_SCENE).expect("writable");
    for words in [
        &["view", "--png", "pictures", "--timeout"][..],
        &["record", "-o", "run.mcap", "--wait"],
        &["record", "-o", "run.mcap", "--duration"],
        &["ctl", "status", "--timeout"],
        &["serve", "scene.toml", "--duration"],
        &["simulate", "scene.toml", "--duration"],
        &["demo", "--duration"],
    ] {
        for time in ["1e19", "NaN", "inf", "-1", "soon"] {
            let mut words = words.to_vec();
            let last = format!("{}={time}", words.pop().expect("an option"));
            words.push(&last);
            let output = stage.cosplat(&words).output().expect("it runs");
            let said = String::from_utf8_lossy(&output.stderr).into_owned();
            assert_eq!(output.status.code(), Some(2), "{words:?}: {said}");
            assert!(said.contains("number of seconds"), "{words:?}: {said}");
        }
    }
}

/// What stands more than once in a sentence of causes.
fn repeated(sentence: &str) -> Option<&str> {
    let parts: Vec<&str> = sentence.split(": ").map(str::trim).collect();
    let is_again = |(i, part): (usize, &&str)| part.len() > 8 && parts[..i].contains(part);
    let found = parts
        .iter()
        .enumerate()
        .find(|&(i, part)| is_again((i, part)));
    found.map(|(_, part)| *part)
}

#[test]
fn an_error_names_its_cause_once() {
    let _watchdog = watchdog();
    let said = "error: cannot read a.toml: no such file: no such file";
    assert_eq!(repeated(said), Some("no such file"));
    let stage = Stage::new();
    let _server = stage.serve(&["--paused"]);
    let file = |name: &str, text: &str| std::fs::write(stage.path(name), text).expect("writable");
    file("text", "no recording, no script, no checkpoint");
    let asset = "[[objects]]\nname = \"vase\"\nasset = \"vase\"\nmaterial = \"jelly\"\n";
    let head = "version = 1\nname = \"a\"\n[[assets]]\nname = \"vase\"\npath = \"nowhere.ply\"\n";
    file("assets.toml", &format!("{head}{asset}"));
    for (words, cause) in [
        (&["explain", "nowhere.toml"][..], "No such file"),
        (&["explain", "assets.toml"], "No such file"),
        (
            &["simulate", "nowhere.toml", "--duration", "1"],
            "No such file",
        ),
        (&["serve", "nowhere.toml"], "No such file"),
        (
            &["serve", "scene.toml", "--restore", "nowhere"],
            "No such file",
        ),
        (&["serve", "scene.toml", "--restore", "text"], "checkpoint"),
        (&["recover", "nowhere.mcap"], "No such file"),
        (&["recover", "text"], "not an MCAP file"),
        (&["record", "-o", "nowhere/run.mcap"], "No such file"),
        (&["view", "--png", "text/pictures"], "Not a directory"),
        (&["view", "--mp4", "text/run.mp4"], "File exists"),
        (&["ctl", "script", "nowhere.toml"], "No such file"),
        (&["ctl", "script", "text"], "expected"),
        (&["ctl", "push", "nobody", "0", "0", "1"], "nobody"),
        (&["import", "nowhere.json", "nowhere"], "No such file"),
        (&["demo", "--splat", "nowhere.ply"], "nowhere.ply"),
    ] {
        let output = stage.cosplat(words).output().expect("it runs");
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(!output.status.success(), "{words:?}");
        assert!(said.contains(cause), "{words:?}: {said}");
        let error = said.split("error: ").last().unwrap_or_default();
        assert_eq!(repeated(error), None, "{words:?}: {said}");
    }
}

#[test]
fn a_limit_of_file_sizes_ends_a_recording_in_a_sentence() {
    let _watchdog = watchdog();
    let stage = Stage::new();
    let _server = stage.serve(&["--paused", "--pace", "free"]);
    let client = stage.client();
    let mut recorder = Process::start(stage.cosplat(&["record", "-o", "run.mcap"]));
    wait_for_status(&client, |s| s.frame_readers >= 1);
    while !stage.path("run.mcap").exists() {
        std::thread::sleep(std::time::Duration::from_millis(5));
    }
    let pid = Pid::from_raw(recorder.id() as i32);
    let limit = Rlimit {
        current: Some(1 << 16),
        maximum: Some(1 << 16),
    };
    prlimit(pid, Resource::Fsize, limit).expect("a child's limits can be set");
    assert!(stage.ctl(&["resume"]).status.success());
    let status = recorder.wait();
    let said = recorder.words();
    assert_eq!(status.code(), Some(1), "{status}: {said}");
    assert!(said.contains("File too large"), "{said}");
    assert!(said.contains("cosplat recover"), "{said}");
}

#[test]
fn a_full_disk_is_said_with_the_name_of_the_file() {
    let stage = Stage::new();
    let scene = stage.path("scene.toml");
    std::fs::write(&scene, SMALL_SCENE).expect("the stage's folder is writable");
    let words = ["simulate", "scene.toml", "--duration", "0.1"];
    let output = stage
        .cosplat(&[&words[..], &["--report", "/dev/full"]].concat())
        .current_dir(stage.path("."))
        .output()
        .expect("cosplat can be run");
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(1), "{said}");
    assert!(
        said.contains("cannot write /dev/full: No space left"),
        "{said}"
    );
}

#[test]
fn a_limit_of_file_sizes_that_stops_a_session_is_named() {
    let stage = Stage::new();
    let scene = stage.path("scene.toml");
    std::fs::write(&scene, SMALL_SCENE).expect("the stage's folder is writable");
    for limit in [2, 100] {
        let output = Command::new("sh")
            .arg("-c")
            .arg(format!(
                "ulimit -f {limit} && exec \"$0\" serve scene.toml --duration 0.1"
            ))
            .arg(env!("CARGO_BIN_EXE_cosplat"))
            .envs(
                stage
                    .cosplat(&[])
                    .get_envs()
                    .filter_map(|(k, v)| Some((k, v?))),
            )
            .current_dir(stage.path("."))
            .output()
            .expect("a shell");
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(1), "{limit}: {said}");
        assert!(said.contains("`ulimit -f unlimited`"), "{limit}: {said}");
    }
}

#[test]
fn what_a_file_says_cannot_command_the_terminal() {
    let _watchdog = watchdog();
    let stage = Stage::new();
    let name = "\\u001b]0;owned\\u0007ball";
    let scene = SMALL_SCENE.replacen("left", name, 1);
    let _server = stage.serve_scene(&scene, &["--paused"]);
    // The answer names the objects that there are.
    let output = stage.ctl(&["push", "nobody", "1", "0", "0"]);
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    let is_plain = |c: char| c == '\n' || !c.is_control();
    assert!(
        said.contains("\\u001b]0;owned\\u0007ball") && said.chars().all(is_plain),
        "{said:?}"
    );
}

#[test]
fn recover_takes_no_memory_for_what_a_damaged_length_claims() {
    let stage = Stage::new();
    let record = |opcode: u8, body: &[u8]| {
        let length = (body.len() as u64).to_le_bytes();
        [&[opcode][..], &length, body].concat()
    };
    let magic = b"\x89MCAP0\r\n";
    let header = record(1, &[0; 8]);
    // A metadata record whose name claims to have 2^31 bytes.
    let metadata = record(12, &[&(1_u32 << 31).to_le_bytes()[..], b"name"].concat());
    let bytes = [&magic[..], &header, &metadata].concat();
    std::fs::write(stage.path("bad.mcap"), bytes).expect("writable");
    let output = Command::new("sh")
        // In KiB: program and threads fit, and less than that name besides.
        .args(["-c", "ulimit -v 1500000 && exec \"$0\" recover bad.mcap"])
        .arg(env!("CARGO_BIN_EXE_cosplat"))
        .current_dir(stage.path("."))
        .output()
        .expect("a shell");
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.success(), "{}: {said}", output.status);
    assert!(has_bytes(&stage.path("bad.recovered.mcap")));
}
