//! Blending of one tile, a row of pixels at a time: the hot loop, written in lanes so that it vectorises.

use crate::ellipse::{ALPHA_MAX, ALPHA_MIN, Ellipse};

/// Pixels along each side of a tile; also the lanes of a row.
pub const SIZE: usize = 16;
/// A tile is finished when less than this fraction of the light behind still passes everywhere: a quarter of a level.
const TRANSMITTANCE_MIN: f32 = 1e-3;
/// Ellipses blended between two checks for a finished tile.
const BATCH: usize = 16;
/// 2 to this power is below [`ALPHA_MIN`]; keeps the exponent in the range of [`exp2`].
const NOTHING: f32 = -9.0;

/// One value per pixel of a row of a tile.
pub type Row = [f32; SIZE];

/// Takes the weights of one strip of tiles: of every Gaussian at every pixel its opacity there times the light that
/// passes all nearer ones.
///
/// Functions are compiled once per instruction set and must give the same bits on all: no fused multiply-add.
pub trait Sink<T: Copy> {
    /// The strip begins; `ellipses` are those that reach it, nearest first.
    fn begin_strip(&mut self, ellipses: &[Ellipse<T>]);

    /// The tile whose first pixel is at column `left` and line `top` begins.
    fn begin_tile(&mut self, left: usize, top: usize);

    /// The ellipse at `place` of the strip has these weights in a row of the tile; many are 0.
    fn row(&mut self, place: usize, payload: T, row: usize, weight: &Row);

    /// The tile is done; `transmittance` is what of the light behind passes all, `[row][pixel]`.
    fn end_tile(&mut self, transmittance: &[Row; SIZE]);
}

/// Pixels of one tile while they are blended.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Tile {
    left: usize,
    top: usize,
    /// Fraction of the light behind that still passes, `[row][pixel]`.
    pub transmittance: [Row; SIZE],
}

impl Tile {
    /// Empties the tile and puts its first pixel at (`left`, `top`).
    #[inline]
    pub fn clear(&mut self, left: usize, top: usize) {
        *self = Self {
            left,
            top,
            transmittance: [[1.0; SIZE]; SIZE],
        };
    }

    /// Blends `members` of `ellipses`, nearest first, and hands their weights to `sink`.
    pub fn blend<T: Copy, S: Sink<T>>(
        &mut self,
        ellipses: &[Ellipse<T>],
        members: &[u32],
        sink: &mut S,
    ) {
        #[cfg(target_arch = "x86_64")]
        if is_x86_feature_detected!("avx512f") {
            // SAFETY: the processor has AVX-512F.
            return unsafe { self.blend_avx512(ellipses, members, sink) };
        }
        #[cfg(target_arch = "x86_64")]
        if is_x86_feature_detected!("avx2") {
            // SAFETY: the processor has AVX2.
            return unsafe { self.blend_avx2(ellipses, members, sink) };
        }
        self.blend_lanes(ellipses, members, sink);
    }

    /// The same operations in the same order as [`Self::blend_lanes`], so the same bits: nothing here may be
    /// contracted to a fused multiply-add.
    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2")]
    fn blend_avx2<T: Copy, S: Sink<T>>(
        &mut self,
        ellipses: &[Ellipse<T>],
        members: &[u32],
        sink: &mut S,
    ) {
        self.blend_lanes(ellipses, members, sink);
    }

    /// As [`Self::blend_avx2`], a row of a tile at once.
    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx512f")]
    fn blend_avx512<T: Copy, S: Sink<T>>(
        &mut self,
        ellipses: &[Ellipse<T>],
        members: &[u32],
        sink: &mut S,
    ) {
        self.blend_lanes(ellipses, members, sink);
    }

    #[inline(always)]
    fn blend_lanes<T: Copy, S: Sink<T>>(
        &mut self,
        ellipses: &[Ellipse<T>],
        members: &[u32],
        sink: &mut S,
    ) {
        for batch in members.chunks(BATCH) {
            for &member in batch {
                self.blend_one(ellipses, member as usize, sink);
            }
            if self.is_opaque() {
                return;
            }
        }
    }

    #[inline(always)]
    fn blend_one<T: Copy, S: Sink<T>>(
        &mut self,
        ellipses: &[Ellipse<T>],
        place: usize,
        sink: &mut S,
    ) {
        let ellipse = ellipses[place];
        // exp(-r^2 / 2) = 2^(xx dx^2 + xy dx dy + yy dy^2)
        let [a, b, c] = ellipse.conic;
        let to_log2 = -0.5 * std::f32::consts::LOG2_E;
        let (xx, xy, yy) = (a * to_log2, 2.0 * b * to_log2, c * to_log2);
        let center = [
            ellipse.center[0] - self.left as f32,
            ellipse.center[1] - self.top as f32,
        ];
        // Centres of pixels lie at half-integers; a sixteenth covers the rounding of the reach.
        let reach = ellipse.reach[1] + 0.0625;
        let line = |at: f32| at.clamp(0.0, SIZE as f32) as usize;
        let first = line((center[1] - reach - 0.5).ceil());
        let end = line((center[1] + reach + 0.5).floor());
        let left = 0.5 - center[0];
        for row in first..end {
            let dy = row as f32 + 0.5 - center[1];
            let (slope, level) = (xy * dy, yy * dy * dy);
            let passes = &mut self.transmittance[row];
            let mut weight = [0.0; SIZE];
            for lane in 0..SIZE {
                let dx = left + lane as f32;
                let exponent = dx * (xx * dx + slope) + level;
                let exponent = if exponent > NOTHING {
                    exponent
                } else {
                    NOTHING
                };
                let alpha = ellipse.opacity * exp2(exponent);
                let alpha = if alpha < ALPHA_MAX { alpha } else { ALPHA_MAX };
                let alpha = if alpha >= ALPHA_MIN { alpha } else { 0.0 };
                weight[lane] = alpha * passes[lane];
            }
            for lane in 0..SIZE {
                passes[lane] -= weight[lane];
            }
            sink.row(place, ellipse.payload, row, &weight);
        }
    }

