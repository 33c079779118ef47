//! Forces that commands hold during a frame, and states that they keep.

use super::{
    World,
    bounds::{MAX_LENGTH, finite, within},
    commands::Effect,
};
use crate::{
    colliders::commanded::{CommandedForce, Loaded, angular_acceleration},
    command::CommandError,
    mat3::length,
    rotation::{from_rotation_vector, product},
    scene::Pose,
};

/// States that are kept at once, at most.
pub(super) const MOST_SNAPSHOTS: usize = 16;

impl World {
    /// A force and a torque on an object during the coming frame.
    pub(super) fn force<'a>(
        &self,
        object: usize,
        force: [f64; 3],
        torque: [f64; 3],
    ) -> Result<Effect<'a>, CommandError> {
        let mass = self.mass_of(object)?;
        self.check_force(force, mass)?;
        finite("torque", &torque)?;
        let turning = self.turning(object, torque)?;
        let scene = &self.model.scene;
        let reach = 2.0 * self.report.objects[object].radius + scene.dx;
        let fastest = self.max_speed() / reach * scene.frame_rate;
        within("angular acceleration by the torque", turning, 0.0, fastest)?;
        Ok(Effect::Force {
            object,
            force,
            torque,
            particles: None,
        })
    }

    /// A force on an object's particles around a point during the coming frame.
    pub(super) fn force_at<'a>(
        &self,
        object: usize,
        force: [f64; 3],
        point: [f64; 3],
        radius: f64,
    ) -> Result<Effect<'a>, CommandError> {
        self.mass_of(object)?;
        for x in point {
            within("point", x, -MAX_LENGTH, MAX_LENGTH)?;
        }
        within("radius", radius, f64::MIN_POSITIVE, MAX_LENGTH)?;
        let particles = self.within_reach(object, point, radius);
        self.check_force(force, self.mass_of_particles(object, &particles))?;
        Ok(Effect::Force {
            object,
            force,
            torque: [0.0; 3],
            particles: Some(particles),
        })
    }

    /// Judges a force on so much mass [kg].
    fn check_force(&self, force: [f64; 3], mass: f64) -> Result<(), CommandError> {
        finite("force", &force)?;
        let strongest = mass * self.max_speed() * self.model.scene.frame_rate;
        within("force", length(force), 0.0, strongest)
    }

    /// The way of a collider at constant velocity through the coming frame.
    pub(super) fn path_at<'a>(
        &self,
        collider: usize,
        linear: [f64; 3],
        angular: [f64; 3],
    ) -> Result<Effect<'a>, CommandError> {
        let count = self.model.scene.colliders.len();
        if collider >= count {
            return Err(CommandError::UnknownCollider { collider, count });
        }
        finite("velocity", &linear)?;
        finite("angular velocity", &angular)?;
        // Half a turn in a frame could be one in either direction.
        let fastest = 0.99 * std::f64::consts::PI * self.model.scene.frame_rate;
        within("angular velocity", length(angular), 0.0, fastest)?;
        let now = self.collider_pose(collider);
        let frame = self.model.scene.frame_rate.recip();
        let turn = from_rotation_vector(angular.map(|w| frame * w));
        let pose = Pose {
            translation: std::array::from_fn(|a| now.translation[a] + frame * linear[a]),
            rotation: product(turn, now.rotation),
        };
        self.path(collider, pose)
    }

    /// The particles of an object with their masses where a force acts: on those listed, a sorted list, or on all.
    fn loaded(&self, object: usize, particles: Option<&[u32]>) -> Vec<Loaded> {
        let owner = &self.model.scene.objects[object];
        let touched = |p: usize| match particles {
            None => true,
            Some(list) => list.binary_search(&(p as u32)).is_ok(),
        };
        let all = owner.particles.clone();
        all.map(|p| Loaded {
            place: self.published.cells[p].map(|x| x * self.model.scene.dx),
            mass: match touched(p) {
                true => owner.density_of(p) * self.published.volume[p],
                false => 0.0,
            },
        })
        .collect()
    }

    /// Angular acceleration of an object by a torque [N m] about its centre of mass [rad/s^2].
    pub(super) fn turning(&self, object: usize, torque: [f64; 3]) -> Result<f64, CommandError> {
        let particles = match torque == [0.0; 3] {
            true => vec![],
            false => self.loaded(object, None),
        };
        angular_acceleration(&particles, torque)
            .map(length)
            .ok_or(CommandError::TooThin { object })
    }

    /// Lets a force [N] and a torque [N m] act on an object's particles, all or those listed, during the coming frame.
    pub(super) fn hold_force(
        &mut self,
        object: usize,
        force: [f64; 3],
        torque: [f64; 3],
        particles: Option<&[u32]>,
    ) {
        let loaded = self.loaded(object, particles);
        let first = self.model.scene.objects[object].particles.start;
        let dx = self.model.scene.dx;
        let held = CommandedForce::new(object, first, &loaded, force, torque, dx);
        self.model.rules.commanded.extend(held);
        // Which blocks hold its particles is to be noted.
        self.state.matter.drift = f64::INFINITY;
    }

    /// Numbers of the states that are kept, ascending.
    pub fn snapshots(&self) -> impl Iterator<Item = u32> {
        self.snapshots.keys().copied()
    }

    /// Keeps the state.
    pub(super) fn save(&mut self, snapshot: u32) {
        let bytes = self.checkpoint();
        self.snapshots.insert(snapshot, bytes);
    }

    /// Goes back to a state that is kept; the step count goes on.
    pub(super) fn bring_back_snapshot(&mut self, snapshot: u32) {
        let Some(bytes) = self.snapshots.remove(&snapshot) else {
            return;
        };
        self.go_to(&bytes);
        self.snapshots.insert(snapshot, bytes);
    }

    /// Whether a state may be kept under this number.
    pub(super) fn has_room_for(&self, snapshot: u32) -> Result<(), CommandError> {
        let is_new = !self.snapshots.contains_key(&snapshot);
        if is_new && self.snapshots.len() >= MOST_SNAPSHOTS {
            return Err(CommandError::TooManySnapshots {
                snapshot,
                max: MOST_SNAPSHOTS,
            });
        }
        Ok(())
    }

    /// Whether there is a state of this number.
    pub(super) fn has_snapshot(&self, snapshot: u32) -> Result<(), CommandError> {
        if self.snapshots.contains_key(&snapshot) {
            return Ok(());
        }
        let saved: Vec<String> = self.snapshots().map(|n| n.to_string()).collect();
        Err(CommandError::UnknownSnapshot {
            snapshot,
            saved: match saved.is_empty() {
                true => "none is saved".into(),
                false => format!("saved are {}", saved.join(", ")),
            },
        })
    }
}
