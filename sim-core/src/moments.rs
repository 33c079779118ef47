//! Object moments from particle arrays: equation (2) of the paper, with inertia, spin, rotation and energy.

use std::{
    array,
    iter::zip,
    ops::{AddAssign, Range},
};

use rayon::prelude::*;

use crate::{
    mat3::{Mat3, cross},
    materials::{Coefficients, Material, polar},
    report::ObjectState,
    rotation::quaternion,
    scene::Part,
};

/// Particles per partial sum. Fixed, and partial sums are added in order: same bits for any thread count.
const CHUNK: usize = 4096;

/// Particle state in scene order and SI units; all slices have the same length.
#[derive(Clone, Copy, Debug)]
pub struct ParticleArrays<'a, T> {
    /// Rest volume [m^3]; 0 takes a particle out of every sum.
    pub volume: &'a [f64],
    /// Position [m].
    pub position: &'a [[T; 3]],
    /// Velocity [m/s].
    pub velocity: &'a [[T; 3]],
    /// Affine velocity `C` [1/s], row-major.
    pub affine: &'a [[[T; 3]; 3]],
    /// Visible deformation gradient, row-major.
    pub deformation: &'a [[[T; 3]; 3]],
    /// Elastic deformation gradient, row-major.
    pub elastic: &'a [[[T; 3]; 3]],
    /// The laws' own number, see [`Trial`](crate::materials::Trial).
    pub memory: &'a [T],
}

/// Particles of one material.
#[derive(Clone, Debug)]
pub struct Body<'a> {
    /// Which.
    pub particles: Range<usize>,
    /// Mass per rest volume [kg/m^3].
    pub density: f64,
    /// The law whose energy is stored in them.
    pub material: &'a Material,
}

/// The parts of an object with their current materials; `parts` are those of a scene, object after object.
pub fn bodies_of<'a>(object: usize, parts: &[Part], materials: &'a [Material]) -> Vec<Body<'a>> {
    let first = parts.partition_point(|part| part.object < object);
    let from = parts[first..].iter().zip(&materials[first..]);
    from.take_while(|(part, _)| part.object == object)
        .map(|(part, material)| Body {
            particles: part.particles.clone(),
            density: part.material.density,
            material,
        })
        .collect()
}

