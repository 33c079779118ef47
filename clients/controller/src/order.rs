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
    /// No such material.
    #[error("{0}")]
    Material(String),
}

/// Radius of a push or pin at a point when the order names none [m].
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
                kind: wire::COMMAND_SET_VELOCITY,
                object: lookup.object(object)?,
                vector: *linear,
                point: *angular,
                ..empty
            },
            Order::SetMaterial {
                object,
                region,
                material,
            } => wire::Command {
                kind: wire::COMMAND_SET_MATERIAL,
                object: lookup.object(object)?,
                material: lookup.material(material, *region)?,
                ..empty
            },
            Order::Gravity { gravity } => wire::Command {
                kind: wire::COMMAND_SET_GRAVITY,
                vector: *gravity,
                ..empty
            },
            Order::MoveCollider {
                collider,
                translation,
                rotation_deg,
            } => wire::Command {
                kind: wire::COMMAND_MOVE_COLLIDER,
                object: lookup.collider(collider)?,
                vector: *translation,
                point: rotation_vector(*rotation_deg),
                ..empty
            },
            Order::Pin {
                object,
                point,
                radius,
            } => wire::Command {
                kind: wire::COMMAND_PIN,
                object: lookup.object(object)?,
                point: point.unwrap_or_default(),
                radius: point.map_or(0.0, |_| radius.unwrap_or(DEFAULT_PUSH_RADIUS)),
                ..empty
            },
            Order::Release { object } => wire::Command {
                kind: wire::COMMAND_RELEASE,
                object: lookup.object(object)?,
                ..empty
            },
            Order::Force { .. } | Order::ColliderVelocity { .. } => self.held(lookup)?,
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
mod tests {
    use super::*;

    fn wired(order: &Order) -> Result<wire::Command, OrderError> {
        order.to_wire(&Lookup {
            objects: &["left".into(), "right".into()],
            colliders: &["floor".into(), "gripper".into()],
            materials: &|value| match value.law.as_deref() {
                Some("von_mises") => Ok(wire::MaterialSpec {
                    law: 3,
                    parameters: [value.numbers["yield_stress_pa"], 0.0, 0.0, 0.0],
                    ..Default::default()
                }),
                _ => Err(format!("no material {value:?}")),
            },
        })
    }

    #[test]
    fn objects_go_by_name_or_id() {
        let push = |object: &str| Order::Push {
            object: object.parse().expect("infallible"),
            impulse: [1.0, 2.0, 3.0],
            point: None,
            radius: None,
        };
        assert_eq!(wired(&push("right")).map(|c| c.object), Ok(1));
        assert_eq!(wired(&push("0")).map(|c| c.object), Ok(0));
        let error = wired(&push("middle")).expect_err("no such object");
        assert!(error.to_string().contains("left, right"), "{error}");
    }

    #[test]
    fn colliders_go_by_name_and_turn_by_a_rotation_vector() {
        let order = Order::MoveCollider {
            collider: ObjectRef::Name("gripper".into()),
            translation: [1.0, 2.0, 3.0],
            rotation_deg: [0.0, 90.0, 0.0],
        };
        let command = wired(&order).expect("valid");
        assert_eq!(
            (command.kind, command.object),
            (wire::COMMAND_MOVE_COLLIDER, 1)
        );
        assert_eq!(command.vector, [1.0, 2.0, 3.0]);
        let turn = command.point[1] - std::f64::consts::FRAC_PI_2;
        assert!(turn.abs() < 1e-12, "{:?}", command.point);
        let order = Order::MoveCollider {
            collider: ObjectRef::Name("left".into()),
            translation: [0.0; 3],
            rotation_deg: [0.0; 3],
        };
        let error = wired(&order).expect_err("an object is no collider");
        assert!(error.to_string().contains("floor, gripper"), "{error}");
    }

    #[test]
    fn a_pin_without_a_point_holds_the_whole_object() {
        let pin = |point| Order::Pin {
            object: ObjectRef::Id(1),
            point,
            radius: None,
        };
        let command = wired(&pin(None)).expect("valid");
        assert_eq!((command.kind, command.radius), (wire::COMMAND_PIN, 0.0));
        let command = wired(&pin(Some([0.0; 3]))).expect("valid");
        assert_eq!(command.radius, DEFAULT_PUSH_RADIUS);
    }

    #[test]
    fn a_point_makes_a_local_push() {
        let order = Order::Push {
            object: ObjectRef::Id(0),
            impulse: [1.0, 0.0, 0.0],
            point: Some([0.0, 1.0, 0.0]),
            radius: None,
        };
        let command = wired(&order).expect("valid");
        assert_eq!(command.kind, wire::COMMAND_IMPULSE_AT);
        assert_eq!(command.radius, DEFAULT_PUSH_RADIUS);
    }

    #[test]
    fn a_force_turns_the_whole_or_pushes_at_a_point() {
        let force = |point| Order::Force {
            object: ObjectRef::Id(1),
            force: [1.0, 0.0, 0.0],
            torque: [0.0, 0.0, 2.0],
            point,
            radius: None,
        };
        let command = wired(&force(None)).expect("valid");
        assert_eq!(
            (command.kind, command.point),
            (wire::COMMAND_FORCE, [0.0, 0.0, 2.0])
        );
        let command = wired(&force(Some([0.0, 1.0, 0.0]))).expect("valid");
        assert_eq!(
            (command.kind, command.point),
            (wire::COMMAND_FORCE_AT, [0.0, 1.0, 0.0])
        );
        let command = wired(&Order::Step { count: 7 }).expect("valid");
        assert_eq!((command.kind, command.object), (wire::COMMAND_STEP, 7));
    }

    #[test]
    fn a_material_is_a_name_or_a_table_and_may_be_for_a_region() {
        let order = |material: &str| {
            let text = format!("action = 'set-material'\nobject = 'left'\n{material}");
            toml::from_str::<Order>(&text).expect("valid")
        };
        let material = "region = 2\nmaterial = { law = 'von_mises', yield_stress_pa = 5 }";
        let command = wired(&order(material)).expect("known");
        assert_eq!((command.material.law, command.material.region), (3, 2));
        assert_eq!(command.material.parameters[0], 5.0);
        let error = wired(&order("material = 'unobtainium'")).expect_err("no such preset");
        assert!(error.to_string().contains("unobtainium"), "{error}");
    }
}
