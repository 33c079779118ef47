//! How near particles are to colliders that act on nodes, for every node that they reach.

mod flat;

use rayon::prelude::*;

use flat::{Flat, merge, see_plane};

use super::{
    NONE, NodeBlock, TILE,
    anchors::Anchors,
    boundary::{corners, near_block},
    place_of,
    topology::OFFSETS,
};
use crate::{
    colliders::{
        Attached, NodeConditions, Placed, VelocityChange,
        approach::{GapSample, RADIUS_MAX, RANGE},
    },
    particles::{BLOCK, Block, NO_PARTICLE, Particles, position_in_cells},
    simd::{F32x16, LANES},
};

/// Cells along an edge in which particles of a block may be, -1..=4.
const CELLS: usize = TILE - 2;
/// All of these cells.
const CUBE: usize = CELLS * CELLS * CELLS;
/// Nodes along an edge of a block.
const EDGE: usize = BLOCK as usize;
/// Gap beyond which no surface holds on to matter [cells].
const BONDING_RANGE: f32 = 0.25;
/// Particle blocks per task at least.
const TASK: usize = 16;

/// The particle of a cell that is nearest to a curved collider.
#[derive(Clone, Copy, Debug)]
struct ClosestParticle {
    /// Number of the collider.
    body: usize,
    /// The cell, 0..6 per axis: -1..=4 in the block of its particles.
    cell: [i32; 3],
    nearest: GapSample,
}

/// What the particles of one block are near to.
#[derive(Clone, Debug)]
pub(crate) struct ParticleGaps {
    /// Half-spaces.
    flat: Vec<Flat>,
    /// All others, collider after collider and cell after cell.
    curved: Vec<ClosestParticle>,
}

/// Everything that acts on nodes in one substep.
#[derive(Clone, Copy, Debug)]
pub(crate) struct BoundaryConditions<'a> {
    /// All colliders and regions.
    pub boundaries: &'a NodeConditions<'a>,
    /// Those that move, or come and go.
    pub moving: &'a NodeConditions<'a>,
    /// Per particle block.
    pub approaches: &'a [ParticleGaps],
    /// What of masses is not matter.
    pub anchors: &'a Anchors<'a>,
    /// Velocity that those of nodes are relative to [cells/s].
    pub frame_velocity: [f64; 3],
    /// Substep [s].
    pub dt: f64,
}

/// What acts on one block of nodes.
#[derive(Clone, Debug)]
pub(crate) struct BlockConstraints<'a> {
    conditions: NodeConditions<'a>,
    /// Node by node, for every collider.
    nearest: Vec<GapSample>,
    /// Whether all is colliders that stand still, and no node is inside any.
    is_outside: bool,
    index: [i32; 3],
    dt: f64,
}

/// Finds what the particles of every block are near to; `half_spacings` is in scene order [cells].
pub(crate) fn approaches(
    particles: &Particles,
    half_spacings: &[f64],
    boundaries: &NodeConditions<'_>,
) -> Vec<ParticleGaps> {
    let blocks = particles.blocks.par_iter().with_min_len(TASK);
    blocks
        .map(|block| approach(block, particles, half_spacings, boundaries))
        .collect()
}

fn approach(
    block: &Block,
    particles: &Particles,
    half_spacings: &[f64],
    boundaries: &NodeConditions<'_>,
) -> ParticleGaps {
    let mut found = ParticleGaps::new();
    // Cells of the block, and as far as particles may drift.
    let min = block.index.map(|i| f64::from(BLOCK * i) - 1.5);
    let max = block.index.map(|i| f64::from(BLOCK * (i + 1)) + 0.5);
    for body in boundaries.bodies() {
        if !body.is_near(min, max, RANGE + RADIUS_MAX) {
            continue;
        }
        if body.flat_normal().is_some() {
            found
                .flat
                .extend(see_plane(block, particles, half_spacings, body));
        } else {
            approach_body(block, particles, half_spacings, body, &mut found.curved);
        }
    }
    found
}

