//! The `cosplat` command line, one file per subcommand; a library, so that benchmarks run scenes by the same code.

mod bench;
pub mod branch;
mod camera_path;
pub mod child;
pub mod compact;
mod costs;
pub mod ctl;
mod demo;
mod explain;
mod export;
#[cfg(feature = "features")]
mod features;
mod import;
pub mod inspect;
mod manual;
pub mod record;
pub mod recover;
mod replay;
mod scene_args;
pub mod serve;
pub mod simulate;
pub mod verify;
pub mod view;
pub mod viewpoint;
mod web;

use std::process::ExitCode;

use clap::{CommandFactory, Parser, Subcommand};
use cosplat_console::{note, progress, say, seconds, signals, threads::threads};
use cosplat_objects::{lift, pick as objects, refine};

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
    Branch(branch::Args),
    Compact(compact::Args),
    Completions(manual::CompletionsArgs),
    Ctl(ctl::Args),
    Demo(demo::Args),
    Explain(explain::Args),
    Export(export::Args),
    #[cfg(feature = "features")]
    Features(features::Args),
    Import(import::Args),
    Inspect(inspect::Args),
    Lift(lift::LiftArgs),
    Manual(manual::ManualArgs),
    Objects(objects::Args),
    Record(record::Args),
    Recover(recover::Args),
    Refine(refine::Args),
    Replay(replay::Args),
    Serve(serve::Args),
    Simulate(simulate::Args),
    Verify(verify::Args),
    View(view::Args),
    Views(lift::ViewsArgs),
}

/// The program `cosplat`: reads its command line and does what it says.
pub fn main() -> ExitCode {
    start_logging();
    let cli = Cli::parse();
    let bound = cli.parent.map_or(Ok(()), signals::end_with);
    let prepared = signals::outlive_full_files().and(bound);
    exit_code(prepared.and_then(|()| match cli.command {
        Command::Bench(args) => bench::run(&args),
        Command::Branch(args) => branch::run(&args),
        Command::Compact(args) => compact::run(&args),
        Command::Completions(args) => manual::complete(&args, Cli::command()),
        Command::Ctl(args) => ctl::run(&args),
        Command::Demo(args) => demo::run(&args),
        Command::Explain(args) => explain::run(&args),
        Command::Export(args) => export::run(&args),
        #[cfg(feature = "features")]
        Command::Features(args) => features::run(&args),
        Command::Import(args) => import::run(&args),
        Command::Inspect(args) => inspect::run(&args),
        Command::Lift(args) => lift::run(&args),
        Command::Manual(args) => manual::write(&args, Cli::command()),
        Command::Objects(args) => objects::run(&args),
        Command::Record(args) => record::run(&args),
        Command::Recover(args) => recover::run(&args),
        Command::Refine(args) => refine::run(&args),
        Command::Replay(args) => replay::run(&args),
        Command::Serve(args) => serve::run(&args),
        Command::Simulate(args) => simulate::run(&args),
        Command::Verify(args) => verify::run(&args),
        Command::View(args) => view::run(&args),
        Command::Views(args) => lift::run_views(&args),
    }))
}

/// Sends log lines to standard error, those that `COSPLAT_LOG` asks for; warnings without.
pub fn start_logging() {
    tracing_subscriber::fmt()
        .with_env_filter(
            tracing_subscriber::EnvFilter::try_from_env("COSPLAT_LOG")
                .unwrap_or_else(|_| "warn".into()),
        )
        .with_writer(std::io::stderr)
        // A warning that nobody reads any more must not panic about it.
        .log_internal_errors(false)
        .init();
}

/// Prints what went wrong. The code is 0 for success, 2 for input that has to change first, 1 for all else.
pub fn exit_code(outcome: anyhow::Result<()>) -> ExitCode {
    match outcome {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            note!("error: {error:#}");
            // Like a wrong command line: the input has to change before another try makes sense.
            let bad_input = error.is::<cosplat_scene::load::LoadError>()
                || error.is::<cosplat_physgaussian::files::ImportError>();
            ExitCode::from(if bad_input { 2 } else { 1 })
        }
    }
}
