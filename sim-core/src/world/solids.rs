//! Solids in the world: moved in substeps of their own, written back to their particles once per frame.

use super::{World, frame::Frame};
use crate::{
    mat3::cross,
    moments::object_shape,
    report::ObjectState,
    solid::{nodes::NODES, state::SolidState},
    substep::laws_of,
};

impl World {
    /// Solids at time 0.
    pub(super) fn form_solids(&mut self) {
        let of_object = |id: usize| {
            let solid = self.model.lagrangian[id].as_ref()?;
            let velocity = self.initial_velocity(id);
            Some(SolidState::new(
                &solid.grid,
                solid.surface.points.len(),
                velocity,
            ))
        };
        let objects = 0..self.model.scene.objects.len();
        self.state.solids = objects.map(of_object).collect();
    }

    /// Gives solids the velocities that they begin with, or none.
    pub(super) fn start_solids(&mut self, moves: bool) {
        let mut solids = std::mem::take(&mut self.state.solids);
        for (id, state) in solids.iter_mut().enumerate() {
            let (Some(solid), Some(state)) = (&self.model.lagrangian[id], state) else {
                continue;
            };
            let velocity = self.initial_velocity(id);
            let grid = &solid.grid;
            state.velocity = [0.0; 3];
            state.change_velocities(grid, |slot, _| match moves {
                true => velocity(grid.node_in_world(slot)),
                false => [0.0; 3],
            });
        }
        self.state.solids = solids;
    }

    /// Whether there are solids on grids of their own whose nodes move.
    pub(super) fn has_solids(&self) -> bool {
        (0..self.state.solids.len()).any(|object| self.is_moving_solid(object))
    }

    /// Whether an object is a solid whose nodes move.
    pub(super) fn is_moving_solid(&self, object: usize) -> bool {
        self.state.solids[object].is_some() && self.given().is_moving_solid(object)
    }

    /// Adds `change` [m/s] to the velocity of some particles of a solid, or all, as far as nodes can.
    pub(super) fn push_solid(&mut self, object: usize, change: [f64; 3], ids: Option<&[u32]>) {
        let (Some(solid), Some(state)) = (
            &self.model.lagrangian[object],
            &mut self.state.solids[object],
        ) else {
            return;
        };
        let first = self.model.scene.objects[object].particles.start;
        let pushed = |n: usize| match ids {
            Some(ids) => ids.binary_search(&((first + n) as u32)).is_ok(),
            None => true,
        };
        let changes = solid.spread(|n| if pushed(n) { change } else { [0.0; 3] });
        state.change_velocities(&solid.grid, |slot, v| {
            std::array::from_fn(|a| v[a] + changes[slot][a])
        });
    }

    /// Gives a solid a rigid velocity field about its centre of mass.
    pub(super) fn set_solid_velocity(&mut self, object: usize, linear: [f64; 3], spin: [f64; 3]) {
        let (Some(solid), Some(state)) = (
            &self.model.lagrangian[object],
            &mut self.state.solids[object],
        ) else {
            return;
        };
        let com = self.report.objects[object].com;
        let at: Vec<[f64; 3]> = (0..NODES * solid.grid.node_blocks.len())
            .map(|slot| state.position(&solid.grid, slot))
            .collect();
        state.change_velocities(&solid.grid, |slot, _| {
            let turn = cross(spin, std::array::from_fn(|a| at[slot][a] - com[a]));
            std::array::from_fn(|a| linear[a] + turn[a])
        });
    }

    /// Lets the tangent of a solid be looked at anew: its material changed.
    pub(super) fn reconsider_solid(&mut self, object: usize) {
        if let Some(state) = &mut self.state.solids[object] {
            state.tangent = 0.0;
        }
    }

    /// Takes solids out that failed, of those that there `were`, or whose centre of mass has left the domain.
    pub(super) fn take_out_solids(&mut self, were: &[bool], frame: &mut Frame) {
        for object in 0..self.state.solids.len() {
            if were[object] && self.state.solids[object].is_none() {
                self.lose_solid(object, frame, false);
            }
            let level = &mut self.state.levels[object];
            if level.proxy.is_some() && self.state.bodies.of[object].is_none() {
                // Its body was taken out.
                (level.proxy, self.state.solids[object]) = (None, None);
            }
            let (true, Some(solid), Some(state)) = (
                self.is_moving_solid(object),
                &self.model.lagrangian[object],
                &self.state.solids[object],
            ) else {
                continue;
            };
            let moment = state.momenta(&solid.grid).moment;
            if !self
                .model
                .is_inside(moment.map(|m| m / solid.grid.total_mass))
            {
                self.lose_solid(object, frame, true);
            }
        }
    }

