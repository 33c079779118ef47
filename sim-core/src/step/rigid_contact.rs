//! Rigid bodies on colliders: impulses at the particles of the body, so that it neither sinks in nor hovers.
//!
//! On the grid a collider stops only the nodes that it covers, and averaged over a rigid body that is a fraction of
//! what the body needs: it would sink. Here the whole body answers to each contact (sequential impulses, Catto
//! 2005): in turn every particle near a collider gets the impulse that keeps it from moving farther in than its gap,
//! with Coulomb friction; impulses add up over the sweeps and never pull.

use crate::{
    colliders::{Placed, contact::Contact},
    mat3::{Mat3, cross, dot},
    scene::Surface,
};

/// Sweeps over all points of a body.
const SWEEPS: usize = 12;
/// Distance from a surface at which a particle touches it [cells]: half of the usual spacing of particles.
const SKIN: f64 = 0.25;
/// Share of a penetration that is undone per substep.
const PUSH: f64 = 0.1;
/// Distance beyond which no particle can touch within one substep [cells].
pub(crate) const REACH: f64 = SKIN + 1.0;

/// A particle of a rigid body near a collider, in cells.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Point {
    /// Where it is.
    x: [f64; 3],
    /// Out of the collider.
    normal: [f64; 3],
    /// How far it may move in [cells]; negative when it is too deep.
    gap: f64,
    /// Velocity of the collider there [cells/s].
    wall: [f64; 3],
    contact: Contact,
}

/// Linear and angular velocity of a body and how it answers to impulses [cells, s].
#[derive(Clone, Copy, Debug)]
pub(crate) struct Answering {
    /// Mass.
    pub mass: f64,
    /// Inertia about the centre of mass, inverted.
    pub inverse_inertia: Mat3<f64>,
    /// Centre of mass.
    pub com: [f64; 3],
    /// Velocity of the centre of mass.
    pub velocity: [f64; 3],
    /// Angular velocity.
    pub spin: [f64; 3],
}

impl Point {
    /// The contact of a particle at `x` [cells] with a collider, if it is near enough.
    pub fn new(x: [f64; 3], placed: &Placed<'_>) -> Option<Self> {
        let distance = placed.distance(x);
        (distance.value < REACH).then(|| Self {
            x,
            normal: distance.normal,
            gap: distance.value - SKIN,
            wall: placed.velocity(x),
            contact: placed.contact(),
        })
    }
}

impl Answering {
    fn at(&self, x: [f64; 3]) -> ([f64; 3], [f64; 3]) {
        let r = std::array::from_fn(|a| x[a] - self.com[a]);
        let orbit = cross(self.spin, r);
        (r, std::array::from_fn(|a| self.velocity[a] + orbit[a]))
    }

    /// Velocity change at a point along `n` per impulse along `n`.
    fn yielding(&self, r: [f64; 3], n: [f64; 3]) -> f64 {
        let lever = cross(r, n);
        1.0 / self.mass + dot(lever, self.inverse_inertia.mul_vec(lever))
    }

    fn push(&mut self, r: [f64; 3], impulse: [f64; 3]) {
        let turn = self.inverse_inertia.mul_vec(cross(r, impulse));
        for a in 0..3 {
            self.velocity[a] += impulse[a] / self.mass;
            self.spin[a] += turn[a];
        }
    }

    /// Resolves all contacts of a substep of `dt` [s]. Velocities are relative to `carrier` [cells/s]; `falling` is
    /// the speed that gravity adds in the substep: what approaches no faster than a few of those rests and does not
    /// bounce.
    pub fn resolve(&mut self, points: &[Point], carrier: [f64; 3], dt: f64, falling: f64) {
        let approach: Vec<f64> = points
            .iter()
            .map(|point| self.relative(point, carrier).1)
            .collect();
        let mut pressed = vec![0.0; points.len()];
        let mut rubbed = vec![[0.0; 3]; points.len()];
        for _ in 0..SWEEPS {
            for (n, point) in points.iter().enumerate() {
                let Contact {
                    surface,
                    friction,
                    restitution,
                } = point.contact;
                let ([u, r], u_n) = self.relative(point, carrier);
                let bounces = approach[n] < -4.0 * falling && -approach[n] * dt > point.gap;
                let least = if bounces && surface != Surface::Sticky {
                    -restitution * approach[n]
                } else {
                    0.0
                };
                let slack = match point.gap > 0.0 {
                    true => -point.gap / dt,
                    false => (-PUSH * point.gap / dt).min(4.0 * falling),
                };
                let target = if bounces { least.max(slack) } else { slack };
                let change = (target - u_n) / self.yielding(r, point.normal);
                let free = surface == Surface::Separate || point.gap > 0.0;
                let total = match free {
                    true => (pressed[n] + change).max(0.0),
                    false => pressed[n] + change,
                };
                let change = total - pressed[n];
                pressed[n] = total;
                self.push(r, point.normal.map(|c| change * c));
                let limit = match surface {
                    Surface::Sticky if point.gap <= 0.0 => f64::INFINITY,
                    _ => friction * total.max(0.0),
                };
                if limit > 0.0 {
                    let along: [f64; 3] = std::array::from_fn(|a| u[a] - u_n * point.normal[a]);
                    self.rub(r, along, limit, &mut rubbed[n]);
                }
            }
        }
    }

    /// Velocity relative to the collider and lever of a point, and the normal part of the velocity.
    fn relative(&self, point: &Point, carrier: [f64; 3]) -> ([[f64; 3]; 2], f64) {
        let (r, v) = self.at(point.x);
        let u = std::array::from_fn(|a| v[a] + carrier[a] - point.wall[a]);
        ([u, r], dot(u, point.normal))
    }

    /// Friction against the tangential velocity `along`; the sum of a point's friction stays within `limit`.
    fn rub(&mut self, r: [f64; 3], along: [f64; 3], limit: f64, sum: &mut [f64; 3]) {
        let speed = dot(along, along).sqrt();
        if speed <= 0.0 {
            return;
        }
        let direction = along.map(|u| u / speed);
        let change = -speed / self.yielding(r, direction);
        let wanted: [f64; 3] = std::array::from_fn(|a| sum[a] + change * direction[a]);
        let size = dot(wanted, wanted).sqrt();
        let kept = if size > limit { limit / size } else { 1.0 };
        let allowed = wanted.map(|j| kept * j);
        self.push(r, std::array::from_fn(|a| allowed[a] - sum[a]));
        *sum = allowed;
    }
}
