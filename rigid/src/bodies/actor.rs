//! A body in a step, and what it moves in.

use super::{
    body::Body,
    shape::Shape,
    vector::{Vec3, add, sub},
};
use crate::{colliders::Placed, interruption::Interruption, mat3::length};

/// What moves a body besides contact.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Drive {
    /// Gravity, and a force and torque as they are at the start of the step; their points of attack stay where they are
    /// during it.
    Free {
        /// Force besides gravity [N].
        force: Vec3,
        /// Torque about the centre of mass [N m].
        torque: Vec3,
    },
    /// Nothing: it keeps velocity and spin, whatever it meets.
    Kinematic {
        /// Of the centre of mass [m/s].
        velocity: Vec3,
        /// Angular velocity [rad/s].
        spin: Vec3,
    },
}

impl Drive {
    /// The same with a force [N] and a torque [N m] more, where they move anything.
    pub fn with(self, more: (Vec3, Vec3)) -> Self {
        match self {
            Self::Free { force, torque } => Self::Free {
                force: add(more.0, force),
                torque: add(more.1, torque),
            },
            held @ Self::Kinematic { .. } => held,
        }
    }
}

/// A body in a step.
#[derive(Clone, Copy, Debug)]
pub struct Actor<'a> {
    /// What never changes of it.
    pub shape: &'a Shape,
    /// Where it is and how it moves.
    pub body: Body,
    /// What moves it.
    pub drive: Drive,
}

impl Actor<'_> {
    /// How deep a place is in it [m], < 0 outside.
    pub fn depth(&self, x: Vec3) -> f64 {
        let beyond = length(sub(x, self.body.com)) - self.shape.radius;
        match beyond < 0.0 {
            true => -self.shape.distance(self.body.inverse_point(x)),
            false => -beyond,
        }
    }
}

/// What bodies move in.
pub struct Setting<'a> {
    /// [m/s^2]
    pub gravity: Vec3,
    /// Cell size [m]: tolerances are parts of it.
    pub dx: f64,
    /// Rate at which velocities decay [1/s].
    pub damping: f64,
    /// Colliders in a part of the step: from when, how long [s].
    pub walls: &'a dyn Fn(f64, f64) -> Vec<Placed<'a>>,
    /// Restitution and friction of a pair of bodies.
    pub surface: &'a (dyn Fn(usize, usize) -> (f64, f64) + Sync),
    /// Friction that the surface of a body states for colliders.
    pub friction: &'a (dyn Fn(usize) -> Option<f64> + Sync),
    /// Whether the step has to end before it is done.
    pub interruption: &'a Interruption<'a>,
}
