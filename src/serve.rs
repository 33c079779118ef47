//! `cosplat serve`: the simulation process.

use std::{path::PathBuf, sync::atomic::AtomicBool, time::Duration};

use anyhow::{Context, anyhow, bail};
use clap::ValueEnum;
use cosplat_ipc::{Domain, client::check_participant, session_name};
use cosplat_pacing::{
    lockstep::{LockstepOptions, Policy, Terms},
    pace::Pace,
};
use cosplat_scene::load::LoadedScene;
use cosplat_server::serve::{ServeOptions, ServeSummary, serve};
use serde_json::json;

use crate::{note, say, scene_args::SceneArgs, seconds, signals, threads};

/// Simulate a scene and publish every step over shared memory.
#[derive(clap::Args)]
pub struct Args {
    #[command(flatten)]
    scene: SceneArgs,
    /// Begin with this checkpoint of the same scene.
    #[arg(long, value_name = "FILE")]
    restore: Option<PathBuf>,
    #[command(flatten)]
    how: How,
}

/// How a scene is served, whatever it begins with.
#[derive(clap::Args)]
pub struct How {
    /// Name under which clients find this simulation.
    #[arg(long, default_value = "default", value_parser = session_name)]
    session: String,
    /// How simulated time follows wall time.
    #[arg(long, value_enum, default_value_t = PaceName::Realtime)]
    pace: PaceName,
    /// With `--pace lockstep`: names of participants that every step waits for from the first one on, each perhaps with
    /// `=POLICY` or `=POLICY:SECONDS` of its own. Others may join; without a list, who comes first.
    #[arg(long, value_name = "NAME,...", value_delimiter = ',')]
    participants: Vec<String>,
    /// With `--pace lockstep`: seconds for which a participant is waited for; without it for ever.
    #[arg(long, value_name = "S", value_parser = seconds::duration)]
    participant_timeout: Option<Duration>,
    /// With `--pace lockstep`: what is done about a participant that is late, or whose process died.
    #[arg(long, value_enum, default_value_t = PolicyName::Wait)]
    on_timeout: PolicyName,
    /// Threads of the solver; 0 means one per core. Results do not depend on it.
    #[arg(long, default_value_t = 0, value_parser = threads)]
    pub threads: usize,
    /// Simulated seconds after which to stop; without it, runs until Ctrl-C or `cosplat ctl stop`.
    #[arg(long, value_name = "S", value_parser = seconds::number)]
    duration: Option<f64>,
    /// Begin paused, so that clients can attach before the first step (`cosplat ctl resume` starts it).
    #[arg(long)]
    paused: bool,
    /// Wait for slow readers instead of skipping a frame when shared memory is used up.
    #[arg(long)]
    lossless: bool,
    /// Frames in the shared pool; chosen by frame size without.
    #[arg(long, value_name = "N")]
    frame_slots: Option<usize>,
    /// Folder for the checkpoints that clients order with `cosplat ctl checkpoint`.
    #[arg(long, value_name = "DIR", default_value = ".")]
    checkpoints: PathBuf,
    /// Print one JSON object when done.
    #[arg(long)]
    json: bool,
}

/// [`Pace`] on the command line.
#[derive(Clone, Copy, clap::ValueEnum)]
enum PaceName {
    /// One simulated second per wall second.
    Realtime,
    /// As fast as possible.
    Free,
    /// As fast as participants permit, a step each time that all do; in real time while there is none.
    Lockstep,
}

/// [`Policy`] on the command line.
#[derive(Clone, Copy, clap::ValueEnum)]
enum PolicyName {
    /// Go on waiting until it comes back.
    Wait,
    /// Go on without it.
    Drop,
    /// End the session.
    Stop,
}

impl From<PolicyName> for Policy {
    fn from(name: PolicyName) -> Policy {
        match name {
            PolicyName::Wait => Policy::Wait,
            PolicyName::Drop => Policy::Drop,
            PolicyName::Stop => Policy::Stop,
        }
    }
}

impl How {
    /// Refuses what can be refused before anything takes time.
    ///
    /// # Errors
    /// When a participant, the folder for checkpoints or the domain cannot be used.
    pub fn check(&self) -> anyhow::Result<()> {
        self.lockstep()?;
        self.checkpoints()?;
        domain()?;
        Ok(())
    }

    fn checkpoints(&self) -> anyhow::Result<PathBuf> {
        self.checkpoints
            .canonicalize()
            .with_context(|| format!("no folder for checkpoints: {}", self.checkpoints.display()))
    }

    fn lockstep(&self) -> anyhow::Result<LockstepOptions> {
        let concerns = !self.participants.is_empty() || self.participant_timeout.is_some();
        if concerns && !matches!(self.pace, PaceName::Lockstep) {
            bail!("participants are waited for with --pace lockstep alone");
        }
        let terms = Terms {
            timeout: self.participant_timeout,
            policy: self.on_timeout.into(),
        };
        let mut required: Vec<(String, Option<Terms>)> = Vec::new();
        for text in &self.participants {
            let (name, own) = participant(text, terms)?;
            if required.iter().any(|(other, _)| *other == name) {
                bail!("--participants names {name} twice");
            }
            required.push((name, own));
        }
        Ok(LockstepOptions { required, terms })
    }
}

