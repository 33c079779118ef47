//! What matter on the grid may meet off it: a rigid body, or a solid on a grid of its own.

use super::CouplingInput;
use crate::{
    bodies::{
        body::Body,
        shape::Shape,
        solve::Mover,
        vector::{Vec3, add, length, sub},
    },
    grid::{NODES, NodeBlock, place_of},
    mat3::{Mat3, cross, dot},
    rotation::rotate,
    simd::LANES,
    solid::{inverse::Known, outline::Unseen},
};

/// Gap up to which nodes count that would not close it by themselves [cells]: what others push may.
pub(super) const GAP_LOOKAHEAD: f64 = 0.1;
/// Cosine of the angle beyond which a node's normal is that of the other side of a thin obstacle.
const SAME_SIDE: f64 = 0.5;
/// Share of an overlap, of a cell at most, that is undone in a substep. Velocities of nodes keep matter out, but what moves
/// between them creeps in: by up to a third of that share of a cell per substep where a block floats.
const RECOVERY: f64 = 1e-3;

/// A surface as seen from a place.
#[derive(Clone, Copy, Debug)]
pub(super) struct Towards {
    /// Signed distance, negative inside [m].
    pub distance: f64,
    /// Unit normal outwards.
    pub normal: Vec3,
    /// The place, and what is there of the obstacle at rest [m].
    pub known: Known,
}

/// A surface as a node meets it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Facing<P> {
    pub towards: Towards,
    /// Velocity that it will have at the end of the substep [m/s].
    pub velocity: Vec3,
    /// What the surface tells of the place.
    pub place: P,
}

/// A particle near an obstacle.
#[derive(Clone, Copy, Debug)]
pub(super) struct NearParticle {
    /// From the first node of its block [cells].
    pub inner: Vec3,
    /// The surface as seen from it, and the gap between its own and that, negative where they overlap [m].
    pub towards: Towards,
    pub gap: f64,
}

/// What matter on the grid meets.
pub(super) trait Obstacle: Sync {
    /// What tells of a place near its surface.
    type Place: Copy;
    /// Centre and radius of a ball that holds it [m].
    fn ball(&self) -> (Vec3, f64);
    /// How far places near each other are from its surface at least, those within `most` of it one by one [m]; and a place of that near
    /// them, if one is known.
    fn around(&self, places: &[Vec3; LANES], most: f64, beyond: &mut [f64; LANES])
    -> Option<Known>;
    /// Whether a place is outside for sure [m].
    fn is_outside(&self, x: Vec3) -> bool;
    /// Its surface as seen from a place [m] that is not farther from it than `most` [m]; `known` is another place nearby.
    fn towards(&self, x: Vec3, most: f64, known: Option<Known>) -> Result<Towards, Unseen>;
    /// The surface as a node at a place [m] meets it; none where it is far.
    fn facing(&self, x: Vec3, known: Known) -> Option<Facing<Self::Place>>;
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

    fn around(&self, places: &[Vec3; LANES], _: f64, beyond: &mut [f64; LANES]) -> Option<Known> {
        let from = self.shape.distance(self.body.inverse_point(places[0]));
        for (beyond, x) in beyond.iter_mut().zip(places) {
            *beyond = from - length(sub(*x, places[0]));
        }
        None
    }

    fn is_outside(&self, x: Vec3) -> bool {
        self.shape.distance(self.body.inverse_point(x)) > 0.0
    }

    fn towards(&self, x: Vec3, most: f64, _: Option<Known>) -> Result<Towards, Unseen> {
        let local = self.body.inverse_point(x);
        let distance = self.shape.distance(local);
        if distance > most {
            return Err(Unseen::Beyond(distance));
        }
        Ok(Towards {
            distance,
            normal: rotate(self.body.rotation, self.shape.normal(local)),
            known: Known {
                now: x,
                rest: local,
                back: Mat3::identity(),
            },
        })
    }

    fn facing(&self, x: Vec3, known: Known) -> Option<Facing<()>> {
        let turns = cross(self.moves.spin, sub(x, self.body.com));
        Some(Facing {
            towards: self.towards(x, f64::INFINITY, Some(known)).ok()?,
            velocity: add(self.moves.velocity, turns),
            place: (),
        })
    }
}

/// An obstacle and a block of nodes.
pub(super) struct FacedBlock<'a, O> {
    pub input: &'a CouplingInput<'a>,
    pub obstacle: &'a O,
    pub nodes: &'a NodeBlock,
    /// Per node the nearest of the particles that may touch the obstacle, if any does.
    pub nearest: Option<[Option<&'a NearParticle>; NODES]>,
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
        let nearest = self.nearest?[at]?;
        let place = self.place(self.index(at));
        let own = self.obstacle.facing(place, nearest.towards.known)?;
        // That of the surface near the node, if it is on the side of the particle.
        let [here, there] = [own.towards.normal, nearest.towards.normal];
        let normal = if dot(here, there) > SAME_SIDE {
            here
        } else {
            there
        };
        let way = input.dt * dot(sub(velocity, own.velocity), normal);
        let gap = nearest.gap;
        if gap + way > GAP_LOOKAHEAD * input.dx {
            return None;
        }
        let way_out = RECOVERY * (-gap).clamp(0.0, input.dx);
        Some((normal, (way_out - gap.max(0.0)) / input.dt, own.place))
    }
}
