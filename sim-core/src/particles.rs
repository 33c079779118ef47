//! Particle state of the fast solver: groups of 16, sorted by block, object and cell.

mod fields;

use std::ops::Range;

use serde::{Deserialize, Serialize};

use crate::{
    mat3::length,
    simd::{F32x16, LANES},
};

/// Cells along one edge of a block.
pub(crate) const BLOCK: i32 = 4;

/// Id of a lane that holds no particle.
pub(crate) const NO_PARTICLE: u32 = u32::MAX;

/// What persists between substeps, 16 particles, one vector per field.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[repr(C, align(64))]
pub(crate) struct Group {
    /// Position relative to the block's centre [cells]: at most 2 in magnitude after sorting, and moving to a
    /// neighbour's centre is then exact.
    pub x: [F32x16; 3],
    /// Deformation gradient, row-major.
    pub f: [F32x16; 9],
}

impl Group {
    /// Undeformed particles at the block's centre: what unused lanes hold.
    pub const REST: Self = {
        let (o, i) = (F32x16::ZERO, F32x16::splat(1.0));
        Self {
            x: [o; 3],
            f: [i, o, o, o, i, o, o, o, i],
        }
    };
}

/// What lives on the grid between substeps and is written out where a segment of substeps ends.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[repr(C, align(64))]
pub(crate) struct Motion {
    /// Velocity relative to the world's frame velocity [cells/s].
    pub v: [F32x16; 3],
    /// Affine velocity `C` [1/s], row-major.
    pub c: [F32x16; 9],
}

impl Motion {
    /// No motion.
    pub const REST: Self = Self {
        v: [F32x16::ZERO; 3],
        c: [F32x16::ZERO; 9],
    };
}

/// What never changes while a particle is simulated.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[repr(C, align(64))]
pub(crate) struct Fixed {
    /// Mass in units of the heaviest particle; 0 in unused lanes.
    pub mass: F32x16,
    /// Index into the scene's particles, or [`NO_PARTICLE`].
    pub id: [u32; LANES],
}

impl Fixed {
    /// Sixteen unused lanes.
    pub const EMPTY: Self = Self {
        mass: F32x16::ZERO,
        id: [NO_PARTICLE; LANES],
    };
}

/// Extremes over some particles in one pass.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Extremes {
    /// Largest squared speed [cells^2/s^2].
    pub speed_squared: f32,
    /// Largest squared Frobenius norm of `C` [1/s^2].
    pub rate_squared: f32,
    /// Bound of the largest squared principal stretch.
    pub stretch_squared: f32,
    /// Smallest `J`.
    pub min_j: f32,
    /// Largest `J`.
    pub max_j: f32,
    /// Largest factor on Lamé's parameters by hardening.
    pub stiffness: f32,
    /// Largest distance from the block's centre along any axis [cells].
    pub reach: f32,
}

impl Extremes {
    /// Of no particle.
    pub const NONE: Self = Self {
        speed_squared: 0.0,
        rate_squared: 0.0,
        stretch_squared: 0.0,
        min_j: f32::INFINITY,
        max_j: 0.0,
        stiffness: 0.0,
        reach: 0.0,
    };

    /// Extremes over both sets.
    pub fn join(&mut self, other: &Self) {
        self.speed_squared = self.speed_squared.max(other.speed_squared);
        self.rate_squared = self.rate_squared.max(other.rate_squared);
        self.stretch_squared = self.stretch_squared.max(other.stretch_squared);
        self.min_j = self.min_j.min(other.min_j);
        self.max_j = self.max_j.max(other.max_j);
        self.stiffness = self.stiffness.max(other.stiffness);
        self.reach = self.reach.max(other.reach);
    }
}

/// Visible deformation gradients of 16 particles, row-major, where it is not the elastic one.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[repr(C, align(64))]
pub(crate) struct Shape(pub [F32x16; 9]);

impl Shape {
    /// Undeformed.
    pub const REST: Self = Self(Group::REST.f);
}

/// Groups of one part within one block.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Run {
    /// Part id.
    pub part: usize,
    /// Its groups.
    pub groups: Range<usize>,
    /// Their visible shapes: as many as groups, or none.
    pub shapes: Range<usize>,
    /// Of the latest pass over it.
    pub extremes: Extremes,
}

