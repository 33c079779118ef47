//! A rigid body in motion: its state, and how it flies when nothing touches it.

use serde::{Deserialize, Serialize};

use super::vector::{Vec3, add, along, length, scaled};
use crate::{
    mat3::{Mat3, cross, dot},
    rotation::{conjugate, product, rotate},
};

/// Largest turn per step of the rotation [rad].
const MAX_TURN: f64 = 0.2;
/// Steps of a turn from which on it is made in one: a body that turns 16 times over and more has an attitude that nothing
/// resolves.
const MOST_STEPS: f64 = 512.0;
/// Iterations for the turn of one step: it converges by a factor of `MAX_TURN` and better.
const TURNS: usize = 24;

/// Mass and principal moments of inertia about the centre of mass, in the body's own frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Inertia {
    /// Mass [kg], > 0.
    pub mass: f64,
    /// Principal moments [kg m^2], > 0.
    pub moments: Vec3,
}

/// Where a body is and how it moves. Its frame has the centre of mass as origin and the principal axes of inertia
/// as axes.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Body {
    /// Centre of mass [m].
    pub com: Vec3,
    /// World-from-body rotation, unit quaternion xyzw.
    pub rotation: [f64; 4],
    /// Velocity of the centre of mass [m/s].
    pub velocity: Vec3,
    /// Angular momentum about the centre of mass [kg m^2/s], world frame.
    pub angular_momentum: Vec3,
}

impl Body {
    /// Angular velocity [rad/s], world frame.
    pub fn spin(&self, inertia: &Inertia) -> Vec3 {
        let own = rotate(conjugate(self.rotation), self.angular_momentum);
        rotate(self.rotation, over(own, inertia.moments))
    }

    /// Gives it an angular velocity [rad/s].
    pub fn set_spin(&mut self, inertia: &Inertia, spin: Vec3) {
        let own = rotate(conjugate(self.rotation), spin);
        let own = [0, 1, 2].map(|a| own[a] * inertia.moments[a]);
        self.angular_momentum = rotate(self.rotation, own);
    }

    /// Inverse inertia [1/(kg m^2)], world frame.
    pub fn inverse_inertia(&self, inertia: &Inertia) -> Mat3<f64> {
        let r = Mat3::from_quaternion(self.rotation);
        let scaled = r.mul(&Mat3::diagonal(inertia.moments.map(|i| 1.0 / i)));
        scaled.mul_transposed(&r)
    }

    /// Kinetic energy [J].
    pub fn kinetic_energy(&self, inertia: &Inertia) -> f64 {
        let linear = inertia.mass * dot(self.velocity, self.velocity);
        0.5 * (linear + dot(self.angular_momentum, self.spin(inertia)))
    }

    /// World position of a point of its frame.
    pub fn point(&self, x: Vec3) -> Vec3 {
        add(rotate(self.rotation, x), self.com)
    }

    /// Position in its frame of a world point.
    pub fn inverse_point(&self, x: Vec3) -> Vec3 {
        let r = [0, 1, 2].map(|a| x[a] - self.com[a]);
        rotate(conjugate(self.rotation), r)
    }

    /// The body after `dt` [s] under a constant force per mass [m/s^2] and torque [N m]: exact for the centre of
    /// mass. Without torque angular momentum and energy stay to round-off; with it the turn is that of the mean
    /// angular momentum.
    pub fn after(&self, inertia: &Inertia, acceleration: Vec3, torque: Vec3, dt: f64) -> Self {
        let mut next = *self;
        let mean = along(self.velocity, 0.5 * dt, acceleration);
        next.com = along(self.com, dt, mean);
        next.velocity = along(self.velocity, dt, acceleration);
        next.rotation = turned(
            self.rotation,
            along(self.angular_momentum, 0.5 * dt, torque),
            inertia.moments,
            dt,
        );
        next.angular_momentum = along(self.angular_momentum, dt, torque);
        next
    }
}

fn over(a: Vec3, b: Vec3) -> Vec3 {
    [a[0] / b[0], a[1] / b[1], a[2] / b[2]]
}