/// Cells 0..[`CUBE`] of sixteen particles in their block.
#[inline(always)]
fn cells_of(x: &[F32x16; 3]) -> [u32; LANES] {
    let mut cells = [0; LANES];
    for a in 0..3 {
        for lane in 0..LANES {
            // From -1 on, the block's centre is at 1.5; without the library's rounding.
            let cell = (x[a].0[lane] + 3.0).clamp(0.0, 5.5) as i32;
            cells[lane] = CELLS as u32 * cells[lane] + cell as u32;
        }
    }
    cells
}

/// Adds what the particles of a block see of one curved collider.
fn approach_body(
    block: &Block,
    particles: &Particles,
    half_spacings: &[f64],
    body: &Placed<'_>,
    found: &mut Vec<ClosestParticle>,
) {
    let (mut cells, mut is_used) = ([GapSample::NONE; CUBE], false);
    for g in block.groups.clone() {
        let (id, x) = (&particles.fixed[g].id, &particles.groups[g].x);
        if is_out_of_range(body, block.index, x) {
            continue;
        }
        let cell = cells_of(x);
        for lane in (0..LANES).filter(|&lane| id[lane] != NO_PARTICLE) {
            let local = [x[0].0[lane], x[1].0[lane], x[2].0[lane]];
            let at = position_in_cells(block.index, local);
            let half_spacing = half_spacings[id[lane] as usize];
            if let Some(nearest) = body.nearest_of(at, half_spacing, 1.0) {
                is_used = true;
                cells[cell[lane] as usize].take(&nearest);
            }
        }
    }
    if !is_used {
        return;
    }
    for (n, nearest) in cells.iter().enumerate() {
        if nearest.gap < f32::INFINITY {
            found.push(ClosestParticle {
                body: body.id,
                cell: [n / (CELLS * CELLS), n / CELLS % CELLS, n % CELLS].map(|i| i as i32),
                nearest: *nearest,
            });
        }
    }
}

/// Whether none of sixteen particles can be in range: distances change no faster than places do, so that one stands for
/// all. Particles of a group are neighbours.
fn is_out_of_range(body: &Placed<'_>, block: [i32; 3], x: &[F32x16; 3]) -> bool {
    let (mut centre, mut radius) = ([0.0; 3], 0.0);
    for a in 0..3 {
        // Unused lanes are at the block's centre and do no harm. Halving, not one after the other, so that several lanes
        // go at once.
        let (mut min, mut max) = (x[a].0, x[a].0);
        for half in [8, 4, 2, 1] {
            for n in 0..half {
                let (low, high) = (min[n + half], max[n + half]);
                min[n] = if low < min[n] { low } else { min[n] };
                max[n] = if high > max[n] { high } else { max[n] };
            }
        }
        let (min, max) = (min[0], max[0]);
        centre[a] = 0.5 * (min + max);
        radius += f64::from(max - min).powi(2);
    }
    // The centre is rounded to single precision.
    let radius = 0.5 * radius.sqrt() + 1e-5;
    body.distance(position_in_cells(block, centre)).value > RANGE + RADIUS_MAX + radius
}

/// Tells the nodes of a block, for collider `b` of `count`, how near the particles are that reach them: those of the cells
/// around them. Of what is equally near it is the first; `seen` has cells -1..=4 of the block, 0..6 per axis, z fastest.
fn spread(seen: &[(usize, GapSample)], nearest: &mut [GapSample], b: usize, count: usize) {
    let Some((_, first)) = seen.first() else {
        return;
    };
    if seen.iter().all(|(_, one)| one.normal == first.normal) {
        // Nearly always: gaps say it all.
        let mut gaps = [f32::INFINITY; CUBE];
        for (cell, one) in seen {
            gaps[*cell] = smaller(gaps[*cell], one.gap);
        }
        return spread_gaps(&gaps, first.normal, nearest, b, count);
    }
    let mut ranks = [u64::MAX; CUBE];
    for (n, (cell, one)) in seen.iter().enumerate() {
        ranks[*cell] = smaller(ranks[*cell], rank(one.gap, n));
    }
    let ranks = smallest_around(&ranks, u64::MAX);
    for (at, &rank) in ranks.as_flattened().iter().enumerate() {
        if rank != u64::MAX {
            nearest[count * at + b] = seen[rank as u32 as usize].1;
        }
    }
}

