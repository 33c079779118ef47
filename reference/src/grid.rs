//! Background grid: quadratic B-spline weights, scatter and gather.

use std::collections::HashMap;

use cosplat_sim_core::{
    colliders::{Attached, GapSample, Ghost, NodeConditions, Nodes, attached},
    mat3::Mat3,
};

/// One grid node.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Node {
    /// Mass, of what is held as it weighs on nodes [kg].
    pub mass: f64,
    /// Momentum after P2G [kg m/s].
    pub momentum: [f64; 3],
    /// Velocity after forces and boundaries [m/s].
    pub velocity: [f64; 3],
}

/// Nodes touched in this substep, in the order of first touch; node `index` sits at `index * dx`.
#[derive(Clone, Debug, Default)]
pub(crate) struct Grid {
    /// Nodes and their indices.
    pub nodes: Vec<([i32; 3], Node)>,
    /// Place of an index in `nodes`. Never iterated: its order is not reproducible.
    slots: HashMap<[i32; 3], usize>,
}

/// The 27 nodes around a particle.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Stencil([Neighbor; 27]);

impl Stencil {
    /// Places of its nodes in [`Grid::nodes`].
    pub fn slots(&self) -> impl Iterator<Item = usize> {
        self.0.iter().map(|neighbor| neighbor.slot)
    }
}

/// One node of a stencil.
#[derive(Clone, Copy, Debug, Default)]
struct Neighbor {
    /// Place in [`Grid::nodes`].
    slot: usize,
    /// B-spline weight.
    weight: f64,
    /// `x_i - x_p` [m].
    offset: [f64; 3],
}

impl Grid {
    /// Quadratic B-spline `N(r) = 3/4 - r^2` for `|r| < 1/2`, `(3/2 - |r|)^2 / 2` up to `3/2`, on the 27 nodes
    /// that it reaches, which are added where missing.
    pub fn stencil(&mut self, position: [f64; 3], dx: f64) -> Stencil {
        let spline = |r: f64| {
            if r.abs() < 0.5 {
                0.75 - r * r
            } else {
                0.5 * (1.5 - r.abs()).max(0.0).powi(2)
            }
        };
        let centre = position.map(|x| (x / dx).round() as i32);
        let mut neighbors = [Neighbor::default(); 27];
        for (n, neighbor) in neighbors.iter_mut().enumerate() {
            let shift = [n / 9, n / 3 % 3, n % 3].map(|s| s as i32 - 1);
            let index: [i32; 3] = std::array::from_fn(|a| centre[a] + shift[a]);
            let offset: [f64; 3] = std::array::from_fn(|a| f64::from(index[a]) * dx - position[a]);
            *neighbor = Neighbor {
                slot: *self.slots.entry(index).or_insert_with(|| {
                    self.nodes.push((index, Node::default()));
                    self.nodes.len() - 1
                }),
                weight: offset.iter().map(|r| spline(r / dx)).product(),
                offset,
            };
        }
        Stencil(neighbors)
    }

    /// Adds `w m` and `w (m v + A (x_i - x_p))` to every node of the stencil, `A` the affine momentum matrix.
    pub fn scatter(&mut self, stencil: &Stencil, mass: f64, v: [f64; 3], affine: &Mat3<f64>) {
        for &Neighbor {
            slot,
            weight: w,
            offset,
        } in &stencil.0
        {
            let node = &mut self.nodes[slot].1;
            let spin = affine.mul_vec(offset);
            node.mass += w * mass;
            for a in 0..3 {
                node.momentum[a] += w * (mass * v[a] + spin[a]);
            }
        }
    }

    /// Gives all nodes velocities that boundaries allow; `nearest` is per node and collider.
    pub fn constrain(
        &mut self,
        boundaries: &NodeConditions<'_>,
        nearest: &[Vec<GapSample>],
        dt: f64,
        dx: f64,
    ) {
        let seen = FreeNodes {
            grid: self,
            boundaries,
            nearest,
        };
        let velocities: Vec<[f64; 3]> = (self.nodes.iter().zip(nearest))
            .map(|((index, node), nearest)| {
                let x = index.map(|i| f64::from(i) * dx);
                let obeyed = attached(boundaries.faces(), *index, &seen, dx, dt);
                let obeyed = obeyed.unwrap_or(Attached::free(node.velocity));
                boundaries.constrain(x, nearest, dt, dx, &obeyed, &mut |_| ())
            })
            .collect();
        for ((_, node), velocity) in self.nodes.iter_mut().zip(velocities) {
            node.velocity = velocity;
        }
    }

    /// `v = sum w v_i` and `C = 4 / dx^2 sum w v_i (x_i - x_p)^T`.
    pub fn gather(&self, stencil: &Stencil, dx: f64) -> ([f64; 3], Mat3<f64>) {
        self.gather_seen(stencil, [0.0; 3], &[], dx)
    }

    /// The same for a particle at `x` that walls part from some of its nodes.
    pub fn gather_seen(
        &self,
        stencil: &Stencil,
        x: [f64; 3],
        walls: &[Ghost<'_>],
        dx: f64,
    ) -> ([f64; 3], Mat3<f64>) {
        let mut v = [0.0; 3];
        let mut c = [[0.0; 3]; 3];
        for &Neighbor {
            slot,
            weight: w,
            offset,
        } in &stencil.0
        {
            let mut u = self.nodes[slot].1.velocity;
            let at = std::array::from_fn(|a| x[a] + offset[a]);
            for wall in walls {
                u = wall.seen(at, u);
            }
            for a in 0..3 {
                v[a] += w * u[a];
                for b in 0..3 {
                    c[a][b] += 4.0 / (dx * dx) * w * u[a] * offset[b];
                }
            }
        }
        (v, Mat3(c))
    }
}

/// Nodes between forces and boundaries.
struct FreeNodes<'a> {
    grid: &'a Grid,
    boundaries: &'a NodeConditions<'a>,
    nearest: &'a [Vec<GapSample>],
}

impl Nodes for FreeNodes<'_> {
    fn node(&self, index: [i32; 3]) -> Option<(f64, [f64; 3])> {
        let &slot = self.grid.slots.get(&index)?;
        let node = &self.grid.nodes[slot].1;
        (node.mass > 0.0).then_some((node.mass, node.velocity))
    }

    fn gap(&self, index: [i32; 3], body: usize) -> f64 {
        let mut bodies = self.boundaries.bodies().iter();
        match (
            self.grid.slots.get(&index),
            bodies.position(|b| b.id == body),
        ) {
            (Some(&slot), Some(b)) => self.nearest[slot][b].gap.into(),
            _ => f64::INFINITY,
        }
    }
}
