//! `cosplat bench scenes`: particle updates per second in the scenes that users write, beside the kernel's of the same laws.

mod kernel_rate;
mod report;
mod run;

use std::{
    fs,
    path::{Path, PathBuf},
};

use anyhow::{Context, ensure};
use cosplat_scene::load::{LoadedScene, load_scene, load_text};

use crate::{machine::Run, page, progress};
use kernel_rate::KernelRates;
use report::{Row, line, sentence, table};
use run::run_scene;

/// Measure whole scenes: speed, shares of the phases, ratio to the kernel, heap allocations.
#[derive(clap::Args)]
pub struct Args {
    /// Scene files, and folders of them; every scene of the repository when left out.
    #[arg(default_values = ["scenes", "scenes/paper"])]
    scenes: Vec<PathBuf>,
    /// Folder of captured splats that lie beside no scene file.
    #[arg(long, value_name = "DIR", env = "COSPLAT_TEST_DATA")]
    data: Option<PathBuf>,
    /// Simulated seconds of every scene.
    #[arg(long, value_name = "S", default_value_t = 0.5, value_parser = seconds)]
    duration: f64,
    /// Threads.
    #[arg(long, value_delimiter = ',', default_values = ["1", "2"], value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Vec<u16>,
    /// Print one JSON object per scene and number of threads.
    #[arg(long)]
    json: bool,
    /// Write the table between the markers of this Markdown file.
    #[arg(long, value_name = "FILE")]
    table: Option<PathBuf>,
}

fn seconds(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(value) if (1e-6..=1e4).contains(&value) => Ok(value),
        _ => Err("expected a number of seconds, 1e-6 to 1e4".into()),
    }
}

/// Scene files that the arguments name, in the order of their names.
fn files(paths: &[PathBuf]) -> anyhow::Result<Vec<PathBuf>> {
    let mut found = Vec::new();
    for path in paths {
        if !path.is_dir() {
            found.push(path.clone());
            continue;
        }
        let unreadable = || format!("cannot read the folder {}", path.display());
        let mut inside = Vec::new();
        for entry in fs::read_dir(path).with_context(unreadable)? {
            let file = entry.with_context(unreadable)?.path();
            if file.extension().is_some_and(|end| end == "toml") && is_scene(&file)? {
                inside.push(file);
            }
        }
        inside.sort();
        ensure!(
            !inside.is_empty(),
            "the folder {} holds no scene file",
            path.display()
        );
        found.extend(inside);
    }
    Ok(found)
}

/// Whether a file has objects: scripts of commands lie beside the scenes that they are for.
fn is_scene(path: &Path) -> anyhow::Result<bool> {
    let text =
        fs::read_to_string(path).with_context(|| format!("cannot read {}", path.display()))?;
    let table: toml::Table = text
        .parse()
        .with_context(|| format!("{} is not TOML", path.display()))?;
    Ok(table.contains_key("objects"))
}

/// The scene of a file, whose captures lie beside it or in `data`.
fn load(path: &Path, data: Option<&Path>) -> anyhow::Result<LoadedScene> {
    let beside = load_scene(path);
    let (Err(_), Some(data), Some(name)) = (&beside, data, path.file_name()) else {
        return Ok(beside?);
    };
    let text =
        fs::read_to_string(path).with_context(|| format!("cannot read {}", path.display()))?;
    Ok(load_text(text, &data.join(name))?)
}

/// Runs the measurement.
///
/// # Errors
/// When a scene cannot be loaded, no threads can be started, or the file cannot be written.
pub fn run(args: &Args) -> anyhow::Result<()> {
    if let Some(path) = &args.table {
        // Better now than after minutes of measuring.
        page::check(path, &[report::PART])?;
    }
    let files = files(&args.scenes)?;
    let here = Run::here();
    let bar = progress::bar("bench scenes", (files.len() * args.threads.len()) as u64);
    let mut kernel = KernelRates::default();
    let mut rows: Vec<Row> = Vec::new();
    for file in &files {
        bar.set_message(file.display().to_string());
        let scene = load(file, args.data.as_deref())?.scene;
        for &threads in &args.threads {
            let measured = run_scene(&scene, args.duration, threads)?;
            let row = Row {
                scene: file.display().to_string(),
                threads,
                kernel: kernel.of_scene(&scene, threads)?,
                measured,
            };
            let text = if args.json {
                line(&row, &here).to_string()
            } else {
                sentence(&row)
            };
            bar.suspend(|| println!("{text}"));
            rows.push(row);
            bar.inc(1);
        }
    }
    bar.finish_and_clear();
    if let Some(path) = &args.table {
        page::put(path, &[(report::PART, table(&rows, args.duration, &here))])?;
        eprintln!("wrote {}", path.display());
    }
    Ok(())
}
