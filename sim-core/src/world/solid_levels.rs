//! Model levels of solids on grids of their own: they sleep with their nodes at rest, and a rigid proxy keeps the nodes in its
//! own frame until they are matter again.

use super::World;
use crate::{
    bodies::{
        body::Body,
        grain::{Grain, of_cubes},
    },
    mat3::{Mat3, cross},
    solid::{grip::Grip, model::SolidModel, state::SolidState},
    state::away::Loose,
};

/// Share of a squared cell that lumping the masses of nodes adds to the inertia of matter about any axis: a quarter along
/// each of the two others.
const LUMPING: f64 = 0.5;

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
        let dx = self.model.scene.dx;
        let own = of_cubes(&grains) + LUMPING * dx * dx;
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
    let mut inertia = Mat3::diagonal([0.0; 3]);
    for slot in grid.nodes() {
        let x = state.position(grid, slot);
        let r: [f64; 3] = std::array::from_fn(|a| x[a] - com[a]);
        for a in 0..3 {
            for b in 0..3 {
                let own = if a == b { crate::mat3::dot(r, r) } else { 0.0 };
                inertia.0[a][b] += grid.mass[slot] * (own - r[a] * r[b]);
            }
        }
    }
    // Nodes are spread over three along every axis at least: it is regular.
    let (cofactor, det) = (inertia.cofactor(), inertia.det());
    let spin = cofactor.mul_vec(angular).map(|w| w / det);
    (momentum.map(|p| p / grid.total_mass), spin, com)
}
