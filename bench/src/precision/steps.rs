//! Multiples of a small time step, as in the literature on implicit MPM for splats: how far do centre of mass and
//! particles drift from the run with the smallest step, and what happens past the stability limit?
//!
//! The measures need every particle, which reports do not have: so this runs the library in this process.

use std::{
    fmt::Write as _,
    fs,
    path::Path,
    sync::atomic::{AtomicBool, Ordering},
    time::Instant,
};

use anyhow::{Context, bail};
use cosplat_reference::ReferenceWorld;
use cosplat_scene::load::load_text;
use cosplat_sim_core::{Scene, World};
use serde::Serialize;

use super::report::THREADS;
use crate::{
    chart::{Emphasis, Figure, Panel, Point, Series, csv},
    machine::Run,
    progress,
};

/// Name on the command line.
pub const NAME: &str = "steps";
/// The step of k = 1, as a share of the stability limit. 20 of them are one and a half limits, as much as the solver
/// lets itself be told.
const SMALLEST: f64 = 0.075;
/// Centre of mass farther off than this, or not a number: failed [m].
const FAILED: f64 = 0.5;
/// Simulated seconds: the ball comes down, and up again.
const DURATION: f64 = 0.35;
/// Cells along the ball.
const CELLS: &str = "8";

/// One multiple with one solver.
#[derive(Clone, Debug, Serialize)]
pub struct Row {
    /// `guarded` is what users run; `no guard` is the reference solver, which has none, in double precision.
    pub solver: &'static str,
    /// Multiple of the smallest step.
    pub k: u32,
    /// Share of the stability limit.
    pub cfl: f64,
    /// Substeps that counted.
    pub substeps: u64,
    /// Segments that the guard took back.
    pub rollbacks: u64,
    /// Particles that the guard set aside.
    pub quarantined: u64,
    /// Wall seconds.
    pub wall_seconds: f64,
    /// Largest distance of the centres of mass over all frames [m]; absent where it is not a number.
    pub comd_max_m: Option<f64>,
    /// Mean over the frames of the mass-weighted root mean square distance of particles [m]; likewise.
    pub mwrmsd_mean_m: Option<f64>,
    /// Mean over the frames of the distance of the centres of mass over 0.5 m, at most 1.
    pub comd_auc: f64,
    /// Whether the distance of the centres of mass passed 0.5 m or was not a number.
    pub failed: bool,
}

/// Per frame: centre of mass and particles.
type Path1 = Vec<([f64; 3], Vec<[f64; 3]>)>;

/// Either solver.
enum Solver {
    Guarded(Box<World>),
    Plain(Box<ReferenceWorld>),
}

fn scene(k: u32) -> anyhow::Result<Scene> {
    let text = include_str!("../../../scenes/precision/bounce.toml");
    let text = text.replace(
        "version = 1",
        &format!("version = 1\ncells_per_object = {CELLS}"),
    );
    let mut scene = load_text(text, Path::new("scenes/precision/bounce.toml"))?.scene;
    scene.cfl = SMALLEST * f64::from(k);
    Ok(scene)
}

/// Mean of positions weighted by volume: one material, so that is the centre of mass.
fn center(positions: &[[f64; 3]], volumes: &[f64]) -> [f64; 3] {
    let total: f64 = volumes.iter().sum();
    [0, 1, 2].map(|a| {
        let moment: f64 = positions.iter().zip(volumes).map(|(x, v)| x[a] * v).sum();
        moment / total
    })
}

fn square(a: &[f64; 3], b: &[f64; 3]) -> f64 {
    (0..3).map(|n| (a[n] - b[n]).powi(2)).sum()
}

fn one(
    k: u32,
    guarded: bool,
    reference: Option<&Path1>,
    stop: &AtomicBool,
) -> anyhow::Result<(Row, Path1)> {
    let scene = scene(k)?;
    let (volumes, frame) = (scene.particles.volume.clone(), 1.0 / scene.frame_rate);
    let frames = (DURATION * scene.frame_rate).round() as usize;
    let cfl = scene.cfl;
    let mut solver = if guarded {
        Solver::Guarded(Box::new(World::new(scene)?))
    } else {
        Solver::Plain(Box::new(ReferenceWorld::new(&scene)))
    };
    let mut row = Row {
        solver: if guarded { "guarded" } else { "no guard" },
        k,
        cfl,
        substeps: 0,
        rollbacks: 0,
        quarantined: 0,
        wall_seconds: 0.0,
        comd_max_m: Some(0.0),
        mwrmsd_mean_m: Some(0.0),
        comd_auc: 0.0,
        failed: false,
    };
    let total: f64 = volumes.iter().sum();
    let mut path = Path1::new();
    for at in 0..frames {
        if stop.load(Ordering::Relaxed) {
            bail!("interrupted");
        }
        let start = Instant::now();
        let (report, positions) = match &mut solver {
            Solver::Guarded(world) => {
                let report = world.step(frame, &[]);
                let positions = world.arrays().position.iter();
                (
                    report,
                    positions.map(|x| x.map(f64::from)).collect::<Vec<_>>(),
                )
            }
            Solver::Plain(world) => {
                let report = world.step(frame, &[]);
                (report, world.particles.arrays().position.to_vec())
            }
        };
        row.wall_seconds += start.elapsed().as_secs_f64();
        row.substeps += u64::from(report.substeps);
        row.rollbacks += u64::from(report.rollbacks);
        row.quarantined += report.quarantined.len() as u64;
        let com = center(&positions, &volumes);
        if let Some((com0, positions0)) = reference.and_then(|r| r.get(at)) {
            let comd = square(&com, com0).sqrt();
            let apart = positions.iter().zip(positions0).zip(&volumes);
            let apart: f64 = apart.map(|((a, b), v)| v * square(a, b)).sum();
            let rmsd = (apart / total).sqrt();
            if !comd.is_finite() || !rmsd.is_finite() || comd > FAILED {
                row.failed = true;
                row.comd_max_m = Some(comd).filter(|c| c.is_finite());
                row.mwrmsd_mean_m = None;
                // What is missing counts as worst.
                row.comd_auc += (frames - at) as f64 / frames as f64;
                break;
            }
            row.comd_max_m = row.comd_max_m.map(|m| m.max(comd));
            row.mwrmsd_mean_m = row.mwrmsd_mean_m.map(|m| m + rmsd / frames as f64);
            row.comd_auc += comd / FAILED / frames as f64;
        }
        path.push((com, positions));
    }
    Ok((row, path))
}

