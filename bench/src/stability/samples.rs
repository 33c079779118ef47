//! What stability is tried on: clusters of few particles, blocks, and objects of scene files.

use std::path::Path;

use cosplat_scene::load::load_text;
use cosplat_sim_core::{
    Scene,
    materials::{Law, Material},
    scene::{Conditions, Object, RestParticles, Transfer},
};

/// Cell size of clusters and blocks [m].
pub const DX: f64 = 0.1;

/// Laws that flow, as they are stated in materials of 0.1 MPa.
pub const MISES: Law = Law::VonMises {
    yield_stress: 3e3,
    hardening: 1e4,
};
/// See [`MISES`].
pub const FOAM: Law = Law::Foam {
    yield_stress: 1e3,
    viscosity: 300.0,
    exponent: 0.6,
};
/// See [`MISES`].
pub const PLASTICINE: Law = Law::Plasticine {
    yield_stress: 3e3,
    softening: 2e3,
};

/// Numbers that look random, the same in every run: a linear congruential generator (Knuth's MMIX).
pub struct Numbers(pub u64);

impl Numbers {
    /// The next one, in 0..1.
    pub fn next(&mut self) -> f64 {
        let Self(state) = self;
        *state = state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (*state >> 33) as f64 / (1_u64 << 31) as f64
    }
}

/// Elastic matter of 1000 kg/m^3.
pub fn solid(law: Law, poisson_ratio: f64) -> Material {
    Material {
        name: law.name().into(),
        law,
        youngs_modulus: 1e5,
        poisson_ratio,
        density: 1000.0,
        loss: 0.0,
    }
}

/// How much of the strain rate of `C` transfers keep, by the name on the maps.
pub fn conditions(transfer: &str) -> Conditions {
    let (transfer, rpic_damping) = match transfer {
        "pic" => (Transfer::Pic, 0.0),
        "rpic" => (Transfer::Apic, 1.0),
        _ => (Transfer::Apic, 0.0),
    };
    Conditions {
        transfer,
        rpic_damping,
        ..Conditions::default()
    }
}

/// One object of particles of equal volume, in free space.
fn free(material: Material, position: Vec<[f64; 3]>, volume: f64) -> Scene {
    let count = position.len();
    Scene {
        objects: vec![Object::new("sample", material, 0..count)],
        particles: RestParticles {
            position,
            volume: vec![volume; count],
        },
        ..Scene::empty("sample", DX)
    }
}

/// `count` particles at random places in a box of one and a half cells.
pub fn cluster(material: Material, count: usize, seed: u64) -> Scene {
    let mut numbers = Numbers(seed.wrapping_add(77));
    numbers.next();
    let mut at = || std::array::from_fn(|_| 1.5 * DX * numbers.next());
    let position = (0..count).map(|_| at()).collect();
    free(material, position, DX.powi(3) / 8.0)
}

/// A cube of `edge` cells along each axis with `per_axis` particles per cell along each, askew to the grid.
pub fn block(material: Material, edge: usize, per_axis: usize) -> Scene {
    let h = DX / per_axis as f64;
    let n = edge * per_axis;
    let place = |i: usize, shift: f64| (i as f64 + 0.5) * h + shift * DX;
    let mut position = Vec::with_capacity(n * n * n);
    for i in 0..n {
        for j in 0..n {
            for k in 0..n {
                position.push([place(i, 0.13), place(j, 0.24), place(k, 0.41)]);
            }
        }
    }
    free(material, position, h * h * h)
}

/// Objects of scene files, by the name on the maps.
pub const OBJECTS: [(&str, &str); 3] = [
    (
        "ball, 8 cells across",
        "cells_per_object = 8\n[[objects]]\nname = \"ball\"\nshape = { kind = \"sphere\", radius = 0.1, gaussian_spacing = 0.05 }\n",
    ),
    (
        "slab, 2 cells thick",
        "dx = 0.02\n[[objects]]\nname = \"slab\"\nshape = { kind = \"slab\", size = [0.2, 0.2], thickness = 0.04, gaussian_spacing = 0.05 }\n",
    ),
    (
        "vase, 16 cells tall",
        "cells_per_object = 16\n[[objects]]\nname = \"vase\"\nbuiltin = \"vase\"\n",
    ),
];

/// An object of rubber-like matter as a scene file makes it, in free space.
///
/// # Errors
/// When the scene cannot be built, which would be a defect of this program.
pub fn object(text: &str, poisson_ratio: f64) -> anyhow::Result<Scene> {
    let text = format!(
        "version = 1\ngravity = [0, 0, 0]\n{text}material = {{ law = \"neo_hookean\", youngs_modulus_pa = 1e5, \
         poisson_ratio = {poisson_ratio}, density_kg_m3 = 1000 }}\n"
    );
    Ok(load_text(text, Path::new("sample.toml"))?.scene)
}
