//! `Scene`: everything that stays constant while a world is stepped.

mod boundaries;
mod coherence;
mod contact;
mod gaussians;
mod pose;
mod turned;

use std::ops::Range;

use serde::{Deserialize, Serialize};

pub use boundaries::*;
pub use coherence::*;
pub use contact::*;
pub use gaussians::*;
pub use pose::pose_at;
pub use turned::*;

use crate::{expression::VectorField, materials::Material};

/// How many particles each Gaussian is bound to.
pub const BINDING_NEIGHBORS: usize = 8;

/// A complete scene, in the world frame and SI units.
#[derive(Clone, Debug)]
pub struct Scene {
    /// Name for reports.
    pub name: String,
    /// Initial gravitational acceleration [m/s^2].
    pub gravity: [f64; 3],
    /// Grid cell size `dx` [m], > 0. Nodes sit at integer multiples of it.
    pub dx: f64,
    /// Published frames per second of simulated time [1/s], > 0.
    pub frame_rate: f64,
    /// Fraction of the stability limit that `dt` uses, 0 < cfl <= 1.
    pub cfl: f64,
    /// What automatic fidelity may change of an object's path and shape, relative to its radius, > 0.
    pub tolerance: f64,
    /// Seed of everything sampled.
    pub seed: u64,
    /// Box that particles must stay in [m]; [`Conditions::domain_policy`] says what happens at its faces.
    pub domain: Aabb,
    /// Objects; an object's id is its index.
    pub objects: Vec<Object>,
    /// How they meet.
    pub contact: Contact,
    /// Rigid boundaries.
    pub colliders: Vec<Collider>,
    /// Boxes whose grid nodes are held or moved.
    pub pinned_regions: Vec<PinnedRegion>,
    /// What is prescribed for particles, and at the faces of the domain.
    pub conditions: Conditions,
    /// Particles at rest, object after object.
    pub particles: RestParticles,
    /// Visible Gaussians at rest in the world frame, object after object.
    pub gaussians: Gaussians,
    /// How each Gaussian follows the particles; same length as `gaussians`.
    pub binding: Binding,
    /// Quantities that `cosplat simulate` reports.
    pub probes: Vec<Probe>,
}

impl Scene {
    /// No matter, no gravity and no boundary in a domain of 200 m, at half the stability limit: to be filled.
    pub fn empty(name: impl Into<String>, dx: f64) -> Self {
        Self {
            name: name.into(),
            gravity: [0.0; 3],
            dx,
            frame_rate: 60.0,
            cfl: 0.5,
            tolerance: 0.01,
            seed: 0,
            domain: Aabb {
                min: [-100.0; 3],
                max: [100.0; 3],
            },
            objects: vec![],
            contact: Contact::default(),
            colliders: vec![],
            pinned_regions: vec![],
            conditions: Conditions::default(),
            particles: RestParticles::default(),
            gaussians: Gaussians::default(),
            binding: Binding::default(),
            probes: vec![],
        }
    }
}

/// Axis-aligned box [m].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Aabb {
    /// Smallest corner.
    pub min: [f64; 3],
    /// Largest corner.
    pub max: [f64; 3],
}

impl Aabb {
    /// Whether a point is inside, faces included; NaN is not.
    pub fn contains(&self, x: [f64; 3]) -> bool {
        (0..3).all(|a| (self.min[a]..=self.max[a]).contains(&x[a]))
    }
}

