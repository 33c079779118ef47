//! An elastic solid on a grid of its own, in double precision: a dense loop over cells, points and nodes.
//!
//! Nodes are a full array of the solid's box. It takes volumes of points, which light nodes follow which and the masses `k_ij` between nodes from
//! the model of the fast solver, and shares the stress of laws with it. Shape functions, masses, forces and steps are written here from their
//! equations:
//!
//! ```text
//! m_i = sum_p N_i(X_p) rho V_p             F_p = I + sum_i u_i (x) grad N_i(X_p)
//! f_i = -sum_p V_p P(F_p) grad N_i(X_p)    p_i += k (f_i / m_i + g)
//! v_i = p_i + sum_j k_ij (p_i - p_j) / m_i                   u_i += dt v_i
//! ```

pub mod resting;

use cosplat_sim_core::{
    mat3::Mat3,
    materials::{Law, hencky_piola::elastic_piola},
};
use cosplat_solid::{
    kernel::SolidLaw,
    model::{SolidModel, gauss_point},
    nodes::NODES,
};

/// A solid in motion, SI units, world frame. Indices of nodes count z first, then y, then x.
#[derive(Clone, Debug)]
pub struct ReferenceSolid {
    dx: f64,
    law: SolidLaw,
    /// Axes of the grid in the world, as columns.
    axes: Mat3<f64>,
    /// Nodes along each axis.
    counts: [usize; 3],
    /// Each quadrature point: the nodes about it, and its rest volume [m^3].
    points: Vec<(Vec<Near>, f64)>,
    /// Light nodes, each with the nodes that it follows and their weights.
    followers: Vec<(usize, Vec<(usize, f64)>)>,
    /// Pairs of nodes with the mass between them [kg].
    pairs: Vec<(usize, usize, f64)>,
    /// Mass of every node [kg]; 0 without matter, and of those that follow others.
    pub mass: Vec<f64>,
    /// Displacement of every node from rest [m].
    pub displacement: Vec<[f64; 3]>,
    /// Momentum of every node over its mass [m/s].
    pub momentum: Vec<[f64; 3]>,
    /// Velocity of every node [m/s], as of the latest substep.
    pub velocity: Vec<[f64; 3]>,
}

/// A node about a place, with its weight and the gradient of that [1/m].
type Near = (usize, f64, [f64; 3]);

/// The quadratic B-spline about 0 and its slope, of a distance [cells].
fn spline(r: f64) -> (f64, f64) {
    let far = 1.5 - r.abs();
    match r.abs() {
        a if a <= 0.5 => (0.75 - r * r, -2.0 * r),
        a if a <= 1.5 => (0.5 * far * far, -far * r.signum()),
        _ => (0.0, 0.0),
    }
}

fn index_in(counts: [usize; 3], [x, y, z]: [usize; 3]) -> usize {
    (x * counts[1] + y) * counts[2] + z
}

