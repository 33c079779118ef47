//! A body in a step, and what it moves in.

use std::cell::Cell;

use super::{
    body::Body,
    impact_time::SearchEffort,
    shape::Shape,
    vector::{Vec3, add},
};
use crate::colliders::Placed;

/// Gap up to which bodies touch, and depth that is left alone [cells].
pub(super) const TOUCH: f64 = 1e-3;
pub(super) const SLOP: f64 = 2e-3;

/// What moves a body besides contact.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Drive {
    /// Gravity, and this force [N] and torque about the centre of mass at the start of the step [N m]; its points of
    /// attack stay where they are during the step.
    Free { force: Vec3, torque: Vec3 },
    /// Nothing: it has this velocity [m/s] and spin [rad/s], whatever it meets.
    Kinematic { velocity: Vec3, spin: Vec3 },
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
pub(crate) struct Actor<'a> {
    pub shape: &'a Shape,
    pub body: Body,
    pub drive: Drive,
}

impl Actor<'_> {
    /// Steps that its turn of `dt` [s] under a torque [N m] takes.
    pub fn turn_steps(&self, torque: Vec3, dt: f64) -> f64 {
        self.body.turn_steps(&self.shape.inertia, torque, dt)
    }
}

/// What bodies move in.
pub(crate) struct Setting<'a> {
    /// [m/s^2]
    pub gravity: Vec3,
    /// Cell size [m]: tolerances are parts of it.
    pub dx: f64,
    /// Rate at which velocities decay [1/s].
    pub damping: f64,
    /// Colliders in a part of the step: from when, how long [s].
    pub walls: &'a dyn Fn(f64, f64) -> Vec<Placed<'a>>,
    /// Restitution and friction of a pair of bodies.
    pub surface: &'a dyn Fn(usize, usize) -> (f64, f64),
    /// Friction that the surface of a body states for colliders.
    pub friction: &'a dyn Fn(usize) -> Option<f64>,
    /// What the search for impacts takes, and may take.
    pub effort: &'a Cell<SearchEffort>,
}
