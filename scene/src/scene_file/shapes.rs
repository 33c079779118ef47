//! Primitive shapes: volume, box, and the lattice of particles that fills them.

use cosplat_sim_core::{
    distance::SignedDistance,
    scene::{Aabb, ColliderShape, RestParticles},
};
use rand_core::{Rng, SeedableRng};
use rand_pcg::Pcg64Mcg;

use super::{
    solids::{Solid, sites},
    spec::Shape,
};
use crate::{
    assets::{
        Gaussians,
        generate::{self, Style},
    },
    fill::sites::{Site, join_slivers},
};

/// Particles are moved off their lattice site by at most this part of the spacing along each axis unless the file says
/// otherwise: enough to break the alignment with the grid, too little to leave the shape or to bring two of them together.
pub(super) const JITTER: f64 = 0.1;
/// Points per axis at which a site that a surface cuts is looked at: its volume to about a hundredth.
const POINTS: usize = 8;

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

    /// What is farther than `wall` [m] from its surface; none where nothing is, or where that is no such shape.
    pub fn shrunk(self, wall: f64) -> Option<Self> {
        let less = |length: f64| Some(length - 2.0 * wall).filter(|length| *length > 0.0);
        Some(match self {
            Self::Box { size: [x, y, z] } => Self::Box {
                size: [less(x)?, less(y)?, less(z)?],
            },
            Self::Sphere { radius } => Self::Sphere {
                radius: 0.5 * less(2.0 * radius)?,
            },
            Self::Cylinder {
                radius,
                inner_radius: 0.0,
                height,
            } => Self::Cylinder {
                radius: 0.5 * less(2.0 * radius)?,
                inner_radius: 0.0,
                height: less(height)?,
            },
            Self::Slab {
                size: [x, z],
                thickness,
            } => Self::Slab {
                size: [less(x)?, less(z)?],
                thickness: less(thickness)?,
            },
            Self::Cylinder { .. } => return None,
        })
    }

    /// The shape as a shell of this thickness [m]; none where [`shrunk`](Self::shrunk) leaves no cavity.
    pub(super) fn hollow(self, wall: f64) -> Option<Solid> {
        let cavity = self.shrunk(wall)?;
        let bounds = self.bounds();
        let origin = std::array::from_fn(|a| 0.5 * (bounds.min[a] + bounds.max[a]));
        let half_extents = std::array::from_fn(|a| 0.5 * (bounds.max[a] - bounds.min[a]));
        let surface = match self {
            Self::Sphere { radius } => ColliderShape::Sphere { radius },
            Self::Cylinder { radius, height, .. } => ColliderShape::Cylinder {
                radius,
                half_height: 0.5 * height,
            },
            Self::Box { .. } | Self::Slab { .. } => ColliderShape::Box { half_extents },
        };
        Some(Solid {
            surface: SignedDistance::new(&surface),
            origin,
            bounds,
            wall,
            exact: Some((self.volume() - cavity.volume(), origin)),
        })
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

    /// Distance of a point from the curved surfaces, negative inside [m]; flat ones lie between sites.
    fn distance(&self, [x, y, z]: [f64; 3]) -> f64 {
        match *self {
            Self::Sphere { radius } => (x * x + y * y + z * z).sqrt() - radius,
            Self::Cylinder {
                radius,
                inner_radius,
                ..
            } => {
                let r = x.hypot(z);
                if inner_radius > 0.0 {
                    (r - radius).max(inner_radius - r)
                } else {
                    r - radius
                }
            }
            Self::Box { .. } | Self::Slab { .. } => f64::NEG_INFINITY,
        }
    }

    /// A lattice of particles, see `lattice`. Volumes add up to the exact volume; the centre of mass is that of the shape.
    pub fn particles(&self, spacing: f64, jitter: f64, seed: u64) -> RestParticles {
        let bounds = self.bounds();
        let part = |middle, step| self.part(middle, step);
        let mut particles = lattice(&bounds, part, spacing, jitter, seed);
        let Aabb { min, max } = bounds;
        let middle = std::array::from_fn(|a| 0.5 * (min[a] + max[a]));
        if particles.position.is_empty() {
            // A wall too thin for all points: one particle, which ends up at the centre of mass.
            particles.position.push(middle);
            particles.volume.push(self.volume());
        }
        normalise(&mut particles, self.volume(), middle);
        particles
    }

    /// What is inside of a box with edges `step` around `middle`.
    fn part(&self, middle: [f64; 3], step: [f64; 3]) -> Site {
        let mut site = Site::default();
        let distance = self.distance(middle);
        let reach = 0.5 * step.iter().map(|s| s * s).sum::<f64>().sqrt();
        if distance <= -reach {
            site.add(middle, step[0] * step[1] * step[2]);
        } else if distance < reach {
            let part = step.map(|s| s / POINTS as f64);
            let volume = part[0] * part[1] * part[2];
            for i in 0..POINTS.pow(3) {
                let at = [i % POINTS, i / POINTS % POINTS, i / POINTS.pow(2)];
                let x = std::array::from_fn(|a| {
                    middle[a] + part[a] * (at[a] as f64 + 0.5 - 0.5 * POINTS as f64)
                });
                if self.distance(x) <= 0.0 {
                    site.add(x, volume);
                }
            }
        }
        site
    }
}

