//! Objects as spheres about their centres of mass: equations (2) to (6) of the paper, as printed.
//!
//! Equations (5) and (6) conserve momentum and give the relative speed `-e u_n` only where `v_COM` stands for an
//! object's own velocity before the impact; as the pair's common velocity, which the text suggests, `e = 0` would
//! rebound elastically and `e = 1` would quadruple the energy. So it is read as the former:
//!
//! `v_i += m_j (1 + e) / (m_i + m_j) u_n n`, `v_j -= m_i (1 + e) / (m_i + m_j) u_n n`, `u_n = (v_j - v_i) . n`,
//!
//! with `n` from `i` to `j`. What the printed method lacks is one test, that the two approach (`u_n < 0`): without it
//! the impulse returns every time as long as the spheres overlap, and every second one pulls them together.

use crate::mat3::dot;

/// What is left of the approach speed where a pair has no restitution of its own.
pub(crate) const RESTITUTION: f64 = 0.5;

/// An object, as far as the method knows it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Sphere {
    /// Mass, in any unit; 0 for what does not take part.
    pub mass: f64,
    /// Centre of mass [cells].
    pub center: [f64; 3],
    /// Its velocity [cells/s].
    pub velocity: [f64; 3],
    /// Effective radius [cells].
    pub radius: f64,
}

/// Tests all pairs in the order of their ids and lets those collide that touch and approach; the velocities of the
/// spheres are changed. Returns the number of pairs tested.
pub(crate) fn collide(spheres: &mut [Sphere], restitution: impl Fn(usize, usize) -> f64) -> u64 {
    let mut tested = 0;
    for i in 0..spheres.len() {
        if spheres[i].mass <= 0.0 {
            continue;
        }
        for j in i + 1..spheres.len() {
            let (a, b) = (spheres[i], spheres[j]);
            if b.mass <= 0.0 {
                continue;
            }
            tested += 1;
            let between: [f64; 3] = std::array::from_fn(|k| b.center[k] - a.center[k]);
            let distance = dot(between, between).sqrt();
            // Equation (3). Concentric spheres have no normal.
            if distance > a.radius + b.radius || distance <= 0.0 {
                continue;
            }
            let normal = between.map(|x| x / distance);
            let relative = std::array::from_fn(|k| b.velocity[k] - a.velocity[k]);
            let approach = dot(relative, normal);
            if approach >= 0.0 {
                continue;
            }
            let common = (1.0 + restitution(i, j)) * approach / (a.mass + b.mass);
            for k in 0..3 {
                spheres[i].velocity[k] += b.mass * common * normal[k];
                spheres[j].velocity[k] -= a.mass * common * normal[k];
            }
        }
    }
    tested
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pair() -> [Sphere; 2] {
        let left = Sphere {
            mass: 3.0,
            center: [0.0; 3],
            velocity: [2.0, 1.0, 0.0],
            radius: 1.0,
        };
        let right = Sphere {
            mass: 1.0,
            center: [1.5, 0.0, 0.0],
            velocity: [-1.0, 0.0, 0.5],
            radius: 0.6,
        };
        [left, right]
    }

    fn momentum(spheres: &[Sphere]) -> [f64; 3] {
        let p = |k: usize| spheres.iter().map(|s| s.mass * s.velocity[k]).sum();
        [p(0), p(1), p(2)]
    }

    #[test]
    fn momentum_stays_and_the_approach_speed_returns_times_e() {
        for e in [0.0, 0.3, 1.0] {
            let mut spheres = pair();
            let before = momentum(&spheres);
            assert_eq!(collide(&mut spheres, |_, _| e), 1);
            for (a, b) in momentum(&spheres).iter().zip(before) {
                // Two products and a sum of order 10.
                assert!((a - b).abs() < 1e-14, "{a} {b}");
            }
            let [a, b] = spheres;
            assert!((b.velocity[0] - a.velocity[0] - 3.0 * e).abs() < 1e-14);
            // Nothing but the part along the normal is touched.
            assert_eq!((a.velocity[1], b.velocity[2]), (1.0, 0.5));
        }
    }

    /// Of the paper's equations (2) to (6).
    #[test]
    fn the_pairs_common_velocity_is_the_wrong_reading() {
        // Equation (5) and (6) with the velocity of the pair's centre of mass in place of the object's own.
        let e = 0.0;
        let [a, b] = pair();
        let total = a.mass + b.mass;
        let common = (a.mass * a.velocity[0] + b.mass * b.velocity[0]) / total;
        let u = b.velocity[0] - a.velocity[0];
        let (va, vb) = (
            common + b.mass * (1.0 + e) / total * u,
            common - a.mass * (1.0 + e) / total * u,
        );
        // "Perfectly plastic" rebounds at the full speed.
        assert!((vb - va + u).abs() < 1e-14);
    }

    #[test]
    fn spheres_that_separate_are_let_go() {
        let mut spheres = pair();
        collide(&mut spheres, |_, _| 0.5);
        let after = spheres;
        collide(&mut spheres, |_, _| 0.5);
        assert_eq!(spheres, after);
    }

    #[test]
    fn concentric_and_massless_spheres_are_left_alone() {
        let mut spheres = pair();
        spheres[1].center = spheres[0].center;
        let before = spheres;
        assert_eq!(collide(&mut spheres, |_, _| 1.0), 1);
        assert_eq!(spheres, before);
        spheres[0].mass = 0.0;
        assert_eq!(collide(&mut spheres, |_, _| 1.0), 0);
    }
}
