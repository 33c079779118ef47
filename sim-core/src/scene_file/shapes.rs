//! Primitive shapes: volume, box, and the lattice of particles that fills them.

use rand_core::{Rng, SeedableRng};
use rand_pcg::Pcg64Mcg;

use super::spec::Shape;
use crate::{
    assets::{
        Gaussians,
        generate::{self, Style},
    },
    scene::{Aabb, RestParticles},
};

/// Particles are moved off their lattice site by at most this part of the spacing along each axis unless the file says
/// otherwise: enough to break the alignment with the grid, too little to leave the shape or to bring two of them together.
pub(super) const JITTER: f64 = 0.1;

impl Shape {
    /// The shape with all lengths multiplied.
    pub fn scaled(self, factor: f64) -> Self {
        let f = factor;
        match self {
            Self::Box { size } => Self::Box {
                size: size.map(|s| s * f),
            },
            Self::Sphere { radius } => Self::Sphere { radius: radius * f },
            Self::Cylinder {
                radius,
                inner_radius,
                height,
            } => Self::Cylinder {
                radius: radius * f,
                inner_radius: inner_radius * f,
                height: height * f,
            },
            Self::Slab { size, thickness } => Self::Slab {
                size: size.map(|s| s * f),
                thickness: thickness * f,
            },
        }
    }

    /// Exact volume [m^3].
    pub fn volume(&self) -> f64 {
        use std::f64::consts::PI;
        match *self {
            Self::Box { size: [x, y, z] } => x * y * z,
            Self::Sphere { radius } => 4.0 / 3.0 * PI * radius.powi(3),
            Self::Cylinder {
                radius,
                inner_radius,
                height,
            } => PI * (radius * radius - inner_radius * inner_radius) * height,
            Self::Slab {
                size: [x, z],
                thickness,
            } => x * thickness * z,
        }
    }

    /// Exact surface area [m^2].
    pub fn area(&self) -> f64 {
        use std::f64::consts::PI;
        let of_box = |[x, y, z]: [f64; 3]| 2.0 * (x * y + y * z + z * x);
        match *self {
            Self::Box { size } => of_box(size),
            Self::Sphere { radius } => 4.0 * PI * radius * radius,
            Self::Cylinder {
                radius,
                inner_radius,
                height,
            } => 2.0 * PI * (radius + inner_radius) * (radius - inner_radius + height),
            Self::Slab {
                size: [x, z],
                thickness,
            } => of_box([x, thickness, z]),
        }
    }

    /// Gaussians that show it.
    pub(super) fn surface(&self, style: &Style) -> Gaussians {
        match *self {
            Self::Box { size } => generate::surface_box(size, style),
            Self::Sphere { radius } => generate::surface_sphere(radius, style),
            Self::Cylinder {
                radius,
                inner_radius,
                height,
            } if inner_radius > 0.0 => {
                let (r, h) = ([inner_radius, radius], 0.5 * height);
                let profile = [[r[0], -h], [r[1], -h], [r[1], h], [r[0], h], [r[0], -h]];
                generate::surface_of_revolution(&profile, style)
            }
            Self::Cylinder { radius, height, .. } => {
                generate::surface_cylinder(radius, height, style)
            }
            Self::Slab { size, thickness } => generate::surface_slab(size, thickness, style),
        }
    }

    /// Exact box [m].
    pub fn bounds(&self) -> Aabb {
        let (half, top) = match *self {
            Self::Box { size: [x, y, z] } => ([x / 2.0, y / 2.0, z / 2.0], y / 2.0),
            Self::Sphere { radius: r } => ([r, r, r], r),
            Self::Cylinder { radius, height, .. } => ([radius, height / 2.0, radius], height / 2.0),
            Self::Slab {
                size: [x, z],
                thickness,
            } => ([x / 2.0, thickness / 2.0, z / 2.0], 0.0),
        };
        let bottom = top - 2.0 * half[1];
        Aabb {
            min: [-half[0], bottom, -half[2]],
            max: [half[0], top, half[2]],
        }
    }

    /// Where a particle goes when no site of the lattice is inside.
    fn inner_point(&self) -> [f64; 3] {
        match *self {
            Self::Cylinder {
                radius,
                inner_radius,
                ..
            } if inner_radius > 0.0 => [0.5 * (radius + inner_radius), 0.0, 0.0],
            _ => [0.0; 3],
        }
    }

    fn contains(&self, [x, y, z]: [f64; 3]) -> bool {
        match *self {
            Self::Sphere { radius } => x * x + y * y + z * z <= radius * radius,
            Self::Cylinder {
                radius,
                inner_radius,
                ..
            } => (inner_radius * inner_radius..=radius * radius).contains(&(x * x + z * z)),
            Self::Box { .. } | Self::Slab { .. } => true,
        }
    }

