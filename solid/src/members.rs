//! Solids that move together with the rigid bodies that they may touch, and their contact from first touch to parting.

use super::{
    mover::{Around, Mover},
    rigid::RigidPeers,
};
use crate::{
    colliders::Substep,
    episodes::{Episodes, PairExchange},
    ledger::{ContactPartner, Ledger},
    motion::RigidMotion,
};

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

    /// Books what objects are given in a substep, before anything moves by it. Colliders have no episodes.
    pub fn book(&self, given: &Ledger, episodes: &mut Episodes) {
        let exchanged = given.pairs().filter_map(|(object, other, received)| {
            let ContactPartner::Object(other) = other else {
                return None;
            };
            Some(([object as u32, other as u32], received.opposite()))
        });
        let exchanged: Vec<PairExchange> = exchanged.collect();
        let now = self.now;
        let motion = |object: u32| self.motion(object as usize);
        episodes.book(&exchanged, motion, [now.kick, now.time + now.dt]);
    }

    /// Rigid part of the motion of an object [m, s], none of what is held or is not there.
    fn motion(&self, object: usize) -> Option<RigidMotion> {
        if let Some(mover) = self.group.iter().find(|mover| mover.id == object) {
            let solid = &mover.solid;
            let motion = || solid.state.rigid_motion(solid.model);
            return solid.is_free().then(motion).flatten();
        }
        let peers = self.peers.as_deref()?;
        let at = peers.objects().iter().position(|&id| id == object)?;
        let actor = &peers.actors()[at];
        let (body, shape) = (&actor.body, &actor.shape);
        Some(RigidMotion {
            com: body.com,
            velocity: body.velocity,
            spin: body.spin(&shape.inertia),
            radius: shape.radius,
        })
    }
}
