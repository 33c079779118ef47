//! Points that walls hold, and the nodes that bear them.

use std::collections::BTreeMap;

use crate::{colliders::Placed, scene::Surface};

/// Share of its own answer that a point gives way by: points say the same where matter is one cell thick, and rounding lets them
/// contradict each other.
const SLACK: f64 = 1e-3;
/// Distance from a wall below which a point is on it [cells].
pub(super) const TOUCH: f64 = 1e-3;

/// A point that a wall holds, and how both stand where the substep begins.
#[derive(Clone, Debug)]
pub(super) struct Bond {
    pub point: usize,
    /// The collider, by its number.
    pub collider: usize,
    /// Where the point is [m].
    pub x: [f64; 3],
    /// Unit normal out of the wall.
    pub normal: [f64; 3],
    /// Signed distance from the wall [m].
    pub gap: f64,
    /// Velocity of the wall there [m/s].
    pub wall: [f64; 3],
    /// Whether it may slip along the wall.
    pub slips: bool,
    /// How far it is from where it stuck along the wall, and how far in front of the wall it stays [m].
    pub stretch: [f64; 3],
}

/// Nodes that bear a point, with weights, and the impulse that changes its velocity, alone [kg]; 0 where nothing does.
#[derive(Clone, Debug)]
pub(super) struct Borne {
    pub nodes: Vec<(u32, f64)>,
    pub answer: f64,
}

impl Borne {
    /// What a point gives way by per impulse on it [1/kg].
    pub fn slack(&self) -> f64 {
        match self.answer > 0.0 {
            true => SLACK / self.answer,
            false => 0.0,
        }
    }

    /// Adds what an impulse makes of the velocities of nodes.
    pub fn push(&self, mass: &[f64], impulse: [f64; 3], change: &mut [[f64; 3]]) {
        for &(slot, w) in &self.nodes {
            let share = w / mass[slot as usize];
            for a in 0..3 {
                change[slot as usize][a] += share * impulse[a];
            }
        }
    }

    /// Velocity of the point where nodes have these.
    pub fn velocity(&self, of_nodes: &[[f64; 3]]) -> [f64; 3] {
        let mut v = [0.0; 3];
        for &(slot, w) in &self.nodes {
            for a in 0..3 {
                v[a] += w * of_nodes[slot as usize][a];
            }
        }
        v
    }
}

/// What walls hold of a solid.
#[derive(Clone, Debug, Default)]
pub struct Walls {
    pub(super) bonds: Vec<Bond>,
    /// Of every point that was held since nodes were last held or let go.
    pub(super) borne: BTreeMap<usize, Borne>,
    /// Points and colliders of the latest bonds, those that are asked for, and the nodes that bear these.
    pub(super) latest: Vec<(usize, usize)>,
    pub(super) chosen: Vec<usize>,
    pub(super) nodes: Vec<u32>,
    /// Change of the velocity of every node [m/s], and that of a step towards it.
    pub(super) change: Vec<[f64; 3]>,
    pub(super) slope: Vec<[f64; 3]>,
}

impl Walls {
    /// Forgets what bears points: other nodes are held now.
    pub(super) fn restart(&mut self) {
        self.borne.clear();
        self.latest.clear();
    }
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
