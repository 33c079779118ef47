//! What happens to single particles between grid and grid: contact, prescribed motion, impulses.

use std::sync::Arc;

use super::{
    Boundaries, ON_FACE, Paths, Placed, Substep,
    constrain::VelocityChange,
    contact::Contact,
    friction::Frictions,
    rules::{Pins, Pushes, Rules},
    sweep::Way,
};

use crate::mat3::dot;

/// How far a collider may be from a particle and still matter to it [cells]: the stencil's reach along a diagonal, and
/// what it may come closer in one substep.
const REACH: f64 = 3.0;
/// Rounds over all colliders near a particle; one that is still squeezed then stays where the last put it.
const ROUNDS: usize = 3;

/// How much heavier particles with a prescribed velocity are on the grid: nodes that they reach then move as
/// prescribed, whatever hangs on them. Below the inverse of single precision, so that nothing is lost.
pub const ANCHOR: f64 = 1e4;

/// Everything that acts on particles around one transfer.
#[derive(Clone, Debug)]
pub struct ParticleConditions<'a> {
    bodies: Vec<Placed<'a>>,
    frictions: &'a Frictions,
    rules: &'a Rules,
    pins: &'a Pins,
    /// The substep that particles just made.
    now: Substep,
    /// The one they will make next.
    next: Substep,
    holds_now: bool,
    holds_next: bool,
    /// What impulses and body forces give in the next substep, when any acts.
    pushes: Option<Arc<Pushes<'a>>>,
    cell: f64,
    /// Metres per unit.
    unit: f64,
    /// Approach speed below which nothing is given back: that of a fall through one cell [units/s].
    resting_speed: f64,
}

/// A thin wall near a particle: nodes beyond the plane through its nearest point are behind it for this particle,
/// whatever is there, and have no more velocity than its surface allows. After the compatible particle-in-cell method
/// of Hu et al. 2018, with the wall's condition in place of the particle's own velocity.
#[derive(Clone, Copy, Debug)]
pub struct Ghost<'a> {
    wall: Placed<'a>,
    point: [f64; 3],
    normal: [f64; 3],
    on_face: f64,
}

impl Ghost<'_> {
    /// Velocity that a node at `x` has for the particle when it has `v` for others.
    pub fn seen(&self, x: [f64; 3], v: [f64; 3]) -> [f64; 3] {
        let r = std::array::from_fn(|a| x[a] - self.point[a]);
        if dot(r, self.normal) >= -self.on_face {
            return v;
        }
        let u = self.wall.velocity(x);
        let contact = Contact {
            restitution: 0.0,
            ..self.wall.contact()
        };
        let relative = std::array::from_fn(|a| v[a] - u[a]);
        let allowed = contact.resolve(relative, self.normal);
        std::array::from_fn(|a| u[a] + allowed[a])
    }

    /// What the wall made of the velocity of the particle.
    pub fn changed(&self, change: [f64; 3]) -> VelocityChange {
        VelocityChange {
            collider: self.wall.id,
            point: self.point,
            normal: self.normal,
            change,
        }
    }
}

/// A particle after what acted on it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ConditionedParticle {
    /// Its position.
    pub x: [f64; 3],
    /// Its velocity.
    pub v: [f64; 3],
    /// New affine velocity, where motion is prescribed.
    pub affine: Option<[f64; 9]>,
}

impl<'a> ParticleConditions<'a> {
    /// What acts after the substep `now` and before the substep `next`; none when nothing does. `gravity` is in SI
    /// units.
    pub fn new(
        boundaries: &'a Boundaries,
        paths: &Paths,
        rules: &'a Rules,
        pins: &'a Pins,
        now: Substep,
        next: Substep,
        gravity: [f64; 3],
    ) -> Option<Self> {
        let bodies = boundaries.on_particles(paths, &now);
        let holds_now = rules.hold_in(pins, &now);
        let holds_next = rules.hold_in(pins, &next);
        let pushed = rules.push_in(&next);
        let acts = !bodies.is_empty() || holds_now || holds_next || pushed;
        acts.then_some(Self {
            bodies,
            frictions: &boundaries.frictions,
            rules,
            pins,
            now,
            next,
            holds_now,
            holds_next,
            pushes: pushed.then(|| Arc::new(rules.pushes(&next))),
            cell: boundaries.cell,
            unit: boundaries.unit,
            resting_speed: {
                let g = dot(gravity, gravity).sqrt() / boundaries.unit;
                (2.0 * g * boundaries.cell).sqrt()
            },
        })
    }

