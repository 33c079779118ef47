//! Colliders and held regions as both solvers see them: placed at a moment, with their velocity conditions.
//!
//! Lengths are in units of the solver (cells, or metres in the reference), times in seconds, all in `f64`.

pub mod approach;
mod attach;
pub mod commanded;
mod constrain;
mod contact;
mod face;
pub mod friction;
mod held;
pub mod mesh;
mod moving;
pub mod primitives;
pub mod rules;
pub mod shape;
mod side;
pub mod springs;
pub mod sweep;
pub mod touch;

pub use approach::GapSample;
pub use attach::{Attached, attached, attached_line};
pub use commanded::{CommandedForce, Loaded};
pub use constrain::VelocityChange;
pub use face::{Face, Nodes, Owner};
pub use moving::turned;
pub use rules::{Members, Pins, Rules};
pub use side::MovedPoint;
pub use sweep::Way;
pub use touch::{ANCHOR, ConditionedParticle, Ghost, ParticleConditions};

use contact::Contact;
use friction::{Frictions, domain_walls};
use held::{FixedRegion, has_faces};
use moving::Motion;
use parry3d_f64::shape::SharedShape;
use primitives::Distance;
use serde::{Deserialize, Serialize};
use shape::Shape;

use crate::{
    mat3::dot,
    rotation::rotate,
    scene::{
        Collider, ColliderMotion, DomainPolicy, PinnedRegion, Pose, Scene, Surface, TimeSpan,
        pose_at,
    },
};

/// Distance from a surface below which a node counts as on it [cells]: covers the round-off of scene
/// coordinates, so that a face meant to run through nodes does.
pub(crate) const ON_FACE: f64 = 1e-6;

/// Thickness below which nodes inside cannot tell the two sides apart [cells]: the stencil's width and one.
/// Thinner colliders act on particles.
const THIN: f64 = 4.0;

/// How far in front of a collider it may act on nodes [cells]: the stencil's reach and a particle's radius.
pub const NODES_REACH: f64 = 2.0;

/// Distance from an open mesh at which bodies touch it [cells].
const BODY_SKIN: f64 = 0.05;

/// A moment of simulated time: what a substep needs to know to place a collider.
#[derive(Clone, Copy, Debug)]
pub struct Substep {
    /// Simulated time at its start [s].
    pub time: f64,
    /// Its size [s]: how long everything moves.
    pub dt: f64,
    /// How long forces act in it [s], see [`kick`](crate::kinematics::kick).
    pub kick: f64,
    /// Start of the frame [s].
    pub frame_start: f64,
    /// Length of the frame [s].
    pub frame_length: f64,
}

impl Substep {
    /// Whether it belongs to a span, by its middle: safe from round-off in its ends.
    pub fn is_in(&self, span: &TimeSpan) -> bool {
        span.contains(self.time + 0.5 * self.dt)
    }

    /// Part of the frame that has passed at a moment.
    fn part(&self, time: f64) -> f64 {
        if self.frame_length > 0.0 {
            (time - self.frame_start) / self.frame_length
        } else {
            1.0
        }
    }
}

/// The way of a collider through one frame, once a command has moved it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Path {
    /// Pose at the start of the frame.
    pub from: Pose,
    /// Pose at its end.
    pub to: Pose,
}

/// What commands made of each collider; plain data, part of the world's state.
pub type Paths = Vec<Option<Path>>;

/// All boundaries of a scene, ready to be placed.
#[derive(Clone, Debug, Default)]
pub struct Boundaries {
    bodies: Vec<Body>,
    regions: Vec<PinnedRegion>,
    /// Whether matter is attached to the faces of a region.
    faced_regions: Vec<bool>,
    frictions: Frictions,
    /// Metres per unit of length.
    unit: f64,
    /// Cell size in units.
    cell: f64,
}

/// A collider without a place.
#[derive(Clone, Debug)]
pub struct Body {
    shape: Shape,
    /// The shape as contact of bodies knows it, where there is any.
    contact_shape: Option<SharedShape>,
    rest: Pose,
    motion: ColliderMotion,
    span: TimeSpan,
    /// Friction is that of [`Placed`].
    contact: Contact,
    /// Friction that the scene states.
    friction: Option<f64>,
    /// Whether it acts on grid nodes.
    on_nodes: bool,
    /// Whether it acts on particles.
    on_particles: bool,
    radius: f64,
    /// See [`Placed::skin`].
    skin: f64,
    /// See [`Placed::is_thin`].
    is_thin: bool,
}

