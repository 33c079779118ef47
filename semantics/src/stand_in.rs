//! Masks that stand in for those of a network, where the objects are known: what is seen of each, with faults.
//!
//! No network runs where cosplat is built. Tests and the demo lift these masks in place of proposals of one; their vectors are
//! made up. What holds for them need not hold for a real network's.

use cosplat_raster::{Camera, Ellipse, Row, SIZE, Sink};
use rayon::prelude::*;

use crate::{MaskMap, Splat, query::unit};

/// Side of the blocks whose edges move together [pixel].
const BLOCK: i64 = 24;

/// Numbers that look random, the same in every run.
#[must_use]
pub fn noise(n: u64) -> u64 {
    let mut x = n.wrapping_mul(0x9e37_79b9_7f4a_7c15);
    x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    x ^ (x >> 31)
}

/// Composited ids of a strip: weight of each object at each pixel.
struct Ids<'a> {
    truth: &'a [i32],
    width: usize,
    left: usize,
    objects: usize,
    /// `[row][column][object]`.
    weight: Vec<f32>,
}

impl Sink<u32> for Ids<'_> {
    fn begin_strip(&mut self, _: &[Ellipse<u32>]) {}

    fn begin_tile(&mut self, left: usize, _: usize) {
        self.left = left;
    }

    fn row(&mut self, _: usize, gaussian: u32, row: usize, weight: &Row) {
        let Ok(object) = usize::try_from(self.truth[gaussian as usize]) else {
            return;
        };
        for (lane, weight) in weight.iter().enumerate() {
            if self.left + lane < self.width {
                let pixel = row * self.width + self.left + lane;
                self.weight[pixel * self.objects + object] += weight;
            }
        }
    }

    fn end_tile(&mut self, _: &[Row; SIZE]) {}
}

/// The object of most weight at every pixel, of `objects` objects that `truth` gives the Gaussians (-1 for none); none where
/// more than half of the light passes.
#[must_use]
pub fn mask(splat: &Splat, truth: &[i32], objects: usize, camera: &Camera) -> MaskMap {
    let (width, height) = (camera.width as usize, camera.height as usize);
    let strips = (0..height.div_ceil(SIZE)).into_par_iter().map(|_| Ids {
        truth,
        width,
        left: 0,
        objects,
        weight: vec![0.0; SIZE * width * objects],
    });
    let strips = splat.project(camera).blend(strips);
    let pixels = strips.iter().flat_map(|strip| strip.weight.chunks(objects));
    let of = |weights: &[f32]| {
        let best = (0..objects).fold(0, |a, b| if weights[b] > weights[a] { b } else { a });
        match weights.iter().sum::<f32>() < 0.5 {
            true => -1,
            false => best as i32,
        }
    };
    MaskMap {
        width,
        height,
        mask: pixels.take(width * height).map(of).collect(),
    }
}

/// Moves every pixel's label by up to `reach` pixels, by blocks: edges are off by as much.
#[must_use]
pub fn shifted(map: &MaskMap, reach: i64, seed: u64) -> MaskMap {
    let at = |n: usize| {
        let (x, y) = ((n % map.width) as i64, (n / map.width) as i64);
        let block = (x / BLOCK + 1000 * (y / BLOCK)) as u64;
        let random = noise(seed ^ (block << 8));
        let offset = |bits: u64| (bits % (2 * reach as u64 + 1)) as i64 - reach;
        let (u, v) = (x + offset(random >> 8), y + offset(random >> 40));
        let (u, v) = (
            u.clamp(0, map.width as i64 - 1),
            v.clamp(0, map.height as i64 - 1),
        );
        map.mask[v as usize * map.width + u as usize]
    };
    MaskMap {
        mask: (0..map.mask.len()).map(at).collect(),
        ..map.clone()
    }
}

