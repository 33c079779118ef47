//! The impulse between two points that touch: no approach is left, and friction is Coulomb's.

use crate::mat3::dot;

/// Impulse that side `b` receives and side `a` loses, or none when they do not approach.
///
/// `u` is the velocity of `a` relative to `b`, `normal` points from `a` to `b`, `k` is the sum of the inverse masses.
/// Friction is Coulomb's: it never adds energy.
pub(crate) fn contact_impulse(
    u: [f64; 3],
    normal: [f64; 3],
    k: f64,
    friction: f64,
) -> Option<[f64; 3]> {
    let approach = dot(u, normal);
    if approach.is_nan() || approach <= 0.0 {
        return None;
    }
    let tangential: [f64; 3] = std::array::from_fn(|a| u[a] - approach * normal[a]);
    let normal_impulse = approach / k;
    let speed = dot(tangential, tangential).sqrt();
    let share = if speed * normal_impulse * friction > 0.0 {
        (friction * normal_impulse / speed).min(1.0 / k)
    } else {
        0.0
    };
    Some(std::array::from_fn(|a| {
        normal_impulse * normal[a] + share * tangential[a]
    }))
}

/// What two points have exchanged so far in a substep.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct AccumulatedImpulse {
    /// Impulse that `b` received and `a` lost.
    pub impulse: [f64; 3],
    /// Its size along the normal, >= 0.
    pub normal_impulse: f64,
}

/// Change of what two points hold that makes [`contact_impulse`] true of all of it, or none where nothing changes.
///
/// Where others act on the same points, an impulse that was right may turn out too large: what is more than needed is
/// given back, as long as they still press. Otherwise it drives them apart, and does work that comes from nowhere.
pub(crate) fn accumulate(
    held: &mut AccumulatedImpulse,
    u: [f64; 3],
    normal: [f64; 3],
    k: f64,
    friction: f64,
) -> Option<[f64; 3]> {
    if held.normal_impulse == 0.0 {
        let impulse = contact_impulse(u, normal, k, friction)?;
        held.impulse = impulse;
        held.normal_impulse = dot(impulse, normal);
        return Some(impulse);
    }
    let approach = dot(u, normal);
    let normal_impulse = (held.normal_impulse + approach / k).max(0.0);
    let before = held.impulse;
    let sticks: [f64; 3] = std::array::from_fn(|a| {
        before[a] - held.normal_impulse * normal[a] + (u[a] - approach * normal[a]) / k
    });
    let size = dot(sticks, sticks).sqrt();
    let share = if size > friction * normal_impulse {
        friction * normal_impulse / size
    } else {
        1.0
    };
    held.normal_impulse = normal_impulse;
    held.impulse = std::array::from_fn(|a| normal_impulse * normal[a] + share * sticks[a]);
    let change: [f64; 3] = std::array::from_fn(|a| held.impulse[a] - before[a]);
    (change != [0.0; 3]).then_some(change)
}

#[cfg(test)]
mod tests {
    use super::*;

    const UP: [f64; 3] = [0.0, 0.0, 1.0];

    fn near(a: [f64; 3], b: [f64; 3], tolerance: f64) -> bool {
        (0..3).all(|i| (a[i] - b[i]).abs() < tolerance)
    }

    #[test]
    fn points_that_separate_feel_nothing() {
        let k = 2.0;
        for u in [[1.0, 0.0, -0.1], [1.0, 0.0, 0.0], [f64::NAN; 3]] {
            assert_eq!(contact_impulse(u, UP, k, 1.0), None, "{u:?}");
        }
    }

    #[test]
    fn coulomb_slides_or_sticks() {
        let k = 2.0;
        let slides = contact_impulse([3.0, 4.0, 2.0], UP, k, 0.5).expect("approach");
        assert!(near(slides, [0.3, 0.4, 1.0], 1e-15), "{slides:?}");
        let sticks = contact_impulse([0.3, 0.4, 2.0], UP, k, 0.5).expect("approach");
        assert!(near(sticks, [0.15, 0.2, 1.0], 1e-15), "{sticks:?}");
        let smooth = contact_impulse([3.0, 4.0, 2.0], UP, k, 0.0).expect("approach");
        assert!(near(smooth, [0.0, 0.0, 1.0], 1e-15), "{smooth:?}");
    }

    #[test]
    fn what_is_held_is_given_back_when_it_is_too_much() {
        let (k, friction) = (2.0, 0.5);
        let mut held = AccumulatedImpulse::default();
        let first = accumulate(&mut held, [3.0, 4.0, 2.0], UP, k, friction).expect("approach");
        assert!(near(first, [0.3, 0.4, 1.0], 1e-15), "{first:?}");
        // Others made them part at 1 m/s: half of it was enough, and friction has to fit that half.
        let back = accumulate(&mut held, [2.4, 3.2, -1.0], UP, k, friction).expect("too much");
        assert!(near(held.impulse, [0.15, 0.2, 0.5], 1e-15), "{held:?}");
        assert!(near(back, [-0.15, -0.2, -0.5], 1e-15), "{back:?}");
        // They part faster than all of it explains: nothing is held, and nothing pulls.
        let rest = accumulate(&mut held, [0.0, 0.0, -9.0], UP, k, friction).expect("too much");
        assert!(near(rest, [-0.15, -0.2, -0.5], 1e-15), "{rest:?}");
        assert_eq!((held.normal_impulse, held.impulse), (0.0, [0.0; 3]));
        assert_eq!(
            accumulate(&mut held, [1.0, 0.0, -0.1], UP, k, friction),
            None
        );
    }

    #[test]
    fn two_pairs_that_share_a_point_agree_in_some_rounds() {
        // A point between two others that close in on it with different masses: what is left of approach, parting with
        // an impulse, and sliding while it is held.
        let mass = [1.0, 0.2, 3.0];
        let mut v = [[0.0, 0.3, 2.0], [0.1, 0.0, 0.0], [0.0, -0.2, -1.0]];
        let mut held = [AccumulatedImpulse::default(); 2];
        for _ in 0..200 {
            for (n, held) in held.iter_mut().enumerate() {
                let u = std::array::from_fn(|a| v[n][a] - v[n + 1][a]);
                let k = 1.0 / mass[n] + 1.0 / mass[n + 1];
                if let Some(change) = accumulate(held, u, UP, k, 0.1) {
                    for a in 0..3 {
                        v[n][a] -= change[a] / mass[n];
                        v[n + 1][a] += change[a] / mass[n + 1];
                    }
                }
            }
        }
        for (n, held) in held.iter().enumerate() {
            let u: [f64; 3] = std::array::from_fn(|a| v[n][a] - v[n + 1][a]);
            assert!(u[2].abs() < 1e-9, "{u:?}");
            assert!(
                dot(held.impulse, u) >= -1e-12,
                "work is done: {held:?} {u:?}"
            );
        }
    }
}
