//! Walls that bind: slip and sticky colliders hold the points of a surface that have met them, held regions those of a face in them.
//!
//! After the forces of a substep, velocities change by as little kinetic energy as keeps those points on the wall at its end: a constraint
//! on positions, as SHAKE imposes it (Ryckaert, Ciccotti and Berendsen 1977). The factor of its matrix lasts as long as the same points are
//! held in the same directions. It does no work on what stays on the wall. Penalty in its place gave way like two cells of matter.

use std::collections::{BTreeMap, BTreeSet};

use super::{
    advance::Solid,
    bonds::{Bond, Borne, Bound, Constraint, HeldFace, MovedBy, Patch, Walls},
    contact::ContactSurface,
    grip::{Grip, OBJECTS},
    kernel::follow_again,
    nodes::{Bears, NODES, read, write},
    skyline::Skyline,
};
use crate::{
    colliders::{Placed, turned},
    ledger::{ContactPartner, Ledger, Received},
    mat3::{dot, length},
    simd::Isa,
};

/// Share of its own answer that a patch gives way by: patches say the same where matter is one cell thick, and rounding lets them
/// contradict each other.
const SLACK: f64 = 1e-3;
/// Largest speed of the way back to where points met the wall, over that of sound: what crushes matter shortens substeps, not the way.
const RECOVERY: f64 = 0.05;

/// Walls where a substep begins.
pub(crate) struct WallsAt<'a> {
    /// All of them.
    pub placed: &'a [Placed<'a>],
    /// Instruction set of the kernels.
    pub isa: Isa,
    /// How long forces have acted, and nodes have moved after that [s].
    pub kick: f64,
    pub drift: f64,
}

impl<'a> WallsAt<'a> {
    /// The collider that a point is held by, if one does.
    fn wall(&self, with: u32) -> Option<&'a Placed<'a>> {
        self.placed.iter().find(|placed| placed.id == with as usize)
    }
}

