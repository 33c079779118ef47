//! What is made of an object of the scene before the first step: its grid, its surface, its particles' places.

use super::{
    contact::ContactSurface,
    depth::DepthField,
    facets::Pieces,
    held::{BorderPoint, cut_at_borders},
    kernel::SolidLaw,
    lattice::{Lattice, Seed},
    model::{CellPoint, SolidModel},
    sampling::Sampling,
    state::SolidState,
    surface::{SurfacePoint, surface},
};
use crate::{
    materials::Material,
    scene::{Fidelity, Object, PinnedRegion, Scene, Solver, TurnedBox},
};

/// Share of a node's mass that must be of held matter for the node to be held: all matter within a hold then stays.
const HELD: f64 = 0.1;
/// The same where the border of what is held is held besides: nodes that matter beyond it moves are free.
const ALL: f64 = 0.999;

/// The constant side of an object that is a solid.
#[derive(Debug)]
pub struct SolidObject {
    /// Its grid.
    pub grid: SolidModel,
    /// Its surface.
    pub surface: ContactSurface,
    /// Depth in it, where there is other matter that may be in it.
    pub depth: Option<DepthField>,
    /// Where each of its particles is on the grid, in scene order.
    pub particles: Vec<CellPoint>,
    /// The same in the order of cells.
    pub sampling: Sampling,
    /// Mass of each of them [kg].
    masses: Vec<f64>,
    /// Per held region of the scene what it holds.
    pub regions: Vec<HeldInRegion>,
}

/// How far behind a face a held region may end that holds it [cells]: where the surface is follows from particles.
const FACE: f64 = 0.02;

/// What a held region of the scene has of a solid at rest.
#[derive(Clone, Debug, Default)]
pub struct HeldInRegion {
    /// Nodes that it holds.
    pub nodes: Vec<usize>,
    /// Points of the surface that it holds where it reaches no particle, or points of its border.
    pub points: Vec<usize>,
    /// Particles within its border, ascending.
    particles: Vec<u32>,
}

/// What moves with the held nodes of a region.
#[derive(Clone, Copy, Debug)]
pub struct CarriedAlong {
    /// Since the start [m].
    pub way: [f64; 3],
    /// [m/s]
    pub velocity: [f64; 3],
}

impl SolidObject {
    /// Of an object of the scene; none of one that is not a solid, or has no particles.
    pub fn new(scene: &Scene, id: usize) -> Option<Self> {
        let object = &scene.objects[id];
        if !is_solid(object) {
            return None;
        }
        let seeds = seeds(scene, object);
        let lattice = Lattice::of(scene.dx, &seeds);
        let reaching = reaching(scene, &seeds);
        let boxes: Vec<TurnedBox> = reaching
            .iter()
            .map(|&n| scene.pinned_regions[n].bounds)
            .collect();
        let cut = cut_at_borders(&lattice, lattice.seeds(&seeds), &boxes);
        let grid = SolidModel::of_pieces(scene.dx, lattice, &cut.pieces);
        // At the border of a cell round-off may put a particle into the next one, which may have no matter.
        let points = seeds.iter().map(|seed| grid.site_near(seed.position));
        let particles = points.collect::<Option<Vec<CellPoint>>>()?;
        let pieces = Pieces::new(&grid.lattice, &seeds);
        let mut solid = Self {
            surface: ContactSurface::new(&grid, surface(&grid, &pieces)),
            depth: has_others(scene).then(|| DepthField::new(&pieces)),
            sampling: Sampling::new(&grid, &particles),
            particles,
            masses: seeds.iter().map(|s| s.volume * s.density).collect(),
            regions: vec![],
            grid,
        };
        let regions = scene.pinned_regions.iter();
        solid.regions = regions
            .map(|region| solid.held_in(region, &seeds))
            .collect();
        for (n, &region) in reaching.iter().enumerate() {
            let border = cut.border.iter().filter(|point| point.region == n);
            solid.regions[region] =
                solid.held_to_border(&scene.pinned_regions[region], &seeds, border);
        }
        Some(solid)
    }