/// A collider during one substep.
#[derive(Clone, Copy, Debug)]
pub struct Placed<'a> {
    /// Place among all bodies.
    pub id: usize,
    /// What never changes of it.
    pub body: &'a Body,
    /// Pose at the start of the substep, in units.
    pub start: Pose,
    /// Pose at its end.
    pub end: Pose,
    /// How it moves in the substep; where that has no length, as it has moved before it.
    ahead: Motion,
    /// How it has moved since what it meets was last looked at; where that is not known, as it moves in the substep.
    past: Motion,
    /// Coulomb coefficient against what it meets.
    friction: f64,
}

/// Everything that acts on grid nodes in one substep.
#[derive(Clone, Debug, Default)]
pub struct NodeConditions<'a> {
    bodies: Vec<Placed<'a>>,
    regions: Vec<FixedRegion>,
    faces: Vec<Face>,
    frictions: Option<&'a Frictions>,
}

impl Boundaries {
    /// The boundaries of a scene in units of `unit` metres.
    pub fn new(scene: &Scene, unit: f64) -> Self {
        let cell = scene.dx / unit;
        let mut bodies: Vec<Body> = scene
            .colliders
            .iter()
            .map(|collider| Body::new(collider, unit, cell))
            .collect();
        if scene.conditions.domain_policy == DomainPolicy::Bounce {
            bodies.extend(domain_walls(&scene.domain).map(|wall| Body {
                on_nodes: true,
                on_particles: true,
                ..Body::new(&wall, unit, cell)
            }));
        }
        Self {
            bodies,
            regions: scene.pinned_regions.clone(),
            faced_regions: scene
                .pinned_regions
                .iter()
                .map(|region| has_faces(region, scene))
                .collect(),
            frictions: Frictions::new(scene),
            unit,
            cell,
        }
    }

    /// Pose of a body [m] at a moment of a frame.
    pub fn pose(&self, id: usize, paths: &Paths, substep: &Substep, time: f64) -> Pose {
        let body = &self.bodies[id];
        match paths.get(id).copied().flatten() {
            Some(path) => path.from.toward(&path.to, substep.part(time)),
            None => pose_at(&body.rest, &body.motion, time),
        }
    }

    /// Whether a body is in one place, always.
    fn is_fixed(&self, id: usize, paths: &Paths) -> bool {
        let body = &self.bodies[id];
        let path = paths.get(id).copied().flatten();
        body.motion == ColliderMotion::Static && body.span == TimeSpan::ALWAYS && path.is_none()
    }

