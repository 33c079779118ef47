//! What goes out each step, in wire types: frame in place, objects, status; and the scene once.

use std::{collections::VecDeque, time::Instant};

use cosplat_ipc::{
    schema::{
        self as wire, GaussianRest, GaussianState, ObjectInfo, SceneFile, SceneHeader, Status,
    },
    server::SceneBlocks,
};
use cosplat_scene::load::LoadedScene;
use cosplat_sim_core::{
    Scene, StepReport, World,
    report::{ObjectCost, Timings},
    scene::{ColliderShape, Fidelity, Object},
};
use xxhash_rust::xxh3::Xxh3;

use crate::{
    convert::{gaussian_objects, object_info, object_to_wire, source_to_wire},
    gaussians::GaussianWriter,
    serve::ServeSummary,
};

/// Steps over which rates are averaged, at most.
const RATE_WINDOW: usize = 60;

/// Turns the world's state into messages.
pub struct Output {
    /// Writes Gaussians.
    pub gaussians: GaussianWriter,
    /// `SERVER_*`.
    pub state: u32,
    recent: VecDeque<Recent>,
    totals: Totals,
}

/// A step of those over which rates are averaged.
struct Recent {
    at: Instant,
    sim_time: f64,
    timings: Timings,
    costs: Vec<ObjectCost>,
}

/// Sums over all steps.
#[derive(Default)]
struct Totals {
    particle_updates: u64,
    particle_updates_full: u64,
    rollbacks: u64,
    left: u64,
    quarantined: u64,
    spring_work: f64,
    edit_energy: f64,
    edit_mass: f64,
}

impl Output {
    /// Prepares what does not change from step to step.
    pub fn new(scene: &Scene) -> Output {
        Output {
            gaussians: GaussianWriter::new(scene),
            state: wire::SERVER_RUNNING,
            recent: VecDeque::new(),
            totals: Totals::default(),
        }
    }

    /// Writes every Gaussian of the frame.
    pub fn write_frame(&self, world: &World, slots: &mut [GaussianState]) {
        self.gaussians.write_all(world, slots);
    }

    /// All objects of the last step.
    pub fn objects(&self, world: &World) -> Vec<wire::ObjectState> {
        let states = world.report().objects.iter().enumerate();
        states
            .map(|(id, state)| object_to_wire(id, state))
            .collect()
    }

    /// Books a step.
    pub fn count(&mut self, report: &StepReport) {
        self.totals.particle_updates += report.particle_updates;
        self.totals.particle_updates_full += report.particle_updates_full;
        self.totals.rollbacks += u64::from(report.rollbacks);
        self.totals.left += report.left_domain.len() as u64;
        self.totals.quarantined += report.quarantined.len() as u64;
        self.totals.spring_work += report.spring_work;
        self.totals.edit_energy += report.edit_energy;
        self.totals.edit_mass += report.edit_mass;
        if self.recent.len() == RATE_WINDOW {
            self.recent.pop_front();
        }
        self.recent.push_back(Recent {
            at: Instant::now(),
            sim_time: report.sim_time,
            timings: report.timings,
            costs: report.costs.clone(),
        });
    }

    /// The newest figures.
    pub fn status(&self, report: &StepReport, summary: &ServeSummary) -> Status {
        let (steps_per_second, real_time_factor) = self.rates();
        let mut status = Status {
            step: report.step,
            sim_time: report.sim_time,
            steps_per_second,
            real_time_factor,
            modelled_fraction: self.modelled_fraction(),
            dt: report.dt_min,
            kinetic_energy: report.kinetic_energy,
            elastic_energy: report.elastic_energy,
            potential_energy: report.potential_energy,
            linear_momentum: report.linear_momentum,
            angular_momentum: report.angular_momentum,
            frames_published: summary.frames_published,
            frames_skipped: summary.frames_skipped,
            rollbacks: self.totals.rollbacks,
            particles_left: self.totals.left,
            particles_quarantined: self.totals.quarantined,
            commands_accepted: summary.commands_accepted,
            commands_refused: summary.commands_refused,
            state_hash: report.state_hash,
            dt_limit: report.dt_limit as u32,
            dt_object: report.dt_object.map_or(u32::MAX, |object| object as u32),
            server_state: self.state,
            spring_work: self.totals.spring_work,
            edit_energy: self.totals.edit_energy,
            edit_mass: self.totals.edit_mass,
            ..Status::default()
        };
        self.tell_costs(&mut status);
        status
    }