/// One object: a contiguous run of particles and of Gaussians.
#[derive(Clone, Debug)]
pub struct Object {
    /// Unique name.
    pub name: String,
    /// What it is made of, but for its regions.
    pub material: Material,
    /// Runs of its particles that are made of something else; in order, at the end of `particles`.
    pub regions: Vec<MaterialRegion>,
    /// How its surface answers to other objects.
    pub surface: ContactSurface,
    /// What holds it together besides its matter.
    pub coherence: Option<Coherence>,
    /// Whether it is there at time 0; otherwise it is away until a command brings it in.
    pub present: bool,
    /// Whether it is simulated.
    pub fidelity: Fidelity,
    /// Which grid its matter is on.
    pub solver: Solver,
    /// Its particles in [`Scene::particles`]; empty for static objects.
    pub particles: Range<usize>,
    /// Its Gaussians in [`Scene::gaussians`]; may be empty.
    pub gaussians: Range<usize>,
    /// Rotation of its placement, unit quaternion xyzw: spherical harmonics stay in the asset's frame, so this
    /// is part of the published rotation.
    pub world_from_asset: [f32; 4],
    /// Initial velocity of the centre of mass [m/s].
    pub linear_velocity: [f64; 3],
    /// Initial velocity gradient about the centre of mass [1/s], row-major: spin plus affine part.
    pub velocity_gradient: [[f64; 3]; 3],
    /// Initial velocity [m/s] on top of these, over the position at rest; without effect on rigid matter.
    pub velocity: Option<VectorField>,
    /// Force per mass on every particle [m/s^2], over its position at rest and time.
    pub body_force: Option<VectorField>,
}

/// Particles of an object with a material of their own.
#[derive(Clone, Debug)]
pub struct MaterialRegion {
    /// Its particles in [`Scene::particles`], within those of the object.
    pub particles: Range<usize>,
    /// What it is made of.
    pub material: Material,
}

/// Particles of one object and one material: the object outside its regions, or one region.
#[derive(Clone, Debug)]
pub struct Part {
    /// Object id.
    pub object: usize,
    /// Number of the region, from 0; none for the object outside its regions.
    pub region: Option<usize>,
    /// Its particles in [`Scene::particles`].
    pub particles: Range<usize>,
    /// What it is made of.
    pub material: Material,
}

impl Object {
    /// A body of matter at rest that nothing is special about.
    pub fn new(name: impl Into<String>, material: Material, particles: Range<usize>) -> Self {
        Self {
            name: name.into(),
            material,
            regions: vec![],
            surface: ContactSurface::default(),
            coherence: None,
            present: true,
            fidelity: Fidelity::Mpm,
            solver: Solver::Spatial,
            particles,
            gaussians: 0..0,
            world_from_asset: [0.0, 0.0, 0.0, 1.0],
            linear_velocity: [0.0; 3],
            velocity_gradient: [[0.0; 3]; 3],
            velocity: None,
            body_force: None,
        }
    }

    /// Whether it is simulated, and some of it deforms.
    pub fn is_matter(&self) -> bool {
        matches!(self.fidelity, Fidelity::Mpm | Fidelity::Auto)
            && !self.particles.is_empty()
            && self.materials().any(|material| !material.law.is_rigid())
    }

    /// Whether all of it keeps its shape: no law of it flows.
    pub fn keeps_shape(&self) -> bool {
        self.materials().all(|material| material.law.may_be_solid())
    }

    /// Its material and those of its regions.
    pub fn materials(&self) -> impl Iterator<Item = &Material> {
        let regions = self.regions.iter().map(|region| &region.material);
        std::iter::once(&self.material).chain(regions)
    }

    /// Whether some of it moves as a body.
    pub fn has_rigid_matter(&self) -> bool {
        self.fidelity == Fidelity::Rigid || self.materials().any(|material| material.law.is_rigid())
    }

    /// The first of its materials that is not elastic without bound.
    pub fn yielding_matter(&self) -> Option<&Material> {
        let mut materials = self.materials();
        materials.find(|material| !material.law.keeps_elastic())
    }

    /// The object outside its regions, then its regions; `id` is the object's id.
    pub fn parts(&self, id: usize) -> impl Iterator<Item = Part> {
        let end = self
            .regions
            .first()
            .map_or(self.particles.end, |region| region.particles.start);
        let rest = Part {
            object: id,
            region: None,
            particles: self.particles.start..end,
            material: self.material.clone(),
        };
        let regions = self.regions.iter().enumerate();
        std::iter::once(rest).chain(regions.map(move |(n, region)| Part {
            object: id,
            region: Some(n),
            particles: region.particles.clone(),
            material: region.material.clone(),
        }))
    }

