//! Nodes with little mass follow those amid matter: affine extension (extended B-splines, Höllig, Reif and Wipper 2001).
//!
//! With lumped masses a node that has next to none of a solid's matter moves freely: it takes an equal part of the energy, at hundreds of
//! metres per second, and motions of such nodes alone are spuriously slow. So an *outer* node is where the affine field through
//! *inner* nodes near it is, and what acts on it acts on those: `u_i = sum_j e_ij u_j`, `f_j += sum_i e_ij f_i`, `m_j += sum_i e_ij m_i`.
//! Constants and linear fields are reproduced, so that mass, centre of mass, momentum and angular momentum are exact.

use std::{collections::BTreeMap, ops::Range};

use super::nodes::{NODES, NodeBlock, NodeRow, Planes, node_at, place_in_cells, read, write};
use crate::{mat3::dot, simd::F32x16};

/// Share of the volume about a node amid matter below which a node is outer: densities say nothing of how much of a cell there is.
const LIGHT: f64 = 0.05;
/// Share below which a node goes with others even where no affine field through those is known.
const TINY: f64 = 0.01;
/// How far from an outer node inner ones are looked for along each axis, and how far if those are too few.
const REACHES: [i32; 2] = [2, 3];
/// Largest sum of magnitudes of weights that is looked no further for: two layers of a plane come to 3.
const SPREAD: f64 = 3.5;
/// Largest such sum of a node that follows.
const WILD: f64 = 8.0;
/// Least share of its own mass that an inner node keeps: weights may be negative.
const KEPT: f64 = 0.3;

/// Which nodes follow which.
#[derive(Clone, Debug, Default)]
pub struct Extension {
    /// Outer nodes by their numbers, ascending.
    pub outer: Vec<u32>,
    /// Per outer node its inner ones.
    rows: Vec<Range<u32>>,
    /// Number of the inner node, and weight.
    weights: Vec<(u32, f32)>,
    /// Per block of nodes, its outer nodes.
    pub outer_of: Vec<Range<u32>>,
    /// Per block of nodes, its inner nodes that others follow.
    inner_of: Vec<Range<u32>>,
    /// Such a node by its number, and what follows it.
    inner: Vec<(u32, Range<u32>)>,
    /// Place in the list of outer nodes, and weight.
    followers: Vec<(u32, f32)>,
}

/// Inner nodes of an outer one, with their weights.
type Row = Vec<(u32, f64)>;

impl Extension {
    /// Of nodes with these masses [kg], which become those of inner nodes; `filled` is how much matter there is about each, over that
    /// about a node amid matter. Blocks are at `places`, in lexicographic order.
    pub fn new(places: &[[i32; 3]], mass: &mut [f64], filled: &[f64]) -> Self {
        let is_light = |slot: &usize| filled[*slot] > 0.0 && filled[*slot] < LIGHT;
        let mut rows: BTreeMap<u32, Row> = (0..mass.len())
            .filter(is_light)
            .filter_map(|slot| {
                let row = row(places, filled, slot)?;
                Some((slot as u32, row))
            })
            .collect();
        // Who would take too much from an inner node stays as it is; those with most go first.
        let mut lumped = mass.to_vec();
        for (&slot, row) in &rows {
            for &(inner, e) in row {
                lumped[inner as usize] += e * mass[slot as usize];
            }
        }
        rows.retain(|&slot, row| {
            let bears = |&(inner, e): &(u32, f64)| {
                e >= 0.0 || lumped[inner as usize] >= KEPT * mass[inner as usize]
            };
            let all = row.iter().all(bears);
            if !all {
                for &(inner, e) in row.iter() {
                    lumped[inner as usize] -= e * mass[slot as usize];
                }
            }
            all
        });
        // What no affine field tells of, and has next to no mass, goes with those nearest to it.
        let left: Vec<usize> = (0..mass.len())
            .filter(|&slot| {
                filled[slot] > 0.0 && filled[slot] < TINY && !rows.contains_key(&(slot as u32))
            })
            .collect();
        for slot in left {
            let row = nearest(places, filled, slot);
            for &(inner, e) in &row {
                lumped[inner as usize] += e * mass[slot];
            }
            if !row.is_empty() {
                rows.insert(slot as u32, row);
            }
        }
        for &slot in rows.keys() {
            lumped[slot as usize] = 0.0;
        }
        mass.copy_from_slice(&lumped);
        Self::of_rows(places.len(), &rows)
    }

