//! A solid of a scene at rest: its oracle, and the time step that its solver takes.

use cosplat_sim_core::{Isa, Scene, scene::Solver};
use cosplat_solid::{
    advance::{Outside, Scratch, Solid},
    kernel::SolidLaw,
    object::{SolidObject, law_of},
    state::SolidState,
};

use super::ReferenceSolid;

/// The first object of a scene on a grid of its own, touched by nothing.
pub struct RestingSolid {
    /// The same in double precision.
    pub oracle: ReferenceSolid,
    /// Edge of its cells [m].
    pub dx: f64,
    object: SolidObject,
    law: SolidLaw,
}

impl RestingSolid {
    /// Of a scene whose first object is of one material; none where that cannot be a solid.
    pub fn new(mut scene: Scene) -> Option<Self> {
        scene.objects[0].solver = Solver::Lagrangian;
        let object = SolidObject::new(&scene, 0)?;
        let material = &scene.objects[0].material;
        let law = law_of(material, material);
        Some(Self {
            oracle: ReferenceSolid::new(&object.grid, law),
            dx: scene.dx,
            object,
            law,
        })
    }

    /// `dx sqrt(rho0 / (3 lambda + 2 mu))` [s].
    pub fn time_of_tangent(&self) -> f64 {
        self.dx * (self.law.density / self.law.tangent_at_rest()).sqrt()
    }

    /// Substep [s] that the solver takes with some `cfl` > 0.
    pub fn substep(&self, cfl: f64) -> f64 {
        let (grid, surface) = (&self.object.grid, &self.object.surface);
        let mut state = SolidState::new(grid, surface.points.len(), |_| [0.0; 3]);
        let mut scratch = Scratch::new(grid);
        let mut solid = Solid {
            model: grid,
            laws: &[self.law],
            state: &mut state,
            scratch: &mut scratch,
        };
        let outside = Outside {
            isa: Isa::detect(),
            gravity: [0.0; 3],
            damping: 0.0,
            cfl,
        };
        let surface = (&surface.points[..], &surface.stiffness[..]);
        solid.begin(&outside, surface, true, |_| [0.0; 3]);
        solid.limit(cfl, 0.0)
    }
}