fn domain() -> anyhow::Result<Domain> {
    Domain::from_env().context("cannot use the session folder")
}

/// `NAME`, `NAME=POLICY` or `NAME=POLICY:SECONDS`.
fn participant(text: &str, terms: Terms) -> anyhow::Result<(String, Option<Terms>)> {
    let (name, own) = match text.split_once('=') {
        None => (text, None),
        Some((name, own)) => (name, Some(own)),
    };
    check_participant(name)?;
    let Some(own) = own else {
        return Ok((name.into(), None));
    };
    let (policy, timeout) = match own.split_once(':') {
        None => (own, None),
        Some((policy, timeout)) => (policy, Some(timeout)),
    };
    let policy = PolicyName::from_str(policy, false)
        .map_err(|_| anyhow!("{policy:?} is no policy: expected wait, drop or stop"))?;
    let timeout = match timeout {
        None => terms.timeout,
        Some(text) => Some(seconds::duration(text).map_err(|error| anyhow!("{text}: {error}"))?),
    };
    let policy = policy.into();
    Ok((name.into(), Some(Terms { timeout, policy })))
}

/// Runs the command.
pub fn run(args: &Args) -> anyhow::Result<()> {
    args.how.check()?;
    // Nothing has begun while a scene is loaded: until then a signal ends the process at once, however long that takes.
    let scene = args.scene.load()?;
    let stop = signals::stop_flag()?;
    serve_scene(scene, args.restore.clone(), &args.how, &stop)
}

/// Serves a scene from its start, or from the checkpoint `restore` on, until it ends or `stop` is set.
///
/// # Errors
/// When it cannot be served.
pub fn serve_scene(
    scene: LoadedScene,
    restore: Option<PathBuf>,
    args: &How,
    stop: &AtomicBool,
) -> anyhow::Result<()> {
    for warning in &scene.report.warnings {
        note!("warning: {warning}");
    }
    let options = ServeOptions {
        domain: domain()?,
        session: args.session.clone(),
        pace: match args.pace {
            PaceName::Realtime => Pace::Realtime,
            PaceName::Free => Pace::Free,
            PaceName::Lockstep => Pace::Lockstep,
        },
        lockstep: args.lockstep()?,
        threads: args.threads,
        duration: args.duration,
        paused: args.paused,
        lossless: args.lossless,
        frame_slots: args.frame_slots,
        checkpoints: Some(args.checkpoints()?),
        restore,
    };
    let summary = serve(scene, &options, stop, |summary| {
        note!(
            "serving session \"{}\": {} Gaussians on {} particles in {} objects{}",
            args.session,
            summary.gaussians,
            summary.particles,
            summary.objects,
            if args.paused { ", paused" } else { "" },
        );
    })?;
    if args.json {
        say!("{}", as_json(&args.session, &summary))?;
    } else {
        note!(
            "{} steps, {:.3} s simulated in {:.3} s, {} frames published, {} skipped, state {:016x}",
            summary.steps,
            summary.sim_seconds,
            summary.wall_seconds,
            summary.frames_published,
            summary.frames_skipped,
            summary.state_hash,
        );
    }
    Ok(())
}

fn as_json(session: &str, summary: &ServeSummary) -> serde_json::Value {
    let factor = if summary.wall_seconds > 0.0 {
        summary.sim_seconds / summary.wall_seconds
    } else {
        0.0
    };
    json!({
        "session": session,
        "gaussians": summary.gaussians,
        "particles": summary.particles,
        "objects": summary.objects,
        "steps": summary.steps,
        "frames_published": summary.frames_published,
        "frames_skipped": summary.frames_skipped,
        "sim_seconds": summary.sim_seconds,
        "wall_seconds": summary.wall_seconds,
        "step_seconds": summary.step_seconds,
        "publish_seconds": summary.publish_seconds,
        "real_time_factor": factor,
        "commands_accepted": summary.commands_accepted,
        "commands_refused": summary.commands_refused,
        "state_hash": format!("{:016x}", summary.state_hash),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn participants_have_terms_of_their_own_or_the_common_ones() {
        let second = Some(Duration::from_secs(1));
        let terms = Terms {
            timeout: second,
            policy: Policy::Drop,
        };
        let read = |text| participant(text, terms).map(|(name, own)| (name, own.unwrap_or(terms)));
        let expect = |name: &str, timeout, policy| (name.to_owned(), Terms { timeout, policy });
        let half = Some(Duration::from_millis(500));
        assert_eq!(read("arm").unwrap(), expect("arm", second, Policy::Drop));
        assert_eq!(
            read("arm=stop").unwrap(),
            expect("arm", second, Policy::Stop)
        );
        assert_eq!(
            read("arm=wait:0.5").unwrap(),
            expect("arm", half, Policy::Wait)
        );
        for bad in [
            "",
            "a b",
            "=drop",
            "arm=leave",
            "arm=drop:soon",
            "arm=drop:",
        ] {
            participant(bad, terms).unwrap_err();
        }
    }
}
