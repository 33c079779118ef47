//! Rigid objects: the motion of a body from what its particles gather from the grid.

use rayon::prelude::*;

use super::{
    block::load_velocities,
    gather::{Gathered, gather},
    lanes::load3,
    rigid_contact::{Answering, Point, REACH},
    stencil::Stencil,
};
use crate::{
    colliders::Placed,
    grid::{Grid, Tile},
    mat3::{Mat3, cross},
    particles::{BLOCK, Block, Fixed, Group, NO_PARTICLE, Particles, Run, position_in_cells},
    simd::{F32x16, Isa, LANES, Lanes, Portable},
};

#[cfg(target_arch = "x86_64")]
use crate::simd::{Avx2, Avx512};

/// Numbers that [`BodySums`] are made of.
const SUMS: usize = 1 + 3 + 6 + 3 + 3 + 3;

/// What a rigid object does in one substep [cells, s]. Velocities are relative to the world's carrier velocity.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct RigidMotion {
    /// Centre of mass before the substep.
    pub com: [f64; 3],
    /// Displacement of the centre of mass, the carrier's included.
    pub shift: [f64; 3],
    /// Rotation during the substep, less the identity.
    pub turn: Mat3<f64>,
    /// Velocity of the centre of mass.
    pub velocity: [f64; 3],
    /// Angular velocity after the substep [1/s].
    pub spin: [f64; 3],
}

/// Sums over particles about the origin of the grid [cells, s]: mass, `m x`, `m x x^T` (xx xy xz yy yz zz),
/// `m v`, `m x (x) v`, axial vector of `m C`.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct BodySums([f64; SUMS]);

impl BodySums {
    /// Adds one particle.
    pub fn add(&mut self, mass: f64, x: [f64; 3], v: [f64; 3], c: &Mat3<f64>) {
        let s = &mut self.0;
        let moment = cross(x, v);
        let c = &c.0;
        let axial = [c[2][1] - c[1][2], c[0][2] - c[2][0], c[1][0] - c[0][1]];
        s[0] += mass;
        for (n, (a, b)) in PAIRS.into_iter().enumerate() {
            s[4 + n] += mass * x[a] * x[b];
        }
        for a in 0..3 {
            s[1 + a] += mass * x[a];
            s[10 + a] += mass * v[a];
            s[13 + a] += mass * moment[a];
            s[16 + a] += mass * axial[a];
        }
    }
}

/// Order of symmetric matrices.
const PAIRS: [(usize, usize); 6] = [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)];

