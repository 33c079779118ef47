//! Matter that deforms the same everywhere: `x = c + A X` for all of it, twelve degrees of freedom and no grid.
//!
//! With `G = sum m (X X^T + D_p)` its kinetic energy is `m |c'|^2 / 2 + tr(A' G A'^T) / 2`. Each part stores `V psi(A F_0)`,
//! `F_0` its mean elastic deformation at `A = 1`, so that `A'' G = -sum V tau A^-T` with the Kirchhoff stress
//! `tau` at `A F_0`. Kick, drift and kick (Verlet 1967): as `tau` is symmetric, neither changes the antisymmetric part of
//! `A G A'^T`, which is the angular momentum.

use serde::{Deserialize, Serialize};

use super::vector::{Vec3, along, length, solve};
use crate::{
    mat3::{Mat3, Sym3, dot},
    materials::{
        Coefficients, Material, Trial,
        limits::{DeformationBounds, critical_dt, max_stretch_squared},
    },
};

/// Substep over that at which the fastest mode would become unstable: 63 to a period.
const SHARE: f64 = 0.05;
/// Substeps of a flight at most; what needs more cannot be followed.
const MAX_STEPS: f64 = 65_536.0;
/// Largest sum of the squared stretches of an elastic deformation that is followed: each below 3.5.
const MAX_NORM_SQUARED: f64 = 12.0;
/// Smallest and largest volume ratio that is followed.
const VOLUMES: [f64; 2] = [0.125, 8.0];

/// Where such matter is and how it moves.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Affine {
    /// Centre of mass [m].
    pub com: Vec3,
    /// Its velocity [m/s].
    pub velocity: Vec3,
    /// `A`, row-major.
    pub map: [Vec3; 3],
    /// `A'` [1/s].
    pub rate: [Vec3; 3],
}

/// A part of it, of one material.
#[derive(Clone, Debug)]
pub(crate) struct Lump {
    /// Volume at rest [m^3].
    pub volume: f64,
    /// What it is made of; a law that is elastic and remembers nothing.
    pub material: Material,
    /// Mean elastic deformation at `A = 1`: the mean stretch, by volume, turned like the mean of all.
    pub elastic: Mat3<f64>,
}

/// What never changes of it.
#[derive(Clone, Debug)]
pub(crate) struct Bulk {
    /// Mass [kg].
    pub mass: f64,
    /// `sum m X X^T` [kg m^2].
    pub spread: Mat3<f64>,
    /// Largest `|X|` [m].
    pub reach: f64,
    /// Mean visible deformation at `A = 1`, by mass.
    pub visible: Mat3<f64>,
    /// `sum m D_p` [kg m^2].
    own: f64,
    lumps: Vec<(Lump, Coefficients<f64>)>,
    /// `G^-1`.
    inverse: Mat3<f64>,
}

/// A way through a frame.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Flight {
    /// At its end.
    pub end: Affine,
    /// Half the edges of the box about the centre of mass that holds it all the time [m].
    pub half: Vec3,
}

/// The motion of particles that take its place.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Loosened {
    /// Velocity gradient of all of them [1/s].
    pub gradient: Mat3<f64>,
    /// Energy that is lost [J]; below zero where more came back than motion could pay for.
    pub lost: f64,
}

/// `m^-1` of an invertible matrix.
fn inverse(m: &Mat3<f64>) -> Mat3<f64> {
    times(1.0 / m.det(), &m.cofactor().transpose())
}

fn times(s: f64, m: &Mat3<f64>) -> Mat3<f64> {
    m.blend(s, m, 0.0)
}

fn full(s: &Sym3<f64>) -> Mat3<f64> {
    Mat3([[s[0], s[1], s[2]], [s[1], s[3], s[4]], [s[2], s[4], s[5]]])
}

/// The vector of the antisymmetric part of `sum m v r^T`: `sum m r x v`.
fn axial(b: &Mat3<f64>) -> Vec3 {
    let b = b.0;
    [b[2][1] - b[1][2], b[0][2] - b[2][0], b[1][0] - b[0][1]]
}

