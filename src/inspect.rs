//! `cosplat inspect`: says what a recording holds.

use std::path::PathBuf;

use cosplat_replay::survey::{RunSurvey, Survey};

use crate::say;

/// Say what a recording holds.
#[derive(clap::Args)]
pub struct Args {
    /// The recording.
    recording: PathBuf,
    /// Print one JSON object.
    #[arg(long)]
    json: bool,
}

/// Runs the command.
///
/// # Errors
/// When the file cannot be read, or is damaged or unfinished.
pub fn run(args: &Args) -> anyhow::Result<()> {
    let survey = Survey::of(&args.recording)?;
    if args.json {
        return say!("{}", serde_json::to_string(&survey)?);
    }
    let runs = survey.runs.len();
    say!(
        "{}: {:.1} MB, {runs} {} of a server",
        survey.path.display(),
        survey.bytes as f64 / 1e6,
        plural(runs as u64, "run")
    )?;
    for (n, run) in survey.runs.iter().enumerate() {
        print(n + 1, run)?;
    }
    say!("messages")?;
    for (topic, traffic) in &survey.topics {
        say!(
            "  {topic:<14} {:>8}  {:>12} bytes",
            traffic.messages,
            traffic.bytes
        )?;
    }
    say!("attachments")?;
    for (name, bytes) in &survey.attachments {
        say!("  {name:<40} {bytes:>12} bytes")?;
    }
    Ok(())
}

fn print(n: usize, run: &RunSurvey) -> anyhow::Result<()> {
    say!(
        "run {n}: session {:?}, recorded by cosplat {}",
        run.session,
        run.program_version
    )?;
    say!(
        "  scene {:016x}: {} Gaussians on {} particles in {} {}: {}",
        run.scene_hash.0,
        run.gaussians,
        run.particles,
        run.objects.len(),
        plural(run.objects.len() as u64, "object"),
        run.objects.join(", ")
    )?;
    match (run.steps, run.sim_time) {
        (Some([first, last]), Some([start, end])) => say!(
            "  {} {}, steps {first} to {last}, {start:.3} s to {end:.3} s simulated in {:.3} s, {} state hashes",
            run.frames,
            plural(run.frames, "frame"),
            run.wall_seconds,
            run.hashes
        )?,
        _ => say!("  no frames")?,
    }
    if run.resets > 0 {
        say!("  reset {} times", run.resets)?;
    }
    if run.has_checkpoint {
        say!("  began with a checkpoint, which is in the file")?;
    }
    if let (Some(first), Some(last)) = (run.checkpoints.first(), run.checkpoints.last()) {
        let count = run.checkpoints.len() as u64;
        say!(
            "  {count} {} of it, the first after step {first}, the last after step {last}",
            plural(count, "checkpoint")
        )?;
    }
    for gap in &run.gaps {
        let reason = serde_json::to_value(gap.reason)?;
        let reason = reason.as_str().unwrap_or_default().replace('_', " ");
        match gap.to_step {
            Some(last) => say!("  steps {} to {last} are missing: {reason}", gap.from_step)?,
            None => say!("  steps from {} on are missing: {reason}", gap.from_step)?,
        }
    }
    for untold in &run.untold {
        say!(
            "  steps {} to {} are missing, and /gaps does not say so",
            untold.from_step,
            untold.to_step
        )?;
    }
    for client in &run.clients {
        let commands = client.commands.iter();
        let list: Vec<_> = commands
            .map(|(name, count)| format!("{count} {name}"))
            .collect();
        say!(
            "  commands of client {:016x}: {}",
            client.client.0,
            list.join(", ")
        )?;
    }
    if run.clients.is_empty() {
        say!("  no commands")?;
    }
    if !run.files.is_empty() {
        say!("  made of the files {}", run.files.join(", "))?;
    }
    match run.lacks.is_empty() && run.untold.is_empty() {
        true => say!("  can be verified"),
        false => {
            for lack in &run.lacks {
                say!("  cannot be verified: {lack}")?;
            }
            Ok(())
        }
    }
}

/// A word for so many.
pub(crate) fn plural(count: u64, word: &str) -> String {
    match count {
        1 => word.to_owned(),
        _ => format!("{word}s"),
    }
}
