//! Matter at a flat boundary along the axes: attached to a held region, a sticky or slipping wall, or pressed on a surface
//! that lets go.
//!
//! There the velocity across the boundary is zero *in its plane*, wherever that lies between nodes, and proportional to
//! the distance next to it. So of every line of nodes across the boundary only those half a cell and more in front of it
//! are free. The one nearest to it (`eta` cells in front, 1/2 <= `eta` < 3/2) carries the two behind with it, in
//! proportion to their distance: their velocity is `eta_i / eta` times its own, and it takes over their momentum and
//! mass as the principle of virtual work has it,
//!
//! ```text
//! v = sum alpha_i m_i v_i / sum alpha_i^2 m_i,    alpha_i = eta_i / eta.
//! ```
//!
//! That is of second order in the cell size. Nodes at rest in the plane and behind it are not: the layer next to the
//! boundary is strained by three quarters of what it should be, and a bar that is held so is 0.19 cells longer
//! (`docs/decisions/0009-contact.md`).
//!
//! A surface that lets go holds nodes back in one direction only: the two behind may not move inwards faster than in that
//! proportion, `v_i >= eta_i / eta v`. What forces alone would give a line is moved to the nearest by mass of all that obey
//! this. Again energy never grows, and where matter presses evenly the line is the attached one.
//!
//! Friction moves a line from where it is towards where it would be attached, along the surface, at most until the
//! coefficient times the momentum that presses has gone to the surface.

use super::{
    FixedRegion, Placed, THIN,
    approach::{RANGE, TOUCHING},
    contact::coefficient,
    edge,
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
const NEAR: [i32; 2] = [-2, 4];
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
    owner: Owner,
    axis: usize,
    /// On which side matter is, +1 or -1.
    side: i32,
    /// The node along the axis that carries those behind.
    target: i32,
    /// How far it is in front of the boundary [cells].
    eta: f64,
    /// Velocity of the target and of the two nodes behind, when attached, over that of the target.
    share: [f64; 3],
    /// Where nodes are, across the axis [units].
    bounds: Aabb,
    /// Components of the velocity that it holds.
    constrained_axes: [bool; 3],
    velocity: [f64; 3],
    /// Whether it lets go of what moves away.
    releases: bool,
    /// Coulomb coefficient.
    friction: f64,
    /// Whether that depends on what it meets, and the collider's own, if it states one.
    frictional: Option<Option<f64>>,
}

/// Velocities on the way from forces to boundaries.
pub trait Nodes {
    /// Mass and velocity of a node by its place in the grid; none where there is no matter.
    fn node(&self, index: [i32; 3]) -> Option<(f64, [f64; 3])>;

    /// Mass of the matter at a node, 0 where there is none: what is held weighs no more than it does.
    fn matter(&self, index: [i32; 3]) -> f64 {
        self.node(index).map_or(0.0, |(mass, _)| mass)
    }

    /// How near matter that reaches a node is to a collider [units].
    fn gap(&self, index: [i32; 3], body: usize) -> f64;

    /// Whether masses tell where matter ends: it keeps its shape and has one density.
    fn reconstructs_surface(&self) -> bool;
}

/// What boundaries along the axes made of a node.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Attached {
    /// Its velocity.
    pub velocity: [f64; 3],
    owners: [Option<Owner>; 6],
}

impl Attached {
    /// What no boundary along the axes has changed.
    pub fn free(velocity: [f64; 3]) -> Self {
        Self {
            velocity,
            owners: [None; 6],
        }
    }

    /// What a face alone has changed.
    pub fn to(face: &Face, velocity: [f64; 3]) -> Self {
        let mut found = Self::free(velocity);
        found.owners[0] = Some(face.owner);
        found
    }

    /// Whether something is obeyed already.
    pub fn obeys(&self, owner: Owner) -> bool {
        self.owners.contains(&Some(owner))
    }
}

/// Mass and velocity, relative to the boundary, of the three nodes of a line: the target and the two behind.
type Members = [(f64, [f64; 3]); 3];

/// What a face makes of a line of nodes.
#[derive(Clone, Copy, Debug)]
struct HeldLine {
    /// Velocity, relative to the boundary, of its target if it is attached.
    carried: [f64; 3],
    /// Speeds away from the boundary of the target and the two behind, where it presses only.
    across: Option<[f64; 3]>,
    /// Part of its way to where it would be attached, along the boundary, that friction moves it.
    rubs: f64,
}

