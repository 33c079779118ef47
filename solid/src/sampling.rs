//! How the particles of a solid move, up to eight of one cell beside up to eight of another: what is published once per frame.

use rayon::prelude::*;

use super::{
    model::{CellPoint, SolidModel, cell_of_number},
    nodes::{NodeBlock, place},
    state::SolidState,
};
use crate::{
    mat3::Mat3,
    simd::{F32x16, Isa, LANES, Lanes, on_isa},
};

/// Groups per task.
const TASK: usize = 8;
/// Lanes of a cell.
const HALF: usize = LANES / 2;
/// Lane without a particle.
const NOBODY: u32 = u32::MAX;
/// What nodes have: displacement and velocity.
const FIELDS: usize = 6;

/// Particles of two cells.
#[derive(Clone, Debug)]
struct Group {
    /// Block and number of the cell of each half.
    cells: [(u32, u8); 2],
    /// By their numbers in the object.
    particles: [u32; LANES],
    /// Places from the centres of the cells [cells].
    d: [F32x16; 3],
    /// Places at rest [m].
    x: [[f64; 3]; LANES],
}

/// The particles of a solid in the order of their cells.
#[derive(Clone, Debug, Default)]
pub struct Sampling {
    groups: Vec<Group>,
}

/// Motion of a particle.
#[derive(Clone, Copy, Debug)]
pub struct Sampled {
    /// Its number in the object.
    pub particle: u32,
    /// Position [m].
    pub x: [f64; 3],
    /// Velocity [m/s].
    pub v: [f32; 3],
    /// Deformation gradient, row-major.
    pub f: [f32; 9],
    /// Gradient of the velocity over present positions [1/s], row-major.
    pub gradient: [f32; 9],
}

/// Motions of a group, lane by lane.
struct Motions {
    /// Displacements and velocities [cells, cells/s].
    moved: [F32x16; FIELDS],
    /// Deformation gradients, and gradients of the velocity over present positions [1/s], row-major.
    f: [F32x16; 9],
    gradient: [F32x16; 9],
}

impl Motions {
    const NONE: Self = Self {
        moved: [F32x16::ZERO; FIELDS],
        f: [F32x16::ZERO; 9],
        gradient: [F32x16::ZERO; 9],
    };
}

impl Group {
    /// Particles of a cell each; none in a half is one of the other, unseen.
    fn new(model: &SolidModel, particles: &[CellPoint], halves: [&[u32]; 2]) -> Self {
        let mut group = Self {
            cells: [(0, 0); 2],
            particles: [NOBODY; LANES],
            d: [F32x16::ZERO; 3],
            x: [[0.0; 3]; LANES],
        };
        for (half, own) in halves.into_iter().enumerate() {
            let first = &particles[*own.first().unwrap_or(&halves[0][0]) as usize];
            group.cells[half] = (first.block, first.number);
            for (n, &particle) in own.iter().enumerate() {
                let (lane, site) = (HALF * half + n, &particles[particle as usize]);
                group.particles[lane] = particle;
                group.x[lane] = model.place_of(site);
                for a in 0..3 {
                    group.d[a].0[lane] = site.d[a] as f32;
                }
            }
        }
        group
    }

    /// How a particle of it moves, if there is one in a lane.
    #[inline(always)]
    fn sampled(
        &self,
        lane: usize,
        motions: &Motions,
        dx: f64,
        state: &SolidState,
    ) -> Option<Sampled> {
        let mut out = Sampled {
            particle: self.particles[lane],
            x: self.x[lane],
            v: [0.0; 3],
            f: [0.0; 9],
            gradient: [0.0; 9],
        };
        if out.particle == NOBODY {
            return None;
        }
        for a in 0..3 {
            out.x[a] += state.shift[a] + dx * f64::from(motions.moved[a].0[lane]);
            let v = f64::from(motions.moved[3 + a].0[lane]);
            out.v[a] = (state.velocity[a] + dx * v) as f32;
        }
        for n in 0..9 {
            out.f[n] = motions.f[n].0[lane];
            out.gradient[n] = motions.gradient[n].0[lane];
        }
        Some(out)
    }
}

