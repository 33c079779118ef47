//! The grid that bodies and solids are coupled to: its nodes, and what is known of the matter there.

pub(crate) mod near;
pub(crate) mod nodes;
mod obstacle;
mod radii;
pub(crate) mod solids;
pub(crate) mod sweeps;

use crate::{bodies::vector::Vec3, grid::Grid, particles::Particles};

/// Nodes lighter than this share of the heaviest particle meet nobody.
const LIGHTEST: f32 = 1e-12;
/// What bodies are told of the fields of a grid.
#[derive(Clone, Copy, Default)]
pub(crate) struct Fields<'a> {
    /// Per part the volume of one unit of mass at rest [cells].
    pub cells_per_mass: &'a [f64],
}

/// What the grid is filled with, and how bodies meet it.
pub(crate) struct CouplingInput<'a> {
    /// What it is the grid of.
    pub particles: &'a Particles,
    pub fields: Fields<'a>,
    /// How fast it moves at most, about [m/s].
    pub fastest: f64,
    /// Cell size [m].
    pub dx: f64,
    /// Unit of mass of nodes [kg].
    pub mass_unit: f64,
    /// Velocity that those of nodes are relative to [cells/s].
    pub frame_velocity: Vec3,
    /// [m/s^2]
    pub gravity: Vec3,
    /// Substep [s].
    pub dt: f64,
    /// Friction of an object with the matter of a grid field.
    pub friction: &'a dyn Fn(usize, u32) -> f64,
    /// Whether an object's body is one piece with the matter of a grid field.
    pub bonded: &'a dyn Fn(usize, u32) -> bool,
}

impl CouplingInput<'_> {
    /// Mass [kg] and velocity [m/s] of a node of a block; none of one that meets nobody.
    pub(super) fn node(&self, grid: &Grid, block: usize, at: usize) -> Option<(f64, Vec3)> {
        let node = &grid.velocities[block].0[at / 4].0[4 * (at % 4)..][..4];
        if node[3].is_nan() || node[3] <= LIGHTEST {
            return None;
        }
        let velocity = [0, 1, 2].map(|a| (f64::from(node[a]) + self.frame_velocity[a]) * self.dx);
        Some((f64::from(node[3]) * self.mass_unit, velocity))
    }

    /// Gives a node of a block a velocity [m/s]; returns the change that is left of it by rounding [m/s], and its largest component
    /// [cells/s].
    pub(super) fn give(
        &self,
        grid: &mut Grid,
        [block, row, first]: [usize; 3],
        velocity: Vec3,
    ) -> (Vec3, f32) {
        let node = &mut grid.velocities[block].0[row].0[first..first + 4];
        let (mut left, mut largest) = ([0.0; 3], 0.0_f32);
        for a in 0..3 {
            let wanted = velocity[a] / self.dx - self.frame_velocity[a];
            node[a] = wanted as f32;
            left[a] = self.dx * (wanted - f64::from(node[a]));
            largest = largest.max(node[a].abs());
        }
        (left, largest)
    }
}
