//! Contact between the grid fields of objects.

use super::{grid::NodeInput, schedule::Context, tally::Tally};
use crate::{
    contact::{ContactInput, meet},
    grid::Grid,
    particles::Particles,
    state::{Given, in_contact::InContact},
    timed,
};

/// Lets fields meet at the nodes that they share; returns the largest velocity component given to a node [cells/s].
pub(super) fn contact(
    at: &Context<'_>,
    input: &NodeInput<'_>,
    grid: &mut Grid,
    in_contact: &mut InContact,
    Tally { timings, work, .. }: &mut Tally,
) -> f32 {
    let (given, now) = (&at.given, &at.now);
    let model = given.model;
    let scene = &model.scene;
    let meeting = ContactInput {
        method: scene.contact.method,
        specific_volumes: &model.specific_volumes,
        friction: &|[a, b]| scene.surface_between(a as usize, b as usize).friction,
        time: now.time + now.dt,
        acting: input.acting(),
    };
    let met = timed(&mut timings.contact, || {
        meet(grid, &meeting, &mut in_contact.at_nodes)
    });
    in_contact.book(&met.exchanged, model.mass_unit, scene.dx);
    work.contact_nodes += met.nodes;
    met.largest
}

/// Books what colliders gave to nodes and to particles in a substep.
pub(super) fn book_colliders(
    given: &Given<'_>,
    particles: &Particles,
    grid: &Grid,
    in_contact: &mut InContact,
) {
    let (mass, dx) = (given.model.mass_unit, given.model.scene.dx);
    for (block, given) in grid.nodes.iter().zip(&grid.given_to_nodes) {
        in_contact.book_colliders(block.field, given, mass, dx);
    }
    for (block, given) in particles.blocks.iter().zip(&grid.given_to_particles) {
        in_contact.book_colliders(block.field, given, mass, dx);
    }
}