impl Sampling {
    /// Of particles where they are on the grid.
    pub fn new(model: &SolidModel, particles: &[CellPoint]) -> Self {
        let cell = |n: &u32| {
            let site = &particles[*n as usize];
            (site.block, site.number)
        };
        let mut order: Vec<u32> = (0..particles.len() as u32).collect();
        order.sort_by_key(|n| (cell(n), *n));
        let of_cells = order.chunk_by(|a, b| cell(a) == cell(b));
        let halves: Vec<&[u32]> = of_cells.flat_map(|own| own.chunks(HALF)).collect();
        let groups = halves.chunks(2).map(|both| {
            let second = both.get(1).copied().unwrap_or_default();
            Group::new(model, particles, [both[0], second])
        });
        Self {
            groups: groups.collect(),
        }
    }

    /// Tells how each particle moves, in no order.
    pub fn sample(
        &self,
        isa: Isa,
        model: &SolidModel,
        state: &SolidState,
        tell: impl Fn(&Sampled) + Sync,
    ) {
        self.groups.par_chunks(TASK).for_each(|groups| {
            let mut motions = [const { Motions::NONE }; TASK];
            let motions = &mut motions[..groups.len()];
            sample_with_isa(isa, model, &state.nodes, groups, motions);
            for (group, motions) in groups.iter().zip(motions) {
                for lane in 0..LANES {
                    if let Some(sampled) = group.sampled(lane, motions, model.dx, state) {
                        tell(&sampled);
                    }
                }
            }
        });
    }
}

on_isa! {
    fn sample_with_isa = sample(
        model: &SolidModel,
        nodes: &[NodeBlock],
        groups: &[Group],
        out: &mut [Motions],
    )
}

#[inline(always)]
fn sample<V: Lanes>(
    model: &SolidModel,
    nodes: &[NodeBlock],
    groups: &[Group],
    out: &mut [Motions],
) {
    let mut fields = [[F32x16::ZERO; 27]; FIELDS];
    let axes = Mat3(model.lattice.axes().0.map(|row| row.map(V::broadcast)));
    for (group, out) in groups.iter().zip(out) {
        for (half, cell) in group.cells.iter().enumerate() {
            read_nodes(model, nodes, *cell, half, &mut fields);
        }
        let [w, g] = weights::<V>(&group.d);
        let mut slopes = [[V::splat(0.0); 3]; FIELDS];
        for (n, field) in fields.iter().enumerate() {
            let sums = interpolate(field, &w, &g);
            sums[0].store(&mut out.moved[n]);
            slopes[n] = [sums[1], sums[2], sums[3]];
        }
        let [a, b, c, d, e, f] = slopes;
        finish(&Mat3([a, b, c]), &Mat3([d, e, f]), &axes, out);
    }
}

/// Displacements and velocities of the 27 nodes of a cell, in the lanes of its half.
#[inline(always)]
fn read_nodes(
    model: &SolidModel,
    nodes: &[NodeBlock],
    (block, number): (u32, u8),
    half: usize,
    fields: &mut [[F32x16; 27]; FIELDS],
) {
    let blocks = &model.point_blocks[block as usize].nodes;
    let cell = cell_of_number(number);
    for n in 0..27 {
        let (i, j, k) = (cell[0] + n / 9, cell[1] + n / 3 % 3, cell[2] + n % 3);
        let node = &nodes[blocks[4 * (i / 4) + 2 * (j / 4) + k / 4] as usize];
        let [x, lane] = place(i % 4, j % 4, k % 4);
        for a in 0..3 {
            let own = HALF * half..HALF * (half + 1);
            fields[a][n].0[own.clone()].fill(node.u[a][x].0[lane]);
            fields[3 + a][n].0[own].fill(node.v[a][x].0[lane]);
        }
    }
}

/// Weights of the three nodes along each axis, and their slopes [1/cell].
#[inline(always)]
fn weights<V: Lanes>(d: &[F32x16; 3]) -> [[[V; 3]; 3]; 2] {
    let (half, zero) = (V::splat(0.5), V::splat(0.0));
    let mut out = [[[zero; 3]; 3]; 2];
    for a in 0..3 {
        let d = V::load(&d[a]);
        let (l, r) = (half - d, half + d);
        out[0][a] = [half * l * l, V::splat(0.75) - d * d, half * r * r];
        out[1][a] = [zero - l, V::splat(-2.0) * d, r];
    }
    out
}