    /// Writes what the latest steps took, and which objects took most of it.
    fn tell_costs(&self, status: &mut Status) {
        let mut timings = Timings::default();
        let mut costs: Vec<ObjectCost> = vec![];
        for step in &self.recent {
            timings += step.timings;
            costs.resize_with(costs.len().max(step.costs.len()), ObjectCost::default);
            for (sum, cost) in costs.iter_mut().zip(&step.costs) {
                *sum += *cost;
            }
        }
        let steps = self.recent.len().max(1) as f64;
        status.step_seconds = timings.total / steps;
        if timings.total > 0.0 {
            status.phase_shares = timings.phases().map(|seconds| seconds / timings.total);
        }
        status.cost_objects = [u32::MAX; 3];
        let all: f64 = costs.iter().map(|cost| cost.seconds).sum();
        let mut dear: Vec<(usize, &ObjectCost)> = costs.iter().enumerate().collect();
        dear.retain(|(_, cost)| cost.seconds > 0.0);
        dear.sort_by(|a, b| b.1.seconds.total_cmp(&a.1.seconds));
        for (n, (object, cost)) in dear.into_iter().take(3).enumerate() {
            status.cost_objects[n] = object as u32;
            status.cost_shares[n] = cost.seconds / all;
            status.cost_substeps[n] = cost.substeps as f64 / steps;
            status.cost_limits[n] = cost.dt_limit as u32;
            status.cost_points[n] = cost.contact_points as u32;
            if cost.substeps > 0 {
                status.cost_dt[n] = cost.dt_min;
            }
        }
    }

    fn modelled_fraction(&self) -> f64 {
        match self.totals.particle_updates_full {
            0 => 1.0,
            full => self.totals.particle_updates as f64 / full as f64,
        }
    }

    /// Steps and simulated seconds per wall second; zero while nothing is known.
    fn rates(&self) -> (f64, f64) {
        let (Some(first), Some(last)) = (self.recent.front(), self.recent.back()) else {
            return (0.0, 0.0);
        };
        let wall = (last.at - first.at).as_secs_f64();
        if wall <= 0.0 {
            return (0.0, 0.0);
        }
        let steps = (self.recent.len() - 1) as f64;
        // A reset inside the window turns simulated time back; no rate is better than a negative one.
        (
            steps / wall,
            ((last.sim_time - first.sim_time) / wall).max(0.0),
        )
    }
}

/// Owned arrays behind the scene blocks.
pub struct SceneBuffers {
    gaussians: Vec<GaussianRest>,
    objects: Vec<ObjectInfo>,
    files: Vec<SceneFile>,
}

impl SceneBuffers {
    /// Converts the scene.
    pub fn new(loaded: &LoadedScene) -> SceneBuffers {
        let scene = &loaded.scene;
        let owners = gaussian_objects(scene);
        let rest = &scene.gaussians;
        SceneBuffers {
            gaussians: (0..rest.len())
                .map(|i| GaussianRest {
                    position: rest.position[i],
                    opacity: rest.opacity[i],
                    scale: rest.scale[i],
                    object: owners[i],
                    rotation: rest.rotation[i],
                })
                .collect(),
            objects: scene
                .objects
                .iter()
                .enumerate()
                .map(|(id, object)| object_info(id, object))
                .collect(),
            files: loaded.sources.iter().map(source_to_wire).collect(),
        }
    }

    /// The blocks as they are published.
    pub fn blocks<'a>(&'a self, loaded: &'a LoadedScene) -> SceneBlocks<'a> {
        let scene = &loaded.scene;
        let (bounds_min, bounds_max) = bounds(scene);
        SceneBlocks {
            header: SceneHeader {
                scene_hash: self.hash(loaded),
                frame_rate: scene.frame_rate,
                dx: scene.dx,
                gravity: scene.gravity,
                bounds_min,
                bounds_max,
                gaussian_count: scene.gaussians.len() as u32,
                particle_count: scene.particles.position.len() as u32,
                object_count: scene.objects.len() as u32,
                sh_degree: u32::from(scene.gaussians.sh_degree),
                feature_dim: scene.gaussians.feature_dim,
                ..SceneHeader::default()
            },
            gaussians: &self.gaussians,
            sh: &scene.gaussians.sh,
            objects: &self.objects,
            features: &scene.gaussians.feature,
            source: &loaded.text,
            files: &self.files,
        }
    }

