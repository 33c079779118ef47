//! Sixteen bytes for a Gaussian: its place in the box of its object, and the Cholesky factor of its covariance.
//!
//! Little-endian, from the lowest bit: three times 16 bits of position in the box, 8 bits of exponent `e`, then
//! `l00 l10 l20 l11 l21 l22` with 12 bits each, in units of `2^(e - 128)`. Diagonal entries go from 0 to 1, the others from
//! -1 to 1. `e` is 0 for what cannot be drawn. A factor is always that of a covariance, whatever rounding does to it.

use cosplat_ipc::schema::GaussianState;

/// Bytes of a packed Gaussian.
pub const BYTES: usize = 16;
/// Largest value of 12 bits, and the value that stands for 0 where a sign is needed.
const FULL: f32 = 4095.0;
const ZERO: f32 = 2048.0;
const HALF: f32 = 2047.0;

/// The box that positions are counted in.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Bounds {
    /// Smallest corner [m].
    pub low: [f32; 3],
    /// Edge lengths [m]; 0 where all positions are equal.
    pub extent: [f32; 3],
}

impl Bounds {
    /// The smallest box round all positions that are finite.
    pub fn of(gaussians: &[GaussianState]) -> Bounds {
        let quick = corners(gaussians.iter().map(|gaussian| gaussian.position));
        let [low, high] = match quick.as_flattened().iter().all(|x| x.is_finite()) {
            true => quick,
            false => corners(gaussians.iter().map(|gaussian| {
                let finite = |x: f32| if x.is_finite() { x } else { f32::NAN };
                gaussian.position.map(finite)
            })),
        };
        let mut bounds = Bounds::default();
        for axis in 0..3 {
            if low[axis] <= high[axis] {
                bounds.low[axis] = low[axis];
                // Positions at both ends of what `f32` holds are further apart than it holds.
                bounds.extent[axis] = (high[axis] - low[axis]).min(f32::MAX);
            }
        }
        bounds
    }

    /// Levels per length [1/m]; 0 where all positions are equal.
    fn scale(&self) -> [f32; 3] {
        self.extent.map(|extent| match extent > 0.0 {
            true => 65_535.0 / extent,
            false => 0.0,
        })
    }
}

/// Smallest and largest of each coordinate; what is no number changes neither.
fn corners(positions: impl Iterator<Item = [f32; 3]>) -> [[f32; 3]; 2] {
    let (mut low, mut high) = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]);
    for position in positions {
        for axis in 0..3 {
            let x = position[axis];
            low[axis] = if x < low[axis] { x } else { low[axis] };
            high[axis] = if x > high[axis] { x } else { high[axis] };
        }
    }
    [low, high]
}

/// Lower triangle `l00 l10 l20 l11 l21 l22` of a covariance xx xy xz yy yz zz: `L L^T` is the covariance. Where it has no
/// positive part left along an axis, that column is 0.
#[inline(always)]
fn cholesky([xx, xy, xz, yy, yz, zz]: [f32; 6]) -> [f32; 6] {
    let column = |diagonal: f32| {
        let root = if diagonal > 0.0 { diagonal } else { 0.0 }.sqrt();
        (root, if root > 0.0 { 1.0 / root } else { 0.0 })
    };
    let (l00, inverse) = column(xx);
    let (l10, l20) = (xy * inverse, xz * inverse);
    let (l11, inverse) = column(yy - l10 * l10);
    let l21 = (yz - l20 * l10) * inverse;
    let (l22, _) = column(zz - l20 * l20 - l21 * l21);
    [l00, l10, l20, l11, l21, l22]
}

/// The four words of a Gaussian, without a branch.
#[inline(always)]
fn words(position: [f32; 3], covariance: [f32; 6], low: [f32; 3], scale: [f32; 3]) -> [u32; 4] {
    let factor = cholesky(covariance);
    let larger = |most: f32, l: f32| if l.abs() > most { l.abs() } else { most };
    let largest = factor.into_iter().fold(0.0, larger);
    // Zero times anything but a finite number is not zero.
    let zero = |sum: f32, x: f32| sum + x * 0.0;
    let zeros = position.into_iter().fold(0.0, zero);
    let zeros = covariance.into_iter().chain(factor).fold(zeros, zero);
    let is_drawn = (zeros == 0.0) & (largest > 0.0);
    // The power of two above the largest entry; its exponent is that of the number, one more where that is not a power.
    let above = (largest.to_bits() >> 23) as i32 - 127 + 1;
    let exponent = above.clamp(-126, 126);
    let unit = f32::from_bits(((127 - exponent) as u32) << 23);
    let at = |axis: usize| {
        let level = (position[axis] - low[axis]) * scale[axis];
        (level.clamp(0.0, 65_535.0) + 0.5) as i32 as u32
    };
    let diagonal = |l: f32| ((l * unit).clamp(0.0, 1.0) * FULL + 0.5) as i32 as u32;
    let other = |l: f32| ((l * unit).clamp(-1.0, 1.0) * HALF + ZERO + 0.5) as i32 as u32;
    let [l00, l10, l20, l11, l21, l22] = factor;
    let (l00, l11, l22) = (diagonal(l00), diagonal(l11), diagonal(l22));
    let (l10, l20, l21) = (other(l10), other(l20), other(l21));
    let all = [
        at(0) | at(1) << 16,
        at(2) | ((exponent + 128) as u32) << 16 | l00 << 24,
        l00 >> 8 | l10 << 4 | l20 << 16 | l11 << 28,
        l11 >> 4 | l21 << 8 | l22 << 20,
    ];
    all.map(|word| if is_drawn { word } else { 0 })
}

