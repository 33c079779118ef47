//! Matter on the grid against what is off it: rigid bodies and solids.

use std::sync::OnceLock;

use super::{rigid::drive, solids::held_nodes, springs::pull_on_body};
use crate::{
    colliders::Substep,
    coupling::{
        CouplingInput, Fields,
        near::Watch,
        nodes::{Coupled, CoupledBody, couple_bodies_to_grid},
        solids::{CoupledSolid, CoupledSolids, couple_solids_to_grid},
    },
    episodes::Episodes,
    solid::{advance::Scratch, inverse::LocalInverse, outline::Outline, state::SolidState},
    state::{Given, GridMotion, Matter, RigidBodies, Workspace},
};

/// What moves off the grid.
pub(crate) struct OffGrid<'a> {
    pub bodies: &'a mut RigidBodies,
    /// Per object.
    pub solids: &'a mut [Option<SolidState>],
    /// Solids in contact.
    pub episodes: &'a mut Episodes,
}

impl OffGrid<'_> {
    /// Whether there are solids whose nodes move.
    pub fn has_moving_solids(&self, given: &Given<'_>) -> bool {
        let mut solids = self.solids.iter().enumerate();
        solids.any(|(id, state)| state.is_some() && given.is_moving_solid(id))
    }
}

/// Impulses between nodes of the grid and what is off it: bodies first, then solids.
pub(super) fn couple(
    given: &Given<'_>,
    now: &Substep,
    matter: &Matter,
    motion: &GridMotion,
    off_grid: &OffGrid<'_>,
    workspace: &mut Workspace,
) -> (Coupled, CoupledSolids) {
    let bodies = &*off_grid.bodies;
    let mut coupled = vec![];
    for (object, (rigid, shape)) in bodies.of.iter().zip(&bodies.shapes).enumerate() {
        if let (Some(rigid), Some(shape)) = (rigid, shape) {
            let pull = pull_on_body(given, object, rigid, (&rigid.body, shape), now);
            coupled.push(CoupledBody {
                object,
                shape,
                body: rigid.body,
                drive: drive(given, object, rigid, now).with(pull),
            });
        }
    }
    let has_solids = off_grid.has_moving_solids(given);
    if matter.particles.groups.is_empty() || coupled.is_empty() && !has_solids {
        let none = Coupled {
            loads: vec![([0.0; 3], [0.0; 3]); coupled.len()],
            ..Coupled::default()
        };
        return (none, CoupledSolids::default());
    }
    let model = given.model;
    let scene = &model.scene;
    let single = model.is_single_field();
    let friction = |object: usize, field: u32| match single {
        true => scene.objects[object].surface.friction_to_objects(),
        false => scene.surface_between(object, field as usize).friction,
    };
    let input = CouplingInput {
        particles: &matter.particles,
        fields: Fields {
            cells_per_mass: &model.cells_per_mass,
        },
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
    let Workspace {
        grid,
        solids: scratch,
        at_solids,
        watches,
        ..
    } = workspace;
    watches.resize_with(scene.objects.len(), Watch::default);
    let of_bodies = couple_bodies_to_grid(grid, &coupled, &input, watches);
    scratch.resize_with(off_grid.solids.len(), || None);
    if now.time == now.frame_start {
        at_solids.clear();
    }
    let solids = solids_at_nodes(given, now, off_grid.solids, scratch);
    let of_solids = couple_solids_to_grid(grid, &solids, &input, model.isa, (at_solids, watches));
    (of_bodies, of_solids)
}

/// Solids where they are.
fn solids_at_nodes<'a>(
    given: &Given<'a>,
    now: &Substep,
    states: &'a [Option<SolidState>],
    scratch: &'a mut [Option<Scratch>],
) -> Vec<CoupledSolid<'a>> {
    let all = states.iter().zip(scratch).enumerate();
    let all = all.filter(|(id, _)| given.is_moving_solid(*id));
    let solids = all.filter_map(|(id, (state, scratch))| {
        let (solid, state) = (given.model.lagrangian[id].as_ref()?, state.as_ref()?);
        let scratch = scratch.get_or_insert_with(|| Scratch::new(&solid.grid));
        if now.time == now.frame_start {
            scratch.search.restart();
        }
        scratch.tiles.look_at(&state.nodes);
        let (bounds, speed) = (solid.surface).reach(&solid.grid, state, Some(scratch));
        let start = scratch.search.start(&solid.grid, state);
        let (held, _) = held_nodes(given, id, (solid, state), now);
        let rows = &scratch.tiles.rows;
        let depth = solid.depth.as_ref()?;
        let inverse = LocalInverse::new((&solid.grid, state), rows, depth, start);
        let known = (&solid.surface, &scratch.search);
        Some(CoupledSolid {
            object: id,
            outline: Outline::new(inverse, known, bounds, given.model.isa),
            speed,
            gravity: given.commanded.gravity,
            dt: now.dt,
            held,
            answers: OnceLock::new(),
        })
    });
    solids.collect()
}