/// The same where only gaps differ; infinite where there is nothing.
fn spread_gaps(
    gaps: &[f32; CUBE],
    normal: [f32; 3],
    nearest: &mut [GapSample],
    b: usize,
    count: usize,
) {
    let gaps = smallest_around(gaps, f32::INFINITY);
    for (at, &gap) in gaps.as_flattened().iter().enumerate() {
        if gap < f32::INFINITY {
            nearest[count * at + b] = GapSample { gap, normal };
        }
    }
}

/// The smallest of the 27 cells around every node of a block, from those of -1..=4; rows along z.
fn smallest_around<T: Copy + PartialOrd>(cells: &[T; CUBE], none: T) -> [[T; EDGE]; EDGE * EDGE] {
    // One axis after the other.
    let mut rows = [[none; EDGE]; CELLS * CELLS];
    for (row, to) in rows.iter_mut().enumerate() {
        let from = &cells[CELLS * row..][..CELLS];
        for k in 0..EDGE {
            to[k] = smaller(smaller(from[k], from[k + 1]), from[k + 2]);
        }
    }
    let mut slabs = [[none; EDGE]; CELLS * EDGE];
    for (n, to) in slabs.iter_mut().enumerate() {
        let first = n / EDGE * CELLS + n % EDGE;
        *to = smallest_of_rows([&rows[first], &rows[first + 1], &rows[first + 2]]);
    }
    let mut nodes = [[none; EDGE]; EDGE * EDGE];
    for (n, to) in nodes.iter_mut().enumerate() {
        *to = smallest_of_rows([&slabs[n], &slabs[n + EDGE], &slabs[n + 2 * EDGE]]);
    }
    nodes
}

fn smallest_of_rows<T: Copy + PartialOrd>([a, b, c]: [&[T; EDGE]; 3]) -> [T; EDGE] {
    let mut smallest = *a;
    for k in 0..EDGE {
        smallest[k] = smaller(smaller(a[k], b[k]), c[k]);
    }
    smallest
}

#[inline(always)]
fn smaller<T: PartialOrd>(a: T, b: T) -> T {
    if b < a { b } else { a }
}

/// Orders gaps, then what they belong to, which is the low half.
fn rank(gap: f32, of: usize) -> u64 {
    // Integers in the order of the floats: negative ones turned round, below the others.
    let bits = gap.to_bits();
    let order = if gap.is_sign_negative() {
        !bits
    } else {
        bits | 1 << 31
    };
    u64::from(order) << 32 | of as u64
}

impl<'a> BoundaryConditions<'a> {
    /// Whether anything may act on the nodes of a block.
    pub fn may_reach(&self, block: &NodeBlock) -> bool {
        block.constrained || super::boundary::covers_block(self.moving, block.index)
    }

    /// What acts on the nodes of a block, if anything does.
    pub fn on(&self, block: &NodeBlock) -> Option<BlockConstraints<'a>> {
        if !self.may_reach(block) {
            return None;
        }
        // What the particle blocks around it are near to; most are near to nothing.
        let nothing = ParticleGaps::new();
        let mut around = [([0; 3], &nothing); 27];
        let mut count = 0;
        for n in (0..27).filter(|&n| block.tiles[n] != NONE) {
            around[count] = (OFFSETS[n], &self.approaches[block.tiles[n] as usize]);
            count += usize::from(!around[count].1.is_empty());
        }
        let around = &around[..count];
        let mut conditions = near_block(self.boundaries, block.index);
        conditions.meet(block.field);
        let [first, last] = corners(block.index);
        let is_inside = |body: &Placed<'_>| body.is_near(first, last, 0.0);
        conditions.retain_bodies(|body| {
            // Without matter near it, a collider acts on nodes inside, and counts with its speed.
            body.holds() && (moves(body) || is_inside(body))
                || around.iter().any(|(_, approach)| approach.sees(body.id))
        });
        if conditions.is_empty() {
            return None;
        }
        let bodies = conditions.bodies();
        let mut nearest = vec![GapSample::NONE; 64 * bodies.len()];
        let mut reaching = Vec::new();
        for (b, body) in bodies.iter().enumerate() {
            if let Some(normal) = body.flat_normal() {
                let mut gaps = [f32::INFINITY; CUBE];
                for (offset, approach) in around {
                    let of_body = approach.flat.iter().filter(|flat| flat.body == body.id);
                    of_body.for_each(|flat| merge(&flat.gaps, *offset, &mut gaps));
                }
                let normal = normal.map(|n| n as f32);
                spread_gaps(&gaps, normal, &mut nearest, b, bodies.len());
                continue;
            }
            reaching.clear();
            for (offset, approach) in around {
                let of_body = approach.curved.iter().filter(|seen| seen.body == body.id);
                reaching.extend(of_body.filter_map(|seen| seen.from(*offset)));
            }
            spread(&reaching, &mut nearest, b, bodies.len());
        }
        let mut bodies = bodies.iter();
        let is_outside = !conditions.has_regions() && bodies.all(|b| !moves(b) && !is_inside(b));
        Some(BlockConstraints {
            is_outside,
            conditions,
            nearest,
            index: block.index,
            dt: self.dt,
        })
    }
}