    /// Places a body at a substep that begins `moved` [s] after what it meets was last looked at.
    fn place(&self, id: usize, paths: &Paths, substep: &Substep, moved: f64) -> Option<Placed<'_>> {
        let body = &self.bodies[id];
        if !substep.is_in(&body.span) {
            return None;
        }
        let at = |time: f64| self.pose(id, paths, substep, time).in_units(self.unit);
        let start = at(substep.time);
        let mut placed = Placed {
            id,
            body,
            start,
            end: start,
            ahead: Motion::NONE,
            past: Motion::NONE,
            friction: self.shared_friction(body.friction),
        };
        if !self.is_fixed(id, paths) {
            if substep.dt > 0.0 {
                placed.end = at(substep.time + substep.dt);
                placed.ahead = Motion::between(&start, &placed.end, substep.dt);
            }
            placed.past = placed.ahead;
            if moved > 0.0 {
                placed.past = Motion::before(&at(substep.time - moved), &start, moved);
            }
            if substep.dt == 0.0 {
                placed.ahead = placed.past;
            }
        }
        Some(placed)
    }

    fn held(&self, n: usize, substep: &Substep) -> Option<FixedRegion> {
        let region = &self.regions[n];
        if !substep.is_in(&region.span) {
            return None;
        }
        let moved = region.span.elapsed(substep.time);
        let faced = self.faced_regions[n];
        Some(FixedRegion::new(
            region, n, faced, moved, self.cell, self.unit,
        ))
    }

    /// What acts on nodes in a substep, in the order of the scene.
    pub fn on_nodes(&self, paths: &Paths, substep: &Substep) -> NodeConditions<'_> {
        let ids = (0..self.bodies.len()).filter(|&id| self.bodies[id].on_nodes);
        let bodies: Vec<Placed<'_>> = ids
            .filter_map(|id| self.place(id, paths, substep, 0.0))
            .collect();
        let regions: Vec<FixedRegion> = (0..self.regions.len())
            .filter_map(|n| self.held(n, substep))
            .collect();
        let of_bodies = bodies.iter();
        let of_bodies = of_bodies.filter_map(|body| Face::of_body(body, self.cell));
        let of_regions = regions.iter();
        let of_regions = of_regions.flat_map(|held| Face::of_region(held, self.cell));
        NodeConditions {
            faces: of_bodies.chain(of_regions).collect(),
            bodies,
            regions,
            frictions: Some(&self.frictions),
        }
    }

    /// All colliders of a substep, in the order of the scene.
    pub fn all(&self, paths: &Paths, substep: &Substep) -> Vec<Placed<'_>> {
        self.all_since(paths, substep, 0.0)
    }

    /// All colliders of a substep that begins `moved` [s] after what they meet was last looked at, in the order of the scene. Where the
    /// substep has no length they move as they did before it.
    pub fn all_since(&self, paths: &Paths, substep: &Substep, moved: f64) -> Vec<Placed<'_>> {
        let ids = 0..self.bodies.len();
        ids.filter_map(|id| self.place(id, paths, substep, moved))
            .collect()
    }

    /// What acts on particles in a substep, in the order of the scene.
    pub fn on_particles(&self, paths: &Paths, substep: &Substep) -> Vec<Placed<'_>> {
        let ids = (0..self.bodies.len()).filter(|&id| self.bodies[id].on_particles);
        ids.filter_map(|id| self.place(id, paths, substep, 0.0))
            .collect()
    }

    /// What acts on nodes in one place, always.
    pub fn fixed_on_nodes(&self, paths: &Paths) -> NodeConditions<'_> {
        let now = Substep {
            time: 0.0,
            dt: 0.0,
            kick: 0.0,
            frame_start: 0.0,
            frame_length: 0.0,
        };
        let ids = (0..self.bodies.len())
            .filter(|&id| self.bodies[id].on_nodes && self.is_fixed(id, paths));
        let fixed = |&n: &usize| {
            let region = &self.regions[n];
            region.velocity == [0.0; 3] && region.span == TimeSpan::ALWAYS
        };
        NodeConditions {
            bodies: ids
                .filter_map(|id| self.place(id, paths, &now, 0.0))
                .collect(),
            regions: (0..self.regions.len())
                .filter(fixed)
                .filter_map(|n| self.held(n, &now))
                .collect(),
            faces: vec![],
            frictions: Some(&self.frictions),
        }
    }

    /// Whether anything of them is in a box [units], or may come there within a substep.
    pub fn reach(&self, paths: &Paths, substep: &Substep, min: [f64; 3], max: [f64; 3]) -> bool {
        let all = self.all(paths, substep);
        let held = |n: usize| {
            let held = self.held(n, substep);
            held.is_some_and(|held| held.touches(min, max))
        };
        all.iter()
            .any(|placed| placed.comes_near(min, max, substep))
            || (0..self.regions.len()).any(held)
    }

    /// Whether something of them begins, ends, or moves near a box [units] during a substep.
    pub fn disturb(&self, paths: &Paths, substep: &Substep, min: [f64; 3], max: [f64; 3]) -> bool {
        let (first, last) = (substep.time - substep.dt, substep.time + substep.dt);
        let changes = |span: &TimeSpan| {
            *span != TimeSpan::ALWAYS
                && [span.start, span.end]
                    .iter()
                    .any(|t| (first..=last).contains(t))
        };
        let moves =
            |placed: &Placed<'_>| !placed.ahead.is_none() && placed.comes_near(min, max, substep);
        let drifts = |n: usize| {
            self.regions[n].velocity != [0.0; 3]
                && self
                    .held(n, substep)
                    .is_some_and(|held| held.touches(min, max))
        };
        self.bodies.iter().any(|body| changes(&body.span))
            || (0..self.regions.len()).any(|n| changes(&self.regions[n].span) || drifts(n))
            || self.all(paths, substep).iter().any(moves)
    }

    /// What acts on nodes and moves, or comes and goes.
    pub fn moving_on_nodes(&self, paths: &Paths, substep: &Substep) -> NodeConditions<'_> {
        let ids = (0..self.bodies.len())
            .filter(|&id| self.bodies[id].on_nodes && !self.is_fixed(id, paths));
        let moving = |&n: &usize| {
            let region = &self.regions[n];
            region.velocity != [0.0; 3] || region.span != TimeSpan::ALWAYS
        };
        NodeConditions {
            bodies: ids
                .filter_map(|id| self.place(id, paths, substep, 0.0))
                .collect(),
            regions: (0..self.regions.len())
                .filter(moving)
                .filter_map(|n| self.held(n, substep))
                .collect(),
            faces: vec![],
            frictions: Some(&self.frictions),
        }
    }
}