/// Packs a Gaussian; all zeros where it has no finite position or covariance.
pub fn pack(gaussian: &GaussianState, bounds: &Bounds) -> u128 {
    let (low, scale) = (bounds.low, bounds.scale());
    let words = words(gaussian.position, gaussian.covariance, low, scale);
    (0..4).fold(0, |all, n| all | u128::from(words[n]) << (32 * n))
}

/// Packs Gaussians as [`pack`] does, each into its bytes of `packed`, which are as many.
pub fn pack_all(gaussians: &[GaussianState], bounds: &Bounds, packed: &mut [[u8; BYTES]]) {
    let (low, scale) = (bounds.low, bounds.scale());
    for (gaussian, packed) in gaussians.iter().zip(packed) {
        let words = words(gaussian.position, gaussian.covariance, low, scale);
        for (place, word) in packed.as_chunks_mut::<4>().0.iter_mut().zip(words) {
            *place = word.to_le_bytes();
        }
    }
}

/// Position [m] and covariance xx xy xz yy yz zz [m^2] of a packed Gaussian; `None` for one that cannot be drawn.
pub fn unpack(packed: u128, bounds: &Bounds) -> Option<([f32; 3], [f32; 6])> {
    let exponent = (packed >> 48) as u8;
    if exponent == 0 {
        return None;
    }
    let position = [0, 1, 2].map(|axis| {
        let level = (packed >> (16 * axis)) as u16;
        let share = f64::from(level) / 65_535.0;
        (f64::from(bounds.low[axis]) + f64::from(bounds.extent[axis]) * share) as f32
    });
    let unit = f64::from(i32::from(exponent) - 128).exp2();
    let entry = |place: usize| {
        let level = ((packed >> (56 + 12 * place)) & 0xfff) as f64;
        unit * match place {
            0 | 3 | 5 => level / f64::from(FULL),
            _ => (level - f64::from(ZERO)) / f64::from(HALF),
        }
    };
    let [l00, l10, l20, l11, l21, l22] = [0, 1, 2, 3, 4, 5].map(entry);
    let covariance = [
        l00 * l00,
        l00 * l10,
        l00 * l20,
        l10 * l10 + l11 * l11,
        l10 * l20 + l11 * l21,
        l20 * l20 + l21 * l21 + l22 * l22,
    ];
    Some((position, covariance.map(|x| x as f32)))
}

/// A unit quaternion xyzw in 32 bits: 2 say which component is the largest, and each of the others, from -1 to 1 over the
/// root of 2, has 10. A rotation that is unset or not finite is none.
#[inline]
pub fn pack_rotation(rotation: [f32; 4]) -> u32 {
    let length = rotation.iter().map(|x| x * x).sum::<f32>().sqrt();
    let unit = match length.is_finite() && length > 1e-6 {
        true => rotation.map(|x| x / length),
        false => [0.0, 0.0, 0.0, 1.0],
    };
    let mut largest = 3;
    for place in 0..3 {
        if unit[place].abs() > unit[largest].abs() {
            largest = place;
        }
    }
    let sign = if unit[largest] < 0.0 { -1.0 } else { 1.0 };
    let mut packed = (largest as u32) << 30;
    let others = (0..4).filter(|place| *place != largest);
    for (n, place) in others.enumerate() {
        let share = (sign * unit[place] * std::f32::consts::SQRT_2).clamp(-1.0, 1.0);
        packed |= ((share * 511.0 + 512.5) as u32 & 0x3ff) << (10 * n);
    }
    packed
}

#[cfg(test)]
mod tests {
    use super::*;

    fn turned(angle: f64, [a, b, c]: [f64; 3]) -> [f32; 6] {
        let (s, k) = angle.sin_cos();
        // Axes a, b, c, turned by `angle` about z and then as much about x.
        let axes = [
            [k * a, s * k * a, s * s * a],
            [-s * b, k * k * b, k * s * b],
            [0.0, -s * c, k * c],
        ];
        let sum = |i: usize, j: usize| axes.iter().map(|v| v[i] * v[j]).sum::<f64>() as f32;
        [
            sum(0, 0),
            sum(0, 1),
            sum(0, 2),
            sum(1, 1),
            sum(1, 2),
            sum(2, 2),
        ]
    }

