//! `cosplat ctl`: orders to a running simulation.

use std::{path::PathBuf, time::Duration};

use anyhow::{Context, bail};
use clap::Subcommand;
use cosplat_controller::{
    Answer, Controller,
    order::{MaterialRef, MaterialValue, ObjectRef, Order},
    script::Script,
};
use cosplat_ipc::{
    Domain,
    client::Client,
    list_sessions,
    schema::{MaterialSpec, SERVER_PAUSED, SERVER_STOPPING, SERVER_WAITING, Status},
};
use cosplat_sim_core::materials::Material;
use serde_json::json;

use crate::{say, seconds};

/// Give orders to a running simulation.
#[derive(clap::Args)]
pub struct Args {
    /// Session to talk to.
    #[arg(long, default_value = "default", global = true)]
    session: String,
    /// Seconds to wait for the server and for its answers.
    #[arg(long, value_name = "S", default_value = "5", global = true, value_parser = seconds::duration)]
    timeout: Duration,
    /// Step at whose start the order takes effect; the next one without.
    #[arg(long, value_name = "STEP", default_value_t = 0, global = true)]
    at_step: u64,
    /// Print one JSON object.
    #[arg(long, global = true)]
    json: bool,
    #[command(subcommand)]
    order: Ctl,
}

#[derive(Subcommand)]
enum Ctl {
    /// Give an object an impulse, as a whole or at a point.
    Push {
        /// Object name or id.
        object: ObjectRef,
        /// Impulse X Y Z [N s].
        #[arg(num_args = 3, allow_negative_numbers = true, required = true)]
        impulse: Vec<f64>,
        /// Point X Y Z [m] around which to push.
        #[arg(long, num_args = 3, allow_negative_numbers = true)]
        point: Option<Vec<f64>>,
        /// Radius around the point [m].
        #[arg(long, requires = "point")]
        radius: Option<f64>,
    },
    /// Set an object's velocity.
    SetVelocity {
        /// Object name or id.
        object: ObjectRef,
        /// Velocity X Y Z [m/s].
        #[arg(num_args = 3, allow_negative_numbers = true, required = true)]
        linear: Vec<f64>,
        /// Angular velocity X Y Z [rad/s].
        #[arg(long, num_args = 3, allow_negative_numbers = true)]
        angular: Option<Vec<f64>>,
    },
    /// Set an object's material: a preset, a law with its numbers, or a preset with other numbers.
    SetMaterial {
        /// Object name or id.
        object: ObjectRef,
        /// Preset name.
        #[arg(required_unless_present = "law")]
        preset: Option<String>,
        /// Law, as in a scene file.
        #[arg(long)]
        law: Option<String>,
        /// A number of the material by its key in a scene file; repeatable.
        #[arg(long = "set", value_name = "KEY=NUMBER", value_parser = key_and_number)]
        numbers: Vec<(String, f64)>,
        /// Only this region of the object, counted from 1.
        #[arg(long, default_value_t = 0, hide_default_value = true)]
        region: u32,
    },
    /// Set gravity.
    Gravity {
        /// Acceleration X Y Z [m/s^2].
        #[arg(num_args = 3, allow_negative_numbers = true, required = true)]
        gravity: Vec<f64>,
    },
    /// Move a collider to a pose within one frame.
    MoveCollider {
        /// Collider name or index.
        collider: ObjectRef,
        /// Position of its origin X Y Z [m].
        #[arg(num_args = 3, allow_negative_numbers = true, required = true)]
        translation: Vec<f64>,
        /// Rotation about x, then y, then z [degrees].
        #[arg(long, num_args = 3, allow_negative_numbers = true)]
        rotation_deg: Option<Vec<f64>>,
    },
    /// Hold an object where it is, as a whole or around a point.
    Pin {
        /// Object name or id.
        object: ObjectRef,
        /// Point X Y Z [m] around which to hold it.
        #[arg(long, num_args = 3, allow_negative_numbers = true)]
        point: Option<Vec<f64>>,
        /// Radius around the point [m].
        #[arg(long, requires = "point")]
        radius: Option<f64>,
    },
    /// Let go what is pinned of an object.
    Release {
        /// Object name or id.
        object: ObjectRef,
    },
    /// Let a force act on an object during one step, as a whole or at a point.
    Force {
        /// Object name or id.
        object: ObjectRef,
        /// Force X Y Z [N].
        #[arg(num_args = 3, allow_negative_numbers = true, required = true)]
        force: Vec<f64>,
        /// Torque X Y Z about the centre of mass [N m].
        #[arg(
            long,
            num_args = 3,
            allow_negative_numbers = true,
            conflicts_with = "point"
        )]
        torque: Option<Vec<f64>>,
        /// Point X Y Z [m] around which it acts.
        #[arg(long, num_args = 3, allow_negative_numbers = true)]
        point: Option<Vec<f64>>,
        /// Radius around the point [m].
        #[arg(long, requires = "point")]
        radius: Option<f64>,
    },
    /// Move a collider at a velocity during one step.
    ColliderVelocity {
        /// Collider name or index.
        collider: ObjectRef,
        /// Velocity X Y Z [m/s].
        #[arg(num_args = 3, allow_negative_numbers = true, required = true)]
        linear: Vec<f64>,
        /// Angular velocity X Y Z [rad/s].
        #[arg(long, num_args = 3, allow_negative_numbers = true)]
        angular: Option<Vec<f64>>,
    },
    /// Have the server keep its state in memory under a number, 16 of them at most.
    Save {
        /// The number.
        snapshot: u32,
    },
    /// Go back to a state that was kept.
    Restore {
        /// The number.
        snapshot: u32,
    },
    /// Make steps while the server is paused, and wait until the last frame is sent.
    Step {
        /// How many.
        #[arg(default_value_t = 1)]
        count: u32,
    },
    /// Have the server write its complete state to a file in its `--checkpoints` folder, and wait for the file; with
    /// `--at-step` for the state before that step.
    Checkpoint,
    /// Stop stepping; with `--at-step` the step before is the last.
    Pause,
    /// Step again; a paused server can be resumed at its next step only.
    Resume,
    /// Go to a step of a replay.
    Seek {
        /// The step.
        step: u64,
    },
    /// Go back to the initial state.
    Reset,
    /// Shut the server down.
    Stop,
    /// Send the orders of a script, each at its simulated time.
    Script {
        /// TOML file of `[[order]]` tables.
        file: PathBuf,
    },
    /// Show what the server is doing.
    Status,
    /// List running sessions.
    List,
}

