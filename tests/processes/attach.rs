//! Clients come when they like and take the time they need.

use std::time::Duration;

use crate::stage::{PATIENCE, Process, Stage, next_frame, wait_for_status, watchdog};
use cosplat_ipc::schema::SERVER_PAUSED;

#[test]
fn late_joiner_on_a_paused_server_gets_scene_and_newest_frame() {
    let _watchdog = watchdog();
    let stage = Stage::new();
    let _server = stage.serve(&["--pace", "free"]);
    let early = stage.client();
    wait_for_status(&early, |s| s.step >= 5);
    assert!(stage.ctl(&["pause"]).status.success());
    let paused = wait_for_status(&early, |s| s.server_state == SERVER_PAUSED);

    let late = stage.client();
    let scene = late
        .scene(PATIENCE)
        .expect("the scene is kept for late joiners");
    assert_eq!(scene.objects().len(), 2);
    assert_eq!(
        scene.gaussians().len(),
        scene.header().gaussian_count as usize
    );
    assert!(scene.source().contains("two blocks"));
    let mut frames = late.frames(1).expect("frames are readable");
    let frame = next_frame(&mut frames);
    assert_eq!(frame.header().step, paused.step);
    assert_eq!(frame.header().state_hash, paused.state_hash);
    assert_eq!(frame.gaussians().len(), scene.gaussians().len());
}

#[test]
fn a_renderer_that_sleeps_never_slows_the_server() {
    let _watchdog = watchdog();
    let stage = Stage::new();
    let mut server = stage.serve(&["--pace", "free", "--duration", "8", "--paused"]);
    let client = stage.client();
    let mut frames = client.frames(1).expect("frames are readable");
    assert!(stage.ctl(&["resume"]).status.success());
    // Two seconds per frame: a server that waited for this reader would need 800 s for its 400 steps, far
    // beyond the patience of `result`.
    let mut seen = 0;
    while server.is_running() {
        let frame = frames
            .next(Duration::from_millis(100))
            .expect("frames are well-formed");
        if frame.is_some() {
            seen += 1;
            std::thread::sleep(Duration::from_secs(2));
        }
    }
    let result = server.result();
    assert_eq!(result["steps"], 400);
    assert_eq!(result["frames_published"], 401);
    assert_eq!(result["frames_skipped"], 0);
    assert!(seen < 100, "{seen} frames at 2 s each");
}

#[test]
fn the_smallest_objects_reader_follows_every_step() {
    let _watchdog = watchdog();
    let stage = Stage::new();
    let mut server = stage.serve(&["--pace", "free", "--duration", "1", "--paused"]);
    let client = stage.client();
    let mut objects = client.objects(64).expect("objects are readable");
    let mut steps = Vec::new();
    assert!(stage.ctl(&["resume"]).status.success());
    while steps.last() != Some(&50) {
        let message = objects
            .next(PATIENCE)
            .expect("objects are well-formed")
            .expect("a message comes in time");
        assert_eq!(message.items().len(), 2);
        steps.push(message.header().step);
    }
    assert_eq!(steps, (0..=50).collect::<Vec<_>>());
    server.result();
}

#[test]
fn a_stopped_reader_of_a_lossless_server_locks_nobody_out() {
    let _watchdog = watchdog();
    let stage = Stage::new();
    let arguments = ["--lossless", "--pace", "free", "--frame-slots", "4"];
    let mut server = stage.serve(&arguments);
    let client = stage.client();
    let _stopped = client.frames(64).expect("frames are readable");
    let mut statuses = client.status().expect("status is readable");
    let mut next = || {
        let status = statuses.next(PATIENCE).expect("status is well-formed");
        status.expect("the heart beats")
    };
    // The pool is full as soon as the heart beats without a step.
    let mut last = next();
    loop {
        let status = next();
        assert!(status.heartbeat_ns > last.heartbeat_ns);
        if std::mem::replace(&mut last, status).step == status.step {
            break;
        }
    }
    for order in [&["push", "left", "0", "0.1", "0"][..], &["pause"]] {
        let output = stage.ctl(order);
        let words = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(output.status.success(), "{order:?}: {words}");
    }
    assert!(stage.ctl(&["stop"]).status.success());
    assert_eq!(server.result()["frames_skipped"], 1, "it was waiting");
}

