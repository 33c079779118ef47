//! `cosplat bench golden`: state hashes of the scenes that users write, held against those on record.
//!
//! A change that moves no result leaves them all. One that moves some says which, and records them anew with `--write`.

use std::{
    collections::BTreeMap,
    fs,
    path::{Path, PathBuf},
};

use anyhow::{Context, bail};
use cosplat_console::{note, say};
use cosplat_sim_core::{Scene, World};

use crate::{chart::csv, progress, scenes};

/// Frames that every scene is stepped.
const FRAMES: u64 = 12;

const HEADER: [&str; 4] = ["scene", "frames", "substeps", "state_hash"];

/// Compare the results of whole scenes with those on record, bit for bit.
#[derive(clap::Args)]
pub struct Args {
    /// Scene files, and folders of them; every scene of the repository when left out.
    #[arg(default_values = ["scenes", "scenes/paper"])]
    scenes: Vec<PathBuf>,
    /// Folder of captured splats that lie beside no scene file.
    #[arg(long, value_name = "DIR", env = "COSPLAT_TEST_DATA")]
    data: Option<PathBuf>,
    /// The record.
    #[arg(long, value_name = "FILE", default_value = "scenes/golden.csv")]
    record: PathBuf,
    /// Put the results of these scenes on record; those of others stay.
    #[arg(long)]
    write: bool,
}

/// Results of a scene as fields of the record: frames, substeps, hash.
fn result(scene: Scene) -> anyhow::Result<[String; 3]> {
    let frame_dt = 1.0 / scene.frame_rate;
    let mut world = World::new(scene)?;
    let (mut substeps, mut hash) = (0, 0);
    for _ in 0..FRAMES {
        let report = world.step(frame_dt, &[]);
        substeps += u64::from(report.substeps);
        hash = report.state_hash;
    }
    Ok([
        FRAMES.to_string(),
        substeps.to_string(),
        format!("{hash:016x}"),
    ])
}

/// The record: per scene what [`result`] gives.
fn recorded(path: &Path) -> anyhow::Result<BTreeMap<String, [String; 3]>> {
    if !path.exists() {
        return Ok(BTreeMap::new());
    }
    let text =
        fs::read_to_string(path).with_context(|| format!("cannot read {}", path.display()))?;
    let mut lines = text.lines();
    let header = HEADER.join(",");
    let found = lines.next().unwrap_or_default();
    if found != header {
        bail!(
            "{} begins with '{found}', expected '{header}'",
            path.display()
        );
    }
    let fields = lines.enumerate().map(|(n, line)| {
        let fields: Vec<String> = line.split(',').map(str::to_owned).collect();
        <[String; 4]>::try_from(fields)
            .map(|[scene, frames, substeps, hash]| (scene, [frames, substeps, hash]))
            .map_err(|fields| {
                let (line, count) = (n + 2, fields.len());
                anyhow::anyhow!(
                    "{} line {line} has {count} fields, expected 4",
                    path.display()
                )
            })
    });
    fields.collect()
}

/// Runs the comparison.
///
/// # Errors
/// When a scene cannot be loaded, the record cannot be read or written, or a result is not the one on record.
pub fn run(args: &Args) -> anyhow::Result<()> {
    let mut record = recorded(&args.record)?;
    let files = scenes::files(&args.scenes)?;
    let bar = progress::bar("bench golden", files.len() as u64);
    let mut moved = Vec::new();
    for (file, text) in &files {
        let name = file.display().to_string();
        bar.set_message(name.clone());
        let found = result(scenes::load(file, text, args.data.as_deref())?.scene)?;
        let before = record.insert(name.clone(), found.clone());
        let [_, substeps, hash] = &found;
        let told = match before {
            Some(before) if before == found => None,
            Some([_, substeps_before, hash_before]) => Some(format!(
                "{name}: {hash} for {hash_before}, substeps {substeps} for {substeps_before}"
            )),
            None => Some(format!(
                "{name}: {hash}, substeps {substeps}, not on record"
            )),
        };
        if let Some(told) = told {
            bar.suspend(|| say!("{told}"))?;
            moved.push(name);
        }
        bar.inc(1);
    }
    bar.finish_and_clear();
    if args.write {
        let rows: Vec<Vec<String>> = record
            .into_iter()
            .map(|(scene, fields)| [vec![scene], fields.to_vec()].concat())
            .collect();
        fs::write(&args.record, csv(&HEADER, &rows))
            .with_context(|| format!("cannot write {}", args.record.display()))?;
        note!("wrote {}", args.record.display());
    } else if !moved.is_empty() {
        bail!(
            "{} of {} scenes moved: {}",
            moved.len(),
            files.len(),
            moved.join(", ")
        );
    } else {
        say!("{} scenes as on record", files.len())?;
    }
    Ok(())
}
