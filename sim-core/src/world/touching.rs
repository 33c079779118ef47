//! The contacts of a frame: impulses of the ledger, and those that deformable objects received from colliders.
//!
//! Colliders act on nodes and particles one by one and keep no accounts of their own. What they gave an object is what
//! remains of the momentum it received; which of them gave it is told by where its surface is.

use super::World;
use crate::{
    colliders::Substep,
    ledger::{Ledger, Received},
    mat3::{dot, length},
    report::{Contact, ContactPartner},
};

/// Gap to a collider below which an object may touch it [cells].
const TOUCHING_GAP: f64 = 0.5;
/// Impulses below this share of an object's momentum and weight are round-off of single precision.
const NOISE: f64 = 1e-5;
/// Sweeps that part an impulse into normal parts.
const SWEEPS: usize = 32;

/// A collider beside an object.
struct Side {
    collider: usize,
    point: [f64; 3],
    normal: [f64; 3],
    pressed: f64,
}

impl World {
    /// Pairs that touched during the latest frame, with the impulses that they exchanged: objects with each other, by
    /// their numbers, then objects with colliders. Objects glued by `single_field` contact and the paper's spheres
    /// exchange none that is known.
    ///
    /// The impulse of a deformable object from colliders is exact in sum: that of its momentum. Where it touches several
    /// at once, each gets the part along its normal, and friction in that proportion. What pins take of its momentum is
    /// counted with them.
    pub fn contacts(&self) -> Vec<Contact> {
        let mut known: Ledger = self.state.in_contact.ledger.clone();
        known.merge(&self.state.bodies.ledger);
        let mut all = known.clone();
        for object in 0..self.model.scene.objects.len() {
            if self.state.bodies.of[object].is_none() && self.report.objects[object].mass > 0.0 {
                self.add_colliders(object, known.received(object), &mut all);
            }
        }
        all.contacts()
    }

    fn add_colliders(&self, object: usize, known: [f64; 3], all: &mut Ledger) {
        let state = &self.report.objects[object];
        let rest: [f64; 3] = std::array::from_fn(|a| state.contact_impulse[a] - known[a]);
        let weight = length(self.state.commanded.gravity) / self.model.scene.frame_rate;
        let noise = NOISE * state.mass * (length(state.linear_velocity) + weight);
        if length(rest) <= noise {
            return;
        }
        let mut sides = self.sides(object);
        part(rest, &mut sides);
        let total: f64 = sides.iter().map(|side| side.pressed).sum();
        let along = |a: usize| sides.iter().map(|s| s.pressed * s.normal[a]).sum::<f64>();
        let across: [f64; 3] = std::array::from_fn(|a| rest[a] - along(a));
        for side in sides.iter().filter(|side| side.pressed > noise) {
            let share = side.pressed / total;
            let impulse =
                std::array::from_fn(|a| side.pressed * side.normal[a] + share * across[a]);
            let received = Received::at(side.point, side.normal, side.pressed, impulse);
            all.add(object, ContactPartner::Collider(side.collider), &received);
        }
    }

    /// The colliders that an object's surface is beside, with the mean place and normal there.
    fn sides(&self, object: usize) -> Vec<Side> {
        let now = Substep {
            time: self.state.progress.sim_time,
            dt: 0.0,
            kick: 0.0,
            frame_start: self.state.progress.sim_time,
            frame_length: 0.0,
        };
        let dx = self.model.scene.dx;
        let particles = self.model.scene.objects[object].particles.clone();
        let mut sides = Vec::new();
        for placed in self.model.solids.all(&self.state.commanded.paths, &now) {
            let (mut weight, mut place, mut normal) = (0.0, [0.0; 3], [0.0; 3]);
            for p in particles
                .clone()
                .filter(|&p| self.published.volume[p] > 0.0)
            {
                let x = self.published.cells[p].map(|x| x * dx);
                let near = placed.distance(x);
                let closeness = (TOUCHING_GAP + self.model.half_spacings[p]) * dx - near.value;
                if closeness <= 0.0 {
                    continue;
                }
                weight += closeness;
                for a in 0..3 {
                    place[a] += closeness * (x[a] - near.value * near.normal[a]);
                    normal[a] += closeness * near.normal[a];
                }
            }
            let size = length(normal);
            if size > 0.0 {
                sides.push(Side {
                    collider: placed.id,
                    point: place.map(|x| x / weight),
                    normal: normal.map(|n| n / size),
                    pressed: 0.0,
                });
            }
        }
        sides
    }
}

/// Finds the parts along the normals, none negative, that together come closest to an impulse (Gauss-Seidel).
fn part(impulse: [f64; 3], sides: &mut [Side]) {
    let mut rest = impulse;
    for _ in 0..SWEEPS {
        for side in sides.iter_mut() {
            let change = dot(rest, side.normal).max(-side.pressed);
            side.pressed += change;
            for a in 0..3 {
                rest[a] -= change * side.normal[a];
            }
        }
    }
}
