//! What the solver is to know of points of contact, and which are none.

use rapier3d_f64::pipeline::{ContactModificationContext, PhysicsHooks};

use super::{
    actor::{Actor, Setting},
    candidates::{Moment, is_free},
    pairs::{SurfaceOfPair, surface_of},
    seams::is_at_seam,
    vector::{Vec3, along, scaled, sub},
};
use crate::mat3::{cross, dot};

/// What bodies are among in a step.
pub(super) struct Surroundings<'a, 'b> {
    pub moment: &'a Moment<'b>,
    pub setting: &'a Setting<'b>,
    /// Pairs that come fast and have not arrived: their impact is no matter of the solver's.
    pub coming: &'a [[u32; 2]],
}

impl Surroundings<'_, '_> {
    pub fn surface(&self, pair: [u32; 2]) -> SurfaceOfPair {
        surface_of(self.moment.bodies, &self.moment.walls, pair, self.setting)
    }
}

/// What the solver is to know of points of contact, and which are none.
pub(super) struct Hooks<'a> {
    moment: &'a Moment<'a>,
    dx: f64,
    /// Pairs with their friction, none where the solver has nothing to do with them.
    pairs: Vec<([u32; 2], Option<f64>)>,
    motions: Vec<Motion>,
    /// Length of the step [s].
    dt: f64,
}

/// How a solid moves.
#[derive(Clone, Copy)]
struct Motion {
    /// Velocity of its origin [m/s].
    linear: Vec3,
    /// Angular velocity [rad/s].
    spin: Vec3,
    /// Infinite of what nothing moves [kg].
    mass: f64,
}

impl Hooks<'_> {
    /// What the velocity of the first of a pair is to be relative to the second where it sticks: that of a chord. The heavier one turns
    /// under the point meanwhile, and the solver knows where that is at the start.
    fn chord(&self, pair: [u32; 2]) -> Vec3 {
        let [a, b] = pair.map(|n| self.motions[n as usize]);
        let way = scaled(sub(a.linear, b.linear), 0.5 * self.dt);
        match a.mass > b.mass {
            true => cross(a.spin, way),
            false => cross(b.spin, way),
        }
    }
}

impl PhysicsHooks for Hooks<'_> {
    fn modify_solver_contacts(&self, context: &mut ContactModificationContext<'_>) {
        let handles = [context.collider1, context.collider2];
        let [first, second] = handles.map(|handle| context.colliders[handle].user_data as u32);
        let pair = [first.min(second), first.max(second)];
        let Some(contact) = context.rigid_mut() else {
            return;
        };
        let known = self.pairs.binary_search_by_key(&pair, |known| known.0);
        // A pair that is not known came by rapier's own margins.
        let friction = known.ok().and_then(|at| self.pairs[at].1);
        let Some(friction) = friction else {
            contact.solver_contacts.clear();
            return;
        };
        (*contact.friction, *contact.restitution) = (friction, 0.0);
        let normal = Vec3::from(match first < second {
            true => -*contact.normal,
            false => *contact.normal,
        });
        let chord = self.chord(pair);
        let across = along(chord, -dot(chord, normal), normal);
        // As if the surface of rapier's first moved as much.
        let moved = scaled(across, if first < second { -1.0 } else { 1.0 });
        for point in contact.solver_contacts.iter_mut() {
            point.tangent_velocity = moved.into();
        }
        contact.solver_contacts.retain(|point| {
            let x = Vec3::from((point.anchor1 + point.anchor2) * 0.5);
            !is_at_seam(self.moment, pair, (x, normal), self.dx)
        });
    }
}

pub(super) fn hooks<'a>(actors: &[Actor<'_>], around: &Surroundings<'a, '_>, dt: f64) -> Hooks<'a> {
    let moment = around.moment;
    let pairs = moment.pairs.iter().map(|pair| {
        let surface = around.surface(*pair);
        (
            *pair,
            (!around.coming.contains(pair)).then_some(surface.friction),
        )
    });
    let bodies = actors.iter().map(|actor| Motion {
        linear: actor.body.velocity,
        spin: actor.body.spin(&actor.shape.inertia),
        mass: match is_free(actor) {
            true => actor.shape.inertia.mass,
            false => f64::INFINITY,
        },
    });
    let walls = moment.walls.iter().map(|wall| Motion {
        linear: wall.velocity_now(wall.start.translation),
        spin: wall.spin(),
        mass: f64::INFINITY,
    });
    Hooks {
        moment,
        dx: around.setting.dx,
        pairs: pairs.collect(),
        motions: bodies.chain(walls).collect(),
        dt,
    }
}