    /// What a region that reaches into it holds: its border, and nodes that nothing beyond moves.
    fn held_to_border<'a>(
        &mut self,
        region: &PinnedRegion,
        seeds: &[Seed],
        border: impl Iterator<Item = &'a BorderPoint>,
    ) -> HeldInRegion {
        let first = self.surface.points.len();
        let grid = &self.grid;
        let points =
            border.filter_map(|at| SurfacePoint::new(grid, [at.x, at.owner], at.area, [0.0; 3]));
        self.surface.points.extend(points);
        let inside = |n: &u32| region.bounds.contains(seeds[*n as usize].position);
        HeldInRegion {
            nodes: self.nodes_with(ALL, |n| inside(&(n as u32))),
            points: (first..self.surface.points.len()).collect(),
            particles: (0..seeds.len() as u32).filter(inside).collect(),
        }
    }

    /// Particles within the borders of regions, which move as the nodes do that those hold: nodes next to a border are moved from beyond.
    pub fn carried_along(&self, state: &SolidState) -> Vec<(u32, CarriedAlong)> {
        let mut all = vec![];
        for region in &self.regions {
            let Some(&node) = region.nodes.first() else {
                continue;
            };
            // Those of an object that was turned as a whole are where their nodes are.
            let way = state.displacement(node);
            if !region.nodes.iter().all(|&n| state.displacement(n) == way) {
                continue;
            }
            let (now, rest) = (
                state.position(&self.grid, node),
                self.grid.node_in_world(node),
            );
            let carried = CarriedAlong {
                way: std::array::from_fn(|a| now[a] - rest[a]),
                velocity: state.velocity_of(&self.grid, node),
            };
            all.extend(region.particles.iter().map(|&n| (n, carried)));
        }
        all
    }

    /// What a region holds of it at rest.
    fn held_in(&self, region: &PinnedRegion, seeds: &[Seed]) -> HeldInRegion {
        if !(seeds.iter()).any(|seed| region.bounds.contains(seed.position)) {
            let points = self.surface.points.iter().enumerate();
            let around = region.bounds.grown(FACE * self.grid.dx);
            let points = points.filter(|(_, point)| around.contains(point.x));
            let points: Vec<usize> = points.map(|(n, _)| n).collect();
            if !points.is_empty() {
                return HeldInRegion {
                    points,
                    ..HeldInRegion::default()
                };
            }
        }
        HeldInRegion {
            nodes: self.nodes_in(region, seeds),
            ..HeldInRegion::default()
        }
    }

    /// Nodes in a region at rest, and those of matter in it.
    fn nodes_in(&self, region: &PinnedRegion, seeds: &[Seed]) -> Vec<usize> {
        let mut nodes = self.nodes_of(|n| region.bounds.contains(seeds[n].position));
        let inside = |&n: &usize| region.bounds.contains(self.grid.node_in_world(n));
        nodes.extend(self.grid.nodes().filter(inside));
        nodes.sort_unstable();
        nodes.dedup();
        nodes
    }

    /// Nodes that particles of the object hold, by their number in it.
    pub fn nodes_of(&self, holds: impl Fn(usize) -> bool) -> Vec<usize> {
        self.nodes_with(HELD, holds)
    }

    /// Nodes that have at least a share of their mass from particles of the object, by their number in it.
    fn nodes_with(&self, least: f64, holds: impl Fn(usize) -> bool) -> Vec<usize> {
        let mut shares = vec![[0.0; 2]; self.grid.mass.len()];
        for (n, site) in self.particles.iter().enumerate() {
            let held = holds(n);
            for (slot, weight) in self.grid.stencil_at(site) {
                let mass = weight * self.masses[n];
                shares[slot][0] += mass;
                if held {
                    shares[slot][1] += mass;
                }
            }
        }
        let slots = self.grid.nodes();
        let is_held = |&n: &usize| shares[n][1] > 0.0 && shares[n][1] >= least * shares[n][0];
        slots.filter(is_held).collect()
    }

    /// Nodes that particles hold, by their numbers, each with what the one says that has most of it.
    pub fn held_by<T: Copy>(&self, holds: impl Fn(usize) -> Option<T>) -> Vec<(usize, T)> {
        let fields: Vec<Option<T>> = (0..self.particles.len()).map(holds).collect();
        let nodes = self.nodes_of(|n| fields[n].is_some());
        let mut most = vec![(0.0, None); self.grid.mass.len()];
        for (n, field) in fields.iter().enumerate().filter(|(_, f)| f.is_some()) {
            for (slot, weight) in self.grid.stencil_at(&self.particles[n]) {
                let mass = weight * self.masses[n];
                if mass > most[slot].0 {
                    most[slot] = (mass, *field);
                }
            }
        }
        let of = |n: usize| Some((n, most[n].1?));
        nodes.into_iter().filter_map(of).collect()
    }

    /// Momentum per mass of nodes, by their number, that velocity changes [m/s] of particles, by theirs, come to.
    pub fn spread(&self, change: impl Fn(usize) -> [f64; 3]) -> Vec<[f64; 3]> {
        let mut out = vec![[0.0; 3]; self.grid.mass.len()];
        for (n, site) in self.particles.iter().enumerate() {
            let change = change(n);
            if change == [0.0; 3] {
                continue;
            }
            for (slot, weight) in self.grid.stencil_at(site) {
                for (inner, e) in self.grid.extension.borne_by(slot as u32) {
                    let (inner, weight) = (inner as usize, weight * f64::from(e));
                    for a in 0..3 {
                        out[inner][a] +=
                            weight * self.masses[n] * change[a] / self.grid.mass[inner];
                    }
                }
            }
        }
        out
    }
}