impl ReferenceSolid {
    /// Matter of one elastic law on the grid of a model, at rest.
    ///
    /// # Panics
    /// When the model holds no matter.
    pub fn new(model: &SolidModel, law: SolidLaw) -> Self {
        let places: Vec<[i32; 3]> = model.nodes().map(|slot| place(model, slot)).collect();
        let bound = |pick: fn(i32, i32) -> i32| -> [i32; 3] {
            let all = places.iter().copied();
            all.reduce(|a, b| std::array::from_fn(|n| pick(a[n], b[n])))
                .expect("a model holds matter")
        };
        let (low, high) = (bound(i32::min), bound(i32::max));
        let counts: [usize; 3] = std::array::from_fn(|a| (high[a] - low[a] + 1) as usize);
        // From the node (0, 0, 0) [cells], along the axes of the grid.
        let mut places = Vec::new();
        for block in &model.point_blocks {
            let first = place(model, NODES * block.nodes[0] as usize);
            for cell in &model.cells[block.cells.clone()] {
                let number = usize::from(cell.number);
                let inside = [number / 16, number / 4 % 4, number % 4];
                for (n, &volume) in cell.volumes.iter().enumerate() {
                    let d = gauss_point(n);
                    // The middle of the three nodes of a cell is at its centre.
                    let at = std::array::from_fn(|a| {
                        f64::from(first[a] - low[a]) + inside[a] as f64 + 1.0 + d[a]
                    });
                    places.push((at, f64::from(volume) * model.dx.powi(3)));
                }
            }
        }
        let nodes = counts.iter().product();
        let mut solid = Self {
            dx: model.dx,
            law,
            axes: model.lattice.world_from_lattice,
            counts,
            points: Vec::new(),
            followers: Vec::new(),
            pairs: Vec::new(),
            mass: vec![0.0; nodes],
            displacement: vec![[0.0; 3]; nodes],
            momentum: vec![[0.0; 3]; nodes],
            velocity: vec![[0.0; 3]; nodes],
        };
        let places = places.into_iter();
        solid.points = places
            .map(|(at, volume)| (solid.stencil(at), volume))
            .collect();
        for (stencil, volume) in &solid.points {
            for (node, weight, _) in stencil {
                solid.mass[*node] += weight * law.density * volume;
            }
        }
        let index = |slot: u32| {
            let at = place(model, slot as usize);
            index_in(counts, std::array::from_fn(|a| (at[a] - low[a]) as usize))
        };
        let of_outer = model.extension.outer.iter().map(|&outer| {
            let inner = model.extension.borne_by(outer);
            let inner = inner.map(|(inner, e)| (index(inner), f64::from(e)));
            (index(outer), inner.collect())
        });
        solid.followers = of_outer.collect();
        for (outer, inner) in &solid.followers {
            for (inner, e) in inner {
                solid.mass[*inner] += e * solid.mass[*outer];
            }
        }
        for (outer, _) in &solid.followers {
            solid.mass[*outer] = 0.0;
        }
        let all = model.nodes().flat_map(|slot| {
            let beside = model.off_diagonal.beside(slot);
            let once = beside.filter(move |&(other, _)| slot < other);
            once.map(move |(other, shared)| (slot, other, model.dx * shared))
        });
        let pairs = all.map(|(a, b, shared)| (index(a as u32), index(b as u32), shared));
        solid.pairs = pairs.collect();
        solid
    }

    fn index(&self, at: [usize; 3]) -> usize {
        index_in(self.counts, at)
    }

    /// Index of a node of the model that the solid was made of.
    pub fn index_of(&self, model: &SolidModel, slot: usize) -> usize {
        let places = || model.nodes().map(|slot| place(model, slot));
        let at = place(model, slot);
        self.index(std::array::from_fn(|a| {
            let low = places().map(|place| place[a]).min().unwrap_or(at[a]);
            (at[a] - low) as usize
        }))
    }

    /// Nodes about a place [cells].
    fn stencil(&self, at: [f64; 3]) -> Vec<Near> {
        let mut found = Vec::with_capacity(27);
        let near = |a: usize| {
            let first = (at[a] - 1.5).ceil().max(0.0) as usize;
            first..(first + 4).min(self.counts[a])
        };
        for x in near(0) {
            for y in near(1) {
                for z in near(2) {
                    let n = [x, y, z];
                    let of: [(f64, f64); 3] = std::array::from_fn(|a| spline(at[a] - n[a] as f64));
                    let weight = of[0].0 * of[1].0 * of[2].0;
                    if weight > 0.0 {
                        let along = [
                            of[0].1 * of[1].0 * of[2].0,
                            of[0].0 * of[1].1 * of[2].0,
                            of[0].0 * of[1].0 * of[2].1,
                        ];
                        let gradient = self.axes.mul_vec(along.map(|slope| slope / self.dx));
                        found.push((self.index(n), weight, gradient));
                    }
                }
            }
        }
        found
    }

