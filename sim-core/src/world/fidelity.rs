//! Fidelity: objects that nothing moves are put to sleep, with all that rests on them, and woken by what comes near.
//!
//! One tolerance decides, relative to the radius of an object: what it has not moved by within a quarter of a second
//! counts as no motion ([`SleepState`]). A sleeping object keeps its particles as they are and costs nothing per substep.

use std::borrow::Cow;

use super::{Frame, World};
use crate::{
    mat3::dot,
    particles::{BLOCK, Block, Motion, NO_PARTICLE, Particles, extent},
    report::{Level, ObjectState},
    scene::{Fidelity, Object},
    simd::F32x16,
    state::sleep::{Asleep, SleepState},
};

/// Particles that are watched per object at most.
const SAMPLES: usize = 64;
/// Reach of matter through the grid: the stencils of two particles, and the drift of one of them [cells].
const REACH: f64 = 4.0;

/// The particles of an object that are watched, spread over all of them.
pub(super) fn samples(object: &Object) -> impl Iterator<Item = usize> {
    let range = object.particles.clone();
    let stride = range.len().div_ceil(SAMPLES).max(1);
    range.step_by(stride)
}

/// Whether all samples are within `limit` [m] of where they were.
pub(super) fn stayed(here: &[[f32; 3]], before: &[[f32; 3]], limit: f64) -> bool {
    let near = |(x, y): (&[f32; 3], &[f32; 3])| {
        let way: [f64; 3] = std::array::from_fn(|a| f64::from(x[a]) - f64::from(y[a]));
        dot(way, way) <= limit * limit
    };
    here.len() == before.len() && here.iter().zip(before).all(near)
}

fn count(particles: &Particles) -> usize {
    let ids = particles.fixed.iter().flat_map(|fixed| fixed.id);
    ids.filter(|&id| id != NO_PARTICLE).count()
}

/// Whether some blocks of two sorted lists are at most `reach` blocks apart along every axis.
pub(super) fn are_near(one: &[Block], other: &[Block], reach: i32) -> bool {
    let (Some(a), Some(b)) = (extent(one), extent(other)) else {
        return false;
    };
    let apart = |n: usize| a[0][n] > b[1][n] + reach || b[0][n] > a[1][n] + reach;
    if (0..3).any(apart) {
        return false;
    }
    let (few, many) = match one.len() <= other.len() {
        true => (one, other),
        false => (other, one),
    };
    few.iter().any(|block| {
        let [x, y, z] = block.index;
        (-reach..=reach).any(|i| {
            (-reach..=reach).any(|j| {
                let column = [x + i, y + j, z - reach];
                let at = many.partition_point(|b| b.index < column);
                many.get(at).is_some_and(|found| {
                    let [fx, fy, fz] = found.index;
                    [fx, fy] == [x + i, y + j] && fz <= z + reach
                })
            })
        })
    })
}

impl World {
    /// How an object of which this mass is left [kg] is modelled.
    pub(super) fn level(&self, object: usize, mass: f64) -> Level {
        match self.given().fidelity_of(object) {
            _ if self.is_removed(object) => Level::Removed,
            Fidelity::Static => Level::Static,
            _ if mass <= 0.0 => Level::Gone,
            _ if self.state.sleeps(object) => Level::Asleep,
            _ if self.is_one_body(object) => Level::Rigid,
            Fidelity::Mpm | Fidelity::Auto | Fidelity::Rigid => Level::Mpm,
        }
    }

    /// Wakes what is about to be touched, then lets islands of still objects fall asleep.
    pub(super) fn update_model_levels(&mut self, frame: &mut Frame) {
        let objects = 0..self.model.scene.objects.len();
        // What a checkpoint brought along of a scene that asked for less.
        for object in objects.clone() {
            if self.given().is_automatic(object) {
                continue;
            }
            if self.state.sleeps(object) {
                self.wake(object);
            }
            if self.state.levels[object].proxy.is_some() {
                self.restore_particles(object);
            }
        }
        if !objects.clone().any(|id| self.given().is_automatic(id)) {
            return;
        }
        self.find_solid_boxes();
        self.wake_disturbed(frame);
        for object in objects.clone() {
            if self.given().is_automatic(object) && !self.state.sleeps(object) {
                self.watch(object, frame.length);
            }
        }
        let awake: Vec<usize> = objects
            .filter(|&id| !self.state.sleeps(id) && !self.blocks_of(id).is_empty())
            .collect();
        self.update_rigid_proxies(frame);
        for island in self.islands(&awake, frame.length) {
            if island.iter().all(|&object| self.may_sleep(object)) {
                for object in island {
                    self.put_to_sleep(object, frame);
                }
            }
        }
        let asleep = self.state.levels.iter().filter_map(SleepState::sleeping);
        frame.asleep = asleep.map(count).sum();
    }

