//! One flat boundary along the axes, and what it makes of a line of nodes across it.

use super::{
    FixedRegion, Placed, THIN,
    approach::{RANGE, TOUCHING},
    contact::coefficient,
    shape::Shape,
};
use crate::{
    mat3::dot,
    scene::{Aabb, Surface},
};

/// How far nodes behind a boundary share what is in front of it [cells]: the reach of the stencil.
const REACH: f64 = 1.5;
/// Gap below which matter is in a boundary, and not on it, at 8 particles per cell [cells].
const OVERLAP: f64 = -0.25;
/// Ranks of nodes that may move as one with a node of its lines.
pub(super) const NEAR: [i32; 2] = [-2, 4];
/// Round-off in coordinates of boundaries that are meant to lie halfway between nodes [cells].
const SLACK: f64 = 1e-6;

/// Whose face it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Owner {
    /// A collider, by its number.
    Body(usize),
    /// A held region, by its number.
    Region(usize),
}

/// A flat boundary along the axes that matter stays attached to.
#[derive(Clone, Copy, Debug)]
pub struct Face {
    /// Whose it is.
    pub(super) owner: Owner,
    pub(super) axis: usize,
    /// On which side matter is, +1 or -1.
    pub(super) side: i32,
    /// The node along the axis that carries those behind.
    pub(super) target: i32,
    /// How far it is in front of the boundary [cells].
    pub(super) eta: f64,
    /// Velocity of the target and of the two nodes behind, when attached, over that of the target.
    pub(super) share: [f64; 3],
    /// Where nodes are, across the axis [units].
    pub(super) bounds: Aabb,
    /// Components of the velocity that it holds.
    pub(super) constrained_axes: [bool; 3],
    pub(super) velocity: [f64; 3],
    /// Whether it lets go of what moves away.
    pub(super) releases: bool,
    /// Coulomb coefficient.
    pub(super) friction: f64,
    /// Whether that depends on what it meets, and the collider's own, if it states one.
    pub(super) frictional: Option<Option<f64>>,
}

/// Velocities on the way from forces to boundaries.
pub trait Nodes {
    /// Mass and velocity of a node by its place in the grid; none where there is no matter.
    fn node(&self, index: [i32; 3]) -> Option<(f64, [f64; 3])>;

    /// How near matter that reaches a node is to a collider [units].
    fn gap(&self, index: [i32; 3], body: usize) -> f64;
}

/// Mass and velocity, relative to the boundary, of the three nodes of a line: the target and the two behind.
pub(super) type Members = [(f64, [f64; 3]); 3];

/// What a face makes of a line of nodes.
#[derive(Clone, Copy, Debug)]
pub(super) struct HeldLine {
    /// Velocity, relative to the boundary, of its target if it is attached.
    pub(super) carried: [f64; 3],
    /// Speeds away from the boundary of the target and the two behind, where it presses only.
    pub(super) across: Option<[f64; 3]>,
    /// Part of its way to where it would be attached, along the boundary, that friction moves it.
    pub(super) friction: f64,
}

impl Face {
    pub(super) fn new(owner: Owner, axis: usize, side: i32, at: f64, cell: f64) -> Self {
        let at = f64::from(side) * at / cell;
        let target = (at + 0.5 - SLACK).ceil();
        let eta = target - at;
        Self {
            owner,
            axis,
            side,
            target: side * target as i32,
            eta,
            share: [1.0, (eta - 1.0) / eta, (eta - 2.0) / eta],
            bounds: Aabb {
                min: [f64::NEG_INFINITY; 3],
                max: [f64::INFINITY; 3],
            },
            constrained_axes: [true; 3],
            velocity: [0.0; 3],
            releases: false,
            friction: 0.0,
            frictional: None,
        }
    }

    /// Of a collider: a plane along the axes that does not turn.
    pub(super) fn of_body(body: &Placed<'_>, cell: f64) -> Option<Self> {
        let contact = body.contact();
        let Shape::HalfSpace { .. } = body.body.shape else {
            return None;
        };
        let releases = contact.surface == Surface::Separate;
        if body.turns() || releases && contact.gives_back() {
            return None;
        }
        let normal = body.distance(body.start.translation).normal;
        let axis = (0..3).find(|&a| normal[a].abs() > 1.0 - 1e-12)?;
        let side = if normal[axis] > 0.0 { 1 } else { -1 };
        let at = body.start.translation[axis];
        let sticky = contact.surface == Surface::Sticky;
        Some(Self {
            constrained_axes: std::array::from_fn(|a| sticky || a == axis),
            velocity: body.velocity(body.start.translation),
            releases,
            friction: if sticky { 0.0 } else { contact.friction },
            frictional: (!sticky).then_some(body.body.friction),
            ..Self::new(Owner::Body(body.id), axis, side, at, cell)
        })
    }

