//! `cosplat replay`: publishes a recording as a session, so that viewers attach to it as to a live run.

use std::path::PathBuf;

use anyhow::Context;
use cosplat_ipc::{Domain, session_name};
use cosplat_replay::player::{PlayOptions, Player};

use crate::{note, progress, say, signals};

/// Publish a recording as a session, so that viewers attach to it as to a live run.
///
/// It takes the orders pause, resume, stop, cancel and seek (`cosplat ctl seek STEP`) and refuses all others.
#[derive(clap::Args)]
pub struct Args {
    /// The recording.
    recording: PathBuf,
    /// Name under which clients find it.
    #[arg(long, default_value = "default", value_parser = session_name)]
    session: String,
    /// How fast: simulated seconds per wall second, 0.001 to 1e6.
    #[arg(long, default_value_t = 1.0, value_parser = rate)]
    rate: f64,
    /// Begin anew at the end.
    #[arg(long = "loop")]
    endless: bool,
    /// Show the first step and wait (`cosplat ctl resume` starts it).
    #[arg(long)]
    paused: bool,
    /// Wait for slow readers instead of skipping a frame when shared memory is used up.
    #[arg(long)]
    lossless: bool,
    /// Which run of the server, counted from 1; needed where the recording holds several.
    #[arg(long, value_name = "N")]
    run: Option<usize>,
    /// Print one JSON object when done.
    #[arg(long)]
    json: bool,
}

fn rate(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(value) if (1e-3..=1e6).contains(&value) => Ok(value),
        _ => Err("expected simulated seconds per wall second, 0.001 to 1e6".into()),
    }
}

/// Runs the command.
///
/// # Errors
/// When the recording cannot be read, or the session cannot be made.
pub fn run(args: &Args) -> anyhow::Result<()> {
    let stop = signals::stop_flag()?;
    let options = PlayOptions {
        domain: Domain::from_env().context("cannot use the session folder")?,
        session: args.session.clone(),
        rate: args.rate,
        endless: args.endless,
        paused: args.paused,
        lossless: args.lossless,
    };
    let bar = progress::bar("looking through", 0);
    let player = Player::open(
        &args.recording,
        args.run,
        &options,
        &stop,
        |done, chunks| {
            bar.set_length(chunks as u64);
            bar.set_position(done as u64);
        },
    )?;
    bar.finish_and_clear();
    let [first, last] = player.range();
    note!(
        "replaying steps {first} to {last} as session {:?}{}",
        args.session,
        if args.paused { ", paused" } else { "" }
    );
    let played = player.run()?;
    if args.json {
        say!("{}", serde_json::to_string(&played)?)?;
    }
    Ok(())
}