/// Runs all multiples with both solvers, on one thread.
///
/// # Errors
/// When interrupted or when the scene cannot be run.
pub fn sweep(quick: bool, stop: &AtomicBool) -> anyhow::Result<Vec<Row>> {
    let multiples: Vec<u32> = if quick {
        vec![10, 14, 20]
    } else {
        (1..=20).collect()
    };
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1);
    let pool = pool.build().context("cannot start the solver's thread")?;
    let bar = progress::bar(NAME, 2 * multiples.len() as u64);
    let mut rows = Vec::new();
    for guarded in [true, false] {
        let mut reference = None;
        for &k in &multiples {
            bar.set_message(format!("k = {k}"));
            let (row, path) = pool.install(|| one(k, guarded, reference.as_ref(), stop))?;
            rows.push(row);
            reference.get_or_insert(path);
            bar.inc(1);
        }
    }
    bar.finish_and_clear();
    Ok(rows)
}

/// The rows as a Markdown table.
pub fn table(rows: &[Row]) -> String {
    let mut text = String::from(
        "| solver | k | cfl | substeps | rollbacks | set aside | wall [s] | COMD, largest [mm] | mwRMSD, mean [mm] | COMD AUC | failed |\n\
         | --- | --: | --: | --: | --: | --: | --: | --: | --: | --: | --- |\n",
    );
    let mm =
        |value: Option<f64>| value.map_or("not a number".into(), |v| format!("{:.3}", 1e3 * v));
    for row in rows {
        let _ = writeln!(
            text,
            "| {} | {} | {:.3} | {} | {} | {} | {:.2} | {} | {} | {:.4} | {} |",
            row.solver,
            row.k,
            row.cfl,
            row.substeps,
            row.rollbacks,
            row.quarantined,
            row.wall_seconds,
            mm(row.comd_max_m),
            mm(row.mwrmsd_mean_m),
            row.comd_auc,
            if row.failed { "**yes**" } else { "no" }
        );
    }
    text
}

/// The picture of all rows.
fn figure(rows: &[Row], here: &Run) -> Figure {
    let panel = |y: &str, of: fn(&Row) -> Option<f64>| {
        let series = |solver: &'static str| Series {
            name: solver.into(),
            points: rows
                .iter()
                .filter(|row| row.solver == solver && row.k > 1)
                .map(|row| Point {
                    x: row.cfl,
                    x_range: None,
                    y: of(row).unwrap_or(f64::NAN),
                    label: if row.k % 5 == 0 {
                        format!("k = {}", row.k)
                    } else {
                        String::new()
                    },
                    emphasis: Emphasis::None,
                })
                .collect(),
            line: true,
        };
        Panel {
            x: "time step over the stability limit".into(),
            y: y.into(),
            series: vec![series("guarded"), series("no guard")],
            front: false,
        }
    };
    Figure {
        title: "Multiples of the smallest time step: a ball that bounces".into(),
        panels: vec![
            panel("mwRMSD, mean over frames [m]", |row| row.mwrmsd_mean_m),
            panel("COMD, largest over frames [m]", |row| row.comd_max_m),
        ],
        caption: vec![format!(
            "Against k = 1 with the same solver. Failed: COMD above 0.5 m or not a number. {}",
            here.caption(THREADS)
        )],
    }
}

/// Picture and figures.
///
/// # Errors
/// When they cannot be written.
pub fn write(folder: &Path, rows: &[Row], here: &Run) -> anyhow::Result<()> {
    let figure = figure(rows, here);
    let header = [
        "solver",
        "k",
        "cfl",
        "substeps",
        "rollbacks",
        "quarantined",
        "wall_s",
        "comd_max_m",
        "mwrmsd_mean_m",
        "comd_auc",
        "failed",
        "machine",
        "commit",
        "flags",
    ];
    let number = |value: Option<f64>| value.map_or(String::new(), |v| format!("{v:.6e}"));
    let fields = |row: &Row| {
        vec![
            row.solver.to_owned(),
            row.k.to_string(),
            row.cfl.to_string(),
            row.substeps.to_string(),
            row.rollbacks.to_string(),
            row.quarantined.to_string(),
            format!("{:.4}", row.wall_seconds),
            number(row.comd_max_m),
            number(row.mwrmsd_mean_m),
            format!("{:.6}", row.comd_auc),
            row.failed.to_string(),
            here.machine.clone(),
            here.commit.clone(),
            here.flags.clone(),
        ]
    };
    let rows: Vec<Vec<String>> = rows.iter().map(fields).collect();
    let folder = folder.join("precision");
    fs::create_dir_all(&folder)?;
    fs::write(folder.join("steps.svg"), figure.svg()?)?;
    fs::write(folder.join("steps.csv"), csv(&header, &rows))?;
    Ok(())
}