/// A lattice of particles in a box at about `spacing` [m], each up to `jitter` spacings off its site, of what `part` tells of
/// the box with these edges around this middle. Where a surface cuts a site, its particle has the volume and the centroid of
/// what is inside, so that the surface of the matter is where that of the shape is.
pub(super) fn lattice(
    bounds: &Aabb,
    part: impl Fn([f64; 3], [f64; 3]) -> Site + Sync,
    spacing: f64,
    jitter: f64,
    seed: u64,
) -> RestParticles {
    let Aabb { min, max } = *bounds;
    // A whole number of sites per side: flat faces lie between sites.
    let count = [0, 1, 2].map(|i| ((max[i] - min[i]) / spacing).round().max(1.0));
    let step: [f64; 3] = std::array::from_fn(|i| (max[i] - min[i]) / count[i]);
    let [nx, ny, nz] = count.map(|n| n as usize);
    let full = step[0] * step[1] * step[2];
    let mut filled = sites([nx, ny, nz], &|site: [usize; 3]| {
        let site = site.map(|s| s as f64 + 0.5);
        part(std::array::from_fn(|a| min[a] + step[a] * site[a]), step)
    });
    // Particles are numbered along z first.
    join_slivers([nz, ny, nx], &mut filled, full);
    filled.retain(|site| site.volume > 0.0);
    let mut rng = Pcg64Mcg::seed_from_u64(seed);
    let mut position: Vec<[f64; 3]> = Vec::with_capacity(filled.len());
    for site in &filled {
        let whole = (site.volume - full).abs() < 1e-6 * full;
        let reach = if whole { jitter } else { 0.0 };
        position.push(std::array::from_fn(|a| {
            let unit = (rng.next_u64() >> 11) as f64 / (1u64 << 52) as f64 - 1.0;
            site.moment[a] / site.volume + reach * step[a] * unit
        }));
    }
    let volume = filled.iter().map(|site| site.volume).collect();
    RestParticles { position, volume }
}

