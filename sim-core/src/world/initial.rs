//! The scene at time 0 as particles in blocks.

use super::{State, Workspace, World, error::MAX_CELLS, published::Published};
use crate::{
    particles::{Extremes, position_in_cells},
    report::StepReport,
    scene::Fidelity,
    simd::LANES,
    step::sort::{Newcomer, place},
};

impl World {
    /// Back to the initial state; the count of steps goes on.
    pub(super) fn reset(&mut self) {
        let scene = &self.scene;
        let newcomers = self.newcomers();
        self.state = State {
            steps: self.state.steps,
            sim_time: 0.0,
            gravity: scene.gravity,
            materials: scene.objects.iter().map(|o| o.material.clone()).collect(),
            live: newcomers.len(),
            particles: place(&newcomers),
            drift: f64::INFINITY,
            extremes: vec![Extremes::NONE; scene.objects.len()],
            carrier: [0.0; 3],
            grid_speed: 0.0,
            removed: vec![],
            momentum: vec![[0.0; 3]; scene.objects.len()],
        };
        self.workspace = Workspace::default();
        self.published = Published::new(scene);
        self.flag_outside();
        self.take_out(|flags| flags.outside);
        self.report = StepReport::default();
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
    pub(super) fn mass_unit(&self) -> f64 {
        let objects = self.scene.objects.iter();
        let heaviest = objects.flat_map(|object| {
            let volumes = &self.scene.particles.volume[object.particles.clone()];
            volumes.iter().map(|v| v * object.material.density)
        });
        heaviest.fold(f64::MIN_POSITIVE, f64::max)
    }

    fn newcomers(&self) -> Vec<Newcomer> {
        let (scene, unit) = (&self.scene, self.mass_unit());
        let mut newcomers = Vec::with_capacity(scene.particles.position.len());
        for (id, object) in scene.objects.iter().enumerate() {
            if object.fidelity == Fidelity::Static {
                continue;
            }
            let particles = object.particles.clone();
            let volume: f64 = scene.particles.volume[particles.clone()].iter().sum();
            let mut com = [0.0; 3];
            for p in particles.clone() {
                for a in 0..3 {
                    com[a] += scene.particles.volume[p] / volume * scene.particles.position[p][a];
                }
            }
            let g = object.velocity_gradient;
            for p in particles {
                let x = scene.particles.position[p];
                let r: [f64; 3] = std::array::from_fn(|a| x[a] - com[a]);
                let v = std::array::from_fn(|a| {
                    let turn: f64 = (0..3).map(|b| g[a][b] * r[b]).sum();
                    ((object.linear_velocity[a] + turn) / scene.dx) as f32
                });
                newcomers.push(Newcomer {
                    id: p as u32,
                    object: id as u32,
                    x: x.map(|x| x / scene.dx),
                    v,
                    c: std::array::from_fn(|n| g[n / 3][n % 3] as f32),
                    mass: (scene.particles.volume[p] * object.material.density / unit) as f32,
                });
            }
        }
        newcomers
    }

    /// Smallest and largest position that a particle may have [cells].
    pub(super) fn domain_in_cells(&self) -> [[f64; 3]; 2] {
        let cells = |x: f64| (x / self.scene.dx).clamp(-MAX_CELLS, MAX_CELLS);
        [
            self.scene.domain.min.map(cells),
            self.scene.domain.max.map(cells),
        ]
    }
}