    /// Takes a solid out: it stays as it was published last, or where it left the domain.
    fn lose_solid(&mut self, object: usize, frame: &mut Frame, somewhere: bool) {
        self.publish_solid(object);
        self.state.solids[object] = None;
        let particles = self.model.scene.objects[object].particles.clone();
        let ids: Vec<u32> = particles.map(|p| p as u32).collect();
        for &id in &ids {
            self.published.freeze(id);
        }
        self.state.matter.removed.extend(&ids);
        frame.lose_body(ids, somewhere);
    }

    /// Writes the particles of all solids that move.
    pub(super) fn publish_solids(&mut self) {
        for object in 0..self.state.solids.len() {
            if self.is_moving_solid(object) {
                self.publish_solid(object);
            }
        }
    }

    /// Writes the particles of solids that sleep.
    pub(super) fn publish_sleeping_solids(&mut self) {
        for object in 0..self.state.solids.len() {
            let level = &self.state.levels[object];
            if level.is_asleep() && level.proxy.is_none() {
                self.publish_solid(object);
                self.stop_solid(object);
            }
        }
    }

    fn publish_solid(&mut self, object: usize) {
        let state = &self.state.solids[object];
        if let (Some(solid), Some(state)) = (&self.model.lagrangian[object], state) {
            let first = self.model.scene.objects[object].particles.start;
            let rest = &self.model.scene.particles.position;
            self.published
                .update_solid(self.model.isa, first, (solid, rest), state);
        }
    }

    /// Mass of an object that is a solid [kg]; 0 of others.
    pub(super) fn mass_of_solid(&self, object: usize) -> f64 {
        let is_body = self.state.levels[object].proxy.is_some();
        match (&self.model.lagrangian[object], &self.state.solids[object]) {
            (Some(solid), Some(_)) if !is_body => solid.grid.total_mass,
            _ => 0.0,
        }
    }

    /// Quadrature points times substeps of a frame in which a solid moves as matter at rest does.
    pub(super) fn updates_of_full_solid(&self, object: usize, length: f64) -> u64 {
        let (Some(solid), Some(_)) = (&self.model.lagrangian[object], &self.state.solids[object])
        else {
            return 0;
        };
        let parts = self.model.parts.iter().zip(&self.model.constants.rest_dt);
        let own = parts.filter(|(part, _)| part.object == object);
        let shortest = own.map(|(_, dt)| *dt).fold(f64::INFINITY, f64::min);
        let substeps = (length / (self.model.scene.cfl * shortest)).ceil();
        8 * solid.grid.cells.len() as u64 * substeps as u64
    }

    /// Box around the points of a solid when the frame began [m].
    pub(super) fn box_of_solid(&self, object: usize) -> Option<[[f64; 3]; 2]> {
        let known = self.workspace.solid_boxes.get(object).copied().flatten();
        known.or_else(|| self.extent_of_solid(object))
    }

    /// Box around the points of a solid that is no body [m].
    pub(super) fn extent_of_solid(&self, object: usize) -> Option<[[f64; 3]; 2]> {
        if self.state.levels[object].proxy.is_some() {
            return None;
        }
        let (solid, state) = (
            self.model.lagrangian[object].as_ref()?,
            self.state.solids[object].as_ref()?,
        );
        Some(solid.surface.extent(&solid.grid, state))
    }

    /// Moments of an object that is a solid: of its nodes, but for what only its particles tell.
    pub(super) fn solid_state(&self, object: usize) -> Option<ObjectState> {
        let solid = self.model.lagrangian[object].as_ref()?;
        let state = self.state.solids[object].as_ref()?;
        let bodies = (self.model).bodies_of(object, &self.state.commanded.materials);
        let arrays = self.published.arrays();
        let sums = state.sums(self.model.isa, &solid.grid, &laws_of(&self.given(), object));
        let mass = solid.grid.total_mass;
        let com = sums.moment.map(|m| m / mass);
        let orbit = cross(com, sums.momentum);
        let angular_momentum = std::array::from_fn(|a| sums.angular[a] - orbit[a]);
        let shape = object_shape(&arrays, &bodies, self.model.scene.dx, angular_momentum);
        // Nodes have more inertia than the matter between them: with that of particles it would be said to spin too fast.
        let spin = state.rigid_motion(&solid.grid).map(|motion| motion.spin);
        Some(ObjectState {
            mass,
            com,
            angular_velocity: spin.unwrap_or(shape.angular_velocity),
            linear_velocity: sums.momentum.map(|p| p / mass),
            angular_momentum,
            kinetic_energy: sums.kinetic,
            elastic_energy: sums.elastic,
            ..shape
        })
    }
}
