//! `cosplat bench`: hands over to `cosplat-bench`, so that who simulates does not build charts.

use std::{env, ffi::OsString, os::unix::process::CommandExt, process::Command};

use anyhow::Context;

/// Measure this machine, and hold the solver against known answers.
///
/// The measurements are the program `cosplat-bench`: `cargo build --release -p cosplat-bench` makes it.
#[derive(clap::Args)]
#[command(disable_help_flag = true)]
pub struct Args {
    /// What to measure, and how; --help tells.
    #[arg(trailing_var_arg = true, allow_hyphen_values = true)]
    words: Vec<OsString>,
}

/// Becomes `cosplat-bench` beside this program.
///
/// # Errors
/// When it is not there.
pub fn run(args: &Args) -> anyhow::Result<()> {
    let own = env::current_exe().context("cannot find this program's own file")?;
    let bench = own.with_file_name("cosplat-bench");
    let profile = if cfg!(debug_assertions) {
        ""
    } else {
        " --release"
    };
    Err(Command::new(&bench).args(&args.words).exec()).with_context(|| {
        format!(
            "cannot start {}, which this makes: cargo build{profile} -p cosplat-bench",
            bench.display()
        )
    })
}
