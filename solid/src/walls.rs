//! Walls that bind: slip and sticky colliders hold the points of a surface that have met them.
//!
//! After the forces of a substep, velocities change by as little kinetic energy as keeps those points on the wall at its end: a constraint
//! on positions, as SHAKE imposes it (Ryckaert, Ciccotti and Berendsen 1977), by conjugate gradients over the impulses at the points. It
//! does no work on what stays on the wall. Penalty in its place gave way like two cells of matter.

use std::collections::BTreeSet;

use super::{
    advance::Solid,
    bonds::{Bond, Borne, Walls},
    contact::ContactSurface,
    kernel::follow_again,
    model::Bears,
    nodes::{NODES, read, write},
};
use crate::{
    ledger::{ContactPartner, Ledger, Received},
    mat3::{dot, length},
};

/// Steps of conjugate gradients at most, and the share of the missing velocities at which they end.
const STEPS: usize = 40;
const DONE: f64 = 1e-4;
/// Largest way back to the wall in a substep [cells].
const RECOVERY: f64 = 0.05;

/// A bond while its impulse is sought.
struct Sought<'a> {
    bond: &'a Bond,
    borne: &'a Borne,
    /// Velocity relative to the wall before, and the one that is asked for [m/s].
    before: [f64; 3],
    asked: [f64; 3],
    /// Impulse on the point [N s].
    impulse: [f64; 3],
}

