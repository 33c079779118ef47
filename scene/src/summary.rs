//! What a scene amounts to, in scene units: sizes, masses, time step, cost.

use cosplat_sim_core::{
    cost::{ObjectCost, SceneCost},
    scene::{Aabb, Object, Scene},
};
use serde::Serialize;

use crate::bounds::bounds_of;

mod precision;
mod surroundings;

pub use precision::PrecisionHint;
pub use surroundings::{ColliderSummary, PinnedSummary, turned, vector};

/// Bytes that the solver keeps per particle: state, sorted copy, backup and published arrays.
const BYTES_PER_PARTICLE: usize = 464;
/// Bytes per visible Gaussian besides its spherical harmonics and features: rest, binding and one published
/// state.
const BYTES_PER_GAUSSIAN: usize = 44 + 64 + 64;

/// A box with its size [m].
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Extent {
    /// Smallest corner.
    pub min: [f64; 3],
    /// Largest corner.
    pub max: [f64; 3],
    /// Edge lengths.
    pub size: [f64; 3],
}

impl From<Aabb> for Extent {
    fn from(b: Aabb) -> Self {
        Self {
            min: b.min,
            max: b.max,
            size: std::array::from_fn(|a| b.max[a] - b.min[a]),
        }
    }
}

/// A whole scene.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SceneSummary {
    /// Name.
    pub name: String,
    /// Gravitational acceleration [m/s^2].
    pub gravity: [f64; 3],
    /// Cell size [m].
    pub dx: f64,
    /// Published frames per simulated second [1/s].
    pub frame_rate: f64,
    /// Fraction of the stability limit.
    pub cfl: f64,
    /// Shortest substep that an object takes at rest, at most a frame [s]; none without simulated objects.
    pub dt: Option<f64>,
    /// The name of the object that asks for it; none where the frame is what limits the substep.
    pub dt_object: Option<String>,
    /// Substeps per frame, the most of any object at rest.
    pub substeps_per_frame: u64,
    /// Particles and quadrature points times the substeps of their own solvers at rest, per simulated second [1/s].
    pub particle_updates_per_second: f64,
    /// Particles.
    pub particles: usize,
    /// Gaussians.
    pub gaussians: usize,
    /// Estimated memory of the simulation process [bytes].
    pub memory_bytes: usize,
    /// Domain.
    pub domain: Extent,
    /// Objects.
    pub objects: Vec<ObjectSummary>,
    /// Colliders.
    pub colliders: Vec<ColliderSummary>,
    /// Regions whose matter is held.
    pub pinned_regions: Vec<PinnedSummary>,
    /// Probes, in a sentence each.
    pub probes: Vec<String>,
    /// How far results are off where the answer is known; none without matter that deforms.
    pub precision: Option<PrecisionHint>,
}

/// One object.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ObjectSummary {
    /// Name.
    pub name: String,
    /// `static` or `mpm`.
    pub fidelity: &'static str,
    /// Which grid its matter is on; none where it is no matter.
    pub solver: Option<&'static str>,
    /// Why that is the spatial grid, where it is and somebody says; [`SceneSummary::new`] knows no reason.
    pub why_spatial: Option<String>,
    /// Gaussians.
    pub gaussians: usize,
    /// Box of their centres; none without Gaussians.
    pub gaussian_box: Option<Extent>,
    /// What only simulated objects have.
    #[serde(flatten)]
    pub body: Option<BodySummary>,
}

/// The simulated side of an object.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct BodySummary {
    /// Particles.
    pub particles: usize,
    /// Box of the particles.
    pub particle_box: Extent,
    /// Edge lengths of that box in cells.
    pub cells: [f64; 3],
    /// Volume [m^3].
    pub volume: f64,
    /// Mass [kg].
    pub mass: f64,
    /// Centre of mass [m].
    pub com: [f64; 3],
    /// Material name.
    pub material: String,
    /// Constitutive law.
    pub law: &'static str,
    /// Young's modulus [Pa].
    pub youngs_modulus_pa: f64,
    /// Poisson's ratio.
    pub poisson_ratio: f64,
    /// Density [kg/m^3].
    pub density_kg_m3: f64,
    /// Loss factor `tan delta`.
    pub loss: f64,
    /// Speed of pressure waves [m/s].
    pub sound_speed: f64,
    /// What its substeps work on: particles, or quadrature points of a grid of its own; 0 of a rigid body, and of what is not yet there.
    pub points: usize,
    /// Largest substep that it allows at rest, `cfl` included [s]; none of a rigid body, whose stiffness limits nothing, and of what is
    /// not yet there.
    pub dt: Option<f64>,
}

impl SceneSummary {
    /// Sums a scene up.
    pub fn new(scene: &Scene) -> Self {
        let cost = SceneCost::at_rest(scene);
        let objects: Vec<ObjectSummary> = scene
            .objects
            .iter()
            .zip(&cost.objects)
            .map(|(object, cost)| object_summary(scene, object, cost.as_ref()))
            .collect();
        let frame = 1.0 / scene.frame_rate;
        let limits = cost.objects.iter().flatten().map(|object| object.dt);
        let is_simulated = objects.iter().any(|object| object.body.is_some());
        let particles = scene.particles.position.len();
        let g = &scene.gaussians;
        let per_gaussian = BYTES_PER_GAUSSIAN + 4 * (g.sh_stride() + g.feature_dim as usize);
        let mut summary = Self {
            name: scene.name.clone(),
            gravity: scene.gravity,
            dx: scene.dx,
            frame_rate: scene.frame_rate,
            cfl: scene.cfl,
            dt: is_simulated.then(|| limits.fold(frame, f64::min)),
            dt_object: cost.limited_by.map(|id| scene.objects[id].name.clone()),
            substeps_per_frame: cost.substeps,
            particle_updates_per_second: cost.updates_per_second,
            particles,
            gaussians: g.len(),
            memory_bytes: particles * BYTES_PER_PARTICLE + g.len() * per_gaussian,
            domain: scene.domain.into(),
            objects,
            colliders: surroundings::colliders(scene),
            pinned_regions: surroundings::pinned_regions(scene),
            probes: surroundings::probes(scene),
            precision: None,
        };
        summary.precision = PrecisionHint::new(&summary);
        summary
    }
}