/// Motion of every part in a substep of `dt` [s]: that of the body it belongs to, or none. `body_of` names the
/// body, an object id, of every rigid part. Linear and angular momentum are those that the particles would have
/// gathered one by one.
pub(crate) fn rigid_motions(
    isa: Isa,
    body_of: &[Option<usize>],
    particles: &Particles,
    grid: &Grid,
    carrier: [f64; 3],
    dt: f64,
    walls: &[Placed<'_>],
    falling: f64,
) -> Vec<Option<RigidMotion>> {
    let Some(last) = body_of.iter().copied().flatten().max() else {
        return vec![None; body_of.len()];
    };
    let found: Vec<Vec<(usize, BodySums)>> = particles
        .blocks
        .par_iter()
        .zip(&grid.nodes_of)
        .zip(&grid.cells)
        .map(|((block, nodes_of), cells)| {
            let runs = particles.runs[block.runs.clone()].iter();
            let mut rigid = runs
                .filter_map(|run| Some((body_of[run.part]?, run)))
                .peekable();
            if rigid.peek().is_none() {
                return vec![];
            }
            let mut velocities = Tile::ZERO;
            load_velocities(nodes_of, &grid.velocities, cells, &mut velocities);
            rigid
                .map(|(body, run)| (body, weigh(isa, particles, block, run, &velocities)))
                .collect()
        })
        .collect();
    // In the order of blocks: the same for any number of threads.
    let mut totals = vec![BodySums::default(); last + 1];
    for (body, sums) in found.iter().flatten() {
        for (total, sum) in totals[*body].0.iter_mut().zip(sums.0) {
            *total += sum;
        }
    }
    let points = contact_points(body_of, particles, walls, last + 1);
    let motions = totals
        .iter()
        .zip(&points)
        .map(|(total, points)| body_motion(total, carrier, dt, points, falling));
    let motions: Vec<Option<RigidMotion>> = motions.collect();
    body_of.iter().map(|body| motions[(*body)?]).collect()
}

/// Particles of every body that are near a collider, in the order of blocks.
fn contact_points(
    body_of: &[Option<usize>],
    particles: &Particles,
    walls: &[Placed<'_>],
    bodies: usize,
) -> Vec<Vec<Point>> {
    let mut points = vec![vec![]; bodies];
    if walls.is_empty() {
        return points;
    }
    for block in &particles.blocks {
        let runs = &particles.runs[block.runs.clone()];
        if !runs.iter().any(|run| body_of[run.part].is_some()) {
            continue;
        }
        let min = block.index.map(|i| f64::from(BLOCK * i) - 1.5);
        let max = min.map(|x| x + f64::from(BLOCK) + 2.0);
        let near = walls.iter().filter(|wall| wall.is_near(min, max, REACH));
        let near: Vec<&Placed<'_>> = near.collect();
        if near.is_empty() {
            continue;
        }
        for run in runs {
            let Some(body) = body_of[run.part] else {
                continue;
            };
            for g in run.groups.clone() {
                for lane in 0..LANES {
                    if particles.fixed[g].id[lane] == NO_PARTICLE {
                        continue;
                    }
                    let x = [0, 1, 2].map(|a| particles.groups[g].x[a].0[lane]);
                    let x = position_in_cells(block.index, x);
                    points[body].extend(near.iter().filter_map(|wall| Point::new(x, wall)));
                }
            }
        }
    }
    points
}

/// Sums of one run about the origin of the grid.
fn weigh(isa: Isa, particles: &Particles, block: &Block, run: &Run, velocities: &Tile) -> BodySums {
    let groups = &particles.groups[run.groups.clone()];
    let fixed = &particles.fixed[run.groups.clone()];
    let local = match isa {
        #[cfg(target_arch = "x86_64")]
        // SAFETY: a world is only made with an instruction set that the processor has.
        Isa::Avx512 => unsafe { weigh_avx512(groups, fixed, velocities) },
        #[cfg(target_arch = "x86_64")]
        // SAFETY: a world is only made with an instruction set that the processor has.
        Isa::Avx2 => unsafe { weigh_avx2(groups, fixed, velocities) },
        _ => weigh_lanes::<Portable>(groups, fixed, velocities),
    };
    let mut s = [0.0; SUMS];
    for (sum, lanes) in s.iter_mut().zip(&local) {
        *sum = lanes.0.iter().map(|&lane| f64::from(lane)).sum();
    }
    // From the block's centre to the origin of the grid.
    let c: [f64; 3] = std::array::from_fn(|a| f64::from(BLOCK * block.index[a]) + 1.5);
    let (m, mx, mv) = (s[0], [s[1], s[2], s[3]], [s[10], s[11], s[12]]);
    for (n, (a, b)) in PAIRS.into_iter().enumerate() {
        s[4 + n] += c[a] * mx[b] + mx[a] * c[b] + m * c[a] * c[b];
    }
    let moment = cross(c, mv);
    for a in 0..3 {
        s[1 + a] += m * c[a];
        s[13 + a] += moment[a];
    }
    BodySums(s)
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f,avx512dq,avx512bw,avx512vl,fma")]
unsafe fn weigh_avx512(groups: &[Group], fixed: &[Fixed], tile: &Tile) -> [F32x16; SUMS] {
    weigh_lanes::<Avx512>(groups, fixed, tile)
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma")]
unsafe fn weigh_avx2(groups: &[Group], fixed: &[Fixed], tile: &Tile) -> [F32x16; SUMS] {
    weigh_lanes::<Avx2>(groups, fixed, tile)
}

/// Sums of the groups of one run, lane by lane, about the block's centre.
#[inline(always)]
fn weigh_lanes<V: Lanes>(groups: &[Group], fixed: &[Fixed], tile: &Tile) -> [F32x16; SUMS] {
    let mut sums = [V::broadcast(0.0); SUMS];
    for (group, fixed) in groups.iter().zip(fixed) {
        let x = load3::<V>(&group.x);
        let Gathered { v, c, .. } = gather(tile, &Stencil::new(x));
        let m = V::load(&fixed.mass);
        let mx = [m * x[0], m * x[1], m * x[2]];
        let orbital = cross(x, v);
        let axial = [
            c.0[2][1] - c.0[1][2],
            c.0[0][2] - c.0[2][0],
            c.0[1][0] - c.0[0][1],
        ];
        sums[0] = sums[0] + m;
        for a in 0..3 {
            sums[1 + a] = sums[1 + a] + mx[a];
            sums[4 + a] = mx[0].mul_add(x[a], sums[4 + a]);
            sums[10 + a] = m.mul_add(v[a], sums[10 + a]);
            sums[13 + a] = m.mul_add(orbital[a], sums[13 + a]);
            sums[16 + a] = m.mul_add(axial[a], sums[16 + a]);
        }
        sums[7] = mx[1].mul_add(x[1], sums[7]);
        sums[8] = mx[1].mul_add(x[2], sums[8]);
        sums[9] = mx[2].mul_add(x[2], sums[9]);
    }
    let mut out = [F32x16::ZERO; SUMS];
    for n in 0..SUMS {
        sums[n].store(&mut out[n]);
    }
    out
}

/// Rigid motion with the mass, linear and angular momentum of the sums; none for a part without mass.
pub(crate) fn body_motion(
    sums: &BodySums,
    carrier: [f64; 3],
    dt: f64,
    points: &[Point],
    falling: f64,
) -> Option<RigidMotion> {
    let s = &sums.0;
    let mass = s[0];
    if mass.is_nan() || mass <= 0.0 {
        return None;
    }
    let com: [f64; 3] = std::array::from_fn(|a| s[1 + a] / mass);
    let velocity: [f64; 3] = std::array::from_fn(|a| s[10 + a] / mass);
    let orbital = cross(com, velocity);
    // Affine part of APIC: D_p = 1/4 cell^2 for quadratic splines.
    let angular: [f64; 3] =
        std::array::from_fn(|a| s[13 + a] - mass * orbital[a] + 0.25 * s[16 + a]);
    let full = [s[4], s[5], s[6], s[5], s[7], s[8], s[6], s[8], s[9]];
    let second = Mat3(std::array::from_fn(|a| {
        std::array::from_fn(|b| full[3 * a + b] - mass * com[a] * com[b])
    }));
    let trace = second.0[0][0] + second.0[1][1] + second.0[2][2];
    let inertia = Mat3::diagonal([trace + 0.5 * mass; 3]).sub(&second);
    let mut spin_now = solve(&inertia, angular)?;
    let (mut velocity, mut angular) = (velocity, angular);
    if !points.is_empty() {
        let det = inertia.det();
        let inverse = inertia.cofactor().transpose();
        let mut body = Answering {
            mass,
            inverse_inertia: Mat3(inverse.0.map(|row| row.map(|c| c / det))),
            com,
            velocity,
            spin: spin_now,
        };
        body.resolve(points, carrier, dt, falling);
        (velocity, spin_now) = (body.velocity, body.spin);
        angular = inertia.mul_vec(spin_now);
    }
    // Angular momentum stays, the inertia turns: half a step of the spin, then the whole turn with it.
    let half = rotation_minus_identity(spin_now, 0.5 * dt);
    let spin_mid = solve(&turned(&inertia, &half), angular)?;
    let turn = rotation_minus_identity(spin_mid, dt);
    let spin = solve(&turned(&inertia, &turn), angular)?;
    Some(RigidMotion {
        com,
        shift: std::array::from_fn(|a| dt * (velocity[a] + carrier[a])),
        turn,
        velocity,
        spin,
    })
}

/// `R I R^T` with `R = 1 + turn`.
fn turned(inertia: &Mat3<f64>, turn: &Mat3<f64>) -> Mat3<f64> {
    let r = turn.blend(1.0, &Mat3::identity(), 1.0);
    r.mul(inertia).mul_transposed(&r)
}

/// Solves a symmetric positive definite system by Cramer's rule; none when it is singular or not finite.
fn solve(m: &Mat3<f64>, b: [f64; 3]) -> Option<[f64; 3]> {
    let cofactor = m.cofactor();
    let det = m.det();
    let x = cofactor.transpose().mul_vec(b).map(|x| x / det);
    x.iter().all(|x| x.is_finite()).then_some(x)
}

/// `exp(t [w]x) - 1`, exact for small angles too (Rodrigues).
fn rotation_minus_identity(w: [f64; 3], t: f64) -> Mat3<f64> {
    let w = w.map(|w| t * w);
    let angle = (w[0] * w[0] + w[1] * w[1] + w[2] * w[2]).sqrt();
    let (a, b) = if angle < 1e-4 {
        let square = angle * angle;
        (1.0 - square / 6.0, 0.5 - square / 24.0)
    } else {
        let half = 0.5 * angle;
        (
            angle.sin() / angle,
            0.5 * (half.sin() / half) * (half.sin() / half),
        )
    };
    let k = Mat3([[0.0, -w[2], w[1]], [w[2], 0.0, -w[0]], [-w[1], w[0], 0.0]]);
    k.blend(a, &k.mul(&k), b)
}
