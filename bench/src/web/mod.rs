//! `cosplat bench web`: what pages in browsers get of a session, and what they cost it.
//!
//! Server, page server and pages are processes of their own. Pages are plain HTTP clients that ask as a browser's does, and draw
//! nothing: what a browser takes to draw is not measured.

mod page;
mod report;
mod session;

use std::path::PathBuf;

use anyhow::Context;
use cosplat_ipc::{Domain, monotonic_ns};
use rustix::process::Signal;

use crate::{
    machine::Run,
    page::Telling,
    trial::{SceneText, scene_text},
};
use page::Got;
use report::{Report, Round};
use session::{Session, Watched};

/// What the table is called in a page of the documentation.
const PART: &str = "cosplat bench web";
/// A capture that is pushed, all of it simulated in full.
const CAPTURE: SceneText = scene_text!("paper/plant_push");
/// Without a capture: a generated vase that falls, likewise.
const GENERATED: SceneText = scene_text!("drop_splat");
/// `ObjectState::fidelity` of matter that sleeps.
const SLEEPS: u32 = 3;
/// Before anything is counted, so that caches are warm and all was sent once [s].
const WARM_UP: f64 = 1.0;
/// What a page that was stopped has to come back [s].
const COMING_BACK: f64 = 2.0;
/// Time of a click, at most, with what is left over [s].
const CLICK: f64 = 0.25;

/// A block that stands on a floor, and sleeps after a while.
const RESTING: &str = r#"
version = 1
gravity = [0, -9.81, 0]
dx = 0.07
frame_rate = 60

[[objects]]
name = "block"
shape = { kind = "box", size = [0.4, 0.3, 0.4], gaussian_spacing = 0.01 }
translation = [0, 0.15, 0]
material = { youngs_modulus_pa = 1e6, poisson_ratio = 0.3, density_kg_m3 = 1000 }
fidelity = "auto"

[[colliders]]
name = "floor"
normal = [0, 1, 0]
surface = "sticky"
"#;

/// Measure what pages in the browser get of a session at 60 steps per second, and what they cost it.
#[derive(clap::Args)]
pub struct Args {
    /// Capture to push, a plant (.ply or .splat); without it, a generated vase falls. All of it is simulated in full.
    #[arg(long, value_name = "FILE")]
    splat: Option<PathBuf>,
    /// Seconds of each measurement, and for which a page is stopped.
    #[arg(long, value_name = "S", default_value_t = 10.0, value_parser = cosplat_console::seconds::positive)]
    seconds: f64,
    /// How often all is measured; medians are told.
    #[arg(long, value_name = "N", default_value_t = 3, value_parser = clap::value_parser!(u32).range(1..))]
    rounds: u32,
    /// Clicks of a round; with 0 nothing is said of them.
    #[arg(long, value_name = "N", default_value_t = 60)]
    clicks: u32,
    #[command(flatten)]
    telling: Telling,
    /// Be the page with this link; the measuring process starts it.
    #[arg(long, value_name = "LINK", hide = true)]
    page: Option<String>,
    /// Number of that page.
    #[arg(long, default_value_t = 1, hide = true)]
    number: u64,
}

/// Runs the command.
///
/// # Errors
/// When a process cannot be started or does not answer. What misses its aim is no error.
pub fn run(args: &Args) -> anyhow::Result<()> {
    if let Some(link) = &args.page {
        return page::run(link, args.number, args.clicks as usize);
    }
    args.telling.check(PART)?;
    let domain = Domain::named(&format!("bweb{}", std::process::id() % 100_000))?;
    let measured = measure(&domain, args);
    domain.discard();
    let report = measured?;
    let here = (&Run::here(), "five or six processes");
    args.telling.tell(PART, &report, &report.table(), here)
}

/// The text of the scene, with the capture where there is one.
fn text(args: &Args) -> anyhow::Result<String> {
    let Some(path) = &args.splat else {
        return Ok(GENERATED.text.to_owned());
    };
    let path = path
        .canonicalize()
        .with_context(|| format!("no capture: {}", path.display()))?;
    let mut scene: toml::Table = CAPTURE.text.parse()?;
    let objects = scene.get_mut("objects").and_then(toml::Value::as_array_mut);
    let capture = objects
        .and_then(|objects| objects.iter_mut().find(|o| o.get("path").is_some()))
        .context("the scene of a capture has no object for it")?;
    capture["path"] = path.to_str().context("its path is not plain text")?.into();
    Ok(scene.to_string())
}

fn measure(domain: &Domain, args: &Args) -> anyhow::Result<Report> {
    let folder = tempfile::tempdir()?;
    let write = |name: &str, text: &str| -> anyhow::Result<String> {
        let path = folder.path().join(name);
        std::fs::write(&path, text)?;
        Ok(path.to_str().context("a plain path")?.to_owned())
    };
    let mut rounds = Vec::new();
    {
        let scene = write("scene.toml", &text(args)?)?;
        let mut session = Session::open(domain, "awake", &scene)?;
        session.run(WARM_UP)?;
        for _ in 0..args.rounds {
            rounds.push(round(&mut session, args)?);
        }
    }
    let resting = write("resting.toml", RESTING)?;
    let mut session = Session::open(domain, "resting", &resting)?;
    session.run_until_all_have(SLEEPS)?;
    let (watched, answers) = one_page(&mut session, args.seconds)?;
    let bytes: u64 = answers.iter().map(|got| got.bytes).sum();
    Ok(Report::of(&rounds, bytes as f64 / watched.seconds))
}

/// Makes steps for so long [s] while one page looks, and the answers that it got meanwhile.
fn one_page(session: &mut Session, seconds: f64) -> anyhow::Result<(Watched, Vec<Got>)> {
    let page = session.page(1, 0)?;
    session.run(WARM_UP)?;
    let begin = monotonic_ns();
    let watched = session.run(seconds)?;
    let end = monotonic_ns();
    let mut answers = page.end()?.answers;
    answers.retain(|got| (begin..end).contains(&got.at));
    Ok((watched, answers))
}

/// All of it once, in the order of the table.
fn round(session: &mut Session, args: &Args) -> anyhow::Result<Round> {
    session.run_until_nobody_looks()?;
    let alone = session.run(args.seconds)?;

    let (watched, answers) = one_page(session, args.seconds)?;
    let news = answers.iter().filter(|got| got.has_news);
    let answer_bytes = news.clone().map(|got| got.bytes).max().unwrap_or(0);
    let one_page = report::OnePage {
        steps_per_second: watched.steps.len() as f64 / watched.seconds,
        frames_per_second: news.count() as f64 / watched.seconds,
        cores: watched.web_seconds / watched.seconds,
    };

    let pages = [session.page(1, 0)?, session.page(2, 0)?];
    let stopped = session.page(3, 0)?;
    session.run(WARM_UP)?;
    stopped.signal(Signal::STOP)?;
    let beside = session.run(args.seconds)?;
    let (at, step) = (monotonic_ns(), session.step);
    stopped.signal(Signal::CONT)?;
    session.run(COMING_BACK)?;
    let stopped = report::Stopped::of(&stopped.end()?, at, step);
    for page in pages {
        page.end()?;
    }

    session.applied.clear();
    let page = session.page(1, args.clicks as usize)?;
    session.run(WARM_UP + CLICK * f64::from(args.clicks))?;
    let clicks = report::reactions(&page.end()?, &session.applied)?;
    Ok(Round {
        alone: alone.steps,
        one_page,
        beside,
        stopped,
        answer_bytes,
        clicks,
    })
}
