//! How the particles of a solid move, two of one cell at a time: what is published once per frame.

use rayon::prelude::*;

use super::{
    cells::CELLS,
    model::{CellPoint, SolidModel, cell_of_number},
    nodes::{NodeBlock, place},
    state::SolidState,
};
use crate::{
    mat3::Mat3,
    simd::{F32x16, Isa, Lanes, on_isa},
};

/// Pairs per task.
const TASK: usize = 64;
/// Lanes of a particle: displacement, velocity, two without a meaning.
const HALF: usize = 8;

/// Two particles of one cell, or one twice.
#[derive(Clone, Debug)]
struct Pair {
    block: u32,
    number: u8,
    /// By their numbers in the object.
    particles: [u32; 2],
    /// Places from the centre of the cell, per axis one in each half [cells].
    d: [F32x16; 3],
}

/// The particles of a solid in the order of their cells.
#[derive(Clone, Debug, Default)]
pub struct Sampling {
    pairs: Vec<Pair>,
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

impl Sampled {
    const NONE: Self = Self {
        particle: 0,
        x: [0.0; 3],
        v: [0.0; 3],
        f: [0.0; 9],
        gradient: [0.0; 9],
    };
}

impl Sampling {
    /// Of particles where they are on the grid.
    pub fn new(particles: &[CellPoint]) -> Self {
        let mut order: Vec<u32> = (0..particles.len() as u32).collect();
        order.sort_by_key(|&n| {
            let site = &particles[n as usize];
            (site.block, site.number, n)
        });
        let same = |a: &u32, b: &u32| {
            let (a, b) = (&particles[*a as usize], &particles[*b as usize]);
            (a.block, a.number) == (b.block, b.number)
        };
        let mut pairs = vec![];
        for cell in order.chunk_by(same) {
            for pair in cell.chunks(2) {
                let both = [pair[0], pair[pair.len() - 1]];
                let first = &particles[both[0] as usize];
                let mut d = [F32x16::ZERO; 3];
                for (half, &n) in both.iter().enumerate() {
                    for (vector, d) in d.iter_mut().zip(particles[n as usize].d) {
                        vector.0[HALF * half..HALF * (half + 1)].fill(d as f32);
                    }
                }
                pairs.push(Pair {
                    block: first.block,
                    number: first.number,
                    particles: both,
                    d,
                });
            }
        }
        Self { pairs }
    }

