//! Solids, and what they touch, as wholes: from first touch to parting, with the restitution that is asked of objects.

use super::{
    model::SolidModel,
    mover::{Around, Mover},
    rigid::{RigidPeers, Wrench},
    state::SolidState,
};
use crate::{
    bodies::actor::Drive,
    colliders::Substep,
    episodes::{COLLIDERS, Episodes, Movers, RequestedRestitution},
    ledger::{ContactPartner, Ledger},
    mat3::{Mat3, length},
    motion::{RigidMotion, SUMS, add_to_sums},
};

/// Contact between wholes, and what is asked of them.
pub struct Wholes<'a> {
    /// Pairs that are in contact, of those that move together.
    pub episodes: &'a mut Episodes,
    /// Restitution that is asked of a pair, the lower number first.
    pub wish: &'a dyn Fn([u32; 2]) -> RequestedRestitution,
}

/// Solids of a group where they are, with what they touch.
pub(super) struct Members<'g, 'a> {
    pub group: &'g mut [Mover<'a>],
    pub peers: Option<&'g mut dyn RigidPeers>,
    pub around: &'g Around<'g>,
    pub now: &'g Substep,
}

impl<'g, 'a> Members<'g, 'a> {
    pub fn new(
        group: &'g mut [Mover<'a>],
        peers: &'g mut Option<&mut dyn RigidPeers>,
        around: &'g Around<'g>,
        now: &'g Substep,
    ) -> Self {
        Self {
            group,
            peers: peers.as_mut().map(|peers| &mut **peers as _),
            around,
            now,
        }
    }
}

/// Number of what a solid touched.
fn number(other: ContactPartner) -> u32 {
    match other {
        ContactPartner::Object(object) => object as u32,
        ContactPartner::Collider(collider) => COLLIDERS + collider as u32,
    }
}

impl Wholes<'_> {
    /// Takes in what pairs are given in a substep, before anything moves by it. Contact with colliders that ask for no restitution is
    /// nobody's concern.
    pub(super) fn take_in(&mut self, members: &Members<'_, '_>, given: &Ledger) {
        let pairs = given.pairs().map(|(object, other, received)| {
            let pair = [object as u32, number(other)];
            (pair, received.opposite())
        });
        let matters =
            |pair: [u32; 2]| pair[1] < COLLIDERS || (self.wish)(pair).restitution.is_some();
        let exchanged: Vec<_> = pairs.filter(|(pair, _)| matters(*pair)).collect();
        let kick = members.now.kick;
        self.episodes.take_in(members, &exchanged, [0.0; 3], kick);
    }

    /// Whether a pair may part with a restitution that is asked.
    pub(super) fn are_due(&self) -> bool {
        let asks = |pair| (self.wish)(pair).restitution.is_some();
        self.episodes.is_due(asks)
    }

    /// Lets pairs part that have come apart.
    pub(super) fn part(&mut self, members: &mut Members<'_, '_>, given: &mut Ledger) {
        if self.episodes.pairs().next().is_none() {
            return;
        }
        let now = members.now;
        // Twice what gravity adds in a substep: what rests does not bounce.
        let gravity = members.around.outside.gravity;
        let resting = 2.0 * length(gravity) * now.kick;
        let mut parted = vec![];
        let end = now.time + now.dt;
        let falling = (resting, gravity);
        self.episodes
            .part(members, self.wish, falling, end, &mut parted);
        for ([object, other], received) in parted {
            let other = match other.checked_sub(COLLIDERS) {
                None => ContactPartner::Object(other as usize),
                Some(collider) => ContactPartner::Collider(collider as usize),
            };
            given.add(object as usize, other, &received.opposite());
        }
    }
}

impl Movers for Members<'_, '_> {
    fn motion(&self, number: u32, place: [f64; 3]) -> Option<RigidMotion> {
        if let Some(collider) = number.checked_sub(COLLIDERS) {
            let placed = self.around.boundaries.all(self.around.paths, self.now);
            let wall = placed.iter().find(|p| p.id == collider as usize)?;
            return Some(RigidMotion::of_wall(place, wall.velocity(place)));
        }
        if let Some(mover) = self.group.iter().find(|mover| mover.id == number as usize) {
            let (state, model) = (&*mover.solid.state, mover.solid.model);
            let free = mover.solid.is_free();
            return free.then(|| motion_of(state, model)).flatten();
        }
        let peers = self.peers.as_deref()?;
        let at = peers
            .objects()
            .iter()
            .position(|&id| id == number as usize)?;
        let actor = &peers.actors()[at];
        let inertia = &actor.shape.inertia;
        let free = matches!(actor.drive, Drive::Free { .. });
        Some(RigidMotion {
            mass: if free { inertia.mass } else { f64::INFINITY },
            com: actor.body.com,
            velocity: actor.body.velocity,
            spin: actor.body.spin(inertia),
            inverse_inertia: match free {
                true => actor.body.inverse_inertia(inertia),
                false => Mat3([[0.0; 3]; 3]),
            },
            vibration: 0.0,
            radius: actor.shape.radius,
        })
    }

    fn push(
        &mut self,
        number: u32,
        motion: &RigidMotion,
        place: [f64; 3],
        impulse: [f64; 3],
        keep: f64,
    ) {
        let mut group = self.group.iter_mut();
        if let Some(mover) = group.find(|mover| mover.id == number as usize) {
            let solid = &mut mover.solid;
            push(solid.state, solid.model, motion, (place, impulse), keep);
            solid.scratch.tiles.look_at(&solid.state.nodes);
        } else if let Some(peers) = &mut self.peers {
            let mut impulses = vec![Wrench::default(); peers.objects().len()];
            let mut bodies = peers.objects().iter().zip(&mut impulses);
            if let Some((_, own)) = bodies.find(|(id, _)| **id == number as usize) {
                *own = Wrench::about(place, impulse, [0.0; 3]);
            }
            peers.push(&impulses);
        }
    }
}

/// Motion of a solid as a whole [kg, m, s], none where it has no extent: spin is that with which its nodes have their angular momentum.
pub fn motion_of(state: &SolidState, model: &SolidModel) -> Option<RigidMotion> {
    // Sums of squares are exact enough about a place amid it.
    let origin = state.position(model, model.nodes().next()?);
    let mut sums = [0.0; SUMS];
    // Outer nodes have no mass.
    for slot in model.nodes().filter(|&slot| model.mass[slot] > 0.0) {
        let (x, v) = (state.position(model, slot), state.velocity_of(model, slot));
        let x = std::array::from_fn(|a| x[a] - origin[a]);
        add_to_sums(&mut sums, model.mass[slot], x, v);
    }
    RigidMotion::from_sums(&sums, origin)
}

/// Gives a solid of this motion an impulse at a place, and scales what it vibrates with.
fn push(
    state: &mut SolidState,
    model: &SolidModel,
    motion: &RigidMotion,
    (place, impulse): ([f64; 3], [f64; 3]),
    keep: f64,
) {
    let after = motion.after(place, impulse);
    let at = state.positions(model);
    state.change_velocities(model, |slot, v| {
        let (rigid, pushed) = (motion.at(at[slot]), after.at(at[slot]));
        std::array::from_fn(|a| pushed[a] + keep * (v[a] - rigid[a]))
    });
}
