//! Rigid bodies: at the nodes of the grid, then among each other and at colliders.

use super::{
    coupling::{OffGrid, couple},
    rigid::RigidGroup,
    solids::{Solids, move_solids},
    tally::Tally,
};
use crate::{
    colliders::Substep,
    report::ContactPartner,
    state::{Given, GridMotion, Matter, Workspace},
    timed,
};

/// Moves all rigid bodies and solids by a substep `now`: bodies coupled to nodes first, then by impacts, resting contact and
/// flight, with the solids that they touch. Returns the largest velocity component given to a node [cells/s].
pub(crate) fn move_bodies(
    given: &Given<'_>,
    now: &Substep,
    matter: &Matter,
    motion: &GridMotion,
    off_grid: OffGrid<'_>,
    workspace: &mut Workspace,
    tally: &mut Tally,
) -> f32 {
    let has_solids = off_grid.has_moving_solids(given);
    if !off_grid.bodies.any() && !has_solids {
        return 0.0;
    }
    // Their velocities are those of now, and they move along the mean one: no half substep is missing.
    let now = &Substep {
        kick: now.dt,
        ..*now
    };
    let (at_nodes, solids_at_nodes) = timed(&mut tally.timings.coupling, || {
        couple(given, now, matter, motion, &off_grid, workspace)
    });
    let mut rigid = RigidGroup::new(given, off_grid.bodies, &at_nodes, now);
    let received = at_nodes.received.iter().chain(&solids_at_nodes.received);
    // In a single field nobody knows whose matter a node holds.
    let is_known = !given.model.is_single_field();
    for (object, field, received) in received.filter(|_| is_known) {
        let other = ContactPartner::Object(*field as usize);
        rigid.ledger.add(*object, other, received);
    }
    if has_solids {
        let solids = Solids {
            states: off_grid.solids,
            scratch: &mut workspace.solids,
            at_nodes: &solids_at_nodes.impulses,
            episodes: off_grid.episodes,
        };
        move_solids(given, now, solids, &mut rigid, tally);
    } else {
        timed(&mut tally.timings.bodies, || rigid.advance(now, None));
    }
    at_nodes.largest.max(solids_at_nodes.largest)
}