    /// Deformation gradient about some nodes.
    fn gradient(&self, stencil: &[Near]) -> Mat3<f64> {
        let mut f = Mat3::identity();
        for (node, _, slope) in stencil {
            for a in 0..3 {
                for b in 0..3 {
                    f.0[a][b] += self.displacement[*node][a] * slope[b];
                }
            }
        }
        f
    }

    /// Force of the stress on every node [N]; none on those that follow others, whose forces those bear.
    pub fn forces(&self) -> Vec<[f64; 3]> {
        let SolidLaw {
            law, lambda, mu, ..
        } = self.law;
        let mut forces = vec![[0.0; 3]; self.mass.len()];
        for (stencil, volume) in &self.points {
            let stress = elastic_piola(law, &self.gradient(stencil), lambda, mu).stress;
            for (node, _, slope) in stencil {
                let pull = stress.mul_vec(*slope);
                for a in 0..3 {
                    forces[*node][a] -= volume * pull[a];
                }
            }
        }
        for (outer, inner) in &self.followers {
            let force = std::mem::take(&mut forces[*outer]);
            for (inner, e) in inner {
                for a in 0..3 {
                    forces[*inner][a] += e * force[a];
                }
            }
        }
        forces
    }

    /// Forces and gravity [m/s^2] act for `kick` [s], then nodes move for `drift` [s].
    pub fn substep(&mut self, kick: f64, drift: f64, gravity: [f64; 3]) {
        let forces = self.forces();
        for (node, force) in forces.iter().enumerate() {
            if self.mass[node] > 0.0 {
                for a in 0..3 {
                    self.momentum[node][a] += kick * (force[a] / self.mass[node] + gravity[a]);
                }
            }
        }
        self.velocity.clone_from(&self.momentum);
        for &(one, other, shared) in &self.pairs {
            for a in 0..3 {
                let change = shared * (self.momentum[one][a] - self.momentum[other][a]);
                self.velocity[one][a] += change / self.mass[one];
                self.velocity[other][a] -= change / self.mass[other];
            }
        }
        for (displacement, v) in self.displacement.iter_mut().zip(&self.velocity) {
            for a in 0..3 {
                displacement[a] += drift * v[a];
            }
        }
        self.follow();
    }

    /// Moves light nodes to where those that they follow say.
    pub fn follow(&mut self) {
        for (outer, inner) in &self.followers {
            for values in [&mut self.displacement, &mut self.velocity] {
                values[*outer] = std::array::from_fn(|a| {
                    inner.iter().map(|(inner, e)| e * values[*inner][a]).sum()
                });
            }
        }
    }

    /// Largest Green's strain of a quadrature point; not a number where one is.
    pub fn largest_strain(&self) -> f64 {
        let mut largest = 0.0_f64;
        for (stencil, _) in &self.points {
            let f = self.gradient(stencil);
            let twice = f.transpose().mul(&f).sub(&Mat3::identity());
            let squares = twice.0.as_flattened().iter().map(|e| 0.25 * e * e);
            let here = squares.sum::<f64>().sqrt();
            if here.is_nan() {
                return here;
            }
            largest = largest.max(here);
        }
        largest
    }

    /// Kinetic energy [J].
    pub fn kinetic_energy(&self) -> f64 {
        let nodes = self.mass.iter().zip(&self.momentum).zip(&self.velocity);
        let twice = nodes.map(|((m, p), v)| {
            let both = p.iter().zip(v);
            m * both.map(|(p, v)| p * v).sum::<f64>()
        });
        0.5 * twice.sum::<f64>()
    }

    /// Whether the law is one of those that the oracle knows: elastic, and with a Piola stress or on Hencky strain.
    pub fn knows(law: Law) -> bool {
        law.may_be_solid() && !law.is_plastic()
    }
}

/// Place of a node of a model among all nodes of its grid.
fn place(model: &SolidModel, slot: usize) -> [i32; 3] {
    model.node_position(slot).map(|x| x.round() as i32)
}

#[cfg(test)]
mod tests;