    /// Mass per rest volume of one of its particles [kg/m^3].
    pub fn density_of(&self, particle: usize) -> f64 {
        let region = self
            .regions
            .iter()
            .find(|region| region.particles.contains(&particle));
        region.map_or(self.material.density, |r| r.material.density)
    }
}

impl Scene {
    /// All parts, object after object.
    pub fn parts(&self) -> Vec<Part> {
        let objects = self.objects.iter().enumerate();
        objects.flat_map(|(id, object)| object.parts(id)).collect()
    }
}

/// How an object is modelled.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[repr(u32)]
pub enum Fidelity {
    /// Visible only: has Gaussians, no particles, costs nothing per step.
    Static = 1,
    /// Material points.
    Mpm = 2,
    /// One body, whatever its material.
    Rigid = 4,
    /// As little as [`Scene::tolerance`] allows.
    Auto = 3,
}

impl Fidelity {
    /// Names in scene files.
    pub const NAMES: [(&'static str, Self); 4] = [
        ("static", Self::Static),
        ("mpm", Self::Mpm),
        ("rigid", Self::Rigid),
        ("auto", Self::Auto),
    ];

    /// Name in scene files.
    pub fn name(self) -> &'static str {
        let entry = Self::NAMES.iter().find(|(_, fidelity)| *fidelity == self);
        entry.map_or("", |(name, _)| name)
    }
}

/// Which grid matter is on.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Solver {
    /// The grid in space that all objects share: matter moves through it, and may flow, mix and break.
    #[default]
    Spatial,
    /// A grid of the object's own in its rest frame: for elastic matter, which keeps its neighbours.
    Lagrangian,
}

impl Solver {
    /// Names in scene files.
    pub const NAMES: [(&'static str, Self); 2] =
        [("spatial", Self::Spatial), ("lagrangian", Self::Lagrangian)];

    /// Name in scene files.
    pub fn name(self) -> &'static str {
        let entry = Self::NAMES.iter().find(|(_, solver)| *solver == self);
        entry.map_or("", |(name, _)| name)
    }
}

/// Particles at rest, structure of arrays.
#[derive(Clone, Debug, Default)]
pub struct RestParticles {
    /// Position [m], world frame.
    pub position: Vec<[f64; 3]>,
    /// Rest volume `V0` [m^3], > 0. Mass = density x volume.
    pub volume: Vec<f64>,
}

/// Each Gaussian takes `x` and `F` from the particles it is bound to.
#[derive(Clone, Debug, Default)]
pub struct Binding {
    /// Particle indices into [`Scene::particles`], of the same object; unused slots repeat an index with weight 0.
    pub particle: Vec<[u32; BINDING_NEIGHBORS]>,
    /// Weights, >= 0, sum 1; all 0 for Gaussians of static objects.
    pub weight: Vec<[f32; BINDING_NEIGHBORS]>,
}

/// A reported quantity.
#[derive(Clone, Debug, PartialEq)]
pub struct Probe {
    /// Unique name; the key in the report.
    pub name: String,
    /// What is measured.
    pub kind: ProbeKind,
}

/// What a probe measures.
#[derive(Clone, Debug, PartialEq)]
pub enum ProbeKind {
    /// Box around an object's particles [m].
    Extent {
        /// Object id.
        object: usize,
        /// Part of its volume that is not beyond a face, 0.5 to 1.
        share: f64,
    },
    /// Mean velocity and density of the particles within `dx` of a fixed point in space.
    Point {
        /// Where [m].
        position: [f64; 3],
    },
    /// Distance of an object's particles from where they should be.
    Deviation {
        /// Object id.
        object: usize,
        /// Where a particle should be [m], over its position at rest and time.
        position: VectorField,
        /// Only particles that are in this box at rest [m].
        bounds: Option<TurnedBox>,
    },
    /// Position, velocity, deformation gradient and stress of the particle that is nearest to `position` at rest.
    MaterialPoint {
        /// Object id.
        object: usize,
        /// Rest position [m].
        position: [f64; 3],
    },
}