/// Moments of the object that consists of these bodies; all but the contact impulse, which stays 0.
///
/// `dx` is the cell size [m] behind the affine inertia `D_p = dx^2 / 4` of quadratic splines.
/// An object without mass gets the default state.
pub fn object_moments<T: Copy + Sync + Into<f64>>(
    particles: &ParticleArrays<'_, T>,
    bodies: &[Body<'_>],
    dx: f64,
) -> ObjectState {
    match sums_of::<T, true>(particles, bodies, dx) {
        Some((sums, about)) => sums.state(about, dx),
        None => ObjectState::default(),
    }
}

/// Of those moments only what shape and place tell, and the spin that goes with an angular momentum about the centre of mass
/// [kg m^2/s]: for those who know the others from elsewhere.
pub fn object_shape<T: Copy + Sync + Into<f64>>(
    particles: &ParticleArrays<'_, T>,
    bodies: &[Body<'_>],
    dx: f64,
    angular_momentum: [f64; 3],
) -> ObjectState {
    match sums_of::<T, false>(particles, bodies, dx) {
        Some((mut sums, about)) => {
            sums.angular = angular_momentum;
            sums.state(about, dx)
        }
        None => ObjectState::default(),
    }
}

/// Sums over what there is of these bodies, motion and energy among them or not, and the point they are taken about; of nothing none.
fn sums_of<T: Copy + Sync + Into<f64>, const MOVES: bool>(
    particles: &ParticleArrays<'_, T>,
    bodies: &[Body<'_>],
    dx: f64,
) -> Option<(Sums, [f64; 3])> {
    let mut all = bodies.iter().flat_map(|body| body.particles.clone());
    let first = all.find(|&p| particles.volume[p] > 0.0)?;
    // Sums are taken about a point of the object, so that none cancels when it is far from the origin.
    let about = to_f64(particles.position[first]);
    let mut chunks = Vec::new();
    for body in bodies {
        let range = body.particles.clone();
        for start in range.clone().step_by(CHUNK) {
            chunks.push((body, start..(start + CHUNK).min(range.end)));
        }
    }
    let partial: Vec<Sums> = chunks
        .into_par_iter()
        .map(|(body, range)| chunk_sums::<T, MOVES>(particles, body, range, about, dx))
        .collect();
    let mut sums = Sums::default();
    for chunk in &partial {
        sums += chunk;
    }
    Some((sums, about))
}

/// Linear momentum [kg m/s] and angular momentum about the world origin [kg m^2/s] of all objects together.
pub fn total_momentum(objects: &[ObjectState]) -> ([f64; 3], [f64; 3]) {
    let mut linear = [0.0; 3];
    let mut angular = [0.0; 3];
    for object in objects {
        let p = object.linear_velocity.map(|v| v * object.mass);
        let orbital = cross(object.com, p);
        for i in 0..3 {
            linear[i] += p[i];
            angular[i] += orbital[i] + object.angular_momentum[i];
        }
    }
    (linear, angular)
}

/// What there is of an object at present.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
pub struct Matter {
    /// Particles, without those that left the domain or were quarantined.
    pub particles: usize,
    /// Their volume as it is deformed [m^3].
    pub volume: f64,
}

/// What there is of each of `objects` objects with these parts; nothing of those that are only shown.
pub fn matter<T: Copy + Into<f64>>(
    particles: &ParticleArrays<'_, T>,
    parts: &[Part],
    objects: usize,
) -> Vec<Matter> {
    let mut all = vec![Matter::default(); objects];
    for part in parts {
        let sum = &mut all[part.object];
        for p in part
            .particles
            .clone()
            .filter(|&p| particles.volume[p] > 0.0)
        {
            // The shape of a fluid is only shown: its volume is the memory of its law.
            let growth = match part.material.law.is_fluid() {
                true => 1.0 + particles.memory[p].into(),
                false => Mat3(particles.deformation[p].map(to_f64)).det(),
            };
            sum.particles += 1;
            sum.volume += particles.volume[p] * growth;
        }
    }
    all
}

fn to_f64<T: Copy + Into<f64>>(v: [T; 3]) -> [f64; 3] {
    v.map(Into::into)
}

/// Sums over particles, positions relative to a fixed point.
#[derive(Clone, Copy, Default)]
struct Sums {
    /// `m`.
    mass: f64,
    /// `m r`.
    first: [f64; 3],
    /// `m r r^T`, xx xy xz yy yz zz.
    second: [f64; 6],
    /// `m v`.
    momentum: [f64; 3],
    /// `m (r x v + D_p axial(C))`.
    angular: [f64; 3],
    /// `m (|v|^2 + D_p |C|^2)`.
    twice_kinetic: f64,
    /// `V psi` [J].
    elastic: f64,
    /// `m F`.
    deformation: [[f64; 3]; 3],
}

impl AddAssign<&Self> for Sums {
    #[inline(always)]
    fn add_assign(&mut self, other: &Self) {
        self.mass += other.mass;
        add(&mut self.first, other.first);
        add(&mut self.second, other.second);
        add(&mut self.momentum, other.momentum);
        add(&mut self.angular, other.angular);
        self.twice_kinetic += other.twice_kinetic;
        self.elastic += other.elastic;
        for (row, more) in zip(&mut self.deformation, other.deformation) {
            add(row, more);
        }
    }
}

#[inline(always)]
fn add<const N: usize>(sum: &mut [f64; N], more: [f64; N]) {
    for (s, m) in zip(sum, more) {
        *s += m;
    }
}

/// Sums over one chunk, with the processor's fused multiply-add where it has one: same bits, ten times as fast
/// as the library routine that stands in for it elsewhere.
fn chunk_sums<T: Copy + Into<f64>, const MOVES: bool>(
    particles: &ParticleArrays<'_, T>,
    body: &Body<'_>,
    range: Range<usize>,
    about: [f64; 3],
    dx: f64,
) -> Sums {
    #[cfg(target_arch = "x86_64")]
    {
        #[target_feature(enable = "avx2,fma")]
        fn with_fma<T: Copy + Into<f64>, const MOVES: bool>(
            particles: &ParticleArrays<'_, T>,
            body: &Body<'_>,
            range: Range<usize>,
            about: [f64; 3],
            dx: f64,
        ) -> Sums {
            sum_particles::<T, MOVES>(particles, body, range, about, dx)
        }
        if is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma") {
            // SAFETY: the features that `with_fma` is compiled for were just detected.
            return unsafe { with_fma::<T, MOVES>(particles, body, range, about, dx) };
        }
    }
    sum_particles::<T, MOVES>(particles, body, range, about, dx)
}

#[inline(always)]
fn sum_particles<T: Copy + Into<f64>, const MOVES: bool>(
    particles: &ParticleArrays<'_, T>,
    body: &Body<'_>,
    range: Range<usize>,
    about: [f64; 3],
    dx: f64,
) -> Sums {
    let d_p = 0.25 * dx * dx;
    let (law, k) = (body.material.law, Coefficients::new(body.material));
    let mut sums = Sums::default();
    for p in range {
        let volume = particles.volume[p];
        if volume <= 0.0 {
            continue;
        }
        let x = to_f64(particles.position[p]);
        let mass = volume * body.density;
        let r: [f64; 3] = array::from_fn(|i| x[i] - about[i]);
        sums.mass += mass;
        add(&mut sums.first, r.map(|r| mass * r));
        let second = [
            mass * r[0] * r[0],
            mass * r[0] * r[1],
            mass * r[0] * r[2],
            mass * r[1] * r[1],
            mass * r[1] * r[2],
            mass * r[2] * r[2],
        ];
        add(&mut sums.second, second);
        let visible = particles.deformation[p].map(to_f64);
        for (row, more) in zip(&mut sums.deformation, visible) {
            add(row, more.map(|f| mass * f));
        }
        if !MOVES {
            continue;
        }
        let v = to_f64(particles.velocity[p]);
        let c = particles.affine[p].map(to_f64);
        let elastic = Mat3(particles.elastic[p].map(to_f64));
        let orbital = cross(r, v);
        let axial = [c[2][1] - c[1][2], c[0][2] - c[2][0], c[1][0] - c[0][1]];
        let v_squared = v[0] * v[0] + v[1] * v[1] + v[2] * v[2];
        add(&mut sums.momentum, v.map(|v| mass * v));
        let angular = array::from_fn(|i| mass * (orbital[i] + d_p * axial[i]));
        add(&mut sums.angular, angular);
        sums.twice_kinetic += mass * (v_squared + d_p * Mat3(c).norm_squared());
        sums.elastic += volume * law.energy_density(&elastic, particles.memory[p].into(), &k);
    }
    sums
}

impl Sums {
    /// Moments about the centre of mass.
    fn state(&self, about: [f64; 3], dx: f64) -> ObjectState {
        let mass = self.mass;
        // Centre of mass relative to `about`.
        let r = self.first.map(|s| s / mass);
        let velocity = self.momentum.map(|s| s / mass);
        let shift = cross(r, self.momentum);
        let angular_momentum = array::from_fn(|i| self.angular[i] - shift[i]);
        // Second moment about the centre of mass (parallel axes).
        let pairs = [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)];
        let s: [f64; 6] = array::from_fn(|k| {
            let (i, j) = pairs[k];
            self.second[k] - mass * r[i] * r[j]
        });
        let trace = s[0] + s[3] + s[5];
        let inertia = [
            trace - s[0],
            -s[1],
            -s[2],
            trace - s[3],
            -s[4],
            trace - s[5],
        ];
        // A particle that spins with the object carries 2 D_p of inertia per mass in its affine part.
        let own = 0.5 * dx * dx * mass;
        let effective = Mat3([
            [inertia[0] + own, inertia[1], inertia[2]],
            [inertia[1], inertia[3] + own, inertia[4]],
            [inertia[2], inertia[4], inertia[5] + own],
        ]);
        let adjugate = effective.cofactor();
        let det = effective.det();
        let angular_velocity = adjugate.mul_vec(angular_momentum).map(|w| w / det);
        let mean = Mat3(self.deformation.map(|row| row.map(|f| f / mass)));
        ObjectState {
            mass,
            com: array::from_fn(|i| about[i] + r[i]),
            linear_velocity: velocity,
            angular_momentum,
            angular_velocity,
            inertia,
            rotation: quaternion(&polar::rotation(&mean)),
            radius: (5.0 / 3.0 * trace / mass).max(0.0).sqrt(),
            kinetic_energy: 0.5 * self.twice_kinetic,
            elastic_energy: self.elastic,
            ..ObjectState::default()
        }
    }
}

#[cfg(test)]
mod tests;
