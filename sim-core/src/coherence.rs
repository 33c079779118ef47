//! The coherence constraint: what holds an object together without stiffening its matter.
//!
//! The paper names it and does not define it. Here it is a projection of the velocities toward the nearest rigid or
//! affine motion. "Nearest" is measured by mass, the affine part `C` of every particle included with its inertia
//! `D_p = dx^2 / 4`, so that the projection is orthogonal in the inner product of the kinetic energy: linear and
//! angular momentum stay what they are, and the kinetic energy can only fall, for any strength from 0 to 1.
//!
//! With `r = x - X` and sums over the particles:
//! `rigid`: `(sum m (r.r 1 - r r^T) + 2 D_p M 1) omega = sum m (r x v + D_p axial C)`;
//! `affine`: `G (sum m r r^T + D_p M 1) = sum m (v r^T + D_p C)`.

use std::ops::AddAssign;

use crate::{mat3::Mat3, scene::CoherentMode};

/// `D_p` of quadratic splines [cells^2].
const D_P: f64 = 0.25;

/// Sums over particles; positions relative to a fixed point [cells], velocities relative to the frame velocity [cells/s].
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Sums {
    mass: f64,
    /// `m r`.
    first: [f64; 3],
    /// `m v`.
    momentum: [f64; 3],
    /// `m r r^T`.
    second: [[f64; 3]; 3],
    /// `m (v r^T + D_p C)`.
    moment: [[f64; 3]; 3],
    /// `m D_p`: nothing of nodes, which have no affine part.
    affine: f64,
}

impl Sums {
    /// Adds a particle.
    #[inline(always)]
    pub fn add(&mut self, mass: f64, r: [f64; 3], v: [f64; 3], c: [[f64; 3]; 3]) {
        self.add_node(mass, r, v);
        self.affine += mass * D_P;
        for a in 0..3 {
            for b in 0..3 {
                self.moment[a][b] += mass * D_P * c[a][b];
            }
        }
    }

    /// Adds a node of a solid.
    #[inline(always)]
    pub fn add_node(&mut self, mass: f64, r: [f64; 3], v: [f64; 3]) {
        self.mass += mass;
        for a in 0..3 {
            self.first[a] += mass * r[a];
            self.momentum[a] += mass * v[a];
            for b in 0..3 {
                self.second[a][b] += mass * r[a] * r[b];
                self.moment[a][b] += mass * v[a] * r[b];
            }
        }
    }
}

impl AddAssign<&Self> for Sums {
    fn add_assign(&mut self, other: &Self) {
        self.mass += other.mass;
        self.affine += other.affine;
        for a in 0..3 {
            self.first[a] += other.first[a];
            self.momentum[a] += other.momentum[a];
            for b in 0..3 {
                self.second[a][b] += other.second[a][b];
                self.moment[a][b] += other.moment[a][b];
            }
        }
    }
}

/// A motion `v = velocity + gradient (r - center)`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Mode {
    /// Centre of mass, relative to the fixed point [cells].
    pub center: [f64; 3],
    /// Its velocity [cells/s].
    pub velocity: [f64; 3],
    /// Velocity gradient [1/s].
    pub gradient: Mat3<f64>,
}

impl Mode {
    /// The motion of this kind that is nearest to that of the particles; none for no mass.
    pub fn nearest(sums: &Sums, kind: CoherentMode) -> Option<Self> {
        let mass = sums.mass;
        if mass <= 0.0 {
            return None;
        }
        let center = sums.first.map(|s| s / mass);
        let velocity = sums.momentum.map(|s| s / mass);
        // About the centre of mass.
        let (mut second, mut moment) = (sums.second, sums.moment);
        for a in 0..3 {
            for b in 0..3 {
                second[a][b] -= mass * center[a] * center[b];
                moment[a][b] -= mass * velocity[a] * center[b];
            }
        }
        let gradient = match kind {
            CoherentMode::Rigid => {
                let angular = [
                    moment[2][1] - moment[1][2],
                    moment[0][2] - moment[2][0],
                    moment[1][0] - moment[0][1],
                ];
                spin(&second, angular, sums.affine)
            }
            CoherentMode::Affine => {
                let mut inertia = Mat3(second);
                for a in 0..3 {
                    inertia.0[a][a] += sums.affine;
                }
                // Symmetric and positive: the cofactor matrix over the determinant is the inverse.
                let inverse = inertia.cofactor();
                let det = inertia.det();
                let g = Mat3(moment).mul(&inverse);
                Mat3(g.0.map(|row| row.map(|x| x / det)))
            }
        };
        Some(Self {
            center,
            velocity,
            gradient,
        })
    }

    /// Velocity [cells/s] at `r`, relative to the fixed point [cells].
    #[inline(always)]
    pub fn at(&self, r: [f64; 3]) -> [f64; 3] {
        let mut v = self.velocity;
        for a in 0..3 {
            for b in 0..3 {
                v[a] += self.gradient.0[a][b] * (r[b] - self.center[b]);
            }
        }
        v
    }
}