/// Torque-free rotation for `dt` [s] by the implicit midpoint rule in the body's frame, where angular momentum `P`
/// obeys `P' = P x I^-1 P`: every quadratic invariant of that stays, so energy does, and the Cayley turn that takes
/// `P` along keeps the angular momentum in the world (Simo and Wong 1991). Neither needs a Cayley turn to be as long as
/// the midpoint rule has it, which is late by `(h w)^2 / 12`: it is made to turn by `h w`, so that a steady spin is exact.
fn turned(mut rotation: [f64; 4], momentum: Vec3, moments: Vec3, dt: f64) -> [f64; 4] {
    let steps = steps_of_turn(rotation, momentum, moments, dt);
    if steps == 0.0 {
        return rotation;
    }
    if steps >= MOST_STEPS {
        return about_momentum(rotation, momentum, moments, dt);
    }
    let h = dt / steps;
    for _ in 0..steps as u32 {
        let before = rotate(conjugate(rotation), momentum);
        let mut after = before;
        for _ in 0..TURNS {
            let mean = scaled(add(before, after), 0.5);
            let half = half_turn(over(mean, moments), h);
            // cay(-h w) before
            let next = cayley(half, before);
            let change = [0, 1, 2].map(|a| (next[a] - after[a]).abs());
            after = next;
            let size = before.iter().fold(0.0_f64, |m, x| m.max(x.abs()));
            if change.iter().all(|c| *c <= 1e-16 * size) {
                break;
            }
        }
        let half = half_turn(over(scaled(add(before, after), 0.5), moments), h);
        rotation = product(rotation, [half[0], half[1], half[2], 1.0]);
    }
    rotation
}

/// Rotation for `dt` [s] about the angular momentum, by the spin along it: what a symmetric body's axis does, and what any
/// body does on average. Momentum in the body's frame is the same after it, so energy is.
fn about_momentum(rotation: [f64; 4], momentum: Vec3, moments: Vec3, dt: f64) -> [f64; 4] {
    let size = length(momentum);
    let axis = scaled(momentum, 1.0 / size);
    let own = rotate(conjugate(rotation), axis);
    // The spin is `size` times this.
    let turn = dt * size * dot(own, over(own, moments));
    if !turn.is_finite() {
        return rotation;
    }
    let (sin, cos) = (0.5 * (turn % std::f64::consts::TAU)).sin_cos();
    let [x, y, z] = scaled(axis, sin);
    product([x, y, z, cos], rotation)
}

/// Steps that a turn for `dt` [s] is made in; 0 where there is none.
fn steps_of_turn(rotation: [f64; 4], momentum: Vec3, moments: Vec3, dt: f64) -> f64 {
    let own = rotate(conjugate(rotation), momentum);
    let fastest = over(own, moments)
        .iter()
        .fold(0.0_f64, |m, w| m.max(w.abs()));
    let least = moments.into_iter().fold(f64::INFINITY, f64::min);
    let bound = (dot(momentum, momentum).sqrt() / least)
        .min(1e9)
        .max(fastest);
    if bound <= 0.0 || !bound.is_finite() {
        return 0.0;
    }
    (bound * dt / MAX_TURN).ceil().clamp(1.0, MOST_STEPS)
}

/// Half the step, along the spin, of a Cayley turn by `|spin| h` [rad].
fn half_turn(spin: Vec3, h: f64) -> Vec3 {
    let half = 0.5 * h * length(spin);
    // tan x / x = 1 + x^2 / 3 + ..., at half <= MAX_TURN.
    let stretch = if half > 1e-8 { half.tan() / half } else { 1.0 };
    scaled(spin, 0.5 * h * stretch)
}

/// `x` turned back by the Cayley transform of `2 half`: solves `(1 + [half]x) y = (1 - [half]x) x`.
fn cayley(half: Vec3, x: Vec3) -> Vec3 {
    // y = x - 2 / (1 + |h|^2) (h x x - h x (h x x))
    let first = cross(half, x);
    let second = cross(half, first);
    let factor = 2.0 / (1.0 + dot(half, half));
    [0, 1, 2].map(|a| x[a] - factor * (first[a] - second[a]))
}