    /// How they move, in the order of their cells; one that has no neighbour in its cell is there twice.
    pub fn sample(
        &self,
        isa: Isa,
        model: &SolidModel,
        particles: &[CellPoint],
        state: &SolidState,
    ) -> Vec<Sampled> {
        let mut out = vec![Sampled::NONE; 2 * self.pairs.len()];
        let pairs = self.pairs.par_chunks(TASK);
        let tasks = pairs.zip(out.par_chunks_mut(2 * TASK));
        tasks.for_each(|(pairs, out)| {
            sample_with_isa(isa, model, particles, state, pairs, out);
        });
        out
    }
}

on_isa! {
    fn sample_with_isa = sample(
        model: &SolidModel,
        particles: &[CellPoint],
        state: &SolidState,
        pairs: &[Pair],
        out: &mut [Sampled],
    )
}

#[inline(always)]
fn sample<V: Lanes>(
    model: &SolidModel,
    particles: &[CellPoint],
    state: &SolidState,
    pairs: &[Pair],
    out: &mut [Sampled],
) {
    let (mut rows, axes) = ([F32x16::ZERO; 27], model.lattice.axes());
    let mut known = None;
    for (pair, out) in pairs.iter().zip(out.chunks_exact_mut(2)) {
        let cell = (pair.block, pair.number);
        if known != Some(cell) {
            read_nodes(model, &state.nodes, cell, &mut rows);
            known = Some(cell);
        }
        let sums = interpolate::<V>(&rows, &pair.d);
        for half in 0..2 {
            let n = pair.particles[half];
            let d = &particles[n as usize].d;
            finish(model, &axes, state, (pair, d), half, &sums, &mut out[half]);
            out[half].particle = n;
        }
    }
}

/// Displacements and velocities of the 27 nodes of a cell, in both halves.
#[inline(always)]
fn read_nodes(
    model: &SolidModel,
    nodes: &[NodeBlock],
    (block, number): (u32, u8),
    rows: &mut [F32x16; 27],
) {
    let blocks = &model.point_blocks[block as usize].nodes;
    let cell = cell_of_number(number);
    for n in 0..27 {
        let (i, j, k) = (cell[0] + n / 9, cell[1] + n / 3 % 3, cell[2] + n % 3);
        let node = &nodes[blocks[4 * (i / 4) + 2 * (j / 4) + k / 4] as usize];
        let [x, lane] = place(i % 4, j % 4, k % 4);
        let row = &mut rows[n].0;
        for a in 0..3 {
            let (u, v) = (node.u[a][x].0[lane], node.v[a][x].0[lane]);
            (row[a], row[HALF + a]) = (u, u);
            (row[3 + a], row[HALF + 3 + a]) = (v, v);
        }
    }
}

/// Values, and slopes along each axis [1/cell].
#[inline(always)]
fn interpolate<V: Lanes>(rows: &[F32x16; 27], d: &[F32x16; 3]) -> [F32x16; 4] {
    let zero = V::splat(0.0);
    let (mut w, mut g) = ([[zero; 3]; 3], [[zero; 3]; 3]);
    for a in 0..3 {
        let d = V::load(&d[a]);
        let (l, r) = (V::splat(0.5) - d, V::splat(0.5) + d);
        w[a] = [
            V::splat(0.5) * l * l,
            V::splat(0.75) - d * d,
            V::splat(0.5) * r * r,
        ];
        g[a] = [zero - l, V::splat(-2.0) * d, r];
    }
    let mut sums = [zero; 4];
    for x in 0..3 {
        let (mut value, mut along_y, mut along_z) = (zero, zero, zero);
        for y in 0..3 {
            let row = &rows[9 * x + 3 * y..9 * x + 3 * y + 3];
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
    let mut out = [F32x16::ZERO; 4];
    for (sum, out) in sums.into_iter().zip(&mut out) {
        sum.store(out);
    }
    out
}

/// What is published of the particle in one half.
#[inline(always)]
fn finish(
    model: &SolidModel,
    axes: &Mat3<f32>,
    state: &SolidState,
    (pair, d): (&Pair, &[f64; 3]),
    half: usize,
    sums: &[F32x16; 4],
    out: &mut Sampled,
) {
    let block = &model.node_blocks[model.point_blocks[pair.block as usize].nodes[0] as usize];
    let cell = cell_of_number(pair.number);
    let (mut slopes, mut rates) = ([[0.0_f32; 3]; 3], [[0.0_f32; 3]; 3]);
    for a in 0..3 {
        out.x[a] = f64::from(CELLS * block[a]) + cell[a] as f64 + 1.0 + d[a];
    }
    out.x = model.world_of(out.x);
    for a in 0..3 {
        let lane = HALF * half + a;
        out.x[a] += state.shift[a] + model.dx * f64::from(sums[0].0[lane]);
        out.v[a] = (state.velocity[a] + model.dx * f64::from(sums[0].0[lane + 3])) as f32;
        for b in 0..3 {
            slopes[a][b] = sums[1 + b].0[lane];
            rates[a][b] = sums[1 + b].0[lane + 3];
        }
    }
    // Over rest positions in the world.
    let (mut f, rate) = (
        Mat3(slopes).mul_transposed(axes),
        Mat3(rates).mul_transposed(axes),
    );
    for a in 0..3 {
        f.0[a][a] += 1.0;
    }
    let j = f.det();
    // Over present positions, as other particles have it.
    let gradient = match j > 0.0 {
        true => rate.mul_transposed(&f.cofactor()),
        false => rate,
    };
    let scale = if j > 0.0 { j.recip() } else { 1.0 };
    for n in 0..9 {
        out.f[n] = f.0[n / 3][n % 3];
        out.gradient[n] = gradient.0[n / 3][n % 3] * scale;
    }
}

#[cfg(test)]
mod tests {
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
        let sampling = Sampling::new(&sites);
        let mut seen = vec![false; sites.len()];
        for isa in Isa::ALL.into_iter().filter(|isa| isa.is_available()) {
            for sampled in sampling.sample(isa, &model, &sites, &state) {
                let n = sampled.particle as usize;
                seen[n] = true;
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
            }
        }
        assert!(seen.into_iter().all(|seen| seen));
    }
}