impl Body {
    fn new(collider: &Collider, unit: f64, cell: f64) -> Self {
        let shape = Shape::new(&collider.shape, unit);
        let contact = Contact {
            surface: collider.surface,
            friction: 0.0,
            restitution: collider.restitution,
        };
        let is_thin = shape.thickness() < THIN * cell;
        let on_particles = contact.gives_back() || is_thin;
        Self {
            radius: shape.radius(),
            skin: if shape.thickness() > 0.0 {
                0.0
            } else {
                BODY_SKIN * cell
            },
            contact_shape: shape.for_contact(),
            shape,
            rest: collider.pose,
            motion: collider.motion.clone(),
            span: collider.span,
            contact,
            friction: collider.friction,
            on_nodes: !on_particles,
            on_particles,
            is_thin,
        }
    }
}

impl Placed<'_> {
    /// Signed distance of a world point at the start of the substep [units].
    pub fn distance(&self, x: [f64; 3]) -> Distance {
        if let Shape::HalfSpace { normal } = self.body.shape
            && self.start.rotation == Pose::IDENTITY.rotation
        {
            // Most floors: nothing to turn.
            let off: [f64; 3] = std::array::from_fn(|a| x[a] - self.start.translation[a]);
            // Unfused on purpose: without the instruction each fused operation is a call.
            return Distance {
                value: off[0] * normal[0] + off[1] * normal[1] + off[2] * normal[2],
                normal,
            };
        }
        let local = self.body.shape.distance(self.start.inverse_point(x));
        Distance {
            normal: rotate(self.start.rotation, local.normal),
            ..local
        }
    }

    /// What it is in its own frame [units].
    pub fn shape(&self) -> &Shape {
        &self.body.shape
    }

    /// What it is as contact of bodies knows it [units]; none of a mesh without triangles.
    pub fn contact_shape(&self) -> Option<&SharedShape> {
        self.body.contact_shape.as_ref()
    }

    /// Whether it acts on matter that moves away from it.
    pub fn holds(&self) -> bool {
        self.body.contact.surface != Surface::Separate
    }

    /// Thickness that a wall without any has for bodies and solids [units].
    pub fn skin(&self) -> f64 {
        self.body.skin
    }

    /// Whether it may come into a box during a substep.
    fn comes_near(&self, min: [f64; 3], max: [f64; 3], substep: &Substep) -> bool {
        let reach = farthest(self.start.translation, min, max);
        self.is_near(min, max, self.speed(0.0, reach) * substep.dt)
    }

    /// Whether a point of a box may be closer than `margin` [units]; may err on the side of yes.
    pub fn is_near(&self, min: [f64; 3], max: [f64; 3], margin: f64) -> bool {
        if let Some(normal) = self.flat_normal() {
            let lowest: [f64; 3] = std::array::from_fn(|a| {
                let corner = if normal[a] > 0.0 { min[a] } else { max[a] };
                corner - self.start.translation[a]
            });
            return dot(lowest, normal) < margin;
        }
        // The nearest point of the box to the collider's origin, against the ball that holds it.
        let off: [f64; 3] = std::array::from_fn(|a| {
            let x = self.start.translation[a];
            x.clamp(min[a], max[a]) - x
        });
        let reach = self.body.radius + margin;
        if dot(off, off) > reach * reach {
            return false;
        }
        let center = std::array::from_fn(|a| 0.5 * (min[a] + max[a]));
        let half: [f64; 3] = std::array::from_fn(|a| 0.5 * (max[a] - min[a]));
        self.distance(center).value < dot(half, half).sqrt() + margin
    }
}