impl Solid<'_> {
    /// Keeps points on the walls that hold them, after forces have acted for `kick` [s] and nodes have moved for `drift` [s] of that.
    pub(crate) fn bind(
        &mut self,
        surface: &ContactSurface,
        [kick, drift]: [f64; 2],
        (object, ledger): (usize, &mut Ledger),
    ) {
        let mut walls = std::mem::take(&mut self.scratch.walls);
        if !walls.bonds.is_empty() && kick > 0.0 {
            self.prepare(surface, &mut walls);
            let Walls {
                bonds,
                borne,
                chosen,
                nodes,
                change,
                slope,
                ..
            } = &mut walls;
            let seek = |&n: &usize| {
                let bond = &bonds[n];
                self.sought(surface, bond, &borne[&bond.point], drift)
            };
            let mut all: Vec<Sought<'_>> = chosen.iter().map(seek).collect();
            self.hold(&mut all, nodes, [change, slope]);
            for one in &all {
                // Pulls count as pushes do.
                let along = dot(one.impulse, one.bond.normal);
                let received = Received {
                    impulse: one.impulse,
                    normal_impulse: one.bond.normal.map(|n| along * n),
                    weight: along.abs(),
                    moment: one.bond.x.map(|x| along.abs() * x),
                };
                ledger.add(
                    object,
                    ContactPartner::Collider(one.bond.collider),
                    &received,
                );
            }
            self.change(nodes, change, drift);
            self.settle(surface, bonds, drift);
        }
        self.scratch.walls = walls;
    }

    /// Notes how far points are now from where they stuck.
    fn settle(&mut self, surface: &ContactSurface, bonds: &[Bond], drift: f64) {
        for bond in bonds.iter().filter(|bond| !bond.slips) {
            let [_, v] = self.motion(surface, bond.point);
            let spring = &mut self.state.springs[bond.point];
            if spring.with == bond.collider as u32 {
                let v: [f64; 3] = std::array::from_fn(|a| v[a] - bond.wall[a]);
                let along = dot(v, bond.normal);
                spring.stretch = std::array::from_fn(|a| {
                    bond.stretch[a] + drift * (v[a] - along * bond.normal[a])
                });
            }
        }
    }

    /// Chooses the bonds that are asked for, one per cell of matter and wall, and finds what bears their points: the motion of a
    /// surface has one value per cell and axis, and more would say the same again.
    fn prepare(&self, surface: &ContactSurface, walls: &mut Walls) {
        let Walls {
            bonds,
            borne,
            latest,
            chosen,
            nodes,
            change,
            slope,
        } = walls;
        change.resize(self.model.mass.len(), [0.0; 3]);
        slope.resize(self.model.mass.len(), [0.0; 3]);
        let now = bonds.iter().map(|bond| (bond.point, bond.collider));
        if latest.iter().copied().eq(now.clone()) {
            return;
        }
        *latest = now.collect();
        chosen.clear();
        nodes.clear();
        let held: BTreeSet<usize> = self.scratch.held.iter().copied().collect();
        let mut taken = BTreeSet::new();
        for (n, &(point, collider)) in latest.iter().enumerate() {
            let at = &surface.points[point];
            let cell = at.x.map(|x| (x / self.model.dx).floor() as i64);
            if !taken.insert((collider, cell)) {
                continue;
            }
            let of_point = borne
                .entry(point)
                .or_insert_with(|| self.borne(&held, &at.bears));
            chosen.push(n);
            nodes.extend(of_point.nodes.iter().map(|node| node.0));
        }
        nodes.sort_unstable();
        nodes.dedup();
    }

    /// What bears a point of nodes that are free to move: outer ones that are held follow nobody.
    fn borne(&self, held: &BTreeSet<usize>, bears: &Bears) -> Borne {
        let is_held = |slot: u32| held.contains(&(slot as usize));
        let free = bears.map(|(slot, w)| (slot, if is_held(slot) { 0.0 } else { w }));
        let nodes = self.model.borne_by(&free).into_iter();
        let nodes = nodes.filter(|&(slot, w)| w != 0.0 && !is_held(slot));
        let nodes: Vec<_> = nodes.map(|(slot, w)| (slot, f64::from(w))).collect();
        let share = |&(slot, w): &(u32, f64)| w * w / self.model.mass[slot as usize];
        let inverse_mass: f64 = nodes.iter().map(share).sum();
        Borne {
            answer: if inverse_mass > 0.0 {
                1.0 / inverse_mass
            } else {
                0.0
            },
            nodes,
        }
    }

    fn sought<'a>(
        &self,
        surface: &ContactSurface,
        bond: &'a Bond,
        borne: &'a Borne,
        drift: f64,
    ) -> Sought<'a> {
        let [_, v] = self.motion(surface, bond.point);
        let most = RECOVERY * self.model.dx;
        let in_front = dot(bond.stretch, bond.normal);
        let mut back: [f64; 3] = std::array::from_fn(|a| {
            let across = match bond.slips {
                false => bond.stretch[a] - in_front * bond.normal[a],
                true => 0.0,
            };
            -across - (bond.gap - in_front) * bond.normal[a]
        });
        let size = length(back);
        if size > most {
            back = back.map(|x| x * most / size);
        }
        let asked = match drift > 0.0 {
            true => back.map(|x| x / drift),
            false => [0.0; 3],
        };
        Sought {
            bond,
            borne,
            before: std::array::from_fn(|a| v[a] - bond.wall[a]),
            asked,
            impulse: [0.0; 3],
        }
    }

    /// Gives all points the impulses that make their velocities those that are asked for; across walls they may slip.
    fn hold(
        &self,
        all: &mut [Sought<'_>],
        nodes: &[u32],
        [change, slope]: [&mut Vec<[f64; 3]>; 2],
    ) {
        let missing =
            |one: &Sought<'_>| one.bound(std::array::from_fn(|a| one.asked[a] - one.before[a]));
        let mut residual: Vec<[f64; 3]> = all.iter().map(missing).collect();
        let size_of = |all: &[Sought<'_>], r: &[[f64; 3]]| -> f64 {
            let shares = all.iter().zip(r);
            shares.map(|(one, r)| one.borne.answer * dot(*r, *r)).sum()
        };
        let first = size_of(all, &residual);
        let (mut size, mut share) = (first, 0.0);
        let mut along = vec![[0.0; 3]; all.len()];
        for _ in 0..STEPS {
            if size <= DONE * DONE * first {
                break;
            }
            for ((one, along), r) in all.iter().zip(&mut along).zip(&residual) {
                *along = std::array::from_fn(|a| one.borne.answer * r[a] + share * along[a]);
                one.borne.push(&self.model.mass, *along, slope);
            }
            let answers = all.iter().zip(&along).map(|(one, along)| {
                let v = one.bound(one.borne.velocity(slope));
                let slack = one.borne.slack();
                std::array::from_fn(|a| v[a] + slack * along[a])
            });
            let answers: Vec<[f64; 3]> = answers.collect();
            let curvature: f64 = along.iter().zip(&answers).map(|(p, q)| dot(*p, *q)).sum();
            let step = size / curvature;
            if !step.is_finite() || step <= 0.0 {
                nodes.iter().for_each(|&n| slope[n as usize] = [0.0; 3]);
                break;
            }
            for &n in nodes {
                let more = std::mem::take(&mut slope[n as usize]);
                for a in 0..3 {
                    change[n as usize][a] += step * more[a];
                }
            }
            for (n, one) in all.iter_mut().enumerate() {
                for a in 0..3 {
                    one.impulse[a] += step * along[n][a];
                    residual[n][a] -= step * answers[n][a];
                }
            }
            let next = size_of(all, &residual);
            (share, size) = (next / size, next);
        }
    }

    /// Changes velocities of nodes, which have moved with them for `drift` [s], and forgets the changes.
    fn change(&mut self, nodes: &[u32], change: &mut [[f64; 3]], drift: f64) {
        let (mut ways, dx) = (vec![0.0_f64; self.state.nodes.len()], self.model.dx);
        let tiles = &mut self.scratch.tiles;
        for &slot in nodes {
            let at = slot as usize;
            let more = std::mem::take(&mut change[at]).map(|v| v / dx);
            let block = &mut self.state.nodes[at / NODES];
            let (u, v) = (read(&block.u, at), read(&block.v, at));
            let u: [f32; 3] = std::array::from_fn(|a| u[a] + (drift * more[a]) as f32);
            let v: [f32; 3] = std::array::from_fn(|a| v[a] + more[a] as f32);
            write(&mut block.u, at, u);
            write(&mut block.v, at, v);
            let row = &mut tiles.rows[at].0;
            row[..3].copy_from_slice(&u);
            row[3..6].copy_from_slice(&v);
            let speed = &mut tiles.speeds[at / NODES];
            *speed = speed.max(v.iter().map(|v| v * v).sum::<f32>().sqrt());
            let way = &mut ways[at / NODES];
            *way = way.max(drift * dx * length(more));
        }
        follow_again(
            self.model,
            &self.scratch.conditions,
            &mut self.state.nodes,
            tiles,
        );
        self.scratch.search.move_on(ways.into_iter());
    }
}

impl Sought<'_> {
    /// The part of a vector that the wall decides on: all of it where nothing slips.
    fn bound(&self, v: [f64; 3]) -> [f64; 3] {
        match self.bond.slips {
            false => v,
            true => {
                let along = dot(v, self.bond.normal);
                self.bond.normal.map(|n| along * n)
            }
        }
    }
}
