//! Commands as clients send them.

use std::cell::RefCell;

use cosplat_ipc::schema as wire;
use cosplat_server::convert::{Order, order_from_wire};
use cosplat_sim_core::{Action, Command, World, materials::Law};

use super::world;

/// Length of the step after commands [s]: up to four of the smallest substeps there are. Commands are judged by the frame of
/// the scene, which is longer: the stiffest matter that they may make takes 65,536 substeps of that.
const FRAME: f64 = 1e-6;
/// Farthest that a command may move or turn a collider to be applied here [m], [rad]. Farther is judged and no more: it
/// takes thousands of substeps by right, each with a search for impacts.
const MOVE_MAX: f64 = 0.01;
/// Of orders that form a body or spin one hard, one in so many is applied, by its number. The surface of a body takes
/// longer than all else, and is always that of the same particles; the search for impacts is cut off at a count of its own.
const RARE_EVERY: u64 = 16;
/// From here on an order spins the body of the scene, some 0.1 kg m^2, by more than 0.2 rad in a step: [rad/s], [N s], [N].
const FAST: f64 = 1e5;

thread_local! {
    static STAGE: RefCell<(World, Vec<u8>)> = RefCell::new({
        let world = world::new();
        let bytes = world.checkpoint();
        (world, bytes)
    });
}

/// Commands one behind the other as on the wire: those that are good are applied, and the world goes on.
pub fn read(data: &[u8]) {
    STAGE.with_borrow_mut(|(world, beginning)| {
        let mut good = Vec::new();
        let size = size_of::<wire::Command>();
        for bytes in data.chunks_exact(size).take(wire::MAX_COMMANDS) {
            let command: wire::Command = bytemuck::pod_read_unaligned(bytes);
            let Ok(Order::World(action)) = order_from_wire(1, &command) else {
                continue;
            };
            match world.check(&action) {
                Err(error) => assert!(!error.to_string().is_empty()),
                Ok(()) if is_far(&action) || is_left_out(&action, command.sequence) => {}
                Ok(()) => good.push(Command {
                    apply_at_step: command.apply_at_step,
                    client: 1,
                    sequence: command.sequence,
                    action,
                }),
            }
        }
        if good.is_empty() {
            return;
        }
        world.step(FRAME, &good);
        world::check(world);
        let restored = world.restore(beginning);
        restored.unwrap_or_else(|error| panic!("{error}"));
    });
}

/// Whether an action moves a collider far in a frame of the scene.
fn is_far(action: &Action) -> bool {
    let (shift, turn) = match action {
        Action::MoveCollider { pose, .. } => {
            let [x, y, z, _] = pose.rotation;
            (pose.translation, [x, y, z].map(|x| 2.0 * x))
        }
        Action::ColliderVelocity {
            linear, angular, ..
        } => (
            linear.map(|v| v / world::FRAME_RATE),
            angular.map(|w| w / world::FRAME_RATE),
        ),
        _ => return false,
    };
    let far = |x: &f64| x.abs() > MOVE_MAX;
    shift.iter().chain(&turn).any(far)
}

/// Whether an action is one of those of which most are left out.
fn is_left_out(action: &Action, sequence: u64) -> bool {
    let is_fast = |vector: &[f64; 3], bound: f64| vector.iter().any(|x| x.abs() > bound);
    let is_rare = match action {
        Action::SetMaterial { material, .. } => material.law == Law::Rigid,
        Action::Reset => true,
        Action::Impulse { impulse, .. } | Action::ImpulseAt { impulse, .. } => {
            is_fast(impulse, FAST)
        }
        Action::SetVelocity {
            linear, angular, ..
        } => is_fast(angular, FAST) || is_fast(linear, FAST),
        Action::Force { force, torque, .. } => {
            is_fast(torque, FAST / FRAME) || is_fast(force, FAST / FRAME)
        }
        Action::ForceAt { force, .. } => is_fast(force, FAST / FRAME),
        _ => false,
    };
    is_rare && !sequence.is_multiple_of(RARE_EVERY)
}

/// One command of each kind.
pub fn seeds() -> Vec<Vec<u8>> {
    let command = |kind| wire::Command {
        kind,
        object: 0,
        sequence: 1,
        vector: [1e-3, 0.0, 0.0],
        point: match kind {
            wire::COMMAND_MOVE_COLLIDER => [0.0, 1e-3, 0.0],
            _ => [0.2, 0.1, 0.2],
        },
        radius: 0.2,
        material: wire::MaterialSpec {
            law: 1 + kind % 9,
            region: match kind {
                wire::COMMAND_SET_FIDELITY => 4,
                wire::COMMAND_BRING_IN => wire::POSE_KEEP_PLACE | wire::POSE_KEEP_ROTATION,
                _ => 0,
            },
            youngs_modulus: 1e5,
            poisson_ratio: 0.3,
            parameters: [30.0, 0.5, 0.5, 0.0],
        },
        ..Default::default()
    };
    let all: Vec<wire::Command> = (1..=wire::COMMAND_CANCEL).map(command).collect();
    let mut seeds: Vec<Vec<u8>> = all.iter().map(|c| bytemuck::bytes_of(c).to_vec()).collect();
    seeds.push(bytemuck::cast_slice(&all).to_vec());
    // Those that are applied once in so many, the material a rigid one.
    let formed = all
        .iter()
        .filter(|c| [wire::COMMAND_RESET, wire::COMMAND_SET_MATERIAL].contains(&c.kind));
    seeds.extend(formed.map(|command| {
        let mut command = *command;
        command.sequence = RARE_EVERY;
        command.material.law = 9;
        bytemuck::bytes_of(&command).to_vec()
    }));
    seeds
}
