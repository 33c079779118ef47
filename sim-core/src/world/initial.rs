//! The scene at time 0 as particles in blocks.

use super::{State, Workspace, World, error::MAX_CELLS, fidelity::Standing, published::Published};
use crate::{
    colliders::approach::half_spacing,
    expression::GRADIENT_STEP,
    materials::Law,
    particles::{Extremes, position_in_cells},
    report::StepReport,
    scene::{ContactMethod, DomainPolicy, Fidelity, Object, Scene},
    simd::LANES,
    step::sort::{Newcomer, place},
};

impl World {
    /// Back to the initial state; the count of steps goes on.
    pub(super) fn reset(&mut self) {
        let scene = &self.scene;
        let newcomers = self.newcomers();
        let fields: Vec<u32> = (0..self.parts.len()).map(|p| self.field_of(p)).collect();
        self.state = State {
            steps: self.state.steps,
            sim_time: 0.0,
            lag: 0.0,
            lags: vec![0.0; scene.objects.len()],
            gravity: scene.gravity,
            materials: self.parts.iter().map(|p| p.material.clone()).collect(),
            shaped: (0..self.parts.len())
                .map(|p| self.is_shaped(p, self.parts[p].material.law))
                .collect(),
            live: newcomers.len(),
            particles: place(&newcomers, &fields),
            drift: f64::INFINITY,
            extremes: vec![Extremes::NONE; self.parts.len()],
            carrier: [0.0; 3],
            grid_speed: 0.0,
            removed: vec![],
            paths: vec![None; scene.colliders.len()],
            pins: vec![None; scene.objects.len()],
            rigid: vec![],
            pressing: vec![],
            standing: vec![Standing::default(); scene.objects.len()],
            episodes: Default::default(),
            momentum: vec![[0.0; 3]; scene.objects.len()],
        };
        self.workspace = Workspace::default();
        self.published = Published::new(scene);
        self.flag_outside();
        self.take_out(|flags| flags.outside);
        self.form_bodies();
        self.publish_bodies();
        self.report = StepReport::default();
        if self.scene.conditions.settle > 0.0 {
            self.come_to_rest(&newcomers);
            self.report = StepReport::default();
        }
    }

    /// Flags particles outside the domain.
    fn flag_outside(&mut self) {
        let [min, max] = self.domain_in_cells();
        let particles = &mut self.state.particles;
        for block in &particles.blocks {
            for g in block.groups.clone() {
                let x = &particles.groups[g].x;
                for lane in 0..LANES {
                    let x = position_in_cells(block.index, [0, 1, 2].map(|a| x[a].0[lane]));
                    let outside = (0..3).any(|a| x[a] < min[a] || x[a] > max[a]);
                    particles.flags[g].outside |= u16::from(outside) << lane;
                }
            }
        }
    }

    /// Largest particle mass [kg]: the solver's unit, so that single precision never under- or overflows.
    pub(super) fn heaviest_particle(&self) -> f64 {
        let heaviest = self.parts.iter().flat_map(|part| {
            let volumes = &self.scene.particles.volume[part.particles.clone()];
            volumes.iter().map(|v| v * part.material.density)
        });
        heaviest.fold(f64::MIN_POSITIVE, f64::max)
    }

    /// Grid field of the particles of a part: objects that do not share one do not meet on the grid.
    pub(super) fn field_of(&self, part: usize) -> u32 {
        match self.scene.contact.method {
            ContactMethod::SingleField => 0,
            ContactMethod::MultiField | ContactMethod::ComSphere | ContactMethod::TwoScale => {
                self.parts[part].object as u32
            }
        }
    }

    /// Whether the visible deformation of a part under this law must be carried apart from the elastic one.
    pub(super) fn is_shaped(&self, part: usize, law: Law) -> bool {
        law.is_plastic() && self.is_visible(part)
    }

    /// Whether Gaussians follow a part.
    pub(super) fn is_visible(&self, part: usize) -> bool {
        !self.scene.objects[self.parts[part].object]
            .gaussians
            .is_empty()
    }

    fn newcomers(&self) -> Vec<Newcomer> {
        let (scene, unit) = (&self.scene, self.mass_unit);
        let mut newcomers = Vec::with_capacity(scene.particles.position.len());
        for (id, part) in self.parts.iter().enumerate() {
            let object = &scene.objects[part.object];
            // Rigid matter becomes a body.
            if object.fidelity == Fidelity::Static
                || object.fidelity == Fidelity::Rigid
                || part.material.law.is_rigid()
            {
                continue;
            }
            let com = centre_of_mass(scene, object);
            let g = object.velocity_gradient;
            for p in part.particles.clone() {
                let x = scene.particles.position[p];
                let r: [f64; 3] = std::array::from_fn(|a| x[a] - com[a]);
                let field = object.velocity.as_ref();
                let (own, grown) = field.map_or(([0.0; 3], [[0.0; 3]; 3]), |field| {
                    (
                        field.at(x, 0.0),
                        field.gradient(x, 0.0, GRADIENT_STEP * scene.dx),
                    )
                });
                let v = std::array::from_fn(|a| {
                    let turn: f64 = (0..3).map(|b| g[a][b] * r[b]).sum();
                    ((object.linear_velocity[a] + own[a] + turn) / scene.dx) as f32
                });
                newcomers.push(Newcomer {
                    id: p as u32,
                    part: id as u32,
                    x: x.map(|x| x / scene.dx),
                    v,
                    c: std::array::from_fn(|n| (g[n / 3][n % 3] + grown[n / 3][n % 3]) as f32),
                    mass: (scene.particles.volume[p] * part.material.density / unit) as f32,
                });
            }
        }
        newcomers
    }

    /// Smallest and largest position that a particle may have [cells].
    pub(super) fn domain_in_cells(&self) -> [[f64; 3]; 2] {
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

/// Half the spacing of particles by their rest volume, in scene order [cells].
pub(super) fn half_spacings(scene: &Scene) -> Vec<f64> {
    let volumes = scene.particles.volume.iter();
    volumes
        .map(|volume| half_spacing(volume / scene.dx.powi(3), 1.0))
        .collect()
}

/// Of an object at rest [m].
fn centre_of_mass(scene: &Scene, object: &Object) -> [f64; 3] {
    let (mut mass, mut com) = (0.0, [0.0; 3]);
    for p in object.particles.clone() {
        mass += scene.particles.volume[p] * object.density_of(p);
    }
    for p in object.particles.clone() {
        let share = scene.particles.volume[p] * object.density_of(p) / mass;
        for a in 0..3 {
            com[a] += share * scene.particles.position[p][a];
        }
    }
    com
}
