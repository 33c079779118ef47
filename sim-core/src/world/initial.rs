//! The scene at time 0 as particles in blocks.

use super::{World, published::Published};
use crate::{
    expression::GRADIENT_STEP,
    particles::{Extremes, position_in_cells},
    report::StepReport,
    scene::{Fidelity, Object, Scene},
    simd::LANES,
    state::{
        Commanded, GridMotion, Matter, Progress, RigidBodies, State, Workspace, sleep::SleepState,
    },
    step::sort::{Newcomer, place},
};

impl World {
    /// Back to the initial state; the count of steps goes on.
    pub(super) fn reset(&mut self) {
        self.sight.forget();
        self.model.paint(&[]);
        self.model.set_gone_over(&[]);
        let (model, newcomers) = (&self.model, self.newcomers());
        let (scene, parts) = (&model.scene, &model.parts);
        let objects = scene.objects.len();
        self.state = State {
            progress: Progress {
                steps: self.state.progress.steps,
                sim_time: 0.0,
                momentum: vec![[0.0; 3]; objects],
            },
            commanded: Commanded {
                gravity: scene.gravity,
                materials: parts.iter().map(|p| p.material.clone()).collect(),
                painted: vec![],
                paths: vec![None; scene.colliders.len()],
                pins: vec![None; objects],
                grabs: vec![],
                fidelity: vec![None; objects],
                away: vec![None; objects],
                shown: vec![None; objects],
            },
            levels: vec![SleepState::default(); objects],
            matter: Matter {
                particles: place(&newcomers, &model.fields()),
                shaped: (0..parts.len())
                    .map(|p| model.is_shaped(p, parts[p].material.law))
                    .collect(),
                live: newcomers.len(),
                removed: vec![],
                drift: f64::INFINITY,
                extremes: vec![Extremes::NONE; parts.len()],
            },
            motion: GridMotion::default(),
            in_contact: Default::default(),
            bodies: RigidBodies::default(),
            gone_over: vec![false; objects],
            solids: vec![],
        };
        self.workspace = Workspace::default();
        self.published = Published::new(scene);
        let commanded = &self.state.commanded;
        self.model.set_materials(&commanded.materials);
        self.flag_outside();
        self.take_out(|flags| flags.outside);
        self.form_bodies();
        self.publish_bodies();
        self.form_solids();
        self.publish_solids();
        self.report = StepReport::default();
        for object in 0..objects {
            if !self.model.scene.objects[object].present {
                self.remove(object);
            }
        }
        if self.model.scene.conditions.settle > 0.0 {
            self.come_to_rest(&newcomers);
            self.report = StepReport::default();
        }
    }

    /// Flags particles outside the domain.
    fn flag_outside(&mut self) {
        let [min, max] = self.model.domain_in_cells();
        let particles = &mut self.state.matter.particles;
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

    fn newcomers(&self) -> Vec<Newcomer> {
        let (scene, unit) = (&self.model.scene, self.model.mass_unit);
        let mut newcomers = Vec::with_capacity(scene.particles.position.len());
        for (id, part) in self.model.parts.iter().enumerate() {
            let object = &scene.objects[part.object];
            // Rigid matter becomes a body, and solids have nodes.
            if object.fidelity == Fidelity::Static
                || object.fidelity == Fidelity::Rigid
                || part.material.law.is_rigid()
                || self.model.lagrangian[part.object].is_some()
            {
                continue;
            }
            let velocity = self.initial_velocity(part.object);
            let (field, g) = (object.velocity.as_ref(), object.velocity_gradient);
            for p in part.particles.clone() {
                let x = scene.particles.position[p];
                let grown = field.map_or([[0.0; 3]; 3], |field| {
                    field.gradient(x, 0.0, GRADIENT_STEP * scene.dx)
                });
                let v = velocity(x).map(|v| (v / scene.dx) as f32);
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
}

impl World {
    /// Velocity [m/s] that an object begins with, over the position at rest [m].
    pub(super) fn initial_velocity(&self, object: usize) -> impl Fn([f64; 3]) -> [f64; 3] + '_ {
        let scene = &self.model.scene;
        let object = &scene.objects[object];
        let com = centre_of_mass(scene, object);
        move |x| {
            let r: [f64; 3] = std::array::from_fn(|a| x[a] - com[a]);
            let own = object.velocity.as_ref();
            let own = own.map_or([0.0; 3], |field| field.at(x, 0.0));
            let g = object.velocity_gradient;
            std::array::from_fn(|a| {
                let turn: f64 = (0..3).map(|b| g[a][b] * r[b]).sum();
                object.linear_velocity[a] + own[a] + turn
            })
        }
    }
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
