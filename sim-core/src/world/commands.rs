//! Commands: checked before anything changes, then applied at the start of a frame.

use std::borrow::Cow;

use super::{
    World,
    bounds::{MAX_LENGTH, finite, within},
    frame::Frame,
    grab::Grasp,
};
use crate::{
    colliders::Path,
    command::{Action, Command, CommandError, Patch},
    mat3::{cross, length},
    materials::Material,
    particles::{NO_PARTICLE, position_in_cells},
    scene::{Fidelity, Pose},
    simd::LANES,
};

/// Substeps of a frame that the fastest commanded motion may need.
const MOTION_SUBSTEPS: f64 = 4096.0;
/// Largest commanded gravity [m/s^2].
const MAX_GRAVITY: f64 = 1e4;

/// What an accepted action does to particles.
pub(super) enum Effect<'a> {
    /// The same velocity change [m/s] for these particles, a sorted list, or for all of the object.
    Push {
        object: usize,
        change: [f64; 3],
        particles: Option<Vec<u32>>,
    },
    Velocity {
        object: usize,
        linear: [f64; 3],
        angular: [f64; 3],
    },
    Material {
        object: usize,
        region: Option<usize>,
        /// A sorted list, or all.
        particles: Option<Vec<u32>>,
        material: Cow<'a, Material>,
    },
    Gravity([f64; 3]),
    Path {
        collider: usize,
        path: Path,
    },
    Pin {
        object: usize,
        particles: Vec<u32>,
    },
    Release {
        object: usize,
    },
    /// A force [N] and a torque [N m] during the frame, on these particles, a sorted list, or on all of the object.
    Force {
        object: usize,
        force: [f64; 3],
        torque: [f64; 3],
        particles: Option<Vec<u32>>,
    },
    /// A patch is taken hold of, dragged or let go.
    Grasp {
        object: usize,
        grasp: Grasp,
    },
    /// A rigid motion of the object.
    Place {
        object: usize,
        way: Pose,
    },
    Fidelity {
        object: usize,
        fidelity: Fidelity,
    },
    Remove {
        object: usize,
    },
    /// The object is brought in after a rigid motion.
    BringIn {
        object: usize,
        way: Pose,
    },
    Undo,
    Redo,
    Save(u32),
    Restore(u32),
    Reset,
}

impl World {
    /// Judges an action against the current state.
    ///
    /// # Errors
    /// [`CommandError`] names what is wrong and what is expected.
    pub fn check(&self, action: &Action) -> Result<(), CommandError> {
        self.effect(action).map(|_| ())
    }

    /// Applies commands in their order; one that is refused changes nothing.
    pub(super) fn apply(&mut self, commands: &[Command], frame: &mut Frame) {
        let mut order: Vec<&Command> = commands.iter().collect();
        order.sort_by_key(|c| (c.apply_at_step, c.client, c.sequence));
        for command in order {
            if let Ok(effect) = self.effect(&command.action) {
                if command.action.is_edit() {
                    self.remember();
                }
                self.enact(effect, frame);
            }
        }
    }

    /// Largest speed that a command may cause [m/s].
    pub(super) fn max_speed(&self) -> f64 {
        0.5 * MOTION_SUBSTEPS * self.model.scene.dx * self.model.scene.frame_rate
    }

