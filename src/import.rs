//! `cosplat import`: a PhysGaussian configuration and a model become a scene file.

use std::path::PathBuf;

use cosplat_physgaussian::{
    Note, NoteKind,
    files::{Written, import_files},
};
use cosplat_scene::load::load_scene;
use serde::Serialize;

use crate::say;

/// Turn a PhysGaussian configuration and its model into a scene file.
///
/// Defects of the original are corrected, and everything that differs is listed.
#[derive(clap::Args)]
pub struct Args {
    /// The JSON configuration.
    config: PathBuf,
    /// A 3DGS model folder, of which the highest iteration is taken, or a PLY file.
    #[arg(value_name = "MODEL_DIR")]
    model: PathBuf,
    /// Folder for scene.toml [default: named like the configuration].
    #[arg(short, long, value_name = "DIR")]
    output: Option<PathBuf>,
    /// Repeat the original's defects where the solver can.
    #[arg(long)]
    compat: bool,
    /// Factor on every Young's modulus: some forks store it divided by 1e7.
    #[arg(long, value_name = "X", value_parser = positive)]
    e_multiplier: Option<f64>,
    /// Print one JSON object instead of text.
    #[arg(long)]
    json: bool,
}

fn positive(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(value) if (1e-12..=1e12).contains(&value) => Ok(value),
        _ => Err("expected a number, 1e-12 to 1e12".into()),
    }
}

/// What was made of the files.
#[derive(Serialize)]
struct Report<'a> {
    scene: String,
    model: String,
    compat: bool,
    /// What the configuration asks for [s].
    duration: f64,
    frames: u64,
    /// Of the original, for that duration.
    fixed_substeps: u64,
    simulated_gaussians: usize,
    static_gaussians: usize,
    transparent_gaussians: usize,
    particles: usize,
    findings: &'a [Note],
    /// What the scene file's own checks find suspicious.
    warnings: Vec<String>,
}

/// Runs the command.
///
/// # Errors
/// When a file cannot be read or written, or the configuration cannot be used.
pub fn run(args: &Args) -> anyhow::Result<()> {
    let stem = args.config.file_stem().unwrap_or("scene".as_ref());
    let out = args.output.clone().unwrap_or_else(|| stem.into());
    let Written {
        scene,
        model,
        imported,
    } = import_files(
        &args.config,
        &args.model,
        &out,
        args.compat,
        args.e_multiplier,
    )?;
    let loaded = load_scene(&scene)?;
    let report = Report {
        scene: scene.display().to_string(),
        model: model.display().to_string(),
        compat: args.compat,
        duration: imported.duration,
        frames: imported.frames,
        fixed_substeps: imported.fixed_substeps,
        simulated_gaussians: imported.simulated,
        static_gaussians: imported.at_rest,
        transparent_gaussians: imported.transparent,
        particles: loaded.scene.particles.position.len(),
        findings: &imported.notes,
        warnings: loaded
            .report
            .warnings
            .iter()
            .map(ToString::to_string)
            .collect(),
    };
    if args.json {
        say!("{}", serde_json::to_string(&report)?)?;
    } else {
        print(&report)?;
    }
    Ok(())
}

fn print(report: &Report) -> anyhow::Result<()> {
    let mut findings = report.findings;
    while let [first, ..] = findings {
        // Keys that are ignored for one and the same reason share a line.
        let alike = |f: &&Note| f.kind == NoteKind::Ignored && f.message == first.message;
        let count = findings.iter().take_while(alike).count().max(1);
        let (group, rest) = findings.split_at(count);
        if count == 1 {
            say!("{first}")?;
        } else {
            let keys: Vec<&str> = group.iter().map(|f| f.key.as_str()).collect();
            say!(
                "{:<10} {}: {}",
                first.kind.to_string(),
                keys.join(", "),
                first.message
            )?;
        }
        findings = rest;
    }
    for warning in &report.warnings {
        say!("scene      {warning}")?;
    }
    say!(
        "{} Gaussians simulated with {} particles, {} at rest, {} too transparent",
        report.simulated_gaussians,
        report.particles,
        report.static_gaussians,
        report.transparent_gaussians
    )?;
    say!(
        "run        cosplat simulate {} --duration {} (the original: {} frames, {} substeps)",
        report.scene,
        report.duration,
        report.frames,
        report.fixed_substeps
    )?;
    Ok(())
}
