//! Points that walls hold, and the nodes that bear them.

use std::collections::BTreeMap;

use super::{grip::Grip, skyline::Skyline};
use crate::{colliders::Placed, mat3::dot, scene::Surface};

/// Distance from a wall below which a point is on it [cells].
pub(super) const TOUCH: f64 = 1e-3;

/// A point that a wall holds, and how both stand where the substep begins.
#[derive(Clone, Debug)]
pub(super) struct Bond {
    pub point: usize,
    /// What holds it: a collider by its number, or a region of the scene as a [grip](crate::grip::Grip::on_region) names it.
    pub with: u32,
    /// Where the point is [m].
    pub x: [f64; 3],
    /// Its velocity, after the forces of the substep once that has begun [m/s].
    pub v: [f64; 3],
    /// Unit normal out of the wall; none of a region.
    pub normal: [f64; 3],
    /// Signed distance from the wall [m].
    pub gap: f64,
    /// Velocity of the wall there [m/s], and its angular velocity [rad/s], in the substep.
    pub wall: [f64; 3],
    pub spin: [f64; 3],
    /// Whether it may slip along the wall.
    pub slips: bool,
    /// How far it is from where it stuck along the wall, and how far in front of the wall it stays: where it was when it met it [m].
    pub stretch: [f64; 3],
}

impl Bond {
    /// How far the point is from where it met the wall; along the wall only where it does not slip [m].
    pub fn off(&self) -> [f64; 3] {
        let in_front = dot(self.stretch, self.normal);
        std::array::from_fn(|a| {
            let across = match self.slips {
                false => self.stretch[a] - in_front * self.normal[a],
                true => 0.0,
            };
            across + (self.gap - in_front) * self.normal[a]
        })
    }
}

/// A point that a flat slip wall holds. All that the wall asks of it is linear in its place, so that patches are asked in its stead.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Bound {
    pub point: usize,
    /// The wall, as of a [`Bond`].
    pub with: u32,
    /// How far in front of the wall it stays [m].
    pub in_front: f64,
}

/// How a wall holds a point.
#[derive(Clone, Debug)]
pub(super) enum Hold {
    Point(Bond),
    Flat(Bound),
}

impl Hold {
    /// What the point remembers of it; `normal` is that of the wall.
    pub fn grip(&self, normal: [f64; 3]) -> Grip {
        let (with, stretch) = match self {
            Self::Point(bond) => (bond.with, bond.stretch),
            Self::Flat(bound) => (bound.with, normal.map(|n| bound.in_front * n)),
        };
        Grip {
            with,
            stretch,
            ..Grip::NONE
        }
    }
}

/// Nodes that bear a point or some, with weights.
pub(super) type Borne = Vec<(u32, f64)>;

/// What moves a point: nodes that are free to, and all others.
#[derive(Clone, Debug, Default)]
pub(super) struct MovedBy {
    pub free: Borne,
    pub others: Borne,
}

/// Points about a corner of cells that one wall holds: it holds their mean, by area. The motion of a surface has one value per cell and
/// axis, and more constraints would say the same again; fewer, as means of the points of a cell, let it bulge between them.
#[derive(Clone, Debug)]
pub(super) struct Patch {
    /// The corner, the points, and the sum of their areas there [m^2].
    pub corner: [i32; 3],
    pub points: Vec<Bound>,
    pub area: f64,
    /// Places among the bonds, with shares of the area; none at a flat slip wall.
    pub bonds: Vec<(usize, f64)>,
    /// Free nodes that bear it, and others that move it.
    pub borne: Borne,
    pub others: Borne,
    /// Where it is at rest, and how far in front of a flat slip wall it stays [m].
    pub rest: [f64; 3],
    pub in_front: f64,
    /// Momenta over masses, and velocities, that an impulse on it gives nodes [1/kg].
    pub pushed: Borne,
    pub answers: Borne,
    pub with: u32,
    /// Whether it may slip along the wall.
    pub slips: bool,
    /// Where it is [m].
    pub x: [f64; 3],
    /// Unit normal out of the wall.
    pub normal: [f64; 3],
    /// What its velocity has to change by [m/s].
    pub missing: [f64; 3],
    /// Impulse on it [N s].
    pub impulse: [f64; 3],
}

impl Patch {
    /// Where it is among others.
    pub fn place(&self) -> ([i32; 3], u32) {
        (self.corner, self.with)
    }

    /// Directions in which the wall decides, one after the other.
    pub fn directions(&self) -> impl Iterator<Item = [f64; 3]> + Clone + use<> {
        let unit = |axis: usize| std::array::from_fn(|a| if a == axis { 1.0 } else { 0.0 });
        let (slips, normal) = (self.slips, self.normal);
        (0..if slips { 1 } else { 3 }).map(move |axis| if slips { normal } else { unit(axis) })
    }
}

/// A patch and one of its directions.
pub(super) type Constraint = (usize, [f64; 3]);

/// What walls hold of a solid.
#[derive(Clone, Debug, Default)]
pub struct Walls {
    pub(super) bonds: Vec<Bond>,
    /// Of every point that was held since nodes were last held or let go.
    pub(super) borne: BTreeMap<usize, MovedBy>,
    /// Points that were held latest, those of bonds first, their patches, and the nodes that impulses on these move.
    pub(super) latest: Vec<Bound>,
    pub(super) patches: Vec<Patch>,
    pub(super) nodes: Vec<u32>,
    /// Outer nodes that follow those, by their places in the list.
    pub(super) outer: Vec<u32>,
    /// Constraints patch after patch; the same in the order of the matrix.
    pub(super) by_patch: Vec<Constraint>,
    pub(super) rows: Vec<Constraint>,
    /// Factor of what velocities along constraints answer to impulses along them.
    pub(super) answers: Skyline,
    /// Velocities that are missing, then impulses, by row.
    pub(super) sought: Vec<f64>,
    /// Change of the velocity of every node, and of its momentum over its mass [m/s].
    pub(super) change: Vec<[[f64; 3]; 2]>,
    /// How far nodes were moved, by block [m].
    pub(super) ways: Vec<f64>,
}

impl Walls {
    /// Forgets what bears points: other nodes are held now.
    pub(super) fn restart(&mut self) {
        self.borne.clear();
        self.latest.clear();
        self.patches.clear();
    }
}

/// Points of a surface that a region of the scene holds.
#[derive(Clone, Copy, Debug)]
pub struct HeldFace<'a> {
    /// The region, by its number.
    pub region: usize,
    /// The points.
    pub points: &'a [usize],
    /// Their velocity [m/s].
    pub velocity: [f64; 3],
}

/// Whether a collider holds what has met it by constraints. Coulomb's law wants the pressure at every point: springs know it, constraints
/// share it out at will.
pub(super) fn binds(placed: &Placed<'_>) -> bool {
    let contact = placed.contact();
    match contact.surface {
        Surface::Sticky => true,
        Surface::Slip => contact.friction == 0.0,
        Surface::Separate => false,
    }
}
