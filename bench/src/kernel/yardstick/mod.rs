//! The yardstick: the same substep as a plain scalar `f32` loop over an array of structs.
//!
//! What a careful programmer writes without vectors in mind: MLS-MPM with quadratic splines and APIC on a dense
//! grid over the particles' bounding box, one particle at a time, mass and units taken out of the loops, nothing
//! allocated, iterations that stop where they have converged. It is compiled for AVX2 and FMA, so that a fused
//! multiply-add is one instruction and the compiler may widen what it finds. The solver's speed is stated as a
//! multiple of this loop's, measured in the same minute.

pub mod laws;
mod linear;

use laws::Law;
use linear::{Matrix, add_product};

/// A particle: 96 bytes for an elastic law.
#[derive(Clone, Copy, Debug)]
struct Particle<S> {
    /// Position [cells].
    x: [f32; 3],
    /// Velocity [cells/s].
    v: [f32; 3],
    /// Velocity gradient `C` [1/s].
    c: Matrix,
    /// What the law remembers.
    state: S,
}

/// What all bodies have in common.
#[derive(Clone, Copy, Debug)]
pub struct Setup {
    /// Density at rest [kg/m^3].
    pub density: f64,
    /// Cell size [m].
    pub dx: f64,
    /// Vertical gravity [m/s^2].
    pub gravity: f64,
}

/// One body of particles of equal mass above a slipping floor at height 0.
struct Loop<L: Law> {
    particles: Vec<Particle<L::State>>,
    law: L,
    /// Dense grid over the bounding box: momentum and mass, then velocity; z fastest.
    nodes: Vec<[f32; 4]>,
    /// Index of the first node.
    origin: [i32; 3],
    size: [usize; 3],
    /// `4 / (rho0 dx^2)`: stress [Pa] to the rate of the affine velocity [1/s^2].
    stress_scale: f32,
    /// Vertical gravity [cells/s^2].
    gravity: f32,
    /// Whether forces have acted.
    is_moving: bool,
}

/// A body of any law.
pub trait Yardstick {
    /// Takes `substeps` of `dt` [s].
    fn advance(&mut self, dt: f64, substeps: u32);
    #[cfg(test)]
    /// Position [cells] and velocity [cells/s] of a particle.
    fn motion(&self, particle: usize) -> [[f32; 3]; 2];
    /// How many particles there are.
    fn len(&self) -> usize;
}

/// A body at rest shape: positions [cells], their velocities [cells/s] and the velocity gradient [1/s].
pub fn yardstick<L: Law + 'static>(
    law: L,
    setup: &Setup,
    position: impl Iterator<Item = ([f32; 3], [f32; 3])>,
    gradient: Matrix,
) -> Box<dyn Yardstick> {
    let particle = |(x, v)| Particle {
        x,
        v,
        c: gradient,
        state: L::REST,
    };
    Box::new(Loop {
        particles: position.map(particle).collect(),
        law,
        nodes: vec![],
        origin: [0; 3],
        size: [0; 3],
        stress_scale: (4.0 / (setup.density * setup.dx * setup.dx)) as f32,
        gravity: (setup.gravity / setup.dx) as f32,
        is_moving: false,
    })
}

impl<L: Law> Yardstick for Loop<L> {
    fn advance(&mut self, dt: f64, substeps: u32) {
        #[cfg(target_arch = "x86_64")]
        if is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma") {
            // SAFETY: the processor has both.
            unsafe { substeps_avx2(self, dt as f32, substeps) };
            return;
        }
        for _ in 0..substeps {
            self.substep(dt as f32);
        }
    }

    #[cfg(test)]
    fn motion(&self, particle: usize) -> [[f32; 3]; 2] {
        let particle = &self.particles[particle];
        [particle.x, particle.v]
    }

    fn len(&self) -> usize {
        self.particles.len()
    }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma")]
fn substeps_avx2<L: Law>(body: &mut Loop<L>, dt: f32, substeps: u32) {
    for _ in 0..substeps {
        body.substep(dt);
    }
}

impl<L: Law> Loop<L> {
    #[inline(always)]
    fn substep(&mut self, dt: f32) {
        // From the middle of one substep to that of the next, like the solvers.
        let kick = if self.is_moving { dt } else { 0.5 * dt };
        self.is_moving = true;
        self.enclose();
        self.scatter(kick);
        self.grid(kick);
        self.gather(dt);
    }