    fn some() -> Vec<GaussianState> {
        (0..500)
            .map(|n| {
                let f = f64::from(n);
                let size = 1e-4 * (1.0 + f);
                GaussianState {
                    position: [f.sin() as f32, (2.0 * f).cos() as f32, 0.01 * f as f32],
                    covariance: turned(f, [size, 0.5 * size, 0.02 * size]),
                    ..Default::default()
                }
            })
            .collect()
    }

    #[test]
    fn packed_gaussians_come_back_within_their_levels() {
        let gaussians = some();
        let bounds = Bounds::of(&gaussians);
        for gaussian in &gaussians {
            let (position, covariance) =
                unpack(pack(gaussian, &bounds), &bounds).expect("one that can be drawn");
            for axis in 0..3 {
                let error = (position[axis] - gaussian.position[axis]).abs();
                // Half a level, and the rounding of `f32` at 5 m.
                assert!(error <= 0.5 * bounds.extent[axis] / 65_535.0 + 5e-7);
            }
            let [xx, _, _, yy, _, zz] = gaussian.covariance;
            let size = xx.max(yy).max(zz);
            for (ours, theirs) in covariance.iter().zip(gaussian.covariance) {
                // An entry of the factor is off by a 4095th of the power of two above the largest, at most twice
                // that one; three products of two entries each are off by as much twice.
                assert!((ours - theirs).abs() < 3.0 * 2.0 * 2.0 / 4095.0 * size);
            }
        }
    }

    #[test]
    fn what_is_not_finite_or_has_no_size_is_packed_as_nothing() {
        let good = some()[3];
        let bounds = Bounds::of(&[good]);
        assert_ne!(pack(&good, &bounds), 0);
        let mut bad = [good; 4];
        bad[0].position[1] = f32::NAN;
        bad[1].covariance[4] = f32::INFINITY;
        bad[2].covariance = [0.0; 6];
        bad[3].covariance = [-1.0; 6];
        for gaussian in bad {
            assert_eq!(unpack(pack(&gaussian, &bounds), &bounds), None);
        }
    }

    #[test]
    fn many_at_once_are_packed_as_one_by_one() {
        let mut gaussians = some();
        gaussians[17].position[2] = f32::NAN;
        gaussians[490].covariance[0] = f32::INFINITY;
        let bounds = Bounds::of(&gaussians);
        assert!(bounds.extent.iter().all(|x| *x > 0.0));
        let mut packed = vec![[9; BYTES]; gaussians.len()];
        pack_all(&gaussians, &bounds, &mut packed);
        for (gaussian, packed) in gaussians.iter().zip(packed) {
            assert_eq!(u128::from_le_bytes(packed), pack(gaussian, &bounds));
        }
    }

    #[test]
    fn any_bits_are_packed_without_a_panic() {
        let mut state = 7u32;
        let mut next = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            f32::from_bits(state)
        };
        for _ in 0..20_000 {
            let gaussian = GaussianState {
                position: [0; 3].map(|_| next()),
                covariance: [0; 6].map(|_| next()),
                rotation: [0; 4].map(|_| next()),
                ..Default::default()
            };
            let bounds = Bounds::of(&[gaussian, some()[0]]);
            assert!(bounds.extent.iter().all(|x| x.is_finite()));
            let packed = pack(&gaussian, &bounds);
            if let Some((position, covariance)) = unpack(packed, &bounds) {
                assert!(position.iter().chain(&covariance).all(|x| !x.is_nan()));
            }
            pack_rotation(gaussian.rotation);
        }
    }

    #[test]
    fn rotations_come_back_within_a_third_of_a_degree() {
        for n in 0..2000 {
            let f = n as f32;
            let q = [f.sin(), (1.7 * f).cos(), (0.3 * f).sin(), (2.9 * f).cos()];
            let length = q.iter().map(|x| x * x).sum::<f32>().sqrt();
            let packed = pack_rotation(q);
            let largest = (packed >> 30) as usize;
            let mut back = [0f32; 4];
            let mut rest = 1.0f32;
            for (n, place) in (0..4).filter(|p| *p != largest).enumerate() {
                let level = (packed >> (10 * n)) & 0x3ff;
                back[place] = (level as f32 - 512.0) / 511.0 / std::f32::consts::SQRT_2;
                rest -= back[place] * back[place];
            }
            back[largest] = rest.max(0.0).sqrt();
            let products = back.iter().zip(q).map(|(a, b)| f64::from(a * b / length));
            let dot = products.sum::<f64>().abs().min(1.0);
            // Half a level of 0.00138 in each of three components, 0.0012 in all. The largest, at least a half, makes up for
            // it by at most 3 / 2 * 0.00069 / 0.5. Both together, 0.0024, turn by twice that: 0.28 degrees.
            assert!(2.0 * dot.acos() < 0.3f64.to_radians(), "{n}: {dot}");
        }
    }
}