/// What each thread of a process gives up of its priority, by the thread's name.
fn niceness(pid: u32) -> Vec<(String, i32)> {
    let tasks = std::fs::read_dir(format!("/proc/{pid}/task")).expect("the process runs");
    let of_task = |task: std::io::Result<std::fs::DirEntry>| {
        // A thread that ends meanwhile has no line any more.
        let stat = std::fs::read_to_string(task.ok()?.path().join("stat")).ok()?;
        let (name, fields) = stat.split_once(" (")?.1.rsplit_once(") ")?;
        // The 19th field, of which two are before.
        let nice = fields.split(' ').nth(16)?.parse().ok()?;
        Some((name.to_owned(), nice))
    };
    tasks.filter_map(of_task).collect()
}

#[test]
fn a_viewer_stands_aside_once_it_has_something_to_draw() {
    let _watchdog = watchdog();
    let stage = Stage::new();
    let arguments = [
        "view",
        "--png",
        "pictures",
        "--size",
        "64x48",
        "--timeout",
        "60",
    ];
    let mut viewer = Process::start(stage.cosplat(&arguments));
    let pause = || std::thread::sleep(Duration::from_millis(5));
    while !stage.domain.root().exists() {
        assert!(viewer.is_running(), "{}", viewer.words());
        pause();
    }
    // It looks for a server, and takes frames, and must not be kept from either.
    let own = rustix::process::nice(0).expect("a priority");
    let lowest = (own + 19).min(19);
    let id = viewer.id();
    let of = |name: &str| {
        let threads = niceness(id);
        threads
            .into_iter()
            .find(|(n, _)| n == name)
            .map(|(_, nice)| nice)
    };
    assert_eq!(of("cosplat"), Some(own));
    let _server = stage.serve(&["--paused"]);
    let has_picture = || std::fs::read_dir(stage.path("pictures")).is_ok_and(|d| d.count() > 0);
    while !has_picture() {
        assert!(viewer.is_running(), "{}", viewer.words());
        pause();
    }
    assert_eq!(of("cosplat"), Some(own), "frames are taken");
    assert_eq!(of("painter"), Some(lowest), "pictures are drawn");
}

#[test]
fn a_recorder_waits_on_when_a_server_goes_while_it_attaches() {
    let _watchdog = watchdog();
    let stage = Stage::new();
    let mut first = stage.serve(&["--paused"]);
    // What a client finds of a server that is just going: its greeting is there, its status no more.
    let services = stage.domain.root().join("services");
    let mut found = false;
    for file in std::fs::read_dir(services).expect("the services") {
        let path = file.expect("an entry").path();
        let text = std::fs::read(&path).expect("a service");
        if text.windows(7).any(|part| part == b"/status") {
            std::fs::remove_file(path).expect("removed");
            found = true;
        }
    }
    assert!(found, "a service of the status");
    let mut recorder =
        Process::start(stage.cosplat(&["record", "-o", "run.mcap", "--wait", "60", "--json"]));
    // Long enough for some tries; if not, it finds the second server at the first.
    std::thread::sleep(Duration::from_millis(500));
    first.signal("TERM");
    first.wait();
    let mut second = stage.serve(&["--paused", "--duration", "0.2"]);
    wait_for_status(&stage.client(), |s| s.frame_readers >= 1);
    assert!(stage.ctl(&["resume"]).status.success());
    second.result();
    let summary = recorder.result();
    assert_eq!(summary["frames_recorded"], 11, "{summary}");
}