    fn of_rows(blocks: usize, rows: &BTreeMap<u32, Row>) -> Self {
        let mut out = Self::default();
        let mut followers: BTreeMap<u32, Vec<(u32, f32)>> = BTreeMap::new();
        for (n, (&slot, row)) in rows.iter().enumerate() {
            let start = out.weights.len() as u32;
            for &(inner, e) in row {
                out.weights.push((inner, e as f32));
                followers
                    .entry(inner)
                    .or_default()
                    .push((n as u32, e as f32));
            }
            out.outer.push(slot);
            out.rows.push(start..out.weights.len() as u32);
        }
        for (inner, list) in followers {
            let start = out.followers.len() as u32;
            out.followers.extend(list);
            out.inner.push((inner, start..out.followers.len() as u32));
        }
        let of_block = |slots: &[u32], block: usize| {
            let at = |block: usize| slots.partition_point(|&s| (s as usize) < NODES * block) as u32;
            at(block)..at(block + 1)
        };
        let inner: Vec<u32> = out.inner.iter().map(|one| one.0).collect();
        out.outer_of = (0..blocks).map(|b| of_block(&out.outer, b)).collect();
        out.inner_of = (0..blocks).map(|b| of_block(&inner, b)).collect();
        out
    }

    /// Inner nodes that bear what acts on a node, with weights: itself if it is one.
    pub fn borne_by(&self, slot: u32) -> impl Iterator<Item = (u32, f32)> + '_ {
        let Range { start, end } = self.outer_of[slot as usize / NODES];
        let found = self.outer[start as usize..end as usize].binary_search(&slot);
        let row = found.map_or(&[][..], |n| self.row(start as usize + n));
        let own = found.is_err().then_some((slot, 1.0));
        own.into_iter().chain(row.iter().copied())
    }

    fn row(&self, n: usize) -> &[(u32, f32)] {
        let Range { start, end } = self.rows[n];
        &self.weights[start as usize..end as usize]
    }

    /// Places in the list of outer nodes that follow some inner ones, ascending.
    pub fn followers_of(&self, inner: &[u32]) -> Vec<u32> {
        let known = |slot: &u32| self.inner.binary_search_by_key(slot, |one| one.0).ok();
        let lists = inner.iter().filter_map(known).map(|at| {
            let Range { start, end } = self.inner[at].1;
            &self.followers[start as usize..end as usize]
        });
        let mut all: Vec<u32> = lists.flatten().map(|follower| follower.0).collect();
        all.sort_unstable();
        all.dedup();
        all
    }

    /// Displacement and velocity of the outer node `n` of the list.
    #[inline(always)]
    pub fn follow(&self, n: usize, rows: &[NodeRow]) -> NodeRow {
        NodeRow(NodeRow::sum(rows, self.row(n)))
    }

    /// Puts outer nodes where they belong.
    pub fn follow_displacements(&self, nodes: &mut [NodeBlock]) {
        self.follow_rows(nodes, &NodeRow::of(nodes));
    }

    /// The same where nodes are known one by one.
    pub fn follow_rows(&self, nodes: &mut [NodeBlock], rows: &[NodeRow]) {
        for (n, &slot) in self.outer.iter().enumerate() {
            let [x, y, z, ..] = self.follow(n, rows).0;
            write(
                &mut nodes[slot as usize / NODES].u,
                slot as usize,
                [x, y, z],
            );
        }
    }

    /// Gives outer nodes the velocities that they follow with.
    pub fn follow_velocities(&self, nodes: &mut [NodeBlock]) {
        let rows = NodeRow::of(nodes);
        for (n, &slot) in self.outer.iter().enumerate() {
            let [.., x, y, z, _, _] = self.follow(n, &rows).0;
            write(
                &mut nodes[slot as usize / NODES].v,
                slot as usize,
                [x, y, z],
            );
        }
    }

    /// Adds what inner nodes of a block bear by the magnitudes of weights of the first number of outer ones, by their place in the list.
    pub fn gather_magnitudes(&self, block: usize, of_outer: &[[f32; 4]], out: &mut Plane) {
        let Range { start, end } = self.inner_of[block];
        for (slot, followers) in &self.inner[start as usize..end as usize] {
            let own = &mut out[*slot as usize / 16 % 4].0[*slot as usize % 16];
            for &(n, e) in &self.followers[followers.start as usize..followers.end as usize] {
                *own += e.abs() * of_outer[n as usize][0];
            }
        }
    }

    /// Adds what inner nodes of a block bear of forces on outer ones, by their place in the list.
    pub fn gather(&self, block: usize, forces: &[[f32; 4]], out: &mut Planes) {
        let Range { start, end } = self.inner_of[block];
        for (slot, followers) in &self.inner[start as usize..end as usize] {
            let mut sum = [0.0; 4];
            for &(n, e) in &self.followers[followers.start as usize..followers.end as usize] {
                let force = &forces[n as usize];
                for a in 0..4 {
                    sum[a] += e * force[a];
                }
            }
            let slot = *slot as usize;
            let own = read(out, slot);
            write(out, slot, std::array::from_fn(|a| own[a] + sum[a]));
        }
    }
}

