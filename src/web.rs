//! The page in the browser: `cosplat view --web`, with what the command line knows of materials.

use std::path::Path;
use std::sync::{atomic::Ordering, mpsc::sync_channel};
use std::{net::SocketAddr, time::Duration};

use anyhow::anyhow;
use cosplat_console::output::announce;
use cosplat_ipc::Domain;
use cosplat_replay::player::{PlayOptions, Player};
use cosplat_scene::materials::presets::PRESETS;
use cosplat_web::{Options, Server};
use serde_json::{Map, Value, json};

use crate::{ctl, progress, signals};

/// How long a session that this process makes itself is waited for.
const OWN: Duration = Duration::from_secs(30);

/// Serves the page of a session until Ctrl-C.
///
/// # Errors
/// When there is no such session, or the address cannot be had.
pub fn serve(
    address: SocketAddr,
    session: &str,
    patience: Duration,
    read_only: bool,
) -> anyhow::Result<()> {
    let stop = signals::stop_flag()?;
    let options = options(address, session, patience)?;
    let server = Server::bind(Options {
        read_only,
        ..options
    })?;
    announce(
        &server.door().link(),
        server.door().is_local(),
        address,
        "give orders",
    )?;
    server.run(&stop);
    Ok(())
}

/// Serves the page of a recording until Ctrl-C: a replay of it, paused at its first step.
///
/// # Errors
/// When the recording cannot be read, or the address cannot be had.
pub fn replay(
    address: SocketAddr,
    recording: &Path,
    run: Option<usize>,
    read_only: bool,
) -> anyhow::Result<()> {
    let stop = signals::stop_flag()?;
    let session = format!("recording-{}", std::process::id());
    let play = PlayOptions {
        domain: Domain::from_env()?,
        session: session.clone(),
        rate: 1.0,
        endless: true,
        paused: true,
        lossless: false,
    };
    let (told, opened) = sync_channel(1);
    std::thread::scope(|scope| {
        let player = scope.spawn(|| {
            let bar = progress::bar("looking through", 0);
            let player = Player::open(recording, run, &play, &stop, |done, chunks| {
                bar.set_length(chunks as u64);
                bar.set_position(done as u64);
            })?;
            bar.finish_and_clear();
            // Who waits for it has given up, if it is gone.
            let _ = told.send(());
            drop(told);
            player.run()
        });
        let page = || -> anyhow::Result<()> {
            // Nothing comes of a recording that cannot be opened: its error is the player's.
            if opened.recv().is_err() {
                return Ok(());
            }
            let server = Server::bind(Options {
                read_only,
                ..options(address, &session, OWN)?
            })?;
            announce(
                &server.door().link(),
                server.door().is_local(),
                address,
                "give orders",
            )?;
            server.run(&stop);
            Ok(())
        };
        let shown = page();
        stop.store(true, Ordering::Relaxed);
        let played = player.join().map_err(|_| anyhow!("the replay panicked"))?;
        played?;
        shown
    })
}

fn options(address: SocketAddr, session: &str, patience: Duration) -> anyhow::Result<Options> {
    Ok(Options {
        domain: Domain::from_env()?,
        session: session.to_owned(),
        patience,
        address,
        read_only: false,
        presets: presets(),
        materials: Box::new(ctl::material),
    })
}

/// The presets with their numbers, by the keys of a scene file.
fn presets() -> Value {
    let rows = PRESETS.iter().map(|preset| {
        let law = preset.law.entry();
        let mut numbers = Map::new();
        if law.elastic {
            numbers.insert("youngs_modulus_pa".into(), preset.youngs_modulus.into());
            numbers.insert("poisson_ratio".into(), preset.poisson_ratio.into());
        }
        for (parameter, value) in law.parameters.iter().zip(preset.law.parameters()) {
            numbers.insert(parameter.key.into(), value.into());
        }
        json!({ "name": preset.name, "law": law.name, "numbers": numbers })
    });
    rows.collect()
}
