//! Ctrl-C, SIGTERM, a closed terminal and `ctl stop` end a session cleanly.

use std::path::PathBuf;

use cosplat_ipc::schema::{FRAME_FLAG_LAST, SERVER_STOPPING};

use crate::stage::{Stage, next_frame, wait_for_status, watchdog};

/// Files in shared memory that a process has mapped.
fn mapped(pid: u32) -> Vec<PathBuf> {
    let maps = std::fs::read_to_string(format!("/proc/{pid}/maps")).expect("the process lives");
    let mut files: Vec<_> = maps
        .split_whitespace()
        .filter(|word| word.starts_with("/dev/shm/"))
        .map(PathBuf::from)
        .collect();
    files.sort();
    files.dedup();
    files
}

fn ends_cleanly(stop: impl Fn(&Stage, &crate::stage::Process)) {
    let _watchdog = watchdog();
    let stage = Stage::new();
    let mut server = stage.serve(&[]);
    let client = stage.client();
    let mut frames = client.frames(64).expect("frames are readable");
    let mut statuses = client.status().expect("status is readable");
    let pid = wait_for_status(&client, |s| s.step >= 3).pid;
    let files = mapped(pid);
    assert!(!files.is_empty(), "a session has its memory here");
    stop(&stage, &server);
    while next_frame(&mut frames).header().flags & FRAME_FLAG_LAST == 0 {}
    assert!(server.result()["frames_published"].as_u64() > Some(3));
    let last = statuses.newest().expect("status is well-formed");
    assert_eq!(last.map(|s| s.server_state), Some(SERVER_STOPPING));
    drop((frames, statuses, client));
    let left: Vec<_> = files.iter().filter(|file| file.exists()).collect();
    assert!(left.is_empty(), "{left:?}");
}

#[test]
fn ctrl_c_ends_the_session_cleanly() {
    ends_cleanly(|_, server| server.signal("INT"));
}

#[test]
fn sigterm_ends_the_session_cleanly() {
    ends_cleanly(|_, server| server.signal("TERM"));
}

#[test]
fn a_closed_terminal_ends_the_session_cleanly() {
    ends_cleanly(|_, server| {
        // One comes from the system and one from the shell.
        server.signal("HUP");
        server.signal("HUP");
    });
}

#[test]
fn nohup_outlives_the_terminal() {
    let _watchdog = watchdog();
    let stage = Stage::new();
    let scene = stage.path("scene.toml");
    std::fs::write(&scene, crate::stage::SMALL_SCENE).expect("the stage's folder is writable");
    let mut command = crate::stage::command("sh");
    command
        .args(["-c", "trap '' HUP; exec \"$0\" serve scene.toml --json"])
        .arg(env!("CARGO_BIN_EXE_cosplat"))
        .envs(
            stage
                .cosplat(&[])
                .get_envs()
                .filter_map(|(k, v)| Some((k, v?))),
        )
        .current_dir(scene.parent().expect("a file has a folder"));
    let mut server = crate::stage::Process::start(command);
    let client = stage.client();
    let step = wait_for_status(&client, |s| s.step >= 1).step;
    server.signal("HUP");
    wait_for_status(&client, |s| s.step >= step + 20);
    assert!(server.is_running());
    server.signal("TERM");
    assert!(server.wait().success());
}

#[test]
fn a_stop_command_ends_the_session_cleanly() {
    ends_cleanly(|stage, _| assert!(stage.ctl(&["stop"]).status.success()));
}

