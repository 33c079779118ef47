//! The constant side of a world: the scene, and what is made of it before the first step.
//!
//! Only [`Model::constants`] ever change, where a command changes a material, and parts, where one paints: at the start of a
//! frame.

mod parts;

pub(crate) use parts::Painted;
use parts::Portion;

use crate::{
    bodies::grain::Grain,
    colliders::{Boundaries, approach::half_spacing, rules::Rules},
    materials::{
        Coefficients, Law, Material,
        limits::{DeformationBounds, critical_dt},
    },
    scene::{ContactMethod, DomainPolicy, Fidelity, Part, Scene},
    simd::Isa,
    solid::object::SolidObject,
    step::constitutive::PartLaw,
};

/// Largest coordinate [cells]: beyond it single precision cannot tell nodes apart.
pub(crate) const MAX_CELLS: f64 = 16_777_216.0;

/// A scene, and what every step reads of it.
#[derive(Debug)]
pub(crate) struct Model {
    pub scene: Scene,
    /// Instruction set of the kernels.
    pub isa: Isa,
    /// Parts of all objects: each has one material. Those of the scene come first, then what commands painted: a painted part
    /// has the range of the part that it is of.
    pub parts: Vec<Part>,
    /// How many of them the scene has.
    pub scene_parts: usize,
    /// Which particles are of which part, in scene order.
    pub portions: Vec<Portion>,
    /// Per part how many particles are of it.
    pub particle_counts: Vec<usize>,
    /// Mass of the heaviest particle [kg]: the solver's unit, so that single precision never under- or overflows.
    pub mass_unit: f64,
    /// Colliders and regions [cells]: what matter meets.
    pub boundaries: Boundaries,
    /// Colliders [m]: what rigid bodies meet.
    pub solids: Boundaries,
    /// Per object its grid, where it is a solid on one of its own.
    pub lagrangian: Vec<Option<SolidObject>>,
    /// Those that have gone over to the spatial grid.
    former: Vec<Option<SolidObject>>,
    /// Prescribed motion, impulses, releases.
    pub rules: Rules,
    /// Radius of every particle of the scene, as colliders see it [cells].
    pub half_spacings: Vec<f64>,
    /// Per part the volume of one unit of mass at rest [cells].
    pub cells_per_mass: Vec<f64>,
    /// Per object the rest volume per mass, up to a common factor.
    pub specific_volumes: Vec<f64>,
    /// Rate at which velocities decay [1/s]: that of the scene, and more while it comes to rest.
    pub damping: f64,
    /// What is made of materials when they change.
    pub constants: Constants,
}

/// What is made of materials when they change, per part unless it says otherwise.
#[derive(Debug, Default)]
pub(crate) struct Constants {
    /// Law and numbers.
    pub laws: Vec<PartLaw>,
    /// Bound of the substep at rest [s].
    pub rest_dt: Vec<f64>,
}

impl Model {
    /// What a kick of `dt` [s] leaves of a velocity; exactly 1 without damping.
    pub fn velocity_kept(&self, dt: f64) -> f64 {
        (-self.damping * dt).exp()
    }

    /// The model of a valid scene.
    pub fn new(scene: Scene, isa: Isa) -> Self {
        let parts = scene.parts();
        let mass_unit = heaviest_particle(&scene, &parts);
        let cell = scene.dx.powi(3);
        let objects = scene.objects.iter();
        let mut model = Self {
            isa,
            damping: scene.conditions.damping,
            mass_unit,
            boundaries: Boundaries::new(&scene, scene.dx),
            solids: Boundaries::new(&scene, 1.0),
            lagrangian: (0..scene.objects.len())
                .map(|id| SolidObject::new(&scene, id))
                .collect(),
            former: scene.objects.iter().map(|_| None).collect(),
            rules: Rules::new(&scene, scene.dx),
            half_spacings: half_spacings(&scene),
            cells_per_mass: parts
                .iter()
                .map(|part| mass_unit / (part.material.density * cell))
                .collect(),
            specific_volumes: objects.map(|o| o.material.density.recip()).collect(),
            constants: Constants::default(),
            scene_parts: parts.len(),
            portions: vec![],
            particle_counts: vec![],
            parts,
            scene,
        };
        model.paint(&[]);
        let at_rest: Vec<Material> = model.parts.iter().map(|p| p.material.clone()).collect();
        model.set_materials(&at_rest);
        model
    }

    /// Says per object whether it has gone over to the spatial grid; those that are not named have not.
    pub fn set_gone_over(&mut self, gone: &[bool]) {
        let solids = self.lagrangian.iter_mut().zip(&mut self.former);
        for (id, (present, former)) in solids.enumerate() {
            let is_gone = gone.get(id).copied().unwrap_or(false);
            if is_gone == present.is_some() {
                std::mem::swap(present, former);
            }
        }
    }