    /// Blocks of an object, awake or not, as of the last sort; those around a body or a solid.
    pub(super) fn blocks_of(&self, object: usize) -> Cow<'_, [Block]> {
        if let Some(bounds) = self
            .box_of_body(object)
            .or_else(|| self.box_of_solid(object))
        {
            return Cow::Owned(self.blocks_in(object, bounds));
        }
        Cow::Borrowed(self.state.blocks_of_particles(object))
    }

    /// Blocks that an object may cross within two frames, and reach beyond.
    pub(super) fn reach_of(&self, object: usize, frame: f64) -> i32 {
        let cells = 2.0 * frame * self.max_point_speed(object) / self.model.scene.dx;
        ((cells.min(1e6) + REACH) / f64::from(BLOCK)).ceil() as i32
    }

    /// Wakes every sleeping object that one that is awake comes near to, or that a boundary disturbs.
    fn wake_disturbed(&mut self, frame: &Frame) {
        let objects = 0..self.model.scene.objects.len();
        let now = self.next_substep(frame, frame.length);
        let mut sleeping: Vec<usize> = objects
            .clone()
            .filter(|&id| self.state.sleeps(id))
            .collect();
        let mut rousers: Vec<usize> = objects.filter(|&id| !self.state.sleeps(id)).collect();
        let disturbed = |world: &Self, object: usize| {
            let Some([min, max]) = extent(&world.blocks_of(object)) else {
                return false;
            };
            let min = min.map(|i| f64::from(BLOCK * i) - REACH);
            let max = max.map(|i| f64::from(BLOCK * (i + 1)) + REACH);
            world
                .model
                .boundaries
                .disturb(&world.state.commanded.paths, &now, min, max)
        };
        let (roused, still): (Vec<usize>, Vec<usize>) = sleeping
            .iter()
            .partition(|&&object| disturbed(self, object));
        sleeping = still;
        for object in roused {
            self.wake(object);
            rousers.push(object);
        }
        // Whoever wakes may wake others.
        while let Some(rouser) = rousers.pop() {
            let reach = self.reach_of(rouser, frame.length);
            let blocks = self.blocks_of(rouser);
            let near = |&&object: &&usize| are_near(&self.blocks_of(object), &blocks, reach);
            let (roused, still): (Vec<usize>, Vec<usize>) =
                sleeping.iter().partition(|object| near(object));
            sleeping = still;
            for object in roused {
                self.wake(object);
                rousers.push(object);
            }
        }
    }

    /// Takes note of where an object is.
    pub(super) fn watch(&mut self, object: usize, frame: f64) {
        let position = &self.published.position;
        let samples = samples(&self.model.scene.objects[object]);
        self.state.levels[object].sample_pose(frame, || samples.map(|p| position[p]).collect());
    }

    /// Whether nothing speaks against an object's sleep but its neighbours.
    fn may_sleep(&self, object: usize) -> bool {
        let limit = self.model.scene.tolerance * self.report.objects[object].radius;
        self.given().is_automatic(object)
            && self.state.levels[object].is_still(limit)
            && !self.given().is_ruled(object)
    }

    /// Groups of objects of which each is near another.
    fn islands(&self, objects: &[usize], frame: f64) -> Vec<Vec<usize>> {
        let mut rest = objects.to_vec();
        let mut islands = Vec::new();
        while let Some(first) = rest.pop() {
            let mut island = vec![first];
            let mut next = 0;
            while next < island.len() {
                let blocks = self.blocks_of(island[next]);
                let reach = self.reach_of(island[next], frame);
                let (near, far): (Vec<usize>, Vec<usize>) = rest
                    .iter()
                    .partition(|&&other| are_near(&self.blocks_of(other), &blocks, reach));
                island.extend(near);
                rest = far;
                next += 1;
            }
            islands.push(island);
        }
        islands
    }

    fn put_to_sleep(&mut self, object: usize, frame: &mut Frame) {
        let mut particles = self.state.matter.particles.take_field(object as u32);
        particles.motion.fill(Motion::REST);
        self.stop_body(object);
        self.stop_solid(object);
        for fixed in &particles.fixed {
            for &id in fixed.id.iter().filter(|&&id| id != NO_PARTICLE) {
                self.published.halt(id);
            }
        }
        let parts = self.model.parts.iter().zip(&self.state.matter.extremes);
        let mine = parts.filter(|(part, _)| part.object == object);
        let extremes = mine.map(|(_, extremes)| *extremes).collect();
        self.state.levels[object].asleep = Some(Box::new(Asleep {
            particles,
            extremes,
        }));
        self.state.progress.momentum[object] = [0.0; 3];
        let state = &mut self.report.objects[object];
        frame.fidelity_loss += state.kinetic_energy;
        *state = ObjectState {
            linear_velocity: [0.0; 3],
            angular_momentum: [0.0; 3],
            angular_velocity: [0.0; 3],
            kinetic_energy: 0.0,
            contact_impulse: [0.0; 3],
            ..*state
        };
        self.state.matter.drift = f64::INFINITY;
    }

    /// Wakes an object, if it sleeps.
    pub(super) fn wake(&mut self, object: usize) {
        let level = &mut self.state.levels[object];
        level.forget_poses();
        let Some(asleep) = level.asleep.take() else {
            return;
        };
        let Asleep {
            mut particles,
            extremes,
        } = *asleep;
        for motion in &mut particles.motion {
            for a in 0..3 {
                motion.v[a] = F32x16::splat(-self.state.motion.frame_velocity[a] as f32);
            }
        }
        self.state.matter.particles.put_field(particles);
        let parts = self.model.parts.iter().zip(&mut self.state.matter.extremes);
        let mine = parts.filter(|(part, _)| part.object == object);
        for ((_, to), from) in mine.zip(extremes) {
            *to = from;
        }
        self.state.matter.drift = f64::INFINITY;
    }

    /// Wakes all.
    pub(super) fn wake_all(&mut self) {
        for object in 0..self.model.scene.objects.len() {
            self.wake(object);
        }
    }
}
