//! Particle state in scene order and SI units: what clients, bindings and probes read.

use rayon::prelude::*;

use super::bodies::{IDENTITY, attitude, turned};
use crate::{
    mat3::cross,
    moments::ParticleArrays,
    particles::{NO_PARTICLE, Particles, position_in_cells},
    scene::{Fidelity, Scene},
    simd::{Isa, LANES},
    solid::{object::SolidObject, state::SolidState},
    state::{away::Loose, rigid::RigidBody},
};

/// Blocks per task at least.
const TASK: usize = 8;
/// Particles of a body per task at least.
const MEMBERS: usize = 1024;

/// Arrays in scene order.
#[derive(Clone, Debug, Default)]
pub(super) struct Published {
    /// Position [cells], exactly as the solver holds it.
    pub cells: Vec<[f64; 3]>,
    /// Position [m].
    pub position: Vec<[f32; 3]>,
    /// Velocity [m/s].
    pub velocity: Vec<[f32; 3]>,
    /// Affine velocity `C` [1/s], row-major.
    pub affine: Vec<[f32; 9]>,
    /// Visible deformation gradient, row-major.
    pub deformation: Vec<[f32; 9]>,
    /// Elastic deformation gradient, row-major; empty while no part keeps the two apart.
    pub elastic: Vec<[f32; 9]>,
    /// The laws' own number.
    pub memory: Vec<f32>,
    /// Rest volume [m^3]; 0 once a particle has been taken out, and for particles of static objects.
    pub volume: Vec<f64>,
}

/// An array that tasks write single entries of, each entry by one task.
struct Shared<T>(*mut T, usize);

// SAFETY: entries are only written through `set`, whose contract forbids two tasks on one entry.
unsafe impl<T: Send> Sync for Shared<T> {}

impl<T> Shared<T> {
    fn new(of: &mut [T]) -> Self {
        Self(of.as_mut_ptr(), of.len())
    }

    /// Writes one entry.
    ///
    /// # Safety
    /// While the borrow given to `new` lasts, no two tasks may write the same entry.
    unsafe fn set(&self, at: usize, value: T) {
        assert!(at < self.1, "entry {at} of {}", self.1);
        // SAFETY: in bounds by the assertion; exclusive by the caller's contract.
        unsafe { *self.0.add(at) = value };
    }
}

impl Published {
    /// Everything at rest at the scene's positions.
    pub fn new(scene: &Scene) -> Self {
        let count = scene.particles.position.len();
        let mut volume = vec![0.0; count];
        for object in &scene.objects {
            if object.fidelity != Fidelity::Static {
                let range = object.particles.clone();
                volume[range.clone()].copy_from_slice(&scene.particles.volume[range]);
            }
        }
        let position = &scene.particles.position;
        Self {
            cells: position.iter().map(|x| x.map(|x| x / scene.dx)).collect(),
            position: position.iter().map(|x| x.map(|x| x as f32)).collect(),
            velocity: vec![[0.0; 3]; count],
            affine: vec![[0.0; 9]; count],
            deformation: vec![IDENTITY; count],
            elastic: vec![],
            memory: vec![0.0; count],
            volume,
        }
    }

