//! Mass between nodes: what lumping takes for mass of the nodes themselves.
//!
//! Weights of quadratic B-splines about any place have a second moment that is a quarter of a squared cell more than that of the place:
//! `sum_i N_i(x) x_i^2 = x^2 + h^2 / 4`. Lumped masses give matter that much more of it along every axis, so that solids resist
//! turning by too much (1.19 times at four cells across, 1.75 at two), and waves are too slow by `(k h)^2 / 8`. The excess of the energy
//! of motion is `v^T C v / 2` with `v^T C v = sum_e k_e (v_i - v_j)^2` over pairs of nodes two cells apart along an axis, the outer two of the
//! three about every place: `4 k_e = m / 4` of what is there.
//!
//! The mass matrix is `M - C` then, with `M` the lumped one, and its inverse is taken for `W + W C' W`, `W = M^-1`: positive whatever `C'`
//! is. `C'` has the pairs of `C`, some near the surface more of it, so that linear fields along an axis have the momenta `(M - C) v` but for
//! what goes on along the others. What forces change is the momentum of nodes, `M p`; nodes move with `v = p + W C' p`.
//! So `sum m p` and `sum m x cross p` are conserved to round-off, and the energy of motion is `sum m p . v / 2`.
//!
//! Waves of eight cells are then too slow by 0.13 % in place of 1.9 %, and substeps 0.76 to 0.9 as long. Pairs of neighbours would
//! leave half of that error, and substeps of 0.72.

use super::nodes::{NODES, Planes, node_at, place_in_cells, read};
use crate::{mat3::dot, simd::F32x16};

/// Mass between the outer two of the three nodes of a place along an axis, over that of the place: `4 k = m / 4`.
pub(super) const SHARE: f64 = 0.0625;
/// No block.
const NONE: u32 = u32::MAX;
/// Least share of the heavier node's matter that the lighter one of a pair has if all of its mass stays there: light nodes would be what
/// moves fastest.
const LIGHTER: f64 = 0.6;
/// Largest factor of the mass of a pair near the surface.
const MORE: f64 = 2.0;
/// Largest mass that a node has together with others over its own, twice that amid matter: what is cut raggedly would have substeps half
/// as long.
const HEAVIEST: f64 = 0.75;
/// How far from a pair others are looked for that take over what it has too much of [cells].
const REACH: i32 = 2;
/// Residual that ends iterations, over the velocities asked for, and how many there are at most: each gains a digit and a half.
const ITERATIONS: (f64, usize) = (1e-9, 40);

/// Mass between the nodes of a solid that are two cells apart along an axis.
#[derive(Clone, Debug, Default)]
pub struct OffDiagonalMass {
    /// Per block of nodes and axis, `k_e` of every node and the one two cells behind it over the cell size [kg/m].
    pub pairs: Vec<Planes>,
    /// Blocks before and behind every block along x, y and z.
    around: Vec<[u32; 6]>,
}

/// The node two cells from another along an axis, before or behind it: whether that is in the next block, and its number there.
fn beyond(slot: usize, axis: usize, behind: bool) -> (bool, usize) {
    let stride = [16, 1, 4][axis];
    let (at, two) = (slot / stride % 4, 2 * stride);
    match behind {
        true if at >= 2 => (true, slot - two),
        true => (false, slot + two),
        false if at < 2 => (true, slot + two),
        false => (false, slot - two),
    }
}

