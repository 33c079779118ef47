//! `cosplat ctl`: orders to a running simulation.

mod look;

use std::{path::PathBuf, time::Duration};

use anyhow::{Context, bail};
use clap::Subcommand;
use cosplat_controller::{
    Answer, Controller,
    order::{Level, MaterialRef, MaterialValue, ObjectRef, Order},
    script::Script,
};
use cosplat_ipc::{Domain, schema::MaterialSpec, session_name};
use cosplat_scene::materials::stated;
use serde_json::json;

use crate::{say, seconds, viewpoint::Viewpoint};

/// Client number of all that `grab`, `drag` and `let-go` send: each is a process of its own.
const HAND: u64 = 0;

/// Give orders to a running simulation.
#[derive(clap::Args)]
pub struct Args {
    /// Session to talk to.
    #[arg(long, default_value = "default", global = true, value_parser = session_name)]
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

/// Where an object is put.
#[derive(clap::Args)]
struct Place {
    /// Centre of mass X Y Z [m]; where it is without.
    #[arg(long, num_args = 3, allow_negative_numbers = true)]
    at: Option<Vec<f64>>,
    /// Rotation since rest, about x, then y, then z [degrees]; as it is without.
    #[arg(long, num_args = 3, allow_negative_numbers = true)]
    rotation_deg: Option<Vec<f64>>,
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
        /// Point X Y Z [m]: only what is around it.
        #[arg(long, num_args = 3, allow_negative_numbers = true)]
        point: Option<Vec<f64>>,
        /// Radius around the point [m].
        #[arg(long, requires = "point", conflicts_with = "half")]
        radius: Option<f64>,
        /// Half the edges X Y Z [m] of a box around the point, along the axes of the world.
        #[arg(long, num_args = 3, requires = "point")]
        half: Option<Vec<f64>>,
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
    /// Hold a part of an object by a spring; it is let go after a while without `drag`.
    Grab {
        /// Object name or id.
        object: ObjectRef,
        /// Point X Y Z [m] to take hold of.
        #[arg(num_args = 3, allow_negative_numbers = true, required = true)]
        point: Vec<f64>,
        /// Point X Y Z [m] that the spring pulls it to; where it is without.
        #[arg(long, num_args = 3, allow_negative_numbers = true)]
        to: Option<Vec<f64>>,
        /// Radius of the part that is held [m].
        #[arg(long)]
        radius: Option<f64>,
        /// Steps that the hold lasts without `drag`.
        #[arg(long, default_value_t = 600)]
        steps: u32,
    },
    /// Pull what `grab` holds of an object elsewhere.
    Drag {
        /// Object name or id.
        object: ObjectRef,
        /// Point X Y Z [m] to pull it to.
        #[arg(num_args = 3, allow_negative_numbers = true, required = true)]
        to: Vec<f64>,
    },
    /// Let go what `grab` holds of an object.
    LetGo {
        /// Object name or id.
        object: ObjectRef,
    },
    /// Put an object elsewhere, at rest; refused where there is no room for it.
    SetPose {
        /// Object name or id.
        object: ObjectRef,
        #[command(flatten)]
        place: Place,
    },
    /// Model an object as matter (mpm), as one body (rigid), as one body that stands (static), or as simply as allowed (auto).
    SetFidelity {
        /// Object name or id.
        object: ObjectRef,
        /// static, mpm, auto or rigid.
        fidelity: Level,
    },
    /// Take an object out of the world; it keeps its number.
    Remove {
        /// Object name or id.
        object: ObjectRef,
    },
    /// Bring an object in that was removed, or that the scene declares as absent.
    BringIn {
        /// Object name or id.
        object: ObjectRef,
        #[command(flatten)]
        place: Place,
    },
    /// Go back to the state right before the newest edit: of pose, fidelity, material, gravity, pins, of what is there.
    Undo,
    /// Go back to the state that the newest undo left.
    Redo,
    /// Drop all orders that wait for their step, whoever gave them; also steps that a paused server has yet to make.
    Cancel,
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
    /// Say which object is seen at a pixel of the picture that `cosplat view` draws from the same viewpoint, and where.
    Pick {
        /// Column and line of the pixel, from 0 at the upper left.
        #[arg(num_args = 2, required = true, value_names = ["X", "Y"])]
        pixel: Vec<u32>,
        #[command(flatten)]
        viewpoint: Viewpoint,
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
        Ctl::List => look::list(&domain, args.json),
        Ctl::Status => look::status(&domain, args, timeout),
        Ctl::Pick { pixel, viewpoint } => look::pick(&domain, args, pixel, viewpoint),
        Ctl::Script { file } => {
            let text = cosplat_files::reading::read_text(file)
                .with_context(|| format!("cannot read {}", file.display()))?;
            let script = Script::parse(&text).with_context(|| format!("in {}", file.display()))?;
            let mut controller = Controller::connect(&domain, &args.session, timeout)?;
            report(args, &controller.run(&script, &material)?)
        }
        _ => {
            let order = order(&args.order)?;
            let mut controller = match args.order {
                Ctl::Grab { .. } | Ctl::Drag { .. } | Ctl::LetGo { .. } => {
                    Controller::connect_as(&domain, &args.session, timeout, HAND)?
                }
                _ => Controller::connect(&domain, &args.session, timeout)?,
            };
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
            point,
            radius,
            half,
        } => Order::SetMaterial {
            object: object.clone(),
            region: *region,
            point: point.as_deref().map(vector).transpose()?,
            radius: *radius,
            half: half.as_deref().map(vector).transpose()?,
            material: MaterialRef::Value(MaterialValue {
                preset: preset.clone(),
                law: law.clone(),
                numbers: numbers.iter().cloned().collect(),
            }),
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
        Ctl::Grab {
            object,
            point,
            to,
            radius,
            steps,
        } => Order::Grab {
            object: object.clone(),
            point: vector(point)?,
            to: to.as_deref().map(vector).transpose()?,
            radius: *radius,
            steps: *steps,
        },
        Ctl::Drag { object, to } => Order::Drag {
            object: object.clone(),
            to: vector(to)?,
        },
        Ctl::LetGo { object } => Order::LetGo {
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
        other => return edit(other),
    })
}

/// The order of a subcommand that edits an object.
fn edit(ctl: &Ctl) -> anyhow::Result<Order> {
    let vectors = |place: &Place| {
        let vector = |numbers: &Option<Vec<f64>>| numbers.as_deref().map(vector).transpose();
        anyhow::Ok((vector(&place.at)?, vector(&place.rotation_deg)?))
    };
    Ok(match ctl {
        Ctl::SetPose { object, place } => {
            let (position, rotation_deg) = vectors(place)?;
            Order::SetPose {
                object: object.clone(),
                position,
                rotation_deg,
            }
        }
        Ctl::BringIn { object, place } => {
            let (position, rotation_deg) = vectors(place)?;
            Order::BringIn {
                object: object.clone(),
                position,
                rotation_deg,
            }
        }
        Ctl::SetFidelity { object, fidelity } => Order::SetFidelity {
            object: object.clone(),
            fidelity: *fidelity,
        },
        Ctl::Remove { object } => Order::Remove {
            object: object.clone(),
        },
        other => return order_to_server(other),
    })
}

/// The order of a subcommand that concerns no object.
fn order_to_server(ctl: &Ctl) -> anyhow::Result<Order> {
    Ok(match ctl {
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
        Ctl::Undo => Order::Undo,
        Ctl::Redo => Order::Redo,
        Ctl::Cancel => Order::Cancel,
        Ctl::Step { count } => Order::Step { count: *count },
        Ctl::Checkpoint => Order::Checkpoint,
        Ctl::Pause => Order::Pause,
        Ctl::Resume => Order::Resume,
        Ctl::Seek { .. } => Order::Seek,
        Ctl::Reset => Order::Reset,
        Ctl::Stop => Order::Stop,
        _ => bail!("not an order"),
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
pub fn material(value: &MaterialValue) -> Result<MaterialSpec, String> {
    let numbers = value
        .numbers
        .iter()
        .map(|(key, number)| (key.as_str(), *number));
    let material = stated::material(value.preset.as_deref(), value.law.as_deref(), numbers)
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
