//! Velocity conditions at surfaces: sticky, slip, separate, with Coulomb friction and restitution.

use super::Placed;
use crate::{mat3::dot, scene::Surface};

/// Rounds of projection before a node that several colliders squeeze moves with the last of them.
const ROUNDS: usize = 8;

/// What a surface does to matter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Contact {
    pub surface: Surface,
    /// Coulomb coefficient.
    pub friction: f64,
    /// Part of the approach speed that is given back.
    pub restitution: f64,
}

fn tangential(v: [f64; 3], normal: [f64; 3], v_n: f64) -> [f64; 3] {
    std::array::from_fn(|a| v[a] - v_n * normal[a])
}

impl Contact {
    /// Whether the normal velocity `v_n` needs no change, up to `slack`.
    fn allows(&self, v_n: f64, slack: f64) -> bool {
        match self.surface {
            Surface::Sticky => false,
            Surface::Slip => v_n.abs() <= slack,
            Surface::Separate => v_n >= -slack,
        }
    }

    /// Whether it has restitution.
    pub fn gives_back(&self) -> bool {
        self.restitution > 0.0 && self.surface != Surface::Sticky
    }

    /// Relative velocity after contact. Coulomb: what presses changes the normal velocity by `(1 + e) |v_n|`,
    /// and `mu_f` times that goes off the tangential speed, which is never turned round. Pull-off costs nothing.
    pub fn resolve(&self, v: [f64; 3], normal: [f64; 3]) -> [f64; 3] {
        if self.surface == Surface::Sticky {
            return [0.0; 3];
        }
        let v_n = dot(v, normal);
        if self.allows(v_n, 0.0) {
            return v;
        }
        let v_t = tangential(v, normal, v_n);
        if v_n > 0.0 {
            return v_t;
        }
        let speed = dot(v_t, v_t).sqrt();
        let pressed = (1.0 + self.restitution) * v_n.abs();
        let kept = if speed > 0.0 {
            (1.0 - self.friction * pressed / speed).max(0.0)
        } else {
            0.0
        };
        if self.restitution == 0.0 {
            return v_t.map(|v| kept * v);
        }
        std::array::from_fn(|a| kept * v_t[a] - self.restitution * v_n * normal[a])
    }
}

fn minus(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|i| a[i] - b[i])
}

fn plus(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|i| a[i] + b[i])
}

/// Velocity that a node at `x` inside some of the bodies may have; nodes within `on_face` of a surface are free.
pub(crate) fn constrain(
    bodies: &[Placed<'_>],
    x: [f64; 3],
    mut v: [f64; 3],
    on_face: f64,
) -> [f64; 3] {
    let mut touched = 0;
    for body in bodies {
        let found = body.distance(x);
        if found.value >= -on_face {
            continue;
        }
        let u = body.velocity(x);
        let contact = &body.body.contact;
        if contact.surface == Surface::Sticky {
            return u;
        }
        v = plus(u, contact.resolve(minus(v, u), found.normal));
        touched += 1;
    }
    if touched < 2 {
        return v;
    }
    let slack = 1e-6 * dot(v, v).sqrt();
    let mut last = v;
    for _ in 0..ROUNDS {
        let mut obeyed = true;
        for body in bodies {
            let found = body.distance(x);
            if found.value >= -on_face {
                continue;
            }
            let u = body.velocity(x);
            let relative = minus(v, u);
            let v_n = dot(relative, found.normal);
            if !body.body.contact.allows(v_n, slack) {
                v = plus(u, tangential(relative, found.normal, v_n));
                obeyed = false;
            }
            last = u;
        }
        if obeyed {
            return v;
        }
    }
    last
}

#[cfg(test)]
mod tests {
    use super::*;

    fn contact(surface: Surface, friction: f64, restitution: f64) -> Contact {
        Contact {
            surface,
            friction,
            restitution,
        }
    }

    fn near(a: [f64; 3], b: [f64; 3]) -> bool {
        (0..3).all(|i| (a[i] - b[i]).abs() < 1e-14)
    }

    const UP: [f64; 3] = [0.0, 0.0, 1.0];

    #[test]
    fn friction_takes_its_share_and_never_reverses() {
        let floor = contact(Surface::Separate, 0.5, 0.0);
        // The tangential speed 5 loses 0.5 x 2.
        assert!(near(floor.resolve([3.0, 4.0, -2.0], UP), [2.4, 3.2, 0.0]));
        assert_eq!(floor.resolve([0.3, 0.4, -2.0], UP), [0.0; 3]);
        assert_eq!(floor.resolve([3.0, 4.0, 2.0], UP), [3.0, 4.0, 2.0]);
    }

    #[test]
    fn slip_charges_friction_only_while_pressed_on() {
        let slip = contact(Surface::Slip, 0.5, 0.0);
        assert!(near(slip.resolve([3.0, 4.0, -2.0], UP), [2.4, 3.2, 0.0]));
        assert!(near(slip.resolve([3.0, 4.0, 2.0], UP), [3.0, 4.0, 0.0]));
    }

    #[test]
    fn restitution_gives_back_its_part_and_friction_is_charged_for_both_halves() {
        let bouncy = contact(Surface::Separate, 0.5, 0.25);
        // 0.5 x (1 + 0.25) x 2 = 1.25 off the tangential speed 5.
        let after = bouncy.resolve([3.0, 4.0, -2.0], UP);
        assert!(near(after, [2.25, 3.0, 0.5]), "{after:?}");
        let sticky = contact(Surface::Sticky, 0.0, 0.5);
        assert_eq!(sticky.resolve([1.0, 2.0, -3.0], UP), [0.0; 3]);
    }
}
