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

use crate::{bench_precision, bench_stability, bench_validate};

/// Measure this machine.
#[derive(clap::Args)]
pub struct Args {
    #[command(subcommand)]
    what: What,
}

#[derive(clap::Subcommand)]
enum What {
    Fidelity(fidelity::Args),
    Kernel(kernel::Args),
    Physgaussian(physgaussian::Args),
    Precision(bench_precision::Args),
    Stability(bench_stability::Args),
    Table1(table1::Args),
    Transport(transport::Args),
    Validate(bench_validate::Args),
}

/// Runs the measurement.
///
/// # Errors
/// When it could not be made.
pub fn run(args: &Args) -> anyhow::Result<()> {
    match &args.what {
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
