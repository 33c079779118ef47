//! `cosplat verify`: simulates what was recorded again and compares every step.

use std::path::PathBuf;

use anyhow::bail;
use cosplat_replay::verify::{Difference, Outcome, verify};

use crate::{progress, say, threads};

/// Simulate what was recorded again, from the recording alone, and compare every step.
///
/// State hashes, Gaussians and objects are compared bit for bit. The exit status is 0 only if all of them agree.
#[derive(clap::Args)]
pub struct Args {
    /// The recording.
    recording: PathBuf,
    /// Threads of the solver; 0 means one per core. Results do not depend on it.
    #[arg(long, default_value_t = 0, value_parser = threads)]
    threads: usize,
    /// Print the outcome as one JSON object.
    #[arg(long)]
    json: bool,
}

/// Runs the command.
///
/// # Errors
/// When the file cannot be read, or a step differs or cannot be compared.
pub fn run(args: &Args) -> anyhow::Result<()> {
    let bar = progress::bar("verifying frames", 0);
    let outcome = verify(&args.recording, args.threads, |done, frames| {
        bar.set_length(frames);
        bar.set_position(done);
    })?;
    bar.finish_and_clear();
    match args.json {
        true => say!("{}", serde_json::to_string(&outcome)?)?,
        false => print(&outcome)?,
    }
    match outcome.verified {
        true => Ok(()),
        false => bail!("{} is not verified", args.recording.display()),
    }
}

fn print(outcome: &Outcome) -> anyhow::Result<()> {
    let count = outcome.runs.len();
    for (n, run) in outcome.runs.iter().enumerate() {
        say!("run {} of {count}, session {:?}:", n + 1, run.session)?;
        if let Some(step) = run.from_checkpoint {
            say!("  taken up from the checkpoint of step {step}")?;
            if run.steps_before > 0 {
                say!(
                    "  {} steps before it were not compared, as commands before them are not in the file",
                    run.steps_before
                )?;
            }
        }
        if let Some([first, last]) = run.steps {
            say!(
                "  {} steps from {first} to {last} agree, {} of them Gaussian by Gaussian, {} object by object, with {} commands and {} checkpoints",
                run.steps_compared,
                run.frames_compared,
                run.objects_compared,
                run.commands,
                run.checkpoints_compared
            )?;
        }
        if let Some(Difference { step, what }) = &run.differs {
            say!("  step {step} is the first that differs:")?;
            for sentence in what {
                say!("    {sentence}")?;
            }
        }
        if let Some(reason) = &run.cannot {
            say!("  cannot be verified: {reason}")?;
        }
    }
    if let Some(damage) = &outcome.damage {
        say!("{damage}")?;
    }
    Ok(())
}
