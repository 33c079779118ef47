//! The impulse between two points that touch: no approach beyond what is allowed, Coulomb friction.

use crate::mat3::{Mat3, dot};

/// What the inverse masses of both sides make of an impulse: the change of relative velocity per impulse.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Compliance {
    /// Of two point masses: `1/m_a + 1/m_b`.
    Points(f64),
    /// Of bodies, or of a body and a point mass: symmetric and positive definite.
    #[cfg_attr(
        not(test),
        expect(dead_code, reason = "bodies of finite mass meet nodes by it")
    )]
    Bodies(Mat3<f64>),
}

/// Impulse that side `b` receives and side `a` loses, or none when they do not approach.
///
/// `u` is the velocity of `a` relative to `b`, `normal` points from `a` to `b`, approach up to `allowed` (>= 0) is
/// left. Of all impulses in the friction cone it is the one on the line from the frictionless to the sticking
/// answer that is closest to sticking (Chatterjee and Ruina 1998 without restitution): it never adds energy.
pub(crate) fn contact_impulse(
    u: [f64; 3],
    normal: [f64; 3],
    compliance: &Compliance,
    friction: f64,
    allowed: f64,
) -> Option<[f64; 3]> {
    let approach = dot(u, normal);
    let excess = approach - allowed;
    if excess.is_nan() || excess <= 0.0 {
        return None;
    }
    let tangential: [f64; 3] = std::array::from_fn(|a| u[a] - approach * normal[a]);
    match compliance {
        Compliance::Points(k) => {
            let pressed = excess / k;
            let speed = dot(tangential, tangential).sqrt();
            let share = if speed * pressed * friction > 0.0 {
                (friction * pressed / speed).min(1.0 / k)
            } else {
                0.0
            };
            Some(std::array::from_fn(|a| {
                pressed * normal[a] + share * tangential[a]
            }))
        }
        Compliance::Bodies(k) => {
            let pressed = excess / dot(normal, k.mul_vec(normal));
            let slides = normal.map(|n| pressed * n);
            let change = std::array::from_fn(|a| excess * normal[a] + tangential[a]);
            let (det, cofactor) = (k.det(), k.cofactor());
            // The inverse of a symmetric matrix is its cofactor matrix over its determinant.
            let sticks = cofactor.mul_vec(change).map(|j| j / det);
            let way: [f64; 3] = std::array::from_fn(|a| sticks[a] - slides[a]);
            let way_n = dot(way, normal);
            let way_t: [f64; 3] = std::array::from_fn(|a| way[a] - way_n * normal[a]);
            // |t way_t| <= friction (pressed + t way_n)
            let slope = dot(way_t, way_t).sqrt() - friction * way_n;
            let share = if slope > friction * pressed {
                friction * pressed / slope
            } else {
                1.0
            };
            Some(std::array::from_fn(|a| slides[a] + share * way[a]))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const UP: [f64; 3] = [0.0, 0.0, 1.0];

    fn near(a: [f64; 3], b: [f64; 3], tolerance: f64) -> bool {
        (0..3).all(|i| (a[i] - b[i]).abs() < tolerance)
    }

    #[test]
    fn points_that_separate_or_approach_slowly_enough_feel_nothing() {
        let k = Compliance::Points(2.0);
        assert_eq!(
            contact_impulse([1.0, 0.0, -0.1], UP, &k, 1.0, 0.0),
            None,
            "separating"
        );
        assert_eq!(contact_impulse([1.0, 0.0, 0.5], UP, &k, 1.0, 0.5), None);
        assert_eq!(contact_impulse([f64::NAN; 3], UP, &k, 1.0, 0.5), None);
    }

    #[test]
    fn coulomb_slides_or_sticks() {
        let k = Compliance::Points(2.0);
        let slides = contact_impulse([3.0, 4.0, 2.0], UP, &k, 0.5, 0.0).expect("approach");
        assert!(near(slides, [0.3, 0.4, 1.0], 1e-15), "{slides:?}");
        let sticks = contact_impulse([0.3, 0.4, 2.0], UP, &k, 0.5, 0.0).expect("approach");
        assert!(near(sticks, [0.15, 0.2, 1.0], 1e-15), "{sticks:?}");
        let smooth = contact_impulse([3.0, 4.0, 2.0], UP, &k, 0.0, 0.5).expect("approach");
        assert!(near(smooth, [0.0, 0.0, 0.75], 1e-15), "{smooth:?}");
    }

    #[test]
    fn bodies_without_extent_are_points() {
        let (point, body) = (
            Compliance::Points(2.5),
            Compliance::Bodies(Mat3::diagonal([2.5; 3])),
        );
        for friction in [0.0, 0.2, 5.0] {
            for allowed in [0.0, 0.7] {
                let u = [1.0, -2.0, 1.5];
                let a = contact_impulse(u, UP, &point, friction, allowed).expect("approach");
                let b = contact_impulse(u, UP, &body, friction, allowed).expect("approach");
                assert!(near(a, b, 1e-14), "{a:?} {b:?}");
            }
        }
    }

    #[test]
    fn off_centre_contact_with_friction_never_adds_energy() {
        // A sample of positive definite matrices and approach velocities from a fixed linear congruence.
        let mut seed = 1_u64;
        let mut random = || {
            seed = seed
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            (seed >> 11) as f64 / (1_u64 << 53) as f64 - 0.5
        };
        let mut worst = f64::NEG_INFINITY;
        for _ in 0..1000 {
            let m = Mat3([[random(); 3].map(|_| random()); 3].map(|row| row.map(|_| random())));
            let mut k = m.mul_transposed(&m);
            for a in 0..3 {
                k.0[a][a] += 0.05;
            }
            let u = [random(), random(), random().abs()];
            let friction = 2.0 * random().abs();
            let Some(j) = contact_impulse(u, UP, &Compliance::Bodies(k), friction, 0.0) else {
                continue;
            };
            let gained = -dot(u, j) + 0.5 * dot(j, k.mul_vec(j));
            worst = worst.max(gained);
            assert!(j[2] >= 0.0, "pulls");
            assert!(
                j[0].hypot(j[1]) <= friction * j[2] + 1e-12,
                "leaves the cone"
            );
            let after = u[2] - k.mul_vec(j)[2];
            assert!(after.abs() < 1e-12, "still approaches by {after}");
        }
        assert!(worst <= 1e-14, "energy rose by {worst}");
    }
}
