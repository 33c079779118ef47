//! Rigid bodies: at the nodes of the grid, then among each other and at colliders.

use super::tally::{Tally, timed};
use crate::{
    bodies::{
        actor::{Actor, Drive, Setting},
        engine::{CachedImpulse, Outcome, Partner, step},
        near::Fields,
        nodes::{Coupled, CoupledBody, CouplingInput, couple_bodies_to_grid},
    },
    colliders::Substep,
    grid::{FieldPass, anchors::Anchors},
    mat3::cross,
    report::ContactPartner,
    state::{Given, GridMotion, Matter, RigidBodies, Workspace, rigid::RigidBody},
};

/// Moves all rigid bodies by a substep `now`: coupled to nodes first, of which `passes` says per field when they move, then
/// by impacts, resting contact and flight. Returns the largest velocity component given to a node [cells/s].
#[expect(
    clippy::too_many_arguments,
    reason = "a phase: each group of the state that it changes is named"
)]
pub(crate) fn move_bodies(
    given: &Given<'_>,
    now: &Substep,
    passes: &[FieldPass],
    matter: &Matter,
    motion: &GridMotion,
    bodies: &mut RigidBodies,
    workspace: &mut Workspace,
    tally: &mut Tally,
) -> f32 {
    if !bodies.any() {
        return 0.0;
    }
    timed(&mut tally.timings.bodies, || {
        move_all(given, now, passes, matter, motion, bodies, workspace)
    })
}

fn move_all(
    given: &Given<'_>,
    now: &Substep,
    passes: &[FieldPass],
    matter: &Matter,
    motion: &GridMotion,
    bodies: &mut RigidBodies,
    workspace: &mut Workspace,
) -> f32 {
    // Their velocities are those of now, and they move along the mean one: no half substep is missing.
    let now = &Substep {
        kick: now.dt,
        ..*now
    };
    let RigidBodies {
        of,
        shapes,
        warm_start,
        ledger,
    } = bodies;
    let (mut coupled, mut objects) = (vec![], vec![]);
    for (object, (rigid, shape)) in of.iter().zip(&*shapes).enumerate() {
        if let (Some(rigid), Some(shape)) = (rigid, shape) {
            objects.push(object);
            coupled.push(CoupledBody {
                object,
                shape,
                body: rigid.body,
                drive: drive(given, object, rigid, now),
            });
        }
    }
    let at_nodes = couple(given, now, passes, matter, motion, &coupled, workspace);
    // In a single field nobody knows whose matter a node holds.
    let single = given.model.is_single_field();
    for (object, field, received) in at_nodes.received.iter().filter(|_| !single) {
        let other = ContactPartner::Object(*field as usize);
        ledger.add(*object, other, received);
    }
    let coupled = coupled.iter().zip(at_nodes.loads);
    let mut actors: Vec<Actor<'_>> = coupled
        .map(|(body, load)| Actor {
            shape: body.shape,
            body: body.body,
            drive: body.drive.with(load),
        })
        .collect();
    let outcome = advance(given, now, &objects, &mut actors, warm_start);
    workspace.body_pairs = outcome.pairs;
    for touch in &outcome.touches {
        let other = match touch.other {
            Partner::Body(body) => ContactPartner::Object(objects[body]),
            Partner::Wall(collider) => ContactPartner::Collider(collider),
        };
        ledger.add(objects[touch.body], other, &touch.received);
    }
    for (object, actor) in objects.iter().zip(&actors) {
        if let Some(rigid) = &mut of[*object] {
            rigid.body = actor.body;
        }
    }
    at_nodes.largest
}