impl OffDiagonalMass {
    /// Of nodes with these masses [kg], 0 of those that follow others; `along` are the masses between each and that two cells behind it along
    /// each axis [kg], and `filled` tells how much matter there is about each. Blocks are at `places`, in lexicographic order, with cells of
    /// `dx` [m].
    pub fn new(
        places: &[[i32; 3]],
        along: &[Vec<f64>; 3],
        (mass, filled): (&[f64], &[f64]),
        dx: f64,
    ) -> Self {
        let find = |at: [i32; 3]| places.binary_search(&at).map_or(NONE, |n| n as u32);
        let around = places.iter().map(|&at| {
            std::array::from_fn(|n| {
                let mut at = at;
                at[n / 2] += if n % 2 == 0 { -1 } else { 1 };
                find(at)
            })
        });
        let mut out = Self {
            pairs: vec![[[F32x16::ZERO; 4]; 3]; places.len()],
            around: around.collect(),
        };
        let around = within_reach();
        let settled = [0, 1, 2].map(|axis| {
            let nodes = PairsAlong {
                places,
                axis,
                mass,
                filled,
                between: &out,
                around: &around,
            };
            let mut settled = nodes.settle(&along[axis]);
            nodes.make_exact(&mut settled);
            settled
        });
        let ends = |slot: usize, axis: usize| {
            let other = out.next(slot, axis, true).unwrap_or(slot);
            [slot, other]
        };
        let mut heavy = vec![0.0; mass.len()];
        for (axis, pairs) in settled.iter().enumerate() {
            for (slot, pair) in pairs.iter().enumerate().filter(|one| *one.1 > 0.0) {
                for end in ends(slot, axis) {
                    heavy[end] += pair / mass[end];
                }
            }
        }
        let mut pairs = out.pairs.clone();
        for (axis, settled) in settled.into_iter().enumerate() {
            for (slot, pair) in settled.into_iter().enumerate().filter(|one| one.1 > 0.0) {
                let most = ends(slot, axis)
                    .map(|end| heavy[end])
                    .into_iter()
                    .fold(HEAVIEST, f64::max);
                let pair = pair * HEAVIEST / most;
                pairs[slot / NODES][axis][slot / 16 % 4].0[slot % 16] = (pair / dx) as f32;
            }
        }
        out.pairs = pairs;
        out
    }

    /// The node two cells from another along an axis.
    fn next(&self, slot: usize, axis: usize, behind: bool) -> Option<usize> {
        let (leaves, number) = beyond(slot % NODES, axis, behind);
        let block = match leaves {
            true => self.around[slot / NODES][2 * axis + usize::from(behind)],
            false => (slot / NODES) as u32,
        };
        (block != NONE).then(|| NODES * block as usize + number)
    }

    /// Blocks of nodes around one, before and behind it along x, y and z.
    #[inline(always)]
    pub fn around(&self, block: usize) -> [Option<usize>; 6] {
        self.around[block].map(|n| (n != NONE).then_some(n as usize))
    }

    /// Nodes that have mass together with one, and that over the cell size [kg/m].
    pub fn beside(&self, slot: usize) -> impl Iterator<Item = (usize, f64)> + '_ {
        (0..6).filter_map(move |n| {
            let (axis, behind) = (n / 2, n % 2 == 1);
            let other = self.next(slot, axis, behind)?;
            let first = if behind { slot } else { other };
            let pair = read(&self.pairs[first / NODES], first)[axis];
            (pair > 0.0).then_some((other, f64::from(pair)))
        })
    }

    /// What the momentum of a node adds to velocities by the mass that it has together with others: the nodes that move by it, this one and the
    /// other of every pair, each with one over its mass, negative for the other, and the mass of the pair over the cell size [kg/m]. `inverse` is
    /// one over the mass of a node.
    pub fn moved_by<'a>(
        &'a self,
        slot: usize,
        inverse: impl Fn(usize) -> f64 + 'a,
    ) -> impl Iterator<Item = (usize, f64, f64)> + 'a {
        let beside = self.beside(slot);
        beside.flat_map(move |(other, shared)| {
            let moved = [
                (slot, inverse(slot), shared),
                (other, -inverse(other), shared),
            ];
            moved.into_iter().filter(|one| one.1 != 0.0)
        })
    }

    /// `p + W C p` of all nodes, with the masses of nodes over the cell size [kg/m].
    fn velocities(&self, weights: &[f64], p: &[[f64; 3]]) -> Vec<[f64; 3]> {
        let mut v = p.to_vec();
        for (slot, own) in p.iter().enumerate() {
            for axis in 0..3 {
                let pair = f64::from(read(&self.pairs[slot / NODES], slot)[axis]);
                if pair == 0.0 {
                    continue;
                }
                let Some(other) = self.next(slot, axis, true) else {
                    continue;
                };
                for a in 0..3 {
                    let change = pair * (own[a] - p[other][a]);
                    v[slot][a] += change / weights[slot];
                    v[other][a] -= change / weights[other];
                }
            }
        }
        v
    }

    /// Momenta over masses [kg], with cells of `dx` [m], that come to some velocities of all nodes: by conjugate gradients.
    pub fn momenta(&self, mass: &[f64], dx: f64, velocities: Vec<[f64; 3]>) -> Vec<[f64; 3]> {
        let weights: Vec<f64> = mass.iter().map(|m| m / dx).collect();
        let product = |a: &[[f64; 3]], b: &[[f64; 3]]| -> f64 {
            let nodes = weights.iter().zip(a).zip(b);
            nodes.map(|((w, a), b)| w * dot(*a, *b)).sum()
        };
        let mut p = velocities;
        // What forces leave alone anyway, that of all nodes in common, is no part of the residual.
        let mut residual = self.velocities(&weights, &p);
        for (residual, v) in residual.iter_mut().zip(&p) {
            *residual = std::array::from_fn(|a| v[a] - residual[a]);
        }
        let goal = ITERATIONS.0.powi(2) * product(&p, &p);
        let mut direction = residual.clone();
        let mut left = product(&residual, &residual);
        for _ in 0..ITERATIONS.1 {
            if left <= goal {
                break;
            }
            let image = self.velocities(&weights, &direction);
            let step = left / product(&direction, &image);
            for (n, p) in p.iter_mut().enumerate() {
                for a in 0..3 {
                    p[a] += step * direction[n][a];
                    residual[n][a] -= step * image[n][a];
                }
            }
            let before = std::mem::replace(&mut left, product(&residual, &residual));
            for (direction, residual) in direction.iter_mut().zip(&residual) {
                *direction = std::array::from_fn(|a| residual[a] + left / before * direction[a]);
            }
        }
        p
    }
}

