//! Between wire types and solver types: written by hand, so that neither side's layout leaks into the other.

use cosplat_ipc::schema::{self as wire, padded};
use cosplat_pacing::steering::Control;
use cosplat_scene::sources::{SourceFile, SourceKind};
use cosplat_sim_core::{
    Action, Contact, ContactPartner, HoldChange, ObjectState, Patch, Place, Scene,
    materials::{Law, Material, laws::LAWS},
    pose::GaussianPose,
    scene::{Fidelity, Object, Pose},
};

/// Why a wire command cannot become an action, whatever the state of the world.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum WireError {
    /// `kind` is none of the known ones.
    #[error(
        "command kind {kind} is unknown: expected 1 to {}",
        wire::COMMAND_CANCEL
    )]
    UnknownKind {
        /// The value sent.
        kind: u32,
    },
    /// `object` says nobody's orders.
    #[error("the orders of {whose} are to be cancelled, expected 0 for the sender's or 1 for all")]
    UnknownExtent {
        /// The value sent.
        whose: u32,
    },
    /// `material.region` says no model level.
    #[error("fidelity {fidelity} is unknown: expected 1 static, 2 mpm, 3 auto or 4 rigid")]
    UnknownFidelity {
        /// The value sent.
        fidelity: u32,
    },
    /// `material.region` has flags that no pose has.
    #[error("the flags {flags} of the pose are unknown: expected 0 to 3")]
    UnknownFlags {
        /// The value sent.
        flags: u32,
    },
    /// Only a replay can go to a step.
    #[error("this session simulates and cannot go to a step: only a replay can")]
    Seek,
    /// Too few steps or too many.
    #[error("{count} steps are asked for, expected 1 to {}", wire::MAX_STEPS)]
    Steps {
        /// The value sent.
        count: u32,
    },
    /// `material.law` is none of the known ones.
    #[error("material law {law} is unknown: expected 1 to {}", LAWS.len())]
    UnknownLaw {
        /// The value sent.
        law: u32,
    },
}

/// What a wire command asks for.
#[derive(Clone, Debug, PartialEq)]
pub enum Order {
    /// Something for the world, at a step boundary.
    World(Action),
    /// Write a checkpoint.
    Checkpoint,
    /// Make so many steps while paused.
    Steps(u64),
    /// Drop orders that wait: the sender's, or those of all.
    Cancel {
        /// Whether those of all.
        of_all: bool,
    },
    /// Something for the server itself.
    Server(Control),
}

