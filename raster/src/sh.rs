//! Colour of a Gaussian as a function of the view direction: real spherical harmonics up to degree 3.

use glam::{Quat, Vec3};

/// Largest number of coefficients per colour channel, degree 3.
pub const MAX_COEFFICIENTS: usize = 16;

/// The `scene/sh` block: per Gaussian `[(degree + 1)^2][rgb]`, the constant term first.
#[derive(Clone, Copy, Debug)]
pub struct Harmonics<'a> {
    coefficients: &'a [f32],
    bands: usize,
}

impl<'a> Harmonics<'a> {
    /// View of the block `coefficients` of degree `degree`; `None` when the degree is above 3.
    pub fn new(degree: u32, coefficients: &'a [f32]) -> Option<Self> {
        (degree <= 3).then_some(Self {
            coefficients,
            bands: degree as usize + 1,
        })
    }

    /// Colour of Gaussian `index`, 0.. per channel, seen along `direction` (unit, from the eye, world frame) when it
    /// is turned by `rotation` (world-from-asset, xyzw). `None` when the block has no finite colour for it.
    pub fn color(&self, index: u32, direction: Vec3, rotation: [f32; 4]) -> Option<Vec3> {
        let count = self.bands * self.bands;
        let first = (index as usize).checked_mul(3 * count)?;
        let own = self
            .coefficients
            .get(first..first.checked_add(3 * count)?)?;
        let rotation = Quat::from_array(rotation);
        let length = rotation.length_squared();
        // An unset rotation means "not turned"; anything else is brought back to unit length.
        let direction = if length.is_finite() && length > 1e-12 {
            (rotation * (1.0 / length.sqrt())).inverse() * direction
        } else {
            direction
        };
        let basis = basis(direction);
        let mut sum = Vec3::splat(0.5);
        for (value, rgb) in basis[..count].iter().zip(own.chunks_exact(3)) {
            sum += *value * Vec3::new(rgb[0], rgb[1], rgb[2]);
        }
        sum.is_finite().then(|| sum.max(Vec3::ZERO))
    }
}