/// Runs the command.
pub fn run(args: &Args) -> anyhow::Result<()> {
    let timeout = args.timeout;
    let domain = Domain::from_env().context("cannot use the session folder")?;
    match &args.order {
        Ctl::List => list(&domain, args.json),
        Ctl::Status => status(&domain, args, timeout),
        Ctl::Script { file } => {
            let text = std::fs::read_to_string(file)
                .with_context(|| format!("cannot read {}", file.display()))?;
            let script = Script::parse(&text).with_context(|| format!("in {}", file.display()))?;
            let mut controller = Controller::connect(&domain, &args.session, timeout)?;
            report(args, &controller.run(&script, &material)?)
        }
        _ => {
            let order = order(&args.order)?;
            let mut controller = Controller::connect(&domain, &args.session, timeout)?;
            let step = match args.order {
                Ctl::Seek { step } => step,
                _ => args.at_step,
            };
            report(args, &controller.send(&[(step, order)], &material)?)
        }
    }
}

/// The order a subcommand stands for.
fn order(ctl: &Ctl) -> anyhow::Result<Order> {
    Ok(match ctl {
        Ctl::Push {
            object,
            impulse,
            point,
            radius,
        } => Order::Push {
            object: object.clone(),
            impulse: vector(impulse)?,
            point: point.as_deref().map(vector).transpose()?,
            radius: *radius,
        },
        Ctl::SetVelocity {
            object,
            linear,
            angular,
        } => Order::SetVelocity {
            object: object.clone(),
            linear: vector(linear)?,
            angular: vector_or_zero(angular)?,
        },
        Ctl::SetMaterial {
            object,
            preset,
            law,
            numbers,
            region,
        } => Order::SetMaterial {
            object: object.clone(),
            region: *region,
            material: MaterialRef::Value(MaterialValue {
                preset: preset.clone(),
                law: law.clone(),
                numbers: numbers.iter().cloned().collect(),
            }),
        },
        Ctl::Gravity { gravity } => Order::Gravity {
            gravity: vector(gravity)?,
        },
        Ctl::MoveCollider {
            collider,
            translation,
            rotation_deg,
        } => Order::MoveCollider {
            collider: collider.clone(),
            translation: vector(translation)?,
            rotation_deg: vector_or_zero(rotation_deg)?,
        },
        Ctl::Pin {
            object,
            point,
            radius,
        } => Order::Pin {
            object: object.clone(),
            point: point.as_deref().map(vector).transpose()?,
            radius: *radius,
        },
        Ctl::Release { object } => Order::Release {
            object: object.clone(),
        },
        Ctl::Force {
            object,
            force,
            torque,
            point,
            radius,
        } => Order::Force {
            object: object.clone(),
            force: vector(force)?,
            torque: vector_or_zero(torque)?,
            point: point.as_deref().map(vector).transpose()?,
            radius: *radius,
        },
        Ctl::ColliderVelocity {
            collider,
            linear,
            angular,
        } => Order::ColliderVelocity {
            collider: collider.clone(),
            linear: vector(linear)?,
            angular: vector_or_zero(angular)?,
        },
        Ctl::Save { snapshot } => Order::Save {
            snapshot: *snapshot,
        },
        Ctl::Restore { snapshot } => Order::Restore {
            snapshot: *snapshot,
        },
        Ctl::Step { count } => Order::Step { count: *count },
        Ctl::Checkpoint => Order::Checkpoint,
        Ctl::Pause => Order::Pause,
        Ctl::Resume => Order::Resume,
        Ctl::Seek { .. } => Order::Seek,
        Ctl::Reset => Order::Reset,
        Ctl::Stop => Order::Stop,
        Ctl::Script { .. } | Ctl::Status | Ctl::List => bail!("not an order"),
    })
}