    /// A lattice of particles at about `spacing` [m], each up to `jitter` spacings off its site; equal volumes whose sum
    /// is the exact volume, and the exact centre of mass of the lattice.
    pub fn particles(&self, spacing: f64, jitter: f64, seed: u64) -> RestParticles {
        let Aabb { min, max } = self.bounds();
        // A whole number of sites per side: the outermost ones sit half a spacing inside the faces.
        let sites = [0, 1, 2].map(|i| ((max[i] - min[i]) / spacing).round().max(1.0));
        let step: [f64; 3] = std::array::from_fn(|i| (max[i] - min[i]) / sites[i]);
        let [nx, ny, nz] = sites.map(|n| n as usize);
        let mut position = Vec::with_capacity(nx * ny * nz);
        for i in 0..nx {
            for j in 0..ny {
                for k in 0..nz {
                    let site = [i, j, k].map(|s| s as f64 + 0.5);
                    let p = std::array::from_fn(|a| min[a] + step[a] * site[a]);
                    if self.contains(p) {
                        position.push(p);
                    }
                }
            }
        }
        if position.is_empty() {
            position.push(self.inner_point());
        }
        shake(&mut position, step.map(|s| s * jitter), seed);
        let volume = self.volume() / position.len() as f64;
        RestParticles {
            volume: vec![volume; position.len()],
            position,
        }
    }
}

/// Moves every point by at most `reach` [m] along each axis, and their mean not at all.
fn shake(position: &mut [[f64; 3]], reach: [f64; 3], seed: u64) {
    let mut rng = Pcg64Mcg::seed_from_u64(seed);
    let mut unit = || (rng.next_u64() >> 11) as f64 / (1u64 << 52) as f64 - 1.0;
    let shifts: Vec<[f64; 3]> = position.iter().map(|_| reach.map(|s| s * unit())).collect();
    let mean: [f64; 3] =
        std::array::from_fn(|a| shifts.iter().map(|s| s[a]).sum::<f64>() / shifts.len() as f64);
    for (p, shift) in position.iter_mut().zip(&shifts) {
        for a in 0..3 {
            p[a] += shift[a] - mean[a];
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SHAPES: [Shape; 5] = [
        Shape::Box {
            size: [0.2, 0.31, 0.4],
        },
        Shape::Sphere { radius: 0.15 },
        Shape::Cylinder {
            radius: 0.1,
            inner_radius: 0.0,
            height: 0.3,
        },
        Shape::Cylinder {
            radius: 0.1,
            inner_radius: 0.06,
            height: 0.3,
        },
        Shape::Slab {
            size: [0.5, 0.4],
            thickness: 0.07,
        },
    ];

    #[test]
    fn particles_have_the_exact_volume_and_the_wanted_density() {
        for shape in SHAPES {
            let spacing = 0.01;
            let particles = shape.particles(spacing, JITTER, 3);
            let total: f64 = particles.volume.iter().sum();
            // Summation of n equal numbers: relative error below n epsilon.
            assert!((total / shape.volume() - 1.0).abs() < 1e-10, "{shape:?}");
            let per_site = particles.volume[0] / spacing.powi(3);
            assert!((0.9..1.1).contains(&per_site), "{shape:?}: {per_site}");
        }
    }

    #[test]
    fn particles_stay_inside_and_centred() {
        for shape in SHAPES {
            let particles = shape.particles(0.01, JITTER, 3);
            let Aabb { min, max } = shape.bounds();
            for a in 0..3 {
                let n = particles.position.len() as f64;
                let mean = particles.position.iter().map(|p| p[a]).sum::<f64>() / n;
                assert!((mean - 0.5 * (min[a] + max[a])).abs() < 1e-12, "{shape:?}");
                let inside = |p: &[f64; 3]| (min[a]..=max[a]).contains(&p[a]);
                assert!(particles.position.iter().all(inside), "{shape:?}");
            }
        }
    }

    #[test]
    fn the_seed_moves_the_particles_and_repeats() {
        let shape = SHAPES[0];
        let a = shape.particles(0.02, JITTER, 1).position;
        assert_eq!(a, shape.particles(0.02, JITTER, 1).position);
        assert_ne!(a, shape.particles(0.02, JITTER, 2).position);
    }

    #[test]
    fn a_shape_smaller_than_the_spacing_still_has_a_particle() {
        for shape in SHAPES {
            assert!(!shape.particles(10.0, JITTER, 0).position.is_empty());
        }
    }
}
