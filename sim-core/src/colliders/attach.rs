//! Matter that stays attached to a flat boundary along the axes: a held region, a sticky or slipping wall.
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
//! (`docs/decisions/0015-walls-of-second-order.md`).

use super::{Held, Placed, THIN, approach::TOUCHING, shape::Shape};
use crate::{
    mat3::dot,
    scene::{Aabb, Surface},
};

/// How far nodes behind a boundary share what is in front of it [cells]: the reach of the stencil.
const REACH: f64 = 1.5;
/// Gap below which matter is in a boundary, and not on it, at 8 particles per cell [cells].
const OVERLAP: f64 = -0.25;
/// Round-off in coordinates of boundaries that are meant to lie halfway between nodes [cells].
const SLACK: f64 = 1e-6;

/// Whose face it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Owner {
    /// A collider, by its number.
    Body(usize),
    /// A held region, by its number.
    Region(usize),
}

/// A flat boundary along the axes that matter stays attached to.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Face {
    /// Whose it is.
    owner: Owner,
    axis: usize,
    /// On which side matter is, +1 or -1.
    side: i32,
    /// The node along the axis that carries those behind.
    target: i32,
    /// Velocity of the next two nodes behind over that of the target.
    share: [f64; 2],
    /// Where nodes are, across the axis [units].
    bounds: Aabb,
    /// Components of the velocity that it holds.
    grips: [bool; 3],
    velocity: [f64; 3],
    /// Coulomb coefficient.
    friction: f64,
}

/// Velocities on the way from forces to boundaries.
pub(crate) trait Nodes {
    /// Mass and velocity of a node by its place in the grid; none where there is no matter.
    fn node(&self, index: [i32; 3]) -> Option<(f64, [f64; 3])>;

    /// How near matter that reaches a node is to a collider [units].
    fn gap(&self, index: [i32; 3], body: usize) -> f64;
}