impl Solid<'_> {
    /// Keeps points on the walls that hold them, after forces have acted and nodes have moved.
    pub(crate) fn bind(
        &mut self,
        surface: &ContactSurface,
        at: &WallsAt<'_>,
        (object, ledger): (usize, &mut Ledger),
    ) {
        let (mut walls, drift) = (std::mem::take(&mut self.scratch.walls), at.drift);
        let any = !walls.bonds.is_empty() || !self.scratch.search.bound.is_empty();
        if any && at.kick > 0.0 {
            self.join(surface, &mut walls);
            let Walls { bonds, patches, .. } = &mut walls;
            for bond in &mut *bonds {
                [_, bond.v] = self.motion(surface, bond.point);
                // Bonds were made where the substep before ended, if that was the last of a span.
                if let Some(wall) = at.wall(bond.with) {
                    (bond.wall, bond.spin) = (wall.velocity(bond.x), wall.spin());
                }
            }
            let mut turned = false;
            for patch in patches {
                let before = patch.normal;
                match patch.bonds.is_empty() {
                    true => self.ask_at_once(at, patch),
                    false => self.ask(bonds, patch, drift),
                }
                turned |= patch.normal != before;
            }
            if turned || walls.by_patch.is_empty() {
                walls.order(at.isa);
            }
            walls.hold(at.isa, self.model.mass.len());
            for one in &walls.patches {
                // Pulls count as pushes do.
                let along = dot(one.impulse, one.normal);
                let received = Received {
                    impulse: one.impulse,
                    normal_impulse: one.normal.map(|n| along * n),
                    weight: along.abs(),
                    moment: one.x.map(|x| along.abs() * x),
                };
                if one.with < OBJECTS {
                    let collider = ContactPartner::Collider(one.with as usize);
                    ledger.add(object, collider, &received);
                }
            }
            self.change(&mut walls, drift);
            self.settle(surface, &walls.bonds, drift);
        }
        self.scratch.walls = walls;
    }

    /// Binds points of the surface to regions that hold them, each where it is when that begins.
    pub(crate) fn hold_faces(&mut self, surface: &ContactSurface, faces: &[HeldFace<'_>]) {
        for face in faces {
            let with = Grip::on_region(face.region);
            for &point in face.points {
                let spring = &mut self.state.springs[point];
                if spring.with != with {
                    *spring = Grip { with, ..Grip::NONE };
                }
                let stretch = spring.stretch;
                let [x, v] = self.motion(surface, point);
                self.scratch.walls.bonds.push(Bond {
                    point,
                    with,
                    x,
                    v,
                    normal: [0.0; 3],
                    gap: 0.0,
                    wall: face.velocity,
                    spin: [0.0; 3],
                    slips: false,
                    stretch,
                });
            }
        }
    }

    /// Notes how far points are now from where they stuck.
    fn settle(&mut self, surface: &ContactSurface, bonds: &[Bond], drift: f64) {
        for bond in bonds.iter().filter(|bond| !bond.slips) {
            let [_, v] = self.motion(surface, bond.point);
            let spring = &mut self.state.springs[bond.point];
            if spring.with == bond.with {
                let v: [f64; 3] = std::array::from_fn(|a| v[a] - bond.wall[a]);
                let along = dot(v, bond.normal);
                let before = turned(bond.spin, drift, bond.stretch);
                spring.stretch =
                    std::array::from_fn(|a| before[a] + drift * (v[a] - along * bond.normal[a]));
            }
        }
    }

    /// Joins bonds to patches and finds what bears these, if they are not those of the substep before.
    fn join(&self, surface: &ContactSurface, walls: &mut Walls) {
        let Walls {
            bonds,
            borne,
            latest,
            patches,
            nodes,
            outer,
            by_patch,
            ..
        } = walls;
        let by_points = bonds.iter().map(|bond| Bound {
            point: bond.point,
            with: bond.with,
            in_front: 0.0,
        });
        let now = by_points.chain(self.scratch.search.bound.iter().copied());
        if latest.iter().copied().eq(now.clone()) {
            return;
        }
        *latest = now.collect();
        by_patch.clear();
        let held: BTreeSet<usize> = self.scratch.held.iter().copied().collect();
        // By place: what bears two of them has them near each other in the matrix, whichever walls they are at.
        let mut members: BTreeMap<_, Vec<(usize, f64)>> = BTreeMap::new();
        for (n, bound) in latest.iter().enumerate() {
            let at = &surface.points[bound.point];
            borne
                .entry(bound.point)
                .or_insert_with(|| self.moved_by(&held, &at.bears));
            let corners = self.model.corners_about(at.x);
            let area = at.area / corners.len() as f64;
            for corner in corners {
                let of_patch = members.entry((corner, bound.with)).or_default();
                of_patch.push((n, area));
            }
        }
        let mut before = std::mem::take(patches).into_iter().peekable();
        for ((corner, with), members) in members {
            let of_points = members.iter().map(|one| latest[one.0]);
            let points: Vec<Bound> = of_points.collect();
            while before.next_if(|p| p.place() < (corner, with)).is_some() {}
            let is_known = |p: &Patch| p.place() == (corner, with) && p.points == points;
            let mut patch = before.next_if(is_known).unwrap_or_else(|| {
                let shares = members.iter().map(|one| one.1);
                self.patch(surface, borne, corner, points, shares)
            });
            // Those of bonds come first, and a wall has one kind or the other.
            patch.slips = bonds.get(members[0].0).is_none_or(|bond| bond.slips);
            let of_bonds = members.into_iter().filter(|one| one.0 < bonds.len());
            patch.bonds = of_bonds.map(|(n, area)| (n, area / patch.area)).collect();
            patches.push(patch);
        }
        nodes.clear();
        let all = patches.iter().flat_map(|patch| &patch.answers);
        nodes.extend(all.map(|node| node.0));
        nodes.sort_unstable();
        nodes.dedup();
        *outer = self.model.extension.followers_of(nodes);
    }

    /// A patch about a corner of cells of points with areas [m^2] of theirs.
    fn patch(
        &self,
        surface: &ContactSurface,
        borne: &BTreeMap<usize, MovedBy>,
        corner: [i32; 3],
        points: Vec<Bound>,
        areas: impl Iterator<Item = f64> + Clone,
    ) -> Patch {
        let area: f64 = areas.clone().sum();
        let (mut free, mut others) = (BTreeMap::new(), BTreeMap::new());
        let (mut rest, mut in_front) = ([0.0; 3], 0.0);
        for (bound, own) in points.iter().zip(areas) {
            let (of, share) = (&borne[&bound.point], own / area);
            for (sums, own) in [(&mut free, &of.free), (&mut others, &of.others)] {
                for (slot, w) in own {
                    *sums.entry(*slot).or_default() += share * w;
                }
            }
            in_front += share * bound.in_front;
            let x = surface.points[bound.point].x;
            for a in 0..3 {
                rest[a] += share * x[a];
            }
        }
        let push = |(&slot, w): (&u32, &f64)| (slot, w / self.model.mass[slot as usize]);
        let pushed: Borne = free.iter().map(push).collect();
        Patch {
            corner,
            with: points[0].with,
            points,
            area,
            bonds: vec![],
            answers: self.answers(&pushed),
            pushed,
            borne: free.into_iter().collect(),
            others: others.into_iter().collect(),
            rest,
            in_front,
            slips: true,
            x: [0.0; 3],
            normal: [0.0; 3],
            missing: [0.0; 3],
            impulse: [0.0; 3],
        }
    }

    /// Velocities of free nodes with momenta over masses of some.
    fn answers(&self, pushed: &Borne) -> Borne {
        let w = &self.scratch.conditions.w;
        let mut answers: BTreeMap<u32, f64> = pushed.iter().copied().collect();
        let inverse = |n: usize| f64::from(w[n / NODES][n / 16 % 4].0[n % 16]);
        for &(slot, p) in pushed {
            let moved = self.model.off_diagonal.moved_by(slot as usize, inverse);
            for (node, inverse, shared) in moved {
                *answers.entry(node as u32).or_default() += inverse * shared * p;
            }
        }
        answers.into_iter().collect()
    }

    /// What moves a point: outer nodes that are held follow nobody.
    fn moved_by(&self, held: &BTreeSet<usize>, bears: &Bears) -> MovedBy {
        let is_held = |slot: u32| held.contains(&(slot as usize));
        let (mut free, mut others) = (BTreeMap::new(), MovedBy::default().others);
        for &(slot, w) in bears.iter().filter(|one| one.1 != 0.0) {
            if is_held(slot) {
                others.push((slot, f64::from(w)));
                continue;
            }
            for (inner, e) in self.model.extension.borne_by(slot) {
                let w = f64::from(w * e);
                // Nodes without mass bear nothing.
                match is_held(inner) || self.model.mass[inner as usize] <= 0.0 {
                    true => others.push((inner, w)),
                    false => *free.entry(inner).or_default() += w,
                }
            }
        }
        let free = free.into_iter().filter(|one| one.1 != 0.0).collect();
        MovedBy { free, others }
    }

    /// Asks a patch at a flat slip wall for what keeps it there: of the nodes that move it, not of its points.
    fn ask_at_once(&self, at: &WallsAt<'_>, patch: &mut Patch) {
        let rows = &self.scratch.tiles.rows;
        let mut sums = [0.0; 6];
        for &(slot, w) in patch.borne.iter().chain(&patch.others) {
            let row = &rows[slot as usize].0;
            for n in 0..6 {
                sums[n] += w * f64::from(row[n]);
            }
        }
        let (mut x, mut v) = (patch.rest, self.state.velocity);
        for a in 0..3 {
            v[a] += self.model.dx * sums[3 + a];
            // Where the substep began.
            x[a] += self.state.shift[a] + self.model.dx * sums[a] - at.drift * v[a];
        }
        patch.missing = [0.0; 3];
        let Some(wall) = at.wall(patch.with) else {
            return;
        };
        let found = wall.distance(x);
        let u = wall.velocity(x);
        let back = patch.in_front - found.value;
        let way_back = match at.drift > 0.0 {
            true => back.signum() * (back.abs() / at.drift).min(self.fastest_back()),
            false => 0.0,
        };
        (patch.x, patch.normal) = (x, found.normal);
        patch.missing = std::array::from_fn(|a| u[a] - v[a] + way_back * found.normal[a]);
    }

    /// Largest speed of the way back to where points met a wall [m/s].
    fn fastest_back(&self) -> f64 {
        RECOVERY * self.sound_at_rest()
    }

    /// Asks for what keeps the mean of a patch where it met the wall: across it and, where nothing slips, along it.
    fn ask(&self, bonds: &[Bond], patch: &mut Patch, drift: f64) {
        let [mut x, mut normal, mut missing, mut back] = [[0.0; 3]; 4];
        for (n, share) in &patch.bonds {
            let bond = &bonds[*n];
            let off = bond.off();
            for a in 0..3 {
                x[a] += share * bond.x[a];
                normal[a] += share * bond.normal[a];
                missing[a] += share * (bond.wall[a] - bond.v[a]);
                back[a] -= share * off[a];
            }
        }
        if drift > 0.0 {
            let share = drift.recip().min(self.fastest_back() / length(back));
            for a in 0..3 {
                missing[a] += share * back[a];
            }
        }
        let size = length(normal);
        patch.normal = match size > 0.0 {
            true => normal.map(|n| n / size),
            false => bonds[patch.bonds[0].0].normal,
        };
        (patch.x, patch.missing) = (x, missing);
    }

    /// Changes velocities of nodes, which have moved with them for `drift` [s], and forgets the changes.
    fn change(&mut self, walls: &mut Walls, drift: f64) {
        let dx = self.model.dx;
        walls.ways.clear();
        walls.ways.resize(self.state.nodes.len(), 0.0);
        let tiles = &mut self.scratch.tiles;
        for &slot in &walls.nodes {
            let at = slot as usize;
            let change = std::mem::take(&mut walls.change[at]);
            let [more, pushed] = change.map(|change| change.map(|v| v / dx));
            let block = &mut self.state.nodes[at / NODES];
            let [u, v, p] = [&block.u, &block.v, &block.p].map(|of| read(of, at));
            let u: [f32; 3] = std::array::from_fn(|a| u[a] + (drift * more[a]) as f32);
            let v: [f32; 3] = std::array::from_fn(|a| v[a] + more[a] as f32);
            let p: [f32; 3] = std::array::from_fn(|a| p[a] + pushed[a] as f32);
            write(&mut block.u, at, u);
            write(&mut block.v, at, v);
            write(&mut block.p, at, p);
            let row = &mut tiles.rows[at].0;
            row[..3].copy_from_slice(&u);
            row[3..6].copy_from_slice(&v);
            let speed = &mut tiles.speeds[at / NODES];
            *speed = speed.max(v.iter().map(|v| v * v).sum::<f32>().sqrt());
            let way = &mut walls.ways[at / NODES];
            *way = way.max(drift * dx * length(more));
        }
        follow_again(
            self.model,
            &self.scratch.conditions,
            &mut self.state.nodes,
            tiles,
            &walls.outer,
        );
        self.scratch.search.move_on(walls.ways.iter().copied());
    }
}