/// Value, and slopes along each axis [1/cell].
#[inline(always)]
fn interpolate<V: Lanes>(field: &[F32x16; 27], w: &[[V; 3]; 3], g: &[[V; 3]; 3]) -> [V; 4] {
    let zero = V::splat(0.0);
    let mut sums = [zero; 4];
    for x in 0..3 {
        let (mut value, mut along_y, mut along_z) = (zero, zero, zero);
        for y in 0..3 {
            let row = &field[9 * x + 3 * y..9 * x + 3 * y + 3];
            let (l, c, r) = (V::load(&row[0]), V::load(&row[1]), V::load(&row[2]));
            let here = l.mul_add(w[2][0], c.mul_add(w[2][1], r * w[2][2]));
            let slope = l.mul_add(g[2][0], c.mul_add(g[2][1], r * g[2][2]));
            value = here.mul_add(w[1][y], value);
            along_y = here.mul_add(g[1][y], along_y);
            along_z = slope.mul_add(w[1][y], along_z);
        }
        sums[0] = value.mul_add(w[0][x], sums[0]);
        sums[1] = value.mul_add(g[0][x], sums[1]);
        sums[2] = along_y.mul_add(w[0][x], sums[2]);
        sums[3] = along_z.mul_add(w[0][x], sums[3]);
    }
    sums
}

/// Gradients of deformation and motion from slopes along the axes of the grid.
#[inline(always)]
fn finish<V: Lanes>(slopes: &Mat3<V>, rates: &Mat3<V>, axes: &Mat3<V>, out: &mut Motions) {
    let (zero, one) = (V::splat(0.0), V::splat(1.0));
    // Over rest positions in the world.
    let (mut f, rate) = (slopes.mul_transposed(axes), rates.mul_transposed(axes));
    for a in 0..3 {
        f.0[a][a] = f.0[a][a] + one;
    }
    let j = f.det();
    // Over present positions, as other particles have it; as it is where those are inside out.
    let present = rate.mul_transposed(&f.cofactor());
    let right = zero.lt(j);
    let scale = one / V::select(right, j, one);
    for a in 0..3 {
        for b in 0..3 {
            let n = 3 * a + b;
            f.0[a][b].store(&mut out.f[n]);
            let gradient = V::select(right, present.0[a][b] * scale, rate.0[a][b]);
            gradient.store(&mut out.gradient[n]);
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicBool, Ordering::Relaxed};

    use super::*;
    use crate::tests::ball;

    #[test]
    fn particles_are_published_as_they_move() {
        let seeds = ball(0.1, [0.02, 0.0, 0.0], 0.33);
        let model = SolidModel::new(0.1, &seeds);
        let sites = seeds.iter().map(|seed| model.site_near(seed.position));
        let sites: Vec<CellPoint> = sites.map(|site| site.expect("in a cell")).collect();
        let mut state = SolidState::new(&model, 0, |x| [x[1], 2.0 * x[2] + 1.0, x[0] * x[1]]);
        let bent: Vec<(usize, [f64; 3])> = model
            .nodes()
            .map(|slot| {
                let [x, y, z] = model.node_in_world(slot);
                (slot, [x + 0.3 * y * z, 1.1 * y, z - 0.2 * x + 5.0])
            })
            .collect();
        state.set_positions(&model, &bent);
        let sampling = Sampling::new(&model, &sites);
        let seen: Vec<_> = sites.iter().map(|_| AtomicBool::new(false)).collect();
        for isa in Isa::ALL.into_iter().filter(|isa| isa.is_available()) {
            sampling.sample(isa, &model, &state, |sampled| {
                let n = sampled.particle as usize;
                assert!(!seen[n].fetch_xor(true, Relaxed), "told twice");
                let exact = state.sample(&model, &sites[n]);
                let f = Mat3(exact.f);
                let (v, rate) = state.velocity_at(&model, &sites[n]);
                let gradient = Mat3(rate).mul_transposed(&f.cofactor());
                for a in 0..3 {
                    // Single precision of displacements of a few cells, times a few operations.
                    assert!((sampled.x[a] - exact.x[a]).abs() < 1e-7);
                    assert!((f64::from(sampled.v[a]) - v[a]).abs() < 2e-6);
                    for b in 0..3 {
                        let f_ab = f64::from(sampled.f[3 * a + b]);
                        assert!((f_ab - exact.f[a][b]).abs() < 3e-6);
                        let expected = gradient.0[a][b] / f.det();
                        assert!((f64::from(sampled.gradient[3 * a + b]) - expected).abs() < 1e-4);
                    }
                }
            });
            assert!(seen.iter().all(|seen| seen.fetch_xor(true, Relaxed)));
        }
    }
}
