//! Where a collider is at a moment.

use crate::{
    rotation::{conjugate, from_rotation_vector, product, rotate, rotation_vector},
    scene::{ColliderMotion, Pose},
};

impl Pose {
    /// World position of a point of the collider's frame.
    pub fn point(&self, x: [f64; 3]) -> [f64; 3] {
        let r = rotate(self.rotation, x);
        std::array::from_fn(|a| r[a] + self.translation[a])
    }

    /// Position in the collider's frame of a world point.
    pub fn inverse_point(&self, x: [f64; 3]) -> [f64; 3] {
        let r = std::array::from_fn(|a| x[a] - self.translation[a]);
        rotate(conjugate(self.rotation), r)
    }

    /// The pose in units of `unit` metres.
    pub fn in_units(&self, unit: f64) -> Self {
        Self {
            translation: self.translation.map(|x| x / unit),
            ..*self
        }
    }

    /// Part `s` of the way to `to`, linear in position and at constant angular velocity.
    pub fn toward(&self, to: &Self, s: f64) -> Self {
        if s <= 0.0 || self == to {
            return *self;
        }
        if s >= 1.0 {
            return *to;
        }
        let turn = rotation_vector(product(to.rotation, conjugate(self.rotation)));
        let turned = from_rotation_vector(turn.map(|r| s * r));
        Self {
            translation: std::array::from_fn(|a| {
                self.translation[a] + s * (to.translation[a] - self.translation[a])
            }),
            rotation: product(turned, self.rotation),
        }
    }
}

/// Pose at the moment `t` [s] of a collider that is at `rest` at time 0 and moves by itself.
pub fn pose_at(rest: &Pose, motion: &ColliderMotion, t: f64) -> Pose {
    match motion {
        ColliderMotion::Static => *rest,
        ColliderMotion::Velocity {
            linear,
            angular,
            span,
        } => {
            let passed = span.elapsed(t);
            let turn = angular.map(|w| w * passed);
            let rotation = if turn == [0.0; 3] {
                rest.rotation
            } else {
                product(from_rotation_vector(turn), rest.rotation)
            };
            Pose {
                translation: std::array::from_fn(|a| rest.translation[a] + passed * linear[a]),
                rotation,
            }
        }
        ColliderMotion::Keyframes(frames) => {
            let next = frames.partition_point(|frame| frame.time <= t);
            match (next.checked_sub(1).map(|i| &frames[i]), frames.get(next)) {
                (Some(a), Some(b)) => a.pose.toward(&b.pose, (t - a.time) / (b.time - a.time)),
                (Some(frame), None) | (None, Some(frame)) => frame.pose,
                (None, None) => *rest,
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::{FRAC_PI_2, PI};

    use super::*;
    use crate::scene::{Keyframe, TimeSpan};

    fn near(a: [f64; 3], b: [f64; 3]) -> bool {
        (0..3).all(|i| (a[i] - b[i]).abs() < 1e-12)
    }

    #[test]
    fn a_rotation_vector_turns_right_handed_and_returns() {
        let q = from_rotation_vector([0.0, 0.0, FRAC_PI_2]);
        assert!(near(rotate(q, [1.0, 0.0, 0.0]), [0.0, 1.0, 0.0]));
        let r = [0.3, -1.2, 2.0];
        assert!(near(rotation_vector(from_rotation_vector(r)), r));
        // Beyond half a turn the shorter way round comes back.
        let long = rotation_vector(from_rotation_vector([0.0, 1.5 * PI, 0.0]));
        assert!(near(long, [0.0, -0.5 * PI, 0.0]));
    }

    #[test]
    fn constant_velocity_and_spin_act_only_in_their_span() {
        let rest = Pose::at([1.0, 0.0, 0.0]);
        let motion = ColliderMotion::Velocity {
            linear: [2.0, 0.0, 0.0],
            angular: [0.0, 0.0, PI],
            span: TimeSpan {
                start: 1.0,
                end: 1.5,
            },
        };
        assert_eq!(pose_at(&rest, &motion, 0.7), rest);
        let end = pose_at(&rest, &motion, 9.0);
        assert_eq!(end.translation, [2.0, 0.0, 0.0]);
        assert!(near(end.point([1.0, 0.0, 0.0]), [2.0, 1.0, 0.0]));
        assert!(near(end.inverse_point([2.0, 1.0, 0.0]), [1.0, 0.0, 0.0]));
    }

    #[test]
    fn keyframes_are_met_and_interpolated() {
        let key = |time, x, angle| Keyframe {
            time,
            pose: Pose {
                translation: [x, 0.0, 0.0],
                rotation: from_rotation_vector([angle, 0.0, 0.0]),
            },
        };
        let motion = ColliderMotion::Keyframes(vec![key(1.0, 0.0, 0.0), key(3.0, 4.0, 1.0)]);
        let at = |t| pose_at(&Pose::IDENTITY, &motion, t);
        assert_eq!(at(0.0).translation, [0.0; 3]);
        assert_eq!(at(5.0), key(3.0, 4.0, 1.0).pose);
        let middle = at(1.5);
        assert!(near(middle.translation, [1.0, 0.0, 0.0]));
        assert!(near(rotation_vector(middle.rotation), [0.25, 0.0, 0.0]));
    }
}
