//! The measured scene: a jittered block of particles falls, spinning, onto a slipping floor.

use cosplat_sim_core::{
    Scene,
    materials::{Law, Material},
    scene::{
        BINDING_NEIGHBORS, Binding, Collider, ColliderShape, Gaussians, Object, Pose,
        RestParticles, Surface,
    },
};

use super::yardstick::{Setup, Yardstick, laws, yardstick};

/// Cell size [m].
const DX: f64 = 1.0 / 64.0;
/// Height of the block above the floor [cells].
const HEIGHT: f64 = 3.0;
/// Spin about the vertical axis [rad/s].
const SPIN: f64 = 2.0;
/// Velocity at the start [m/s].
const VELOCITY: [f64; 3] = [0.3, 0.2, -2.0];
/// Vertical gravity [m/s^2].
const GRAVITY: f64 = -9.81;

/// What is measured, under the names of the laws.
pub const MATERIALS: [&str; 6] = [
    "fixed_corotated",
    "neo_hookean",
    "snow",
    "fluid",
    "drucker_prager",
    "von_mises",
];

/// The material of that name.
pub fn material(name: &str) -> Option<Material> {
    let (law, youngs_modulus, poisson_ratio, density) = match name {
        "fixed_corotated" => (Law::FixedCorotated, 5e5, 0.3, 1000.0),
        "neo_hookean" => (Law::NeoHookean, 5e5, 0.3, 1000.0),
        "snow" => {
            let law = Law::Snow {
                critical_compression: 0.025,
                critical_stretch: 0.0045,
                hardening: 10.0,
            };
            (law, 1.4e5, 0.2, 400.0)
        }
        "fluid" => {
            let law = Law::Fluid {
                bulk_modulus: 5e5,
                viscosity: 1e-3,
            };
            (law, 0.0, 0.0, 1000.0)
        }
        "drucker_prager" => {
            let law = Law::DruckerPrager {
                friction_angle: 35.0,
                cohesion: 0.0,
            };
            (law, 5e5, 0.3, 1600.0)
        }
        "von_mises" => {
            let law = Law::VonMises {
                yield_stress: 5e3,
                hardening: 1e4,
            };
            (law, 5e5, 0.3, 1000.0)
        }
        _ => return None,
    };
    Some(Material {
        name: name.into(),
        law,
        youngs_modulus,
        poisson_ratio,
        density,
        loss: 0.0,
    })
}

/// How many particles, and how dense.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Layout {
    /// Cells along each edge of the block.
    cells: [u32; 3],
    /// Particles along each edge of a cell.
    per_edge: [u32; 3],
}

impl Layout {
    /// The block nearest to a cube with this many particles, rounded to a power of two; 1, 2, 4 or 8 per cell.
    pub fn new(particles: u32, per_cell: u32) -> Self {
        // Doublings of one cell and of one particle, dealt out over the axes.
        let cells = (f64::from(particles) / f64::from(per_cell)).log2().round() as u32;
        let dense = per_cell.ilog2();
        Self {
            cells: [0, 1, 2].map(|a| 1 << ((cells + 2 - a) / 3)),
            per_edge: [0, 1, 2].map(|a| 1 << ((dense + a) / 3)),
        }
    }

    /// Particles in the block.
    pub fn particles(&self) -> usize {
        self.cells.iter().chain(&self.per_edge).product::<u32>() as usize
    }
}

/// Numbers in -0.5..0.5 from a linear congruential generator (Knuth's MMIX constants).
fn jitter(seed: &mut u64) -> f64 {
    *seed = seed
        .wrapping_mul(6_364_136_223_846_793_005)
        .wrapping_add(1_442_695_040_888_963_407);
    (*seed >> 11) as f64 / (1_u64 << 53) as f64 - 0.5
}

