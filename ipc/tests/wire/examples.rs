//! The examples that the documents show, run against a server.

use std::{
    io::{BufRead, BufReader},
    path::{Path, PathBuf},
    process::{Command, Stdio},
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
    },
    time::Duration,
};

use cosplat_ipc::{
    Domain,
    schema::{FRAME_FLAG_LAST, FrameHeader},
};

use super::support::{COUNT, serve, write_frame};

/// A server whose last frame comes when `stop` is set.
fn serve_until(domain: Domain, stop: Arc<AtomicBool>) -> std::thread::JoinHandle<()> {
    let (ready, wait) = std::sync::mpsc::channel();
    let server = std::thread::spawn(move || {
        let ports = serve(&domain, "example");
        ready.send(()).expect("heard");
        for step in 1.. {
            let stopped = stop.load(Ordering::Relaxed);
            let header = FrameHeader {
                step,
                sim_time: 0.5,
                flags: if stopped { FRAME_FLAG_LAST } else { 0 },
                ..FrameHeader::default()
            };
            write_frame(&ports, &header);
            ports.maintain();
            std::thread::sleep(Duration::from_millis(5));
            if stopped {
                // Long enough for the last frame to be seen.
                std::thread::sleep(Duration::from_millis(500));
                return;
            }
        }
    });
    wait.recv().expect("a server");
    server
}

/// Runs a subscriber and returns what it prints; it must end by itself after the last frame.
fn run(mut subscriber: Command, name: &str) -> Vec<String> {
    let domain = Domain::named(&format!("{name}{}", std::process::id())).expect("a domain");
    let stop = Arc::new(AtomicBool::new(false));
    let server = serve_until(domain.clone(), stop.clone());
    let mut child = subscriber
        .arg("example")
        .env("COSPLAT_DOMAIN", domain.root())
        .stdout(Stdio::piped())
        .spawn()
        .expect("a subscriber");
    let mut lines = Vec::new();
    for line in BufReader::new(child.stdout.take().expect("its output")).lines() {
        lines.push(line.expect("text"));
        if lines.len() == 5 {
            stop.store(true, Ordering::Relaxed);
        }
    }
    stop.store(true, Ordering::Relaxed);
    let status = child.wait().expect("its end");
    server.join().expect("the server");
    domain.discard();
    assert!(status.success(), "{status}: {lines:?}");
    lines
}

/// The part of a line that both examples print alike.
fn check(line: &str) {
    let step: u64 = line
        .strip_prefix("step ")
        .and_then(|rest| rest.split_once(' '))
        .and_then(|(step, _)| step.parse().ok())
        .unwrap_or_else(|| panic!("no step in {line:?}"));
    assert!(step > 0);
    // The height of the highest is the step: it was read from the frame that the header belongs to.
    let expected = format!("at 0.500 s: {COUNT} Gaussians, the highest at {step}");
    assert!(line.contains(&expected), "{line:?} without {expected:?}");
}

/// A program that makes files which must be usable later: iceoryx2 narrows the mask of this whole process while it makes
/// its own, and a child that is started in that moment would keep it.
fn maker(program: &Path) -> Command {
    let mut command = Command::new("sh");
    command.args(["-c", "umask 022 && exec \"$0\" \"$@\""]);
    command.arg(program);
    command
}

#[test]
fn the_smallest_subscriber_sees_frames() {
    let exe = std::env::current_exe().expect("this binary");
    let profile = exe.ancestors().nth(2).expect("the profile's folder");
    // With `--test wire` alone nobody has built the examples.
    let mut build = maker(Path::new(env!("CARGO")));
    build.args(["build", "--quiet", "--package", "cosplat-ipc"]);
    build.args(["--example", "smallest_subscriber"]);
    if profile.ends_with("release") {
        build.arg("--release");
    }
    assert!(build.status().expect("cargo").success());
    let lines = run(
        Command::new(profile.join("examples/smallest_subscriber")),
        "rs",
    );
    assert_eq!(lines[0], "1 objects");
    assert!(lines.len() >= 5, "{lines:?}");
    lines[1..].iter().for_each(|line| check(line));
}

const PACKAGES: [&str; 2] = ["iceoryx2==0.10.0", "numpy==2.2.6"];

/// The interpreter of an environment with the packages below the target folder.
fn python() -> Option<PathBuf> {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("python-iceoryx2");
    let python = folder.join("bin/python");
    let run = |program: &Path, arguments: &[&str]| {
        let output = maker(program).args(arguments).output();
        output.is_ok_and(|output| output.status.success())
    };
    let install = ["-m", "pip", "install", "--quiet", PACKAGES[0], PACKAGES[1]];
    let venv = ["-m", "venv", &folder.to_string_lossy()];
    let is_ready = run(&python, &["-c", "import iceoryx2, numpy"])
        || (run(Path::new("python3"), &venv) && run(&python, &install));
    is_ready.then_some(python)
}

#[test]
fn a_subscriber_in_python_sees_frames() {
    let Some(python) = python() else {
        let why = format!("needs python3 with venv and the packages {PACKAGES:?}");
        assert!(std::env::var_os("COSPLAT_REQUIRE_ALL").is_none(), "{why}");
        eprintln!("SKIPPED: a_subscriber_in_python_sees_frames: {why}");
        return;
    };
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/examples/subscriber.py");
    let mut command = Command::new(python);
    command.arg(script);
    let lines = run(command, "py");
    assert!(lines.len() >= 5, "{lines:?}");
    lines.iter().for_each(|line| check(line));
}
