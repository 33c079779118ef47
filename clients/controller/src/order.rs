//! What a person or script orders, in names and SI units, and the wire command it becomes.

use std::collections::BTreeMap;

use cosplat_ipc::schema as wire;
use glam::{DQuat, EulerRot};
use serde::Deserialize;

/// One order to a running simulation.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(tag = "action", rename_all = "kebab-case", deny_unknown_fields)]
pub enum Order {
    /// Impulse [N s] on a whole object, or on its particles within `radius` [m] of `point` [m].
    Push {
        /// Object name or id.
        object: ObjectRef,
        /// Total impulse [N s].
        impulse: [f64; 3],
        /// Where [m], world frame; without it the whole object is pushed.
        point: Option<[f64; 3]>,
        /// How far around `point` [m].
        radius: Option<f64>,
    },
    /// Rigid velocity field.
    SetVelocity {
        /// Object name or id.
        object: ObjectRef,
        /// Velocity of the centre of mass [m/s].
        #[serde(default)]
        linear: [f64; 3],
        /// Angular velocity [rad/s].
        #[serde(default)]
        angular: [f64; 3],
    },
    /// New material.
    SetMaterial {
        /// Object name or id.
        object: ObjectRef,
        /// Number of the region, from 1; without it the whole object.
        #[serde(default)]
        region: u32,
        /// Preset name, or preset or law with numbers.
        material: MaterialRef,
        /// Centre of a patch [m], world frame: only its particles get the material.
        point: Option<[f64; 3]>,
        /// How far around `point` [m].
        radius: Option<f64>,
        /// Half the edges of a box around `point` [m], along the axes of the world, in place of a radius.
        half: Option<[f64; 3]>,
    },
    /// New gravity [m/s^2].
    Gravity {
        /// New value.
        gravity: [f64; 3],
    },
    /// A collider goes to a pose within one frame.
    MoveCollider {
        /// Collider name or index.
        collider: ObjectRef,
        /// Position of its origin [m].
        translation: [f64; 3],
        /// Rotation about x, then y, then z of the world [degrees].
        #[serde(default)]
        rotation_deg: [f64; 3],
    },
    /// Hold an object, or its particles within `radius` [m] of `point` [m].
    Pin {
        /// Object name or id.
        object: ObjectRef,
        /// Where [m], world frame; without it the whole object is held.
        point: Option<[f64; 3]>,
        /// How far around `point` [m].
        radius: Option<f64>,
    },
    /// Let go what is pinned of an object.
    Release {
        /// Object name or id.
        object: ObjectRef,
    },
    /// Hold the particles within `radius` [m] of `point` [m] by a spring.
    Grab {
        /// Object name or id.
        object: ObjectRef,
        /// Where to take hold of it [m], world frame.
        point: [f64; 3],
        /// Where the spring pulls that point to [m]; without it nowhere.
        to: Option<[f64; 3]>,
        /// How far around `point` [m].
        radius: Option<f64>,
        /// Steps after which it is let go unless it is dragged; 60 without.
        #[serde(default)]
        steps: u32,
    },
    /// Pull what is held of an object elsewhere.
    Drag {
        /// Object name or id.
        object: ObjectRef,
        /// Where to [m].
        to: [f64; 3],
    },
    /// Let go what is held of an object.
    LetGo {
        /// Object name or id.
        object: ObjectRef,
    },
    /// Put an object elsewhere, at rest.
    SetPose {
        /// Object name or id.
        object: ObjectRef,
        /// Its centre of mass [m]; where it is without.
        position: Option<[f64; 3]>,
        /// Its rotation since rest, about x, then y, then z of the world [degrees]; as it is without.
        rotation_deg: Option<[f64; 3]>,
    },
    /// Model an object otherwise.
    SetFidelity {
        /// Object name or id.
        object: ObjectRef,
        /// How.
        fidelity: Level,
    },
    /// Take an object out of the world.
    Remove {
        /// Object name or id.
        object: ObjectRef,
    },
    /// Bring an object in that was removed or is absent.
    BringIn {
        /// Object name or id.
        object: ObjectRef,
        /// Its centre of mass [m]; where it was without.
        position: Option<[f64; 3]>,
        /// Its rotation since rest, about x, then y, then z of the world [degrees]; as it was without.
        rotation_deg: Option<[f64; 3]>,
    },
    /// Back to the state right before the newest edit.
    Undo,
    /// Back to the state that the newest undo left.
    Redo,
    /// Drop the orders of all clients that wait for their step.
    Cancel,
    /// A force [N] and a torque [N m] about the centre of mass during the step, or a force on the particles within
    /// `radius` [m] of `point` [m].
    Force {
        /// Object name or id.
        object: ObjectRef,
        /// Force [N].
        force: [f64; 3],
        /// Torque [N m]; none with a point.
        #[serde(default)]
        torque: [f64; 3],
        /// Where [m], world frame; without it the force is on the whole object.
        point: Option<[f64; 3]>,
        /// How far around `point` [m].
        radius: Option<f64>,
    },
    /// A collider moves during the step, and then stands.
    ColliderVelocity {
        /// Collider name or index.
        collider: ObjectRef,
        /// Velocity of its origin [m/s].
        #[serde(default)]
        linear: [f64; 3],
        /// Angular velocity [rad/s].
        #[serde(default)]
        angular: [f64; 3],
    },
    /// Keep the state in the server's memory.
    Save {
        /// Its number.
        snapshot: u32,
    },
    /// Back to a state that was kept.
    Restore {
        /// Its number.
        snapshot: u32,
    },
    /// Make steps while paused.
    Step {
        /// How many.
        count: u32,
    },
    /// Write the state to a file on the server's side.
    Checkpoint,
    /// Stop stepping.
    Pause,
    /// Step again.
    Resume,
    /// Have a replay go to the step at which the order is to take effect.
    Seek,
    /// Back to the initial state.
    Reset,
    /// Shut the server down.
    Stop,
}

