//! The picture: ellipses sorted by depth, handed to tiles, blended front to back.

use std::ops::Range;

use cosplat_ipc::schema::GaussianState;
use rayon::prelude::*;

use crate::project::{Ellipse, Projection};
use crate::tile::{SIZE, Tile};
use crate::{Camera, Harmonics, Image};

/// Gaussians projected by one task.
const CHUNK: usize = 4096;

/// Picture of `gaussians` as `camera` sees them before `background` (sRGB, 0..=1).
///
/// Colours come from `sh` where it has one for the Gaussian's index, else from `GaussianState::color`. Gaussians that
/// cannot be drawn (not finite, behind the camera, covariance not positive) are left out. Equal input gives equal
/// bytes for any number of threads and any instruction set.
pub fn picture(
    gaussians: &[GaussianState],
    sh: Option<Harmonics>,
    camera: &Camera,
    background: [f32; 3],
) -> Image {
    Projected::new(gaussians, sh, camera).draw(background)
}

/// A frame as seen by a camera, not drawn yet: all that a picture needs of the frame's memory, which can be given back.
#[derive(Clone, Debug)]
pub struct Projected {
    /// What shows of every [`CHUNK`] Gaussians, in the order of the frame.
    chunks: Vec<Vec<Ellipse>>,
    width: u32,
    height: u32,
}

impl Projected {
    /// First half of [`picture`].
    pub fn new(gaussians: &[GaussianState], sh: Option<Harmonics>, camera: &Camera) -> Self {
        Self {
            chunks: ellipses(gaussians, &Projection::new(camera, sh)),
            width: camera.width,
            height: camera.height,
        }
    }

    /// The ellipse that a key of [`strips`] stands for.
    fn of(&self, key: u64) -> Ellipse {
        let place = (key & 0xffff_ffff) as usize;
        self.chunks[place / CHUNK][place % CHUNK]
    }

    /// Second half of [`picture`].
    pub fn draw(&self, background: [f32; 3]) -> Image {
        let (width, height) = (self.width as usize, self.height as usize);
        let mut rgb = vec![0; 3 * width * height];
        let mut strips = strips(&self.chunks, height);
        // `max(1)`: chunks of zero bytes are not allowed, and a picture without pixels has none.
        rgb.par_chunks_mut((3 * width * SIZE).max(1))
            .zip(&mut strips)
            .enumerate()
            .for_each(|(row, (pixels, members))| {
                // Keys are unique, so that there is one order.
                members.sort_unstable();
                // In one place: fetched from all over the frame tile by tile, they would cost a cache miss each time.
                let ellipses: Vec<Ellipse> = members.iter().map(|&key| self.of(key)).collect();
                draw_strip(&ellipses, row, width, background, pixels);
            });
        Image {
            width: self.width,
            height: self.height,
            rgb,
        }
    }
}

/// Everything that shows.
fn ellipses(gaussians: &[GaussianState], projection: &Projection) -> Vec<Vec<Ellipse>> {
    let of_chunk = |chunk: &[GaussianState]| {
        let mut shown = Vec::with_capacity(chunk.len());
        shown.extend(
            chunk
                .iter()
                .filter_map(|gaussian| projection.ellipse(gaussian)),
        );
        shown
    };
    gaussians.par_chunks(CHUNK).map(of_chunk).collect()
}

/// The ellipses that reach each strip of [`SIZE`] rows, as keys: they sort nearest first, equal depths in the order of the
/// frame.
fn strips(chunks: &[Vec<Ellipse>], height: usize) -> Vec<Vec<u64>> {
    let mut strips = vec![Vec::new(); height.div_ceil(SIZE)];
    for (chunk, ellipses) in chunks.iter().enumerate() {
        for (n, ellipse) in ellipses.iter().enumerate() {
            let (center, reach) = (ellipse.center[1], ellipse.reach[1]);
            // The bits of positive floats sort like the floats; the place in the frame makes every key unique.
            let place = (chunk * CHUNK + n) as u64;
            let key = u64::from(ellipse.depth.to_bits()) << 32 | place;
            for row in tiles(center - reach, center + reach, strips.len()) {
                strips[row].push(key);
            }
        }
    }
    strips
}

/// Tiles, of `count` in a row, that the pixels from `low` to `high` lie in.
fn tiles(low: f32, high: f32, count: usize) -> Range<usize> {
    // A sixteenth of a pixel covers the rounding of the bounds; float-to-integer casts saturate.
    let first = ((low - 0.0625) / SIZE as f32).max(0.0) as usize;
    let end = ((high + 0.0625) / SIZE as f32 + 1.0).max(0.0) as usize;
    first.min(count)..end.min(count)
}

/// Draws strip `row`, whose bytes are `pixels`; `ellipses` are those that reach it, nearest first.
fn draw_strip(
    ellipses: &[Ellipse],
    row: usize,
    width: usize,
    background: [f32; 3],
    pixels: &mut [u8],
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
        tile.blend(ellipses, &sorted[first[column]..first[column + 1]]);
        tile.write(background, width, pixels);
    }
}