    /// Of a held region that has faces: all that are far enough from the one behind.
    pub(super) fn of_region(held: &FixedRegion, cell: f64) -> impl Iterator<Item = Self> {
        let FixedRegion {
            bounds: Aabb { min, max },
            velocity,
            has_faces,
            id,
            ..
        } = *held;
        (0..6).filter_map(move |face| {
            let (axis, side) = (face / 2, if face % 2 == 0 { -1 } else { 1 });
            if !has_faces || max[axis] - min[axis] < THIN * cell {
                return None;
            }
            let at = if side > 0 { max[axis] } else { min[axis] };
            // Near its edges a region holds nodes as they are: there is no line of nodes that its face ends.
            let inner = |x: [f64; 3], by: f64, end: f64| {
                std::array::from_fn(|a| if a == axis { end } else { x[a] + by * cell })
            };
            Some(Self {
                bounds: Aabb {
                    min: inner(min, REACH, f64::NEG_INFINITY),
                    max: inner(max, -REACH, f64::INFINITY),
                },
                velocity,
                ..Self::new(Owner::Region(id), axis, side, at, cell)
            })
        })
    }

    /// The same for an object whose surface states this friction.
    pub(super) fn against(&self, object: Option<f64>) -> Self {
        let friction = self.frictional.map(|stated| coefficient(stated, object));
        Self {
            friction: friction.unwrap_or(self.friction),
            ..*self
        }
    }

    /// How many nodes behind its target a node is.
    pub(super) fn rank(&self, i: i32) -> i32 {
        self.side * (self.target - i)
    }

    /// Whether a node is of one of its lines.
    pub(super) fn has(&self, index: [i32; 3]) -> bool {
        (0..=2).contains(&self.rank(index[self.axis]))
    }

    /// In the line of nodes through `index` the one that is `n` behind its target.
    pub(super) fn behind(&self, index: [i32; 3], n: i32) -> [i32; 3] {
        let mut node = index;
        node[self.axis] = self.target - n * self.side;
        node
    }

    /// Whether it may act on a node of a box of nodes [units].
    pub fn touches(&self, first: [f64; 3], last: [f64; 3], cell: f64) -> bool {
        (0..3).all(|a| {
            if a != self.axis {
                return last[a] >= self.bounds.min[a] && first[a] <= self.bounds.max[a];
            }
            let (near, far) = (self.target, self.target - 2 * self.side);
            let [low, high] = [near.min(far), near.max(far)].map(|i| f64::from(i) * cell);
            last[a] >= low - 0.5 * cell && first[a] <= high + 0.5 * cell
        })
    }

    /// Whether it may act on some node of a box of nodes, or on what moves as one with it; by places in the grid.
    pub fn is_near(&self, first: [i32; 3], last: [i32; 3], cell: f64) -> bool {
        (0..3).all(|a| {
            if a != self.axis {
                let [low, high] = [first[a], last[a]].map(|i| f64::from(i) * cell);
                return high >= self.bounds.min[a] && low <= self.bounds.max[a];
            }
            let ranks = [self.rank(first[a]), self.rank(last[a])];
            ranks[0].max(ranks[1]) >= NEAR[0] && ranks[0].min(ranks[1]) <= NEAR[1]
        })
    }

    /// The axis that it is across, and the first and last node of its lines along that.
    pub fn lines(&self) -> (usize, [i32; 2]) {
        let far = self.target - 2 * self.side;
        (self.axis, [self.target.min(far), self.target.max(far)])
    }

    /// Which of the nodes of its lines one is, by its place along that axis: 0 for the target.
    pub fn rank_of(&self, i: i32) -> usize {
        self.rank(i) as usize
    }

    /// How near matter in the line of nodes through `index` is to it [units]; none where it does not act on it.
    pub(super) fn gap(&self, index: [i32; 3], nodes: &impl Nodes, cell: f64) -> Option<f64> {
        if !self.bounds.contains(index.map(|i| f64::from(i) * cell)) {
            return None;
        }
        let nearest = self.behind(index, 1);
        nodes.node(nearest)?;
        let Owner::Body(id) = self.owner else {
            return Some(0.0);
        };
        let gap = nodes.gap(nearest, id);
        let range = if self.releases { RANGE } else { TOUCHING };
        (OVERLAP * cell..range * cell).contains(&gap).then_some(gap)
    }

    /// Whether it grips the same component of the same nodes as another of the same axis may.
    pub(super) fn meets(&self, other: &Self) -> bool {
        (0..=2).any(|n| other.has(self.behind([0; 3], n)))
    }

    /// Mass and velocity, relative to the boundary, of the nodes of the line through `index`, from the target on.
    pub(super) fn members(&self, index: [i32; 3], nodes: &impl Nodes) -> Members {
        [0, 1, 2].map(|n| match nodes.node(self.behind(index, n)) {
            Some((m, v)) => (m, std::array::from_fn(|a| v[a] - self.velocity[a])),
            None => (0.0, [0.0; 3]),
        })
    }

    /// Velocity, relative to the boundary, of the target of a line that is attached to it.
    pub(super) fn carried(&self, line: &Members) -> [f64; 3] {
        let (mut shared, mut mass) = ([0.0; 3], 0.0);
        for ((m, v), share) in line.iter().zip(self.share) {
            for q in 0..3 {
                shared[q] += share * m * v[q];
            }
            mass += share * share * m;
        }
        shared.map(|shared| if mass > 0.0 { shared / mass } else { 0.0 })
    }