/// How an object is modelled.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Level {
    /// As one body that stands where it is.
    Static = 1,
    /// As matter.
    Mpm = 2,
    /// With as little as the scene's tolerance allows.
    Auto = 3,
    /// As one body.
    Rigid = 4,
}

impl std::str::FromStr for Level {
    type Err = String;

    fn from_str(text: &str) -> Result<Level, String> {
        match text {
            "static" => Ok(Level::Static),
            "mpm" => Ok(Level::Mpm),
            "auto" => Ok(Level::Auto),
            "rigid" => Ok(Level::Rigid),
            _ => Err(format!(
                "{text:?} is no fidelity: expected static, mpm, auto or rigid"
            )),
        }
    }
}

/// An object by name or by id.
#[derive(Clone, Debug, PartialEq, Eq, Deserialize)]
#[serde(untagged)]
pub enum ObjectRef {
    /// Index in the scene's object table.
    Id(u32),
    /// Name in the scene file.
    Name(String),
}

impl std::str::FromStr for ObjectRef {
    type Err = std::convert::Infallible;

    fn from_str(text: &str) -> Result<ObjectRef, Self::Err> {
        Ok(text
            .parse()
            .map_or_else(|_| ObjectRef::Name(text.to_owned()), ObjectRef::Id))
    }
}

/// A material by preset name or by value.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(untagged)]
pub enum MaterialRef {
    /// Name of a preset.
    Preset(String),
    /// Law and numbers.
    Value(MaterialValue),
}

/// A material in the words of a scene file; whoever runs the order knows the table of laws.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
pub struct MaterialValue {
    /// Preset to start from.
    pub preset: Option<String>,
    /// Law by name; that of the preset without.
    pub law: Option<String>,
    /// Numbers by their keys, as in a scene file.
    #[serde(flatten)]
    pub numbers: BTreeMap<String, f64>,
}

/// What turns a material's words into its wire form; the error is a sentence.
pub type Materials<'a> = &'a dyn Fn(&MaterialValue) -> Result<wire::MaterialSpec, String>;

/// Why an order cannot be put on the wire.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum OrderError {
    /// No object of that name.
    #[error("object \"{name}\" does not exist: the scene has {known}")]
    UnknownObject {
        /// Name asked for.
        name: String,
        /// Names there are.
        known: String,
    },
    /// No collider of that name.
    #[error("collider \"{name}\" does not exist: the scene has {known}")]
    UnknownCollider {
        /// Name asked for.
        name: String,
        /// Names there are.
        known: String,
    },
    /// A box without a centre.
    #[error("half is given without point, expected the centre of the box as point")]
    NoCentre,
    /// No such material.
    #[error("{0}")]
    Material(String),
}

/// Radius of a push, pin or grab at a point when the order names none [m].
pub const DEFAULT_PUSH_RADIUS: f64 = 0.05;

/// What an order needs to know of the running scene.
pub struct Lookup<'a> {
    /// Object names, by id.
    pub objects: &'a [String],
    /// Collider names, by index.
    pub colliders: &'a [String],
    /// Materials.
    pub materials: Materials<'a>,
}

/// Index of a reference among names; the error is the unknown name and the known ones.
fn index(reference: &ObjectRef, names: &[String]) -> Result<u32, (String, String)> {
    match reference {
        // An id out of range is sent as it is: the server's refusal names the valid ones.
        ObjectRef::Id(id) => Ok(*id),
        ObjectRef::Name(name) => names
            .iter()
            .position(|known| known == name)
            .map(|id| id as u32)
            .ok_or_else(|| (name.clone(), names.join(", "))),
    }
}

