//! `cosplat record`: every step of a session into an MCAP file.

use std::path::PathBuf;
use std::time::Duration;

use cosplat_ipc::{Domain, session_name};
use cosplat_recorder::client::{RecordOptions, Summary, record};
use cosplat_recorder::parts::Split;
use cosplat_recorder::writer::{Compression, WriterOptions};

use crate::{progress, say, seconds, signals};

/// Record every step of a session as MCAP.
#[derive(clap::Args)]
pub struct Args {
    /// Name of the session.
    #[arg(long, default_value = "default", value_parser = session_name)]
    session: String,
    /// The recording.
    #[arg(short, long)]
    output: PathBuf,
    /// Compression of chunks. Moving splats shrink by 0 % (lz4) to 10 % (zstd), at a third of the speed.
    #[arg(long, value_enum, default_value_t = CompressionName::None)]
    compression: CompressionName,
    /// Go on in another file after the step that brings one to this size: bytes, or with K, M or G behind the number.
    /// RUN.mcap becomes RUN-0001.mcap, RUN-0002.mcap and so on, each of which can be read by itself.
    #[arg(long, value_parser = size)]
    split_size: Option<u64>,
    /// Go on in another file after this much simulated time [s].
    #[arg(long, value_parser = seconds::number)]
    split_duration: Option<f64>,
    /// Keep a checkpoint of the simulation in the recording at once, and then one each this much simulated time [s]. The server
    /// writes them to its folder, and the recorder takes them from there. Parts of the recording then begin with one, and can
    /// be verified and branched by themselves.
    #[arg(long, value_parser = seconds::positive)]
    checkpoint_every: Option<f64>,
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

/// Reads a size of at least a byte.
fn size(text: &str) -> Result<u64, String> {
    let (digits, unit) = match text.trim().char_indices().next_back() {
        Some((at, 'K')) => (&text[..at], 1 << 10),
        Some((at, 'M')) => (&text[..at], 1 << 20),
        Some((at, 'G')) => (&text[..at], 1 << 30),
        _ => (text.trim(), 1),
    };
    let bytes = digits.parse().ok().and_then(|n: u64| n.checked_mul(unit));
    bytes.filter(|bytes| *bytes > 0).ok_or_else(|| {
        format!(
            "expected a number of bytes, 1 or more, with K, M or G behind it or not, not {text:?}"
        )
    })
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
        split: Split {
            bytes: args.split_size,
            seconds: args.split_duration,
        },
        checkpoint_every: args.checkpoint_every,
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_are_read_or_refused_in_a_sentence() {
        assert_eq!(size("1"), Ok(1));
        assert_eq!(size("64M"), Ok(64 << 20));
        assert_eq!(size("3G"), Ok(3 << 30));
        for bad in ["0", "-1", "", "M", "1T", "1e9", "99999999999G"] {
            let error = size(bad).expect_err(bad);
            assert!(error.contains(&format!("{bad:?}")), "{error}");
        }
    }
}