/// Gradient of the spin with this angular momentum.
fn spin(second: &[[f64; 3]; 3], angular: [f64; 3], affine: f64) -> Mat3<f64> {
    let trace = second[0][0] + second[1][1] + second[2][2];
    let mut inertia = Mat3(second.map(|row| row.map(|s| -s)));
    for a in 0..3 {
        inertia.0[a][a] += trace + 2.0 * affine;
    }
    let det = inertia.det();
    let [x, y, z] = inertia.cofactor().mul_vec(angular).map(|w| w / det);
    Mat3([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mat3::cross;

    type Particle = (f64, [f64; 3], [f64; 3], [[f64; 3]; 3]);

    fn particles() -> Vec<Particle> {
        // Low-discrepancy numbers: nothing symmetric, nothing rigid.
        let number = |n: usize| (n as f64 * 0.754_877_666).fract() - 0.5;
        (0..40)
            .map(|p| {
                let at = |k: usize| number(17 * p + k);
                let three = |k: usize| [at(k), at(k + 1), at(k + 2)];
                let r = three(1).map(|x| 6.0 * x);
                (1.0 + at(0), r, three(4), [three(7), three(10), three(13)])
            })
            .collect()
    }

    fn sums(particles: &[Particle]) -> Sums {
        let mut sums = Sums::default();
        for (m, r, v, c) in particles {
            sums.add(*m, *r, *v, *c);
        }
        sums
    }

    /// Linear momentum, angular momentum about the fixed point, twice the kinetic energy.
    fn totals(particles: &[Particle]) -> ([f64; 3], [f64; 3], f64) {
        let (mut p, mut l, mut t) = ([0.0; 3], [0.0; 3], 0.0);
        for (m, r, v, c) in particles {
            let orbital = cross(*r, *v);
            let axial = [c[2][1] - c[1][2], c[0][2] - c[2][0], c[1][0] - c[0][1]];
            for a in 0..3 {
                p[a] += m * v[a];
                l[a] += m * (orbital[a] + D_P * axial[a]);
                t += m * v[a] * v[a];
            }
            t += m * D_P * Mat3(*c).norm_squared();
        }
        (p, l, t)
    }

    #[test]
    fn momentum_stays_and_kinetic_energy_falls_for_any_strength() {
        for kind in [CoherentMode::Rigid, CoherentMode::Affine] {
            let before = particles();
            let mode = Mode::nearest(&sums(&before), kind).expect("mass");
            let (p, l, mut least) = totals(&before);
            for part in [0.1, 0.5, 1.0] {
                let after: Vec<Particle> = before
                    .iter()
                    .map(|(m, r, v, c)| {
                        let goal = mode.at(*r);
                        let v = std::array::from_fn(|a| v[a] + part * (goal[a] - v[a]));
                        let c = Mat3(*c).blend(1.0 - part, &mode.gradient, part).0;
                        (*m, *r, v, c)
                    })
                    .collect();
                let (p1, l1, t1) = totals(&after);
                for a in 0..3 {
                    // Forty terms of order ten.
                    assert!((p1[a] - p[a]).abs() < 1e-13, "{p1:?} {p:?}");
                    assert!((l1[a] - l[a]).abs() < 1e-13, "{l1:?} {l:?}");
                }
                assert!(t1 < least, "{t1} {least}");
                least = t1;
            }
        }
    }

    #[test]
    fn its_own_motion_is_left_alone() {
        let g = [[0.1, 2.0, -1.0], [0.5, 0.3, 0.0], [-0.2, 0.7, 1.0]];
        let given = Mode {
            center: [0.0; 3],
            velocity: [1.0, -2.0, 0.5],
            gradient: Mat3(g),
        };
        let moving: Vec<Particle> = particles()
            .into_iter()
            .map(|(m, r, _, _)| (m, r, given.at(r), g))
            .collect();
        let found = Mode::nearest(&sums(&moving), CoherentMode::Affine).expect("mass");
        assert!(found.gradient.sub(&given.gradient).norm_squared().sqrt() < 1e-13);
        let rigid = Mode::nearest(&sums(&moving), CoherentMode::Rigid).expect("mass");
        let (a, b) = (rigid.gradient.0, rigid.gradient.transpose().0);
        assert_eq!(a, b.map(|row| row.map(|x| 0.0 - x)), "a spin");
    }

    #[test]
    fn nothing_has_no_motion_and_one_particle_has_its_own() {
        assert!(Mode::nearest(&Sums::default(), CoherentMode::Affine).is_none());
        let one = &particles()[..1];
        let mode = Mode::nearest(&sums(one), CoherentMode::Affine).expect("mass");
        let (_, r, v, c) = one[0];
        for a in 0..3 {
            assert!((mode.at(r)[a] - v[a]).abs() < 1e-12);
        }
        assert!(mode.gradient.sub(&Mat3(c)).norm_squared() < 1e-20);
    }
}