/// One number per node of a block.
type Plane = [F32x16; 4];

/// The inner nodes nearest to an outer one, all with the same weight; none where there are none.
fn nearest(places: &[[i32; 3]], filled: &[f64], slot: usize) -> Row {
    let [_, reach] = REACHES;
    let near = inner_near(places, filled, (slot, reach));
    let least = near.first().map_or(0, |one| one.0);
    let count = near.iter().take_while(|one| one.0 == least).count();
    let weight = 1.0 / count as f64;
    near[..count].iter().map(|one| (one.1, weight)).collect()
}

/// The inner nodes that an outer one follows: as few as determine an affine field well. None where there are none.
fn row(places: &[[i32; 3]], filled: &[f64], slot: usize) -> Option<Row> {
    let rows = REACHES.iter().filter_map(|&reach| {
        let near = inner_near(places, filled, (slot, reach));
        fewest(&near)
    });
    let mut best: Option<(f64, Row)> = None;
    for (spread, row) in rows {
        if best.as_ref().is_none_or(|(least, _)| spread < *least) {
            best = Some((spread, row));
        }
        if spread <= SPREAD {
            break;
        }
    }
    best.filter(|(spread, _)| *spread <= WILD)
        .map(|(_, row)| row)
}

/// A node near another: squared distance [cells^2], number, how filled it is, and place from there [cells].
type InnerNode = (i32, u32, f64, [f64; 3]);

/// Weights of as few of some nodes as determine an affine field well, nearest first, with the sum of their magnitudes.
fn fewest(near: &[InnerNode]) -> Option<(f64, Row)> {
    let mut best: Option<(f64, Row)> = None;
    let mut count = 0;
    while count < near.len() {
        // Nodes as far away come together, so that what is symmetric stays so.
        let distance = near[count].0;
        count += near[count..].iter().take_while(|n| n.0 == distance).count();
        let Some(weights) = affine(&near[..count]) else {
            continue;
        };
        let spread: f64 = weights.iter().map(|w| w.1.abs()).sum();
        if best.as_ref().is_none_or(|(least, _)| spread < *least) {
            best = Some((spread, weights));
        }
        if spread <= SPREAD {
            break;
        }
    }
    best
}

/// Inner nodes about a node, so far along each axis, nearest first.
fn inner_near(places: &[[i32; 3]], filled: &[f64], (slot, reach): (usize, i32)) -> Vec<InnerNode> {
    let at = place_in_cells(places, slot);
    let mut near = vec![];
    let side = 2 * reach + 1;
    for n in 0..side.pow(3) {
        let o = [n / side.pow(2), n / side % side, n % side].map(|o| o - reach);
        let there: [i32; 3] = std::array::from_fn(|a| at[a] + o[a]);
        let Some(other) = node_at(places, there) else {
            continue;
        };
        if filled[other] >= LIGHT {
            let squared: i32 = o.iter().map(|o| o * o).sum();
            near.push((squared, other as u32, filled[other], o.map(f64::from)));
        }
    }
    near.sort_by_key(|one| (one.0, one.1));
    near
}

/// Weights of nodes that reproduce affine fields at the origin, smallest in sum of squares over how filled they are; none where they do not
/// determine one.
fn affine(nodes: &[InnerNode]) -> Option<Row> {
    if nodes.len() < 4 {
        return None;
    }
    let weigh = |filled: f64, squared: i32| filled / f64::from(squared * squared);
    let mut m = [[0.0; 4]; 4];
    for &(squared, _, filled, r) in nodes {
        let p = [1.0, r[0], r[1], r[2]];
        for i in 0..4 {
            for j in 0..4 {
                m[i][j] += weigh(filled, squared) * p[i] * p[j];
            }
        }
    }
    let c = solve(m, [1.0, 0.0, 0.0, 0.0])?;
    let weights = nodes.iter().map(|&(squared, slot, filled, r)| {
        let factor = c[0] + dot([c[1], c[2], c[3]], r);
        (slot, weigh(filled, squared) * factor)
    });
    Some(weights.filter(|(_, e)| e.abs() > 1e-6).collect())
}