/// The velocity gradient of a spin.
fn turning([x, y, z]: Vec3) -> Mat3<f64> {
    Mat3([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
}

/// `tr(w g w^T) / 2`: kinetic energy at a velocity gradient.
fn kinetic(w: &Mat3<f64>, g: &Mat3<f64>) -> f64 {
    let moved = w.mul(g);
    0.5 * (0..3).map(|a| dot(moved.0[a], w.0[a])).sum::<f64>()
}

/// Angular velocity at which matter of second moments `g` has an angular momentum.
fn spin_of(g: &Mat3<f64>, momentum: Vec3) -> Vec3 {
    let trace = g.0[0][0] + g.0[1][1] + g.0[2][2];
    solve(&Mat3::diagonal([trace; 3]).sub(g), momentum)
}

impl Affine {
    /// `A`.
    pub fn map(&self) -> Mat3<f64> {
        Mat3(self.map)
    }

    /// Velocity gradient `A' A^-1` [1/s].
    pub fn gradient(&self) -> Mat3<f64> {
        Mat3(self.rate).mul(&inverse(&self.map()))
    }
}

impl Bulk {
    /// Of `mass` [kg] with second moments `spread` and `own` [kg m^2], none of it farther than `reach` [m] from the centre
    /// of mass at `A = 1`. None where that is no mass.
    pub fn new(
        mass: f64,
        spread: Mat3<f64>,
        own: f64,
        reach: f64,
        visible: Mat3<f64>,
        lumps: Vec<Lump>,
    ) -> Option<Self> {
        let coefficients = |lump: Lump| {
            let coefficients = Coefficients::new(&lump.material);
            (lump, coefficients)
        };
        let bulk = Self {
            mass,
            spread,
            reach,
            visible,
            own,
            lumps: lumps.into_iter().map(coefficients).collect(),
            inverse: inverse(&spread.blend(1.0, &Mat3::diagonal([own; 3]), 1.0)),
        };
        let sound = mass > 0.0 && bulk.inverse.norm_squared() < f64::INFINITY;
        sound.then_some(bulk)
    }

    /// `G`.
    fn second(&self) -> Mat3<f64> {
        self.spread.blend(1.0, &Mat3::diagonal([self.own; 3]), 1.0)
    }

    /// `sum m x x^T` about the centre of mass [kg m^2].
    pub fn spread_at(&self, map: &Mat3<f64>) -> Mat3<f64> {
        map.mul(&self.spread).mul_transposed(map)
    }

    /// `sum m (x x^T + D_p)`, as particles have it [kg m^2]: their `D_p` stays as it is, that in `G` is stretched.
    fn second_at(&self, map: &Mat3<f64>) -> Mat3<f64> {
        self.spread_at(map)
            .blend(1.0, &Mat3::diagonal([self.own; 3]), 1.0)
    }

    /// Angular velocity of the rigid motion with an angular momentum [rad/s].
    pub fn spin(&self, map: &Mat3<f64>, momentum: Vec3) -> Vec3 {
        spin_of(&self.second_at(map), momentum)
    }

    /// The `A'` at which it has the first moments of momentum `sum m (v r^T + D_p C)` [kg m^2/s] at `A = 1`: of all motions
    /// of this kind the nearest to that of its matter.
    pub fn rate_of(&self, moments: &Mat3<f64>) -> Mat3<f64> {
        moments.mul(&self.inverse)
    }

    /// Angular momentum about the centre of mass [kg m^2/s].
    pub fn angular_momentum(&self, affine: &Affine) -> Vec3 {
        axial(
            &Mat3(affine.rate)
                .mul(&self.second())
                .mul_transposed(&affine.map()),
        )
    }

    /// Kinetic energy of what is not the motion of the centre of mass [J].
    fn inner_energy(&self, affine: &Affine) -> f64 {
        kinetic(&Mat3(affine.rate), &self.second())
    }

    /// Kinetic energy [J].
    pub fn kinetic_energy(&self, affine: &Affine) -> f64 {
        0.5 * self.mass * dot(affine.velocity, affine.velocity) + self.inner_energy(affine)
    }

    /// Elastic energy of the mean deformation [J].
    pub fn elastic_energy(&self, map: &Mat3<f64>) -> f64 {
        let lumps = self.lumps.iter();
        let stored = lumps.map(|(lump, k)| {
            let f = map.mul(&lump.elastic);
            lump.volume * lump.material.law.energy_density(&f, 0.0, k)
        });
        stored.sum()
    }

    /// `sum V tau` [J]; none where some of it is inverted or stretched too far.
    fn stress(&self, map: &Mat3<f64>) -> Option<Mat3<f64>> {
        let mut sum = [0.0; 6];
        for (lump, k) in &self.lumps {
            let f = map.mul(&lump.elastic);
            // Written so that NaN is none.
            let followed = (VOLUMES[0]..=VOLUMES[1]).contains(&f.det())
                && f.norm_squared() <= MAX_NORM_SQUARED;
            if !followed {
                return None;
            }
            let trial = Trial {
                f,
                memory: 0.0,
                gradient: Mat3::diagonal([0.0; 3]),
                dt: 0.0,
            };
            let tau = lump.material.law.respond(&trial, k).tau;
            for (sum, tau) in sum.iter_mut().zip(tau) {
                *sum += lump.volume * tau;
            }
        }
        Some(full(&sum))
    }

    /// `A''` [1/s^2].
    pub fn pull(&self, map: &Mat3<f64>) -> Option<Mat3<f64>> {
        let stress = self.stress(map)?;
        let back = times(-1.0 / map.det(), &map.cofactor());
        Some(stress.mul(&back).mul(&self.inverse))
    }

    /// Steps for `length` [s]: a power of two, so that they seldom change.
    fn steps(&self, affine: &Affine, length: f64) -> Option<u32> {
        let map = affine.map();
        let stiffness = self.lumps.iter().map(|(lump, _)| {
            let f = map.mul(&lump.elastic);
            let j = f.det();
            let bounds = DeformationBounds {
                max_stretch: max_stretch_squared(&f).max(0.0).sqrt(),
                min_j: j.min(1.0),
                max_j: j,
                max_stiffness: 1.0,
            };
            // The largest tangent, by the step of a particle of unit density in a cell of unit size.
            lump.volume / critical_dt(&lump.material, 1.0, 1.0, &bounds).powi(2)
        });
        let elastic = stiffness.sum::<f64>() * self.inverse.norm_squared().sqrt();
        let fastest = (elastic + affine.gradient().norm_squared()).sqrt();
        let steps = (length * fastest / (2.0 * SHARE)).max(1.0);
        (steps <= MAX_STEPS).then(|| (steps.ceil() as u32).next_power_of_two())
    }

    /// Where it is after `length` [s] in gravity [m/s^2], its velocities damped by `damping` [1/s]; exact for the centre of
    /// mass. None where it would be inverted or stretched too far to be followed.
    pub fn flight(
        &self,
        start: &Affine,
        gravity: Vec3,
        damping: f64,
        length: f64,
    ) -> Option<Flight> {
        let steps = self.steps(start, length)?;
        self.fly(start, gravity, damping, length, steps)
    }

    pub(super) fn fly(
        &self,
        start: &Affine,
        gravity: Vec3,
        damping: f64,
        length: f64,
        steps: u32,
    ) -> Option<Flight> {
        let h = length / f64::from(steps);
        let keep = match damping > 0.0 {
            true => (-0.5 * damping * h).exp(),
            false => 1.0,
        };
        let (mut map, mut rate) = (start.map(), Mat3(start.rate));
        let mut pull = self.pull(&map)?;
        let mut half = self.half(&map);
        for _ in 0..steps {
            rate = rate.blend(keep, &pull, 0.5 * h * keep);
            map = map.blend(1.0, &rate, h);
            pull = self.pull(&map)?;
            rate = rate.blend(keep, &pull, 0.5 * h);
            let here = self.half(&map);
            for a in 0..3 {
                half[a] = half[a].max(here[a]);
            }
        }
        let [kept, way, fall] = fallen(damping, length);
        let end = Affine {
            com: along(along(start.com, way, start.velocity), fall, gravity),
            velocity: along(start.velocity.map(|v| kept * v), way, gravity),
            map: map.0,
            rate: rate.0,
        };
        let finite = |v: &Vec3| v.iter().all(|x| x.is_finite());
        let all = end.rate.iter().chain([&end.com, &end.velocity]);
        all.into_iter().all(finite).then_some(Flight { end, half })
    }

    /// Half the edges of the box about the centre of mass that holds it [m].
    pub fn half(&self, map: &Mat3<f64>) -> Vec3 {
        map.0.map(|row| self.reach * length(row))
    }

    /// The motion of particles that take its place, their velocities `lag` [s] behind: with all of the angular momentum, and
    /// with the energy of its stretching less `gain` [J], what they store more than it did.
    pub fn loosened(&self, affine: &Affine, gain: f64, lag: f64) -> Loosened {
        let map = affine.map();
        let g = self.second_at(&map);
        let momentum = self.angular_momentum(affine);
        let spin = turning(spin_of(&g, momentum));
        let all = affine.gradient();
        let turned = turning(spin_of(&g, axial(&all.mul(&g))));
        let stretching = all.sub(&turned);
        let (turn, stretch) = (kinetic(&spin, &g), kinetic(&stretching, &g));
        let room = self.inner_energy(affine) - gain - turn;
        let share = match stretch > 0.0 {
            true => (room / stretch).clamp(0.0, 1.0),
            false => 0.0,
        };
        let mut gradient = spin.blend(1.0, &stretching, share.sqrt());
        if let Some(stress) = self.stress(&map).filter(|_| lag > 0.0) {
            gradient = gradient.blend(1.0, &stress.mul(&inverse(&g)), lag);
        }
        Loosened {
            gradient,
            lost: room - share * stretch,
        }
    }
}

/// After `t` [s] under a damping of `d` [1/s]: what is left of a velocity, how far one of 1 went, and how far an acceleration
/// of 1 did.
fn fallen(d: f64, t: f64) -> [f64; 3] {
    let x = d * t;
    if x <= 1e-4 {
        // To the order at which the differences below lose as much.
        let way = t * (1.0 - x / 2.0 * (1.0 - x / 3.0));
        return [
            (-x).exp(),
            way,
            0.5 * t * t * (1.0 - x / 3.0 * (1.0 - x / 4.0)),
        ];
    }
    let way = -(-x).exp_m1() / d;
    [(-x).exp(), way, (t - way) / d]
}
