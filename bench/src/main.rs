//! `cosplat bench`: measurements, in a program of their own beside `cosplat`.
//!
//! Scenes are run by this very program: a figure never comes from another build than the one that prints it.

#![allow(
    unsafe_code,
    reason = "vector instructions in the yardstick of the kernel"
)]

mod chart;
mod faults;
mod golden;
mod kernel;
mod lockstep;
mod machine;
mod page;
mod precision;
mod process;
mod quantiles;
mod recording;
mod scenes;
mod stability;
mod table1;
mod transport;
mod trial;
mod validate;

use std::{
    path::{Path, PathBuf},
    process::ExitCode,
};

use anyhow::bail;
use clap::{Parser, Subcommand};
use cosplat::child;
use cosplat_console::{progress, signals};

/// Measure this machine, and hold the solver against known answers.
#[derive(Parser)]
#[command(name = "cosplat bench", version, propagate_version = true)]
struct Cli {
    #[command(subcommand)]
    what: What,
}

#[derive(Subcommand)]
enum What {
    Documents(Documents),
    Faults(faults::Args),
    Golden(golden::Args),
    Kernel(kernel::Args),
    Lockstep(lockstep::Args),
    Precision(precision::Args),
    Recording(recording::Args),
    Scenes(scenes::Args),
    Stability(stability::Args),
    Table1(table1::Args),
    Transport(transport::Args),
    Validate(validate::Args),
    // What measurements start as processes of their own.
    #[command(hide = true)]
    Branch(cosplat::branch::Args),
    #[command(hide = true)]
    Compact(cosplat::compact::Args),
    #[command(hide = true)]
    Ctl(cosplat::ctl::Args),
    #[command(hide = true)]
    Inspect(cosplat::inspect::Args),
    #[command(hide = true)]
    Record(cosplat::record::Args),
    #[command(hide = true)]
    Recover(cosplat::recover::Args),
    #[command(hide = true)]
    Serve(cosplat::serve::Args),
    #[command(hide = true)]
    Simulate(cosplat::simulate::Args),
    #[command(hide = true)]
    Verify(cosplat::verify::Args),
    #[command(hide = true)]
    View(cosplat::view::Args),
}

/// Validate, map stability and chart precision at full size, and write all their pages.
#[derive(clap::Args)]
struct Documents {
    /// Folder of `validation.md`, `stability.md` and `precision.md`.
    #[arg(default_value = "docs")]
    folder: PathBuf,
}

/// What cannot be measured does not keep the rest from being written.
fn documents(folder: &Path) -> anyhow::Result<()> {
    let failed: Vec<String> = [
        (
            "validate",
            validate::run(&validate::Args::documents(folder)),
        ),
        (
            "stability",
            stability::run(&stability::Args::documents(folder)),
        ),
        (
            "precision",
            precision::run(&precision::Args::documents(folder)),
        ),
    ]
    .into_iter()
    .filter_map(|(name, result)| Some(format!("bench {name}: {:#}", result.err()?)))
    .collect();
    if !failed.is_empty() {
        bail!("{}", failed.join("\n"));
    }
    Ok(())
}

fn main() -> ExitCode {
    cosplat::start_logging();
    // What records here is to say that its disk is full.
    let prepared = signals::outlive_full_files();
    cosplat::exit_code(prepared.and_then(|()| match Cli::parse().what {
        What::Documents(args) => documents(&args.folder),
        What::Faults(args) => faults::run(&args),
        What::Golden(args) => golden::run(&args),
        What::Kernel(args) => kernel::run(&args),
        What::Lockstep(args) => lockstep::run(&args),
        What::Precision(args) => precision::run(&args),
        What::Recording(args) => recording::run(&args),
        What::Scenes(args) => scenes::run(&args),
        What::Stability(args) => stability::run(&args),
        What::Table1(args) => table1::run(&args),
        What::Transport(args) => transport::run(&args),
        What::Validate(args) => validate::run(&args),
        What::Branch(args) => cosplat::branch::run(&args),
        What::Compact(args) => cosplat::compact::run(&args),
        What::Ctl(args) => cosplat::ctl::run(&args),
        What::Inspect(args) => cosplat::inspect::run(&args),
        What::Record(args) => cosplat::record::run(&args),
        What::Recover(args) => cosplat::recover::run(&args),
        What::Serve(args) => cosplat::serve::run(&args),
        What::Simulate(args) => cosplat::simulate::run(&args),
        What::Verify(args) => cosplat::verify::run(&args),
        What::View(args) => cosplat::view::run(&args),
    }))
}