    /// What becomes of a line that is attached to it, and to nothing else.
    pub(super) fn bond(&self, line: &Members, frictional: [bool; 3]) -> HeldLine {
        let mut held = HeldLine {
            carried: self.carried(line),
            across: None,
            friction: 0.0,
        };
        if self.friction > 0.0 {
            let carried = held.carried[self.axis];
            let given = line.iter().zip(self.share);
            let given = given.map(|((m, v), share)| m * (share * carried - v[self.axis]));
            let normal_impulse = f64::from(self.side) * given.sum::<f64>();
            held.friction = self.friction_part(line, &held.carried, normal_impulse, frictional);
        }
        held
    }

    /// What becomes of a line that presses on it, and may come closer by `max_closing_speed`; none where it does not press.
    pub(super) fn press(
        &self,
        line: &Members,
        max_closing_speed: f64,
        frictional: [bool; 3],
    ) -> Option<HeldLine> {
        let (speed, given) = self.clamp_inward(line, max_closing_speed);
        if given.is_nan() || given <= 0.0 {
            return None;
        }
        let carried = self.carried(line);
        Some(HeldLine {
            carried,
            across: Some(speed),
            friction: self.friction_part(line, &carried, given, frictional),
        })
    }

    /// Moves the node of a line that is `rank` behind its target, in components along the boundary that are `frictional`.
    pub(super) fn move_node(
        &self,
        velocity: &mut [f64; 3],
        held: &HeldLine,
        rank: usize,
        frictional: [bool; 3],
    ) {
        match &held.across {
            Some(speed) => {
                velocity[self.axis] = self.velocity[self.axis] + f64::from(self.side) * speed[rank];
            }
            None => {
                for q in (0..3).filter(|&q| self.constrained_axes[q]) {
                    velocity[q] = self.velocity[q] + self.share[rank] * held.carried[q];
                }
            }
        }
        self.apply_friction(velocity, held, rank, frictional);
    }

    /// Moves it as friction does.
    pub(super) fn apply_friction(
        &self,
        velocity: &mut [f64; 3],
        held: &HeldLine,
        rank: usize,
        frictional: [bool; 3],
    ) {
        if held.friction <= 0.0 {
            return;
        }
        for q in (0..3).filter(|&q| q != self.axis && frictional[q]) {
            let attached = self.velocity[q] + self.share[rank] * held.carried[q];
            velocity[q] += held.friction * (attached - velocity[q]);
        }
    }

    /// Speeds away from the boundary of the nodes of a line that may come closer by `max_closing_speed`, and the momentum that
    /// the boundary gives to them.
    pub(super) fn clamp_inward(&self, line: &Members, max_closing_speed: f64) -> ([f64; 3], f64) {
        let mass = line.map(|(m, _)| m);
        let free = line.map(|(_, v)| f64::from(self.side) * v[self.axis] + max_closing_speed);
        let share = self.share;
        let mut speed = free;
        // The nearest of what is allowed is where none, both or one of the nodes behind are held: where no free one is
        // too far inwards and no held one is pulled at.
        for is_held in [[false; 2], [true; 2], [true, false], [false, true]] {
            let held = || (1..3).filter(|&n| is_held[n - 1]);
            let of_line = mass[0] + held().map(|n| share[n] * share[n] * mass[n]).sum::<f64>();
            let shared =
                mass[0] * free[0] + held().map(|n| share[n] * mass[n] * free[n]).sum::<f64>();
            // Matter that does not reach the target just stops.
            let carried = if mass[0] > 0.0 { shared / of_line } else { 0.0 };
            let least = share.map(|share| share * carried);
            speed = [carried, free[1], free[2]];
            held().for_each(|n| speed[n] = least[n]);
            let obeys = |n: usize| {
                mass[n] == 0.0
                    || if is_held[n - 1] {
                        least[n] >= free[n]
                    } else {
                        free[n] >= least[n]
                    }
            };
            if obeys(1) && obeys(2) {
                break;
            }
        }
        let given = (0..3).map(|n| mass[n] * (speed[n] - free[n])).sum();
        (speed.map(|speed| speed - max_closing_speed), given)
    }

    /// Coulomb friction on a line on which this momentum presses: the part of its way towards where it would be attached along
    /// the boundary, all of it if that takes no more than the coefficient allows. Only in the components `frictional`, which
    /// no other boundary has a hold of.
    pub(super) fn friction_part(
        &self,
        line: &Members,
        carried: &[f64; 3],
        normal_impulse: f64,
        frictional: [bool; 3],
    ) -> f64 {
        let most = self.friction * normal_impulse;
        if most <= 0.0 {
            return 0.0;
        }
        let mut taken = [0.0; 3];
        for ((m, v), share) in line.iter().zip(self.share) {
            for q in (0..3).filter(|&q| q != self.axis && frictional[q]) {
                taken[q] += m * (share * carried[q] - v[q]);
            }
        }
        let all = dot(taken, taken).sqrt();
        if all > most { most / all } else { 1.0 }
    }
}
