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
    constrain::VelocityChange,
    face::{Face, HeldLine, NEAR, Nodes, Owner},
};

/// What boundaries along the axes made of a node.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Attached {
    /// Its velocity.
    pub velocity: [f64; 3],
    owners: [Option<Plane>; 6],
}

/// Whose face it is, and where.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Plane {
    owner: Owner,
    axis: usize,
    side: i32,
    /// Along the axis [cells].
    at: f64,
}

impl Plane {
    fn of(face: &Face) -> Self {
        Self {
            owner: face.owner,
            axis: face.axis,
            side: face.side,
            at: f64::from(face.target) - f64::from(face.side) * face.eta,
        }
    }
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
        found.owners[0] = Some(Plane::of(face));
        found
    }

    fn planes(&self) -> impl Iterator<Item = &Plane> {
        self.owners.iter().flatten()
    }

    /// Whether something is obeyed already.
    pub fn obeys(&self, owner: Owner) -> bool {
        self.planes().any(|plane| plane.owner == owner)
    }

    /// What colliders changed of a node that would have had the velocity `free`: each what is along its normal, and all the
    /// same part of what is across all of them. What held regions changed is left out.
    pub fn changes(
        &self,
        index: [i32; 3],
        free: [f64; 3],
        cell: f64,
    ) -> impl Iterator<Item = VelocityChange> {
        let change: [f64; 3] = std::array::from_fn(|q| self.velocity[q] - free[q]);
        let share = move |plane: &Plane, q: usize| {
            let along = self.planes().filter(|other| other.axis == q).count();
            match along {
                0 => 1.0 / self.planes().count() as f64,
                _ if plane.axis == q => 1.0 / along as f64,
                _ => 0.0,
            }
        };
        let planes = self.planes().filter(move |_| change != [0.0; 3]);
        planes.filter_map(move |plane| {
            let Owner::Body(collider) = plane.owner else {
                return None;
            };
            let (mut point, mut normal) = (index.map(|i| f64::from(i) * cell), [0.0; 3]);
            point[plane.axis] = plane.at * cell;
            normal[plane.axis] = f64::from(plane.side);
            Some(VelocityChange {
                collider,
                point,
                normal,
                change: std::array::from_fn(|q| share(plane, q) * change[q]),
            })
        })
    }
}

/// Per axis and side.
type All<'a> = [[Option<&'a Face>; 2]; 3];

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
                    found.owners[count] = Some(Plane::of(face));
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
                found.owners[count] = Some(Plane::of(face));
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
            friction: face.friction_part(&line, &carried, normal_impulse, frictional),
            across: None,
            carried,
        };
        face.apply_friction(
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