/// Rotation vector [rad] of turns about x, then y, then z of the world [degrees].
fn rotation_vector(degrees: [f64; 3]) -> [f64; 3] {
    let [x, y, z] = degrees.map(f64::to_radians);
    DQuat::from_euler(EulerRot::XYZEx, x, y, z)
        .to_scaled_axis()
        .to_array()
}

impl Lookup<'_> {
    fn object(&self, reference: &ObjectRef) -> Result<u32, OrderError> {
        index(reference, self.objects)
            .map_err(|(name, known)| OrderError::UnknownObject { name, known })
    }

    fn collider(&self, reference: &ObjectRef) -> Result<u32, OrderError> {
        index(reference, self.colliders)
            .map_err(|(name, known)| OrderError::UnknownCollider { name, known })
    }

    fn material(
        &self,
        reference: &MaterialRef,
        region: u32,
    ) -> Result<wire::MaterialSpec, OrderError> {
        let spec = match reference {
            MaterialRef::Preset(name) => (self.materials)(&MaterialValue {
                preset: Some(name.clone()),
                ..Default::default()
            }),
            MaterialRef::Value(value) => (self.materials)(value),
        };
        let spec = spec.map_err(OrderError::Material)?;
        Ok(wire::MaterialSpec { region, ..spec })
    }
}

impl Order {
    /// The wire command, without sequence and step.
    ///
    /// # Errors
    /// When a name is unknown.
    pub fn to_wire(&self, lookup: &Lookup<'_>) -> Result<wire::Command, OrderError> {
        let empty = wire::Command::default();
        Ok(match self {
            Order::Push {
                object,
                impulse,
                point,
                radius,
            } => wire::Command {
                kind: match point {
                    None => wire::COMMAND_IMPULSE,
                    Some(_) => wire::COMMAND_IMPULSE_AT,
                },
                object: lookup.object(object)?,
                vector: *impulse,
                point: point.unwrap_or_default(),
                radius: point.map_or(0.0, |_| radius.unwrap_or(DEFAULT_PUSH_RADIUS)),
                ..empty
            },
            Order::SetVelocity {
                object,
                linear,
                angular,
            } => wire::Command {
                object: lookup.object(object)?,
                vector: *linear,
                point: *angular,
                ..of_kind(wire::COMMAND_SET_VELOCITY)
            },
            Order::SetMaterial {
                object,
                region,
                material,
                point,
                radius,
                half,
            } => wire::Command {
                object: match (point, half) {
                    (None, Some(_)) => return Err(OrderError::NoCentre),
                    _ => lookup.object(object)?,
                },
                vector: half.unwrap_or_default(),
                point: point.unwrap_or_default(),
                radius: match (point, half) {
                    (Some(_), None) => radius.unwrap_or(DEFAULT_PUSH_RADIUS),
                    _ => 0.0,
                },
                material: lookup.material(material, *region)?,
                ..of_kind(wire::COMMAND_SET_MATERIAL)
            },
            Order::Gravity { gravity } => wire::Command {
                vector: *gravity,
                ..of_kind(wire::COMMAND_SET_GRAVITY)
            },
            Order::MoveCollider {
                collider,
                translation,
                rotation_deg,
            } => wire::Command {
                object: lookup.collider(collider)?,
                vector: *translation,
                point: rotation_vector(*rotation_deg),
                ..of_kind(wire::COMMAND_MOVE_COLLIDER)
            },
            Order::Pin {
                object,
                point,
                radius,
            } => wire::Command {
                object: lookup.object(object)?,
                point: point.unwrap_or_default(),
                radius: point.map_or(0.0, |_| radius.unwrap_or(DEFAULT_PUSH_RADIUS)),
                ..of_kind(wire::COMMAND_PIN)
            },
            Order::Release { object } => wire::Command {
                object: lookup.object(object)?,
                ..of_kind(wire::COMMAND_RELEASE)
            },
            Order::Force { .. } | Order::ColliderVelocity { .. } => self.held(lookup)?,
            Order::Grab { .. } | Order::Drag { .. } | Order::LetGo { .. } => self.hold(lookup)?,
            Order::SetPose { .. }
            | Order::SetFidelity { .. }
            | Order::Remove { .. }
            | Order::BringIn { .. } => self.edit(lookup)?,
            Order::Undo => of_kind(wire::COMMAND_UNDO),
            Order::Redo => of_kind(wire::COMMAND_REDO),
            Order::Cancel => numbered(wire::COMMAND_CANCEL, 1),
            Order::Save { snapshot } => numbered(wire::COMMAND_SAVE, *snapshot),
            Order::Restore { snapshot } => numbered(wire::COMMAND_RESTORE, *snapshot),
            Order::Step { count } => numbered(wire::COMMAND_STEP, *count),
            Order::Checkpoint => of_kind(wire::COMMAND_CHECKPOINT),
            Order::Pause => of_kind(wire::COMMAND_PAUSE),
            Order::Resume => of_kind(wire::COMMAND_RESUME),
            Order::Seek => of_kind(wire::COMMAND_SEEK),
            Order::Reset => of_kind(wire::COMMAND_RESET),
            Order::Stop => of_kind(wire::COMMAND_STOP),
        })
    }