/// Per axis and side.
type All<'a> = [[Option<&'a Face>; 2]; 3];

impl Face {
    fn new(owner: Owner, axis: usize, side: i32, at: f64, cell: f64) -> Self {
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
        if body.angular != [0.0; 3] || releases && contact.gives_back() {
            return None;
        }
        let normal = body.distance(body.start.translation).normal;
        let axis = (0..3).find(|&a| normal[a].abs() > 1.0 - 1e-12)?;
        let side = if normal[axis] > 0.0 { 1 } else { -1 };
        let at = body.start.translation[axis];
        let sticky = contact.surface == Surface::Sticky;
        Some(Self {
            constrained_axes: std::array::from_fn(|a| sticky || a == axis),
            velocity: body.linear,
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
    fn rank(&self, i: i32) -> i32 {
        self.side * (self.target - i)
    }

    /// Whether a node is of one of its lines.
    fn has(&self, index: [i32; 3]) -> bool {
        (0..=2).contains(&self.rank(index[self.axis]))
    }

    /// In the line of nodes through `index` the one that is `n` behind its target.
    fn behind(&self, index: [i32; 3], n: i32) -> [i32; 3] {
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
    fn gap(&self, index: [i32; 3], nodes: &impl Nodes, cell: f64) -> Option<f64> {
        if !self.bounds.contains(index.map(|i| f64::from(i) * cell)) {
            return None;
        }
        let nearest = self.behind(index, 1);
        nodes.node(nearest)?;
        let Owner::Body(id) = self.owner else {
            return Some(0.0);
        };
        let mut gap = nodes.gap(nearest, id);
        if self.releases && gap < RANGE * cell && nodes.reconstructs_surface() {
            let mut normal = [0.0; 3];
            normal[self.axis] = f64::from(self.side);
            let edge = edge::line(nearest, normal, self.eta - 1.0, |at| nodes.matter(at));
            gap = cell * edge::gap(gap / cell, edge);
        }
        let range = if self.releases { RANGE } else { TOUCHING };
        (OVERLAP * cell..range * cell).contains(&gap).then_some(gap)
    }

    /// Whether it grips the same component of the same nodes as another of the same axis may.
    fn meets(&self, other: &Self) -> bool {
        (0..=2).any(|n| other.has(self.behind([0; 3], n)))
    }

    /// Mass and velocity, relative to the boundary, of the nodes of the line through `index`, from the target on.
    fn members(&self, index: [i32; 3], nodes: &impl Nodes) -> Members {
        [0, 1, 2].map(|n| match nodes.node(self.behind(index, n)) {
            Some((m, v)) => (m, std::array::from_fn(|a| v[a] - self.velocity[a])),
            None => (0.0, [0.0; 3]),
        })
    }

    /// Velocity, relative to the boundary, of the target of a line that is attached to it.
    fn carried(&self, line: &Members) -> [f64; 3] {
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
    fn bond(&self, line: &Members, frictional: [bool; 3]) -> HeldLine {
        let mut held = HeldLine {
            carried: self.carried(line),
            across: None,
            rubs: 0.0,
        };
        if self.friction > 0.0 {
            let carried = held.carried[self.axis];
            let given = line.iter().zip(self.share);
            let given = given.map(|((m, v), share)| m * (share * carried - v[self.axis]));
            let normal_impulse = f64::from(self.side) * given.sum::<f64>();
            held.rubs = self.rubs(line, &held.carried, normal_impulse, frictional);
        }
        held
    }

    /// What becomes of a line that presses on it, and may come closer by `max_closing_speed`; none where it does not press.
    fn press(
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
            rubs: self.rubs(line, &carried, given, frictional),
        })
    }

    /// Moves the node of a line that is `rank` behind its target, in components along the boundary that are `frictional`.
    fn move_node(
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
        self.rub(velocity, held, rank, frictional);
    }

    /// Moves it as friction does.
    fn rub(&self, velocity: &mut [f64; 3], held: &HeldLine, rank: usize, frictional: [bool; 3]) {
        if held.rubs <= 0.0 {
            return;
        }
        for q in (0..3).filter(|&q| q != self.axis && frictional[q]) {
            let attached = self.velocity[q] + self.share[rank] * held.carried[q];
            velocity[q] += held.rubs * (attached - velocity[q]);
        }
    }

    /// Speeds away from the boundary of the nodes of a line that may come closer by `max_closing_speed`, and the momentum that
    /// the boundary gives to them.
    fn clamp_inward(&self, line: &Members, max_closing_speed: f64) -> ([f64; 3], f64) {
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
    fn rubs(
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

/// The nodes of a line that move as one, and their shares.
#[derive(Clone, Copy)]
struct Line {
    members: [(i32, f64); 5],
    count: usize,
    /// Share of the node that was asked for.
    own: f64,
}

/// What the faces of one axis that grip component `q` make of the node `i`; none when they hold it where they are.
fn line(along: &[Option<&Face>; 2], q: usize, i: i32) -> Option<Line> {
    let faces = || {
        along
            .iter()
            .flatten()
            .filter(|face| face.constrained_axes[q])
    };
    let mut own = (i, 1.0);
    for face in faces() {
        if let rank @ 1..=2 = face.rank(i) {
            if own.0 != i {
                return None;
            }
            own = (face.target, face.share[rank as usize]);
        }
    }
    let (target, own) = own;
    if faces().any(|face| (1..=2).contains(&face.rank(target))) {
        return None;
    }
    let mut line = Line {
        members: [(target, 1.0); 5],
        count: 1,
        own,
    };
    for face in faces().filter(|face| face.target == target) {
        for (n, share) in (0..).zip(face.share).skip(1) {
            line.members[line.count] = (target - n * face.side, share);
            line.count += 1;
        }
    }
    Some(line)
}

/// Velocity of a node near flat boundaries during `dt`; none where none of them acts on it.
pub fn attached(
    faces: &[Face],
    index: [i32; 3],
    nodes: &impl Nodes,
    cell: f64,
    dt: f64,
) -> Option<Attached> {
    if !faces.iter().any(|face| face.has(index)) {
        return None;
    }
    let mut found = Attached::free(nodes.node(index)?.1);
    let FacesAt {
        bonded: all,
        unilateral,
    } = FacesAt::new(faces, index, nodes, cell, &mut found)?;
    let bonded = || all.iter().flatten().flatten();
    let holding = || bonded().filter(|face| face.has(index));
    let frictional: [bool; 3] = std::array::from_fn(|q| {
        unilateral[q].is_none() && !holding().any(|face| face.constrained_axes[q])
    });
    let mut bonded = bonded();
    match (bonded.next(), bonded.next()) {
        (None, _) => {}
        // Nearly always.
        (Some(face), None) if face.has(index) => {
            let held = face.bond(&face.members(index, nodes), frictional);
            let rank = face.rank(index[face.axis]) as usize;
            face.move_node(&mut found.velocity, &held, rank, frictional);
        }
        _ => bond_all(&mut found.velocity, &all, index, nodes, frictional),
    }
    for (face, gap) in unilateral.into_iter().flatten() {
        let line = face.members(index, nodes);
        if let Some(held) = face.press(&line, gap.max(0.0) / dt, frictional) {
            let rank = face.rank(index[face.axis]) as usize;
            face.move_node(&mut found.velocity, &held, rank, frictional);
        }
    }
    Some(found)
}

/// The same of all nodes of the line through `index` across a face, where no other one is near: velocities of its target and the
/// two behind, zero where there is no matter. None where it does not act on the line.
pub fn attached_line(
    face: &Face,
    index: [i32; 3],
    nodes: &impl Nodes,
    cell: f64,
    dt: f64,
) -> Option<[[f64; 3]; 3]> {
    let gap = face.gap(index, nodes, cell)?;
    let line = face.members(index, nodes);
    let frictional = std::array::from_fn(|q| q != face.axis && !face.constrained_axes[q]);
    let held = match face.releases {
        true => face.press(&line, gap.max(0.0) / dt, frictional),
        false => Some(face.bond(&line, frictional)),
    };
    let of_node = |rank| {
        let (_, mut velocity) = nodes.node(face.behind(index, rank as i32))?;
        if let Some(held) = &held {
            face.move_node(&mut velocity, held, rank, frictional);
        }
        Some(velocity)
    };
    Some([0, 1, 2].map(|rank| of_node(rank).unwrap_or([0.0; 3])))
}

/// The faces that act on a node or on those that move as one with it.
struct FacesAt<'a> {
    /// Those that matter is attached to.
    bonded: All<'a>,
    /// Per axis the one that the node presses on, with its gap.
    unilateral: [Option<(&'a Face, f64)>; 3],
}

impl<'a> FacesAt<'a> {
    /// Finds them and writes down what the node obeys; none where that is nothing.
    fn new(
        faces: &'a [Face],
        index: [i32; 3],
        nodes: &impl Nodes,
        cell: f64,
        found: &mut Attached,
    ) -> Option<Self> {
        let mut all: All<'_> = [[None; 2]; 3];
        let mut unilateral: [Option<(&Face, f64)>; 3] = [None; 3];
        let mut count = 0;
        for face in faces {
            let of = &mut all[face.axis][usize::from(face.side > 0)];
            let is_in_reach = (NEAR[0]..=NEAR[1]).contains(&face.rank(index[face.axis]));
            if of.is_some() || !is_in_reach {
                continue;
            }
            let Some(gap) = face.gap(index, nodes, cell) else {
                continue;
            };
            if !face.releases {
                *of = Some(face);
                if face.has(index) {
                    found.owners[count] = Some(face.owner);
                    count += 1;
                }
            } else if face.has(index) && unilateral[face.axis].is_none() {
                unilateral[face.axis] = Some((face, gap));
            }
        }
        // Nodes that another boundary has a hold of in the same direction are left to the conditions on single nodes.
        for (axis, of) in unilateral.iter_mut().enumerate() {
            let alone = |face: &Face| {
                let mut holding = all.iter().flatten().flatten();
                let mut facing = faces.iter().filter(|other| other.axis == axis);
                !holding.any(|other| other.constrained_axes[axis])
                    && !facing.any(|other| other.side != face.side && face.meets(other))
            };
            *of = of.filter(|(face, _)| alone(face));
            if let Some((face, _)) = of {
                found.owners[count] = Some(face.owner);
                count += 1;
            }
        }
        (count > 0).then_some(Self {
            bonded: all,
            unilateral,
        })
    }
}

/// Moves a node of lines that are attached to several boundaries.
fn bond_all(
    velocity: &mut [f64; 3],
    all: &All<'_>,
    index: [i32; 3],
    nodes: &impl Nodes,
    frictional: [bool; 3],
) {
    let holding = || {
        all.iter()
            .flatten()
            .flatten()
            .filter(|face| face.has(index))
    };
    for q in 0..3 {
        if let Some(face) = holding().find(|face| face.constrained_axes[q]) {
            let u = face.velocity[q];
            velocity[q] = u + component(all, index, q, u, nodes).0;
        }
    }
    for face in holding().filter(|face| face.friction > 0.0) {
        let u = face.velocity[face.axis];
        let given = component(all, index, face.axis, u, nodes).1;
        let line = face.members(index, nodes);
        let carried = face.carried(&line);
        let normal_impulse = given * f64::from(face.side);
        let held = HeldLine {
            rubs: face.rubs(&line, &carried, normal_impulse, frictional),
            across: None,
            carried,
        };
        face.rub(
            velocity,
            &held,
            face.rank(index[face.axis]) as usize,
            frictional,
        );
    }
}

/// Component `q` of the velocity of a node relative to boundaries that move at `u`, and the momentum that they give to all
/// nodes that move as one with it.
fn component(all: &All<'_>, index: [i32; 3], q: usize, u: f64, nodes: &impl Nodes) -> (f64, f64) {
    let mut lines = index.map(|i| Line {
        members: [(i, 1.0); 5],
        count: 1,
        own: 1.0,
    });
    let mut is_held = false;
    for axis in 0..3 {
        match line(&all[axis], q, index[axis]) {
            Some(line) => lines[axis] = line,
            None => is_held = true,
        }
    }
    let (mut shared, mut mass, mut lever, mut momentum) = (0.0, 0.0, 0.0, 0.0);
    for &(i, a) in &lines[0].members[..lines[0].count] {
        for &(j, b) in &lines[1].members[..lines[1].count] {
            for &(k, c) in &lines[2].members[..lines[2].count] {
                let Some((m, v)) = nodes.node([i, j, k]) else {
                    continue;
                };
                let share = a * b * c;
                shared += share * m * (v[q] - u);
                mass += share * share * m;
                lever += share * m;
                momentum += m * (v[q] - u);
            }
        }
    }
    if is_held || mass == 0.0 {
        return (0.0, -momentum);
    }
    let v = shared / mass;
    let own = lines[0].own * lines[1].own * lines[2].own;
    (own * v, lever * v - momentum)
}

#[cfg(test)]
mod tests;