/// What boundaries along the axes made of a node.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Attached {
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

    /// Whether something is obeyed already.
    pub fn obeys(&self, owner: Owner) -> bool {
        self.owners.contains(&Some(owner))
    }
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
            share: [(eta - 1.0) / eta, (eta - 2.0) / eta],
            bounds: Aabb {
                min: [f64::NEG_INFINITY; 3],
                max: [f64::INFINITY; 3],
            },
            grips: [true; 3],
            velocity: [0.0; 3],
            friction: 0.0,
        }
    }

    /// Of a collider: a plane along the axes that does not turn.
    pub(super) fn of_body(body: &Placed<'_>, cell: f64) -> Option<Self> {
        let contact = body.contact();
        let Shape::HalfSpace { .. } = body.body.shape else {
            return None;
        };
        if !body.holds() || body.angular != [0.0; 3] {
            return None;
        }
        let normal = body.distance(body.start.translation).normal;
        let axis = (0..3).find(|&a| normal[a].abs() > 1.0 - 1e-12)?;
        let side = if normal[axis] > 0.0 { 1 } else { -1 };
        let at = body.start.translation[axis];
        let sticky = contact.surface == Surface::Sticky;
        Some(Self {
            grips: std::array::from_fn(|a| sticky || a == axis),
            velocity: body.linear,
            friction: if sticky { 0.0 } else { contact.friction },
            ..Self::new(Owner::Body(body.id), axis, side, at, cell)
        })
    }

    /// Of a held region without matter inside: all that are far enough from the one behind.
    pub(super) fn of_region(held: &Held, cell: f64) -> impl Iterator<Item = Self> {
        let Held {
            bounds: Aabb { min, max },
            velocity,
            is_empty,
            id,
        } = *held;
        (0..6).filter_map(move |face| {
            let (axis, side) = (face / 2, if face % 2 == 0 { -1 } else { 1 });
            if !is_empty || max[axis] - min[axis] < THIN * cell {
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

    /// How many nodes behind its target a node is.
    fn rank(&self, i: i32) -> i32 {
        self.side * (self.target - i)
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

    /// Whether matter in the line of nodes through `index` is attached to it.
    fn acts(&self, index: [i32; 3], nodes: &impl Nodes, cell: f64) -> bool {
        if !self.bounds.contains(index.map(|i| f64::from(i) * cell)) {
            return false;
        }
        let nearest = self.behind(index, 1);
        nodes.node(nearest).is_some()
            && match self.owner {
                Owner::Body(id) => {
                    (OVERLAP * cell..TOUCHING * cell).contains(&nodes.gap(nearest, id))
                }
                Owner::Region(_) => true,
            }
    }

    /// What [`component`] gives for all that it grips, where no other face acts and nothing rubs: most nodes.
    fn carry(&self, velocity: &mut [f64; 3], index: [i32; 3], nodes: &impl Nodes) {
        let (mut shared, mut mass) = ([0.0; 3], 0.0);
        for (n, share) in (0..).zip([1.0, self.share[0], self.share[1]]) {
            if let Some((m, v)) = nodes.node(self.behind(index, n)) {
                for q in 0..3 {
                    shared[q] += share * m * (v[q] - self.velocity[q]);
                }
                mass += share * share * m;
            }
        }
        let own = match self.rank(index[self.axis]) {
            0 => 1.0,
            rank => self.share[rank as usize - 1],
        };
        for q in (0..3).filter(|&q| self.grips[q]) {
            let carried = if mass > 0.0 {
                own * (shared[q] / mass)
            } else {
                0.0
            };
            velocity[q] = self.velocity[q] + carried;
        }
    }

    /// Coulomb friction on a node in or behind the plane of a line that is `pressed` with this momentum: such nodes share it.
    fn rub(&self, v: &mut [f64; 3], pressed: f64, index: [i32; 3], nodes: &impl Nodes) {
        let mass_at = |n: i32| {
            let node = nodes.node(self.behind(index, n));
            node.map_or(0.0, |(mass, _)| mass)
        };
        let mass = mass_at(1) + mass_at(2);
        let mut relative: [f64; 3] = std::array::from_fn(|a| v[a] - self.velocity[a]);
        relative[self.axis] = 0.0;
        let speed = dot(relative, relative).sqrt();
        if speed > 0.0 && pressed > 0.0 {
            let taken = (self.friction * pressed / (mass * speed)).min(1.0);
            for a in 0..3 {
                v[a] -= taken * relative[a];
            }
        }
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
    let faces = || along.iter().flatten().filter(|face| face.grips[q]);
    let mut own = (i, 1.0);
    for face in faces() {
        if let rank @ 1..=2 = face.rank(i) {
            if own.0 != i {
                return None;
            }
            own = (face.target, face.share[rank as usize - 1]);
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
        for (n, share) in (1..).zip(face.share) {
            line.members[line.count] = (target - n * face.side, share);
            line.count += 1;
        }
    }
    Some(line)
}

/// Velocity of a node near flat boundaries; none where matter is attached to none of them.
pub(crate) fn attached(
    faces: &[Face],
    index: [i32; 3],
    nodes: &impl Nodes,
    cell: f64,
) -> Option<Attached> {
    let near = |face: &Face| (0..=2).contains(&face.rank(index[face.axis]));
    if !faces.iter().any(near) {
        return None;
    }
    let raw = nodes.node(index)?.1;
    let mut found = Attached::free(raw);
    // Those that act on this node or on those that move as one with it.
    let mut all: All<'_> = [[None; 2]; 3];
    let mut count = 0;
    for face in faces {
        let of = &mut all[face.axis][usize::from(face.side > 0)];
        let is_in_reach = (-2..=4).contains(&face.rank(index[face.axis]));
        if of.is_none() && is_in_reach && face.acts(index, nodes, cell) {
            *of = Some(face);
            if near(face) {
                found.owners[count] = Some(face.owner);
                count += 1;
            }
        }
    }
    if count == 0 {
        return None;
    }
    let mut acting = all.iter().flatten().flatten();
    if let (Some(face), None) = (acting.next(), acting.next())
        && face.friction == 0.0
    {
        face.carry(&mut found.velocity, index, nodes);
        return Some(found);
    }
    for q in 0..3 {
        let mut gripping = all.iter().flatten().flatten();
        if let Some(face) = gripping.find(|face| face.grips[q] && near(face)) {
            let u = face.velocity[q];
            found.velocity[q] = u + component(&all, index, q, u, nodes).0;
        }
    }
    for face in all.iter().flatten().flatten() {
        if face.friction > 0.0 && (1..=2).contains(&face.rank(index[face.axis])) {
            let u = face.velocity[face.axis];
            let given = component(&all, index, face.axis, u, nodes).1;
            face.rub(
                &mut found.velocity,
                given * f64::from(face.side),
                index,
                nodes,
            );
        }
    }
    Some(found)
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
mod tests {
    use super::*;

    /// Nodes along the first axis, all alike across it.
    struct Row(Vec<(i32, f64, f64)>);

    impl Nodes for Row {
        fn node(&self, index: [i32; 3]) -> Option<(f64, [f64; 3])> {
            let found = self.0.iter().find(|(i, ..)| *i == index[0]);
            found.map(|&(_, m, v)| (m, [v, 0.5, 0.0]))
        }

        fn gap(&self, _: [i32; 3], _: usize) -> f64 {
            0.0
        }
    }

    fn wall(at: f64, side: i32, sticky: bool) -> Face {
        Face {
            grips: [true, sticky, sticky],
            ..Face::new(Owner::Body(0), 0, side, at, 1.0)
        }
    }

    #[test]
    fn what_moves_in_proportion_to_the_distance_stays_as_it_is() {
        for at in [-0.5, -0.3, 0.0, 0.2, 0.49, 0.5, 0.8] {
            for side in [1, -1] {
                let face = wall(at, side, false);
                let speed = |i: i32| 0.7 * (f64::from(i) - at);
                let nodes = (-4..=4).map(|i| (i, 1.0 + 0.1 * f64::from(i * i), speed(i)));
                let nodes = Row(nodes.collect());
                let mut seen = 0;
                for i in -4..=4 {
                    if let Some(found) = attached(&[face], [i, 0, 0], &nodes, 1.0) {
                        assert!((found.velocity[0] - speed(i)).abs() < 1e-12, "{at} {i}");
                        assert_eq!(found.velocity[1], 0.5);
                        seen += 1;
                    }
                }
                assert_eq!(seen, 3);
            }
        }
    }

    #[test]
    fn the_power_of_what_moves_as_one_is_kept_and_energy_never_grows() {
        let nodes = Row(vec![
            (-1, 0.2, 0.9),
            (0, 0.6, -0.4),
            (1, 1.0, 0.3),
            (2, 1.0, 0.1),
        ]);
        let face = wall(0.1, 1, false);
        let after = |i: i32| attached(&[face], [i, 0, 0], &nodes, 1.0);
        assert_eq!(after(2), None);
        let energy = |v: &dyn Fn(i32) -> f64| {
            let nodes = nodes.0.iter().filter(|(i, ..)| *i < 2);
            nodes.map(|&(i, m, _)| m * v(i).powi(2)).sum::<f64>()
        };
        let before = energy(&|i| nodes.node([i, 0, 0]).map_or(0.0, |(_, v)| v[0]));
        let now = energy(&|i| after(i).map_or(0.0, |found| found.velocity[0]));
        assert!(now < before, "{now} {before}");
        // A projection: what is taken away is orthogonal, by mass, to what is left.
        let power: f64 = nodes.0[..3]
            .iter()
            .map(|&(i, m, v)| {
                let left = after(i).map_or(v, |found| found.velocity[0]);
                m * left * (v - left)
            })
            .sum();
        assert!(power.abs() < 1e-15, "{power}");
    }

    #[test]
    fn a_slot_of_one_cell_holds_all_that_is_in_it() {
        let faces = [wall(0.0, 1, true), wall(1.0, -1, true)];
        let nodes = Row((-1..=2).map(|i| (i, 1.0, 2.0)).collect());
        for i in -1..=2 {
            let found = attached(&faces, [i, 0, 0], &nodes, 1.0).expect("both act");
            assert_eq!(found.velocity, [0.0; 3]);
        }
    }

    #[test]
    fn in_a_slot_of_two_cells_the_middle_is_free() {
        let faces = [wall(0.0, 1, false), wall(2.0, -1, false)];
        let nodes = Row((-1..=3).map(|i| (i, 1.0, 1.0)).collect());
        let at = |i| attached(&faces, [i, 0, 0], &nodes, 1.0).map(|found| found.velocity[0]);
        // 1 - 1 - 1 over 1 + 1 + 1: both mirrored nodes move against the middle one.
        let middle = -1.0 / 3.0;
        assert_eq!(at(1), Some(middle));
        assert_eq!([at(0), at(2)], [Some(0.0); 2]);
        assert_eq!([at(-1), at(3)], [Some(-middle); 2]);
    }

    #[test]
    fn a_line_that_is_pressed_loses_the_coefficient_times_what_presses_it() {
        let nodes = Row(vec![(-1, 0.2, -0.01), (0, 0.6, -0.02), (1, 1.0, -0.01)]);
        let face = Face {
            friction: 0.3,
            ..wall(0.0, 1, false)
        };
        let mut change = [0.0; 2];
        for &(i, m, v) in &nodes.0 {
            let found = attached(&[face], [i, 0, 0], &nodes, 1.0).expect("it touches");
            change[0] += m * (found.velocity[0] - v);
            change[1] += m * (found.velocity[1] - 0.5);
        }
        assert!(change[0] > 0.0);
        assert!((change[1] + 0.3 * change[0]).abs() < 1e-15, "{change:?}");
    }
}