    /// The wire command of an order about what a spring holds.
    fn hold(&self, lookup: &Lookup<'_>) -> Result<wire::Command, OrderError> {
        Ok(match self {
            Order::Grab {
                object,
                point,
                to,
                radius,
                steps,
            } => wire::Command {
                object: lookup.object(object)?,
                vector: to.unwrap_or(*point),
                point: *point,
                radius: radius.unwrap_or(DEFAULT_PUSH_RADIUS),
                material: wire::MaterialSpec {
                    region: *steps,
                    ..Default::default()
                },
                ..of_kind(wire::COMMAND_GRAB)
            },
            Order::Drag { object, to } => wire::Command {
                object: lookup.object(object)?,
                vector: *to,
                ..of_kind(wire::COMMAND_DRAG)
            },
            Order::LetGo { object } => wire::Command {
                object: lookup.object(object)?,
                ..of_kind(wire::COMMAND_LET_GO)
            },
            other => other.to_wire(lookup)?,
        })
    }

    /// The wire command of an edit of an object.
    fn edit(&self, lookup: &Lookup<'_>) -> Result<wire::Command, OrderError> {
        Ok(match self {
            Order::SetPose {
                object,
                position,
                rotation_deg,
            } => wire::Command {
                object: lookup.object(object)?,
                ..posed(wire::COMMAND_SET_POSE, *position, *rotation_deg)
            },
            Order::BringIn {
                object,
                position,
                rotation_deg,
            } => wire::Command {
                object: lookup.object(object)?,
                ..posed(wire::COMMAND_BRING_IN, *position, *rotation_deg)
            },
            Order::SetFidelity { object, fidelity } => wire::Command {
                object: lookup.object(object)?,
                material: wire::MaterialSpec {
                    region: *fidelity as u32,
                    ..Default::default()
                },
                ..of_kind(wire::COMMAND_SET_FIDELITY)
            },
            Order::Remove { object } => numbered(wire::COMMAND_REMOVE, lookup.object(object)?),
            other => other.to_wire(lookup)?,
        })
    }

    /// The wire command of an order that acts during one step.
    fn held(&self, lookup: &Lookup<'_>) -> Result<wire::Command, OrderError> {
        let empty = wire::Command::default();
        Ok(match self {
            Order::Force {
                object,
                force,
                torque,
                point,
                radius,
            } => wire::Command {
                kind: match point {
                    None => wire::COMMAND_FORCE,
                    Some(_) => wire::COMMAND_FORCE_AT,
                },
                object: lookup.object(object)?,
                vector: *force,
                point: point.unwrap_or(*torque),
                radius: point.map_or(0.0, |_| radius.unwrap_or(DEFAULT_PUSH_RADIUS)),
                ..empty
            },
            Order::ColliderVelocity {
                collider,
                linear,
                angular,
            } => wire::Command {
                kind: wire::COMMAND_COLLIDER_VELOCITY,
                object: lookup.collider(collider)?,
                vector: *linear,
                point: *angular,
                ..empty
            },
            other => other.to_wire(lookup)?,
        })
    }
}

/// A command with a pose, of which parts may be kept.
fn posed(kind: u32, position: Option<[f64; 3]>, degrees: Option<[f64; 3]>) -> wire::Command {
    let flag = |is_kept: bool, flag: u32| if is_kept { flag } else { 0 };
    let region = flag(position.is_none(), wire::POSE_KEEP_PLACE)
        | flag(degrees.is_none(), wire::POSE_KEEP_ROTATION);
    wire::Command {
        vector: position.unwrap_or_default(),
        point: degrees.map_or([0.0; 3], rotation_vector),
        material: wire::MaterialSpec {
            region,
            ..Default::default()
        },
        ..of_kind(kind)
    }
}

fn of_kind(kind: u32) -> wire::Command {
    wire::Command {
        kind,
        ..Default::default()
    }
}

fn numbered(kind: u32, number: u32) -> wire::Command {
    wire::Command {
        object: number,
        ..of_kind(kind)
    }
}

#[cfg(test)]
mod tests;
