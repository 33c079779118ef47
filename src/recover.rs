//! `cosplat recover`: makes a recording readable whose recorder was killed or whose bytes were damaged.

use std::path::PathBuf;

use crate::say;

/// Repair a recording that was cut off or damaged.
#[derive(clap::Args)]
pub struct Args {
    /// The recording.
    input: PathBuf,
    /// Repaired file [default: the input's name with `.recovered.mcap`].
    #[arg(short, long)]
    output: Option<PathBuf>,
    /// Replace an existing output.
    #[arg(long)]
    force: bool,
    /// Print the report as one JSON object.
    #[arg(long)]
    json: bool,
}

/// Runs the command.
///
/// # Errors
/// When the input is no recording or the output cannot be written.
pub fn run(args: &Args) -> anyhow::Result<()> {
    let output = match &args.output {
        Some(path) => path.clone(),
        None => args.input.with_extension("recovered.mcap"),
    };
    let report = cosplat_recorder::recover::recover(&args.input, &output, args.force)?;
    if args.json {
        say!("{}", serde_json::to_string(&report)?)?;
        return Ok(());
    }
    let steps = match (report.first_step, report.last_step) {
        (Some(first), Some(last)) => format!("{} frames, steps {first} to {last}", report.frames),
        _ => "no frames".to_owned(),
    };
    say!("{}: {steps}", output.display())?;
    match report.was_intact {
        true => say!("the recording was intact")?,
        false => say!(
            "lost: {} bytes, {} damaged chunks, {} damaged attachments; {} messages of the cut-off end have no checksum",
            report.lost_bytes,
            report.chunks_damaged,
            report.attachments_damaged,
            report.messages_unverified
        )?,
    }
    for gap in &report.lost_steps {
        let last = gap.to_step.unwrap_or(gap.from_step);
        say!("lost steps {} to {last}", gap.from_step)?;
    }
    Ok(())
}