fn object_summary(scene: &Scene, object: &Object, cost: Option<&ObjectCost>) -> ObjectSummary {
    let centers = &scene.gaussians.position[object.gaussians.clone()];
    let gaussian_box = bounds_of(centers.iter().map(|p| p.map(f64::from)));
    ObjectSummary {
        name: object.name.clone(),
        fidelity: object.fidelity.name(),
        solver: object.is_matter().then(|| object.solver.name()),
        why_spatial: None,
        gaussians: object.gaussians.len(),
        gaussian_box: gaussian_box.map(Extent::from),
        body: body_summary(scene, object, cost),
    }
}

fn body_summary(scene: &Scene, object: &Object, cost: Option<&ObjectCost>) -> Option<BodySummary> {
    let position = &scene.particles.position[object.particles.clone()];
    let volumes = &scene.particles.volume[object.particles.clone()];
    let particle_box: Extent = bounds_of(position.iter().copied())?.into();
    let volume: f64 = volumes.iter().sum();
    let masses: Vec<f64> = (object.particles.clone().zip(volumes))
        .map(|(p, v)| v * object.density_of(p))
        .collect();
    let mass: f64 = masses.iter().sum();
    let moment = |a: usize| -> f64 { position.iter().zip(&masses).map(|(p, m)| p[a] * m).sum() };
    let m = &object.material;
    let (lambda, mu) = (m.lambda(), m.mu());
    Some(BodySummary {
        particles: position.len(),
        particle_box,
        cells: particle_box.size.map(|s| s / scene.dx),
        volume,
        mass,
        com: [0, 1, 2].map(|a| moment(a) / mass),
        material: m.name.clone(),
        law: m.law.name(),
        youngs_modulus_pa: m.youngs_modulus,
        poisson_ratio: m.poisson_ratio,
        density_kg_m3: m.density,
        loss: m.loss,
        sound_speed: ((lambda + 2.0 * mu) / m.density).sqrt(),
        points: cost.map_or(0, |cost| cost.points),
        dt: cost.map(|cost| cost.dt),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene_file::{SceneFile, build};

    const TEXT: &str = r#"version = 1
dx = 0.05
[[objects]]
name = "steel"
shape = { kind = "box", size = [0.2, 0.2, 0.2] }
translation = [1, 2, 3]
material = { youngs_modulus_pa = 2e11, poisson_ratio = 0.25, density_kg_m3 = 8000 }
[[objects]]
name = "jelly"
shape = { kind = "box", size = [0.2, 0.2, 0.2] }
material = "jelly"
[[objects]]
name = "backdrop"
builtin = "ground"
fidelity = "static"
"#;

    #[test]
    fn a_summary_is_in_scene_units() {
        let file = SceneFile::parse(TEXT).expect("valid");
        let (scene, _) = build(&file, &mut |_| unreachable!("no files")).expect("builds");
        let summary = SceneSummary::new(&scene);
        let steel = summary.objects[0].body.as_ref().expect("simulated");
        assert!((steel.mass - 64.0).abs() < 1e-9, "{}", steel.mass);
        for a in 0..3 {
            assert!((steel.com[a] - [1.0, 2.0, 3.0][a]).abs() < 1e-12);
        }
        // lambda + 2 mu = 1.2 E at nu = 0.25; dt = 2 * 0.8 dx sqrt(rho / (2.7 M)), M = 3 lambda + 2 mu = 2 E.
        assert!((steel.sound_speed - (2.4e11f64 / 8000.0).sqrt()).abs() < 1e-6);
        let dt = 2.0 * 0.8 * 0.05 * (8000.0f64 / 1.08e12).sqrt();
        let said = steel.dt.expect("a limit");
        assert!((said / dt - 1.0).abs() < 1e-12, "{said} {dt}");
        assert_eq!(steel.points, 512);
        assert_eq!(summary.dt_object.as_deref(), Some("steel"));
        assert_eq!(summary.substeps_per_frame, (1.0 / 60.0 / dt).ceil() as u64);
        assert!(summary.objects[2].body.is_none());
        assert!(summary.objects[2].gaussian_box.is_some());
    }

    #[test]
    fn no_substep_is_longer_than_a_frame() {
        for (material, updates) in [("jelly", true), ("rigid", false)] {
            let text = format!(
                "version = 1\ndx = 0.05\nframe_rate = 2000\n[[objects]]\nname = \"a\"\n\
                 shape = {{ kind = \"box\", size = [0.2, 0.2, 0.2] }}\nmaterial = {material:?}\n"
            );
            let file = SceneFile::parse(&text).expect("valid");
            let (scene, _) = build(&file, &mut |_| unreachable!("no files")).expect("builds");
            let summary = SceneSummary::new(&scene);
            let limit = summary.objects[0].body.as_ref().expect("simulated").dt;
            assert_eq!(limit.is_some(), updates);
            assert!(limit.is_none_or(|dt| dt > 5e-4));
            assert_eq!((summary.dt, summary.dt_object), (Some(5e-4), None));
            assert_eq!(summary.substeps_per_frame, 1);
            assert_eq!(summary.particle_updates_per_second > 0.0, updates);
        }
    }
}
