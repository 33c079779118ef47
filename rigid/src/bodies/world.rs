//! The world as rapier knows it during one step of ours: bodies and colliders go in where they are, and come out where they went.
//!
//! Nothing of it outlives the step: what does is the state of each body, and what points of contact bore.

use std::sync::Arc;

use rapier3d_f64::{
    dynamics::{
        FrictionModel, GenericJointBuilder, JointAxesMask, JointAxis, RigidBodyBuilder,
        RigidBodyHandle, SpringCoefficients,
    },
    geometry::ColliderBuilder,
    parry::{
        math::{Pose, Rotation, Vector},
        shape::SharedShape,
    },
    pipeline::{ActiveHooks, PhysicsWorld},
    prelude::MassProperties,
};

use super::{
    actor::{Actor, Drive, Setting},
    body::Body,
    candidates::{Moment, Solid, flown, is_free, mean_torque, pose_of},
    dispatcher::{Dispatcher, Tagged, borne},
    exchange::{exchanged, note, places_of},
    hooks::{Surroundings, hooks},
    manifolds::manifolds,
    pairs::ExchangedImpulse,
    vector::{Vec3, length, scaled, sub},
    warm_start::CachedImpulse,
};

/// Iterations of the solver in a step, each of which moves bodies by its part of it.
const ITERATIONS: usize = 8;
/// Sweeps per iteration that take back the speed with which what overlaps was moved apart: after one some hundredths are left, after four
/// some millionths.
const SETTLING: usize = 4;
/// Largest speed at which what overlaps is moved apart [m/s].
const RECOVERY: f64 = 1.0;
/// Frequency [Hz] and damping of contact between bodies, and at what nothing moves.
const SOFTNESS: SpringCoefficients<f64> = SpringCoefficients {
    natural_frequency: 1000.0,
    damping_ratio: 5.0,
};
const SOFTNESS_FIXED: SpringCoefficients<f64> = SpringCoefficients {
    natural_frequency: 2000.0,
    damping_ratio: 5.0,
};
/// Gap below which contact is foreseen [m].
const PREDICTION: f64 = 5e-5;
/// Speed from which on a body does not pass through what is free to move either [m/s].
const FAST: f64 = 20.0;
/// Farthest that something is held from where it touches [m].
const HELD_WITHIN: f64 = 1e3;
/// Difference between where rapier takes what flies and where it is [m], beyond which it was stopped.
const STOPPED: f64 = 1e-9;

/// A collider in the world.
struct Wall {
    id: usize,
    moves: bool,
    handle: RigidBodyHandle,
}

/// All of them.
pub(super) struct World {
    world: PhysicsWorld,
    bodies: Vec<RigidBodyHandle>,
    walls: Vec<Wall>,
    /// What the first step begins with.
    warm_start: Vec<CachedImpulse>,
    /// Length of the solver's iterations before [s].
    before: f64,
}

fn array(v: Vector) -> Vec3 {
    v.into()
}

fn tagged(id: u32, shape: &SharedShape, offset: Pose) -> ColliderBuilder {
    let shape = shape.clone();
    ColliderBuilder::new(SharedShape(Arc::new(Tagged { id, shape })))
        .user_data(u128::from(id))
        .position(offset)
        .density(0.0)
}

