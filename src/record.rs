//! `cosplat record`: every step of a session into an MCAP file.

use std::path::PathBuf;
use std::time::Duration;

use cosplat_ipc::Domain;
use cosplat_recorder::client::{RecordOptions, Summary, record};
use cosplat_recorder::writer::{Compression, WriterOptions};

use crate::{progress, say, seconds, signals};

/// Record every step of a session as MCAP.
#[derive(clap::Args)]
pub struct Args {
    /// Name of the session.
    #[arg(long, default_value = "default")]
    session: String,
    /// The recording.
    #[arg(short, long)]
    output: PathBuf,
    /// Compression of chunks. Moving splats shrink by 0 % (lz4) to 10 % (zstd), at a third of the speed.
    #[arg(long, value_enum, default_value_t = CompressionName::None)]
    compression: CompressionName,
    /// Stop after this time [s, wall clock]; without it, at the end of the session or on Ctrl-C.
    #[arg(long, value_parser = seconds::duration)]
    duration: Option<Duration>,
    /// How long to wait for a server [s].
    #[arg(long, value_parser = seconds::duration, default_value = "10")]
    wait: Duration,
    /// Replace an existing file.
    #[arg(long)]
    force: bool,
    /// Print the summary as one JSON object.
    #[arg(long)]
    json: bool,
}

#[derive(Clone, Copy, clap::ValueEnum)]
enum CompressionName {
    None,
    Lz4,
    Zstd,
}

/// Runs the command.
///
/// # Errors
/// When there is no server, or the file cannot be written.
pub fn run(args: &Args) -> anyhow::Result<()> {
    let stop = signals::stop_flag()?;
    let options = RecordOptions {
        domain: Domain::from_env()?,
        session: args.session.clone(),
        output: args.output.clone(),
        writer: WriterOptions {
            compression: match args.compression {
                CompressionName::None => Compression::None,
                CompressionName::Lz4 => Compression::Lz4,
                CompressionName::Zstd => Compression::Zstd,
            },
            overwrite: args.force,
            ..Default::default()
        },
        wait: args.wait,
        duration: args.duration,
    };
    let counter = progress::spinner("recording");
    let summary = record(&options, &stop, |now| {
        counter.set_position(now.frames_recorded);
        if now.missed_steps > 0 {
            counter.set_message(format!("frames, {} steps missed", now.missed_steps));
        }
    })?;
    counter.finish_and_clear();
    match args.json {
        true => say!("{}", serde_json::to_string(&summary)?)?,
        false => print(args, &summary)?,
    }
    Ok(())
}

fn print(args: &Args, summary: &Summary) -> anyhow::Result<()> {
    say!(
        "{}: {} frames, {} commands, {:.1} MB",
        args.output.display(),
        summary.frames_recorded,
        summary.journal_entries,
        summary.bytes as f64 / 1e6
    )?;
    if let (Some(first), Some(last)) = (summary.first_step, summary.last_step) {
        say!(
            "steps {first} to {last}, {} gaps with {} missed steps",
            summary.gaps,
            summary.missed_steps
        )?;
    }
    if let (Some(p50), Some(p99)) = (summary.latency_us.p50, summary.latency_us.p99) {
        say!("latency {p50:.0} us (median), {p99:.0} us (99 %)")?;
    }
    Ok(())
}
