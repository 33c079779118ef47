//! What was measured, as JSON lines, tables, pictures and the page.

use std::{fmt::Write as _, fs, path::Path};

use anyhow::Context;
use cosplat_console::say;
use serde_json::json;

use super::{
    case::{CELLS, PRESETS},
    measure::{CaseResult, Figures, Measured},
};
use crate::{
    chart::{Emphasis, Figure, Panel, Point, Series, cost_over_front, csv, pareto},
    machine::Run,
    page,
};

/// How far from the front the default may be: a factor in cost or in error.
pub const WITHIN: f64 = 1.2;
/// How many threads every run had.
pub const THREADS: &str = "1 thread";

/// The page, in the folder of documents, and its parts.
const PAGE: &str = "precision.md";
const SUMMARY: &str = "cosplat bench precision summary";
const CHARTS: &str = "cosplat bench precision charts";

/// Whether the page can be written.
///
/// # Errors
/// When it cannot be read or lacks a marker.
pub fn check(folder: &Path) -> anyhow::Result<()> {
    page::check(&folder.join(PAGE), &[SUMMARY, CHARTS])
}

/// The runs that succeeded, with the coordinates of a chart: cost or updates, and error.
fn points(result: &CaseResult, cost: fn(&Figures) -> f64) -> Vec<[f64; 2]> {
    let runs = result.runs.iter();
    runs.map(|run| match &run.result {
        Ok(f) => [cost(f), f.error],
        Err(_) => [f64::NAN; 2],
    })
    .collect()
}

fn wall(f: &Figures) -> f64 {
    f.quartiles()[1]
}

/// Where a run stands against the front of its chart.
#[derive(Clone, Copy)]
pub struct Standing {
    /// Its cost over the smallest cost of a run with no larger error.
    pub cost: f64,
    /// Its error over the smallest error of a run with no larger cost.
    pub error: f64,
}

impl Standing {
    fn of(points: &[[f64; 2]], at: usize) -> Self {
        let swapped: Vec<[f64; 2]> = points.iter().map(|p| [p[1], p[0]]).collect();
        Self {
            cost: cost_over_front(points, at),
            error: cost_over_front(&swapped, at),
        }
    }

    /// Whether it is on the front or near it in one of the two.
    pub fn is_near(self) -> bool {
        self.cost <= WITHIN || self.error <= WITHIN
    }
}

/// One JSON object per setting.
///
/// # Errors
/// Never in practice: what is printed can be written as JSON.
pub fn print_lines(result: &CaseResult, here: &Run) -> anyhow::Result<()> {
    let all = points(result, wall);
    let front = pareto(&all);
    for (i, run) in result.runs.iter().enumerate() {
        let mut line = json!({
            "case": result.case.name,
            "setting": run.setting.label,
            "error_of": result.case.error,
            "against": result.case.against,
            "default": run.setting.is_default(),
            "on_front": front.contains(&i),
            "command": run.command,
            "machine": here.machine,
            "commit": here.commit,
            "flags": here.flags,
            "threads": 1,
        });
        match &run.result {
            Ok(f) => {
                let [q1, median, q3] = f.quartiles();
                line["error"] = json!(f.error);
                line["wall_seconds_per_simulated_second"] = json!([q1, median, q3]);
                line["particle_updates_per_simulated_second"] = json!(f.updates);
                line["particles"] = json!(f.particles);
                line["substeps"] = json!(f.substeps);
                line["runs"] = json!(f.walls.len());
            }
            Err(why) => line["failed"] = json!(why),
        }
        say!("{}", serde_json::to_string(&line)?)?;
    }
    Ok(())
}

/// The table of one case for the terminal.
pub fn table(result: &CaseResult) -> String {
    let mut text = format!(
        "{}: {}\n| setting | error | wall s per simulated s | million updates per simulated s |\n| --- | --: | --: | --: |\n",
        result.case.name, result.case.title
    );
    for run in &result.runs {
        let _ = match &run.result {
            Ok(f) => {
                let [q1, median, q3] = f.quartiles();
                writeln!(
                    text,
                    "| {} | {} | {median:.3} ({q1:.3} to {q3:.3}) | {:.3} |",
                    run.setting.label,
                    percent(f.error),
                    f.updates / 1e6
                )
            }
            Err(why) => writeln!(text, "| {} | failed: {why} | | |", run.setting.label),
        };
    }
    text
}

fn percent(error: f64) -> String {
    let percent = 100.0 * error;
    match percent {
        p if p >= 10.0 => format!("{p:.0} %"),
        p if p >= 1.0 => format!("{p:.1} %"),
        p if p >= 0.1 => format!("{p:.2} %"),
        p if p >= 0.001 => format!("{p:.4} %"),
        p => format!("{p:.1e} %"),
    }
}