/// Whether an object moves as a solid: it says so, and is no rigid body whatever its material.
pub fn is_solid(object: &Object) -> bool {
    object.is_matter() && object.solver == Solver::Lagrangian
}

/// Regions of a scene that hold a part of this matter all the time, by their numbers.
fn reaching(scene: &Scene, seeds: &[Seed]) -> Vec<usize> {
    let regions = scene.pinned_regions.iter().enumerate();
    let always =
        regions.filter(|(_, region)| region.span.start <= 0.0 && region.span.end == f64::INFINITY);
    let holds = |seed: &Seed| {
        scene
            .pinned_regions
            .iter()
            .any(|region| region.bounds.contains(seed.position))
    };
    // Of what is held as a whole nothing has a border.
    if seeds.iter().all(holds) {
        return vec![];
    }
    let reaching = always.filter(|(_, region)| {
        seeds
            .iter()
            .any(|seed| region.bounds.contains(seed.position))
    });
    reaching.map(|(n, _)| n).collect()
}

/// Whether a scene has more than one object that moves.
fn has_others(scene: &Scene) -> bool {
    let moves = |o: &&Object| o.fidelity != Fidelity::Static && !o.particles.is_empty();
    scene.objects.iter().filter(moves).count() > 1
}

/// The particles of an object as matter at rest.
pub(super) fn seeds(scene: &Scene, object: &Object) -> Vec<Seed> {
    let part = |p: usize| {
        let of = |r: &crate::scene::MaterialRegion| r.particles.contains(&p);
        object
            .regions
            .iter()
            .position(of)
            .map_or(0, |n| n as u16 + 1)
    };
    let particles = object.particles.clone();
    particles
        .map(|p| Seed {
            position: scene.particles.position[p],
            volume: scene.particles.volume[p],
            density: object.density_of(p),
            part: part(p),
        })
        .collect()
}

/// The numbers of a material's law for matter of the density [kg/m^3] and the loss factor of `at_rest`, which edits leave as they are.
pub fn law_of(material: &Material, at_rest: &Material) -> SolidLaw {
    SolidLaw {
        law: material.law,
        lambda: material.lambda(),
        mu: material.mu(),
        density: at_rest.density,
        loss: at_rest.loss,
    }
}
