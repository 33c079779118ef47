//! What varies of a solid in time, and sums over it.

use serde::{Deserialize, Serialize};

use super::{
    basis::weights_f64,
    grip::{Grip, NOTHING},
    kernel::{SolidLaw, elastic_energy},
    memory::BlockMemory,
    model::{CellPoint, SolidModel, cell_of_number},
    nodes::{NODES, NodeBlock, Planes, place, read, write},
    overlaps::Overlaps,
};
use crate::{
    mat3::{Mat3, cross, dot},
    motion::{RigidMotion, SUMS, add_to_sums},
    simd::Isa,
};

/// Nodes and the frame that they move in.
#[derive(Debug, PartialEq, Serialize, Deserialize)]
pub struct SolidState {
    /// Per block.
    pub nodes: Vec<NodeBlock>,
    /// What points remember of plastic flow, per block of them.
    pub memory: Vec<BlockMemory>,
    /// What elastic forces have relaxed to, per block of nodes [Pa]; none where matter loses nothing.
    pub relaxed: Vec<Planes>,
    /// Place of the frame [m]: a node at rest is at its rest position plus this.
    pub shift: [f64; 3],
    /// Velocity of the frame [m/s].
    pub velocity: [f64; 3],
    /// Largest tangent over density as of the latest substep that looked for it [m^2/s^2].
    pub tangent: f32,
    /// Springs of the points of its surface.
    pub springs: Vec<Grip>,
    /// What points of it were put into.
    pub overlaps: Overlaps,
    /// What matter on the spatial grid did to nodes in the latest span, by their numbers.
    pub of_matter: Vec<NodeLoad>,
    /// Length of that [s].
    pub span: f64,
    /// Largest gradient of the velocity in it, where it is deformed so much, or so fast, that this counts [1/s].
    pub rate: f32,
}

impl Clone for SolidState {
    fn clone(&self) -> Self {
        Self {
            nodes: self.nodes.clone(),
            memory: self.memory.clone(),
            relaxed: self.relaxed.clone(),
            springs: self.springs.clone(),
            overlaps: self.overlaps.clone(),
            of_matter: self.of_matter.clone(),
            ..*self
        }
    }

    // Kept before every span: memory is taken once.
    fn clone_from(&mut self, source: &Self) {
        let Self {
            nodes,
            memory,
            relaxed,
            shift,
            velocity,
            tangent,
            springs,
            overlaps,
            of_matter,
            span,
            rate,
        } = self;
        nodes.clone_from(&source.nodes);
        memory.clone_from(&source.memory);
        relaxed.clone_from(&source.relaxed);
        springs.clone_from(&source.springs);
        overlaps.clone_from(&source.overlaps);
        of_matter.clone_from(&source.of_matter);
        (*shift, *velocity) = (source.shift, source.velocity);
        (*tangent, *span, *rate) = (source.tangent, source.span, source.rate);
    }
}

/// A force on a node through a span.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct NodeLoad {
    /// Number of the node.
    pub slot: u32,
    /// The force [N].
    pub force: [f64; 3],
    /// Velocity of the node where the span began [m/s].
    pub before: [f64; 3],
    /// Its acceleration by all but matter, as was expected of the span [m/s^2].
    pub expected: [f64; 3],
}

/// Sums over a solid, about the world's origin.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Sums {
    /// Mass times position [kg m].
    pub moment: [f64; 3],
    /// Momentum [kg m/s].
    pub momentum: [f64; 3],
    /// Angular momentum about the world's origin [kg m^2/s].
    pub angular: [f64; 3],
    /// Kinetic energy [J].
    pub kinetic: f64,
    /// Elastic energy, that which contacts hold with it [J].
    pub elastic: f64,
}

/// Place of a material point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    /// Position [m].
    pub x: [f64; 3],
    /// Deformation gradient.
    pub f: [[f64; 3]; 3],
}

impl SolidState {
    /// Points of its surface that touch something.
    pub fn contact_points(&self) -> usize {
        let touches = |grip: &&Grip| grip.with != NOTHING;
        self.springs.iter().filter(touches).count()
    }

    /// At rest with so many points of its surface, moving with these velocities over rest positions [m/s].
    pub fn new(model: &SolidModel, points: usize, velocity: impl Fn([f64; 3]) -> [f64; 3]) -> Self {
        let mut state = Self {
            nodes: vec![NodeBlock::REST; model.node_blocks.len()],
            memory: vec![vec![]; model.point_blocks.len()],
            relaxed: vec![],
            shift: [0.0; 3],
            velocity: [0.0; 3],
            tangent: 0.0,
            springs: vec![Grip::NONE; points],
            overlaps: Overlaps::DUE,
            of_matter: vec![],
            span: 0.0,
            rate: 0.0,
        };
        state.change_velocities(model, |slot, _| velocity(model.node_in_world(slot)));
        state.recentre(model);
        state
    }

