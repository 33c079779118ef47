//! The substep on one page: P2G, grid pass, contact, rigid bodies, G2P, guard, in the order of `docs/model.md`.
//!
//! Every phase is a function over what it reads and what it changes. The length of a substep is chosen before it begins (`limit`,
//! `schedule`); the loop with its rollbacks is the world's.

mod bodies;
mod contact;
mod coupling;
mod grid;
mod guard;
mod limit;
mod particles;
mod rigid;
mod schedule;
mod solids;
mod springs;
mod tally;

pub(crate) use bodies::move_bodies;
pub(crate) use coupling::OffGrid;
pub(crate) use guard::Failure;
pub(crate) use limit::{Limit, smallest_dt};
pub(crate) use schedule::{Schedule, Segment};
pub(crate) use solids::laws_of;
pub(crate) use tally::Tally;

use crate::{
    interruption::Interruption,
    model::Model,
    state::{State, Workspace},
};
use contact::{book_colliders, contact};
use grid::{NodeInput, grid_pass, kick_frame};
use guard::{check_travel, collect_extremes, larger, travel};
use particles::{gather, scatter};
use schedule::Context;
use springs::book_springs;

/// Takes one substep of a segment; returns the next one, if the segment goes on.
///
/// # Errors
/// [`Failure`] where the guard trips: whoever called undoes what has changed by then.
pub(crate) fn substep(
    model: &Model,
    segment: &Segment,
    schedule: &Schedule,
    (state, interruption): (&mut State, &Interruption<'_>),
    workspace: &mut Workspace,
    tally: &mut Tally,
) -> Result<Option<Schedule>, Failure> {
    let (given, moving) = state.split(model, interruption);
    let (matter, motion) = (moving.matter, moving.motion);
    let at = &Context::new(given, segment, schedule, motion.velocity_offset);
    // P2G: of the first substep of a segment. That of the others came with the G2P before.
    if segment.taken.is_empty() {
        scatter(at, matter, motion, workspace, tally)?;
    }
    // Grid pass: momentum to velocity, gravity, boundary conditions.
    kick_frame(at, motion);
    let (grid, concerned) = (&mut workspace.grid, &workspace.concerned);
    let input = &NodeInput::new(at, matter, motion, concerned, grid, tally);
    let on_nodes = grid_pass(at, input, grid, tally);
    // Contact: between the fields of objects.
    let in_contact = contact(at, input, grid, moving.in_contact, tally);
    // Rigid bodies and solids: at nodes, at each other and at colliders.
    let off_grid = OffGrid {
        bodies: moving.bodies,
        solids: moving.solids,
        episodes: &mut moving.in_contact.of_solids,
    };
    let at_bodies = move_bodies(&given, &at.now, matter, motion, off_grid, workspace, tally);
    // Guard: nothing may travel farther than the tiles reach.
    let speeds = [on_nodes, larger(in_contact, at_bodies)];
    let travel = travel(at, speeds, workspace, motion);
    let bounds = check_travel(travel);
    if !segment.is_last_try() {
        bounds?;
    }
    // G2P, constitutive law, and the P2G of the next substep.
    let next = segment.next(at, matter, motion);
    let ends = segment.ends(schedule, matter.drift, travel);
    let deformation = gather(at, &next, ends, matter, motion, workspace, tally);
    book_springs(&given, &mut moving.in_contact.ledger);
    book_colliders(
        &given,
        &matter.particles,
        &workspace.grid,
        moving.in_contact,
    );
    // Guard: nothing may be inside out, or nowhere.
    bounds.and(deformation)?;
    motion.velocity_offset = at.velocity_offset;
    collect_extremes(matter);
    Ok((!ends).then_some(next))
}
