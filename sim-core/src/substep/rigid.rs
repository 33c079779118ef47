//! All rigid bodies of a world, and what drives each of them through a span.

use super::springs::{Pulled, parts, pull_on_body};
use crate::{
    bodies::{
        actor::{Actor, Drive, Setting},
        body::Body,
        engine::{Outcome, step},
        pairs::Partner,
        warm_start::CachedImpulse,
    },
    colliders::Substep,
    coupling::nodes::Coupled,
    ledger::Ledger,
    mat3::cross,
    report::ContactPartner,
    solid::rigid::{RigidPeers, Wrench},
    state::{Given, RigidBodies, rigid::RigidBody},
};

/// All rigid bodies through a span.
pub(crate) struct RigidGroup<'a> {
    given: &'a Given<'a>,
    of: &'a mut [Option<RigidBody>],
    warm_start: &'a mut Vec<CachedImpulse>,
    pub ledger: &'a mut Ledger,
    objects: Vec<usize>,
    actors: Vec<Actor<'a>>,
    /// What matter on the grid gives to each throughout the span.
    at_nodes: Vec<Wrench>,
}

/// Bodies where they are, and what their next step begins with.
pub(crate) struct Places {
    bodies: Vec<Body>,
    warm_start: Vec<CachedImpulse>,
    ledger: Ledger,
}

impl<'a> RigidGroup<'a> {
    pub fn new(
        given: &'a Given<'a>,
        bodies: &'a mut RigidBodies,
        at_nodes: &Coupled,
        now: &Substep,
    ) -> Self {
        let RigidBodies {
            of,
            shapes,
            warm_start,
            ledger,
        } = bodies;
        let (mut objects, mut actors) = (vec![], vec![]);
        for (object, (rigid, shape)) in of.iter().zip(&*shapes).enumerate() {
            if let (Some(rigid), Some(shape)) = (rigid, shape) {
                objects.push(object);
                actors.push(Actor {
                    shape,
                    body: rigid.body,
                    drive: drive(given, object, rigid, now),
                });
            }
        }
        let loads = actors.iter().zip(&at_nodes.loads);
        Self {
            at_nodes: loads
                .map(|(actor, (force, torque))| Wrench::about(actor.body.com, *force, *torque))
                .collect(),
            given,
            of,
            warm_start,
            ledger,
            objects,
            actors,
        }
    }

    /// Centre of each body, and how far its surface may be from there within `length` [s] where it becomes `margin` times as
    /// fast [m].
    pub fn reaches(&self, margin: f64, length: f64) -> impl Iterator<Item = ([f64; 3], f64)> + '_ {
        let gravity = crate::mat3::length(self.given.commanded.gravity);
        self.actors.iter().map(move |actor| {
            let spin = crate::mat3::length(actor.body.spin(&actor.shape.inertia));
            let linear = crate::mat3::length(actor.body.velocity);
            let speed = linear + spin * actor.shape.radius;
            let way = margin * speed * length + gravity * length * length;
            (actor.body.com, actor.shape.radius + way)
        })
    }

    /// Their numbers in the scene.
    pub fn numbers(&self) -> &[usize] {
        &self.objects
    }

    /// Where all are.
    pub fn places(&self) -> Places {
        Places {
            bodies: self.actors.iter().map(|actor| actor.body).collect(),
            warm_start: self.warm_start.clone(),
            ledger: self.ledger.clone(),
        }
    }

    /// Back to where all were.
    pub fn put_back(&mut self, places: &Places) {
        for (actor, body) in self.actors.iter_mut().zip(&places.bodies) {
            actor.body = *body;
        }
        self.write();
        self.warm_start.clone_from(&places.warm_start);
        self.ledger.clone_from(&places.ledger);
    }

    fn write(&mut self) {
        for (object, actor) in self.objects.iter().zip(&self.actors) {
            if let Some(rigid) = &mut self.of[*object] {
                rigid.body = actor.body;
            }
        }
    }

    /// Moves all by a substep, in which solids give each a load as well.
    pub fn advance(&mut self, now: &Substep, loads: Option<&[Wrench]>) {
        if self.actors.is_empty() {
            return;
        }
        for part in &parts(self.given, &self.objects, now) {
            self.advance_part(part, loads);
        }
        self.write();
    }

    fn advance_part(&mut self, now: &Substep, loads: Option<&[Wrench]>) {
        let mut pulled = vec![];
        for (n, (actor, object)) in self.actors.iter_mut().zip(&self.objects).enumerate() {
            let Some(rigid) = &self.of[*object] else {
                continue;
            };
            let com = actor.body.com;
            actor.drive =
                drive(self.given, *object, rigid, now).with(self.at_nodes[n].load_about(com));
            if let Some(loads) = loads {
                actor.drive = actor.drive.with(loads[n].load_about(com));
            }
            let at = (&actor.body, actor.shape);
            let pull = pull_on_body(self.given, *object, rigid, at, now);
            actor.drive = actor.drive.with(pull);
            pulled.extend(Pulled::new(actor, pull).map(|pulled| (n, pulled)));
        }
        let outcome = advance(
            self.given,
            now,
            &self.objects,
            &mut self.actors,
            self.warm_start,
        );
        for touch in &outcome.touches {
            let other = match touch.other {
                Partner::Body(body) => ContactPartner::Object(self.objects[body]),
                Partner::Wall(collider) => ContactPartner::Collider(collider),
            };
            self.ledger
                .add(self.objects[touch.body], other, &touch.received);
        }
        for (n, pulled) in pulled {
            let given = pulled.given(&self.actors[n], now.dt);
            self.ledger.add_spring(self.objects[n], &given);
        }
    }
}

impl RigidPeers for RigidGroup<'_> {
    fn actors(&self) -> &[Actor<'_>] {
        &self.actors
    }

    fn objects(&self) -> &[usize] {
        &self.objects
    }

    fn advance(&mut self, now: &Substep, loads: &[Wrench]) {
        RigidGroup::advance(self, now, Some(loads));
    }

    fn push(&mut self, impulses: &[Wrench]) {
        for (actor, impulse) in self.actors.iter_mut().zip(impulses) {
            if let Drive::Free { .. } = actor.drive {
                let (push, turn) = impulse.load_about(actor.body.com);
                for a in 0..3 {
                    actor.body.velocity[a] += push[a] / actor.shape.inertia.mass;
                    actor.body.angular_momentum[a] += turn[a];
                }
            }
        }
        self.write();
    }
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
        damping: given.model.damping,
        walls: &walls,
        surface: &surface,
        friction: &|body| solids.friction_of(objects[body]),
        interruption: given.interruption,
    };
    step(actors, warm_start, &setting, now.dt)
}

/// What moves a body in a substep besides contact and gravity.
pub(super) fn drive(given: &Given<'_>, object: usize, rigid: &RigidBody, now: &Substep) -> Drive {
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
