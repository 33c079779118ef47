//! Springs that hold patches: on rigid bodies and solids, and what they gave to all.

use crate::{
    bodies::{
        actor::{Actor, Drive},
        body::Body,
        shape::Shape,
    },
    colliders::{Substep, springs::Given as FromSprings},
    ledger::Ledger,
    mat3::cross,
    solid::springs::SolidSpring,
    state::{Given, rigid::RigidBody},
};

/// Longest time in which the force of a spring on a body is constant [s].
const LONGEST: f64 = 1.0 / 240.0;

/// Books what springs gave to matter on the grid.
pub(super) fn book_springs(given: &Given<'_>, ledger: &mut Ledger) {
    for spring in given.model.rules.springs.iter() {
        ledger.add_spring(spring.object, &spring.take());
    }
}

/// Forgets what springs gave to matter: a segment begins, perhaps anew.
pub(super) fn forget_springs(given: &Given<'_>) {
    let springs = given.model.rules.springs.iter();
    springs.for_each(|spring| spring.forget());
}

/// Parts of a substep in which springs pull bodies with constant forces: all of it where none does.
pub(super) fn parts(given: &Given<'_>, objects: &[usize], now: &Substep) -> Vec<Substep> {
    let mut springs = given.model.rules.springs.iter();
    let count = match springs.any(|spring| objects.contains(&spring.object)) {
        true => (now.dt / LONGEST - 1e-9).ceil().max(1.0),
        false => 1.0,
    };
    let dt = now.dt / count;
    let part = |n: u32| Substep {
        time: now.time + f64::from(n) * dt,
        dt,
        kick: dt,
        ..*now
    };
    (0..count as u32).map(part).collect()
}

/// Force [N] of springs on a body in a substep, and torque about its centre of mass [N m].
pub(super) fn pull_on_body(
    given: &Given<'_>,
    object: usize,
    rigid: &RigidBody,
    (body, shape): (&Body, &Shape),
    now: &Substep,
) -> ([f64; 3], [f64; 3]) {
    let (mut force, mut torque) = ([0.0; 3], [0.0; 3]);
    let springs = given.model.rules.springs.iter();
    for spring in springs.filter(|spring| spring.object == object) {
        let spin = body.spin(&shape.inertia);
        for member in &rigid.members {
            let Some(number) = spring.number(member.id) else {
                continue;
            };
            let x = body.point(member.place);
            let r = std::array::from_fn(|a| x[a] - body.com[a]);
            let turn = cross(spin, r);
            let v = std::array::from_fn(|a| body.velocity[a] + turn[a]);
            let gravity = given.commanded.gravity;
            let f = spring.force(number, [now.time, now.dt], [x, v], gravity);
            let turn = cross(r, f);
            for a in 0..3 {
                force[a] += f[a];
                torque[a] += turn[a];
            }
        }
    }
    (force, torque)
}

/// What springs pull a body with in a substep.
pub(super) struct Pulled {
    force: [f64; 3],
    torque: [f64; 3],
    before: Body,
}

impl Pulled {
    /// A body that is pulled by a force [N] and a torque [N m], where it is any.
    pub fn new(actor: &Actor<'_>, (force, torque): ([f64; 3], [f64; 3])) -> Option<Self> {
        let is_free = matches!(actor.drive, Drive::Free { .. });
        let is_pulled = force != [0.0; 3] || torque != [0.0; 3];
        (is_free && is_pulled).then_some(Self {
            force,
            torque,
            before: actor.body,
        })
    }

    /// What it was given in `dt` [s], after which it is where the actor says: work along the way, and along the mean of the
    /// spins. The force stays where it attacked, so its torque about the centre of mass changes on the way.
    pub fn given(&self, actor: &Actor<'_>, dt: f64) -> FromSprings {
        let inertia = &actor.shape.inertia;
        let [one, other] = [&self.before, &actor.body].map(|body| body.spin(inertia));
        let way: [f64; 3] = std::array::from_fn(|a| actor.body.com[a] - self.before.com[a]);
        let turn = cross(way, self.force);
        let mut work = 0.0;
        for a in 0..3 {
            let torque = self.torque[a] - 0.5 * turn[a];
            work += self.force[a] * way[a] + torque * 0.5 * dt * (one[a] + other[a]);
        }
        FromSprings {
            impulse: self.force.map(|f| dt * f),
            work,
        }
    }
}

/// Springs on particles of a solid in a span.
pub(super) fn springs_of_solid<'a>(given: &Given<'a>, id: usize) -> Vec<SolidSpring<'a>> {
    let Some(solid) = given.model.lagrangian[id].as_ref() else {
        return vec![];
    };
    let first = given.model.scene.objects[id].particles.start;
    let springs = given.model.rules.springs.iter();
    let own = springs.filter(|spring| spring.object == id);
    own.map(|spring| SolidSpring::new(spring, solid, first))
        .collect()
}
