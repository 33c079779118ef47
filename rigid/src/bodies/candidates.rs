//! Bodies and colliders where they are, and which of them are near each other.

use rapier3d_f64::parry::{
    bounding_volume::{Aabb, BoundingVolume},
    math::{Pose, Rotation, Vector},
    shape::SharedShape,
};

use super::{
    actor::{Actor, Drive, Setting},
    body::Body,
    sampled::distance,
    vector::{Vec3, along, length, scaled, sub},
};
use crate::{colliders::Placed, mat3::cross, scene};

/// A shape in its place.
#[derive(Clone)]
pub(super) struct Solid {
    pub shape: SharedShape,
    pub pose: Pose,
    /// Distance from its surface at which it is met [m].
    pub skin: f64,
    /// Whether impulses move it.
    pub is_free: bool,
}

impl Solid {
    pub fn of_actor(actor: &Actor<'_>, body: &Body) -> Self {
        let (shape, offset) = &actor.shape.contact;
        Self {
            shape: shape.clone(),
            pose: pose_of(body) * *offset,
            skin: 0.0,
            is_free: is_free(actor),
        }
    }

    /// A collider at a pose; none where it has no surface.
    pub fn of_wall(wall: &Placed<'_>, pose: &scene::Pose) -> Option<Self> {
        Some(Self {
            shape: wall.contact_shape()?.clone(),
            pose: pose_at(pose.translation, pose.rotation),
            skin: wall.skin(),
            is_free: false,
        })
    }

    /// Signed distance of a world point from where it is met [m].
    pub fn distance(&self, x: Vec3) -> f64 {
        let local = self.pose.inverse_transform_point(x.into());
        distance(&*self.shape, local.into()).value - self.skin
    }

    /// Outward normal there.
    pub fn normal(&self, x: Vec3) -> Vec3 {
        let local = self.pose.inverse_transform_point(x.into());
        let normal = distance(&*self.shape, local.into()).normal;
        (self.pose.rotation * Vector::from(normal)).into()
    }

    /// Box about it and all that is nearer than `margin` [m].
    fn bounds(&self, margin: f64) -> Aabb {
        let around = self.shape.compute_aabb(&self.pose);
        around.loosened(margin + self.skin)
    }
}

/// Whether impulses move it.
pub(super) fn is_free(actor: &Actor<'_>) -> bool {
    matches!(actor.drive, Drive::Free { .. })
}

pub(super) fn pose_of(body: &Body) -> Pose {
    pose_at(body.com, body.rotation)
}

fn pose_at(translation: Vec3, [x, y, z, w]: [f64; 4]) -> Pose {
    Pose::from_parts(translation.into(), Rotation::from_xyzw(x, y, z, w))
}

/// Bodies and colliders at a moment, and what comes near to what in a span that begins with it.
pub(super) struct Moment<'a> {
    /// Colliders that have a surface.
    pub walls: Vec<Placed<'a>>,
    /// Bodies, then colliders.
    pub solids: Vec<Solid>,
    /// How many are bodies.
    pub bodies: usize,
    /// Pairs of which one at least is free, in their order.
    pub pairs: Vec<[u32; 2]>,
    /// By the number of each solid, what it is near to.
    pub neighbours: Vec<Vec<u32>>,
}

