//! What happens when things go wrong, and what commands do.

use super::*;
use crate::{
    command::{Action, CommandError},
    notices::Notices,
    report::Level,
    scene::Aabb,
};

fn command(sequence: u64, action: Action) -> Command {
    Command {
        client: 1,
        sequence,
        apply_at_step: 0,
        action,
    }
}

/// Group and lane of some particle.
fn somewhere(world: &World) -> (usize, usize) {
    let group = world.state.matter.particles.groups.len() / 2;
    let ids = &world.state.matter.particles.fixed[group].id;
    let lane = ids
        .iter()
        .rposition(|&id| id != crate::particles::NO_PARTICLE);
    (group, lane.expect("no group is empty"))
}

fn finite(world: &World) -> bool {
    let positions = world.positions().iter().flatten();
    let deformations = world.deformations().iter().flatten();
    positions.chain(deformations).all(|x| x.is_finite())
        && world.velocities().iter().flatten().all(|x| x.is_finite())
        && world
            .report()
            .objects
            .iter()
            .all(|o| o.kinetic_energy.is_finite())
}

#[test]
fn a_particle_with_nan_velocity_is_quarantined_alone() {
    let scene = falling_block(Law::FixedCorotated);
    let mut world = World::new(scene).expect("valid scene");
    world.step(1.0 / 60.0, &[]);
    let before = world.positions().to_vec();
    let (group, lane) = somewhere(&world);
    let id = world.state.matter.particles.fixed[group].id[lane];
    world.state.matter.particles.motion[group].v[1].0[lane] = f32::NAN;
    let report = world.step(1.0 / 60.0, &[]);
    assert_eq!(report.quarantined, [id]);
    assert!(finite(&world));
    assert_eq!(world.positions()[id as usize], before[id as usize]);
    let mass = report.objects[0].mass;
    for _ in 0..5 {
        let report = world.step(1.0 / 60.0, &[]);
        assert!(report.quarantined.is_empty());
        assert_eq!(report.objects[0].mass, mass);
    }
    assert_eq!(world.positions()[id as usize], before[id as usize]);
    assert!(finite(&world));
}

#[test]
fn an_extreme_material_edit_is_contained() {
    let scene = falling_block(Law::FixedCorotated);
    let mut world = World::new(scene).expect("valid scene");
    // On the floor and compressed.
    for _ in 0..9 {
        world.step(1.0 / 60.0, &[]);
    }
    let stiff = |e: f64| Action::SetMaterial {
        object: 0,
        region: None,
        patch: None,
        material: elastic(Law::NeoHookean, e, 0.45),
    };
    let Err(CommandError::OutOfRange { field, max, .. }) = world.check(&stiff(1e15)) else {
        panic!("1e15 Pa was accepted");
    };
    assert_eq!(field, "youngs_modulus");
    // The stiffest that is allowed, behind the back of the time step control.
    let edit = [command(0, stiff(1e-3 * max))];
    world.step(1.0 / 60.0, &edit);
    assert!(finite(&world));
    assert_eq!(world.material(0).law, Law::NeoHookean);
}

#[test]
fn a_crushed_particle_is_rolled_back_and_then_quarantined() {
    let scene = falling_block(Law::FixedCorotated);
    let mut world = World::new(scene).expect("valid scene");
    world.step(1.0 / 60.0, &[]);
    let (group, lane) = somewhere(&world);
    let id = world.state.matter.particles.fixed[group].id[lane];
    // Turned inside out: no substep is small enough to mend that.
    world.state.matter.particles.groups[group].f[0].0[lane] = -1.0;
    let report = world.step(1.0 / 60.0, &[]);
    assert!(report.rollbacks > 0);
    assert_eq!(report.quarantined, [id]);
    assert!(finite(&world));
    // The frame was completed nevertheless.
    assert!((report.sim_time - 2.0 / 60.0).abs() < 1e-12);
}