/// Reads a wire command of a client. Numbers are not judged here: [`World::check`](cosplat_sim_core::World::check) does.
///
/// # Errors
/// When an enumeration value is unknown.
pub fn order_from_wire(client: u64, command: &wire::Command) -> Result<Order, WireError> {
    let object = command.object as usize;
    let action = match command.kind {
        wire::COMMAND_IMPULSE => Action::Impulse {
            object,
            impulse: command.vector,
        },
        wire::COMMAND_IMPULSE_AT => Action::ImpulseAt {
            object,
            impulse: command.vector,
            point: command.point,
            radius: command.radius,
        },
        wire::COMMAND_SET_VELOCITY => Action::SetVelocity {
            object,
            linear: command.vector,
            angular: command.point,
        },
        wire::COMMAND_SET_MATERIAL => Action::SetMaterial {
            object,
            region: (command.material.region as usize).checked_sub(1),
            patch: patch_from_wire(command),
            material: material_from_wire(&command.material)?,
        },
        wire::COMMAND_SET_GRAVITY => Action::SetGravity {
            gravity: command.vector,
        },
        wire::COMMAND_MOVE_COLLIDER => Action::MoveCollider {
            collider: object,
            pose: Pose::turned(command.vector, command.point),
        },
        wire::COMMAND_PIN => Action::Pin {
            object,
            point: command.point,
            radius: match command.radius {
                0.0 => f64::INFINITY,
                radius => radius,
            },
        },
        wire::COMMAND_RELEASE => Action::Release { object },
        wire::COMMAND_RESET => Action::Reset,
        wire::COMMAND_FORCE => Action::Force {
            object,
            force: command.vector,
            torque: command.point,
        },
        wire::COMMAND_FORCE_AT => Action::ForceAt {
            object,
            force: command.vector,
            point: command.point,
            radius: command.radius,
        },
        wire::COMMAND_COLLIDER_VELOCITY => Action::ColliderVelocity {
            collider: object,
            linear: command.vector,
            angular: command.point,
        },
        wire::COMMAND_SAVE => Action::Save {
            snapshot: command.object,
        },
        wire::COMMAND_RESTORE => Action::Restore {
            snapshot: command.object,
        },
        wire::COMMAND_GRAB | wire::COMMAND_DRAG | wire::COMMAND_LET_GO => Action::Hold {
            holder: client,
            object,
            change: hold_from_wire(command),
        },
        wire::COMMAND_SET_POSE
        | wire::COMMAND_SET_FIDELITY
        | wire::COMMAND_REMOVE
        | wire::COMMAND_BRING_IN
        | wire::COMMAND_UNDO
        | wire::COMMAND_REDO => edit_from_wire(command)?,
        wire::COMMAND_CHECKPOINT => return Ok(Order::Checkpoint),
        wire::COMMAND_SEEK => return Err(WireError::Seek),
        wire::COMMAND_STEP => {
            let count = command.object;
            if !(1..=wire::MAX_STEPS).contains(&count) {
                return Err(WireError::Steps { count });
            }
            return Ok(Order::Steps(count.into()));
        }
        wire::COMMAND_CANCEL => {
            let of_all = match command.object {
                0 => false,
                1 => true,
                whose => return Err(WireError::UnknownExtent { whose }),
            };
            return Ok(Order::Cancel { of_all });
        }
        wire::COMMAND_PAUSE => return Ok(Order::Server(Control::Pause)),
        wire::COMMAND_RESUME => return Ok(Order::Server(Control::Resume)),
        wire::COMMAND_STOP => return Ok(Order::Server(Control::Stop)),
        kind => return Err(WireError::UnknownKind { kind }),
    };
    Ok(Order::World(action))
}

/// An edit of an object, or what takes edits back.
fn edit_from_wire(command: &wire::Command) -> Result<Action, WireError> {
    let object = command.object as usize;
    Ok(match command.kind {
        wire::COMMAND_SET_POSE => Action::SetPose {
            object,
            place: place_from_wire(command)?,
        },
        wire::COMMAND_BRING_IN => Action::BringIn {
            object,
            place: place_from_wire(command)?,
        },
        wire::COMMAND_SET_FIDELITY => {
            let fidelity = command.material.region;
            let mut known = Fidelity::NAMES.iter().map(|(_, known)| *known);
            Action::SetFidelity {
                object,
                fidelity: known
                    .find(|known| *known as u32 == fidelity)
                    .ok_or(WireError::UnknownFidelity { fidelity })?,
            }
        }
        wire::COMMAND_REMOVE => Action::Remove { object },
        wire::COMMAND_UNDO => Action::Undo,
        _ => Action::Redo,
    })
}

fn place_from_wire(command: &wire::Command) -> Result<Place, WireError> {
    let flags = command.material.region;
    if flags > wire::POSE_KEEP_PLACE | wire::POSE_KEEP_ROTATION {
        return Err(WireError::UnknownFlags { flags });
    }
    let is_set = |flag: u32| flags & flag == 0;
    let turned = Pose::turned(command.vector, command.point);
    Ok(Place {
        position: is_set(wire::POSE_KEEP_PLACE).then_some(turned.translation),
        rotation: is_set(wire::POSE_KEEP_ROTATION).then_some(turned.rotation),
    })
}

/// Where a material goes; none for all of an object or region.
fn patch_from_wire(command: &wire::Command) -> Option<Patch> {
    if command.radius != 0.0 {
        return Some(Patch::Ball {
            point: command.point,
            radius: command.radius,
        });
    }
    (command.vector != [0.0; 3]).then_some(Patch::Box {
        centre: command.point,
        half: command.vector,
    })
}