/// Masks of a view as proposals are: half of them cut by a line, three of ten with the number of another object, edges off by up to
/// 4 pixels. What was object `n` is the masks `2 n` and `2 n + 1`.
#[must_use]
pub fn damaged(map: &MaskMap, objects: usize, view: usize) -> MaskMap {
    let dice = |object: i32, what: u64| noise(view as u64 * 1000 + object as u64 * 10 + what);
    let mut sums = vec![[0i64; 3]; objects];
    for (n, &object) in map.mask.iter().enumerate().filter(|(_, o)| **o >= 0) {
        let sum = &mut sums[object as usize];
        let (x, y) = (n % map.width, n / map.width);
        for (sum, value) in sum.iter_mut().zip([x as i64, y as i64, 1]) {
            *sum += value;
        }
    }
    let named = |(n, &object): (usize, &i32)| {
        if object < 0 {
            return -1;
        }
        let [x, y, count] = sums[object as usize];
        let count = count.max(1);
        let (dx, dy) = (
            (n % map.width) as i64 - x / count,
            (n / map.width) as i64 - y / count,
        );
        let angle = (dice(object, 1) % 360) as f64 * std::f64::consts::PI / 180.0;
        let side = dx as f64 * angle.cos() + dy as f64 * angle.sin() > 0.0;
        let is_split = dice(object, 2) % 100 < 50;
        let is_merged = dice(object, 3) % 100 < 30;
        let as_object = match is_merged {
            true => (object + 1 + (dice(object, 4) % (objects as u64 - 1)) as i32) % objects as i32,
            false => object,
        };
        2 * as_object + i32::from(is_split && side)
    };
    let map = MaskMap {
        mask: map.mask.iter().enumerate().map(named).collect(),
        ..map.clone()
    };
    shifted(&map, 4, view as u64)
}

/// A unit vector of `dim` values for a word, by its number: independent of those of other numbers.
#[must_use]
pub fn vector(number: u64, dim: usize) -> Vec<f32> {
    // The sum of twelve uniform numbers looks normal, so that the direction is uniform.
    let uniform = |n: u64| (noise(number << 20 | (n + 1)) >> 11) as f32 / (1u64 << 53) as f32;
    let value = |k: u64| (0..12).map(|j| uniform(12 * k + j)).sum::<f32>() - 6.0;
    scaled((0..dim as u64).map(value).collect())
}

/// A unit vector at this cosine to the unit vector `of`, by the number of its noise.
#[must_use]
pub fn aside(of: &[f32], cosine: f32, number: u64) -> Vec<f32> {
    let noise = vector(number, of.len());
    let along: f32 = noise.iter().zip(of).map(|(n, o)| n * o).sum();
    let off = scaled(noise.iter().zip(of).map(|(n, o)| n - along * o).collect());
    let rest = (1.0 - cosine * cosine).max(0.0).sqrt();
    of.iter()
        .zip(&off)
        .map(|(o, a)| cosine * o + rest * a)
        .collect()
}

fn scaled(vector: Vec<f32>) -> Vec<f32> {
    unit(&vector).unwrap_or(vector)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn damage_is_the_same_in_every_run_and_keeps_the_background() {
        let mask = (0..64 * 48).map(|n| if n % 64 < 32 { n % 2 } else { -1 });
        let map = MaskMap {
            width: 64,
            height: 48,
            mask: mask.collect(),
        };
        let found = damaged(&map, 2, 3);
        assert_eq!(found, damaged(&map, 2, 3));
        assert_ne!(found, damaged(&map, 2, 4));
        assert!(found.mask.iter().all(|m| (-1..4).contains(m)));
        // Far from an edge nothing comes out of nothing.
        assert!((0..48).all(|row| found.mask[row * 64 + 40] == -1));
    }

    #[test]
    fn vectors_of_words_are_apart_and_noise_keeps_its_cosine() {
        let cosine = |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f32>();
        let words: Vec<Vec<f32>> = (0..8).map(|n| vector(n, 512)).collect();
        for (n, word) in words.iter().enumerate() {
            assert!((cosine(word, word) - 1.0).abs() < 1e-5);
            let others = words.iter().enumerate().filter(|(m, _)| *m != n);
            // Six standard deviations of the cosine of two random directions.
            assert!(
                others
                    .clone()
                    .all(|(_, other)| cosine(word, other).abs() < 0.27)
            );
            let noisy = aside(word, 0.5, 100 + n as u64);
            assert!((cosine(word, &noisy) - 0.5).abs() < 1e-4);
        }
    }
}
