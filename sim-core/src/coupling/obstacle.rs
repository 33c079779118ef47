//! What matter on the grid may meet off it: a rigid body, or a solid on a grid of its own.

use super::{CouplingInput, matter};
use crate::{
    bodies::{
        body::Body,
        shape::Shape,
        solve::Mover,
        vector::{Vec3, add, sub},
    },
    colliders::edge,
    grid::{Grid, NODES, NodeBlock, place_of},
    mat3::{cross, dot},
    rotation::rotate,
};

/// Gap up to which nodes count that would not close it by themselves [cells]: what others push may.
pub(super) const GAP_LOOKAHEAD: f64 = 0.1;
/// Cosine of the angle beyond which a node's normal is that of the other side of a thin obstacle.
const SAME_SIDE: f64 = 0.5;
/// Share of an overlap, of a cell at most, that is undone in a substep of what flows. Velocities of nodes keep matter out, but what moves
/// between them creeps in: by up to a third of that share of a cell per substep where a block floats.
const RECOVERY: f64 = 1e-3;

/// Signed distance from a surface, negative inside [m], and its unit normal outwards.
pub(super) type Towards = (f64, Vec3);

/// A surface as a node meets it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Facing<P> {
    pub towards: Towards,
    /// Velocity that it will have at the end of the substep [m/s].
    pub velocity: Vec3,
    /// What the surface tells of the place.
    pub place: P,
}

/// The nearest of the particles that reach a node.
#[derive(Clone, Copy, Debug)]
pub(super) struct GapSample {
    /// Between its surface and that of the obstacle, negative where they overlap [m]; infinite where there is none.
    pub gap: f64,
    /// Normal out of the obstacle there.
    pub normal: Vec3,
}

impl GapSample {
    pub const NONE: Self = Self {
        gap: f64::INFINITY,
        normal: [0.0; 3],
    };
}

/// What matter on the grid meets.
pub(super) trait Obstacle: Sync {
    /// What tells of a place near its surface.
    type Place: Copy;
    /// Centre and radius of a ball that holds it [m].
    fn ball(&self) -> (Vec3, f64);
    /// Where its surface is from a place [m]; none where it is farther than `most` [m].
    fn towards(&self, x: Vec3, most: f64) -> Option<Towards>;
    /// The surface as a node at a place [m] meets it; none where it is far.
    fn facing(&self, x: Vec3) -> Option<Facing<Self::Place>>;
}

/// A rigid body, with the velocity that it will have.
pub(super) struct RigidObstacle<'a> {
    pub shape: &'a Shape,
    pub body: Body,
    pub moves: Mover,
}

impl Obstacle for RigidObstacle<'_> {
    type Place = ();

    fn ball(&self) -> (Vec3, f64) {
        (self.body.com, self.shape.radius)
    }

    fn towards(&self, x: Vec3, most: f64) -> Option<Towards> {
        let local = self.body.inverse_point(x);
        let distance = self.shape.distance(local);
        let normal = || rotate(self.body.rotation, self.shape.normal(local));
        (distance <= most).then(|| (distance, normal()))
    }

    fn facing(&self, x: Vec3) -> Option<Facing<()>> {
        let turns = cross(self.moves.spin, sub(x, self.body.com));
        Some(Facing {
            towards: self.towards(x, f64::INFINITY)?,
            velocity: add(self.moves.velocity, turns),
            place: (),
        })
    }
}

/// An obstacle and a block of nodes.
pub(super) struct FacedBlock<'a, O> {
    pub grid: &'a Grid,
    pub input: &'a CouplingInput<'a>,
    pub obstacle: &'a O,
    pub nodes: &'a NodeBlock,
    /// What particles may touch the obstacle, if any.
    pub nearest: Option<&'a [GapSample; NODES]>,
}

impl<O: Obstacle> FacedBlock<'_, O> {
    /// Which node of the grid one of the block is.
    pub fn index(&self, at: usize) -> [i32; 3] {
        place_of(self.nodes.index, at)
    }

    /// Where a node of the grid is [m].
    pub fn place(&self, index: [i32; 3]) -> Vec3 {
        index.map(|i| f64::from(i) * self.input.dx)
    }

    /// Normal out of the obstacle at a node that meets it, and the least velocity along it that is left to the node [m/s], both
    /// relative to the obstacle, with what tells of the place.
    pub fn closing(&self, at: usize, velocity: Vec3) -> Option<(Vec3, f64, O::Place)> {
        let input = self.input;
        let nearest = self.nearest?[at];
        if nearest.gap == f64::INFINITY {
            return None;
        }
        let own = self.obstacle.facing(self.place(self.index(at)))?;
        // That of the surface near the node, if it is on the side of the particle.
        let normal = match dot(own.towards.1, nearest.normal) > SAME_SIDE {
            true => own.towards.1,
            false => nearest.normal,
        };
        let way = input.dt * dot(sub(velocity, own.velocity), normal);
        // What is on its way since it came to the grid is farther than where it was.
        let pass = &input.fields.passes[self.nodes.field as usize];
        let mut gap = nearest.gap + pass.elapsed * dot(velocity, normal);
        if gap + way > GAP_LOOKAHEAD * input.dx {
            return None;
        }
        let keeps_shape = input.fields.reconstructs_surface[self.nodes.field as usize];
        if keeps_shape && gap + way < 0.0 {
            gap = input.dx * edge::gap(gap / input.dx, self.edge(at));
        }
        let way_out = match keeps_shape {
            true => 0.0,
            false => RECOVERY * (-gap).clamp(0.0, input.dx),
        };
        Some((normal, (way_out - gap.max(0.0)) / input.dt, own.place))
    }

    /// Gap in front of a node by where masses say that matter ends [cells].
    fn edge(&self, at: usize) -> f64 {
        let surface = |index: [i32; 3]| {
            let found = self.obstacle.towards(self.place(index), f64::INFINITY);
            let (distance, normal) = found.unwrap_or((f64::INFINITY, [0.0; 3]));
            (distance / self.input.dx, normal)
        };
        edge::edge(self.index(at), surface, |index| {
            matter(self.grid, self.input.anchors, self.nodes.field, index)
        })
    }
}
