//! Grid pass: sum the tiles in fixed order, momentum to velocity, boundaries.

use rayon::prelude::*;

use super::{
    Cells, FRONT, Grid, NONE, NodeBlock, Tile, Velocities,
    approach::BoundaryConditions,
    attach::attach,
    boundary::{attaches, constrain, holds_matter},
    topology::OFFSETS,
};
use crate::{
    colliders::Attached,
    ledger::ColliderImpulses,
    particles::BLOCK,
    simd::{F32x16, Isa, Lanes, on_isa},
};

/// Nodes lighter than this share of the heaviest particle stay at rest: their weights are denormal noise.
const LIGHTEST: f32 = 1e-24;

/// Node blocks per task, at least and at most: where one thread is held up, others must find work to take over.
const TASK: [usize; 2] = [16, 64];

/// Turns tiles into node velocities, of which damping leaves `keep`, 0..=1. They are relative to the frame velocity, which holds
/// all that gravity adds.
///
/// Returns the largest component of a velocity, frame velocity included, before or after boundaries, or speed of a boundary among
/// nodes [cells/s]; NaN or infinite when a node's is.
pub(crate) fn node_pass(
    isa: Isa,
    grid: &mut Grid,
    keep: f32,
    acting: &BoundaryConditions<'_>,
) -> f32 {
    let Grid {
        tiles,
        cells,
        nodes,
        velocities,
        given_to_nodes,
        ..
    } = grid;
    let tiles = (tiles.as_slice(), cells.as_slice());
    given_to_nodes.resize_with(nodes.len(), ColliderImpulses::default);
    // Magnitudes are compared as integers: NaN is then the largest of all and cannot get lost.
    let largest = nodes
        .par_iter()
        .zip(velocities.par_iter_mut())
        .zip(given_to_nodes.par_iter_mut())
        .enumerate()
        .with_min_len(TASK[0])
        .with_max_len(TASK[1])
        .map(|(n, ((block, out), given))| {
            given.clear();
            let mut largest = sum_block(isa, block, tiles, keep, acting.frame_velocity, out);
            if acting.may_reach(block)
                && !attaches(acting.boundaries, block.index)
                && holds_matter(out)
                && let Some(allowed) = acting.on(block)
            {
                let speed = (allowed.speed() as f32).to_bits();
                let left = constrain(out, acting.frame_velocity, |at, mass, v| {
                    let mass = acting.anchors.matter(n, block, at, mass.into());
                    allowed.constrain(at, &Attached::free(v), &mut |change| {
                        given.add(mass, &change)
                    })
                });
                largest = largest.max(speed).max(left);
            }
            largest
        })
        .reduce(|| 0, u32::max);
    let attached = attach(nodes, velocities, given_to_nodes, acting);
    f32::from_bits(largest.max(attached))
}

/// Turns tiles into means over nodes, of whatever was scattered in place of momentum: they take the place of velocities.
pub(crate) fn node_means(isa: Isa, grid: &mut Grid) {
    let tiles = (grid.tiles.as_slice(), grid.cells.as_slice());
    grid.nodes
        .par_iter()
        .zip(grid.velocities.par_iter_mut())
        .with_min_len(TASK[0])
        .with_max_len(TASK[1])
        .for_each(|(block, out)| {
            sum_block(isa, block, tiles, 1.0, [0.0; 3], out);
        });
}

/// Sums and divides the nodes of one block; returns the largest magnitude of a component, frame velocity included, as bits.
#[inline(always)]
fn sum_block(
    isa: Isa,
    block: &NodeBlock,
    tiles: (&[Tile], &[Cells]),
    keep: f32,
    frame_velocity: [f64; 3],
    out: &mut Velocities,
) -> u32 {
    let [x, y, z] = frame_velocity.map(|u| u as f32);
    let frame_velocity = F32x16([x, y, z, 0.0, x, y, z, 0.0, x, y, z, 0.0, x, y, z, 0.0]);
    node_block_with_isa(isa, block, tiles, keep, &frame_velocity, out)
}

