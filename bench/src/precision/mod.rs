//! `cosplat bench precision`: error against cost, over everything that trades one for the other.

mod case;
mod cases;
mod measure;
mod report;
#[cfg(test)]
mod tests;

use std::path::{Path, PathBuf};

use anyhow::bail;

use crate::{machine::Run, progress, signals};
use cosplat_console::{note, say};

/// Runs of each setting, unless one says otherwise.
const ROUNDS: u64 = 7;

/// Chart the error of results against what they cost.
#[derive(clap::Args)]
pub struct Args {
    /// Only this case; may be given several times.
    #[arg(long = "case", value_name = "CASE")]
    cases: Vec<String>,
    /// Print one JSON object per setting instead of tables.
    #[arg(long)]
    json: bool,
    /// Each setting once, and none that is finer than the default: whether everything still runs.
    #[arg(long)]
    quick: bool,
    /// Write pictures and figures into DIR/precision and tables into DIR/precision.md.
    #[arg(long, value_name = "DIR", num_args = 0..=1, default_missing_value = "docs", conflicts_with = "quick")]
    write: Option<PathBuf>,
    /// Runs of each setting, in turns.
    #[arg(long, default_value_t = ROUNDS, value_parser = clap::value_parser!(u64).range(1..=101))]
    rounds: u64,
}

impl Args {
    /// Everything at full size, written into a folder of documents.
    pub fn documents(folder: &Path) -> Self {
        Self {
            cases: Vec::new(),
            rounds: ROUNDS,
            quick: false,
            json: false,
            write: Some(folder.to_owned()),
        }
    }
}

/// Runs the measurement. A setting that fails is shown failing; a case whose reference run fails is left out and
/// said so at the end.
///
/// # Errors
/// When a case is unknown or could not be run, or nothing can be written.
pub fn run(args: &Args) -> anyhow::Result<()> {
    let known = cases::ALL.map(|case| case.name);
    if let Some(wanted) = args.cases.iter().find(|w| !known.contains(&w.as_str())) {
        bail!(
            "unknown case '{wanted}', expected one of {}",
            known.join(", ")
        );
    }
    let chosen = |name: &str| args.cases.is_empty() || args.cases.iter().any(|w| w == name);
    if let Some(folder) = &args.write {
        report::check(folder)?;
    }
    let here = Run::here();
    let stop = signals::stop_flag()?;
    let rounds = if args.quick { 1 } else { args.rounds as usize };
    let coarse = |setting: &case::Setting| !args.quick || setting.is_coarse();
    let mut results = Vec::new();
    let mut failed = Vec::new();
    for case in cases::ALL.iter().filter(|case| chosen(case.name)) {
        let bar = progress::bar(case.name, 0);
        match measure::measure(case, rounds, coarse, &bar, &stop) {
            Ok(result) => {
                bar.finish_and_clear();
                note!("{}: {:.0} s", case.name, result.seconds);
                if args.json {
                    report::print_lines(&result, &here)?;
                } else {
                    say!("{}", report::table(&result))?;
                }
                if let Some(folder) = &args.write {
                    report::write_case(folder, &result, &here)?;
                }
                results.push(result);
            }
            Err(error) => {
                bar.finish_and_clear();
                if stop.load(std::sync::atomic::Ordering::Relaxed) {
                    return Err(error);
                }
                note!("{} cannot be measured: {error:#}", case.name);
                failed.push(case.name);
            }
        }
    }
    if let Some(folder) = &args.write
        && args.cases.is_empty()
    {
        report::write_all(folder, &results, &failed, &here)?;
    }
    if !failed.is_empty() {
        bail!("not measured: {}", failed.join(", "));
    }
    Ok(())
}