    #[inline(always)]
    fn is_opaque(&self) -> bool {
        // A lane each: one for all would wait for every value in turn.
        let mut open = [0f32; SIZE];
        for row in &self.transmittance {
            for lane in 0..SIZE {
                open[lane] = if row[lane] > open[lane] {
                    row[lane]
                } else {
                    open[lane]
                };
            }
        }
        open.iter().all(|open| *open < TRANSMITTANCE_MIN)
    }
}

/// 2^x for -126 < x < 126; relative error below 3e-7.
#[inline(always)]
fn exp2(x: f32) -> f32 {
    // Adding 1.5 * 2^23 leaves the nearest integer in the low bits.
    const ROUND: f32 = 12_582_912.0;
    let whole = x + ROUND;
    let part = x - (whole - ROUND);
    let mut power = POWER[5];
    for term in [4, 3, 2, 1, 0] {
        power = power * part + POWER[term];
    }
    f32::from_bits(power.to_bits().wrapping_add(whole.to_bits() << 23))
}

/// Polynomial through 2^x at the six Chebyshev nodes of -1/2..1/2; error 1e-7.
const POWER: [f32; 6] = [
    1.000_000_1,
    std::f32::consts::LN_2,
    0.240_221_08,
    0.055_503_57,
    0.009_676_032,
    0.001_339_086_3,
];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exp2_is_accurate_to_f32() {
        for k in -9000..=1000 {
            let x = k as f32 / 1000.0;
            let exact = f64::from(x).exp2();
            // Interpolation error 1e-7 plus a few roundings.
            assert!((f64::from(exp2(x)) / exact - 1.0).abs() < 3e-7, "{x}");
        }
    }

    /// Weights as they come, and what passes.
    #[derive(Debug, Default, PartialEq)]
    struct Log(Vec<(usize, usize, Row)>);

    impl Sink<()> for Log {
        fn begin_strip(&mut self, _: &[Ellipse<()>]) {}
        fn begin_tile(&mut self, _: usize, _: usize) {}
        #[inline(always)]
        fn row(&mut self, place: usize, (): (), row: usize, weight: &Row) {
            self.0.push((place, row, *weight));
        }
        fn end_tile(&mut self, _: &[Row; SIZE]) {}
    }

    #[test]
    fn every_instruction_set_gives_the_same_bits() {
        let ellipses: Vec<Ellipse<()>> = (0..400)
            .map(|k| {
                let f = k as f32;
                let b = 0.2 * (f * 0.7).sin();
                Ellipse {
                    center: [8.0 + 9.0 * (f * 1.3).sin(), 8.0 + 9.0 * (f * 2.1).cos()],
                    conic: [0.3 + 0.2 * (f * 0.9).cos(), b, 0.4],
                    reach: [6.0, 6.0],
                    cutoff: 10.0,
                    opacity: 0.05 + 0.001 * f,
                    depth: 1.0,
                    payload: (),
                }
            })
            .collect();
        let members: Vec<u32> = (0..400).collect();
        let blend = |how: fn(&mut Tile, &[Ellipse<()>], &[u32], &mut Log)| {
            let (mut tile, mut log) = (Tile::default(), Log::default());
            tile.clear(0, 0);
            how(&mut tile, &ellipses, &members, &mut log);
            (tile, log)
        };
        let portable = blend(Tile::blend_lanes);
        assert!(portable.0.transmittance[8][8] < 0.5);
        // All light that does not pass is weight of some ellipse.
        let weights = portable.1.0.iter().filter(|(_, row, _)| *row == 8);
        let sum: f32 = weights.map(|(_, _, weight)| weight[8]).sum();
        assert!((sum + portable.0.transmittance[8][8] - 1.0).abs() < 1e-5);
        assert_eq!(portable, blend(Tile::blend));
        #[cfg(target_arch = "x86_64")]
        if is_x86_feature_detected!("avx2") {
            // SAFETY: the processor has AVX2.
            let how = |tile: &mut Tile, e: &[Ellipse<()>], m: &[u32], log: &mut Log| unsafe {
                tile.blend_avx2(e, m, log)
            };
            assert_eq!(portable, blend(how));
        }
    }
}