/// Picture and figures of a case.
///
/// # Errors
/// When they cannot be written.
pub fn write_case(folder: &Path, result: &CaseResult, here: &Run) -> anyhow::Result<()> {
    let folder = folder.join("precision");
    fs::create_dir_all(&folder).with_context(|| format!("cannot make {}", folder.display()))?;
    let write = |name: String, text: String| {
        let path = folder.join(name);
        fs::write(&path, text).with_context(|| format!("cannot write {}", path.display()))
    };
    let name = result.case.name;
    write(format!("{name}.svg"), figure(result, here).svg()?)?;
    write(format!("{name}.csv"), figures(result, here))
}

fn figure(result: &CaseResult, here: &Run) -> Figure {
    let case = result.case;
    let rounds = result.runs.iter().filter_map(|r| r.result.as_ref().ok());
    let rounds = rounds.map(|f| f.walls.len()).min().unwrap_or(0);
    let reference = result.reference.as_ref().map(|(command, _)| {
        format!("Reference run: {command}. Errors near its own resolution come out too small.")
    });
    let mut caption = vec![format!(
        "Error against {}. Medians and quartiles of {rounds} runs in turns. {}",
        case.against,
        here.caption(THREADS)
    )];
    caption.extend(reference);
    Figure {
        title: case.title.into(),
        panels: vec![
            panel(result, "wall seconds per simulated second", wall, true),
            panel(
                result,
                "particle-updates per simulated second",
                |f| f.updates,
                false,
            ),
        ],
        caption,
    }
}

fn panel(result: &CaseResult, x: &str, cost: fn(&Figures) -> f64, ranges: bool) -> Panel {
    let point = |family: &str, (i, label): &(usize, String)| {
        let run: &Measured = &result.runs[*i];
        let figures = run.result.as_ref().ok();
        let emphasis = match (family, run.setting.is_default()) {
            (PRESETS, true) => Emphasis::Default,
            (PRESETS, false) => Emphasis::Named,
            _ => Emphasis::None,
        };
        Point {
            x: figures.map_or(f64::NAN, cost),
            x_range: figures.filter(|_| ranges).map(|f| {
                let [q1, _, q3] = f.quartiles();
                [q1, q3]
            }),
            y: figures.map_or(f64::NAN, |f| f.error),
            // The default stands in every family; its ring says it once.
            label: match (family, run.setting.is_default()) {
                (PRESETS, _) | (_, false) => label.clone(),
                _ => String::new(),
            },
            emphasis,
        }
    };
    let has_presets = result.families.iter().any(|f| f.0 == PRESETS);
    let mut series: Vec<Series> = result
        .families
        .iter()
        .map(|(name, places)| Series {
            name: (*name).into(),
            points: places.iter().map(|place| point(name, place)).collect(),
            line: ![PRESETS, "contact", "left vase"].contains(name),
        })
        .collect();
    if !has_presets {
        series.push(Series {
            name: PRESETS.into(),
            points: vec![point(PRESETS, &(0, "balanced".into()))],
            line: false,
        });
    }
    Panel {
        x: x.into(),
        y: result.case.error.into(),
        series,
        front: true,
    }
}

fn figures(result: &CaseResult, here: &Run) -> String {
    let front = pareto(&points(result, wall));
    let header = [
        "case",
        "series",
        "setting",
        "error",
        "wall_s_per_s_q1",
        "wall_s_per_s_median",
        "wall_s_per_s_q3",
        "runs",
        "timed_s",
        "updates_per_s",
        "particles",
        "substeps",
        "default",
        "on_front",
        "command",
        "machine",
        "commit",
        "flags",
        "date",
    ];
    let mut rows = Vec::new();
    for (family, places) in &result.families {
        for (i, label) in places {
            let run = &result.runs[*i];
            let mut row = vec![result.case.name.to_owned(), (*family).into(), label.clone()];
            match &run.result {
                Ok(f) => {
                    let [q1, median, q3] = f.quartiles();
                    row.push(format!("{:.6e}", f.error));
                    row.extend([q1, median, q3].map(|w| format!("{w:.5}")));
                    row.push(f.walls.len().to_string());
                    row.push(format!("{:.4}", f.timed));
                    row.push(format!("{:.6e}", f.updates));
                    row.push(f.particles.to_string());
                    row.push(f.substeps.to_string());
                }
                Err(why) => {
                    row.push(format!("failed: {why}"));
                    row.extend(std::iter::repeat_n(String::new(), 8));
                }
            }
            row.push(run.setting.is_default().to_string());
            row.push(front.contains(i).to_string());
            row.push(run.command.clone());
            row.extend([&here.machine, &here.commit, &here.flags, &here.date].map(String::clone));
            rows.push(row);
        }
    }
    csv(&header, &rows)
}