    /// Largest speed of a node relative to the frame [m/s].
    pub fn fastest(&self, model: &SolidModel) -> f64 {
        let speeds = self.nodes.iter().map(NodeBlock::fastest);
        model.dx * f64::from(speeds.fold(0.0, f32::max))
    }

    /// Whether all of it is somewhere.
    pub fn is_sound(&self) -> bool {
        let finite = |planes: &Planes| {
            planes
                .iter()
                .flatten()
                .all(|v| v.0.iter().all(|x| x.is_finite()))
        };
        let of_matter = self.of_matter.iter();
        self.nodes
            .iter()
            .all(|block| [&block.u, &block.v, &block.p].into_iter().all(finite))
            && self.relaxed.iter().all(finite)
            && self
                .shift
                .iter()
                .chain(&self.velocity)
                .chain(of_matter.flat_map(|load| load.force.iter().chain(&load.expected)))
                .all(|x| x.is_finite())
    }

    /// Position of a node by its number [m].
    pub fn position(&self, model: &SolidModel, slot: usize) -> [f64; 3] {
        let rest = model.node_in_world(slot);
        let u = read(&self.nodes[slot / NODES].u, slot);
        std::array::from_fn(|a| rest[a] + self.shift[a] + model.dx * f64::from(u[a]))
    }

    /// Positions of all nodes by their numbers [m].
    pub fn positions(&self, model: &SolidModel) -> Vec<[f64; 3]> {
        let slots = 0..model.mass.len();
        slots.map(|slot| self.position(model, slot)).collect()
    }

    /// Displacement of a node in the solid's frame [cells].
    pub fn displacement(&self, slot: usize) -> [f32; 3] {
        read(&self.nodes[slot / NODES].u, slot)
    }

    /// Puts nodes elsewhere, each with its number [m]: all nodes with matter.
    pub fn set_positions(&mut self, model: &SolidModel, to: &[(usize, [f64; 3])]) {
        let travel = |&(slot, x): &(usize, [f64; 3])| -> [f64; 3] {
            let rest = model.node_in_world(slot);
            std::array::from_fn(|a| x[a] - rest[a])
        };
        let mut mean = [0.0; 3];
        for node in to {
            let travel = travel(node);
            for a in 0..3 {
                mean[a] += travel[a] * model.mass[node.0] / model.total_mass;
            }
        }
        self.overlaps = Overlaps::DUE;
        self.shift = mean;
        for node in to {
            let travel = travel(node);
            let u = std::array::from_fn(|a| ((travel[a] - mean[a]) / model.dx) as f32);
            write(&mut self.nodes[node.0 / NODES].u, node.0, u);
        }
    }

    /// Velocity of a node by its number [m/s].
    pub fn velocity_of(&self, model: &SolidModel, slot: usize) -> [f64; 3] {
        let v = read(&self.nodes[slot / NODES].v, slot);
        std::array::from_fn(|a| self.velocity[a] + model.dx * f64::from(v[a]))
    }

    /// Momentum of a node over its mass by its number [m/s].
    fn momentum_of(&self, model: &SolidModel, slot: usize) -> [f64; 3] {
        let p = read(&self.nodes[slot / NODES].p, slot);
        std::array::from_fn(|a| self.velocity[a] + model.dx * f64::from(p[a]))
    }

    /// Motion as a rigid body [m, s], none where it has no extent: that nearest to the velocities of its nodes, by their masses.
    pub fn rigid_motion(&self, model: &SolidModel) -> Option<RigidMotion> {
        // Sums of squares are exact enough about a place amid it.
        let origin = self.position(model, model.nodes().next()?);
        let mut sums = [0.0; SUMS];
        // Outer nodes have no mass.
        for slot in model.nodes().filter(|&slot| model.mass[slot] > 0.0) {
            let (x, v) = (self.position(model, slot), self.velocity_of(model, slot));
            let x = std::array::from_fn(|a| x[a] - origin[a]);
            add_to_sums(&mut sums, model.mass[slot], x, v);
        }
        RigidMotion::from_sums(&sums, origin)
    }

