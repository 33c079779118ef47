//! One session as a client sees it: `cosplat serve`, `cosplat record` and `cosplat ctl` in child processes.

use std::{
    fs,
    process::{Command, Output, Stdio},
    sync::atomic::{AtomicU32, Ordering},
    time::{Duration, Instant},
};

use anyhow::{Context, bail, ensure};
use cosplat_ipc::{
    Domain,
    client::Client,
    schema::{FrameHeader, GaussianState, Status},
};
use cosplat_recorder::reader::{Event, Recording};

use crate::{child::Owned, trial::SceneText};

/// Longest that any single wait may take.
const PATIENCE: Duration = Duration::from_secs(120);

/// What a client received of a session.
pub struct Recorded {
    /// Every published frame, the state before the first step included.
    pub frames: Vec<(FrameHeader, Vec<GaussianState>)>,
    /// Commands that took effect.
    pub commands: usize,
}

/// Waits until a process has ended well.
fn finish(process: &mut Owned, what: &str) -> anyhow::Result<()> {
    let deadline = Instant::now() + PATIENCE;
    loop {
        if let Some(status) = process.0.try_wait()? {
            ensure!(status.success(), "cosplat {what} ended with {status}");
            return Ok(());
        }
        ensure!(
            Instant::now() < deadline,
            "cosplat {what} did not end within {} s",
            PATIENCE.as_secs()
        );
        std::thread::sleep(Duration::from_millis(10));
    }
}

/// Serves a scene for `duration` simulated seconds and records all of it; `orders` are `cosplat ctl` command lines,
/// given before the first step.
///
/// # Errors
/// When one of the processes fails.
pub fn record(
    scene: &SceneText,
    duration: f64,
    threads: u32,
    orders: &[&[&str]],
) -> anyhow::Result<Recorded> {
    static COUNT: AtomicU32 = AtomicU32::new(0);
    let number = COUNT.fetch_add(1, Ordering::Relaxed);
    let name = format!("v{}-{number}", std::process::id());
    let domain = Domain::named(&name)?;
    let outcome = session(scene, duration, threads, orders, &name, &domain);
    domain.discard();
    outcome
}

fn session(
    scene: &SceneText,
    duration: f64,
    threads: u32,
    orders: &[&[&str]],
    name: &str,
    domain: &Domain,
) -> anyhow::Result<Recorded> {
    let folder = tempfile::tempdir().context("cannot make a temporary folder")?;
    let program = std::env::current_exe().context("cannot find this program")?;
    let cosplat = |arguments: &[&str]| {
        let mut command = Command::new(&program);
        command
            .args(arguments)
            .env("COSPLAT_DOMAIN", name)
            .current_dir(folder.path())
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(Stdio::null());
        command
    };
    fs::write(folder.path().join("scene.toml"), scene.text).context("cannot write the scene")?;
    let (duration, threads) = (duration.to_string(), threads.to_string());
    let mut server = Owned(
        cosplat(&[
            "serve",
            "scene.toml",
            "--paused",
            "--lossless",
            "--pace",
            "free",
            "--duration",
            &duration,
            "--threads",
            &threads,
        ])
        .spawn()
        .context("cannot start cosplat serve")?,
    );
    let client = attach(domain, &mut server)?;
    let mut recorder = Owned(
        cosplat(&["record", "-o", "run.mcap"])
            .spawn()
            .context("cannot start cosplat record")?,
    );
    wait(&client, |status| status.frame_readers >= 1)?;
    for order in orders.iter().copied().chain([&["resume"] as &[&str]]) {
        let mut all = vec!["ctl"];
        all.extend(order);
        let Output { status, .. } = cosplat(&all).output().context("cannot start cosplat ctl")?;
        ensure!(
            status.success(),
            "cosplat {} ended with {status}",
            all.join(" ")
        );
    }
    finish(&mut server, "serve")?;
    finish(&mut recorder, "record")?;
    let mut recorded = Recorded {
        frames: Vec::new(),
        commands: 0,
    };
    for event in Recording::open(&folder.path().join("run.mcap"))? {
        match event? {
            Event::Frame(frame) => recorded.frames.push((frame.header, frame.gaussians)),
            Event::Journal(_) => recorded.commands += 1,
            _ => {}
        }
    }
    ensure!(!recorded.frames.is_empty(), "nothing was recorded");
    Ok(recorded)
}

fn attach(domain: &Domain, server: &mut Owned) -> anyhow::Result<Client> {
    let deadline = Instant::now() + PATIENCE;
    loop {
        match Client::connect(domain, "default", "validate", Duration::from_millis(20)) {
            Ok(client) => return Ok(client),
            Err(error) if Instant::now() >= deadline => return Err(error.into()),
            Err(_) => {}
        }
        if let Some(status) = server.0.try_wait()? {
            bail!("cosplat serve ended with {status}");
        }
    }
}

fn wait(client: &Client, wanted: impl Fn(&Status) -> bool) -> anyhow::Result<()> {
    let mut reader = client.status()?;
    let deadline = Instant::now() + PATIENCE;
    while !reader
        .next(Duration::from_millis(100))?
        .is_some_and(|status| wanted(&status))
    {
        ensure!(Instant::now() < deadline, "the recorder did not attach");
    }
    Ok(())
}