/// Impulses between bodies and nodes.
fn couple(
    given: &Given<'_>,
    now: &Substep,
    passes: &[FieldPass],
    matter: &Matter,
    motion: &GridMotion,
    bodies: &[CoupledBody<'_>],
    workspace: &mut Workspace,
) -> Coupled {
    if matter.particles.groups.is_empty() {
        return Coupled {
            loads: vec![([0.0; 3], [0.0; 3]); bodies.len()],
            ..Coupled::default()
        };
    }
    let model = given.model;
    let scene = &model.scene;
    let single = model.is_single_field();
    let friction = |object: usize, field: u32| match single {
        true => scene.objects[object].surface.friction_to_objects(),
        false => scene.surface_between(object, field as usize).friction,
    };
    let anchors = Anchors::new(
        &matter.particles,
        &model.rules,
        &given.commanded.pins,
        *now,
        &workspace.concerned,
        workspace.grid.nodes.len(),
    );
    let input = CouplingInput {
        particles: &matter.particles,
        fields: Fields {
            cells_per_mass: &model.cells_per_mass,
            passes,
            reconstructs_surface: &model.constants.reconstructs_surface,
        },
        anchors: &anchors,
        // Of the substep before: that of this one is not known yet.
        fastest: 3.0_f64.sqrt() * motion.max_speed * scene.dx,
        dx: scene.dx,
        mass_unit: model.mass_unit,
        frame_velocity: motion.frame_velocity,
        gravity: given.commanded.gravity,
        dt: now.dt,
        friction: &friction,
        bonded: &|object, field| !single && object == field as usize,
    };
    couple_bodies_to_grid(&mut workspace.grid, bodies, &input)
}

/// Impacts at their moments, forces of resting contact, flight.
fn advance(
    given: &Given<'_>,
    now: &Substep,
    objects: &[usize],
    actors: &mut [Actor<'_>],
    warm_start: &mut Vec<CachedImpulse>,
) -> Outcome {
    let scene = &given.model.scene;
    let (solids, paths) = (&given.model.solids, &given.commanded.paths);
    let walls = |from: f64, length: f64| {
        let part = Substep {
            time: now.time + from,
            dt: length,
            ..*now
        };
        solids.all(paths, &part)
    };
    let surface = |a: usize, b: usize| {
        let surface = scene.surface_between(objects[a], objects[b]);
        (surface.restitution.unwrap_or(0.0), surface.friction)
    };
    let setting = Setting {
        gravity: given.commanded.gravity,
        dx: scene.dx,
        damping: scene.conditions.damping,
        walls: &walls,
        surface: &surface,
        friction: &|body| solids.friction_of(objects[body]),
    };
    step(actors, warm_start, &setting, now.dt)
}

/// What moves a body in a substep besides contact and gravity.
fn drive(given: &Given<'_>, object: usize, rigid: &RigidBody, now: &Substep) -> Drive {
    if given.levels[object].is_asleep() {
        return Drive::Kinematic {
            velocity: [0.0; 3],
            spin: [0.0; 3],
        };
    }
    prescribed(given, rigid, now).unwrap_or_else(|| pushed(given, object, rigid, now))
}

/// The motion of a body that a rule or a command moves.
fn prescribed(given: &Given<'_>, rigid: &RigidBody, now: &Substep) -> Option<Drive> {
    let (rules, pins) = (&given.model.rules, &given.commanded.pins);
    if !rules.hold_in(pins, now) {
        return None;
    }
    let dx = given.model.scene.dx;
    let mut members = rigid.members.iter();
    let field = members.find_map(|m| rules.field(pins, now, m.id))?;
    let com = rigid.body.com.map(|x| x / dx);
    let [_, a, b, c, _, d, e, f, _] = field.gradient();
    Some(Drive::Kinematic {
        velocity: field.velocity(com).map(|v| v * dx),
        spin: [0.5 * (f - d), 0.5 * (b - e), 0.5 * (c - a)],
    })
}

/// What impulses and body forces give to a body.
fn pushed(given: &Given<'_>, object: usize, rigid: &RigidBody, now: &Substep) -> Drive {
    let (rules, dx) = (&given.model.rules, given.model.scene.dx);
    let (mut force, mut torque) = ([0.0; 3], [0.0; 3]);
    if rules.push_in(now) {
        let pushes = rules.pushes(now);
        for member in &rigid.members {
            let change = pushes.on(member.id);
            if change == [0.0; 3] {
                continue;
            }
            let mass = given.model.grain(object, member.id, member.place).mass;
            let x = rigid.body.point(member.place);
            let f = change.map(|v| mass * v * dx / now.dt);
            let turn = cross(std::array::from_fn(|a| x[a] - rigid.body.com[a]), f);
            for a in 0..3 {
                force[a] += f[a];
                torque[a] += turn[a];
            }
        }
    }
    Drive::Free { force, torque }
}
