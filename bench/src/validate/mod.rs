//! `cosplat bench validate`: cases with a known answer, each a scene file run by `cosplat simulate`.

mod case;
mod cases;
pub mod measures;
mod recorded;
pub mod report;

use std::{
    path::{Path, PathBuf},
    time::Instant,
};

use anyhow::bail;

use case::{Group, Runs, Size};

use crate::{machine::Run, page, progress};
use cosplat_console::{note, say};

/// Run cases with a known answer and hold the results against it.
#[derive(clap::Args)]
pub struct Args {
    /// Only this case, by name or number; may be given several times.
    #[arg(long = "case", value_name = "CASE")]
    cases: Vec<String>,
    /// Say what the cases are and run none; with --json one object per row.
    #[arg(long)]
    list: bool,
    /// At the size of the test suite instead of the full one.
    #[arg(long)]
    quick: bool,
    /// Print one JSON object per row instead of a table.
    #[arg(long)]
    json: bool,
    /// Replace the table in DIR/validation.md and the rows in DIR/validation, of all cases at full size.
    #[arg(long, value_name = "DIR", num_args = 0..=1, default_missing_value = "docs", conflicts_with_all = ["cases", "list", "quick"])]
    write: Option<PathBuf>,
    /// Say which rows differ from those on record in DIR/validation.
    #[arg(long, value_name = "DIR", num_args = 0..=1, default_missing_value = "docs", conflicts_with_all = ["list", "quick", "write"])]
    against: Option<PathBuf>,
}

impl Args {
    /// Everything at full size, written into a folder of documents.
    pub fn documents(folder: &Path) -> Self {
        Self {
            list: false,
            cases: Vec::new(),
            quick: false,
            json: false,
            write: Some(folder.to_owned()),
            against: None,
        }
    }
}

/// Runs the command.
///
/// # Errors
/// When a case is unknown or cannot be run, a row fails that is not known to, or one passes that is known to fail.
pub fn run(args: &Args) -> anyhow::Result<()> {
    let size = if args.quick { Size::Quick } else { Size::Full };
    if args.list {
        for group in &cases::ALL {
            if !args.json {
                say!("{:>2} {:<18} {}", group.number, group.name, group.about)?;
                continue;
            }
            for case in (group.cases)(size) {
                say!("{}", case.plan(group))?;
            }
        }
        return Ok(());
    }
    if let Some(folder) = &args.write {
        page::check(&folder.join(report::PAGE), &[report::PART])?;
    }
    let known = || cases::ALL.map(|group| group.name).join(", ");
    for wanted in &args.cases {
        if !cases::ALL.iter().any(|group| group.is(wanted)) {
            bail!("unknown case '{wanted}', expected one of {}", known());
        }
    }
    let is_chosen =
        |group: &&Group| args.cases.is_empty() || args.cases.iter().any(|wanted| group.is(wanted));
    let chosen: Vec<&Group> = cases::ALL.iter().filter(is_chosen).collect();
    let here = Run::here();
    let bar = progress::bar("cases", chosen.len() as u64);
    let mut results = Vec::new();
    for group in chosen {
        bar.set_message(group.name);
        let start = Instant::now();
        let mut made = Runs::default();
        let rows = (group.cases)(size)
            .into_iter()
            .map(|case| case.measure(&mut made))
            .collect::<anyhow::Result<Vec<_>>>()
            .map_err(|e| e.context(format!("case {}", group.name)))?;
        if args.json {
            for row in &rows {
                bar.suspend(|| -> anyhow::Result<()> {
                    say!("{}", serde_json::to_string(&report::Line::new(group, row))?)?;
                    Ok(())
                })?;
            }
        }
        results.push((group, rows, start.elapsed().as_secs_f64()));
        bar.inc(1);
    }
    bar.finish_and_clear();
    if !args.json {
        say!("{}", report::table(&results))?;
    }
    if let Some(folder) = &args.write {
        page::put(
            &folder.join(report::PAGE),
            &[(
                report::PART,
                format!(
                    "{}\n\n{}",
                    here.caption("threads as scenes choose"),
                    report::table(&results)
                ),
            )],
        )?;
        report::write_rows(&folder.join(report::ROWS), &results)?;
    }
    if let Some(folder) = &args.against {
        let moved = report::moved(&folder.join(report::ROWS), &results)?;
        let rows: usize = results.iter().map(|(_, rows, _)| rows.len()).sum();
        for row in &moved {
            note!("{row}");
        }
        note!("{} of {rows} rows are not as on record", moved.len());
    }
    let surprises: Vec<String> = results
        .iter()
        .flat_map(|(group, rows, _)| rows.iter().filter_map(|row| row.surprise(group.name)))
        .collect();
    if !surprises.is_empty() {
        bail!(
            "surprises, {} of them:\n{}",
            surprises.len(),
            surprises.join("\n")
        );
    }
    Ok(())
}