/// A block of 4x4x4 cells that holds particles.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Block {
    /// Grid field: particles of different fields never share a node.
    pub field: u32,
    /// Block index: its first node is 4 times this.
    pub index: [i32; 3],
    /// Its runs, ordered by part.
    pub runs: Range<usize>,
    /// Its groups.
    pub groups: Range<usize>,
    /// Its visible shapes.
    pub shapes: Range<usize>,
}

impl Block {
    /// Distance of a point from its cells and `margin` more on all sides; all in cells.
    pub fn distance(&self, from: [f64; 3], margin: f64) -> f64 {
        length(std::array::from_fn(|a| {
            let first = f64::from(BLOCK * self.index[a]);
            let [min, max] = [first - margin, first + f64::from(BLOCK) + margin];
            (min - from[a]).max(from[a] - max).max(0.0)
        }))
    }
}

/// Smallest and largest block index, or `None` without blocks.
pub(crate) fn extent(blocks: &[Block]) -> Option<[[i32; 3]; 2]> {
    let first = blocks.first()?.index;
    let mut extent = [first; 2];
    for block in blocks {
        for a in 0..3 {
            extent[0][a] = extent[0][a].min(block.index[a]);
            extent[1][a] = extent[1][a].max(block.index[a]);
        }
    }
    Some(extent)
}

/// Lanes of one group that need attention, one bit each.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct Flags {
    /// Not finite, turned inside out, or moved beyond the limits.
    pub bad: u16,
    /// Outside the scene's domain.
    pub outside: u16,
}

/// What a substep changes of particles, as it was at the start of a segment.
#[derive(Clone, Debug, Default)]
pub(crate) struct Backup {
    /// Like [`Particles::groups`].
    pub groups: Vec<Group>,
    /// Like [`Particles::memory`].
    pub memory: Vec<F32x16>,
    /// Like [`Particles::shapes`].
    pub shapes: Vec<Shape>,
}

impl Backup {
    /// Makes room for as much as `particles` holds.
    pub fn fit(&mut self, particles: &Particles) {
        self.groups.resize(particles.groups.len(), Group::REST);
        self.memory.resize(particles.memory.len(), F32x16::ZERO);
        self.shapes.resize(particles.shapes.len(), Shape::REST);
    }

    /// Puts everything back.
    pub fn restore(&self, particles: &mut Particles) {
        particles.groups.copy_from_slice(&self.groups);
        particles.memory.copy_from_slice(&self.memory);
        particles.shapes.copy_from_slice(&self.shapes);
    }
}

/// All simulated particles.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub(crate) struct Particles {
    /// Blocks in lexicographic order.
    pub blocks: Vec<Block>,
    /// Runs, block after block.
    pub runs: Vec<Run>,
    /// Position and elastic deformation, run after run.
    pub groups: Vec<Group>,
    /// The one number that laws keep per particle, like `groups`.
    pub memory: Vec<F32x16>,
    /// Visible deformation of runs that carry it apart.
    pub shapes: Vec<Shape>,
    /// Velocities at segment boundaries, like `groups`.
    pub motion: Vec<Motion>,
    /// Masses and ids, like `groups`.
    pub fixed: Vec<Fixed>,
    /// Findings of the latest pass, like `groups`.
    pub flags: Vec<Flags>,
}

impl Particles {
    /// Takes the particle in `lane` of `group` out: the lane becomes unused.
    pub fn remove(&mut self, group: usize, lane: usize) {
        for (to, from) in self.groups[group].x.iter_mut().zip(&Group::REST.x) {
            to.0[lane] = from.0[lane];
        }
        for (to, from) in self.groups[group].f.iter_mut().zip(&Group::REST.f) {
            to.0[lane] = from.0[lane];
        }
        self.memory[group].0[lane] = 0.0;
        // The lane of a visible shape keeps what it holds: nothing looks at it again.
        let motion = &mut self.motion[group];
        for to in motion.v.iter_mut().chain(&mut motion.c) {
            to.0[lane] = 0.0;
        }
        self.fixed[group].mass.0[lane] = 0.0;
        self.fixed[group].id[lane] = NO_PARTICLE;
    }
}

/// Position [cells] of a lane in the world, from its block and its offset from the block's centre.
#[inline(always)]
pub(crate) fn position_in_cells(block: [i32; 3], x: [f32; 3]) -> [f64; 3] {
    let mut position = [0.0; 3];
    for a in 0..3 {
        position[a] = f64::from(BLOCK * block[a]) + 1.5 + f64::from(x[a]);
    }
    position
}