#[test]
fn a_session_whose_files_are_cleaned_away_ends_and_says_why() {
    for what in ["", "session-default.lock"] {
        let _watchdog = watchdog();
        let stage = Stage::new();
        let mut server = stage.serve(&[]);
        let client = stage.client();
        let pid = wait_for_status(&client, |s| s.step >= 1).pid;
        let files = mapped(pid);
        let root = client.domain().root().join(what);
        match root.is_dir() {
            true => std::fs::remove_dir_all(&root).expect("removed"),
            false => std::fs::remove_file(&root).expect("removed"),
        }
        assert_eq!(server.wait().code(), Some(1));
        let words = server.words();
        assert!(
            words.contains("were removed") && words.contains("COSPLAT_DOMAIN"),
            "{words}"
        );
        drop(client);
        let left: Vec<_> = files.iter().filter(|file| file.exists()).collect();
        assert!(left.is_empty(), "{left:?}");
    }
}

/// Steel on a grid of its own, with frames of 1000 s: billions of substeps.
const ENDLESS_FRAMES: &str = r#"
version = 1
dx = 0.05
frame_rate = 0.001
objects = [{ name = "bar", shape = { kind = "box", size = [0.4, 0.2, 0.2] }, translation = [0, 0.2, 0], material = "steel" }]
colliders = [{ name = "floor", normal = [0, 1, 0] }]
"#;

#[test]
fn a_frame_without_end_is_broken_off() {
    for signal in [Some("INT"), Some("TERM"), None] {
        let _watchdog = watchdog();
        let stage = Stage::new();
        let mut server = stage.serve_scene(ENDLESS_FRAMES, &[]);
        let client = stage.client();
        let mut frames = client.frames(64).expect("frames are readable");
        match signal {
            Some(signal) => server.signal(signal),
            None => assert!(stage.ctl(&["stop"]).status.success()),
        }
        // The state at the start; its successor never comes.
        let last = loop {
            let frame = next_frame(&mut frames);
            if frame.header().flags & FRAME_FLAG_LAST != 0 {
                break frame.header().step;
            }
        };
        assert_eq!(last, 0);
        assert_eq!(server.result()["steps"].as_u64(), Some(0));
    }
}

/// One of the same session name.
#[test]
fn a_second_server_is_refused_with_the_first_ones_pid() {
    let _watchdog = watchdog();
    let stage = Stage::new();
    let _server = stage.serve(&["--paused"]);
    let pid = wait_for_status(&stage.client(), |_| true).pid;
    let scene = stage.path("scene.toml");
    let output = stage
        .cosplat(&["serve", scene.to_str().expect("a plain path")])
        .output()
        .expect("cosplat can be run");
    assert!(!output.status.success());
    let words = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(words.contains(&pid.to_string()), "{words}");
}

#[test]
fn too_little_shared_memory_is_refused_and_not_a_bus_error() {
    let _watchdog = watchdog();
    let stage = Stage::new();
    let scene = stage.path("scene.toml");
    std::fs::write(&scene, crate::stage::SMALL_SCENE).expect("the stage's folder is writable");
    // A mount namespace of its own, whose shared memory is smaller than the pool.
    let output = std::process::Command::new("unshare")
        .args(["--mount", "--map-root-user", "sh", "-c"])
        .arg(
            "mount -t tmpfs -o size=4m tmpfs /dev/shm && exec \"$0\" serve scene.toml --duration 1",
        )
        .arg(env!("CARGO_BIN_EXE_cosplat"))
        .envs(
            stage
                .cosplat(&[])
                .get_envs()
                .filter_map(|(k, v)| Some((k, v?))),
        )
        .current_dir(scene.parent().expect("a file has a folder"))
        .output()
        .expect("unshare is a program");
    let words = String::from_utf8_lossy(&output.stderr).into_owned();
    if words.contains("unshare") {
        let required = std::env::var_os("COSPLAT_REQUIRE_ALL").is_some();
        assert!(!required, "no mount namespace: {words}");
        eprintln!("SKIPPED: too_little_shared_memory: no mount namespace: {words}");
        return;
    }
    assert_eq!(output.status.code(), Some(1), "{words}");
    assert!(words.contains("shared memory is too small"), "{words}");
    assert!(words.contains("MiB required"), "{words}");
}