#[test]
fn leaving_the_domain_is_an_event() {
    let mut scene = falling_block(Law::FixedCorotated);
    scene.colliders.clear();
    scene.domain = Aabb {
        min: [-2.0, -2.0, -0.5],
        max: [2.0; 3],
    };
    let count = scene.particles.position.len();
    let mut world = World::new(scene).expect("valid scene");
    let mut left = vec![];
    for _ in 0..60 {
        let report = world.step(1.0 / 60.0, &[]);
        for &id in &report.left_domain {
            let x = world.positions()[id as usize];
            assert!(x[2] < -0.4 && x[2] > -0.8, "{x:?}");
        }
        left.extend(report.left_domain);
        assert!(finite(&world));
    }
    left.sort_unstable();
    assert_eq!(left, (0..count as u32).collect::<Vec<_>>());
    assert_eq!(world.report().objects[0].mass, 0.0);
    let push = Action::Impulse {
        object: 0,
        impulse: [1.0; 3],
    };
    let refused = CommandError::NothingLeft {
        object: 0,
        particles: count,
    };
    assert_eq!(world.check(&push), Err(refused));
    assert_eq!(world.report().objects[0].level, Level::Gone);
    let mut notices = Notices::new(world.scene());
    let said = notices.of(world.scene(), world.report());
    assert!(
        said.len() == 1 && said[0].contains("nothing is left of object"),
        "{said:?}"
    );
    let report = world.step(1.0 / 60.0, &[]);
    let again = notices.of(world.scene(), &report);
    assert!(again.is_empty(), "{again:?}");
    // A reset brings it back.
    world.step(1.0 / 60.0, &[command(1, Action::Reset)]);
    assert_eq!(world.report().objects[0].level, Level::Mpm);
}

#[test]
fn refused_commands_change_no_bit() {
    let scene = falling_block(Law::FixedCorotated);
    let mut plain = World::new(scene.clone()).expect("valid scene");
    let mut pestered = World::new(scene).expect("valid scene");
    let m = |e: f64, nu: f64| elastic(Law::NeoHookean, e, nu);
    let bad = [
        Action::Impulse {
            object: 7,
            impulse: [1.0; 3],
        },
        Action::Impulse {
            object: 0,
            impulse: [f64::NAN, 0.0, 0.0],
        },
        Action::Impulse {
            object: 0,
            impulse: [1e300, 0.0, 0.0],
        },
        Action::ImpulseAt {
            object: 0,
            impulse: [1.0; 3],
            point: [f64::INFINITY; 3],
            radius: 1.0,
        },
        Action::ImpulseAt {
            object: 0,
            impulse: [1.0; 3],
            point: [0.0; 3],
            radius: -1.0,
        },
        Action::ImpulseAt {
            object: 0,
            impulse: [1e9; 3],
            point: [0.0; 3],
            radius: 1e-6,
        },
        Action::SetVelocity {
            object: 0,
            linear: [0.0; 3],
            angular: [0.0, 1e12, 0.0],
        },
        Action::SetVelocity {
            object: 0,
            linear: [0.0, f64::NAN, 0.0],
            angular: [0.0; 3],
        },
        Action::SetMaterial {
            object: 0,
            region: None,
            patch: None,
            material: m(f64::NAN, 0.3),
        },
        Action::SetMaterial {
            object: 0,
            region: None,
            patch: None,
            material: m(-1.0, 0.3),
        },
        Action::SetMaterial {
            object: 0,
            region: None,
            patch: None,
            material: m(1e5, 0.5),
        },
        Action::SetGravity {
            gravity: [0.0, 0.0, f64::NEG_INFINITY],
        },
        Action::SetGravity {
            gravity: [0.0, 0.0, 1e9],
        },
    ];
    for action in &bad {
        let error = pestered
            .check(action)
            .expect_err("must be refused")
            .to_string();
        assert!(!error.is_empty());
    }
    let commands: Vec<Command> = (0..)
        .zip(bad)
        .map(|(n, action)| command(n, action))
        .collect();
    for _ in 0..5 {
        let expected = plain.step(1.0 / 60.0, &[]).state_hash;
        assert_eq!(pestered.step(1.0 / 60.0, &commands).state_hash, expected);
    }
}

#[test]
fn reset_reproduces_the_run() {
    let scene = falling_block(Law::NeoHookean);
    let mut world = World::new(scene).expect("valid scene");
    let initial = world.report().state_hash;
    let first: Vec<u64> = (0..15)
        .map(|_| world.step(1.0 / 60.0, &[]).state_hash)
        .collect();
    let push = Action::ImpulseAt {
        object: 0,
        impulse: [3.0, 0.0, 5.0],
        point: [0.0; 3],
        radius: 0.1,
    };
    let gravity = Action::SetGravity { gravity: [1.0; 3] };
    world.step(1.0 / 60.0, &[command(0, push), command(1, gravity)]);
    world.step(0.0, &[command(2, Action::Reset)]);
    assert_eq!(world.report().state_hash, initial);
    assert_eq!((world.report().step, world.report().sim_time), (17, 0.0));
    let again: Vec<u64> = (0..15)
        .map(|_| world.step(1.0 / 60.0, &[]).state_hash)
        .collect();
    assert_eq!(first, again);
}