fn vector(numbers: &[f64]) -> anyhow::Result<[f64; 3]> {
    numbers
        .try_into()
        .with_context(|| format!("{} numbers, expected 3", numbers.len()))
}

fn vector_or_zero(numbers: &Option<Vec<f64>>) -> anyhow::Result<[f64; 3]> {
    numbers.as_deref().map_or(Ok([0.0; 3]), vector)
}

/// Parses `KEY=NUMBER`.
fn key_and_number(text: &str) -> Result<(String, f64), String> {
    let (key, number) = text
        .split_once('=')
        .ok_or_else(|| format!("expected KEY=NUMBER, found {text:?}"))?;
    let number = number
        .trim()
        .parse()
        .map_err(|_| format!("{number:?} is not a number"))?;
    Ok((key.trim().to_owned(), number))
}

/// The wire form of a material.
fn material(value: &MaterialValue) -> Result<MaterialSpec, String> {
    let numbers = value
        .numbers
        .iter()
        .map(|(key, number)| (key.as_str(), *number));
    let material = Material::stated(value.preset.as_deref(), value.law.as_deref(), numbers)
        .map_err(|error| error.to_string())?;
    Ok(MaterialSpec {
        law: material.law.id(),
        region: 0,
        youngs_modulus: material.youngs_modulus,
        poisson_ratio: material.poisson_ratio,
        parameters: material.law.parameters(),
    })
}

/// Prints the answers; a refusal is a failure of the command.
fn report(args: &Args, answers: &[Answer]) -> anyhow::Result<()> {
    let refusals: Vec<_> = answers.iter().filter_map(|a| a.refused.as_ref()).collect();
    if args.json {
        let steps: Vec<_> = answers.iter().map(|a| a.applied_at_step).collect();
        let files: Vec<_> = answers.iter().filter_map(|a| a.file.as_ref()).collect();
        say!(
            "{}",
            json!({
                "acknowledged": answers.len() - refusals.len(),
                "refused": refusals,
                "applied_at_step": steps,
                "files": files,
            })
        )?;
    } else {
        for answer in answers.iter().filter(|a| a.refused.is_none()) {
            match &answer.file {
                None if matches!(args.order, Ctl::Step { .. }) => {
                    say!("step {} is made", answer.applied_at_step)?;
                }
                None => say!("accepted, takes effect at step {}", answer.applied_at_step)?,
                Some(file) => say!("{file}")?,
            }
        }
    }
    match refusals.first() {
        None => Ok(()),
        Some(reason) => bail!("refused: {reason}"),
    }
}

fn list(domain: &Domain, json: bool) -> anyhow::Result<()> {
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

fn status(domain: &Domain, args: &Args, timeout: Duration) -> anyhow::Result<()> {
    let client = Client::connect(domain, &args.session, "controller", timeout)?;
    let mut reader = client.status()?;
    let status = reader
        .next(timeout)?
        .with_context(|| format!("session \"{}\" sent no status", args.session))?;
    if args.json {
        say!("{}", status_json(&status))?;
    } else {
        say!(
            "{} at step {}, {:.3} s simulated: {:.1} steps/s, {:.2} x real time, dt {:.3e} s\n\
             energy {:.4} J kinetic, {:.4} J elastic, {:.4} J potential\n\
             {} frames published, {} skipped; {} commands accepted, {} refused; {} particles left, {} quarantined",
            state_name(&status),
            status.step,
            status.sim_time,
            status.steps_per_second,
            status.real_time_factor,
            status.dt,
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
