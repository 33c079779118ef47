//! `cosplat bench scenes`: particle updates per second in the scenes that users write, beside the kernel's of the same laws.

mod kernel_rate;
mod report;
mod run;

use std::{
    fs,
    path::{Path, PathBuf},
};

use anyhow::{Context, ensure};
use cosplat_console::{note, say, seconds};
use cosplat_scene::load::{LoadedScene, load_text};
use cosplat_sim_core::{Scene, scene::Solver};

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
    #[arg(long, value_name = "S", default_value_t = 0.5, value_parser = seconds::positive)]
    duration: f64,
    /// Threads.
    #[arg(long, value_delimiter = ',', default_values = ["1", "2"], value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Vec<u16>,
    /// Run every scene also with all matter on the spatial grid, each right after its run as it is.
    #[arg(long)]
    spatial: bool,
    /// Print one JSON object per scene and number of threads.
    #[arg(long)]
    json: bool,
    /// Write the table between the markers of this Markdown file.
    #[arg(long, value_name = "FILE")]
    table: Option<PathBuf>,
}

/// Scene files that the arguments name with their texts, in the order of their names.
///
/// # Errors
/// When a file or folder cannot be read, a file is not TOML, or a folder holds no scene.
pub fn files(paths: &[PathBuf]) -> anyhow::Result<Vec<(PathBuf, String)>> {
    let mut found = Vec::new();
    for path in paths {
        if !path.is_dir() {
            found.push((path.clone(), read(path)?));
            continue;
        }
        let unreadable = || format!("cannot read the folder {}", path.display());
        let mut inside = Vec::new();
        for entry in fs::read_dir(path).with_context(unreadable)? {
            let file = entry.with_context(unreadable)?.path();
            if file.extension().is_none_or(|end| end != "toml") {
                continue;
            }
            let text = read(&file)?;
            if is_scene(&file, &text)? {
                inside.push((file, text));
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

fn read(path: &Path) -> anyhow::Result<String> {
    fs::read_to_string(path).with_context(|| format!("cannot read {}", path.display()))
}

/// Whether a file has objects: scripts of commands lie beside the scenes that they are for.
fn is_scene(path: &Path, text: &str) -> anyhow::Result<bool> {
    let table: toml::Table = text
        .parse()
        .with_context(|| format!("{} is not TOML", path.display()))?;
    Ok(table.contains_key("objects"))
}

/// The scene of a file with this text, whose captures lie beside it or in `data`.
///
/// # Errors
/// When the scene cannot be loaded.
pub fn load(path: &Path, text: &str, data: Option<&Path>) -> anyhow::Result<LoadedScene> {
    let beside = load_text(text.to_owned(), path);
    let (Err(_), Some(data), Some(name)) = (&beside, data, path.file_name()) else {
        return Ok(beside?);
    };
    Ok(load_text(text.to_owned(), &data.join(name))?)
}

/// The scene with all matter on the spatial grid.
fn on_the_spatial_grid(scene: &Scene) -> Scene {
    let mut scene = scene.clone();
    for object in &mut scene.objects {
        object.solver = Solver::Spatial;
    }
    scene
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
    for (file, text) in &files {
        bar.set_message(file.display().to_string());
        let scene = load(file, text, args.data.as_deref())?.scene;
        let spatial = args.spatial.then(|| on_the_spatial_grid(&scene));
        for &threads in &args.threads {
            for (scene, suffix) in [(Some(&scene), ""), (spatial.as_ref(), ", spatial")] {
                let Some(scene) = scene else { continue };
                let row = Row {
                    scene: format!("{}{suffix}", file.display()),
                    threads,
                    kernel: kernel.of_scene(scene, threads)?,
                    measured: run_scene(scene, args.duration, threads)?,
                };
                let text = if args.json {
                    line(&row, &here).to_string()
                } else {
                    sentence(&row)
                };
                bar.suspend(|| say!("{text}"))?;
                rows.push(row);
            }
            bar.inc(1);
        }
    }
    bar.finish_and_clear();
    if let Some(path) = &args.table {
        page::put(path, &[(report::PART, table(&rows, args.duration, &here))])?;
        note!("wrote {}", path.display());
    }
    Ok(())
}