#[test]
fn impulses_change_momentum_by_exactly_what_they_are() {
    let mut scene = falling_block(Law::FixedCorotated);
    scene.gravity = [0.0; 3];
    scene.colliders.clear();
    let mut world = World::new(scene).expect("valid scene");
    let before = world.report().linear_momentum;
    let actions = [
        Action::Impulse {
            object: 0,
            impulse: [1.0, 2.0, 3.0],
        },
        Action::ImpulseAt {
            object: 0,
            impulse: [0.5, -1.0, 0.25],
            point: [0.1, 0.1, 0.2],
            radius: 0.1,
        },
        // Nothing within reach: the nearest particle takes it.
        Action::ImpulseAt {
            object: 0,
            impulse: [0.1, 0.0, 0.0],
            point: [5.0, 0.0, 0.2],
            radius: 0.1,
        },
    ];
    let commands: Vec<Command> = (0..).zip(actions).map(|(n, a)| command(n, a)).collect();
    world.step(0.0, &commands);
    let after = world.report().linear_momentum;
    // Single precision of a momentum of some 80 kg m/s.
    let moved: [f64; 3] = std::array::from_fn(|a| after[a] - before[a]);
    assert!(distance(moved, [1.6, 1.0, 3.25]) < 1e-4, "{moved:?}");
    // What commands give is no contact.
    let contact = norm(world.step(1.0 / 60.0, &[]).objects[0].contact_impulse);
    assert!(contact < 1e-4, "{contact}");
}

#[test]
fn set_velocity_gives_a_rigid_field() {
    let mut scene = falling_block(Law::FixedCorotated);
    scene.gravity = [0.0; 3];
    scene.colliders.clear();
    let mut world = World::new(scene).expect("valid scene");
    let action = Action::SetVelocity {
        object: 0,
        linear: [1.0, -2.0, 0.5],
        angular: [0.3, 4.0, -1.0],
    };
    let report = world.step(0.0, &[command(0, action)]);
    let object = &report.objects[0];
    assert!(distance(object.linear_velocity, [1.0, -2.0, 0.5]) < 1e-6);
    assert!(distance(object.angular_velocity, [0.3, 4.0, -1.0]) < 1e-5);
    assert_eq!(
        world.affine()[0],
        [0.0, 1.0, 4.0, -1.0, 0.0, -0.3, -4.0, 0.3, 0.0]
    );
}

#[test]
fn commands_act_in_the_order_of_step_client_and_sequence() {
    let scene = falling_block(Law::FixedCorotated);
    let set = |client: u64, sequence: u64, apply_at_step: u64, g: f64| Command {
        client,
        sequence,
        apply_at_step,
        action: Action::SetGravity {
            gravity: [0.0, 0.0, g],
        },
    };
    let mut world = World::new(scene).expect("valid scene");
    world.step(
        0.0,
        &[set(2, 0, 1, -2.0), set(1, 9, 1, -1.0), set(9, 9, 0, -9.0)],
    );
    assert_eq!(world.gravity(), [0.0, 0.0, -2.0]);
}

#[test]
fn impossible_scenes_are_refused_with_a_reason() {
    let refuse = |change: &dyn Fn(&mut Scene)| {
        let mut scene = falling_block(Law::FixedCorotated);
        change(&mut scene);
        World::new(scene).err().map(|error| error.to_string())
    };
    let reason = |change: &dyn Fn(&mut Scene)| refuse(change).expect("refused");
    assert_eq!(refuse(&|_| ()), None);
    assert!(reason(&|s| s.dx = f64::NAN).starts_with("dx is NaN, expected"));
    assert!(reason(&|s| s.particles.volume[3] = -1.0).starts_with("volume of particle 3 is -1"));
    assert!(
        reason(&|s| s.particles.position[4][1] = f64::INFINITY)
            .starts_with("position[1] of particle 4 is inf")
    );
    assert!(reason(&|s| s.objects[0].particles.end = 9999).contains("claims particles 0..9999"));
    assert!(
        reason(&|s| s.objects[0].material.poisson_ratio = 0.5)
            .starts_with("poisson_ratio of object 0 is 0.5")
    );
    assert!(
        reason(&|s| s.particles.volume.truncate(1))
            .contains("336 particle positions and 1 volumes")
    );
}
