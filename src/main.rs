//! The `cosplat` command line: one file per subcommand.

mod bench;
mod bench_precision;
mod bench_stability;
mod bench_validate;
mod chart;
mod child;
mod ctl;
mod demo;
mod explain;
mod import;
mod machine;
mod page;
mod progress;
mod record;
mod recover;
mod serve;
mod signals;
mod simulate;
mod trial;
mod view;

use std::process::ExitCode;

use clap::{Parser, Subcommand};

/// Physics in 3D Gaussian Splatting scenes: one process simulates, others watch, record and push over shared
/// memory.
#[derive(Parser)]
#[command(version, propagate_version = true)]
struct Cli {
    /// Process that started this one: they end together.
    #[arg(long, value_name = "PID", hide = true)]
    parent: Option<i32>,
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    Bench(bench::Args),
    Ctl(ctl::Args),
    Demo(demo::Args),
    Explain(explain::Args),
    Import(import::Args),
    Record(record::Args),
    Recover(recover::Args),
    Serve(serve::Args),
    Simulate(simulate::Args),
    View(view::Args),
}

fn main() -> ExitCode {
    tracing_subscriber::fmt()
        .with_env_filter(
            tracing_subscriber::EnvFilter::try_from_env("COSPLAT_LOG")
                .unwrap_or_else(|_| "warn".into()),
        )
        .with_writer(std::io::stderr)
        .init();
    let cli = Cli::parse();
    let bound = cli.parent.map_or(Ok(()), signals::end_with);
    let outcome = bound.and_then(|()| match cli.command {
        Command::Bench(args) => bench::run(&args),
        Command::Ctl(args) => ctl::run(&args),
        Command::Demo(args) => demo::run(&args),
        Command::Explain(args) => explain::run(&args),
        Command::Import(args) => import::run(&args),
        Command::Record(args) => record::run(&args),
        Command::Recover(args) => recover::run(&args),
        Command::Serve(args) => serve::run(&args),
        Command::Simulate(args) => simulate::run(&args),
        Command::View(args) => view::run(&args),
    });
    match outcome {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error:#}");
            // Like a wrong command line: the input has to change before another try makes sense.
            let bad_input = error.is::<cosplat_server::load::LoadError>()
                || error.is::<cosplat_server::import::files::ImportError>();
            ExitCode::from(if bad_input { 2 } else { 1 })
        }
    }
}
