//! `cosplat bench`: measurements.

#[path = "bench_fidelity.rs"]
mod fidelity;
#[path = "bench_kernel/mod.rs"]
mod kernel;
#[path = "bench_physgaussian.rs"]
mod physgaussian;
#[path = "bench_table1.rs"]
mod table1;
#[path = "bench_transport.rs"]
mod transport;

use std::path::{Path, PathBuf};

use anyhow::bail;

use crate::{bench_precision, bench_stability, bench_validate};

/// Measure this machine.
#[derive(clap::Args)]
pub struct Args {
    #[command(subcommand)]
    what: What,
}

#[derive(clap::Subcommand)]
enum What {
    Documents(Documents),
    Fidelity(fidelity::Args),
    Kernel(kernel::Args),
    Physgaussian(physgaussian::Args),
    Precision(bench_precision::Args),
    Stability(bench_stability::Args),
    Table1(table1::Args),
    Transport(transport::Args),
    Validate(bench_validate::Args),
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
            bench_validate::run(&bench_validate::Args::documents(folder)),
        ),
        (
            "stability",
            bench_stability::run(&bench_stability::Args::documents(folder)),
        ),
        (
            "precision",
            bench_precision::run(&bench_precision::Args::documents(folder)),
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

/// Runs the measurement.
///
/// # Errors
/// When it could not be made.
pub fn run(args: &Args) -> anyhow::Result<()> {
    match &args.what {
        What::Documents(args) => documents(&args.folder),
        What::Fidelity(args) => fidelity::run(args),
        What::Kernel(args) => kernel::run(args),
        What::Physgaussian(args) => physgaussian::run(args),
        What::Precision(args) => bench_precision::run(args),
        What::Stability(args) => bench_stability::run(args),
        What::Table1(args) => table1::run(args),
        What::Transport(args) => transport::run(args),
        What::Validate(args) => bench_validate::run(args),
    }
}