/// Pairs along an axis.
struct PairsAlong<'a> {
    places: &'a [[i32; 3]],
    axis: usize,
    mass: &'a [f64],
    filled: &'a [f64],
    between: &'a OffDiagonalMass,
    /// Places within reach, nearest first, with their squared distances.
    around: &'a [(i32, [i32; 3])],
}

impl PairsAlong<'_> {
    /// Share of what a pair has that may stay there; 0 where one of its nodes follows others.
    fn bearable(&self, slot: usize) -> f64 {
        let Some(other) = self.between.next(slot, self.axis, true) else {
            return 0.0;
        };
        if self.mass[slot] <= 0.0 || self.mass[other] <= 0.0 {
            return 0.0;
        }
        let [a, b] = [slot, other].map(|n| self.filled[n]);
        (a.min(b) / (LIGHTER * a.max(b))).min(1.0)
    }

    /// Gives pairs near those that cannot bear what they have the rest of it; what no pair near can take is left out.
    fn settle(&self, along: &[f64]) -> Vec<f64> {
        let mut settled = vec![0.0; along.len()];
        for (slot, &pair) in along.iter().enumerate().filter(|one| *one.1 > 0.0) {
            let share = self.bearable(slot);
            let takers = match share < 1.0 {
                true => self.takers(slot),
                false => vec![],
            };
            let stays = if takers.is_empty() {
                f64::from(share > 0.0)
            } else {
                share
            };
            settled[slot] += stays * pair;
            for &taker in &takers {
                settled[taker] += (1.0 - share) * pair / takers.len() as f64;
            }
        }
        settled
    }

    /// Makes pairs such that `(1 + W C') (1 - W C) x = x` for the place `x` of nodes along the axis.
    fn make_exact(&self, pairs: &mut [f64]) {
        // `W C x`: what a pair gives its nodes is that over their masses.
        let mut excess = vec![0.0; pairs.len()];
        let is_any = |one: &(usize, &f64)| *one.1 > 0.0;
        for (slot, pair) in pairs.iter().enumerate().filter(is_any) {
            excess[slot] -= 2.0 * pair / self.mass[slot];
            if let Some(other) = self.between.next(slot, self.axis, true) {
                excess[other] += 2.0 * pair / self.mass[other];
            }
        }
        for (slot, pair) in pairs.iter_mut().enumerate().filter(|one| *one.1 > 0.0) {
            if let Some(other) = self.between.next(slot, self.axis, true) {
                let left = 1.0 - 0.5 * (excess[other] - excess[slot]);
                *pair /= left.clamp(MORE.recip(), MORE);
            }
        }
    }

    /// The nearest pairs that bear all that they have.
    fn takers(&self, slot: usize) -> Vec<usize> {
        let at = place_in_cells(self.places, slot);
        let mut found: Vec<usize> = vec![];
        let mut nearest = i32::MAX;
        for &(squared, o) in self.around {
            if squared > nearest {
                break;
            }
            let there = std::array::from_fn(|a| at[a] + o[a]);
            let taker = node_at(self.places, there).filter(|&n| self.bearable(n) == 1.0);
            if let Some(taker) = taker {
                nearest = squared;
                found.push(taker);
            }
        }
        found
    }
}