impl NodeConditions<'_> {
    /// Whether some node of a box of nodes may be constrained.
    pub fn cover(&self, first: [f64; 3], last: [f64; 3]) -> bool {
        self.regions.iter().any(|held| held.touches(first, last))
            || self
                .bodies
                .iter()
                .any(|body| body.is_near(first, last, NODES_REACH))
    }

    /// Colliders, in the order of the scene.
    pub fn bodies(&self) -> &[Placed<'_>] {
        &self.bodies
    }

    /// Whether held regions are among them.
    pub fn has_regions(&self) -> bool {
        !self.regions.is_empty()
    }

    /// Those that may act on a box of nodes.
    pub fn near(&self, first: [f64; 3], last: [f64; 3]) -> Self {
        let near = |body: &&Placed<'_>| body.is_near(first, last, NODES_REACH);
        Self {
            bodies: self.bodies.iter().filter(near).copied().collect(),
            regions: self
                .regions
                .iter()
                .filter(|held| held.touches(first, last))
                .copied()
                .collect(),
            faces: vec![],
            frictions: self.frictions,
        }
    }

    /// Flat boundaries that matter may be attached to.
    pub fn faces(&self) -> &[Face] {
        &self.faces
    }

    /// Keeps only some of the colliders.
    pub fn retain_bodies(&mut self, keep: impl FnMut(&Placed<'_>) -> bool) {
        let mut keep = keep;
        self.bodies.retain(|body| keep(body));
    }

    /// Whether nothing acts.
    pub fn is_empty(&self) -> bool {
        self.bodies.is_empty() && self.regions.is_empty()
    }

    /// Largest speed that they may give to nodes of a box [units/s].
    pub fn speed(&self, first: [f64; 3], last: [f64; 3]) -> f64 {
        let bodies = self.bodies.iter().filter_map(|body| {
            let reach = farthest(body.start.translation, first, last);
            let speed = body.speed(NODES_REACH, reach);
            (speed > 0.0 && body.is_near(first, last, NODES_REACH)).then_some(speed)
        });
        let regions = self
            .regions
            .iter()
            .map(|held| dot(held.velocity, held.velocity).sqrt());
        bodies.chain(regions).fold(0.0, f64::max)
    }

    /// Velocity that a node at `x` may have in a substep of `dt` when forces and what it obeys already would give it
    /// another: every other collider in order with its friction, then projections until all are obeyed at once. `nearest` is
    /// per collider; `record` is told what colliders change, not held regions.
    pub fn constrain(
        &self,
        x: [f64; 3],
        nearest: &[GapSample],
        dt: f64,
        cell: f64,
        obeyed: &Attached,
        record: &mut impl FnMut(VelocityChange),
    ) -> [f64; 3] {
        let holds = |held: &&FixedRegion| held.holds(x) && !obeyed.obeys(Owner::Region(held.id));
        if let Some(held) = self.regions.iter().rev().find(holds) {
            return held.velocity;
        }
        let free = |(body, _): &(&Placed<'_>, &GapSample)| !obeyed.obeys(Owner::Body(body.id));
        let acting = self.bodies.iter().zip(nearest).filter(free);
        constrain::constrain(acting, x, obeyed.velocity, dt, cell, record)
    }
}

/// Largest distance from a point to a point of a box.
pub fn farthest(from: [f64; 3], min: [f64; 3], max: [f64; 3]) -> f64 {
    let far = |a: usize| (from[a] - min[a]).abs().max((from[a] - max[a]).abs());
    (far(0).powi(2) + far(1).powi(2) + far(2).powi(2)).sqrt()
}