impl World {
    pub fn new(
        actors: &[Actor<'_>],
        setting: &Setting<'_>,
        warm_start: Vec<CachedImpulse>,
    ) -> Self {
        let mut world = PhysicsWorld::new();
        world.gravity = setting.gravity.into();
        let settings = &mut world.integration_parameters;
        settings.num_solver_iterations = ITERATIONS;
        settings.num_internal_stabilization_iterations = SETTLING;
        settings.normalized_max_corrective_velocity = RECOVERY;
        settings.friction_model = FrictionModel::Simplified;
        settings.contact_recycling = false;
        // Manifolds of one plane are merged where they are made.
        settings.contact_clustering = false;
        settings.contact_softness = SOFTNESS;
        settings.static_contact_softness = SOFTNESS_FIXED;
        settings.normalized_prediction_distance = PREDICTION;
        settings.normalized_max_linear_velocity = f64::MAX;
        let bodies = actors.iter().zip(0..).map(|(actor, id)| {
            let inertia = &actor.shape.inertia;
            let (shape, offset) = &actor.shape.contact;
            let body = match actor.drive {
                Drive::Free { .. } => RigidBodyBuilder::dynamic(),
                Drive::Kinematic { .. } => RigidBodyBuilder::kinematic_position_based(),
            };
            let mass =
                MassProperties::new(Vector::ZERO, inertia.mass, Vector::from(inertia.moments));
            let body = body
                .pose(pose_of(&actor.body))
                .additional_mass_properties(mass)
                .can_sleep(false);
            let collider =
                tagged(id, shape, *offset).active_hooks(ActiveHooks::MODIFY_SOLVER_CONTACTS);
            world.insert(body, collider).0
        });
        let bodies = bodies.collect();
        Self {
            world,
            bodies,
            walls: vec![],
            warm_start,
            before: 1.0,
        }
    }

    /// Puts colliders where they are in a step of `dt` [s]; they come and go.
    fn place_walls(&mut self, moment: &Moment<'_>, dt: f64) {
        let now = moment.walls.iter().map(|wall| (wall.id, wall.moves()));
        if !self.walls.iter().map(|wall| (wall.id, wall.moves)).eq(now) {
            for wall in self.walls.drain(..) {
                self.world.remove_body(wall.handle);
            }
            let solids = moment.solids.iter().zip(0..).skip(moment.bodies);
            for (wall, (solid, place)) in moment.walls.iter().zip(solids) {
                let body = match wall.moves() {
                    true => RigidBodyBuilder::kinematic_position_based(),
                    false => RigidBodyBuilder::fixed(),
                };
                let collider = tagged(place, &solid.shape, Pose::IDENTITY).contact_skin(solid.skin);
                let (handle, _) = self.world.insert(body.pose(solid.pose), collider);
                self.walls.push(Wall {
                    id: wall.id,
                    moves: wall.moves(),
                    handle,
                });
            }
        }
        for (known, (wall, solid)) in self
            .walls
            .iter()
            .zip(moment.walls.iter().zip(&moment.solids[moment.bodies..]))
        {
            if !known.moves {
                continue;
            }
            let body = &mut self.world.bodies[known.handle];
            body.set_position(solid.pose, false);
            if let Some(end) = Solid::of_wall(wall, &wall.later(dt).start) {
                body.set_next_kinematic_position(end.pose);
            }
        }
    }

    fn place_bodies(&mut self, actors: &[Actor<'_>], setting: &Setting<'_>, dt: f64) {
        for (actor, handle) in actors.iter().zip(&self.bodies) {
            let body = &mut self.world.bodies[*handle];
            body.set_position(pose_of(&actor.body), false);
            match actor.drive {
                Drive::Free { force, .. } => {
                    let spin = actor.body.spin(&actor.shape.inertia);
                    body.reset_forces(false);
                    body.reset_torques(false);
                    body.add_force(force.into(), false);
                    body.add_torque(mean_torque(actor, setting, dt).into(), false);
                    body.set_linvel(actor.body.velocity.into(), false);
                    body.set_angvel(spin.into(), false);
                    body.enable_ccd(length(actor.body.velocity) > FAST);
                }
                Drive::Kinematic { .. } => {
                    body.set_next_kinematic_position(pose_of(&flown(actor, setting, dt)));
                }
            }
        }
    }

    /// Holds what touches a collider that does not let go: as a whole where it sticks, else along the normal at each point.
    fn hold(&mut self, around: &Surroundings<'_, '_>) -> Vec<[u32; 2]> {
        let mut held = vec![];
        let joints = self.world.impulse_joints.iter().map(|(handle, _)| handle);
        for joint in joints.collect::<Vec<_>>() {
            self.world.remove_impulse_joint(joint);
        }
        let moment = around.moment;
        for pair in &moment.pairs {
            let surface = around.surface(*pair);
            if !surface.holds {
                continue;
            }
            let [body, wall] = pair.map(|n| &moment.solids[n as usize]);
            let pos12 = body.pose.inv_mul(&wall.pose);
            let reach = PREDICTION + wall.skin;
            let found = manifolds(&pos12, &*body.shape, &*wall.shape, reach);
            let points = found.iter().flat_map(|manifold| {
                let normal = wall.pose.rotation * manifold.local_n2;
                manifold.points.iter().map(move |point| (normal, point))
            });
            let touching: Vec<(Vector, Vector)> = points
                .map(|(normal, point)| (normal, body.pose.transform_point(point.local_p1)))
                .collect();
            if touching.is_empty() {
                continue;
            }
            held.push(*pair);
            let handles = [
                self.walls[pair[1] as usize - moment.bodies].handle,
                self.bodies[pair[0] as usize],
            ];
            let [below, above] = handles.map(|handle| *self.world.bodies[handle].position());
            if surface.sticks {
                let joint = GenericJointBuilder::new(JointAxesMask::LOCKED_FIXED_AXES)
                    .contacts_enabled(false)
                    .local_frame1(below.inv_mul(&above))
                    .local_frame2(Pose::IDENTITY);
                self.world
                    .insert_impulse_joint(handles[0], handles[1], joint);
                continue;
            }
            for (normal, x) in touching {
                let frame = Pose::from_parts(x, Rotation::from_rotation_arc(Vector::X, normal));
                let joint = GenericJointBuilder::new(JointAxesMask::empty())
                    .local_frame1(below.inv_mul(&frame))
                    .local_frame2(above.inv_mul(&frame))
                    .limits(JointAxis::LinX, [-HELD_WITHIN, 0.0]);
                self.world
                    .insert_impulse_joint(handles[0], handles[1], joint);
            }
        }
        held
    }

    /// Moves bodies by a step of `dt` [s], and notes what they exchange.
    pub fn advance(
        &mut self,
        actors: &mut [Actor<'_>],
        around: &Surroundings<'_, '_>,
        dt: f64,
        touches: &mut Vec<ExchangedImpulse>,
    ) {
        let length = dt / ITERATIONS as f64;
        self.world.integration_parameters.dt = dt;
        self.place_walls(around.moment, dt);
        self.place_bodies(actors, around.setting, dt);
        let warm_start = std::mem::take(&mut self.warm_start);
        let dispatcher = Dispatcher {
            warm_start: Arc::new(self.by_places(warm_start)),
            length,
            before: self.before,
        };
        self.world.narrow_phase.set_query_dispatcher(dispatcher);
        self.before = length;
        let held = self.hold(around);
        let hooks = hooks(actors, around, dt);
        self.world.step_with_events(&hooks, &());
        let before: Vec<Body> = actors.iter().map(|actor| actor.body).collect();
        let exchanged = exchanged(&self.world, &held);
        let mut met = vec![false; around.moment.solids.len()];
        for n in exchanged.iter().flat_map(|one| one.pair) {
            met[n as usize] = true;
        }
        for ((actor, handle), met) in actors.iter_mut().zip(&self.bodies).zip(met) {
            let flown = flown(actor, around.setting, dt);
            if is_free(actor) {
                let after = &self.world.bodies[*handle];
                actor.body = match met {
                    true => body_after(actor, after),
                    false => unless_stopped(flown, actor, after, around.setting, dt),
                };
            } else {
                actor.body = flown;
            }
        }
        note(actors, &before, around, exchanged, dt, touches);
    }

    /// What points bore before, by places among bodies and colliders: colliders that are not there have none.
    fn by_places(&self, warm_start: Vec<CachedImpulse>) -> Vec<CachedImpulse> {
        let bodies = self.bodies.len();
        let place = |id: u32| match (id as usize).checked_sub(bodies) {
            None => Some(id),
            Some(wall) => {
                let at = self.walls.iter().position(|known| known.id == wall)?;
                Some((bodies + at) as u32)
            }
        };
        let moved = warm_start.into_iter().filter_map(|one| {
            let [a, b] = one.pair.map(place);
            Some(CachedImpulse {
                pair: [a?, b?],
                ..one
            })
        });
        let mut moved: Vec<CachedImpulse> = moved.collect();
        moved.sort_by_key(|one| one.pair);
        moved
    }

    /// What points of contact bore in the end.
    pub fn borne(&self) -> Vec<CachedImpulse> {
        let force = 1.0 / self.before;
        let mut all: Vec<CachedImpulse> = vec![];
        for pair in self.world.narrow_phase.contact_pairs() {
            let ids = places_of(&self.world, pair).map(|place| {
                let wall = (place as usize).checked_sub(self.bodies.len());
                let number = |wall: usize| (self.bodies.len() + self.walls[wall].id) as u32;
                wall.map_or(place, number)
            });
            all.extend(borne(pair.solver_manifolds()).map(|one| CachedImpulse {
                pair: ids,
                normal_impulse: force * one.normal_impulse,
                friction_impulse: scaled(one.friction_impulse, force),
                twist: force * one.twist,
                ..one
            }));
        }
        all.sort_by_key(|one| one.pair);
        all
    }
}

/// A body where the solver took it.
fn body_after(actor: &Actor<'_>, after: &rapier3d_f64::dynamics::RigidBody) -> Body {
    let q = after.rotation();
    let mut body = Body {
        com: array(after.translation()),
        rotation: [q.x, q.y, q.z, q.w],
        velocity: array(after.linvel()),
        ..actor.body
    };
    body.set_spin(&actor.shape.inertia, array(after.angvel()));
    body
}

/// A body that nothing touches, where it flew, but where it was kept from passing through something.
fn unless_stopped(
    flown: Body,
    actor: &Actor<'_>,
    after: &rapier3d_f64::dynamics::RigidBody,
    setting: &Setting<'_>,
    dt: f64,
) -> Body {
    let force = match actor.drive {
        Drive::Free { force, .. } => length(force) / actor.shape.inertia.mass,
        Drive::Kinematic { .. } => 0.0,
    };
    // Iterations move bodies by the velocity that each has in the end.
    let late = (force + length(setting.gravity)) * dt * dt;
    match length(sub(array(after.translation()), flown.com)) > late + STOPPED {
        true => Body {
            com: array(after.translation()),
            ..flown
        },
        false => flown,
    }
}
