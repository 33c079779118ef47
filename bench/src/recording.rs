//! `cosplat bench recording`: whether a disk holds out against large frames in real time.
//!
//! A server without a solver writes every Gaussian of every frame anew, and a recorder in a process of its own records
//! what comes. The server never waits: what finds no memory is a gap, and counted.

use std::{
    path::PathBuf,
    process::{Command, Stdio},
    time::{Duration, Instant},
};

use anyhow::{Context, ensure};
use cosplat_console::say;
use cosplat_ipc::{
    Domain, ServerPorts,
    schema::{
        CHANGE_GAUSSIANS, ChangesHeader, FRAME_FLAG_LAST, GaussianRest, ObjectChange, ObjectInfo,
        SceneHeader, Status, padded, row_slots,
    },
    server::{ChangesReaders, LoanRefused, PoolPlan, SceneBlocks},
};
use serde::Serialize;

use crate::{child::Owned, transport::fill};

const SESSION: &str = "bench";
const PATIENCE: Duration = Duration::from_secs(20);

/// Record large frames in real time, and report what was lost.
#[derive(clap::Args)]
pub struct Args {
    /// Gaussians in a frame of 64 bytes each: 16 MiB.
    #[arg(long, default_value_t = 1 << 18, value_parser = clap::value_parser!(u32).range(1..=1 << 24))]
    gaussians: u32,
    /// Frames per second [1/s].
    #[arg(long, default_value_t = 60, value_parser = clap::value_parser!(u32).range(1..=1000))]
    rate: u32,
    /// Frames.
    #[arg(long, default_value_t = 300, value_parser = clap::value_parser!(u32).range(2..))]
    frames: u32,
    /// Folder of the recording, which is removed.
    #[arg(long, default_value = ".")]
    folder: PathBuf,
    /// Print one JSON object.
    #[arg(long)]
    json: bool,
}

/// What came of it.
#[derive(Serialize)]
struct Report {
    frame_bytes: u64,
    rate_asked: u32,
    /// Frames per second that the server came to.
    rate: f64,
    frames: u32,
    /// Steps for which there was no memory: the disk was too slow for all buffers.
    skipped: u32,
    /// As the recorder counts.
    frames_recorded: u64,
    missed_steps: u64,
    /// From the first frame to the end of the file.
    megabytes_per_second: f64,
    /// Processor time of the recorder per frame.
    recorder_ms_per_frame: f64,
}

/// Runs the command.
///
/// # Errors
/// When shared memory is short, or the recorder fails.
pub fn run(args: &Args) -> anyhow::Result<()> {
    let domain = Domain::named(&format!("brec{}", std::process::id()))?;
    let file = args
        .folder
        .join(format!("cosplat-bench-{}.mcap", std::process::id()));
    let outcome = measure(args, &domain, &file);
    domain.discard();
    // What is there of it is of no use.
    let _ = std::fs::remove_file(&file);
    let report = outcome?;
    if args.json {
        say!("{}", serde_json::to_string(&report)?)?;
    } else {
        say!(
            "{} frames of {:.1} MiB at {:.1} per second: {} skipped, {} recorded, {} missed",
            report.frames,
            report.frame_bytes as f64 / f64::from(1 << 20),
            report.rate,
            report.skipped,
            report.frames_recorded,
            report.missed_steps
        )?;
        say!(
            "{:.0} MB/s to the file, {:.2} ms of processor time per frame in the recorder",
            report.megabytes_per_second,
            report.recorder_ms_per_frame
        )?;
    }
    Ok(())
}

