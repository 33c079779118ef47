//! The scene as a camera sees it: ellipses sorted by depth and handed to tiles, a strip of tiles at a time.

use std::ops::Range;

use rayon::prelude::*;

use crate::Camera;
use crate::ellipse::Ellipse;
use crate::tile::{SIZE, Sink, Tile};

/// Gaussians projected by one task.
const CHUNK: usize = 4096;

/// Everything that shows of a scene in one camera.
#[derive(Clone, Debug)]
pub struct Splats<T> {
    /// What shows of every [`CHUNK`] Gaussians, in their order.
    chunks: Vec<Vec<Ellipse<T>>>,
    width: usize,
    height: usize,
}

impl<T: Copy + Send + Sync> Splats<T> {
    /// What shows in `camera` of `count` Gaussians, of which `ellipse` projects the one of an index.
    pub fn new(
        count: usize,
        camera: &Camera,
        ellipse: impl Fn(usize) -> Option<Ellipse<T>> + Sync,
    ) -> Self {
        let of_chunk = |chunk: usize| {
            let (first, end) = (chunk * CHUNK, count.min((chunk + 1) * CHUNK));
            let mut shown = Vec::with_capacity(end - first);
            shown.extend((first..end).filter_map(&ellipse));
            shown
        };
        let chunks = 0..count.div_ceil(CHUNK);
        Self {
            chunks: chunks.into_par_iter().map(of_chunk).collect(),
            width: camera.width as usize,
            height: camera.height as usize,
        }
    }

    /// Pixels per row, and rows.
    pub fn size(&self) -> [usize; 2] {
        [self.width, self.height]
    }

    /// All that shows, in the order of the scene.
    pub(crate) fn ellipses(&self) -> impl Iterator<Item = &Ellipse<T>> {
        self.chunks.iter().flatten()
    }

    /// The ellipse at a place of [`Self::strips`].
    fn of(&self, place: u32) -> Ellipse<T> {
        let place = place as usize;
        self.chunks[place / CHUNK][place % CHUNK]
    }

    /// Blends the picture and gives back its sinks, one per strip of [`SIZE`] rows from top to bottom.
    ///
    /// Equal input gives equal bits for any number of threads and any instruction set. Sinks beyond the last strip are
    /// dropped.
    pub fn blend<S: Sink<T> + Send>(
        &self,
        sinks: impl IndexedParallelIterator<Item = S>,
    ) -> Vec<S> {
        let strips = self.strips();
        sinks
            .zip(&strips)
            .enumerate()
            .map(|(row, (mut sink, members))| {
                // In one place: fetched from all over the scene tile by tile, they would cost a cache miss each time.
                let ellipses: Vec<_> = members.iter().map(|&place| self.of(place)).collect();
                sink.begin_strip(&ellipses);
                blend_strip(&ellipses, row, self.width, &mut sink);
                sink
            })
            .collect()
    }

    /// Places of the ellipses that reach each strip of [`SIZE`] rows, nearest first, equal depths in the order of the scene.
    fn strips(&self) -> Vec<Vec<u32>> {
        let count = self.height.div_ceil(SIZE);
        let all = self.chunks.iter().enumerate().flat_map(|(chunk, shown)| {
            let reached = move |(n, ellipse): (usize, &Ellipse<T>)| {
                let (center, reach) = (ellipse.center[1], ellipse.reach[1]);
                let rows = tiles(center - reach, center + reach, count);
                Reached {
                    depth: ellipse.depth.to_bits(),
                    place: (chunk * CHUNK + n) as u32,
                    rows: [rows.start as u32, rows.end as u32],
                }
            };
            shown.iter().enumerate().map(reached)
        });
        let mut strips = vec![Vec::new(); count];
        for reached in by_depth(all.collect()) {
            let [first, end] = reached.rows.map(|row| row as usize);
            for strip in &mut strips[first..end] {
                strip.push(reached.place);
            }
        }
        strips
    }
}

