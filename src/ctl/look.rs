//! What `cosplat ctl` says of a session without an order: who runs, what is seen, what the server does.

use std::time::Duration;

use anyhow::Context;
use cosplat_ipc::{
    Domain,
    client::Client,
    list_sessions,
    schema::{SERVER_PAUSED, SERVER_STOPPING, SERVER_WAITING, Status, str_from_padded},
};
use serde_json::json;

use super::Args;
use crate::{say, viewpoint::Viewpoint};

/// Lists running sessions.
pub fn list(domain: &Domain, json: bool) -> anyhow::Result<()> {
    let sessions = list_sessions(domain);
    if json {
        let rows: Vec<_> = sessions
            .iter()
            .map(|s| json!({ "session": s.name, "pid": s.pid }))
            .collect();
        say!("{}", json!({ "sessions": rows }))?;
    } else if sessions.is_empty() {
        say!("no session is running; start one with: cosplat serve SCENE.toml")?;
    } else {
        for session in &sessions {
            say!("{}  (process {})", session.name, session.pid)?;
        }
    }
    Ok(())
}

/// Says what is seen at a pixel.
pub fn pick(
    domain: &Domain,
    args: &Args,
    pixel: &[u32],
    viewpoint: &Viewpoint,
) -> anyhow::Result<()> {
    let client = Client::connect(domain, &args.session, "controller", args.timeout)?;
    let scene = client.scene(args.timeout)?;
    let frame = client.frames(1)?.next(args.timeout)?;
    let frame = frame.with_context(|| format!("session \"{}\" sent no frame", args.session))?;
    let camera = viewpoint.look().camera(scene.header());
    let at = [pixel[0], pixel[1]].map(|x| x as f32 + 0.5);
    let seen = cosplat_renderer::pick(frame.gaussians(), &camera, at);
    let name = |id: u32| {
        let objects = scene.objects();
        let info = objects.get(id as usize);
        info.and_then(|info| str_from_padded(&info.name).ok())
    };
    match seen {
        _ if args.json => {
            let name = seen.and_then(|seen| name(seen.object));
            say!(
                "{}",
                json!({ "seen": seen, "name": name, "step": frame.header().step })
            )
        }
        None => say!("nothing is seen there"),
        Some(seen) => {
            let [x, y, z] = seen.point;
            let name = name(seen.object).unwrap_or_default();
            say!("{name} (object {}) at {x} {y} {z}", seen.object)
        }
    }?;
    Ok(())
}

/// Says what the server is doing.
pub fn status(domain: &Domain, args: &Args, timeout: Duration) -> anyhow::Result<()> {
    let client = Client::connect(domain, &args.session, "controller", timeout)?;
    let mut reader = client.status()?;
    let status = reader
        .next(timeout)?
        .with_context(|| format!("session \"{}\" sent no status", args.session))?;
    if args.json {
        say!("{}", status_json(&status))?;
    } else {
        say!(
            "{} at step {}, {:.3} s simulated: {:.1} steps/s, {:.2} x real time, {}\n\
             energy {:.4} J kinetic, {:.4} J elastic, {:.4} J potential\n\
             {} frames published, {} skipped; {} commands accepted, {} refused; {} particles left, {} quarantined",
            state_name(&status),
            status.step,
            status.sim_time,
            status.steps_per_second,
            status.real_time_factor,
            substep(&status),
            status.kinetic_energy,
            status.elastic_energy,
            status.potential_energy,
            status.frames_published,
            status.frames_skipped,
            status.commands_accepted,
            status.commands_refused,
            status.particles_left,
            status.particles_quarantined,
        )?;
    }
    Ok(())
}

/// The substep of the latest frame; where everything rests there is none.
fn substep(status: &Status) -> String {
    match status.dt > 0.0 {
        true => format!("dt {:.3e} s", status.dt),
        false => "no substeps".into(),
    }
}

fn state_name(status: &Status) -> &'static str {
    match status.server_state {
        SERVER_PAUSED => "paused",
        SERVER_STOPPING => "stopping",
        SERVER_WAITING => "waiting",
        _ => "running",
    }
}

fn status_json(status: &Status) -> serde_json::Value {
    json!({
        "state": state_name(status),
        "step": status.step,
        "sim_time": status.sim_time,
        "steps_per_second": status.steps_per_second,
        "real_time_factor": status.real_time_factor,
        "modelled_fraction": status.modelled_fraction,
        "dt": status.dt,
        "kinetic_energy": status.kinetic_energy,
        "elastic_energy": status.elastic_energy,
        "potential_energy": status.potential_energy,
        "linear_momentum": status.linear_momentum,
        "angular_momentum": status.angular_momentum,
        "frames_published": status.frames_published,
        "frames_skipped": status.frames_skipped,
        "rollbacks": status.rollbacks,
        "particles_left": status.particles_left,
        "particles_quarantined": status.particles_quarantined,
        "commands_accepted": status.commands_accepted,
        "commands_refused": status.commands_refused,
        "state_hash": format!("{:016x}", status.state_hash),
        "pid": status.pid,
    })
}