fn measure(args: &Args, domain: &Domain, file: &std::path::Path) -> anyhow::Result<Report> {
    let count = args.gaussians as usize;
    let rest = vec![GaussianRest::default(); count];
    let objects = [ObjectInfo {
        id: 0,
        fidelity: 2,
        particle_count: 0,
        gaussian_first: 0,
        gaussian_count: args.gaussians,
        law: 1,
        youngs_modulus: 1e5,
        poisson_ratio: 0.3,
        density: 1000.0,
        name: padded("all"),
        material: padded("any"),
    }];
    let scene = SceneBlocks {
        header: SceneHeader {
            frame_rate: args.rate.into(),
            ..SceneHeader::default()
        },
        gaussians: &rest,
        sh: &vec![0.0; 3 * count],
        objects: &objects,
        features: &[],
        source: "",
        files: &[],
    };
    let mut ports = ServerPorts::create(domain, SESSION, &PoolPlan::new(&scene))?;
    ports.publish_scene(&scene)?;
    ports.update_status(&status(0))?;
    let mut recorder = Owned(
        Command::new(std::env::current_exe()?)
            .args(["record", "--json", "--session", SESSION, "-o"])
            .arg(file)
            .env("COSPLAT_DOMAIN", domain.root())
            .stdout(Stdio::piped())
            .spawn()
            .context("the recorder cannot be started")?,
    );
    let begin = Instant::now();
    while ports.changes_readers() == ChangesReaders::None {
        ensure!(begin.elapsed() < PATIENCE, "no recorder came");
        std::thread::sleep(Duration::from_millis(5));
    }
    let start = Instant::now();
    let mut skipped = 0;
    for frame in 0..args.frames {
        let due = start + Duration::from_secs_f64(f64::from(frame) / f64::from(args.rate));
        std::thread::sleep(due.saturating_duration_since(Instant::now()));
        let is_last = frame + 1 == args.frames;
        match send(&mut ports, frame, args, is_last) {
            Ok(()) => {}
            Err(Sending::NoMemory) => skipped += 1,
            Err(Sending::Failed(error)) => return Err(error),
        }
        ports.update_status(&status(frame.into()))?;
        ports.maintain();
    }
    let seconds = start.elapsed().as_secs_f64();
    let output = recorder.0.stdout.take().context("the recorder's output")?;
    let summary: serde_json::Value = serde_json::from_reader(output)?;
    let whole = start.elapsed().as_secs_f64();
    recorder.0.wait()?;
    let number = |key: &str| summary[key].as_u64().context("the recorder's summary");
    let usage = children_seconds();
    Ok(Report {
        frame_bytes: (count * 64) as u64,
        rate_asked: args.rate,
        rate: f64::from(args.frames) / seconds,
        frames: args.frames,
        skipped,
        frames_recorded: number("frames_recorded")?,
        missed_steps: number("missed_steps")?,
        megabytes_per_second: number("bytes")? as f64 / 1e6 / whole,
        recorder_ms_per_frame: 1e3 * usage / f64::from(args.frames),
    })
}

/// Processor time of processes that were started here and have ended [s].
fn children_seconds() -> f64 {
    // Linux tells them in hundredths of a second.
    const TICKS: f64 = 100.0;
    // User and system time of children are behind the name, which is in brackets.
    let stat = std::fs::read_to_string("/proc/self/stat").unwrap_or_default();
    let fields = stat.rsplit(')').next().unwrap_or_default();
    let ticks = fields.split_whitespace().skip(13).take(2);
    let ticks: f64 = ticks.filter_map(|t| t.parse::<f64>().ok()).sum();
    ticks / TICKS
}

fn status(step: u64) -> Status {
    Status {
        step,
        has_changes: 1,
        ..Status::default()
    }
}

/// Why a frame was not sent.
enum Sending {
    NoMemory,
    Failed(anyhow::Error),
}

impl<E: Into<anyhow::Error>> From<E> for Sending {
    fn from(error: E) -> Self {
        Self::Failed(error.into())
    }
}

/// Writes a frame in which everything moved, and sends it. The last one waits for memory.
fn send(ports: &mut ServerPorts, frame: u32, args: &Args, is_last: bool) -> Result<(), Sending> {
    let begin = Instant::now();
    let mut loan = loop {
        match ports.loan_changes(1, args.gaussians as usize) {
            Ok(loan) => break loan,
            Err(LoanRefused::PoolInUse { .. }) if is_last && begin.elapsed() < PATIENCE => {
                std::thread::sleep(Duration::from_millis(2));
            }
            Err(LoanRefused::PoolInUse { .. }) => return Err(Sending::NoMemory),
            Err(error) => return Err(error.into()),
        }
    };
    let (rows, gaussians) = loan.parts_mut();
    rows[0] = ObjectChange {
        kind: CHANGE_GAUSSIANS,
        count: args.gaussians,
        slot: row_slots(1) as u32,
        ..ObjectChange::default()
    };
    fill(gaussians, frame.into());
    let header = ChangesHeader {
        step: frame.into(),
        since: frame.into(),
        sim_time: f64::from(frame) / f64::from(args.rate),
        gaussians: args.gaussians,
        flags: if is_last { FRAME_FLAG_LAST } else { 0 },
        ..ChangesHeader::default()
    };
    ports.send_changes(loan, &header, true)?;
    Ok(())
}