/// An ellipse as strips know it.
#[derive(Clone, Copy, Default)]
struct Reached {
    /// Bits of its depth: those of positive floats sort like the floats.
    depth: u32,
    place: u32,
    /// First strip, and the one behind the last.
    rows: [u32; 2],
}

/// Sorts by depth and keeps the order of equal ones: a radix sort by three digits of 11 bits.
fn by_depth(mut all: Vec<Reached>) -> Vec<Reached> {
    const DIGIT: u32 = 11;
    let digit = |one: &Reached, n: usize| (one.depth >> (DIGIT * n as u32)) as usize % (1 << DIGIT);
    let mut counts = vec![[0u32; 3]; 1 << DIGIT];
    for one in &all {
        for n in 0..3 {
            counts[digit(one, n)][n] += 1;
        }
    }
    let mut sorted = vec![Reached::default(); all.len()];
    for n in 0..3 {
        let mut before = 0;
        for count in &mut counts {
            before += std::mem::replace(&mut count[n], before);
        }
        for one in &all {
            let next = &mut counts[digit(one, n)][n];
            sorted[*next as usize] = *one;
            *next += 1;
        }
        std::mem::swap(&mut all, &mut sorted);
    }
    all
}

/// Tiles, of `count` in a row, that the pixels from `low` to `high` lie in.
#[inline]
fn tiles(low: f32, high: f32, count: usize) -> Range<usize> {
    // A sixteenth of a pixel covers the rounding of the bounds; float-to-integer casts saturate.
    let first = ((low - 0.0625) / SIZE as f32).max(0.0) as usize;
    let end = ((high + 0.0625) / SIZE as f32 + 1.0).max(0.0) as usize;
    first.min(count)..end.min(count)
}

/// Blends strip `row` of a picture `width` pixels wide; `ellipses` are those that reach it, nearest first.
fn blend_strip<T: Copy, S: Sink<T>>(
    ellipses: &[Ellipse<T>],
    row: usize,
    width: usize,
    sink: &mut S,
) {
    let columns = width.div_ceil(SIZE);
    let top = (row * SIZE) as f32;
    let spans: Vec<Range<usize>> = ellipses
        .iter()
        .map(|ellipse| {
            let (center, reach) = (ellipse.center[0], ellipse.reach[0]);
            let widest = tiles(center - reach, center + reach, columns);
            if widest.len() < 2 {
                return widest;
            }
            // A slanted ellipse crosses fewer tiles in one strip than in all.
            ellipse
                .span(top, top + SIZE as f32)
                .map_or(0..0, |[left, right]| tiles(left, right, columns))
        })
        .collect();
    // Counting sort by column; it keeps the order by depth.
    let mut first = vec![0; columns + 1];
    for column in spans.iter().cloned().flatten() {
        first[column + 1] += 1;
    }
    for column in 0..columns {
        first[column + 1] += first[column];
    }
    let mut next = first.clone();
    let mut sorted = vec![0u32; first[columns]];
    for (place, span) in spans.into_iter().enumerate() {
        for column in span {
            sorted[next[column]] = place as u32;
            next[column] += 1;
        }
    }
    let mut tile = Tile::default();
    for column in 0..columns {
        tile.clear(column * SIZE, row * SIZE);
        sink.begin_tile(column * SIZE, row * SIZE);
        tile.blend(ellipses, &sorted[first[column]..first[column + 1]], sink);
        sink.end_tile(&tile.transmittance);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn depths_sort_and_equal_ones_stay_in_order() {
        let depth = |k: u32| 1e-3 * 1.2f32.powi((k * k % 97) as i32);
        let all: Vec<_> = (0..5000)
            .map(|place| Reached {
                depth: depth(place).to_bits(),
                place,
                rows: [0, 1],
            })
            .collect();
        let sorted = by_depth(all);
        let order = |one: &Reached| (f32::from_bits(one.depth), one.place);
        assert!(sorted.is_sorted_by(|one, other| order(one) < order(other)));
        assert_eq!(sorted.len(), 5000);
    }
}
