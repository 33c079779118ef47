//! How colliders move through a substep, and have moved before it.

use super::Placed;
use crate::{
    mat3::{cross, dot},
    rotation::{conjugate, from_rotation_vector, product, rotate, rotation_vector},
    scene::Pose,
};

/// Motion of a collider from one pose to another, by the chords of the ways of its points: what has the velocity of a chord is where the
/// point is in the end, where that of the arc takes it outwards by half of the turn.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Motion {
    /// Velocity of its origin [units/s].
    linear: [f64; 3],
    /// Angular velocity `w` [rad/s].
    angular: [f64; 3],
    /// Factors of `w x r` and of `w x (w x r)` in the velocity along a chord [1, s].
    chord: [f64; 2],
}

impl Motion {
    /// That of what stays where it is.
    pub const NONE: Self = Self {
        linear: [0.0; 3],
        angular: [0.0; 3],
        chord: [1.0, 0.0],
    };

    /// From one pose to another in `dt` [s], for places at its start.
    pub fn between(from: &Pose, to: &Pose, dt: f64) -> Self {
        let linear = std::array::from_fn(|a| (to.translation[a] - from.translation[a]) / dt);
        if to.rotation == from.rotation {
            return Self {
                linear,
                ..Self::NONE
            };
        }
        let turn = rotation_vector(product(to.rotation, conjugate(from.rotation)));
        // (R - 1) / dt of a turn by twice `half`.
        let half = 0.5 * dot(turn, turn).sqrt();
        let sinc = if half > 0.0 { half.sin() / half } else { 1.0 };
        Self {
            linear,
            angular: turn.map(|r| r / dt),
            chord: [sinc * half.cos(), 0.5 * sinc * sinc * dt],
        }
    }

    /// From one pose to another in `dt` [s], for places at its end.
    pub fn before(from: &Pose, to: &Pose, dt: f64) -> Self {
        let Self {
            linear,
            angular,
            chord: [along, inwards],
        } = Self::between(from, to, dt);
        Self {
            linear,
            angular,
            chord: [along, -inwards],
        }
    }

    /// Whether nothing moves.
    pub fn is_none(&self) -> bool {
        self.linear == [0.0; 3] && self.angular == [0.0; 3]
    }

    /// Velocity of a point that is at `r` from the origin [units/s].
    fn velocity(&self, r: [f64; 3]) -> [f64; 3] {
        let across = cross(self.angular, r);
        let inwards = cross(self.angular, across);
        let [along, bend] = self.chord;
        std::array::from_fn(|a| self.linear[a] + (along * across[a] + bend * inwards[a]))
    }
}

impl Placed<'_> {
    fn arm(&self, x: [f64; 3]) -> [f64; 3] {
        std::array::from_fn(|a| x[a] - self.start.translation[a])
    }

    /// Velocity with which the collider's matter at a world point goes straight to where it is at the end of the substep [units/s].
    pub fn velocity(&self, x: [f64; 3]) -> [f64; 3] {
        match self.turns() {
            true => self.ahead.velocity(self.arm(x)),
            false => self.ahead.linear,
        }
    }

    /// Velocity with which the collider's matter at a world point came straight from where it was when what the collider meets was last
    /// looked at [units/s].
    pub fn past_velocity(&self, x: [f64; 3]) -> [f64; 3] {
        match self.past.angular == [0.0; 3] {
            true => self.past.linear,
            false => self.past.velocity(self.arm(x)),
        }
    }

    /// A direction or way that was fixed to it `moved` [s] ago.
    pub fn carried(&self, way: [f64; 3], moved: f64) -> [f64; 3] {
        turned(self.past.angular, moved, way)
    }

    /// Velocity of the collider's matter at a world point, at the start of the substep [units/s].
    pub fn velocity_now(&self, x: [f64; 3]) -> [f64; 3] {
        let turn = cross(self.ahead.angular, self.arm(x));
        std::array::from_fn(|a| self.ahead.linear[a] + turn[a])
    }

    /// Whether it moves in the substep.
    pub fn moves(&self) -> bool {
        !self.ahead.is_none()
    }

    /// Whether it turns in the substep.
    pub fn turns(&self) -> bool {
        self.ahead.angular != [0.0; 3]
    }

    /// Angular velocity in the substep [rad/s].
    pub fn spin(&self) -> [f64; 3] {
        self.ahead.angular
    }

    /// The same collider `t` [s] into its substep.
    pub fn later(&self, t: f64) -> Self {
        if self.ahead.is_none() {
            return *self;
        }
        let Motion {
            linear, angular, ..
        } = self.ahead;
        let turn = from_rotation_vector(angular.map(|w| t * w));
        Self {
            start: Pose {
                translation: std::array::from_fn(|a| self.start.translation[a] + t * linear[a]),
                rotation: product(turn, self.start.rotation),
            },
            ..*self
        }
    }

    /// Largest speed of its matter within `margin` of it, as far as `reach` from its origin [units/s].
    pub fn speed(&self, margin: f64, reach: f64) -> f64 {
        let Motion {
            linear, angular, ..
        } = self.ahead;
        let linear = dot(linear, linear).sqrt();
        let angular = dot(angular, angular).sqrt();
        if angular == 0.0 {
            return linear;
        }
        linear + angular * (self.body.radius + margin).min(reach)
    }
}