/// Whether matter with this velocity [cells/s] at a node outside of all colliders touches none of them in a substep of `dt`
/// [s], whatever its direction: then they leave it as it is.
fn is_clear(nearest: &[GapSample], v: [f64; 3], dt: f64) -> bool {
    let travel = dt * (v[0].abs() + v[1].abs() + v[2].abs());
    let mut gaps = nearest.iter().map(|nearest| nearest.gap);
    // Less than all of the gap, for round-off.
    gaps.all(|gap| gap > BONDING_RANGE && travel <= 0.99 * f64::from(gap))
}

fn moves(body: &Placed<'_>) -> bool {
    body.speed(1.0, 1.0) > 0.0
}

impl ParticleGaps {
    /// To nothing.
    fn new() -> Self {
        Self {
            flat: vec![],
            curved: vec![],
        }
    }

    fn is_empty(&self) -> bool {
        self.flat.is_empty() && self.curved.is_empty()
    }

    /// Whether any particle is near a collider.
    fn sees(&self, body: usize) -> bool {
        self.flat.iter().any(|flat| flat.body == body)
            || self.curved.iter().any(|seen| seen.body == body)
    }
}

impl ClosestParticle {
    /// The same by the number of its cell around a node block that has the particles' block at an offset, if it is there.
    fn from(&self, offset: [i32; 3]) -> Option<(usize, GapSample)> {
        let [i, j, k] = std::array::from_fn(|a| self.cell[a] + BLOCK * offset[a]);
        let range = 0..CELLS as i32;
        let is_there = range.contains(&i) && range.contains(&j) && range.contains(&k);
        let cell = (i * CELLS as i32 + j) * CELLS as i32 + k;
        is_there.then_some((cell as usize, self.nearest))
    }
}

impl BlockConstraints<'_> {
    /// Largest speed that it may give to nodes [cells/s].
    pub fn speed(&self) -> f64 {
        let [first, last] = corners(self.index);
        self.conditions.speed(first, last)
    }

    /// Velocity that the node `at`, 0..64 with z fastest, may have when it `obeyed` what it is attached to; `record` is told what
    /// colliders change.
    pub fn constrain(
        &self,
        at: usize,
        obeyed: &Attached,
        record: &mut impl FnMut(VelocityChange),
    ) -> [f64; 3] {
        let nearest = self.near(at);
        if self.is_outside && is_clear(nearest, obeyed.velocity, self.dt) {
            return obeyed.velocity;
        }
        let x = self.place(at).map(f64::from);
        self.conditions
            .constrain(x, nearest, self.dt, 1.0, obeyed, record)
    }

    /// Per collider the nearest of the particles that reach a node.
    fn near(&self, at: usize) -> &[GapSample] {
        let count = self.conditions.bodies().len();
        &self.nearest[count * at..][..count]
    }

    /// Index of a node.
    fn place(&self, at: usize) -> [i32; 3] {
        place_of(self.index, at)
    }

    /// How near matter that reaches a node is to a collider [cells].
    pub fn gap(&self, at: usize, body: usize) -> f64 {
        let bodies = self.conditions.bodies();
        let found = bodies.iter().position(|known| known.id == body);
        found.map_or(f64::INFINITY, |b| {
            self.nearest[bodies.len() * at + b].gap.into()
        })
    }
}

#[cfg(test)]
mod tests;
