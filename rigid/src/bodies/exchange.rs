//! What pairs exchanged in a step of the solver.

use rapier3d_f64::{
    geometry::{ContactPair, NEW_CONTACT_BIT},
    parry::math::Vector,
    pipeline::PhysicsWorld,
};

use super::{
    actor::{Actor, Drive},
    body::Body,
    hooks::Surroundings,
    pairs::{ExchangedImpulse, partner},
    vector::{Vec3, along, length, scaled, sub},
};
use crate::{ledger::Received, mat3::dot};

/// Places of a pair among bodies and colliders.
pub(super) fn places_of(world: &PhysicsWorld, pair: &ContactPair) -> [u32; 2] {
    [pair.collider1, pair.collider2].map(|handle| world.colliders[handle].user_data as u32)
}

/// What pairs exchanged in the latest step, and with what others are held by joints.
pub(super) fn exchanged(world: &PhysicsWorld, held: &[[u32; 2]]) -> Vec<Exchanged> {
    let mut all: Vec<Exchanged> = vec![];
    for pair in world.narrow_phase.contact_pairs() {
        let places = places_of(world, pair);
        for manifold in pair.solver_manifolds() {
            let mut one = Exchanged::new(places);
            let (mut last, mut across) = (0.0, Vector::ZERO);
            for contact in &manifold.data.solver_contacts {
                let n = (contact.contact_id[0] & !NEW_CONTACT_BIT) as usize;
                let point = &manifold.points[n];
                let place = world.colliders[pair.collider1].position() * point.local_p1;
                one.size += point.data.impulse;
                one.moment = along(one.moment, point.data.impulse, place.into());
                last += point.data.warmstart_impulse;
                across = point.data.warmstart_tangent_world;
            }
            if one.size <= 0.0 {
                continue;
            }
            // Friction is known of the last iteration: all have the same share of what presses.
            let share = if last > 0.0 { one.size / last } else { 0.0 };
            one.normal = scaled((-manifold.data.normal).into(), one.size);
            one.impulse = along(one.normal, share, across.into());
            all.push(one.in_order());
        }
    }
    all.extend(held.iter().map(|pair| Exchanged::new(*pair)));
    all.sort_by_key(|one| one.pair);
    all.dedup_by(|next, sum| sum.pair == next.pair && sum.take(next));
    all
}

/// What the first of a pair received from the second.
pub(super) struct Exchanged {
    pub pair: [u32; 2],
    impulse: Vec3,
    /// The part along normals, the sum of sizes of it, and of places times that.
    normal: Vec3,
    size: f64,
    moment: Vec3,
}

impl Exchanged {
    fn new(pair: [u32; 2]) -> Self {
        Self {
            pair,
            impulse: [0.0; 3],
            normal: [0.0; 3],
            size: 0.0,
            moment: [0.0; 3],
        }
    }

    /// The same with the lower place first.
    fn in_order(self) -> Self {
        let [a, b] = self.pair;
        if a < b {
            return self;
        }
        Self {
            pair: [b, a],
            impulse: scaled(self.impulse, -1.0),
            normal: scaled(self.normal, -1.0),
            ..self
        }
    }

    /// Adds another of the same pair.
    fn take(&mut self, more: &Self) -> bool {
        self.impulse = along(self.impulse, 1.0, more.impulse);
        self.normal = along(self.normal, 1.0, more.normal);
        self.moment = along(self.moment, 1.0, more.moment);
        self.size += more.size;
        true
    }
}

/// Notes what pairs exchanged. What a body got of the only one that it met is the change of its momentum.
pub(super) fn note(
    actors: &[Actor<'_>],
    before: &[Body],
    around: &Surroundings<'_, '_>,
    exchanged: Vec<Exchanged>,
    dt: f64,
    touches: &mut Vec<ExchangedImpulse>,
) {
    let mut partners = vec![0_usize; around.moment.solids.len()];
    for n in exchanged.iter().flat_map(|one| one.pair) {
        partners[n as usize] += 1;
    }
    let got = |n: usize| {
        let actor = actors.get(n)?;
        let Drive::Free { force, .. } = actor.drive else {
            return None;
        };
        let mass = actor.shape.inertia.mass;
        let gained = scaled(sub(actor.body.velocity, before[n].velocity), mass);
        let pushed = along(scaled(around.setting.gravity, mass), 1.0, force);
        (partners[n] == 1).then(|| along(gained, -dt, pushed))
    };
    for mut one in exchanged {
        let [a, b] = one.pair.map(|n| n as usize);
        if let Some(impulse) = got(a).or_else(|| Some(scaled(got(b)?, -1.0))) {
            one.impulse = impulse;
            if one.size == 0.0 {
                // Held by a joint, where it is.
                one.size = length(impulse);
                one.normal = impulse;
                one.moment = scaled(before[a].com, one.size);
            } else {
                let size = length(one.normal);
                let normal = scaled(one.normal, 1.0 / size.max(f64::MIN_POSITIVE));
                one.normal = scaled(normal, dot(impulse, normal));
            }
        }
        if one.size > 0.0 {
            touches.push(ExchangedImpulse {
                body: a,
                other: partner(actors.len(), &around.moment.walls, one.pair[1]),
                received: Received {
                    impulse: one.impulse,
                    normal_impulse: one.normal,
                    weight: one.size,
                    moment: one.moment,
                },
            });
        }
    }
}