/// What becomes of a patch that the sender holds.
fn hold_from_wire(command: &wire::Command) -> HoldChange {
    match command.kind {
        wire::COMMAND_GRAB => HoldChange::Grab {
            point: command.point,
            target: command.vector,
            radius: command.radius,
            steps: command.material.region,
        },
        wire::COMMAND_DRAG => HoldChange::Drag {
            target: command.vector,
        },
        _ => HoldChange::LetGo,
    }
}

fn material_from_wire(spec: &wire::MaterialSpec) -> Result<Material, WireError> {
    let law = Law::from_parameters(spec.law, spec.parameters)
        .ok_or(WireError::UnknownLaw { law: spec.law })?;
    let elastic = |value| if law.is_elastic() { value } else { 0.0 };
    Ok(Material {
        name: "edited".into(),
        law,
        youngs_modulus: elastic(spec.youngs_modulus),
        poisson_ratio: elastic(spec.poisson_ratio),
        // An edit keeps the object's mass and its loss factor, so these are not read; any valid values will do.
        density: 1.0,
        loss: 0.0,
    })
}

/// The object's row in the `objects` stream.
pub fn object_to_wire(id: usize, state: &ObjectState) -> wire::ObjectState {
    wire::ObjectState {
        id: id as u32,
        fidelity: state.level as u32,
        mass: state.mass,
        com: state.com,
        rotation: state.rotation,
        linear_velocity: state.linear_velocity,
        angular_velocity: state.angular_velocity,
        inertia: state.inertia,
        radius: state.radius,
        kinetic_energy: state.kinetic_energy,
        elastic_energy: state.elastic_energy,
        contact_impulse: state.contact_impulse,
    }
}

/// A pair's row in the `contacts` stream.
pub fn contact_to_wire(contact: &Contact) -> wire::Contact {
    let (kind, other) = match contact.other {
        ContactPartner::Object(object) => (wire::CONTACT_OBJECT, object),
        ContactPartner::Collider(collider) => (wire::CONTACT_COLLIDER, collider),
    };
    wire::Contact {
        object: contact.object as u32,
        other: other as u32,
        kind,
        reserved: 0,
        point: contact.point,
        normal: contact.normal,
        impulse: contact.impulse,
    }
}

/// The object's row in the `scene/objects` block.
pub fn object_info(id: usize, object: &Object) -> wire::ObjectInfo {
    wire::ObjectInfo {
        id: id as u32,
        fidelity: object.fidelity as u32,
        particle_count: object.particles.len() as u32,
        gaussian_first: object.gaussians.start as u32,
        gaussian_count: object.gaussians.len() as u32,
        law: object.material.law.id(),
        youngs_modulus: object.material.youngs_modulus,
        poisson_ratio: object.material.poisson_ratio,
        density: object.material.density,
        name: padded(&object.name),
        material: padded(&object.material.name),
    }
}

/// The file's row in the `scene/files` block.
pub fn source_to_wire(source: &SourceFile) -> wire::SceneFile {
    let kind = match source.kind {
        SourceKind::Asset => wire::SCENE_FILE_ASSET,
        SourceKind::Checkpoint => wire::SCENE_FILE_CHECKPOINT,
    };
    let path = source.path.to_string_lossy();
    wire::SceneFile::new(kind, &source.name, &path, source.bytes, source.hash)
}

/// Colour of degree-0 spherical harmonics with opacity, as eight-bit RGBA, for every Gaussian.
pub fn base_colors(scene: &Scene) -> Vec<[u8; 4]> {
    const SH_C0: f32 = 0.282_094_79;
    let byte = |value: f32| (value.clamp(0.0, 1.0) * 255.0).round() as u8;
    let gaussians = &scene.gaussians;
    let stride = gaussians.sh_stride();
    gaussians
        .opacity
        .iter()
        .enumerate()
        .map(|(i, opacity)| {
            let dc = &gaussians.sh[i * stride..i * stride + 3];
            let [r, g, b] = [0, 1, 2].map(|c| byte(0.5 + SH_C0 * dc[c]));
            [r, g, b, byte(*opacity)]
        })
        .collect()
}