    /// Gives every node the velocity [m/s] that `change` makes of its number and velocity; outer ones follow.
    pub fn change_velocities(
        &mut self,
        model: &SolidModel,
        change: impl Fn(usize, [f64; 3]) -> [f64; 3],
    ) {
        for slot in model.nodes() {
            let v = change(slot, self.velocity_of(model, slot));
            let own = std::array::from_fn(|a| ((v[a] - self.velocity[a]) / model.dx) as f32);
            write(&mut self.nodes[slot / NODES].v, slot, own);
        }
        model.extension.follow_velocities(&mut self.nodes);
        let slots = 0..model.mass.len();
        let velocities = slots.map(|slot| read(&self.nodes[slot / NODES].v, slot).map(f64::from));
        let momenta = (model.off_diagonal).momenta(&model.mass, model.dx, velocities.collect());
        for (slot, p) in momenta.into_iter().enumerate() {
            let p = p.map(|p| p as f32);
            write(&mut self.nodes[slot / NODES].p, slot, p);
        }
    }

    /// Spin with which it has an angular momentum [kg m^2/s] about its centre of mass, a place [m], as it moves as one [rad/s].
    pub fn spin_with(&self, model: &SolidModel, com: [f64; 3], angular: [f64; 3]) -> [f64; 3] {
        let second = self.second_moments(model, com);
        let inertia = Mat3::diagonal([second.trace(); 3]).sub(&second);
        // Nodes are spread over three along every axis at least: it is regular.
        let det = inertia.det();
        inertia.cofactor().mul_vec(angular).map(|w| w / det)
    }

    /// Second moments of mass about a place that its resistance to turning comes of [kg m^2]: with the mass between nodes.
    pub fn second_moments(&self, model: &SolidModel, about: [f64; 3]) -> Mat3<f64> {
        let arm = |slot: usize| -> [f64; 3] {
            let x = self.position(model, slot);
            match model.mass[slot] > 0.0 {
                true => std::array::from_fn(|a| x[a] - about[a]),
                false => [0.0; 3],
            }
        };
        let arms: Vec<[f64; 3]> = (0..model.mass.len()).map(arm).collect();
        let momenta = (model.off_diagonal).momenta(&model.mass, model.dx, arms.clone());
        let mut sums = [[0.0; 3]; 3];
        for ((mass, x), p) in model.mass.iter().zip(&arms).zip(&momenta) {
            for a in 0..3 {
                for b in 0..3 {
                    // Symmetric but for what is left of iterations.
                    sums[a][b] += 0.5 * mass * (x[a] * p[b] + x[b] * p[a]);
                }
            }
        }
        Mat3(sums)
    }

    /// Gives the frame this velocity [m/s]; nothing moves otherwise.
    pub fn set_frame_velocity(&mut self, model: &SolidModel, velocity: [f64; 3]) {
        let change: [f32; 3] =
            std::array::from_fn(|a| ((velocity[a] - self.velocity[a]) / model.dx) as f32);
        for a in 0..3 {
            self.velocity[a] += f64::from(change[a]) * model.dx;
        }
        self.subtract(model, change, |block| &mut block.v);
        self.subtract(model, change, |block| &mut block.p);
    }

    /// Makes the frame's velocity that of the centre of mass, and its place such that displacements are small: what single
    /// precision rounds is small then.
    pub fn recentre(&mut self, model: &SolidModel) {
        let sums = self.momenta(model);
        let mean = sums.momentum.map(|p| p / model.total_mass);
        if mean.iter().all(|v| v.is_finite()) {
            self.set_frame_velocity(model, mean);
        }
        let mut travel = [0.0; 3];
        for (slot, &mass) in model.mass.iter().enumerate().filter(|one| *one.1 > 0.0) {
            let u = read(&self.nodes[slot / NODES].u, slot);
            for a in 0..3 {
                travel[a] += f64::from(u[a]) * mass / model.total_mass;
            }
        }
        // In steps of an eighth: most of what is subtracted is then exact.
        let steps = travel.map(|u| (8.0 * u).round() as f32 / 8.0);
        if steps.iter().any(|u| u.abs() >= 0.5) && steps.iter().all(|u| u.is_finite()) {
            for a in 0..3 {
                self.shift[a] += f64::from(steps[a]) * model.dx;
            }
            self.subtract(model, steps, |block| &mut block.u);
        }
    }

    fn subtract(
        &mut self,
        model: &SolidModel,
        value: [f32; 3],
        of: impl Fn(&mut NodeBlock) -> &mut Planes,
    ) {
        for slot in model.nodes() {
            let planes = of(&mut self.nodes[slot / NODES]);
            let now = read(planes, slot);
            write(planes, slot, std::array::from_fn(|a| now[a] - value[a]));
        }
    }

