//! The solver that everyone uses, past the limit: what its guard does about it.

use std::path::Path;

use cosplat_scene::load::load_text;
use cosplat_sim_core::{Scene, materials::Law, scene::Solver};
use rayon::prelude::*;

use super::{
    samples::{cluster, conditions, solid},
    trial::{Contained, guarded},
};

/// Fractions of the limit that scenes ask for; beyond 1 only to see what happens.
pub const CFL: [f64; 8] = [0.5, 0.8, 0.9, 1.0, 1.05, 1.1, 1.25, 1.5];

/// A scene at one fraction of the limit.
pub struct Field {
    /// Short name of the scene.
    pub scene: &'static str,
    /// Transfer, or that it is about solids on grids of their own.
    pub transfer: &'static str,
    /// `cfl`.
    pub cfl: f64,
    /// What came of it.
    pub found: Contained,
}

impl Field {
    /// Class on the map.
    pub fn class(&self) -> usize {
        match self.found {
            Contained {
                quarantined: 1.., ..
            } => 3,
            Contained { energy, .. } if energy > 1.005 => 2,
            Contained { rollbacks: 1.., .. } => 1,
            _ => 0,
        }
    }
}

/// Classes, in the order of [`Field::class`].
pub const CLASSES: [(&str, &str, usize); 4] = [
    ("no substep taken back", "", 0),
    ("taken back and retried, energy below start", "r", 1),
    ("energy more than 0.5 % above start", "e", 1),
    ("particles taken out", "q", 2),
];

const DROP: &str = "version = 1\ndx = 0.05\n[[objects]]\nname = \"block\"\nshape = { kind = \"box\", size = [0.2, 0.2, 0.2], gaussian_spacing = 0.1 }\n\
    material = { law = \"neo_hookean\", youngs_modulus_pa = 1e5, poisson_ratio = 0.3, density_kg_m3 = 1000 }\nsolver = \"spatial\"\n\
    translation = [0, 0.2, 0]\nlinear_velocity = [0, -3, 0]\n\
    [[colliders]]\nname = \"floor\"\nshape = \"half_space\"\nnormal = [0, 1, 0]\nsurface = \"separate\"\n";
const PAIR: &str = "version = 1\ngravity = [0, 0, 0]\ndx = 0.05\n[[objects]]\nname = \"left\"\n\
    shape = { kind = \"sphere\", radius = 0.12, gaussian_spacing = 0.1 }\n\
    material = { law = \"neo_hookean\", youngs_modulus_pa = 1e5, poisson_ratio = 0.3, density_kg_m3 = 1000 }\nsolver = \"spatial\"\n\
    translation = [-0.15, 0.02, 0]\nlinear_velocity = [3, 0, 0]\n\
    [[objects]]\nname = \"right\"\nclone = \"left\"\ntranslation = [0.15, -0.02, 0]\nlinear_velocity = [-3, 0, 0]\n";

const RING: &str = "version = 1\ngravity = [0, 0, 0]\ndx = 0.05\n[[objects]]\nname = \"block\"\n\
    shape = { kind = \"box\", size = [0.2, 0.2, 0.2], gaussian_spacing = 0.1 }\n\
    material = { law = \"neo_hookean\", youngs_modulus_pa = 1e5, poisson_ratio = 0.3, density_kg_m3 = 1000 }\nsolver = \"spatial\"\n\
    velocity = [\"X\", \"Y\", \"Z\"]\n";
const HELD: &str = "version = 1\ngravity = [0, 0, 0]\ndx = 0.05\n[[objects]]\nname = \"beam\"\n\
    shape = { kind = \"box\", size = [0.6, 0.1, 0.1], gaussian_spacing = 0.1 }\n\
    material = { law = \"neo_hookean\", youngs_modulus_pa = 1e5, poisson_ratio = 0.3, density_kg_m3 = 1000 }\nsolver = \"spatial\"\n\
    translation = [0.2, 0, 0]\nvelocity = [\"0\", \"0.5*(X+abs(X))\", \"0\"]\n\
    [[pinned_regions]]\nmin = [-1, -1, -1]\nmax = [0, 1, 1]\n";
/// What runs with solids on grids of their own are called where others have a transfer.
pub const SOLID: &str = "solid";

/// Lone particles that spread: each starts with a strain rate that makes a stretch of 5 %.
fn dust() -> Scene {
    let mut scene = cluster(solid(Law::NeoHookean, 0.3), 27, 1);
    for (n, x) in scene.particles.position.iter_mut().enumerate() {
        let place = [n / 9, n / 3 % 3, n % 3];
        for a in 0..3 {
            x[a] += 0.5 * place[a] as f64;
        }
    }
    // omega = 2 / dt_crit is about 200 / s here.
    for a in 0..3 {
        scene.objects[0].velocity_gradient[a][a] = 1.0;
    }
    scene
}

fn from_text(text: &str) -> anyhow::Result<Scene> {
    Ok(load_text(text.into(), Path::new("guard.toml"))?.scene)
}

/// All scenes at all fractions.
///
/// # Errors
/// When a scene cannot be built or simulated, which would be a defect of this program.
pub fn fields(quick: bool) -> anyhow::Result<Vec<Field>> {
    let scenes = [
        ("dust", dust()),
        ("drop", from_text(DROP)?),
        ("pair", from_text(PAIR)?),
    ];
    let cfl: &[f64] = if quick { &[0.5, 1.25] } else { &CFL };
    let mut runs = Vec::new();
    for (name, text) in [
        ("ring", RING),
        ("drop", DROP),
        ("pair", PAIR),
        ("held beam", HELD),
    ] {
        let mut scene = from_text(text)?;
        for object in &mut scene.objects {
            object.solver = Solver::Lagrangian;
        }
        for cfl in cfl {
            let scene = Scene {
                cfl: *cfl,
                ..scene.clone()
            };
            runs.push((name, SOLID, *cfl, scene));
        }
    }
    for (name, scene) in &scenes {
        for transfer in ["apic", "pic"] {
            for cfl in cfl {
                let mut scene = scene.clone();
                scene.cfl = *cfl;
                scene.conditions.transfer = conditions(transfer).transfer;
                runs.push((*name, transfer, *cfl, scene));
            }
        }
    }
    let frames = if quick { 5 } else { 30 };
    runs.into_par_iter()
        .map(|(scene, transfer, cfl, built)| {
            Ok(Field {
                scene,
                transfer,
                cfl,
                found: guarded(built, frames)?,
            })
        })
        .collect()
}