/// Writes the page's tables of all cases, and that of resolutions, which `cosplat explain` reads. `failed` are
/// those that could not be measured.
///
/// # Errors
/// When a file cannot be written.
pub fn write_all(
    folder: &Path,
    results: &[CaseResult],
    failed: &[&str],
    here: &Run,
) -> anyhow::Result<()> {
    let mut text = summary(results, here);
    if !failed.is_empty() {
        let _ = write!(text, "\nNot measured: {}.\n", failed.join(", "));
    }
    page::put(
        &folder.join(PAGE),
        &[(SUMMARY, text), (CHARTS, charts(results))],
    )?;
    let file = folder.join("precision/resolution.csv");
    fs::write(&file, resolutions(results))
        .with_context(|| format!("cannot write {}", file.display()))
}

fn summary(results: &[CaseResult], here: &Run) -> String {
    let mut text = format!(
        "{}\n\n\
         Error and cost (wall seconds per simulated second, median) of the presets. The last columns say where the \
         default stands against the Pareto front of its chart: by which factor another setting is cheaper without a \
         larger error, and by which factor another is more accurate without a higher cost. Near the front means that \
         one of the two is at most {WITHIN}.\n\n\
         | case | draft | balanced | accurate | default: cheaper by | more accurate by | near the front |\n\
         | --- | --- | --- | --- | --: | --: | --- |\n",
        here.caption(THREADS)
    );
    let mut near = 0;
    for result in results {
        let presets = result.families.iter().find(|f| f.0 == PRESETS);
        let cell = |name: &str| -> String {
            let place = presets.and_then(|(_, places)| places.iter().find(|p| p.1 == name));
            let figures = match place {
                Some((i, _)) => result.runs[*i].result.as_ref().ok(),
                None if name == "balanced" => result.default_run(),
                None => return String::new(),
            };
            figures.map_or("fails".into(), |f| {
                format!("{}, {:.2} s", percent(f.error), wall(f))
            })
        };
        let standing = Standing::of(&points(result, wall), 0);
        near += usize::from(standing.is_near());
        let _ = writeln!(
            text,
            "| [{}](#{}) | {} | {} | {} | {:.2} | {:.2} | {} |",
            result.case.name,
            result.case.name,
            cell("draft"),
            cell("balanced"),
            cell("accurate"),
            standing.cost,
            standing.error,
            if standing.is_near() { "yes" } else { "**no**" }
        );
    }
    let _ = writeln!(
        text,
        "\nNear the front: {near} of {} charts. All charts together took {:.0} s.",
        results.len(),
        results.iter().map(|r| r.seconds).sum::<f64>()
    );
    let failures: Vec<String> = results
        .iter()
        .flat_map(|result| result.runs.iter().map(move |run| (result, run)))
        .filter_map(|(result, run)| {
            let why = run.result.as_ref().err()?;
            Some(format!(
                "- {}, {}: {why}\n",
                result.case.name, run.setting.label
            ))
        })
        .collect();
    if !failures.is_empty() {
        let _ = write!(text, "\nSettings that fail:\n\n{}", failures.concat());
    }
    text
}

fn charts(results: &[CaseResult]) -> String {
    let mut text = String::new();
    for result in results {
        let name = result.case.name;
        let _ = writeln!(
            text,
            "### {name}\n\n{}. Error: {}. Reference: {}. Scene: [`{}`](../{}); figures: \
             [`{name}.csv`](precision/{name}.csv).\n\n![Error against cost of {name}](precision/{name}.svg)\n",
            result.case.title,
            result.case.error,
            result.case.against,
            result.case.scene.path,
            result.case.scene.path
        );
        let all = points(result, wall);
        let front = pareto(&all);
        let names: Vec<String> = front
            .iter()
            .filter_map(|&i| {
                let f = result.runs[i].result.as_ref().ok()?;
                let label = &result.runs[i].setting.label;
                Some(format!("{label} ({}, {:.3} s)", percent(f.error), wall(f)))
            })
            .collect();
        let _ = writeln!(
            text,
            "On the front, from cheap to accurate: {}.\n",
            names.join("; ")
        );
    }
    text
}

/// Errors over the cell size, for `cosplat explain`.
fn resolutions(results: &[CaseResult]) -> String {
    let mut rows = Vec::new();
    for result in results {
        let cells = result.families.iter().find(|f| f.0 == CELLS);
        for (i, label) in cells.map(|c| c.1.as_slice()).unwrap_or_default() {
            if let Ok(f) = &result.runs[*i].result {
                let name = result.case.name.to_owned();
                rows.push(vec![name, label.clone(), format!("{:.3e}", f.error)]);
            }
        }
    }
    csv(&["case", "cells", "error"], &rows)
}