    /// Makes the constants of what commands may change.
    pub fn set_materials(&mut self, materials: &[Material]) {
        let parts = 0..self.parts.len();
        let rest = &DeformationBounds::REST;
        self.constants = Constants {
            laws: parts
                .clone()
                .map(|part| self.law(part, &materials[part]))
                .collect(),
            rest_dt: parts
                .map(|part| self.critical_dt(part, &materials[part], rest))
                .collect(),
        };
    }

    /// Law and numbers of a part.
    fn law(&self, part: usize, material: &Material) -> PartLaw {
        let dx = self.scene.dx;
        let density = self.parts[part].material.density;
        PartLaw {
            law: material.law,
            coefficients: Coefficients::new(material),
            cells_per_rest_mass: self.mass_unit / (density * dx * dx * dx),
            inertia: density * dx * dx,
            visible: self.is_visible(part),
        }
    }

    /// Bound of the substep of a part by the speed of sound, where it is of `material` and deformed within `bounds` [s].
    pub fn critical_dt(&self, part: usize, material: &Material, bounds: &DeformationBounds) -> f64 {
        let density = self.parts[part].material.density;
        let conditions = &self.scene.conditions;
        let kept = conditions.time_step_kept(material.law.is_fluid());
        kept * critical_dt(material, density, self.scene.dx, bounds)
    }

    /// Grid field of the particles of a part: objects that do not share one do not meet on the grid.
    pub fn field_of(&self, part: usize) -> u32 {
        match self.scene.contact.method {
            ContactMethod::SingleField => 0,
            ContactMethod::MultiField | ContactMethod::ComSphere | ContactMethod::TwoScale => {
                self.parts[part].object as u32
            }
        }
    }

    /// Grid field of every part.
    pub fn fields(&self) -> Vec<u32> {
        (0..self.parts.len()).map(|p| self.field_of(p)).collect()
    }

    /// Whether all matter is in one grid field.
    pub fn is_single_field(&self) -> bool {
        (0..self.parts.len()).all(|part| self.field_of(part) == 0)
    }

    /// Whether Gaussians follow a part.
    pub fn is_visible(&self, part: usize) -> bool {
        !self.scene.objects[self.parts[part].object]
            .gaussians
            .is_empty()
    }

    /// Whether the visible deformation of a part under this law must be carried apart from the elastic one.
    pub fn is_shaped(&self, part: usize, law: Law) -> bool {
        law.is_plastic() && self.is_visible(part)
    }

    /// Whether a part has particles that are not for show alone.
    pub fn has_particles(&self, part: usize) -> bool {
        let object = self.parts[part].object;
        self.scene.objects[object].fidelity != Fidelity::Static && self.particle_counts[part] > 0
    }

    /// Mass and volume of a particle at a place.
    pub fn grain(&self, object: usize, id: u32, x: [f64; 3]) -> Grain {
        let volume = self.scene.particles.volume[id as usize];
        let density = self.scene.objects[object].density_of(id as usize);
        Grain {
            x,
            mass: density * volume,
            volume,
        }
    }

    /// Whether a point [m] is in the domain.
    pub fn is_inside(&self, x: [f64; 3]) -> bool {
        let domain = &self.scene.domain;
        (0..3).all(|a| (domain.min[a]..=domain.max[a]).contains(&x[a]))
    }

    /// Smallest and largest position that a particle may have [cells].
    pub fn domain_in_cells(&self) -> [[f64; 3]; 2] {
        // Walls bring a particle back after the grid moved it.
        let slack = match self.scene.conditions.domain_policy {
            DomainPolicy::Bounce => 2.0,
            DomainPolicy::Delete | DomainPolicy::Stop => 0.0,
        };
        let cells = |x: f64| x / self.scene.dx;
        let inside = |x: f64| x.clamp(-MAX_CELLS, MAX_CELLS);
        [
            self.scene.domain.min.map(|x| inside(cells(x) - slack)),
            self.scene.domain.max.map(|x| inside(cells(x) + slack)),
        ]
    }
}

/// Largest particle mass [kg].
fn heaviest_particle(scene: &Scene, parts: &[Part]) -> f64 {
    let heaviest = parts.iter().flat_map(|part| {
        let volumes = &scene.particles.volume[part.particles.clone()];
        volumes.iter().map(|v| v * part.material.density)
    });
    heaviest.fold(f64::MIN_POSITIVE, f64::max)
}

/// Half the spacing of particles by their rest volume, in scene order [cells].
fn half_spacings(scene: &Scene) -> Vec<f64> {
    let volumes = scene.particles.volume.iter();
    volumes
        .map(|volume| half_spacing(volume / scene.dx.powi(3), 1.0))
        .collect()
}