/// Object id of every Gaussian.
pub fn gaussian_objects(scene: &Scene) -> Vec<u32> {
    let mut ids = vec![0; scene.gaussians.len()];
    for (id, object) in scene.objects.iter().enumerate() {
        ids[object.gaussians.clone()].fill(id as u32);
    }
    ids
}

/// The slots of a frame as the solver writes them: the same numbers in the same places, checked when this is compiled.
/// The labels are colour, object and index.
pub fn gaussians_as_poses(slots: &mut [wire::GaussianState]) -> &mut [GaussianPose] {
    use std::mem::offset_of;
    type Wire = wire::GaussianState;
    const {
        assert!(offset_of!(Wire, position) == offset_of!(GaussianPose, position));
        assert!(offset_of!(Wire, color) == offset_of!(GaussianPose, label));
        assert!(offset_of!(Wire, covariance) == offset_of!(GaussianPose, covariance));
        assert!(offset_of!(Wire, object) == offset_of!(GaussianPose, labels));
        assert!(offset_of!(Wire, index) == offset_of!(GaussianPose, labels) + 4);
        assert!(offset_of!(Wire, rotation) == offset_of!(GaussianPose, rotation));
    }
    bytemuck::cast_slice_mut(slots)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn unknown_enumeration_values_are_named() {
        let command = wire::Command {
            kind: 77,
            ..Default::default()
        };
        let error = order_from_wire(1, &command).expect_err("77 is no kind");
        assert_eq!(error, WireError::UnknownKind { kind: 77 });
        let command = wire::Command {
            kind: wire::COMMAND_SET_MATERIAL,
            material: wire::MaterialSpec {
                law: 77,
                ..Default::default()
            },
            ..Default::default()
        };
        let error = order_from_wire(1, &command).expect_err("77 is no law");
        assert_eq!(
            error.to_string(),
            "material law 77 is unknown: expected 1 to 10"
        );
    }

    #[test]
    fn materials_of_every_law_arrive_with_parameters_and_region() {
        for (n, law) in LAWS.iter().enumerate() {
            let parameters = [0.25, 1.5, 2.0, 0.0];
            let command = wire::Command {
                kind: wire::COMMAND_SET_MATERIAL,
                object: 3,
                material: wire::MaterialSpec {
                    law: law.id,
                    region: n as u32,
                    youngs_modulus: 1e6,
                    poisson_ratio: 0.3,
                    parameters,
                },
                ..Default::default()
            };
            let Ok(Order::World(Action::SetMaterial {
                object,
                region,
                patch: None,
                material,
            })) = order_from_wire(1, &command)
            else {
                panic!("a material is an order to the world");
            };
            assert_eq!((object, region), (3, n.checked_sub(1)));
            assert_eq!(Law::from_parameters(law.id, parameters), Some(material.law));
            assert_eq!(material.youngs_modulus, if law.elastic { 1e6 } else { 0.0 });
        }
    }

    #[test]
    fn a_radius_makes_a_ball_and_half_edges_a_box() {
        let (point, half) = ([1.0, 2.0, 3.0], [0.1, 0.0, 0.3]);
        let patch = |radius: f64, vector: [f64; 3]| {
            patch_from_wire(&wire::Command {
                kind: wire::COMMAND_SET_MATERIAL,
                vector,
                point,
                radius,
                ..Default::default()
            })
        };
        assert_eq!(patch(0.0, [0.0; 3]), None);
        let ball = Patch::Ball { point, radius: 0.2 };
        assert_eq!(patch(0.2, half), Some(ball));
        let centre = point;
        assert_eq!(patch(0.0, half), Some(Patch::Box { centre, half }));
    }

    #[test]
    fn the_wire_format_document_lists_the_laws() {
        let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../docs/wire-format.md");
        let text = std::fs::read_to_string(path).expect("the document");
        for law in LAWS {
            let keys: Vec<_> = law
                .parameters
                .iter()
                .map(|p| format!("`{}`", p.key))
                .collect();
            let row = format!("| {} | `{}` | {} |", law.id, law.name, keys.join(", "));
            let row = row.replace("|  |", "| |");
            assert!(text.contains(&row), "no row {row:?}");
        }
    }
}