on_isa! {
    fn node_block_with_isa = node_block(block: &NodeBlock, tiles: Tiles<'_>, keep: f32, frame_velocity: &F32x16, out: &mut Velocities) -> u32
}

/// How many tiles ahead of the sums a tile is asked for.
const AHEAD: usize = 6;

/// Packed tiles and their cells in use.
type Tiles<'a> = (&'a [Tile], &'a [Cells]);

/// The rows along z that a tile shares with a node block.
#[derive(Clone, Copy)]
struct Overlap {
    /// Where node 0, 0, 0 of the block would be; at most 12 floats in front of the tile's first node.
    origin: *const f32,
    /// Nodes along y and z in the tile.
    length: [isize; 2],
    /// First and last node in use, in the block's numbers.
    range: [[i32; 2]; 3],
}

impl Overlap {
    /// Of the particle block at this offset; `None` where they share no node.
    #[inline(always)]
    fn new(tile: &Tile, cells: &Cells, offset: [i32; 3]) -> Option<Self> {
        let mut start = [0; 3];
        let mut range = [[0; 2]; 3];
        let mut length = [0; 3];
        for a in 0..3 {
            let shift = BLOCK * offset[a];
            start[a] = (cells[a].0 - 1 + shift) as isize;
            length[a] = (cells[a].1 - cells[a].0 + 3) as isize;
            range[a] = [
                (cells[a].0 - 1 + shift).max(0),
                (cells[a].1 + 1 + shift).min(BLOCK - 1),
            ];
            if range[a][0] > range[a][1] {
                return None;
            }
        }
        let first = (start[0] * length[1] + start[1]) * length[2] + start[2];
        Some(Self {
            origin: tile.0.as_ptr().wrapping_offset(FRONT as isize - 4 * first),
            length: [length[1], length[2]],
            range,
        })
    }

    /// Four nodes along z; those outside the range hold anything.
    #[inline(always)]
    fn row(&self, i: i32, j: i32) -> *const f32 {
        let [ny, nz] = self.length;
        let node = (i as isize * ny + j as isize) * nz;
        self.origin.wrapping_offset(4 * node)
    }

    /// Asks for the rows.
    #[inline(always)]
    fn prefetch(&self) {
        #[cfg(target_arch = "x86_64")]
        {
            use std::arch::x86_64::{_MM_HINT_T0, _mm_prefetch};
            let [[x0, x1], [y0, y1], _] = self.range;
            for i in x0..=x1 {
                for j in y0..=y1 {
                    let row = self.row(i, j).cast::<i8>();
                    // SAFETY: hints.
                    unsafe {
                        _mm_prefetch::<_MM_HINT_T0>(row);
                        _mm_prefetch::<_MM_HINT_T0>(row.wrapping_add(63));
                    }
                }
            }
        }
    }
}

/// Sums one node block and divides; returns the largest magnitude of a velocity component as bits.
#[inline(always)]
fn node_block<V: Lanes>(
    block: &NodeBlock,
    tiles: Tiles<'_>,
    keep: f32,
    frame_velocity: &F32x16,
    out: &mut Velocities,
) -> u32 {
    let zero = V::broadcast(0.0);
    let one = V::broadcast(1.0);
    let node = V::load(&F32x16([
        0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 1.0, 2.0, 2.0, 2.0, 2.0, 3.0, 3.0, 3.0, 3.0,
    ]));
    let velocity = V::load(&F32x16([
        1.0, 1.0, 1.0, 0.0, 1.0, 1.0, 1.0, 0.0, 1.0, 1.0, 1.0, 0.0, 1.0, 1.0, 1.0, 0.0,
    ]));
    let velocity = zero.lt(velocity);
    // Tiles come from the outer caches: each is asked for while those before it are summed.
    let mut overlaps = [None; 27 + AHEAD];
    let mut count = 0;
    for n in 0..27 {
        if block.tiles[n] != NONE {
            let tile = block.tiles[n] as usize;
            overlaps[count] = Overlap::new(&tiles.0[tile], &tiles.1[tile], OFFSETS[n]);
            count += usize::from(overlaps[count].is_some());
        }
    }
    for first in overlaps[..AHEAD].iter().flatten() {
        first.prefetch();
    }
    let mut sum = [zero; 16];
    for n in 0..count {
        if let Some(next) = &overlaps[n + AHEAD] {
            next.prefetch();
        }
        let Some(overlap) = &overlaps[n] else {
            continue;
        };
        let [[x0, x1], [y0, y1], [z0, z1]] = overlap.range;
        let (first, last) = (V::broadcast(z0 as f32), V::broadcast(z1 as f32));
        let outside = node.lt(first) | last.lt(node);
        let mut i = x0;
        while i <= x1 {
            let mut j = y0;
            while j <= y1 {
                // SAFETY: row i, j is in the tile, and node 0 of it at most three nodes before, node 3 at most three
                // nodes behind those in use; tiles are padded by four and more.
                let row = unsafe { V::load_at(overlap.row(i, j)) };
                let sum = &mut sum[(BLOCK * i + j) as usize];
                *sum = *sum + V::select(outside, zero, row);
                j += 1;
            }
            i += 1;
        }
    }
    let keep = V::broadcast(keep);
    let frame_velocity = V::load(frame_velocity);
    let mut largest = zero;
    for (row, to) in sum.iter().zip(&mut out.0) {
        let mass = row.fourth();
        let occupied = V::broadcast(LIGHTEST).lt(mass);
        let v = *row / V::select(occupied, mass, one) * keep;
        let v = V::select(velocity & occupied, v, zero);
        V::select(velocity, v, mass).store(to);
        let total = V::select(velocity & occupied, v + frame_velocity, zero);
        largest = largest.larger_magnitude(total);
    }
    largest.largest_magnitude_bits()
}
