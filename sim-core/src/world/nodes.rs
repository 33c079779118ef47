//! The grid pass of a substep: momentum to velocity, boundaries, contact between objects.

use std::time::Instant;

use super::{
    World,
    frame::{Frame, Step},
};
use crate::{
    bodies::near::Fields,
    colliders::edge::tell_edges,
    contact::{Closed, Meeting, Wish, meet},
    grid::{
        anchors::Anchors,
        approach::{Acting, approaches},
        node_pass,
    },
    mat3::dot,
    materials::{Law, Material},
    report::ContactEpisode,
    scene::{Fidelity, Part, Scene},
};

/// Nodes of a block.
const NODES: u64 = 64;

impl World {
    /// Runs the grid pass; returns the largest velocity component [cells/s].
    pub(super) fn nodes(&mut self, frame: &mut Frame, step: &Step) -> f64 {
        let start = Instant::now();
        let dt = step.dt;
        let substep = self.substep(frame, dt);
        let clocks = self.clocks(frame, step);
        let carrier = self.carrier_after(substep.kick);
        let transfers = self.transfers(&mut frame.pace, &clocks, carrier);
        self.state.carrier = carrier;
        let boundaries = self.boundaries.on_nodes(&self.state.paths, &substep);
        let moving = self.boundaries.moving_on_nodes(&self.state.paths, &substep);
        let (cells_per_mass, tell_edges) = (self.cells_per_mass(), self.tell_edges());
        let grid = &mut self.workspace.grid;
        let active = grid.nodes.iter();
        let active = active.filter(|node| !clocks[node.field as usize].waits);
        frame.work.grid_nodes += NODES * active.count() as u64;
        let scene = &self.scene;
        let anchors = Anchors::new(
            &self.state.particles,
            &self.rules,
            &self.state.pins,
            substep,
            &self.workspace.concerned,
            grid.nodes.len(),
        );
        let acting = Acting {
            boundaries: &boundaries,
            moving: &moving,
            approaches: &approaches(
                &self.state.particles,
                &self.half_spacings,
                &boundaries,
                &clocks,
            ),
            tell_edges: &tell_edges,
            anchors: &anchors,
            clocks: &clocks,
        };
        let fastest = node_pass(self.isa, grid, &acting, &transfers);
        let meeting = Meeting {
            method: scene.contact.method,
            isa: self.isa,
            particles: &self.state.particles,
            cells_per_mass: &cells_per_mass,
            fullness: &fullness(scene),
            friction: &|[a, b]| scene.surface_between(a as usize, b as usize).friction,
            wish: &|fields| wish(scene, &self.parts, &self.state.materials, fields),
            gravity: dot(self.state.gravity, self.state.gravity).sqrt() / scene.dx,
            time: substep.time + dt,
            dt,
            acting,
            carrier,
        };
        frame.timings.grid += start.elapsed().as_secs_f64();
        let start = Instant::now();
        let met = meet(grid, &meeting, &mut self.state.episodes);
        frame.contact_work.add(&met.work);
        // As integers, so that NaN is the largest of all.
        let larger = |a: f32, b: f32| f32::from_bits(a.to_bits().max(b.to_bits()));
        let fields = Fields {
            cells_per_mass: &cells_per_mass,
            clocks: &clocks,
            tell_edges: &tell_edges,
        };
        frame.timings.contact += start.elapsed().as_secs_f64();
        let start = Instant::now();
        let relative = larger(met.largest, self.move_bodies(&substep, fields));
        frame.timings.bodies += start.elapsed().as_secs_f64();
        let fold = |m: f32, u: f64| m.max(u.abs() as f32);
        let given = relative + carrier.into_iter().fold(0.0, fold);
        self.state.grid_speed = frame.pace.fastest(larger(fastest, given)).into();
        self.speed_with_boundaries(&substep)
    }

    /// Per grid field whether the masses of nodes tell where matter ends.
    fn tell_edges(&self) -> Vec<bool> {
        let scene = &self.scene;
        let parts = self.parts.iter().zip(&self.state.materials).enumerate();
        let on_grid = parts.filter(|(_, (part, _))| {
            let fidelity = scene.objects[part.object].fidelity;
            !matches!(fidelity, Fidelity::Static | Fidelity::Rigid)
        });
        let densities = on_grid.map(|(id, (part, material))| {
            let field = self.field_of(id) as usize;
            (field, part.material.density, material.law)
        });
        tell_edges(scene.objects.len(), densities)
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

/// Restitution that is asked of two objects.
fn wish(scene: &Scene, parts: &[Part], materials: &[Material], fields: [u32; 2]) -> Wish {
    let [a, b] = fields.map(|field| field as usize);
    let all = |what: fn(Law) -> bool| {
        let mut parts = parts.iter().zip(materials);
        parts.all(|(part, m)| part.object != a && part.object != b || what(m.law))
    };
    Wish {
        restitution: scene.surface_between(a, b).restitution,
        solid: all(Law::is_solid),
        elastic: all(|law| law.is_solid() && !law.is_plastic()),
    }
}

/// An ended contact in SI units.
pub(super) fn episode(closed: &Closed, mass_unit: f64, dx: f64) -> ContactEpisode {
    let ratio = |speed: f64| (closed.before > 0.0).then(|| speed / closed.before);
    ContactEpisode {
        objects: closed.fields.map(|field| field as usize),
        impulse: closed.impulse.map(|p| p * mass_unit * dx),
        speed_before: closed.before * dx,
        speed_after: closed.after.map_or(0.0, |speed| speed * dx),
        lasting: closed.after.is_none(),
        restitution_requested: closed.requested,
        restitution_natural: closed.natural.and_then(ratio),
        restitution_achieved: closed.after.and_then(ratio),
        energy_taken: closed.lost * mass_unit * dx * dx,
        duration: closed.duration,
        time: closed.time,
    }
}

/// Per object the volume of a unit of mass, up to a common factor.
fn fullness(scene: &Scene) -> Vec<f64> {
    let objects = scene.objects.iter();
    objects.map(|o| o.material.density.recip()).collect()
}
