//! The grid pass: momentum to velocity, gravity, boundary conditions.

use super::{
    rates::Rate,
    schedule::Context,
    tally::{Tally, timed},
};
use crate::{
    colliders::NodeConditions,
    grid::{
        FieldPass, Grid, NODES,
        anchors::Anchors,
        approach::{BoundaryConditions, ParticleGaps, approaches},
        node_pass,
    },
    kinematics::kick,
    state::{CoarseSubstep, Given, GridMotion, Matter},
};

/// Lets gravity and damping act on the frame velocity; returns per grid field what becomes of its velocities.
pub(super) fn field_passes(
    at: &Context<'_>,
    motion: &mut GridMotion,
    coarse: &mut CoarseSubstep,
) -> Vec<FieldPass> {
    let Context {
        given,
        segment,
        schedule,
        now,
    } = at;
    let before = motion.frame_velocity;
    let after = given.frame_velocity_after(before, now.kick);
    motion.frame_velocity = after;
    if schedule.index == 0 {
        *coarse = CoarseSubstep {
            frame_velocity: after,
            max_speed: 0.0,
        };
    }
    let scene = &given.model.scene;
    let shift = |from: [f64; 3]| std::array::from_fn(|a| (from[a] - after[a]) as f32);
    let offsets = motion.velocity_offsets.iter().enumerate();
    offsets
        .map(|(object, &offset)| {
            let rate = segment.rates.of(object);
            let (dt, elapsed) = match rate {
                Rate::Fine => (schedule.dt, 0.0),
                Rate::Isolated | Rate::Coupled => (schedule.coarse_dt, schedule.elapsed()),
            };
            let is_inactive = rate == Rate::Isolated && schedule.index > 0;
            let count = match rate {
                Rate::Coupled => f64::from(segment.rates.per_coarse),
                Rate::Fine | Rate::Isolated => 1.0,
            };
            let kick = kick(offset, dt, scene.cfl)[0] / count;
            let own = given.frame_velocity_after(before, kick);
            FieldPass {
                dt,
                elapsed,
                is_inactive,
                keep: given.model.velocity_kept(kick) as f32,
                frame_velocity: own,
                shift: match (is_inactive, at.ends_coarse()) {
                    (false, _) => shift(own),
                    (true, true) => shift(coarse.frame_velocity),
                    (true, false) => [0.0; 3],
                },
                continues: (rate == Rate::Coupled).then_some(kick as f32),
            }
        })
        .collect()
}

/// All that acts on nodes in one substep.
pub(super) struct NodeInput<'a> {
    boundaries: NodeConditions<'a>,
    moving: NodeConditions<'a>,
    approaches: Vec<ParticleGaps>,
    anchors: Anchors<'a>,
    passes: &'a [FieldPass],
}

impl<'a> NodeInput<'a> {
    /// Places boundaries and measures the gaps of particles to them; `concerned` says per particle block whether a rule may
    /// name one of its particles.
    pub fn new(
        at: &Context<'a>,
        passes: &'a [FieldPass],
        matter: &'a Matter,
        concerned: &'a [bool],
        grid: &Grid,
        tally: &mut Tally,
    ) -> Self {
        timed(&mut tally.timings.grid, || {
            Self::placed(at, passes, matter, concerned, grid)
        })
    }

    fn placed(
        at: &Context<'a>,
        passes: &'a [FieldPass],
        matter: &'a Matter,
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
            approaches: approaches(particles, &model.half_spacings, &boundaries, passes),
            anchors: Anchors::new(
                particles,
                &model.rules,
                &commanded.pins,
                *now,
                concerned,
                grid.nodes.len(),
            ),
            passes,
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
            passes: self.passes,
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
    let active = grid.nodes.iter();
    let active = active.filter(|node| !input.passes[node.field as usize].is_inactive);
    work.grid_nodes += NODES as u64 * active.count() as u64;
    timed(&mut timings.grid, || {
        node_pass(at.given.model.isa, grid, &input.acting())
    })
}
