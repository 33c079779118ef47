//! The grid pass of a substep: momentum to velocity, boundaries, contact between objects.

use std::time::Instant;

use super::{World, frame::Frame};
use crate::{
    contact::{Meeting, meet},
    grid::{
        approach::{Acting, approaches},
        node_pass,
    },
    scene::Scene,
};

impl World {
    /// Runs the grid pass; returns the largest velocity component [cells/s].
    pub(super) fn nodes(&mut self, frame: &mut Frame, dt: f64) -> f64 {
        let start = Instant::now();
        self.state.carrier = self.carrier_after(dt);
        let keep = self.scene.conditions.damping_factor(dt) as f32;
        let substep = self.substep(frame, dt);
        let boundaries = self.boundaries.on_nodes(&self.state.paths, &substep);
        let moving = self.boundaries.moving_on_nodes(&self.state.paths, &substep);
        let cells_per_mass = self.cells_per_mass();
        let grid = &mut self.workspace.grid;
        let carrier = self.state.carrier;
        let acting = Acting {
            boundaries: &boundaries,
            moving: &moving,
            approaches: &approaches(&self.state.particles, &cells_per_mass, &boundaries),
            dt,
        };
        let mut fastest = node_pass(self.isa, grid, &acting, carrier, keep);
        let scene = &self.scene;
        let meeting = Meeting {
            method: scene.contact.method,
            particles: &self.state.particles,
            cells_per_mass: &cells_per_mass,
            fullness: &fullness(scene),
            friction: &|[a, b]| scene.surface_between(a as usize, b as usize).friction,
            acting,
            carrier,
        };
        fastest.relative = fastest.relative.max(meet(grid, &meeting));
        let carrier = self
            .state
            .carrier
            .iter()
            .fold(0.0, |m: f64, u| m.max(u.abs()));
        // What meets a moving boundary leaves it at most this much faster than either.
        self.state.grid_speed =
            f64::from(fastest.relative) + carrier + 2.0 * f64::from(fastest.boundary);
        frame.timings.grid += start.elapsed().as_secs_f64();
        self.speed_with_boundaries(&substep)
    }

    /// Per part the volume of one unit of mass at rest [cells].
    fn cells_per_mass(&self) -> Vec<f64> {
        let cell = self.scene.dx.powi(3);
        let parts = self.parts.iter();
        parts
            .map(|part| self.mass_unit / (part.material.density * cell))
            .collect()
    }
}

/// Per object the volume of a unit of mass, up to a common factor.
fn fullness(scene: &Scene) -> Vec<f64> {
    let objects = scene.objects.iter();
    objects.map(|o| o.material.density.recip()).collect()
}
