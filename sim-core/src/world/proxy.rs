//! Rigid proxies: an object that flies and keeps its shape moves as one rigid body until something comes near.
//!
//! In contact a body would rest where its shape at rest ends, and matter where its weight presses it: so matter comes
//! back before anything is touched, and sleep takes care of what has come to rest.

use super::{
    Frame, World,
    fidelity::{are_near, samples, stayed},
};
use crate::{
    mat3::{dot, length},
    materials::Material,
    particles::{BLOCK, extent},
    report::ObjectState,
    scene::Part,
};

/// How long an object must have kept its shape before it becomes a rigid proxy [s].
const STEADY: f64 = 0.1;

impl World {
    /// Restores the particles of what is about to be touched, and makes proxies of what flies and keeps its shape.
    pub(super) fn update_rigid_proxies(&mut self, frame: &mut Frame) {
        for object in 0..self.model.scene.objects.len() {
            let is_idle = self.state.sleeps(object) || self.is_removed(object);
            if !self.given().is_automatic(object) || is_idle {
                continue;
            }
            if self.meets_something(object, frame) {
                self.restore_particles(object);
            } else if self.state.levels[object].proxy.is_none() {
                self.watch_shape(object, frame.length);
                if self.state.levels[object].steady >= STEADY && self.may_be_proxy(object) {
                    let state = &self.report.objects[object];
                    frame.fidelity_loss += vibration(state);
                    self.state.levels[object].proxy = Some(state.elastic_energy);
                    match self.model.lagrangian[object] {
                        Some(_) => self.freeze_solid(object),
                        None => self.freeze(object),
                    }
                }
            }
        }
    }

    /// Gives an object its particles back, if it is a rigid proxy and nobody wants it to be one.
    pub(super) fn restore_particles(&mut self, object: usize) {
        if !self.is_made_rigid(object) {
            self.loosen(object);
        }
    }

    /// Gives an object its particles back, if it is a rigid proxy.
    pub(super) fn loosen(&mut self, object: usize) {
        let level = &mut self.state.levels[object];
        (level.steady, level.shape) = (0.0, vec![]);
        if level.proxy.take().is_some() {
            match self.model.lagrangian[object] {
                Some(_) => self.thaw_solid(object),
                None => self.thaw(object),
            }
        }
    }

    /// Whether one body can be all of an object: matter that flows cannot, nor what something else moves.
    fn may_be_proxy(&self, object: usize) -> bool {
        let parts = self.model.parts.iter().zip(&self.state.commanded.materials);
        let solid =
            |(part, material): (&Part, &Material)| part.object != object || material.law.is_solid();
        parts.into_iter().all(solid) && !self.given().is_ruled(object)
    }

    /// Largest speed of any point of an object [m/s].
    pub(super) fn max_point_speed(&self, object: usize) -> f64 {
        let ObjectState {
            linear_velocity,
            angular_velocity,
            radius,
            ..
        } = self.report.objects[object];
        length(linear_velocity) + 2.0 * radius * length(angular_velocity)
    }

    /// Whether an object may touch another, or a boundary, within two frames.
    pub(super) fn meets_something(&self, object: usize, frame: &Frame) -> bool {
        let blocks = &*self.blocks_of(object);
        let reach = self.reach_of(object, frame.length);
        let Some([min, max]) = extent(blocks) else {
            return false;
        };
        let mut others = (0..self.model.scene.objects.len()).filter(|&other| other != object);
        let near = |other: usize| {
            let reach = reach.max(self.reach_of(other, frame.length));
            are_near(blocks, &self.blocks_of(other), reach)
        };
        let min = min.map(|i| f64::from(BLOCK * (i - reach)));
        let max = max.map(|i| f64::from(BLOCK * (i + 1 + reach)));
        let now = self.next_substep(frame, frame.length);
        others.any(near)
            || self
                .model
                .boundaries
                .reach(&self.state.commanded.paths, &now, min, max)
    }

    /// Takes note of whether an object keeps its shape.
    fn watch_shape(&mut self, object: usize, frame: f64) {
        let state = self.report.objects[object];
        let [x, y, z, w] = state.rotation;
        let turn = [-x, -y, -z, w];
        let position = &self.published.position;
        let here: Vec<[f32; 3]> = samples(&self.model.scene.objects[object])
            .map(|p| {
                let r = std::array::from_fn(|a| f64::from(position[p][a]) - state.com[a]);
                crate::rotation::rotate(turn, r).map(|r| r as f32)
            })
            .collect();
        let limit = self.model.scene.tolerance * state.radius;
        let level = &mut self.state.levels[object];
        level.steady = match stayed(&here, &level.shape, limit) {
            true => level.steady + frame,
            false => {
                level.shape = here;
                0.0
            }
        };
    }
}

/// Kinetic energy of an object beside that of its rigid motion [J].
fn vibration(state: &ObjectState) -> f64 {
    let v = state.linear_velocity;
    let rigid = state.mass * dot(v, v) + dot(state.angular_velocity, state.angular_momentum);
    state.kinetic_energy - 0.5 * rigid
}
