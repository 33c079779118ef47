//! What the masks of a view say about each Gaussian: the weight that it has in each of them.

use cosplat_raster::{Camera, Ellipse, Row, SIZE, Sink};
use rayon::prelude::*;

use crate::Splat;

/// Masks of one view: which one each pixel lies in.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MaskMap {
    /// Pixels per row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// `[height][width]`, a number per mask from 0; -1 in none.
    pub mask: Vec<i32>,
}

impl MaskMap {
    /// The map at another size: the value of the pixel that each centre falls into.
    #[must_use]
    pub fn resized(&self, width: usize, height: usize) -> MaskMap {
        let at = |k: usize, from: usize, to: usize| (2 * k + 1) * from / (2 * to);
        let pixel = |n: usize| {
            let (x, y) = (n % width, n / width);
            self.mask[at(y, self.height, height) * self.width + at(x, self.width, width)]
        };
        MaskMap {
            width,
            height,
            mask: (0..width * height).map(pixel).collect(),
        }
    }
}

/// The weight of one Gaussian in one mask of one view.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Evidence {
    /// Index of the Gaussian.
    pub gaussian: u32,
    /// Number of the mask; -1 for pixels in none.
    pub mask: i32,
    /// Sum over pixels of opacity times transmittance [pixel].
    pub weight: f32,
}

/// Weights of the Gaussians of `splat` in the masks of a view, by Gaussian and mask, each pair once.
///
/// A map of another size than the camera's is resized. Sums have a fixed order: any number of threads gives the same
/// bits.
pub fn evidence(splat: &Splat, camera: &Camera, masks: &MaskMap) -> Vec<Evidence> {
    let (width, height) = (camera.width as usize, camera.height as usize);
    if masks.mask.is_empty() {
        return Vec::new();
    }
    let resized;
    let labels = if (masks.width, masks.height) == (width, height) {
        &masks.mask
    } else {
        resized = masks.resized(width, height).mask;
        &resized
    };
    let strips = (0..height.div_ceil(SIZE)).into_par_iter();
    let tallies = splat.project(camera).blend(strips.map(|_| Tally {
        labels,
        size: [width, height],
        corner: [0; 2],
        gaussian: Vec::new(),
        slots: Vec::new(),
    }));
    let mut found: Vec<Evidence> = tallies.iter().flat_map(Tally::evidence).collect();
    // Stable: the sums below go over strips from top to bottom.
    found.par_sort_by_key(|e| (e.gaussian, e.mask));
    found.dedup_by(|next, kept| {
        let same = (next.gaussian, next.mask) == (kept.gaussian, kept.mask);
        if same {
            kept.weight += next.weight;
        }
        same
    });
    found
}

/// No further slot.
const NONE: u32 = u32::MAX;
/// Mask of a slot that has had no pixel.
const EMPTY: i32 = i32::MIN;

/// One mask of the chain that an ellipse has.
struct Slot {
    mask: i32,
    weight: f32,
    next: u32,
}

/// Weights within one strip.
struct Tally<'a> {
    labels: &'a [i32],
    size: [usize; 2],
    /// First pixel of the tile at hand.
    corner: [usize; 2],
    gaussian: Vec<u32>,
    /// The first slots are those of the ellipses, in their order; the rest continues them.
    slots: Vec<Slot>,
}

impl Tally<'_> {
    fn add(&mut self, place: usize, mask: i32, weight: f32) {
        let mut at = place;
        loop {
            let slot = &mut self.slots[at];
            if slot.mask == mask {
                slot.weight += weight;
                return;
            }
            if slot.mask == EMPTY {
                (slot.mask, slot.weight) = (mask, weight);
                return;
            }
            if slot.next == NONE {
                break;
            }
            at = slot.next as usize;
        }
        self.slots[at].next = self.slots.len() as u32;
        self.slots.push(Slot {
            mask,
            weight,
            next: NONE,
        });
    }

    fn evidence(&self) -> impl Iterator<Item = Evidence> {
        self.gaussian
            .iter()
            .enumerate()
            .flat_map(move |(place, &n)| {
                let mut at = place as u32;
                std::iter::from_fn(move || {
                    let slot = self.slots.get(at as usize)?;
                    at = slot.next;
                    (slot.mask != EMPTY).then_some(Evidence {
                        gaussian: n,
                        mask: slot.mask,
                        weight: slot.weight,
                    })
                })
            })
    }
}

impl Sink<u32> for Tally<'_> {
    fn begin_strip(&mut self, ellipses: &[Ellipse<u32>]) {
        self.gaussian = ellipses.iter().map(|e| e.payload).collect();
        let empty = |_: &Ellipse<u32>| Slot {
            mask: EMPTY,
            weight: 0.0,
            next: NONE,
        };
        self.slots = ellipses.iter().map(empty).collect();
    }

    fn begin_tile(&mut self, left: usize, top: usize) {
        self.corner = [left, top];
    }

    #[inline(always)]
    fn row(&mut self, place: usize, _: u32, row: usize, weight: &Row) {
        let [left, y] = [self.corner[0], self.corner[1] + row];
        let [width, height] = self.size;
        if y >= height {
            return;
        }
        let columns = SIZE.min(width - left);
        let line = y * width + left;
        // Neighbours mostly lie in one mask: the chain is walked where it changes.
        let (mut mask, mut sum) = (EMPTY, 0.0);
        for (lane, &weight) in weight[..columns].iter().enumerate() {
            if weight == 0.0 {
                continue;
            }
            let here = self.labels[line + lane];
            if here != mask {
                if sum > 0.0 {
                    self.add(place, mask, sum);
                }
                (mask, sum) = (here, 0.0);
            }
            sum += weight;
        }
        if sum > 0.0 {
            self.add(place, mask, sum);
        }
    }

    fn end_tile(&mut self, _: &[Row; SIZE]) {}
}