    /// Hash of everything that makes a run: the scene's text, and what its assets turned into.
    fn hash(&self, loaded: &LoadedScene) -> u64 {
        let mut hash = Xxh3::new();
        hash.update(loaded.text.as_bytes());
        hash.update(bytemuck::cast_slice(&self.gaussians));
        hash.update(bytemuck::cast_slice(&loaded.scene.gaussians.sh));
        hash.update(bytemuck::cast_slice(&loaded.scene.particles.position));
        hash.update(bytemuck::cast_slice(&loaded.scene.particles.volume));
        hash.digest()
    }
}

/// Share of an object's Gaussians along each axis that may be floaters of the capture.
const FLOATERS: f64 = 0.005;

/// Box of what moves, or of everything where nothing does, without the farthest Gaussians; drawn out to a floor
/// not far below.
fn bounds(scene: &Scene) -> ([f32; 3], [f32; 3]) {
    let moving = |object: &&Object| object.fidelity != Fidelity::Static;
    let mut positions: Vec<[f32; 3]> = scene
        .objects
        .iter()
        .filter(moving)
        .flat_map(|object| &scene.gaussians.position[object.gaussians.clone()])
        .copied()
        .collect();
    if positions.is_empty() {
        positions.clone_from(&scene.gaussians.position);
    }
    let (mut min, mut max) = ([0.0; 3], [0.0; 3]);
    let Some(last) = positions.len().checked_sub(1) else {
        return (min, max);
    };
    let outliers = (positions.len() as f64 * FLOATERS) as usize;
    for axis in 0..3 {
        positions.sort_unstable_by(|a, b| a[axis].total_cmp(&b[axis]));
        min[axis] = positions[outliers][axis];
        max[axis] = positions[last - outliers][axis];
    }
    for collider in &scene.colliders {
        let ColliderShape::HalfSpace { normal } = collider.shape else {
            continue;
        };
        let point = collider.pose.translation;
        for axis in 0..3 {
            let (floor, height) = (point[axis] as f32, max[axis] - min[axis]);
            let faces = normal[axis] > 0.99 && floor < min[axis];
            if faces && min[axis] - floor < height {
                min[axis] = floor;
            }
        }
    }
    (min, max)
}

#[cfg(test)]
mod tests {
    use cosplat_scene::{
        assets::{Gaussians, ReadReport},
        scene_file,
    };

    use super::*;

    const SCENE: &str = r#"
version = 1
name = "two"
frame_rate = 60
dx = 0.1
particles_per_cell = 8

[domain]
min = [-2, -1, -2]
max = [2, 2, 2]

[[colliders]]
name = "floor"
normal = [0, 1, 0]
surface = "separate"

[[objects]]
name = "small"
shape = { kind = "box", size = [0.2, 0.2, 0.2] }
translation = [-0.6, 0.1, 0]
material = "soft_rubber"

[[objects]]
name = "large"
shape = { kind = "box", size = [0.6, 0.6, 0.6] }
translation = [0.4, 0.3, 0]
material = "soft_rubber"
"#;

    #[test]
    fn the_status_says_what_a_step_takes_and_by_whom() {
        assert_eq!(Timings::PHASES, wire::PHASES);
        let file = scene_file::SceneFile::parse(SCENE).unwrap_or_else(|e| panic!("{e}"));
        let mut load = |_: &str| Ok((Gaussians::default(), ReadReport::default()));
        let (scene, _) = scene_file::build(&file, &mut load).unwrap_or_else(|e| panic!("{e}"));
        let mut output = Output::new(&scene);
        let mut world = World::new(scene).expect("valid");
        let nothing = output.status(world.report(), &ServeSummary::default());
        assert_eq!(
            (nothing.step_seconds, nothing.cost_objects),
            (0.0, [u32::MAX; 3])
        );
        let (mut substeps, mut smallest) = (0, f64::INFINITY);
        for _ in 0..5 {
            world.step(1.0 / 60.0, &[]);
            output.count(world.report());
            let cost = &world.report().costs[1];
            substeps += cost.substeps;
            smallest = smallest.min(cost.dt_min);
        }
        let status = output.status(world.report(), &ServeSummary::default());
        assert!(status.step_seconds > 0.0);
        let phases: f64 = status.phase_shares.iter().sum();
        assert!(phases > 0.1 && phases <= 1.0, "{phases}");
        // 27 times the matter.
        assert_eq!(status.cost_objects, [1, 0, u32::MAX]);
        let shares = status.cost_shares;
        assert!((shares[0] + shares[1] - 1.0).abs() < 1e-12 && shares[0] > shares[1]);
        assert_eq!(status.cost_substeps[0], substeps as f64 / 5.0);
        assert_eq!(status.cost_dt[0], smallest);
        assert!(status.cost_points[0] > 0, "it stands on the floor");
    }
}