/// Orthonormal real spherical harmonics at the unit vector `d`, ordered (l, m) = (0,0), (1,-1), (1,0), (1,1), ...
/// with the Condon-Shortley sign of trained splats (Kerbl et al. 2023).
pub fn basis(d: Vec3) -> [f32; MAX_COEFFICIENTS] {
    let Vec3 { x, y, z } = d;
    let (xx, yy, zz) = (x * x, y * y, z * z);
    [
        0.282_094_8,
        -0.488_602_5 * y,
        0.488_602_5 * z,
        -0.488_602_5 * x,
        1.092_548_5 * x * y,
        -1.092_548_5 * y * z,
        0.315_391_57 * (2.0 * zz - xx - yy),
        -1.092_548_5 * x * z,
        0.546_274_24 * (xx - yy),
        -0.590_043_6 * y * (3.0 * xx - yy),
        2.890_611_4 * x * y * z,
        -0.457_045_8 * y * (4.0 * zz - xx - yy),
        0.373_176_34 * z * (2.0 * zz - 3.0 * xx - 3.0 * yy),
        -0.457_045_8 * x * (4.0 * zz - xx - yy),
        1.445_305_7 * z * (xx - yy),
        -0.590_043_6 * x * (xx - 3.0 * yy),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Nodes and weights of 8-point Gauss-Legendre on -1..1 (Abramowitz and Stegun, table 25.4): exact for
    /// polynomials up to degree 15; the products below have degree 6.
    const GAUSS: [(f64, f64); 4] = [
        (0.183_434_642_495_650, 0.362_683_783_378_362),
        (0.525_532_409_916_329, 0.313_706_645_877_887),
        (0.796_666_477_413_627, 0.222_381_034_453_374),
        (0.960_289_856_497_536, 0.101_228_536_290_376),
    ];

    fn sphere() -> impl Iterator<Item = (Vec3, f64)> {
        let around = 16;
        GAUSS
            .iter()
            .flat_map(|&(z, weight)| [(z, weight), (-z, weight)])
            .flat_map(move |(z, weight)| {
                (0..around).map(move |k| {
                    let angle = std::f64::consts::TAU * (f64::from(k) + 0.5) / f64::from(around);
                    let radius = (1.0 - z * z).sqrt();
                    let d = Vec3::new(
                        (radius * angle.cos()) as f32,
                        (radius * angle.sin()) as f32,
                        z as f32,
                    );
                    (d, weight * std::f64::consts::TAU / f64::from(around))
                })
            })
    }

    #[test]
    fn the_basis_is_orthonormal_on_the_sphere() {
        for i in 0..MAX_COEFFICIENTS {
            for j in 0..MAX_COEFFICIENTS {
                let product: f64 = sphere()
                    .map(|(d, weight)| {
                        let b = basis(d);
                        weight * f64::from(b[i]) * f64::from(b[j])
                    })
                    .sum();
                let expected = if i == j { 1.0 } else { 0.0 };
                // The quadrature is exact; what is left is f32 rounding of the basis.
                assert!((product - expected).abs() < 1e-6, "{i} {j} {product}");
            }
        }
    }

    #[test]
    fn low_degrees_have_the_signs_of_trained_splats() {
        // Kerbl et al. 2023: colour = C0 s0 - C1 y s1 + C1 z s2 - C1 x s3 + ...
        let b = basis(Vec3::X);
        assert!(b[3] < 0.0 && b[1] == 0.0 && b[2] == 0.0);
        assert!(basis(Vec3::Y)[1] < 0.0);
        assert!(basis(Vec3::Z)[2] > 0.0);
    }

    /// Rotation matrix of band `l` from the definition: D[i][j] = integral of Y_i(R d) Y_j(d).
    fn band_rotation(l: usize, rotation: Quat) -> Vec<Vec<f64>> {
        let (first, size) = (l * l, 2 * l + 1);
        let mut matrix = vec![vec![0.0; size]; size];
        for (d, weight) in sphere() {
            let (turned, plain) = (basis(rotation * d), basis(d));
            for i in 0..size {
                for j in 0..size {
                    matrix[i][j] +=
                        weight * f64::from(turned[first + i]) * f64::from(plain[first + j]);
                }
            }
        }
        matrix
    }

    #[test]
    fn turning_the_view_back_equals_rotating_the_coefficients() {
        let rotation = Quat::from_euler(glam::EulerRot::XYZ, 0.7, -1.1, 2.3);
        let own: Vec<f32> = (0..48)
            .map(|k| ((k * 37 + 11) % 23) as f32 / 23.0 - 0.5)
            .collect();
        // The function g(d) = f(R^-1 d) has coefficients D c, band by band.
        let mut rotated = own.clone();
        for l in 0..=3 {
            let matrix = band_rotation(l, rotation);
            for (i, row) in matrix.iter().enumerate() {
                for channel in 0..3 {
                    let sum: f64 = row
                        .iter()
                        .enumerate()
                        .map(|(j, d)| d * f64::from(own[3 * (l * l + j) + channel]))
                        .sum();
                    rotated[3 * (l * l + i) + channel] = sum as f32;
                }
            }
        }
        let (own, rotated) = (Harmonics::new(3, &own), Harmonics::new(3, &rotated));
        let (own, rotated) = (own.unwrap(), rotated.unwrap());
        let identity = [0.0, 0.0, 0.0, 1.0];
        let mut brightest = 0f32;
        for (d, _) in sphere() {
            let a = own.color(0, d, rotation.to_array()).unwrap();
            let b = rotated.color(0, d, identity).unwrap();
            brightest = brightest.max(a.max_element());
            assert!((a - b).abs().max_element() < 1e-5, "{a} {b}");
        }
        assert!(
            brightest > 1.0,
            "the test function is too flat to tell rotations apart"
        );
    }

    #[test]
    fn bad_indices_and_values_give_no_color() {
        let block = [1.0, 2.0, 3.0, f32::NAN, 0.0, 0.0];
        let sh = Harmonics::new(0, &block).unwrap();
        assert!(sh.color(0, Vec3::Z, [0.0; 4]).is_some());
        assert!(sh.color(0, Vec3::Z, [f32::NAN; 4]).is_some());
        assert!(sh.color(1, Vec3::Z, [0.0; 4]).is_none());
        assert!(sh.color(2, Vec3::Z, [0.0; 4]).is_none());
        assert!(sh.color(u32::MAX, Vec3::Z, [0.0; 4]).is_none());
        assert!(Harmonics::new(4, &block).is_none());
    }
}
