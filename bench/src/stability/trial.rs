//! One run past, at or below the stability limit, and what became of it.

use cosplat_reference::ReferenceWorld;
use cosplat_sim_core::{
    Scene, World, WorldError,
    materials::limits::{DeformationBounds, critical_dt},
};

use super::samples::Numbers;

/// What became of a run without guard.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Fate {
    /// The motion it started with goes on.
    Passed,
    /// Less than a third of its amplitude is left.
    Damped,
    /// It grew without bound, or stopped being a number.
    BlownUp,
}

impl Fate {
    /// As on the maps and in the files beside them.
    pub fn name(self) -> &'static str {
        match self {
            Self::Passed => "pass",
            Self::Damped => "damped",
            Self::BlownUp => "blown-up",
        }
    }
}

/// Critical time step [s] of an isolated particle of the scene's first object at rest, with APIC.
pub fn limit(scene: &Scene) -> f64 {
    let material = &scene.objects[0].material;
    critical_dt(
        material,
        material.density,
        scene.dx,
        &DeformationBounds::REST,
    )
}

/// Strain that runs start with: small enough that the closed form, which is linear, holds.
pub const START: f64 = 1e-6;
/// Growth of the largest strain that counts as blown up. In stable runs random clusters overshoot up to a hundred times.
pub const GROWTH: f64 = 1e4;

/// `steps` substeps of `dt` [s] in the double-precision solver, which has no guard, after a start with a breathing
/// motion and random strain.
pub fn unguarded(scene: &Scene, dt: f64, steps: usize) -> Fate {
    let mut world = ReferenceWorld::new(scene);
    let mut numbers = Numbers(scene.particles.position.len() as u64);
    let moved = scene.objects[0].particles.clone();
    for p in moved.clone() {
        for i in 0..3 {
            // A strain rate that reaches the strain `START` within a substep.
            world.particles.affine[p][i][i] = START / dt;
            for j in 0..3 {
                let noise = START * (numbers.next() - 0.5);
                world.particles.elastic[p][i][j] += noise;
            }
        }
    }
    let centre: [f64; 3] = world.objects()[0].com;
    for p in moved.clone() {
        for i in 0..3 {
            let r = world.particles.position[p][i] - centre[i];
            world.particles.velocity[p][i] = START / dt * r;
        }
    }
    // Fluids keep their strain in another number than solids.
    let strain = |world: &ReferenceWorld| {
        let state = &world.particles;
        let mut largest = 0.0_f64;
        for p in moved.clone() {
            // Green's strain: a rotation of `F` is no strain, and nothing damps it.
            let f = state.elastic[p];
            let mut sum = 0.0;
            for i in 0..3 {
                for j in 0..3 {
                    let rest = if i == j { 1.0 } else { 0.0 };
                    let product: f64 = (0..3).map(|k| f[k][i] * f[k][j]).sum();
                    sum += (0.5 * (product - rest)).powi(2);
                }
            }
            let memory = match scene.objects[0].material.law.is_fluid() {
                true => state.memory[p].abs(),
                false => 0.0,
            };
            let here = sum.sqrt() + memory;
            largest = if here.is_nan() {
                here
            } else {
                largest.max(here)
            };
            if largest.is_nan() {
                break;
            }
        }
        largest
    };
    // Largest strain in each tenth of the run.
    let mut tenths = [0.0_f64; 10];
    for tenth in &mut tenths {
        for _ in 0..steps / 10 {
            world.step_with(&[dt], &[]);
            let now = strain(&world);
            *tenth = tenth.max(now);
            if now.is_nan() || now > GROWTH * START {
                return Fate::BlownUp;
            }
        }
    }
    match tenths[9] < tenths[0] / 3.0 {
        true => Fate::Damped,
        false => Fate::Passed,
    }
}

/// What became of a run with guard.
#[derive(Clone, Copy, Debug, Default)]
pub struct Contained {
    /// Substeps taken back.
    pub rollbacks: u32,
    /// Particles taken out.
    pub quarantined: usize,
    /// Largest total energy over that at the start.
    pub energy: f64,
    /// Particles whose position is not a number; the guard exists so that there is none.
    pub lost: usize,
}

/// `frames` frames of the solver that everyone uses, at the scene's `cfl`.
///
/// # Errors
/// When the scene cannot be simulated.
pub fn guarded(scene: Scene, frames: u32) -> Result<Contained, WorldError> {
    let mut world = World::new(scene)?;
    let start = world.report();
    let energy = start.kinetic_energy + start.potential_energy + start.elastic_energy;
    let mut found = Contained {
        energy: 1.0,
        ..Contained::default()
    };
    for _ in 0..frames {
        let report = world.step(1.0 / 60.0, &[]);
        found.rollbacks += report.rollbacks;
        found.quarantined += report.quarantined.len();
        let now = report.kinetic_energy + report.potential_energy + report.elastic_energy;
        found.energy = found.energy.max(now / energy);
    }
    let bad = |x: &&[f32; 3]| x.iter().any(|x| !x.is_finite());
    found.lost = world.positions().iter().filter(bad).count();
    Ok(found)
}