/// A block of `material`; with Gaussians, one per particle.
pub fn scene(material: Material, layout: &Layout, with_gaussians: bool) -> Scene {
    let edge: [u32; 3] = std::array::from_fn(|a| layout.cells[a] * layout.per_edge[a]);
    let step = layout.per_edge.map(|n| DX / f64::from(n));
    let mut seed = 1;
    let mut position = Vec::with_capacity(layout.particles());
    for i in 0..edge[0] {
        for j in 0..edge[1] {
            for k in 0..edge[2] {
                let mut x = [i, j, k].map(|n| f64::from(n) + 0.5 + 0.5 * jitter(&mut seed));
                for a in 0..3 {
                    x[a] *= step[a];
                }
                x[2] += HEIGHT * DX;
                position.push(x);
            }
        }
    }
    let count = position.len();
    let visible = if with_gaussians { count } else { 0 };
    let centres: Vec<[f32; 3]> = position[..visible]
        .iter()
        .map(|x| x.map(|x| x as f32))
        .collect();
    let block = Object {
        gaussians: 0..visible,
        linear_velocity: VELOCITY,
        velocity_gradient: [[0.0, -SPIN, 0.0], [SPIN, 0.0, 0.0], [0.0; 3]],
        ..Object::new("block", material, 0..count)
    };
    Scene {
        gravity: [0.0, 0.0, GRAVITY],
        seed,
        objects: vec![block],
        colliders: vec![Collider::fixed(
            "floor",
            ColliderShape::HalfSpace {
                normal: [0.0, 0.0, 1.0],
            },
            Pose::IDENTITY,
            Surface::Slip,
        )],
        particles: RestParticles {
            position,
            volume: vec![step.iter().product(); count],
        },
        gaussians: Gaussians {
            position: centres,
            scale: vec![[DX as f32; 3]; visible],
            rotation: vec![[0.0, 0.0, 0.0, 1.0]; visible],
            opacity: vec![0.5; visible],
            sh: vec![0.0; 3 * visible],
            ..Gaussians::default()
        },
        binding: Binding {
            particle: (0..visible as u32)
                .map(|p| [p; BINDING_NEIGHBORS])
                .collect(),
            weight: vec![[1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]; visible],
        },
        ..Scene::empty("kernel", DX)
    }
}

/// Positions [cells] and velocities [cells/s] of the body's particles.
fn motion(scene: &Scene) -> impl Iterator<Item = ([f32; 3], [f32; 3])> {
    let object = &scene.objects[0];
    let position = &scene.particles.position;
    let count = position.len() as f64;
    let mut centre = [0.0; 3];
    for x in position {
        for a in 0..3 {
            centre[a] += x[a] / count;
        }
    }
    position.iter().map(move |x| {
        let v: [f64; 3] = std::array::from_fn(|a| {
            let gradient = &object.velocity_gradient[a];
            let turn: f64 = (0..3).map(|b| gradient[b] * (x[b] - centre[b])).sum();
            object.linear_velocity[a] + turn
        });
        (
            x.map(|x| (x / scene.dx) as f32),
            v.map(|v| (v / scene.dx) as f32),
        )
    })
}

/// The same body for the yardstick; `None` for a law that it does not have.
pub fn yardstick_of(scene: &Scene) -> Option<Box<dyn Yardstick>> {
    let object = &scene.objects[0];
    let material = &object.material;
    let (lambda, mu) = (material.lambda() as f32, material.mu() as f32);
    let setup = Setup {
        density: material.density,
        dx: scene.dx,
        gravity: scene.gravity[2],
    };
    let body = motion(scene);
    let gradient = object.velocity_gradient;
    let gradient = std::array::from_fn(|n| gradient[n / 3][n % 3] as f32);
    Some(match material.law {
        Law::FixedCorotated => {
            yardstick(laws::FixedCorotated { lambda, mu }, &setup, body, gradient)
        }
        Law::NeoHookean => yardstick(laws::NeoHookean { lambda, mu }, &setup, body, gradient),
        Law::Snow {
            critical_compression,
            critical_stretch,
            hardening,
        } => {
            let stretch = [1.0 - critical_compression, 1.0 + critical_stretch];
            let law = laws::Snow {
                lambda,
                mu,
                stretch: stretch.map(|s| s as f32),
                hardening: hardening as f32,
            };
            yardstick(law, &setup, body, gradient)
        }
        Law::Fluid {
            bulk_modulus,
            viscosity,
        } => {
            let law = laws::Fluid {
                modulus: (bulk_modulus / 7.0) as f32,
                viscosity: viscosity as f32,
            };
            yardstick(law, &setup, body, gradient)
        }
        Law::DruckerPrager { friction_angle, .. } => {
            let sine = friction_angle.to_radians().sin();
            let cone = (2.0_f64 / 3.0).sqrt() * 6.0 * sine / (3.0 - sine);
            let bulk = material.lambda() + 2.0 / 3.0 * material.mu();
            let law = laws::Sand {
                lambda,
                mu,
                slope: (cone * bulk / (2.0 * material.mu())) as f32,
            };
            yardstick(law, &setup, body, gradient)
        }
        Law::VonMises {
            yield_stress,
            hardening,
        } => {
            let law = laws::VonMises {
                lambda,
                mu,
                yield_stress: yield_stress as f32,
                hardening: hardening as f32,
            };
            yardstick(law, &setup, body, gradient)
        }
        Law::Hencky | Law::Foam { .. } | Law::Plasticine { .. } | Law::Rigid => {
            return None;
        }
    })
}
