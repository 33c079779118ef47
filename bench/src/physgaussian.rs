//! `cosplat bench physgaussian`: the sample scenes of PhysGaussian, imported and run; substeps against their fixed
//! step.

mod models;

use std::{fmt, path::PathBuf, sync::atomic::Ordering, time::Instant};

use anyhow::{Context, bail};
use cosplat_physgaussian::{self as import, Options};
use cosplat_scene::{
    assets::{ReadReport, ply},
    scene_file::{SceneFile, build},
};
use cosplat_sim_core::{Scene, World};
use serde::Serialize;

use crate::{progress, signals};
use models::{SAMPLES, Sample};

/// Import and run the six sample settings of PhysGaussian, on generated stand-ins for their captures.
#[derive(clap::Args)]
pub struct Args {
    /// Only this sample: ficus, pillow2sofa, plane, tear_bread, vasedeck or wolf.
    #[arg(long, value_name = "NAME")]
    scene: Option<String>,
    /// Simulated seconds at most; the whole run when left out.
    #[arg(long, value_name = "S")]
    duration: Option<f64>,
    /// Repeat the original's defects where the solver can.
    #[arg(long)]
    compat: bool,
    /// Write NAME.json and NAME.ply of every sample to this folder, as input for `cosplat import`.
    #[arg(short, long, value_name = "DIR")]
    output: Option<PathBuf>,
    /// Print one JSON object per sample.
    #[arg(long)]
    json: bool,
}

/// One sample, run.
#[derive(Serialize)]
struct Row {
    scene: &'static str,
    particles: usize,
    /// Simulated time [s].
    seconds: f64,
    /// Whether that is the whole run.
    complete: bool,
    /// Of the original, for the same time.
    fixed_substeps: u64,
    /// Taken here.
    substeps: u64,
    /// The former over the latter.
    fewer: f64,
    rollbacks: u64,
    left_domain: usize,
    quarantined: usize,
    findings: usize,
    wall_seconds: f64,
    state_hash: String,
}

/// Runs the measurement.
///
/// # Errors
/// When a sample cannot be imported or run, or a file cannot be written.
pub fn run(args: &Args) -> anyhow::Result<()> {
    let chosen: Vec<&Sample> = match &args.scene {
        None => SAMPLES.iter().collect(),
        Some(name) => SAMPLES.iter().filter(|s| s.name == name).collect(),
    };
    if chosen.is_empty() {
        let names = SAMPLES.each_ref().map(|s| s.name).join(", ");
        bail!("unknown sample, expected one of {names}");
    }
    if !args.json {
        println!("{}", Row::HEAD);
    }
    for sample in chosen {
        let row = one(sample, args).with_context(|| sample.name)?;
        if args.json {
            println!("{}", serde_json::to_string(&row)?);
        } else {
            println!("{row}");
        }
    }
    Ok(())
}

fn one(sample: &'static Sample, args: &Args) -> anyhow::Result<Row> {
    let model = sample.model()?;
    if let Some(folder) = &args.output {
        let file = |extension| folder.join(sample.name).with_extension(extension);
        std::fs::create_dir_all(folder)
            .and_then(|()| std::fs::write(file("json"), sample.config))
            .and_then(|()| std::fs::write(file("ply"), ply::write(&model)))
            .with_context(|| format!("cannot write to {}", folder.display()))?;
    }
    let options = Options {
        name: sample.name.into(),
        asset: format!("{}.ply", sample.name),
        compat: args.compat,
        e_multiplier: None,
    };
    let imported = import::import(sample.config, &model, &options)?;
    let file = SceneFile::parse(&imported.scene)?;
    let mut load = |_: &str| Ok((model.clone(), ReadReport::default()));
    let (scene, _) = build(&file, &mut load)?;
    let duration = imported.duration.min(args.duration.unwrap_or(f64::MAX));
    let mut row = simulate(sample.name, &scene, duration)?;
    row.complete = duration == imported.duration;
    let part = duration / imported.duration;
    row.fixed_substeps = (imported.fixed_substeps as f64 * part).round() as u64;
    row.fewer = row.fixed_substeps as f64 / row.substeps.max(1) as f64;
    row.findings = imported.notes.len();
    Ok(row)
}

fn simulate(name: &'static str, scene: &Scene, duration: f64) -> anyhow::Result<Row> {
    let stop = signals::stop_flag()?;
    let frame = 1.0 / scene.frame_rate;
    let frames = (duration * scene.frame_rate - 1e-6).ceil().max(1.0) as u64;
    let bar = progress::bar(name, frames);
    let mut row = Row {
        scene: name,
        particles: scene.particles.position.len(),
        seconds: 0.0,
        complete: false,
        fixed_substeps: 0,
        substeps: 0,
        fewer: 0.0,
        rollbacks: 0,
        left_domain: 0,
        quarantined: 0,
        findings: 0,
        wall_seconds: 0.0,
        state_hash: String::new(),
    };
    let mut world = World::new(scene.clone())?;
    let start = Instant::now();
    for _ in 0..frames {
        if stop.load(Ordering::Relaxed) {
            bail!("interrupted");
        }
        let report = world.step(frame.min(duration - row.seconds), &[]);
        row.seconds = report.sim_time;
        row.substeps += u64::from(report.substeps);
        row.rollbacks += u64::from(report.rollbacks);
        row.left_domain += report.left_domain.len();
        row.quarantined += report.quarantined.len();
        row.state_hash = format!("{:016x}", report.state_hash);
        bar.inc(1);
    }
    bar.finish_and_clear();
    row.wall_seconds = start.elapsed().as_secs_f64();
    Ok(row)
}

impl Row {
    const HEAD: &str = "| scene | particles | simulated | their substeps | ours | fewer by | rollbacks | left domain \
                        | quarantined | wall |\n|---|--:|--:|--:|--:|--:|--:|--:|--:|--:|";
}

impl fmt::Display for Row {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "| {} | {} | {:.3} s{} | {} | {} | {:.1} x | {} | {} | {} | {:.0} s |",
            self.scene,
            self.particles,
            self.seconds,
            if self.complete { "" } else { " (part)" },
            self.fixed_substeps,
            self.substeps,
            self.fewer,
            self.rollbacks,
            self.left_domain,
            self.quarantined,
            self.wall_seconds
        )
    }
}
