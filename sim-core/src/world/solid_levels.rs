//! Model levels of solids on grids of their own: they sleep with their nodes at rest, and a rigid proxy keeps the nodes in its
//! own frame until they are matter again.

use super::World;
use crate::{
    bodies::{body::Body, grain::Grain},
    mat3::{cross, dot},
    solid::{grip::Grip, model::SolidModel, state::SolidState},
    state::away::Loose,
};

impl World {
    /// Finds the boxes around solids that move, and around those whose box nobody knows.
    pub(super) fn find_solid_boxes(&mut self) {
        let objects = self.model.scene.objects.len();
        self.workspace.solid_boxes.resize(objects, None);
        for object in 0..objects {
            if self.workspace.solid_boxes[object].is_none() || self.is_moving_solid(object) {
                self.workspace.solid_boxes[object] = self.extent_of_solid(object);
            }
        }
    }

    /// Brings a solid to rest as it is deformed.
    pub(super) fn stop_solid(&mut self, object: usize) {
        let (Some(solid), Some(state)) = (
            &self.model.lagrangian[object],
            &mut self.state.solids[object],
        ) else {
            return;
        };
        state.velocity = [0.0; 3];
        state.change_velocities(&solid.grid, |_, _| [0.0; 3]);
        for p in self.model.scene.objects[object].particles.clone() {
            self.published.halt(p as u32);
        }
    }

    /// Makes one rigid body of a solid, with its momentum and its angular momentum about any point.
    pub(super) fn freeze_solid(&mut self, object: usize) {
        let Some(solid) = &self.model.lagrangian[object] else {
            return;
        };
        let Some(state) = &self.state.solids[object] else {
            return;
        };
        let sums = state.momenta(&solid.grid);
        let loose = self.loose_of_solid(object);
        let grains = loose.iter().map(|p| self.model.grain(object, p.id, p.x));
        let grains: Vec<Grain> = grains.collect();
        let com = sums.moment.map(|m| m / solid.grid.total_mass);
        let resists = state.second_moments(&solid.grid, com).trace() / solid.grid.total_mass;
        let own = (2.0 / 3.0 * (resists - mean_square(&grains, com))).max(0.0);
        self.form_body(object, &loose, Some(own));
        let (Some(rigid), Some(shape)) = (
            &mut self.state.bodies.of[object],
            &self.state.bodies.shapes[object],
        ) else {
            return;
        };
        let body = &mut rigid.body;
        let orbit = cross(body.com, sums.momentum);
        body.velocity = sums.momentum.map(|p| p / shape.inertia.mass);
        body.angular_momentum = std::array::from_fn(|a| sums.angular[a] - orbit[a]);
        let body = *body;
        if let (Some(solid), Some(state)) = (
            &self.model.lagrangian[object],
            &mut self.state.solids[object],
        ) {
            place_nodes(&solid.grid, state, |x| body.inverse_point(x));
            state.velocity = [0.0; 3];
            state.change_velocities(&solid.grid, |_, _| [0.0; 3]);
            state.springs.fill(Grip::NONE);
            state.of_matter.clear();
        }
    }

    /// Makes nodes of a solid's rigid proxy again, with its momentum and angular momentum.
    pub(super) fn thaw_solid(&mut self, object: usize) {
        let Some(rigid) = self.state.bodies.of[object].take() else {
            return;
        };
        let shape = self.state.bodies.shapes[object].take();
        let (Some(solid), Some(state), Some(shape)) = (
            &self.model.lagrangian[object],
            &mut self.state.solids[object],
            shape,
        ) else {
            return;
        };
        let (grid, body) = (&solid.grid, rigid.body);
        place_nodes(grid, state, |x| body.point(x));
        let (velocity, spin, com) = rigid_motion(grid, state, &body, shape.inertia.mass);
        let at = state.positions(grid);
        state.velocity = velocity;
        state.change_velocities(grid, |slot, _| {
            let turn = cross(spin, std::array::from_fn(|a| at[slot][a] - com[a]));
            std::array::from_fn(|a| velocity[a] + turn[a])
        });
        if let Some(bounds) = self.workspace.solid_boxes.get_mut(object) {
            *bounds = None;
        }
    }

    /// The particles of a solid as they were published last.
    fn loose_of_solid(&self, object: usize) -> Vec<Loose> {
        let (published, dx) = (&self.published, self.model.scene.dx);
        let particles = self.model.scene.objects[object].particles.clone();
        let loose = |p: usize| Loose {
            id: p as u32,
            x: published.cells[p].map(|x| x * dx),
            v: [0.0; 3],
            c: [0.0; 9],
            visible: published.deformation[p],
            elastic: published.deformation[p],
            memory: 0.0,
        };
        particles.map(loose).collect()
    }
}

/// Moves every node [m].
pub(super) fn place_nodes(
    grid: &SolidModel,
    state: &mut SolidState,
    to: impl Fn([f64; 3]) -> [f64; 3],
) {
    let at: Vec<(usize, [f64; 3])> = grid
        .nodes()
        .map(|slot| (slot, to(state.position(grid, slot))))
        .collect();
    state.set_positions(grid, &at);
}

/// Velocity of the centre of mass [m/s], angular velocity [rad/s] and centre of mass [m] with which nodes that move as one have
/// the momenta of a body of some mass [kg].
fn rigid_motion(
    grid: &SolidModel,
    state: &SolidState,
    body: &Body,
    mass: f64,
) -> ([f64; 3], [f64; 3], [f64; 3]) {
    let com = state.momenta(grid).moment.map(|m| m / grid.total_mass);
    let momentum = body.velocity.map(|v| v * mass);
    let arm = std::array::from_fn(|a| body.com[a] - com[a]);
    let orbit = cross(arm, momentum);
    let angular: [f64; 3] = std::array::from_fn(|a| body.angular_momentum[a] + orbit[a]);
    let spin = state.spin_with(grid, com, angular);
    (momentum.map(|p| p / grid.total_mass), spin, com)
}

/// Mean square distance of grains from a place, by mass.
fn mean_square(grains: &[Grain], from: [f64; 3]) -> f64 {
    let of_grain = |grain: &Grain| {
        let r: [f64; 3] = std::array::from_fn(|a| grain.x[a] - from[a]);
        grain.mass * dot(r, r)
    };
    let mass: f64 = grains.iter().map(|grain| grain.mass).sum();
    grains.iter().map(of_grain).sum::<f64>() / mass
}
