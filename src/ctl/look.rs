//! What `cosplat ctl` says of a session without an order: who runs, what is seen, what the server does.

use std::time::Duration;

use anyhow::Context;
use cosplat_ipc::{
    Domain,
    client::Client,
    list_sessions,
    schema::{
        ObjectInfo, PHASES, SERVER_PAUSED, SERVER_STOPPING, SERVER_WAITING, Status, str_from_padded,
    },
};
use serde_json::json;

use super::Args;
use crate::{
    costs::{self, CostShare},
    say,
    viewpoint::Viewpoint,
};

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
    let scene = client.scene(timeout)?;
    let costs = costs_of(&status, scene.objects());
    if args.json {
        say!("{}", status_json(&status, &costs))?;
    } else {
        let step = match status.step_seconds > 0.0 {
            true => format!(
                "\na step takes {:.3e} s: {}{}",
                status.step_seconds,
                costs::of_phases(&PHASES, &status.phase_shares),
                costs::of_objects(costs)
            ),
            false => String::new(),
        };
        say!(
            "{} at step {}, {:.3} s simulated: {:.1} steps/s, {:.2} x real time, {}\n\
             energy {:.4} J kinetic, {:.4} J elastic, {:.4} J potential\n\
             {} frames published, {} skipped; {} commands accepted, {} refused; {} particles left, {} quarantined{step}",
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

/// The objects that take most of a step's time, the dearest first.
fn costs_of<'a>(status: &Status, objects: &'a [ObjectInfo]) -> Vec<CostShare<'a>> {
    let costs = status.cost_objects.iter().enumerate();
    let costs = costs.filter_map(|(n, &id)| {
        let info = objects.get(id as usize)?;
        Some(CostShare {
            name: str_from_padded(&info.name).unwrap_or_default(),
            share: status.cost_shares[n],
            substeps: format!("{:.1} substeps a step", status.cost_substeps[n]),
            dt: status.cost_dt[n],
            limit: status.cost_limits[n],
            points: status.cost_points[n].into(),
        })
    });
    costs.collect()
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

fn status_json(status: &Status, costs: &[CostShare<'_>]) -> serde_json::Value {
    let phases = PHASES.iter().zip(status.phase_shares);
    let phases: serde_json::Map<_, _> = phases
        .map(|(name, share)| ((*name).to_owned(), share.into()))
        .collect();
    let costs = costs.iter().enumerate().map(|(n, cost)| {
        json!({
            "object": status.cost_objects[n],
            "name": cost.name,
            "share": cost.share,
            "substeps": status.cost_substeps[n],
            "dt_min": cost.dt,
            "dt_limit": costs::LIMITS[cost.limit.min(3) as usize],
            "contact_points": cost.points,
        })
    });
    let costs: Vec<serde_json::Value> = costs.collect();
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
        "step_seconds": status.step_seconds,
        "phases": phases,
        "costs": costs,
    })
}