impl<'a> Moment<'a> {
    /// Pairs are those that may come as near as `margin` [m] within `length` [s].
    pub fn new(
        actors: &[Actor<'_>],
        walls: Vec<Placed<'a>>,
        setting: &Setting<'_>,
        length: f64,
        margin: f64,
    ) -> Self {
        let mut moment = Self {
            solids: actors
                .iter()
                .map(|actor| Solid::of_actor(actor, &actor.body))
                .collect(),
            bodies: actors.len(),
            walls: vec![],
            pairs: vec![],
            neighbours: vec![],
        };
        let mut margins: Vec<f64> = actors
            .iter()
            .map(|actor| 0.5 * margin + way(actor, setting, length))
            .collect();
        for wall in walls {
            if let Some(solid) = Solid::of_wall(&wall, &wall.start) {
                moment.solids.push(solid);
                // Where bodies are it goes as fast as its own size says, if it has one.
                let size = wall
                    .contact_shape()
                    .map(|shape| shape.compute_local_bounding_sphere());
                let reach = size.map_or(0.0, |ball| ball.radius + ball.center.length());
                let speed = if wall.moves() {
                    wall.speed(margin, reach)
                } else {
                    0.0
                };
                margins.push(0.5 * margin + speed * length);
                moment.walls.push(wall);
            }
        }
        moment.pairs = near_pairs(&moment.solids, moment.bodies, &margins);
        moment.neighbours = neighbours(&moment.pairs, moment.solids.len());
        moment
    }

    /// A solid `t` [s] later, a body where it flies.
    pub fn later(&self, actors: &[Actor<'_>], setting: &Setting<'_>, n: usize, t: f64) -> Solid {
        let solid = &self.solids[n];
        match actors.get(n) {
            Some(actor) => Solid {
                pose: pose_of(&flown(actor, setting, t)) * actor.shape.contact.1,
                ..solid.clone()
            },
            None => {
                let pose = self.walls[n - self.bodies].later(t).start;
                Solid {
                    pose: pose_at(pose.translation, pose.rotation),
                    ..solid.clone()
                }
            }
        }
    }
}

/// A body after `t` [s] of flight.
pub(super) fn flown(actor: &Actor<'_>, setting: &Setting<'_>, t: f64) -> Body {
    let inertia = &actor.shape.inertia;
    match actor.drive {
        Drive::Free { force, .. } => {
            let acceleration = along(setting.gravity, 1.0 / inertia.mass, force);
            let torque = mean_torque(actor, setting, t);
            actor.body.after(inertia, acceleration, torque, t)
        }
        Drive::Kinematic { .. } => actor.body.after(inertia, [0.0; 3], [0.0; 3], t),
    }
}

/// Mean torque of what acts on a free body during `t` [s] of flight [N m]: its points of attack stay where they are.
pub(super) fn mean_torque(actor: &Actor<'_>, setting: &Setting<'_>, t: f64) -> Vec3 {
    let Drive::Free { force, torque } = actor.drive else {
        return [0.0; 3];
    };
    let acceleration = along(setting.gravity, 1.0 / actor.shape.inertia.mass, force);
    let way = along(
        scaled(actor.body.velocity, 0.5 * t),
        t * t / 6.0,
        acceleration,
    );
    sub(torque, cross(way, force))
}

/// Bound of the way of a body's surface within `t` [s] of flight [m].
fn way(actor: &Actor<'_>, setting: &Setting<'_>, t: f64) -> f64 {
    let gained = match actor.drive {
        Drive::Free { force, .. } => {
            t * (length(setting.gravity) + length(force) / actor.shape.inertia.mass)
        }
        Drive::Kinematic { .. } => 0.0,
    };
    let spin = length(actor.body.spin(&actor.shape.inertia));
    1.1 * t * (length(actor.body.velocity) + gained + spin * actor.shape.radius)
}

/// Pairs, by numbers in their order, of which one at least is free and whose boxes meet; `margins` [m] is what each is loosened by.
/// The first so many are bodies; colliders do not meet each other.
pub(super) fn near_pairs(solids: &[Solid], bodies: usize, margins: &[f64]) -> Vec<[u32; 2]> {
    let bounds: Vec<Aabb> = solids
        .iter()
        .zip(margins)
        .map(|(solid, margin)| solid.bounds(*margin))
        .collect();
    let mut order: Vec<usize> = (0..bodies).collect();
    order.sort_by(|&p, &q| {
        let [p_min, q_min] = [p, q].map(|n| bounds[n].mins.x);
        p_min.total_cmp(&q_min).then(p.cmp(&q))
    });
    let mut found = vec![];
    let mut add = |a: usize, b: usize| {
        if (solids[a].is_free || solids[b].is_free) && bounds[a].intersects(&bounds[b]) {
            found.push([a.min(b) as u32, a.max(b) as u32]);
        }
    };
    for (at, &a) in order.iter().enumerate() {
        for &b in &order[at + 1..] {
            if bounds[b].mins.x > bounds[a].maxs.x {
                break;
            }
            add(a, b);
        }
        for b in bodies..solids.len() {
            add(a, b);
        }
    }
    found.sort_unstable();
    found
}

/// By the number of each, what it is near to.
fn neighbours(pairs: &[[u32; 2]], count: usize) -> Vec<Vec<u32>> {
    let mut all = vec![vec![]; count];
    for [a, b] in pairs {
        all[*a as usize].push(*b);
        all[*b as usize].push(*a);
    }
    all
}
