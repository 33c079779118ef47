//! The grid pass: momentum to velocity, gravity, boundary conditions.

use super::{schedule::Context, tally::Tally};
use crate::{
    colliders::NodeConditions,
    grid::{
        Grid, NODES,
        anchors::Anchors,
        approach::{BoundaryConditions, ParticleGaps, approaches},
        node_pass,
    },
    state::{Given, GridMotion, Matter},
    timed,
};

/// Lets gravity and damping act on the frame velocity.
pub(super) fn kick_frame(at: &Context<'_>, motion: &mut GridMotion) {
    let before = motion.frame_velocity;
    motion.frame_velocity = at.given.frame_velocity_after(before, at.now.kick);
}

/// All that acts on nodes in one substep.
pub(super) struct NodeInput<'a> {
    boundaries: NodeConditions<'a>,
    moving: NodeConditions<'a>,
    approaches: Vec<ParticleGaps>,
    anchors: Anchors<'a>,
    frame_velocity: [f64; 3],
    dt: f64,
}

impl<'a> NodeInput<'a> {
    /// Places boundaries and measures the gaps of particles to them; `concerned` says per particle block whether a rule may
    /// name one of its particles.
    pub fn new(
        at: &Context<'a>,
        matter: &'a Matter,
        motion: &GridMotion,
        concerned: &'a [bool],
        grid: &Grid,
        tally: &mut Tally,
    ) -> Self {
        timed(&mut tally.timings.grid, || {
            Self::placed(at, matter, motion, concerned, grid)
        })
    }

    fn placed(
        at: &Context<'a>,
        matter: &'a Matter,
        motion: &GridMotion,
        concerned: &'a [bool],
        grid: &Grid,
    ) -> Self {
        let Given {
            model, commanded, ..
        } = at.given;
        let now = &at.now;
        let (particles, paths) = (&matter.particles, &commanded.paths);
        let boundaries = model.boundaries.on_nodes(paths, now);
        Self {
            moving: model.boundaries.moving_on_nodes(paths, now),
            approaches: approaches(particles, &model.half_spacings, &boundaries),
            anchors: Anchors::new(
                particles,
                &model.rules,
                &commanded.pins,
                *now,
                concerned,
                grid.nodes.len(),
            ),
            frame_velocity: motion.frame_velocity,
            dt: now.dt,
            boundaries,
        }
    }

    /// The same, as nodes see it.
    pub fn acting(&self) -> BoundaryConditions<'_> {
        BoundaryConditions {
            boundaries: &self.boundaries,
            moving: &self.moving,
            approaches: &self.approaches,
            anchors: &self.anchors,
            frame_velocity: self.frame_velocity,
            dt: self.dt,
        }
    }
}

/// Sums the tiles to velocities and applies boundary conditions; returns the largest velocity component, frame velocity
/// included [cells/s].
pub(super) fn grid_pass(
    at: &Context<'_>,
    input: &NodeInput<'_>,
    grid: &mut Grid,
    Tally { timings, work, .. }: &mut Tally,
) -> f32 {
    work.grid_nodes += NODES as u64 * grid.nodes.len() as u64;
    let model = at.given.model;
    timed(&mut timings.grid, || {
        let keep = model.velocity_kept(at.now.kick) as f32;
        node_pass(model.isa, grid, keep, &input.acting())
    })
}