impl Walls {
    /// Finds the impulses on all patches that change their velocities by what is missing, and what they make of so many nodes.
    fn hold(&mut self, isa: Isa, nodes: usize) {
        self.change.resize(nodes, [[0.0; 3]; 2]);
        let missing = |(patch, along): &Constraint| {
            let patch: &Patch = &self.patches[*patch];
            match patch.borne.is_empty() {
                true => 0.0,
                false => dot(patch.missing, *along),
            }
        };
        self.sought.clear();
        self.sought.extend(self.rows.iter().map(missing));
        self.answers.solve(isa, &mut self.sought);
        for patch in &mut self.patches {
            patch.impulse = [0.0; 3];
        }
        for ((patch, along), size) in self.rows.iter().zip(&self.sought) {
            let patch = &mut self.patches[*patch];
            for a in 0..3 {
                patch.impulse[a] += size * along[a];
            }
        }
        for patch in &self.patches {
            for (n, shares) in [&patch.answers, &patch.pushed].into_iter().enumerate() {
                for &(slot, share) in shares {
                    let change = &mut self.change[slot as usize][n];
                    for a in 0..3 {
                        change[a] += share * patch.impulse[a];
                    }
                }
            }
        }
    }

    /// Velocities that impulses on patches give patches that are not before them, along the same direction: patch, the one that has the
    /// impulse, and velocity per impulse [1/kg].
    fn answers_of_patches(&self) -> Vec<(usize, usize, f64)> {
        let patches = self.patches.iter().enumerate();
        let borne = patches.flat_map(|(n, patch)| patch.borne.iter().map(move |b| (b.0, n, b.1)));
        let mut borne: Vec<(u32, usize, f64)> = borne.collect();
        borne.sort_by_key(|one| (one.0, one.1));
        let last = self.nodes.last().map_or(0, |slot| *slot as usize + 1);
        let mut starts = vec![0; last + 1];
        for (slot, _, _) in &borne {
            starts[*slot as usize + 1] += 1;
        }
        for n in 1..starts.len() {
            starts[n] += starts[n - 1];
        }
        let mut velocity = vec![0.0; self.patches.len()];
        let (mut met, mut all) = (vec![], vec![]);
        for (other, patch) in self.patches.iter().enumerate() {
            for &(slot, answer) in &patch.answers {
                let slot = slot as usize;
                for &(_, n, w) in &borne[starts[slot]..starts[slot + 1]] {
                    if n >= other {
                        if velocity[n] == 0.0 {
                            met.push(n);
                        }
                        velocity[n] += w * answer;
                    }
                }
            }
            for n in met.drain(..) {
                all.push((n, other, std::mem::take(&mut velocity[n])));
            }
        }
        all
    }

