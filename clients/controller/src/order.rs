//! What a person or script orders, in names and SI units, and the wire command it becomes.

use cosplat_ipc::schema as wire;
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
        /// Preset name or law with parameters.
        material: MaterialRef,
    },
    /// New gravity [m/s^2].
    Gravity {
        /// New value.
        gravity: [f64; 3],
    },
    /// Stop stepping.
    Pause,
    /// Step again.
    Resume,
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
    /// Name of a preset; whoever runs the order knows the table.
    Preset(String),
    /// Law and parameters.
    Value {
        /// `fixed-corotated` or `neo-hookean`.
        law: LawName,
        /// Young's modulus [Pa].
        youngs_modulus_pa: f64,
        /// Poisson's ratio.
        poisson_ratio: f64,
    },
}

/// Constitutive laws by name.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum LawName {
    /// Fixed corotated elasticity.
    FixedCorotated,
    /// Neo-Hookean elasticity.
    NeoHookean,
}

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
    /// No preset of that name.
    #[error("{0}")]
    UnknownPreset(String),
}

/// Radius of a push at a point when the order names none [m].
pub const DEFAULT_PUSH_RADIUS: f64 = 0.05;

/// What an order needs to know of the running scene.
pub struct Lookup<'a> {
    /// Object names, by id.
    pub objects: &'a [String],
    /// Material presets by name; the error is a sentence.
    pub preset: &'a dyn Fn(&str) -> Result<wire::MaterialSpec, String>,
}

impl Lookup<'_> {
    fn object(&self, reference: &ObjectRef) -> Result<u32, OrderError> {
        match reference {
            // An id out of range is sent as it is: the server's refusal names the valid ones.
            ObjectRef::Id(id) => Ok(*id),
            ObjectRef::Name(name) => self
                .objects
                .iter()
                .position(|known| known == name)
                .map(|id| id as u32)
                .ok_or_else(|| OrderError::UnknownObject {
                    name: name.clone(),
                    known: self.objects.join(", "),
                }),
        }
    }

    fn material(&self, reference: &MaterialRef) -> Result<wire::MaterialSpec, OrderError> {
        match reference {
            MaterialRef::Preset(name) => (self.preset)(name).map_err(OrderError::UnknownPreset),
            MaterialRef::Value {
                law,
                youngs_modulus_pa,
                poisson_ratio,
            } => Ok(wire::MaterialSpec {
                law: match law {
                    LawName::FixedCorotated => 1,
                    LawName::NeoHookean => 2,
                },
                reserved: 0,
                youngs_modulus: *youngs_modulus_pa,
                poisson_ratio: *poisson_ratio,
            }),
        }
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
            Order::SetMaterial { object, material } => wire::Command {
                kind: wire::COMMAND_SET_MATERIAL,
                object: lookup.object(object)?,
                material: lookup.material(material)?,
                ..empty
            },
            Order::Gravity { gravity } => wire::Command {
                kind: wire::COMMAND_SET_GRAVITY,
                vector: *gravity,
                ..empty
            },
            Order::Pause => of_kind(wire::COMMAND_PAUSE),
            Order::Resume => of_kind(wire::COMMAND_RESUME),
            Order::Reset => of_kind(wire::COMMAND_RESET),
            Order::Stop => of_kind(wire::COMMAND_STOP),
        })
    }
}

fn of_kind(kind: u32) -> wire::Command {
    wire::Command {
        kind,
        ..Default::default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn wired(order: &Order) -> Result<wire::Command, OrderError> {
        order.to_wire(&Lookup {
            objects: &["left".into(), "right".into()],
            preset: &|name| Err(format!("no preset {name}")),
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
}
