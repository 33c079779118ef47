//! Colours of generated assets, with the light baked in as a capture would have it.

use super::SH_C0;

/// What a generated surface looks like.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Paint {
    /// One colour, RGB 0..=1.
    Plain([f32; 3]),
    /// Planks along x with grain.
    Wood,
    /// Glazed pottery around the y axis: a body colour, bands of a second colour, a soft highlight that moves
    /// with the viewer (spherical harmonics of degree 2).
    Glaze {
        /// Body colour, RGB 0..=1.
        body: [f32; 3],
        /// Colour of bands and rim, RGB 0..=1.
        band: [f32; 3],
        /// Height of the vessel in asset units, > 0; bands sit at fractions of it.
        height: f32,
    },
}

/// Direction to the light: above, to the right of and behind a camera that looks along -z.
const LIGHT: [f32; 3] = [0.424_264_07, std::f32::consts::FRAC_1_SQRT_2, 0.565_685_4];

impl Paint {
    /// Degree of the spherical harmonics that [`coefficients`](Self::coefficients) needs.
    pub(super) fn sh_degree(&self) -> u8 {
        match self {
            Self::Plain(_) | Self::Wood => 0,
            Self::Glaze { .. } => 2,
        }
    }

    /// Spherical harmonics of a surface point; `noise` is uniform in -1..=1.
    pub(super) fn coefficients(&self, p: [f32; 3], n: [f32; 3], noise: f32, sh: &mut Vec<f32>) {
        let lit = 0.62 + 0.38 * dot(n, LIGHT);
        let albedo = self.albedo(p, n, noise);
        let sheen = match self {
            Self::Glaze { .. } => Some(0.3),
            Self::Plain(_) | Self::Wood => None,
        };
        let Some(strength) = sheen else {
            sh.extend(albedo.map(|c| (c * lit - 0.5) / SH_C0));
            return;
        };
        // Seen from the mirror direction r, towards the eye v = -d, the highlight ((1 + v.r) / 2)^2 is never
        // negative and exactly of degree 2: 1/3 P0 + 1/2 P1(v.r) + 1/6 P2(v.r).
        let nl = dot(n, LIGHT);
        let r: [f32; 3] = std::array::from_fn(|i| 2.0 * nl * n[i] - LIGHT[i]);
        let glow = strength * nl.max(0.0);
        let basis = harmonics(r.map(|x| -x));
        for (k, y) in basis.iter().enumerate() {
            let (part, band) = match k {
                0 => (1.0 / 3.0, 1.0),
                1..4 => (0.5, 3.0),
                _ => (1.0 / 6.0, 5.0),
            };
            let four_pi = 4.0 * std::f32::consts::PI;
            let highlight = glow * part * four_pi / band * y;
            for c in albedo {
                let base = if k == 0 { (c * lit - 0.5) / SH_C0 } else { 0.0 };
                sh.push(base + highlight);
            }
        }
    }

    fn albedo(&self, p: [f32; 3], n: [f32; 3], noise: f32) -> [f32; 3] {
        match *self {
            Self::Plain(color) => color.map(|c| c * (1.0 + 0.02 * noise)),
            Self::Wood => wood(p, noise),
            Self::Glaze { body, band, height } => {
                let y = p[1] / height;
                let out = p[0] * n[0] + p[2] * n[2];
                let inside = out < 0.0 || (n[1] > 0.9 && y < 0.5);
                if inside {
                    // Light falls in through the opening only.
                    let depth = (1.0 - y).clamp(0.0, 1.0);
                    return body.map(|c| c * (0.75 - 0.5 * depth) * (1.0 + 0.02 * noise));
                }
                let angle = p[2].atan2(p[0]);
                let wave = 0.012 * (9.0 * angle).sin();
                let near = |at: f32, half: f32| (y - at - wave).abs() < half;
                let banded =
                    near(0.30, 0.018) || near(0.62, 0.035) || near(0.72, 0.008) || y > 0.965;
                let color = if banded { band } else { body };
                // The glaze runs thin towards the foot.
                let flow = 0.85 + 0.15 * (y * 1.6).min(1.0);
                color.map(|c| c * flow * (1.0 + 0.03 * noise))
            }
        }
    }
}

/// Planks 0.12 wide along x, each with its own tone, with growth rings bent by slow waves.
fn wood(p: [f32; 3], noise: f32) -> [f32; 3] {
    let plank = (p[2] / 0.12).floor();
    let tone = 0.5 + 0.5 * (plank * 12.9898 + 4.1).sin();
    let bend = 0.01 * (p[0] * 7.0 + plank * 1.7).sin() + 0.004 * (p[0] * 19.0 + plank).sin();
    let ring = ((p[2] + bend) * 260.0 + 3.0 * (p[0] * 3.0 + plank).sin()).sin();
    let seam = (p[2] / 0.12 - plank).min(plank + 1.0 - p[2] / 0.12);
    let dark = if seam < 0.02 { 0.7 } else { 1.0 };
    let shade = dark * (0.86 + 0.10 * tone + 0.07 * ring + 0.02 * noise);
    [0.66 * shade, 0.44 * shade, 0.26 * shade]
}

fn dot(a: [f32; 3], b: [f32; 3]) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// Real spherical harmonics of degree 0 to 2 in the order and with the signs of 3D Gaussian splatting.
fn harmonics([x, y, z]: [f32; 3]) -> [f32; 9] {
    const C1: f32 = 0.488_602_5;
    const C2: [f32; 3] = [1.092_548_5, 0.315_391_57, 0.546_274_24];
    [
        SH_C0,
        -C1 * y,
        C1 * z,
        -C1 * x,
        C2[0] * x * y,
        -C2[0] * y * z,
        C2[1] * (3.0 * z * z - 1.0),
        -C2[0] * x * z,
        C2[2] * (x * x - y * y),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// And never darkens.
    #[test]
    fn highlight_is_brightest_in_the_mirror_direction() {
        let glaze = Paint::Glaze {
            body: [0.5; 3],
            band: [0.5; 3],
            height: 1.0,
        };
        let n = [0.6, 0.8, 0.0];
        let mut sh = Vec::new();
        glaze.coefficients([1.0, 0.1, 0.0], n, 0.0, &mut sh);
        assert_eq!(sh.len(), 27);
        let nl = dot(n, LIGHT);
        let seen = |v: [f32; 3]| {
            let basis = harmonics(v.map(|x| -x));
            0.5 + basis
                .iter()
                .zip(sh.iter().step_by(3))
                .map(|(y, c)| y * c)
                .sum::<f32>()
        };
        let mirror: [f32; 3] = std::array::from_fn(|i| 2.0 * nl * n[i] - LIGHT[i]);
        let body = seen(mirror.map(|x| -x));
        assert!(
            (seen(mirror) - body - 0.3 * nl).abs() < 1e-5,
            "closed form of the lobe"
        );
        for i in 0..500 {
            let z = 1.0 - (2 * i + 1) as f32 / 500.0;
            let (s, c) = (i as f32 * 2.399_963_2).sin_cos();
            let ring = (1.0 - z * z).sqrt();
            let color = seen([ring * c, ring * s, z]);
            assert!(color > body - 1e-5 && color < seen(mirror) + 1e-5);
        }
    }
}