    /// All arrays.
    pub fn arrays(&self) -> ParticleArrays<'_, f32> {
        ParticleArrays {
            volume: &self.volume,
            position: &self.position,
            velocity: &self.velocity,
            affine: bytemuck::cast_slice(&self.affine),
            deformation: bytemuck::cast_slice(&self.deformation),
            elastic: bytemuck::cast_slice(match self.elastic.is_empty() {
                true => &self.deformation,
                false => &self.elastic,
            }),
            memory: &self.memory,
        }
    }

    /// Takes over the state of all simulated particles; those taken out keep their last.
    pub fn update(&mut self, particles: &Particles, frame_velocity: [f64; 3], dx: f64) {
        let cells = Shared::new(&mut self.cells);
        let position = Shared::new(&mut self.position);
        let velocity = Shared::new(&mut self.velocity);
        let affine = Shared::new(&mut self.affine);
        if self.elastic.is_empty() && !particles.shapes.is_empty() {
            self.elastic.clone_from(&self.deformation);
        }
        let apart = !self.elastic.is_empty();
        let deformation = Shared::new(&mut self.deformation);
        let elastic = Shared::new(&mut self.elastic);
        let memory = Shared::new(&mut self.memory);
        particles
            .blocks
            .par_iter()
            .with_min_len(TASK)
            .for_each(|block| {
                let runs = particles.runs[block.runs.clone()].iter();
                let groups = runs.flat_map(|run| {
                    let shapes = run.shapes.clone().map(Some).chain(std::iter::repeat(None));
                    run.groups.clone().zip(shapes)
                });
                for (g, shape) in groups {
                    let visible = match shape {
                        Some(shape) => &particles.shapes[shape].0,
                        None => &particles.groups[g].f,
                    };
                    let (group, motion) = (&particles.groups[g], &particles.motion[g]);
                    let id = &particles.fixed[g].id;
                    for lane in (0..LANES).filter(|&lane| id[lane] != NO_PARTICLE) {
                        // Loops, not closures: those are not always inlined, and this is most of a frame's
                        // cost outside the substeps.
                        let (mut x, mut v) = ([0.0; 3], [0.0; 3]);
                        for a in 0..3 {
                            x[a] = group.x[a].0[lane];
                            v[a] =
                                ((f64::from(motion.v[a].0[lane]) + frame_velocity[a]) * dx) as f32;
                        }
                        let (mut c, mut f, mut f_e) = ([0.0; 9], [0.0; 9], [0.0; 9]);
                        for n in 0..9 {
                            c[n] = motion.c[n].0[lane];
                            f[n] = visible[n].0[lane];
                            f_e[n] = group.f[n].0[lane];
                        }
                        let x = position_in_cells(block.index, x);
                        let at = id[lane] as usize;
                        // SAFETY: every id is in exactly one lane of one group, and a group belongs to one task.
                        unsafe {
                            cells.set(at, x);
                            position.set(
                                at,
                                [(x[0] * dx) as f32, (x[1] * dx) as f32, (x[2] * dx) as f32],
                            );
                            velocity.set(at, v);
                            affine.set(at, c);
                            deformation.set(at, f);
                            memory.set(at, particles.memory[g].0[lane]);
                            if apart {
                                elastic.set(at, f_e);
                            }
                        }
                    }
                }
            });
    }

    /// Writes the particles of a body that turns with `spin` [rad/s].
    pub fn update_body(&mut self, rigid: &RigidBody, spin: [f64; 3], dx: f64) {
        let body = &rigid.body;
        let [x, y, z] = spin.map(|w| w as f32);
        let gradient = [0.0, -z, y, z, 0.0, -x, -y, x, 0.0];
        let map = attitude(body);
        let cells = Shared::new(&mut self.cells);
        let position = Shared::new(&mut self.position);
        let velocity = Shared::new(&mut self.velocity);
        let affine = Shared::new(&mut self.affine);
        let apart = !self.elastic.is_empty();
        let deformation = Shared::new(&mut self.deformation);
        let elastic = Shared::new(&mut self.elastic);
        let memory = Shared::new(&mut self.memory);
        let members = rigid.members.par_iter().with_min_len(MEMBERS);
        members.for_each(|member| {
            let arm = map.mul_vec(member.place);
            let at: [f64; 3] = std::array::from_fn(|a| body.com[a] + arm[a]);
            let orbit = cross(spin, arm);
            let v = std::array::from_fn(|a| (body.velocity[a] + orbit[a]) as f32);
            let id = member.id as usize;
            // SAFETY: a particle is in one body once.
            unsafe {
                cells.set(id, at.map(|x| x / dx));
                position.set(id, at.map(|x| x as f32));
                velocity.set(id, v);
                affine.set(id, gradient);
                deformation.set(id, turned(&map, &member.visible));
                memory.set(id, member.memory);
                if apart {
                    elastic.set(id, turned(&map, &member.elastic));
                }
            }
        });
    }

    /// Writes the particles of a solid, of which `first` is the first; `rest` are the places of all at the start [m].
    pub fn update_solid(
        &mut self,
        isa: Isa,
        first: usize,
        (solid, rest): (&SolidObject, &[[f64; 3]]),
        state: &SolidState,
    ) {
        let per_cell = solid.grid.dx.recip();
        let cells = Shared::new(&mut self.cells);
        let position = Shared::new(&mut self.position);
        let velocity = Shared::new(&mut self.velocity);
        let affine = Shared::new(&mut self.affine);
        let apart = !self.elastic.is_empty();
        let deformation = Shared::new(&mut self.deformation);
        let elastic = Shared::new(&mut self.elastic);
        solid.sampling.sample(isa, &solid.grid, state, |sample| {
            let id = first + sample.particle as usize;
            // SAFETY: every particle is in one lane of one group.
            unsafe {
                cells.set(id, sample.x.map(|x| x * per_cell));
                position.set(id, sample.x.map(|x| x as f32));
                velocity.set(id, sample.v);
                affine.set(id, sample.gradient);
                deformation.set(id, sample.f);
                if apart {
                    elastic.set(id, sample.f);
                }
            }
        });
        for (particle, carried) in solid.carried_along(state) {
            let id = first + particle as usize;
            let x: [f64; 3] = std::array::from_fn(|a| rest[id][a] + carried.way[a]);
            self.cells[id] = x.map(|x| x * per_cell);
            self.position[id] = x.map(|x| x as f32);
            self.affine[id] = [0.0; 9];
            self.velocity[id] = carried.velocity.map(|v| v as f32);
            self.deformation[id] = IDENTITY;
            if apart {
                self.elastic[id] = IDENTITY;
            }
        }
    }

    /// Writes a particle that is in no array and no body.
    pub fn update_loose(&mut self, particle: &Loose, dx: f64) {
        let id = particle.id as usize;
        self.cells[id] = particle.x.map(|x| x / dx);
        self.position[id] = particle.x.map(|x| x as f32);
        self.deformation[id] = particle.visible;
        self.memory[id] = particle.memory;
        if !self.elastic.is_empty() {
            self.elastic[id] = particle.elastic;
        }
    }

    /// Stops a particle where it is.
    pub fn halt(&mut self, id: u32) {
        self.velocity[id as usize] = [0.0; 3];
        self.affine[id as usize] = [0.0; 9];
    }

    /// Freezes a particle that was taken out: it stays where it is, without motion or mass.
    pub fn freeze(&mut self, id: u32) {
        self.halt(id);
        self.volume[id as usize] = 0.0;
    }
}