/// Solves four equations by elimination; none where they are singular.
fn solve(mut m: [[f64; 4]; 4], mut b: [f64; 4]) -> Option<[f64; 4]> {
    let scale = m[0][0];
    for i in 0..4 {
        let pivot = (i..4).max_by(|&p, &q| m[p][i].abs().total_cmp(&m[q][i].abs()))?;
        m.swap(i, pivot);
        b.swap(i, pivot);
        if m[i][i].abs() <= 1e-6 * scale {
            return None;
        }
        for row in i + 1..4 {
            let factor = m[row][i] / m[i][i];
            for column in i..4 {
                m[row][column] -= factor * m[i][column];
            }
            b[row] -= factor * b[i];
        }
    }
    for i in (0..4).rev() {
        let known: f64 = (i + 1..4).map(|j| m[i][j] * b[j]).sum();
        b[i] = (b[i] - known) / m[i][i];
    }
    Some(b)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        model::{SolidModel, cell_of_number, gauss_point},
        tests::{DENSITY, ball, lattice},
    };

    #[test]
    fn outer_nodes_follow_linear_fields_and_keep_mass_and_centre() {
        let seeds = [
            ball(0.1, [0.02, 0.01, -0.03], 0.33),
            lattice(0.1, [0.0; 3], [5, 2, 1], |_| true),
        ];
        for seeds in seeds {
            let model = SolidModel::new(0.1, &seeds);
            let extension = &model.extension;
            assert!(!extension.outer.is_empty());
            let mut nodes = vec![NodeBlock::REST; model.node_blocks.len()];
            let field = |slot: usize| -> [f32; 3] {
                let [x, y, z] = model.node_position(slot);
                [0.3 * y - 0.1 * z + 1.0, 0.2 * x, z - 0.7 * x].map(|u| u as f32)
            };
            for slot in model.nodes() {
                if model.mass[slot] > 0.0 {
                    write(&mut nodes[slot / NODES].v, slot, field(slot));
                }
            }
            extension.follow_velocities(&mut nodes);
            for &slot in &extension.outer {
                let slot = slot as usize;
                assert_eq!(model.mass[slot], 0.0);
                let (v, exact) = (read(&nodes[slot / NODES].v, slot), field(slot));
                for a in 0..3 {
                    // Single precision of a few cells.
                    assert!((v[a] - exact[a]).abs() < 1e-5, "{v:?} {exact:?}");
                }
            }
            // None is so light any more that it may fly.
            let inner = model.mass.iter().filter(|&&mass| mass > 0.0);
            let least = inner.fold(f64::INFINITY, |least, &mass| least.min(mass));
            assert!(least > KEPT * LIGHT * DENSITY * model.dx.powi(3));
            // Mass and its moment are those of the quadrature points.
            let mut points = [0.0; 4];
            for block in &model.point_blocks {
                let place = model.node_blocks[block.nodes[0] as usize];
                for cell in &model.cells[block.cells.clone()] {
                    let local = cell_of_number(cell.number);
                    for (n, volume) in cell.volumes.into_iter().enumerate() {
                        let mass = f64::from(volume) * DENSITY * model.dx.powi(3);
                        points[3] += mass;
                        for a in 0..3 {
                            let at = f64::from(4 * place[a]) + local[a] as f64 + 1.0;
                            points[a] += mass * (at + gauss_point(n)[a]);
                        }
                    }
                }
            }
            let mass: f64 = model.mass.iter().sum();
            assert!((mass / points[3] - 1.0).abs() < 1e-6);
            for a in 0..3 {
                let of_nodes: f64 = model
                    .nodes()
                    .map(|n| model.mass[n] * model.node_position(n)[a])
                    .sum();
                assert!((of_nodes - points[a]).abs() < 1e-6 * mass);
            }
        }
    }

    #[test]
    fn who_follows_is_told_by_volume_and_not_by_density() {
        let alike = lattice(0.1, [0.0; 3], [10, 2, 2], |_| true);
        let mut heavy = alike.clone();
        for seed in heavy.iter_mut().filter(|seed| seed.position[0] > 0.9) {
            seed.density *= 300.0;
        }
        let [alike, heavy] = [&alike, &heavy].map(|seeds| SolidModel::new(0.1, seeds));
        assert_eq!(heavy.extension.outer, alike.extension.outer);
        // Nodes without heavy matter about them, or about what follows them, have the mass that they have without it.
        let far = |&slot: &usize| heavy.node_position(slot)[0] < 5.5;
        for slot in alike.nodes().filter(far) {
            let [with, without] = [&heavy, &alike].map(|model| model.mass[slot]);
            assert!((with - without).abs() <= 1e-9 * without, "{with} {without}");
        }
    }
}