    /// What acts on the particles of a box and a grid field; `concerned` says whether a rule may. None when nothing does.
    pub fn near(&self, field: u32, min: [f64; 3], max: [f64; 3], concerned: bool) -> Option<Self> {
        let bodies = self.bodies.iter();
        let friction = self.frictions.of_field(field);
        let near = Self {
            bodies: bodies
                .filter(|body| body.is_near(min, max, REACH * self.cell))
                .map(|body| body.against(friction))
                .collect(),
            holds_now: self.holds_now && concerned,
            holds_next: self.holds_next && concerned,
            pushes: self.pushes.clone().filter(|_| concerned),
            ..*self
        };
        (!near.bodies.is_empty() || near.holds_now || near.acts_next()).then_some(near)
    }

    fn acts_next(&self) -> bool {
        self.holds_next || self.pushes.is_some()
    }

    /// Largest speed of colliders near a box, when any is [units/s].
    pub fn collider_speed(&self, min: [f64; 3], max: [f64; 3]) -> Option<f64> {
        let speeds = self.bodies.iter().filter_map(|body| {
            let reach = super::farthest(body.start.translation, min, max);
            let speed = body.speed(self.cell, reach);
            let margin = REACH * self.cell + speed * self.now.dt;
            body.is_near(min, max, margin).then_some(speed)
        });
        speeds.reduce(f64::max)
    }

    /// The walls that part a particle at `x` from some of its nodes; `v` is the velocity that it gathered from all of
    /// them. One that hits a wall with restitution hard is left to [`after`](Self::after).
    pub fn ghosts(&self, x: [f64; 3], v: [f64; 3]) -> Vec<Ghost<'a>> {
        let mut found = Vec::new();
        for wall in self.bodies.iter().filter(|wall| !wall.body.on_nodes) {
            let near = wall.distance(x);
            // As far as the stencil reaches along the normal.
            let reach: f64 = near.normal.iter().map(|n| 1.5 * self.cell * n.abs()).sum();
            if near.value >= reach {
                continue;
            }
            if wall.body.contact.gives_back() {
                let u = wall.velocity(x);
                let approach: f64 = (0..3).map(|a| (u[a] - v[a]) * near.normal[a]).sum();
                if approach > self.resting_speed {
                    continue;
                }
            }
            found.push(Ghost {
                wall: *wall,
                point: std::array::from_fn(|a| x[a] - near.value * near.normal[a]),
                normal: near.normal,
                on_face: ON_FACE * self.cell,
            });
        }
        found
    }

    /// What becomes of a particle that the grid moves along `way`; none when nothing acts on it. `record` is told what
    /// colliders change of its velocity.
    pub fn after(
        &self,
        id: u32,
        mut way: Way,
        record: &mut impl FnMut(VelocityChange),
    ) -> Option<ConditionedParticle> {
        if let Some(pushes) = &self.pushes {
            pushes.settle(id, way.v, self.unit);
        }
        if self.holds_now
            && let Some(field) = self.rules.field(self.pins, &self.now, id)
        {
            let x = field.moved(way.from, self.now.dt);
            return Some(ConditionedParticle {
                x,
                v: field.velocity(x),
                affine: Some(field.gradient()),
            });
        }
        let mut touched = false;
        for _ in 0..ROUNDS {
            let mut again = false;
            for body in &self.bodies {
                let before = way.v;
                again |= body.stop(&mut way, self.now.dt, self.cell);
                if way.v != before {
                    let near = body.distance(way.to);
                    record(VelocityChange {
                        collider: body.id,
                        point: std::array::from_fn(|a| way.to[a] - near.value * near.normal[a]),
                        normal: near.normal,
                        change: std::array::from_fn(|a| way.v[a] - before[a]),
                    });
                }
            }
            touched |= again;
            if !again || self.bodies.len() == 1 {
                break;
            }
        }
        touched.then_some(ConditionedParticle {
            x: way.to,
            v: way.v,
            affine: None,
        })
    }

    /// Velocity and perhaps affine velocity with which a particle at `x` goes into the next transfer. One with an
    /// affine velocity is held: it weighs [`ANCHOR`] times as much on the grid and brings no stress.
    pub fn before(&self, id: u32, x: [f64; 3], v: [f64; 3]) -> Option<ConditionedParticle> {
        if self.holds_next
            && let Some(field) = self.rules.field(self.pins, &self.next, id)
        {
            return Some(ConditionedParticle {
                x,
                v: field.velocity(x),
                affine: Some(field.gradient()),
            });
        }
        let pushes = self.pushes.as_ref()?;
        let (push, pull) = (pushes.on(id), pushes.pull(id, x, v, self.unit));
        let push: [f64; 3] = std::array::from_fn(|a| push[a] + pull[a]);
        (push != [0.0; 3]).then(|| ConditionedParticle {
            x,
            v: std::array::from_fn(|a| v[a] + push[a]),
            affine: None,
        })
    }
}