/// Places within reach but the middle, nearest first, with their squared distances.
fn within_reach() -> Vec<(i32, [i32; 3])> {
    let side = 2 * REACH + 1;
    let all = (0..side.pow(3)).map(|n| {
        let o = [n / side.pow(2), n / side % side, n % side].map(|o| o - REACH);
        (o.iter().map(|o| o * o).sum(), o)
    });
    let mut all: Vec<_> = all.filter(|one| one.0 > 0).collect();
    all.sort_unstable();
    all
}

#[cfg(test)]
mod tests {
    use crate::{
        model::{SolidModel, gauss_point},
        tests::{DENSITY, ball, lattice},
    };

    /// A box, a ball whose light nodes follow others, and a plate of one layer of cells.
    fn models() -> [SolidModel; 3] {
        [
            SolidModel::new(0.1, &lattice(0.1, [0.3, 0.0, -0.2], [5, 4, 3], |_| true)),
            SolidModel::new(0.1, &ball(0.1, [0.01, 0.02, 0.03], 0.33)),
            SolidModel::new(0.1, &lattice(0.1, [0.0; 3], [6, 6, 1], |_| true)),
        ]
    }

    /// Second moment along an axis about the origin of the grid, and that of motion along the axis that grows with the place [kg cells^2].
    fn second_moments(model: &SolidModel, axis: usize) -> [f64; 2] {
        let mut exact = 0.0;
        for block in &model.point_blocks {
            let first = model.node_blocks[block.nodes[0] as usize];
            for cell in &model.cells[block.cells.clone()] {
                let number = usize::from(cell.number);
                let inside = [number / 16, number / 4 % 4, number % 4];
                for (n, &volume) in cell.volumes.iter().enumerate() {
                    let x = f64::from(4 * first[axis]) + inside[axis] as f64 + 1.0;
                    let mass = f64::from(volume) * DENSITY * model.dx.powi(3);
                    exact += mass * (x + gauss_point(n)[axis]).powi(2);
                }
            }
        }
        let mass = model.total_mass;
        let places = (0..model.mass.len()).map(|n| model.node_position(n));
        let places = places
            .zip(&model.mass)
            .map(|(x, m)| if *m > 0.0 { x } else { [0.0; 3] });
        let places: Vec<_> = places.collect();
        let momenta = (model.off_diagonal).momenta(&model.mass, model.dx, places.clone());
        let nodes = model.mass.iter().zip(&places).zip(&momenta);
        let found = nodes.map(|((m, x), p)| m * x[axis] * p[axis]).sum::<f64>();
        let moment: f64 = model
            .mass
            .iter()
            .zip(&places)
            .map(|(m, x)| m * x[axis])
            .sum();
        [exact, found].map(|second| second - moment * moment / mass)
    }

    #[test]
    fn second_moments_are_those_of_matter() {
        for (n, model) in models().iter().enumerate() {
            for axis in 0..3 {
                let [exact, found] = second_moments(model, axis);
                // Pairs along the other axes, of which the excess at the surface knows nothing, leave 0.01 at most; without mass between nodes
                // it is 0.12 in a ball, and 0.33 across three cells. One layer of cells has hardly any to give.
                let most = if (n, axis) == (2, 2) { 1.0 } else { 0.012 };
                let off = (found / exact - 1.0).abs();
                assert!(off < most, "{n} {axis}: {off}");
            }
        }
    }

    #[test]
    fn momenta_are_those_of_their_velocities() {
        for model in models() {
            let wave = |n: usize| {
                let [x, y, z] = model.node_position(n);
                [(x + 0.3 * y).sin(), x - y * z, 0.4 * z]
            };
            let velocity = |n: usize| {
                if model.mass[n] > 0.0 {
                    wave(n)
                } else {
                    [0.0; 3]
                }
            };
            let velocities: Vec<_> = (0..model.mass.len()).map(velocity).collect();
            let between = &model.off_diagonal;
            let momenta = between.momenta(&model.mass, model.dx, velocities.clone());
            let weights: Vec<f64> = model.mass.iter().map(|m| m / model.dx).collect();
            let back = between.velocities(&weights, &momenta);
            let far = (back.iter().zip(&velocities))
                .flat_map(|(a, b)| (0..3).map(move |n| (a[n] - b[n]).abs()));
            assert!(far.fold(0.0, f64::max) < 1e-7);
            let same = between.momenta(&model.mass, model.dx, vec![[0.7; 3]; model.mass.len()]);
            assert!(same.iter().all(|p| *p == [0.7; 3]));
        }
    }
}