    /// Lays an empty grid around the particles.
    #[inline(always)]
    fn enclose(&mut self) {
        let (mut low, mut high) = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]);
        for particle in &self.particles {
            for a in 0..3 {
                low[a] = low[a].min(particle.x[a]);
                high[a] = high[a].max(particle.x[a]);
            }
        }
        for a in 0..3 {
            self.origin[a] = (low[a] + 0.5).floor() as i32 - 1;
            self.size[a] = ((high[a] + 0.5).floor() as i32 + 2 - self.origin[a]) as usize;
        }
        self.nodes.clear();
        self.nodes.resize(self.size.iter().product(), [0.0; 4]);
    }

    /// Law and P2G: weight x (momentum of the affine field at the node, mass).
    #[inline(always)]
    fn scatter(&mut self, kick: f32) {
        let ([_, ny, nz], origin) = (self.size, self.origin.map(|o| o as f32));
        let nodes = self.nodes.as_mut_slice();
        let stress_scale = -kick * self.stress_scale;
        for particle in &mut self.particles {
            let t = self.law.respond(&mut particle.state, &particle.c);
            let t = [t[0], t[1], t[2], t[1], t[3], t[4], t[2], t[4], t[5]];
            let a = add_product(&particle.c, stress_scale, &t);
            let v = particle.v;
            let Stencil { cell, d, w } = Stencil::new(particle.x, origin);
            // Momentum at the nearest node, per unit mass.
            let mut centre = [0.0; 3];
            for r in 0..3 {
                centre[r] = v[r] - a[3 * r] * d[0] - a[3 * r + 1] * d[1] - a[3 * r + 2] * d[2];
            }
            for i in 0..3 {
                let x = i as f32 - 1.0;
                for j in 0..3 {
                    let y = j as f32 - 1.0;
                    let mut middle = [0.0; 3];
                    for r in 0..3 {
                        middle[r] = centre[r] + x * a[3 * r] + y * a[3 * r + 1];
                    }
                    let weight = w[0][i] * w[1][j];
                    let first = ((cell[0] + i) * ny + cell[1] + j) * nz + cell[2];
                    let row = &mut nodes[first..first + 3];
                    for k in 0..3 {
                        let z = k as f32 - 1.0;
                        let weight = weight * w[2][k];
                        for r in 0..3 {
                            let p = z.mul_add(a[3 * r + 2], middle[r]);
                            row[k][r] = weight.mul_add(p, row[k][r]);
                        }
                        row[k][3] += weight;
                    }
                }
            }
        }
    }

    /// Momentum to velocity, gravity, floor.
    #[inline(always)]
    fn grid(&mut self, kick: f32) {
        let (nz, first) = (self.size[2], self.origin[2]);
        let fall = kick * self.gravity;
        for column in self.nodes.chunks_exact_mut(nz) {
            for (z, node) in (first..).zip(column) {
                if node[3] > 0.0 {
                    let inverse = 1.0 / node[3];
                    node[0] *= inverse;
                    node[1] *= inverse;
                    node[2] = if z < 0 {
                        0.0
                    } else {
                        node[2].mul_add(inverse, fall)
                    };
                }
            }
        }
    }

    /// G2P, motion, deformation.
    #[inline(always)]
    fn gather(&mut self, dt: f32) {
        let ([_, ny, nz], origin) = (self.size, self.origin.map(|o| o as f32));
        let nodes = self.nodes.as_slice();
        for particle in &mut self.particles {
            let Stencil { cell, d, w } = Stencil::new(particle.x, origin);
            let mut v = [0.0; 3];
            let mut c = [0.0; 9];
            for i in 0..3 {
                let x = i as f32 - 1.0 - d[0];
                for j in 0..3 {
                    let y = j as f32 - 1.0 - d[1];
                    let weight = w[0][i] * w[1][j];
                    let first = ((cell[0] + i) * ny + cell[1] + j) * nz + cell[2];
                    let row = &nodes[first..first + 3];
                    for k in 0..3 {
                        let z = k as f32 - 1.0 - d[2];
                        let weight = weight * w[2][k];
                        for r in 0..3 {
                            let share = weight * row[k][r];
                            v[r] += share;
                            c[3 * r] = x.mul_add(share, c[3 * r]);
                            c[3 * r + 1] = y.mul_add(share, c[3 * r + 1]);
                            c[3 * r + 2] = z.mul_add(share, c[3 * r + 2]);
                        }
                    }
                }
            }
            for n in 0..9 {
                c[n] *= 4.0;
            }
            particle.v = v;
            for r in 0..3 {
                particle.x[r] += dt * v[r];
            }
            particle.c = c;
            L::deform(&mut particle.state, &c, dt);
        }
    }
}

/// Nearest node, distance from it [cells] and weights of the nodes -1, 0, 1 per axis.
struct Stencil {
    /// Index of the first of the 27 nodes in the grid.
    cell: [usize; 3],
    d: [f32; 3],
    w: [[f32; 3]; 3],
}

impl Stencil {
    #[inline(always)]
    fn new(x: [f32; 3], origin: [f32; 3]) -> Self {
        let mut stencil = Self {
            cell: [0; 3],
            d: [0.0; 3],
            w: [[0.0; 3]; 3],
        };
        for a in 0..3 {
            let x = x[a] - origin[a];
            let nearest = (x + 0.5) as i32;
            let d = x - nearest as f32;
            let (low, high) = (0.5 - d, 0.5 + d);
            stencil.cell[a] = (nearest - 1) as usize;
            stencil.d[a] = d;
            stencil.w[a] = [0.5 * low * low, 0.75 - d * d, 0.5 * high * high];
        }
        stencil
    }
}