/// Scales the volumes of particles and moves all of them such that together they have this volume [m^3] and centroid [m].
pub(super) fn normalise(particles: &mut RestParticles, volume: f64, centroid: [f64; 3]) {
    let total: f64 = particles.volume.iter().sum();
    for v in &mut particles.volume {
        *v = *v * volume / total;
    }
    for (a, middle) in centroid.into_iter().enumerate() {
        let moments = particles.position.iter().zip(&particles.volume);
        let off = moments.map(|(p, v)| p[a] * v).sum::<f64>() / volume - middle;
        particles.position.iter_mut().for_each(|p| p[a] -= off);
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
            // A site and what is joined to it from at most six sides; nothing below a sliver.
            let mut full = 0;
            for v in &particles.volume {
                let part = v / spacing.powi(3);
                assert!((0.13..2.0).contains(&part), "{shape:?}: {part}");
                full += usize::from((0.9..1.1).contains(&part));
            }
            assert!(2 * full > particles.volume.len(), "{shape:?}: {full}");
        }
    }

    #[test]
    fn particles_stay_inside_and_centred() {
        for shape in SHAPES {
            let particles = shape.particles(0.01, JITTER, 3);
            let Aabb { min, max } = shape.bounds();
            for a in 0..3 {
                let moments = particles.position.iter().zip(&particles.volume);
                let mean = moments.map(|(p, v)| p[a] * v).sum::<f64>() / shape.volume();
                assert!((mean - 0.5 * (min[a] + max[a])).abs() < 1e-12, "{shape:?}");
                let inside = |p: &[f64; 3]| (min[a]..=max[a]).contains(&p[a]);
                assert!(particles.position.iter().all(inside), "{shape:?}");
            }
        }
    }

    #[test]
    fn a_hollow_shape_has_the_volume_and_the_inertia_of_its_wall() {
        for shape in [SHAPES[0], SHAPES[1], SHAPES[2], SHAPES[4]] {
            let (wall, spacing) = (0.025, 0.01);
            let cavity = shape.shrunk(wall).expect("room");
            let solid = shape.hollow(wall).expect("room");
            let particles = solid.particles(spacing, 0.0, 0).0;
            let (mut square, mut volume) = (0.0, 0.0);
            for (p, v) in particles.position.iter().zip(&particles.volume) {
                square += v * (p[0] * p[0] + p[2] * p[2] + v.cbrt().powi(2) / 6.0);
                volume += v;
            }
            let exact = shape.volume() - cavity.volume();
            assert!((volume / exact - 1.0).abs() < 1e-10, "{shape:?}");
            let about_y = |shape: &Shape| {
                shape.volume()
                    * match *shape {
                        Shape::Sphere { radius } => 0.4 * radius * radius,
                        Shape::Cylinder { radius, .. } => 0.5 * radius * radius,
                        Shape::Box { size: [x, _, z] } | Shape::Slab { size: [x, z], .. } => {
                            (x * x + z * z) / 12.0
                        }
                    }
            };
            let expected = about_y(&shape) - about_y(&cavity);
            // Sites 2.5 spacings deep; 0.5 % as for whole shapes at that resolution.
            assert!(
                (square / expected - 1.0).abs() < 0.01,
                "{shape:?}: {}",
                square / expected
            );
        }
        assert!(SHAPES[1].hollow(0.15).is_none() && SHAPES[3].hollow(0.01).is_none());
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

    /// At every resolution.
    #[test]
    fn balls_and_drums_have_the_inertia_of_their_shape() {
        for cells in [5.0, 7.3, 12.0, 20.0] {
            for shape in [SHAPES[1], SHAPES[2], SHAPES[3]] {
                let spacing = 2.0 * shape.bounds().max[0] / cells;
                let particles = shape.particles(spacing, 0.0, 0);
                let (mut square, mut volume) = (0.0, 0.0);
                for (p, v) in particles.position.iter().zip(&particles.volume) {
                    // The part of each particle's own is that of a cube.
                    square += v * (p[0] * p[0] + p[2] * p[2] + v.cbrt().powi(2) / 6.0);
                    volume += v;
                }
                let expected = match shape {
                    Shape::Sphere { radius } => 0.4 * radius * radius,
                    Shape::Cylinder {
                        radius,
                        inner_radius,
                        ..
                    } => 0.5 * (radius * radius + inner_radius * inner_radius),
                    _ => unreachable!("no ball and no drum"),
                };
                let off = square / volume / expected - 1.0;
                // Measured: 0.5 % at 5 cells, 0.02 % at 20.
                assert!(off.abs() < 0.01, "{shape:?}, {cells}: {off}");
            }
        }
    }
}