    /// Checks an action and works out what it does.
    fn effect<'a>(&self, action: &'a Action) -> Result<Effect<'a>, CommandError> {
        match *action {
            Action::Impulse { object, impulse } => self.checked_push(object, impulse),
            Action::ImpulseAt {
                object,
                impulse,
                point,
                radius,
            } => self.push_at(object, impulse, point, radius),
            Action::SetVelocity {
                object,
                linear,
                angular,
            } => self.checked_velocity(object, linear, angular),
            Action::SetMaterial {
                object,
                region,
                patch,
                ref material,
            } => self.checked_material(object, region, patch, material),
            Action::SetGravity { gravity } => {
                finite("gravity", &gravity)?;
                within("gravity", length(gravity), 0.0, MAX_GRAVITY)?;
                Ok(Effect::Gravity(gravity))
            }
            Action::MoveCollider { collider, pose } => self.path(collider, pose),
            Action::ColliderVelocity {
                collider,
                linear,
                angular,
            } => self.path_at(collider, linear, angular),
            Action::Force {
                object,
                force,
                torque,
            } => self.force(object, force, torque),
            Action::ForceAt {
                object,
                force,
                point,
                radius,
            } => self.force_at(object, force, point, radius),
            Action::Hold {
                holder,
                object,
                ref change,
            } => {
                let grasp = self.checked_hold(holder, object, change)?;
                Ok(Effect::Grasp { object, grasp })
            }
            Action::Pin {
                object,
                point,
                radius,
            } => self.pin(object, point, radius),
            Action::Release { object } => {
                self.mass_of(object)?;
                Ok(Effect::Release { object })
            }
            Action::Reset => Ok(Effect::Reset),
            Action::SetPose { .. }
            | Action::SetFidelity { .. }
            | Action::Remove { .. }
            | Action::BringIn { .. }
            | Action::Undo
            | Action::Redo
            | Action::Save { .. }
            | Action::Restore { .. } => self.whole(action),
        }
    }

    /// The same of what edits objects as a whole, and of what goes back to states.
    fn whole<'a>(&self, action: &'a Action) -> Result<Effect<'a>, CommandError> {
        match *action {
            Action::SetPose { object, ref place } => {
                let way = self.checked_place(object, place)?;
                Ok(Effect::Place { object, way })
            }
            Action::BringIn { object, ref place } => {
                let way = self.checked_entry(object, place)?;
                Ok(Effect::BringIn { object, way })
            }
            Action::Remove { object } => {
                self.check_present(object)?;
                Ok(Effect::Remove { object })
            }
            Action::SetFidelity { object, fidelity } => {
                self.check_fidelity(object, fidelity)?;
                Ok(Effect::Fidelity { object, fidelity })
            }
            Action::Undo => self.can_go(true).map(|()| Effect::Undo),
            Action::Redo => self.can_go(false).map(|()| Effect::Redo),
            Action::Save { snapshot } => {
                self.has_room_for(snapshot)?;
                Ok(Effect::Save(snapshot))
            }
            Action::Restore { snapshot } => {
                self.has_snapshot(snapshot)?;
                Ok(Effect::Restore(snapshot))
            }
            ref other => self.effect(other),
        }
    }

    /// An impulse on all particles of an object.
    fn checked_push<'a>(
        &self,
        object: usize,
        impulse: [f64; 3],
    ) -> Result<Effect<'a>, CommandError> {
        let mass = self.mass_of(object)?;
        finite("impulse", &impulse)?;
        within("impulse", length(impulse), 0.0, mass * self.max_speed())?;
        Ok(Effect::Push {
            object,
            change: impulse.map(|j| j / mass),
            particles: None,
        })
    }

    /// Another material for an object, a region or a patch.
    fn checked_material<'a>(
        &self,
        object: usize,
        region: Option<usize>,
        patch: Option<Patch>,
        material: &'a Material,
    ) -> Result<Effect<'a>, CommandError> {
        self.mass_of(object)?;
        self.check_region(object, region)?;
        self.check_material(object, material)?;
        self.check_keeps_shape(object, material)?;
        let particles = patch
            .map(|patch| self.painted_by(object, region, &patch, material))
            .transpose()?;
        Ok(Effect::Material {
            object,
            region,
            particles,
            material: Cow::Borrowed(material),
        })
    }

    /// Velocity and spin of an object.
    fn checked_velocity<'a>(
        &self,
        object: usize,
        linear: [f64; 3],
        angular: [f64; 3],
    ) -> Result<Effect<'a>, CommandError> {
        self.mass_of(object)?;
        finite("linear velocity", &linear)?;
        finite("angular velocity", &angular)?;
        within("linear velocity", length(linear), 0.0, self.max_speed())?;
        let reach = 2.0 * self.report.objects[object].radius + self.model.scene.dx;
        let max_spin = self.max_speed() / reach;
        within("angular velocity", length(angular), 0.0, max_spin)?;
        Ok(Effect::Velocity {
            object,
            linear,
            angular,
        })
    }

    /// An impulse on the particles near a point.
    fn push_at<'a>(
        &self,
        object: usize,
        impulse: [f64; 3],
        point: [f64; 3],
        radius: f64,
    ) -> Result<Effect<'a>, CommandError> {
        self.mass_of(object)?;
        finite("impulse", &impulse)?;
        finite("point", &point)?;
        for x in point {
            within("point", x, -MAX_LENGTH, MAX_LENGTH)?;
        }
        within("radius", radius, f64::MIN_POSITIVE, MAX_LENGTH)?;
        let particles = self.within_reach(object, point, radius);
        let mass = self.mass_of_particles(object, &particles);
        within("impulse", length(impulse), 0.0, mass * self.max_speed())?;
        Ok(Effect::Push {
            object,
            change: impulse.map(|j| j / mass),
            particles: Some(particles),
        })
    }

    /// Holds the particles near a point, or all.
    fn pin<'a>(
        &self,
        object: usize,
        point: [f64; 3],
        radius: f64,
    ) -> Result<Effect<'a>, CommandError> {
        self.mass_of(object)?;
        let particles = if radius == f64::INFINITY {
            let all = self.model.scene.objects[object].particles.clone();
            all.map(|p| p as u32).collect()
        } else {
            for x in point {
                within("point", x, -MAX_LENGTH, MAX_LENGTH)?;
            }
            within("radius", radius, f64::MIN_POSITIVE, MAX_LENGTH)?;
            self.within_reach(object, point, radius)
        };
        Ok(Effect::Pin { object, particles })
    }

    /// The way of a collider through the coming frame.
    pub(super) fn path<'a>(&self, collider: usize, pose: Pose) -> Result<Effect<'a>, CommandError> {
        let count = self.model.scene.colliders.len();
        if collider >= count {
            return Err(CommandError::UnknownCollider { collider, count });
        }
        for x in pose.translation {
            within("position", x, -MAX_LENGTH, MAX_LENGTH)?;
        }
        finite("rotation", &pose.rotation)?;
        let norm = pose.rotation.iter().map(|x| x * x).sum::<f64>().sqrt();
        within("length of the rotation", norm, 1e-6, 1e6)?;
        let to = Pose {
            rotation: pose.rotation.map(|x| x / norm),
            ..pose
        };
        let from = self.collider_pose(collider);
        let shift: [f64; 3] = std::array::from_fn(|a| to.translation[a] - from.translation[a]);
        let speed = length(shift) * self.model.scene.frame_rate;
        within("collider speed", speed, 0.0, self.max_speed())?;
        Ok(Effect::Path {
            collider,
            path: Path { from, to },
        })
    }

    /// Mass of an object's simulated particles [kg].
    pub(super) fn mass_of(&self, object: usize) -> Result<f64, CommandError> {
        let count = self.model.scene.objects.len();
        let Some(o) = self.model.scene.objects.get(object) else {
            return Err(CommandError::UnknownObject { object, count });
        };
        let mass = self.report.objects[object].mass;
        if self.is_removed(object) {
            return Err(CommandError::Removed { object });
        }
        if o.fidelity == Fidelity::Static {
            return Err(CommandError::StaticObject { object });
        }
        if mass <= 0.0 {
            let particles = o.particles.len();
            return Err(CommandError::NothingLeft { object, particles });
        }
        Ok(mass)
    }

    /// Mass of some particles of an object [kg].
    pub(super) fn mass_of_particles(&self, object: usize, particles: &[u32]) -> f64 {
        let owner = &self.model.scene.objects[object];
        let volume = &self.published.volume;
        let masses = particles.iter().map(|&p| {
            let p = p as usize;
            owner.density_of(p) * volume[p]
        });
        masses.sum()
    }

    fn check_region(&self, object: usize, region: Option<usize>) -> Result<(), CommandError> {
        let count = self.model.scene.objects[object].regions.len();
        match region {
            Some(region) if region >= count => Err(CommandError::UnknownRegion {
                object,
                region,
                count,
            }),
            _ => Ok(()),
        }
    }

    /// Simulated particles of an object within `radius` of `point` [m], ascending; the nearest when there are
    /// none.
    pub(super) fn within_reach(&self, object: usize, point: [f64; 3], radius: f64) -> Vec<u32> {
        let dx = self.model.scene.dx;
        let candidates = self.model.scene.objects[object].particles.clone();
        let distances: Vec<(u32, f64)> = candidates
            .filter(|&p| self.published.volume[p] > 0.0)
            .map(|p| {
                let x = self.published.cells[p];
                (
                    p as u32,
                    length(std::array::from_fn(|a| x[a] * dx - point[a])),
                )
            })
            .collect();
        let nearest = distances.iter().map(|d| d.1).fold(f64::INFINITY, f64::min);
        let reach = radius.max(nearest);
        let touched = distances.into_iter().filter(|d| d.1 <= reach);
        touched.map(|d| d.0).collect()
    }

    fn enact(&mut self, effect: Effect<'_>, frame: &mut Frame) {
        match effect {
            Effect::Push { object, .. }
            | Effect::Velocity { object, .. }
            | Effect::Material { object, .. }
            | Effect::Pin { object, .. }
            | Effect::Force { object, .. }
            | Effect::Grasp { object, .. }
            | Effect::Release { object } => {
                self.wake(object);
                self.restore_particles(object);
            }
            Effect::Gravity(_) => self.wake_all(),
            // What a collider comes near is woken when the frame begins; a reset forgets all sleep.
            // Edits of objects wake what they must.
            _ => {}
        }
        match effect {
            Effect::Push {
                object,
                change,
                particles,
            } => self.push(object, change, particles.as_deref()),
            Effect::Velocity {
                object,
                linear,
                angular,
            } => self.set_velocity(object, linear, angular),
            Effect::Material {
                object,
                region,
                particles,
                material,
            } => {
                self.go_over_for(object, particles.as_deref(), &material, frame);
                self.change_material(object, region, particles.as_deref(), &material);
            }
            Effect::Gravity(gravity) => self.state.commanded.gravity = gravity,
            Effect::Path { collider, path } => {
                self.state.commanded.paths[collider] = Some(path);
                // Which blocks it may reach is no longer known.
                self.state.matter.drift = f64::INFINITY;
            }
            Effect::Pin { object, particles } => {
                let pin = self.state.commanded.pins[object].get_or_insert_default();
                pin.extend(&particles);
                self.state.matter.drift = f64::INFINITY;
            }
            Effect::Release { object } => {
                self.state.commanded.pins[object] = None;
                self.state.matter.drift = f64::INFINITY;
            }
            Effect::Force {
                object,
                force,
                torque,
                particles,
            } => self.hold_force(object, force, torque, particles.as_deref()),
            Effect::Grasp { grasp, .. } => self.change_grabs(grasp),
            Effect::Place { object, way } => self.put_elsewhere(object, &way),
            Effect::Fidelity { object, fidelity } => self.recast(object, fidelity),
            Effect::Remove { object } => self.remove(object),
            Effect::BringIn { object, way } => self.bring_in(object, &way),
            Effect::Undo => self.go(true),
            Effect::Redo => self.go(false),
            Effect::Save(snapshot) => self.save(snapshot),
            Effect::Restore(snapshot) => self.bring_back_snapshot(snapshot),
            Effect::Reset => {
                self.model.rules.commanded.clear();
                self.reset();
                self.report = self.measure(&Frame::new(0.0));
            }
        }
    }

    /// Adds `change` [m/s] to the velocity of an object's particles, all or those listed.
    fn push(&mut self, object: usize, change: [f64; 3], particles: Option<&[u32]>) {
        self.push_body(object, change, particles);
        self.push_solid(object, change, particles);
        let cells = change.map(|v| (v / self.model.scene.dx) as f32);
        self.add_velocity(object, cells, particles);
        let mass = match particles {
            None => self.report.objects[object].mass,
            Some(list) => self.mass_of_particles(object, list),
        };
        for a in 0..3 {
            self.state.progress.momentum[object][a] += mass * change[a];
        }
    }

    /// Adds `change` [cells/s] to the velocity of an object's particles, all or those of a sorted list.
    pub(super) fn add_velocity(
        &mut self,
        object: usize,
        change: [f32; 3],
        particles: Option<&[u32]>,
    ) {
        let touched = |id: u32| particles.is_none_or(|list| list.binary_search(&id).is_ok());
        let all = &mut self.state.matter.particles;
        let parts = &self.model.parts;
        let runs = all.runs.iter();
        for run in runs.filter(|run| parts[run.part].object == object) {
            for g in run.groups.clone() {
                for lane in 0..LANES {
                    let id = all.fixed[g].id[lane];
                    if id != NO_PARTICLE && touched(id) {
                        for a in 0..3 {
                            all.motion[g].v[a].0[lane] += change[a];
                        }
                    }
                }
            }
        }
    }

    /// Gives an object a rigid velocity field about its centre of mass.
    fn set_velocity(&mut self, object: usize, linear: [f64; 3], angular: [f64; 3]) {
        let dx = self.model.scene.dx;
        let state = self.report.objects[object];
        self.set_solid_velocity(object, linear, angular);
        if let Some(body) = self.state.bodies.of[object].as_ref().map(|r| r.body) {
            let r = std::array::from_fn(|a| body.com[a] - state.com[a]);
            let turn = cross(angular, r);
            let there = std::array::from_fn(|a| linear[a] + turn[a]);
            self.set_body_velocity(object, there, angular);
        }
        let (frame_velocity, offset_velocity) =
            (self.state.motion.frame_velocity, self.offset_velocity());
        let [x, y, z] = angular;
        let spin = [0.0, -z, y, z, 0.0, -x, -y, x, 0.0];
        let all = &mut self.state.matter.particles;
        for block in &all.blocks {
            let runs = all.runs[block.runs.clone()].iter();
            for g in runs
                .filter(|run| self.model.parts[run.part].object == object)
                .flat_map(|run| run.groups.clone())
            {
                for lane in (0..LANES).filter(|&lane| all.fixed[g].id[lane] != NO_PARTICLE) {
                    let at = [0, 1, 2].map(|a| all.groups[g].x[a].0[lane]);
                    let at = position_in_cells(block.index, at);
                    let r = std::array::from_fn(|a| at[a] * dx - state.com[a]);
                    let turn = cross(angular, r);
                    for a in 0..3 {
                        all.motion[g].v[a].0[lane] =
                            ((linear[a] - offset_velocity[a] + turn[a]) / dx - frame_velocity[a])
                                as f32;
                    }
                    for n in 0..9 {
                        all.motion[g].c[n].0[lane] = spin[n] as f32;
                    }
                }
            }
        }
        let behind = state.mass - self.mass_of_body(object);
        self.state.progress.momentum[object] =
            [0, 1, 2].map(|a| state.mass * linear[a] - behind * offset_velocity[a]);
    }
}