    /// Everything but elastic energy.
    pub fn momenta(&self, model: &SolidModel) -> Sums {
        let mut sums = Sums::default();
        // Outer nodes have no mass.
        for (slot, &mass) in model.mass.iter().enumerate().filter(|one| *one.1 > 0.0) {
            let (x, v) = (self.position(model, slot), self.velocity_of(model, slot));
            let p = self.momentum_of(model, slot);
            let turn = cross(x, p);
            for a in 0..3 {
                sums.moment[a] += mass * x[a];
                sums.momentum[a] += mass * p[a];
                sums.angular[a] += mass * turn[a];
            }
            sums.kinetic += 0.5 * mass * dot(p, v);
        }
        sums
    }

    /// All sums.
    pub fn sums(&self, isa: Isa, model: &SolidModel, laws: &[SolidLaw]) -> Sums {
        let in_contact: f64 = self.springs.iter().map(|grip| grip.energy.max(0.0)).sum();
        Sums {
            elastic: elastic_energy(isa, model, laws, &self.nodes, &self.memory) + in_contact,
            ..self.momenta(model)
        }
    }

    /// Where the material point at a site is, and how it is deformed.
    #[inline(always)]
    pub fn sample(&self, model: &SolidModel, site: &CellPoint) -> Sample {
        self.sample_of(model, site, &self.sums_at(model, site, |node| &node.u))
    }

    /// The same where displacement there and its slopes along each axis are known.
    #[inline(always)]
    pub fn sample_of(&self, model: &SolidModel, site: &CellPoint, sums: &[[f64; 3]; 4]) -> Sample {
        let mut out = Sample {
            x: model.place_of(site),
            f: Mat3::identity().0,
        };
        let slopes = over_rest(model, sums);
        for a in 0..3 {
            out.x[a] += self.shift[a] + model.dx * sums[0][a];
            for b in 0..3 {
                out.f[a][b] += slopes[a][b];
            }
        }
        out
    }

    /// Velocity of the material point at a site [m/s], and its gradient over rest positions [1/s].
    #[inline(always)]
    pub fn velocity_at(&self, model: &SolidModel, site: &CellPoint) -> ([f64; 3], [[f64; 3]; 3]) {
        let sums = self.sums_at(model, site, |node| &node.v);
        let mut v = self.velocity;
        for a in 0..3 {
            v[a] += model.dx * sums[0][a];
        }
        (v, over_rest(model, &sums))
    }

    /// A field at a site, and its slopes along each axis, summed along z, then y, then x.
    #[inline(always)]
    fn sums_at(
        &self,
        model: &SolidModel,
        site: &CellPoint,
        field: impl Fn(&NodeBlock) -> &Planes,
    ) -> [[f64; 3]; 4] {
        let blocks = &model.point_blocks[site.block as usize].nodes;
        let (cell, axes) = (cell_of_number(site.number), site.d.map(weights_f64));
        let mut sums = [[0.0_f64; 3]; 4];
        for x in 0..3 {
            let i = cell[0] + x;
            let mut planes = [[0.0; 3]; 3];
            for y in 0..3 {
                let j = cell[1] + y;
                let (mut value, mut slope) = ([0.0; 3], [0.0; 3]);
                for z in 0..3 {
                    let k = cell[2] + z;
                    let block = blocks[4 * (i / 4) + 2 * (j / 4) + k / 4] as usize;
                    let node = field(&self.nodes[block]);
                    let [plane, lane] = place(i % 4, j % 4, k % 4);
                    let (w, g) = (axes[2].0[z], axes[2].1[z]);
                    for a in 0..3 {
                        let here = f64::from(node[a][plane].0[lane]);
                        value[a] += w * here;
                        slope[a] += g * here;
                    }
                }
                let (w, g) = (axes[1].0[y], axes[1].1[y]);
                for a in 0..3 {
                    planes[0][a] += w * value[a];
                    planes[1][a] += g * value[a];
                    planes[2][a] += w * slope[a];
                }
            }
            let (w, g) = (axes[0].0[x], axes[0].1[x]);
            for a in 0..3 {
                sums[0][a] += w * planes[0][a];
                sums[1][a] += g * planes[0][a];
                sums[2][a] += w * planes[1][a];
                sums[3][a] += w * planes[2][a];
            }
        }
        sums
    }
}

/// Gradient over rest positions in the world of a field with these slopes along the axes of the grid.
#[inline(always)]
fn over_rest(model: &SolidModel, sums: &[[f64; 3]; 4]) -> [[f64; 3]; 3] {
    let axes = &model.lattice.world_from_lattice.0;
    let mut out = [[0.0; 3]; 3];
    for a in 0..3 {
        for b in 0..3 {
            out[a][b] =
                axes[b][0] * sums[1][a] + (axes[b][1] * sums[2][a] + axes[b][2] * sums[3][a]);
        }
    }
    out
}
