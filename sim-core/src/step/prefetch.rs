//! Hints to the processor: what the particle pass is going to read and write.

use crate::{
    grid::{Cells, Tile, Velocities},
    particles::{BLOCK, Fixed, Group},
    simd::F32x16,
};

/// Asks for the velocities that the next block will load, taking its cells in use for those of this one.
#[inline(always)]
pub(super) fn prefetch_velocities(nodes_of: &[u32; 27], nodes: &[Velocities], cells: &Cells) {
    #[cfg(target_arch = "x86_64")]
    {
        use std::arch::x86_64::{_MM_HINT_T0, _mm_prefetch};
        let [(x0, x1), (y0, y1), _] = *cells;
        for i in x0 - 1..=x1 + 1 {
            for j in y0 - 1..=y1 + 1 {
                let column = 9 * ((i + BLOCK) / BLOCK) + 3 * ((j + BLOCK) / BLOCK);
                let row = BLOCK * (i & (BLOCK - 1)) + (j & (BLOCK - 1));
                for k in 0..3 {
                    let block = nodes_of[(column + k) as usize] as usize;
                    let at = nodes.as_ptr().wrapping_add(block).cast::<F32x16>();
                    // SAFETY: a hint.
                    unsafe { _mm_prefetch::<_MM_HINT_T0>(at.wrapping_add(row as usize).cast()) };
                }
            }
        }
    }
    #[cfg(not(target_arch = "x86_64"))]
    let _ = (nodes_of, nodes, cells);
}

/// Asks for the part of a packed tile that is going to be written.
#[inline(always)]
pub(super) fn prefetch_tile(tile: &Tile, cells: &Cells) {
    #[cfg(target_arch = "x86_64")]
    {
        use std::arch::x86_64::{_MM_HINT_ET0, _mm_prefetch};
        // A block that lost all its particles has no cells.
        let edges = cells.iter().map(|(low, high)| (high - low + 3).max(0));
        let nodes: i32 = edges.product();
        let start = tile.0.as_ptr().cast::<i8>();
        for line in 1..=(nodes as usize).div_ceil(4) {
            // SAFETY: a hint.
            unsafe { _mm_prefetch::<_MM_HINT_ET0>(start.wrapping_add(64 * line)) };
        }
    }
    #[cfg(not(target_arch = "x86_64"))]
    let _ = (tile, cells);
}

/// Asks for the two groups from `next` on while the two before them are worked on.
#[inline(always)]
pub(super) fn prefetch(
    groups: &[Group],
    fixed: &[Fixed],
    memory: &[F32x16],
    next: usize,
    deforms: bool,
) {
    #[cfg(target_arch = "x86_64")]
    {
        use std::arch::x86_64::{_MM_HINT_T0, _mm_prefetch};
        let end = (next + 2).min(groups.len());
        for g in next..end {
            let group = (&raw const groups[g]).cast::<i8>();
            // Positions come first; a fluid's deformation is not read.
            let bytes = if deforms { size_of::<Group>() } else { 192 };
            for line in 0..bytes / 64 {
                // SAFETY: a hint; the address is inside the group.
                unsafe { _mm_prefetch::<_MM_HINT_T0>(group.add(64 * line)) };
            }
            // SAFETY: hints; the addresses are those of references.
            unsafe {
                _mm_prefetch::<_MM_HINT_T0>((&raw const fixed[g].mass).cast());
                _mm_prefetch::<_MM_HINT_T0>((&raw const memory[g]).cast());
            }
        }
    }
    #[cfg(not(target_arch = "x86_64"))]
    let _ = (groups, fixed, memory, next, deforms);
}