/// A way after a turn of `t` [s] with an angular velocity [rad/s].
pub fn turned(angular: [f64; 3], t: f64, way: [f64; 3]) -> [f64; 3] {
    if angular == [0.0; 3] || t == 0.0 {
        return way;
    }
    rotate(from_rotation_vector(angular.map(|w| t * w)), way)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        colliders::{Boundaries, Substep},
        scene::{Collider, ColliderMotion, ColliderShape, Surface, TimeSpan},
        test_scenes::empty,
    };

    /// A disc that turns and moves, from a moment on for `dt` [s], looked at `moved` [s] before.
    fn disc(dt: f64, moved: f64, check: impl Fn(&Placed<'_>, &dyn Fn([f64; 3], f64) -> [f64; 3])) {
        let mut scene = empty(0.1);
        let shape = ColliderShape::Cylinder {
            radius: 2.0,
            half_height: 0.1,
        };
        let pose = Pose {
            translation: [0.3, -0.2, 0.1],
            ..Pose::IDENTITY
        };
        let mut disc = Collider::fixed("disc", shape, pose, Surface::Separate);
        disc.motion = ColliderMotion::Velocity {
            linear: [0.4, 0.1, -0.3],
            angular: [0.5, 6.0, -1.0],
            span: TimeSpan::ALWAYS,
        };
        scene.colliders.push(disc);
        let boundaries = Boundaries::new(&scene, 1.0);
        let paths = vec![None];
        let now = Substep {
            time: 0.7,
            dt,
            kick: dt,
            frame_start: 0.7 - moved,
            frame_length: 1.0,
        };
        let placed = boundaries.all_since(&paths, &now, moved)[0];
        let carry = |x: [f64; 3], t: f64| {
            let to = boundaries.pose(0, &paths, &now, now.time + t);
            to.point(placed.start.inverse_point(x))
        };
        check(&placed, &carry);
    }

    #[test]
    fn what_has_a_colliders_velocity_ends_where_its_matter_does() {
        let x = [1.4, 0.2, -0.9];
        for t in [1e-7, 1e-3, 0.05] {
            disc(t, t, |placed, carry| {
                for (velocity, t) in [(placed.velocity(x), t), (placed.past_velocity(x), -t)] {
                    let end = carry(x, t);
                    for a in 0..3 {
                        let error = x[a] + t * velocity[a] - end[a];
                        assert!(error.abs() < 1e-13, "{t}: {error}");
                    }
                }
            });
        }
    }

    #[test]
    fn at_a_moment_without_length_colliders_move_as_before() {
        let x = [1.4, 0.2, -0.9];
        disc(0.0, 1e-3, |placed, carry| {
            let from = carry(x, -1e-3);
            let velocity = placed.velocity(x);
            assert_eq!(velocity, placed.past_velocity(x));
            for a in 0..3 {
                assert!((1e-3 * velocity[a] - (x[a] - from[a])).abs() < 1e-13);
            }
        });
        disc(0.0, 0.0, |placed, _| {
            assert_eq!(placed.velocity(x), [0.0; 3])
        });
    }
}