    /// Puts constraints in order and makes their matrix, if they are not those of the substep before.
    fn order(&mut self, isa: Isa) {
        let patches = self.patches.iter().enumerate();
        let rows = patches.flat_map(|(n, patch)| patch.directions().map(move |along| (n, along)));
        let is_same = |(row, known): (Constraint, &Constraint)| row == *known;
        let known = self.by_patch.len();
        if known == rows.clone().count() && rows.clone().zip(&self.by_patch).all(is_same) {
            return;
        }
        self.by_patch = rows.clone().collect();
        self.rows = rows.collect();
        // Where all directions are axes, impulses along one do nothing along another: those of each are a matrix of their own.
        let axis = |along: &[f64; 3]| along.iter().position(|x| x.abs() == 1.0);
        if self.rows.iter().all(|(_, along)| axis(along).is_some()) {
            self.rows.sort_by_key(|(n, along)| (axis(along), *n));
        }
        let rows = &self.rows;
        let given = self.answers_of_patches();
        let mut of_patch = vec![vec![]; self.patches.len()];
        for (row, (patch, _)) in rows.iter().enumerate() {
            of_patch[*patch].push(row);
        }
        let (of_patch, both) = (&of_patch, |a: usize, b: usize| dot(rows[a].1, rows[b].1));
        let pairs = given.iter().flat_map(|&(patch, other, answer)| {
            let rows = of_patch[patch].iter();
            rows.flat_map(move |&row| (of_patch[other].iter()).map(move |&c| (row, c, answer)))
        });
        let mut firsts: Vec<usize> = (0..rows.len()).collect();
        let below = |one: &(usize, usize, f64)| one.0 >= one.1 && both(one.0, one.1) != 0.0;
        for (row, column, _) in pairs.clone().filter(below) {
            firsts[row] = firsts[row].min(column);
        }
        let mut answers = Skyline::new(firsts.into_iter());
        for (row, column, answer) in pairs.filter(below) {
            *answers.entry(row, column) += answer * both(row, column);
        }
        for row in 0..rows.len() {
            let own = answers.entry(row, row);
            // Nothing that is free bears it.
            *own = if *own > 0.0 {
                (1.0 + SLACK) * *own
            } else {
                1.0
            };
        }
        answers.factorise(isa);
        self.answers = answers;
    }
}
