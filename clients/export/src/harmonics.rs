//! Colours that turn with their Gaussians: spherical harmonics, rotated band by band.
//!
//! A colour `f` of directions that is turned by `R` is `g(d) = f(R^-1 d)`. Bands do not mix, and the coefficients of `g` are
//! the integrals of `g Y_i` over the sphere. The rule used for them is exact: four Gauss-Legendre heights and seven angles
//! integrate all polynomials up to degree 6, and the product of two harmonics of degree 3 has that.

use cosplat_renderer::sh::{MAX_COEFFICIENTS, basis};
use glam::{Quat, Vec3};

/// Heights and weights of the Gauss-Legendre rule with four points (Abramowitz and Stegun, table 25.4).
const HEIGHTS: [[f64; 2]; 4] = [
    [-0.861_136_311_594_053, 0.347_854_845_137_454],
    [-0.339_981_043_584_856, 0.652_145_154_862_546],
    [0.339_981_043_584_856, 0.652_145_154_862_546],
    [0.861_136_311_594_053, 0.347_854_845_137_454],
];
/// Angles around each.
const ANGLES: usize = 7;

/// Turns colours.
pub struct Turner {
    /// Directions, and the basis there times their weights.
    samples: Vec<(Vec3, [f32; MAX_COEFFICIENTS])>,
    /// Coefficients per channel.
    count: usize,
}

impl Turner {
    /// For colours of `count` coefficients per channel: 1, 4, 9 or 16.
    pub fn new(count: usize) -> Self {
        let samples = HEIGHTS.iter().flat_map(|&[z, weight]| {
            (0..ANGLES).map(move |k| {
                let (sin, cos) = (std::f64::consts::TAU * k as f64 / ANGLES as f64).sin_cos();
                let radius = (1.0 - z * z).sqrt();
                let direction = Vec3::new((radius * cos) as f32, (radius * sin) as f32, z as f32);
                let share = (weight * std::f64::consts::TAU / ANGLES as f64) as f32;
                (direction, basis(direction).map(|value| value * share))
            })
        });
        Self {
            samples: samples.collect(),
            count: count.min(MAX_COEFFICIENTS),
        }
    }

    /// Turns the colour `[coefficient][rgb]` of one Gaussian.
    pub fn turn(&self, color: &mut [f32], rotation: Quat) {
        if self.count < 2 || color.len() != 3 * self.count {
            return;
        }
        let back = rotation.inverse();
        let mut turned = [[0.0f32; 3]; MAX_COEFFICIENTS];
        for (direction, weighted) in &self.samples {
            let there = basis(back * *direction);
            let mut value = [0.0f32; 3];
            for (y, rgb) in there[..self.count]
                .iter()
                .zip(color.chunks_exact(3))
                .skip(1)
            {
                for channel in 0..3 {
                    value[channel] += y * rgb[channel];
                }
            }
            for (sum, y) in turned[..self.count].iter_mut().zip(weighted).skip(1) {
                for channel in 0..3 {
                    sum[channel] += y * value[channel];
                }
            }
        }
        // The first coefficient is the same from all sides.
        color[3..].copy_from_slice(&turned.as_flattened()[3..3 * self.count]);
    }
}

#[cfg(test)]
mod tests {
    use cosplat_renderer::Harmonics;

    use super::*;

    #[test]
    fn turned_colours_are_those_of_the_view_turned_back() {
        let rotation = Quat::from_euler(glam::EulerRot::XYZ, 0.7, -1.1, 2.3);
        for degree in 0..=3 {
            let count = (degree as usize + 1).pow(2);
            let own: Vec<f32> = (0..3 * count)
                .map(|k| ((k * 37 + 11) % 23) as f32 / 23.0 - 0.5)
                .collect();
            let mut turned = own.clone();
            Turner::new(count).turn(&mut turned, rotation);
            let (own, turned) = (
                Harmonics::new(degree, &own),
                Harmonics::new(degree, &turned),
            );
            let (own, turned) = (own.expect("a degree"), turned.expect("a degree"));
            for k in 0..50 {
                let (a, b) = (f32::from(k as u8) * 0.37, f32::from(k as u8) * 1.3);
                let direction = Vec3::new(a.cos() * b.cos(), a.sin() * b.cos(), b.sin());
                let expected = own.color(0, direction, rotation.to_array());
                let found = turned.color(0, direction, Quat::IDENTITY.to_array());
                let error = (expected.expect("a colour") - found.expect("a colour")).abs();
                // Rounding of f32 in sums of 28 times 16 terms of at most 1.
                assert!(error.max_element() < 2e-5, "degree {degree}: {error}");
            }
        }
    }
}
