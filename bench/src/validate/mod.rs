//! `cosplat bench validate`: cases with a known answer, each a scene file run by `cosplat simulate`.

mod cases;
mod recorded;
mod report;

use std::{
    path::{Path, PathBuf},
    time::Instant,
};

use anyhow::bail;

use crate::{page, progress};
pub use report::{Gate, Row};

/// Run cases with a known answer and hold the results against it.
#[derive(clap::Args)]
pub struct Args {
    /// Only this case, by name or number; may be given several times.
    #[arg(long = "case", value_name = "CASE")]
    cases: Vec<String>,
    /// Say what the cases are and run none.
    #[arg(long)]
    list: bool,
    /// At the size of the test suite instead of the full one.
    #[arg(long)]
    quick: bool,
    /// Print one JSON object per row instead of a table.
    #[arg(long)]
    json: bool,
    /// Replace the table in DIR/validation.md, of all cases at full size.
    #[arg(long, value_name = "DIR", num_args = 0..=1, default_missing_value = "docs", conflicts_with_all = ["cases", "list", "quick"])]
    write: Option<PathBuf>,
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
        }
    }
}

/// How large a case is run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Size {
    /// Seconds, for the test suite.
    Quick,
    /// As the case is defined.
    Full,
}

/// A case with a known answer.
pub struct Case {
    /// Number in the list of recommended cases.
    pub number: u8,
    /// Short name, as on the command line.
    pub name: &'static str,
    /// What it shows, in one line.
    pub about: &'static str,
    /// Runs it.
    pub run: fn(Size) -> anyhow::Result<Vec<Row>>,
}

impl Case {
    fn is(&self, wanted: &str) -> bool {
        wanted == self.name || wanted == self.number.to_string()
    }
}

/// Runs the command.
///
/// # Errors
/// When a case is unknown or cannot be run, a row fails that is not known to, or one passes that is known to fail.
pub fn run(args: &Args) -> anyhow::Result<()> {
    if args.list {
        for case in cases::ALL {
            println!("{:>2} {:<18} {}", case.number, case.name, case.about);
        }
        return Ok(());
    }
    if let Some(folder) = &args.write {
        page::check(&folder.join(report::PAGE), &[report::PART])?;
    }
    let known = || cases::ALL.map(|case| case.name).join(", ");
    for wanted in &args.cases {
        if !cases::ALL.iter().any(|case| case.is(wanted)) {
            bail!("unknown case '{wanted}', expected one of {}", known());
        }
    }
    let chosen = |case: &&&Case| args.cases.is_empty() || args.cases.iter().any(|w| case.is(w));
    let chosen: Vec<&&Case> = cases::ALL.iter().filter(chosen).collect();
    let size = if args.quick { Size::Quick } else { Size::Full };
    let bar = progress::bar("cases", chosen.len() as u64);
    let mut results = Vec::new();
    for case in chosen {
        bar.set_message(case.name);
        let start = Instant::now();
        let rows = (case.run)(size).map_err(|e| e.context(format!("case {}", case.name)))?;
        if args.json {
            for row in &rows {
                bar.suspend(|| -> anyhow::Result<()> {
                    println!("{}", serde_json::to_string(&report::Line::new(case, row))?);
                    Ok(())
                })?;
            }
        }
        results.push((*case, rows, start.elapsed().as_secs_f64()));
        bar.inc(1);
    }
    bar.finish_and_clear();
    if !args.json {
        println!("{}", report::table(&results));
    }
    if let Some(folder) = &args.write {
        page::put(
            &folder.join(report::PAGE),
            &[(report::PART, report::table(&results))],
        )?;
    }
    let surprises: Vec<String> = results
        .iter()
        .flat_map(|(case, rows, _)| rows.iter().filter_map(|row| row.surprise(case.name)))
        .collect();
    if !surprises.is_empty() {
        bail!("{} surprise(s):\n{}", surprises.len(), surprises.join("\n"));
    }
    Ok(())
}
