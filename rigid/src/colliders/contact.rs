//! Velocity conditions at surfaces: sticky, slip, separate, with Coulomb friction and restitution.

use crate::{
    mat3::dot,
    scene::{Surface, mean_friction},
};

/// Coulomb coefficient of a collider and an object by what each of them states.
pub(super) fn coefficient(collider: Option<f64>, object: Option<f64>) -> f64 {
    match (collider, object) {
        (Some(a), Some(b)) => mean_friction(a, b),
        (Some(one), None) | (None, Some(one)) => one,
        (None, None) => 0.0,
    }
}

/// What a surface does to matter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Contact {
    pub surface: Surface,
    /// Coulomb coefficient.
    pub friction: f64,
    /// Part of the approach speed that is given back.
    pub restitution: f64,
}

pub(super) fn tangential(v: [f64; 3], normal: [f64; 3], v_n: f64) -> [f64; 3] {
    std::array::from_fn(|a| v[a] - v_n * normal[a])
}

impl Contact {
    /// Whether the normal velocity `v_n` needs no change, up to `slack`, when `max_closing_speed` towards the surface is allowed.
    pub fn allows(&self, v_n: f64, max_closing_speed: f64, slack: f64) -> bool {
        match self.surface {
            Surface::Sticky => false,
            Surface::Slip => v_n <= slack && v_n >= -max_closing_speed - slack,
            Surface::Separate => v_n >= -max_closing_speed - slack,
        }
    }

    /// Whether it has restitution.
    pub fn gives_back(&self) -> bool {
        self.restitution > 0.0 && self.surface != Surface::Sticky
    }

    /// Relative velocity after contact at a node whose matter may still come closer at the speed `max_closing_speed`.
    pub fn resolve_at(&self, v: [f64; 3], normal: [f64; 3], max_closing_speed: f64) -> [f64; 3] {
        let v_n = dot(v, normal);
        if self.surface == Surface::Sticky {
            let kept = v_n.clamp(-max_closing_speed, 0.0);
            return normal.map(|n| kept * n);
        }
        if self.allows(v_n, max_closing_speed, 0.0) {
            return v;
        }
        if v_n > 0.0 {
            return tangential(v, normal, v_n);
        }
        let moved = std::array::from_fn(|a| v[a] + max_closing_speed * normal[a]);
        let after = self.resolve(moved, normal);
        std::array::from_fn(|a| after[a] - max_closing_speed * normal[a])
    }

    /// Relative velocity after contact. Coulomb: what presses changes the normal velocity by `(1 + e) |v_n|`,
    /// and `mu_f` times that goes off the tangential speed, which is never turned round. Pull-off costs nothing.
    pub fn resolve(&self, v: [f64; 3], normal: [f64; 3]) -> [f64; 3] {
        if self.surface == Surface::Sticky {
            return [0.0; 3];
        }
        let v_n = dot(v, normal);
        if self.allows(v_n, 0.0, 0.0) {
            return v;
        }
        let v_t = tangential(v, normal, v_n);
        if v_n > 0.0 {
            return v_t;
        }
        let speed = dot(v_t, v_t).sqrt();
        let normal_change = (1.0 + self.restitution) * v_n.abs();
        let kept = if speed > 0.0 {
            (1.0 - self.friction * normal_change / speed).max(0.0)
        } else {
            0.0
        };
        if self.restitution == 0.0 {
            return v_t.map(|v| kept * v);
        }
        std::array::from_fn(|a| kept * v_t[a] - self.restitution * v_n * normal[a])
    }
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
    fn restitution_gives_back_e_and_friction_counts_both_halves() {
        let bouncy = contact(Surface::Separate, 0.5, 0.25);
        // 0.5 x (1 + 0.25) x 2 = 1.25 off the tangential speed 5.
        let after = bouncy.resolve([3.0, 4.0, -2.0], UP);
        assert!(near(after, [2.25, 3.0, 0.5]), "{after:?}");
        let sticky = contact(Surface::Sticky, 0.0, 0.5);
        assert_eq!(sticky.resolve([1.0, 2.0, -3.0], UP), [0.0; 3]);
    }
}
