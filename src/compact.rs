//! `cosplat compact`: a finished recording made smaller without loss.

use std::path::PathBuf;

use cosplat_recorder::compact::compact;

use crate::{inspect::plural, progress, say};

/// Write a recording smaller, without loss. What was written is read back and compared with the original.
#[derive(clap::Args)]
pub struct Args {
    /// The recording.
    recording: PathBuf,
    /// The smaller one; without it, beside the recording with `.compact` in its name.
    #[arg(short, long)]
    output: Option<PathBuf>,
    /// Replace an existing file.
    #[arg(long)]
    force: bool,
    /// Print the report as one JSON object.
    #[arg(long)]
    json: bool,
}

/// Runs the command.
///
/// # Errors
/// When the recording is damaged or unfinished, or the output cannot be written or does not come back as it was.
pub fn run(args: &Args) -> anyhow::Result<()> {
    let output = args
        .output
        .clone()
        .unwrap_or_else(|| args.recording.with_extension("compact.mcap"));
    let bar = progress::bar("compacting", 0);
    let report = compact(&args.recording, &output, args.force, |at, total| {
        bar.set_length(total);
        bar.set_position(at);
    })?;
    bar.finish_and_clear();
    match args.json {
        true => say!("{}", serde_json::to_string(&report)?)?,
        false => say!(
            "{}: {:.1} MB of {:.1} MB, {:.0} % of it; {} {}, {} {} compared",
            report.output.display(),
            report.bytes_after as f64 / 1e6,
            report.bytes_before as f64 / 1e6,
            100.0 / report.ratio,
            report.frames,
            plural(report.frames, "frame"),
            report.messages,
            plural(report.messages, "message")
        )?,
    }
    Ok(())
}
