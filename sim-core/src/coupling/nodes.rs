//! Bodies and matter on the grid: impulses between a body and the nodes in it.
//!
//! A body meets matter as a collider of finite mass would: nodes may come no nearer to it than the nearest of the particles
//! that reach them does, and rub. Impulses act at the nodes, equal and opposite, so that linear and angular momentum stay.

use std::collections::BTreeMap;

use super::{
    CouplingInput,
    near::{Watch, near},
    obstacle::{FacedBlock, Obstacle, RigidObstacle},
};
use crate::{
    bodies::{
        actor::Drive,
        body::Body,
        shape::Shape,
        solve::{Mover, Point, sweep},
        vector::{Vec3, add, along, length, scaled, sub},
    },
    grid::{Grid, NODES},
    ledger::Received,
    mat3::{Mat3, cross, dot},
};

/// Depth that a body has at least for nodes of matter that is one piece with it [cells]: a thinner one might lie between all of
/// them.
const DEPTH: f64 = 0.9;

/// A body among nodes.
#[derive(Clone, Copy, Debug)]
pub(crate) struct CoupledBody<'a> {
    /// Its object.
    pub object: usize,
    pub shape: &'a Shape,
    pub body: Body,
    pub drive: Drive,
}

/// Force [N] and torque about the centre of mass [N m].
pub(crate) type Load = (Vec3, Vec3);

/// A node that meets a body, the first of those that it meets.
struct CoupledNode {
    /// Node block, row and first float of the node.
    at: [usize; 3],
    body: usize,
    arm: Vec3,
    /// Before the meeting [m/s].
    velocity: Vec3,
}

/// What came of bodies at nodes.
#[derive(Clone, Debug, Default)]
pub(crate) struct Coupled {
    /// Per body the force [N] and torque about its centre of mass [N m] in the substep.
    pub loads: Vec<Load>,
    /// What objects received from the matter of grid fields.
    pub received: Vec<(usize, u32, Received)>,
    /// Largest velocity component given to a node [cells/s].
    pub largest: f32,
}

/// Lets bodies and nodes meet.
pub(crate) fn couple_bodies_to_grid(
    grid: &mut Grid,
    bodies: &[CoupledBody<'_>],
    input: &CouplingInput<'_>,
    watches: &mut [Watch],
) -> Coupled {
    let mut coupling = Coupling {
        movers: bodies.iter().map(|b| mover(b, input)).collect(),
        ..Coupling::default()
    };
    for n in 0..bodies.len() {
        let watch = &mut watches[bodies[n].object];
        coupling.find_points(grid, bodies, n, input, watch);
    }
    let mut coupled = Coupled {
        loads: vec![([0.0; 3], [0.0; 3]); bodies.len()],
        ..Coupled::default()
    };
    if !coupling.presses() {
        return coupled;
    }
    sweep(&mut coupling.points, &mut coupling.movers, SWEEPS);
    coupled.received = coupling.received(bodies);
    coupled.largest = coupling.give_back(grid, input, &mut coupled.loads);
    coupled
}

/// All points at which bodies and nodes meet in a substep.
#[derive(Default)]
struct Coupling {
    /// The bodies, then the nodes.
    movers: Vec<Mover>,
    /// The nodes, in the order of their movers.
    sites: Vec<CoupledNode>,
    /// Per node its mover.
    known: BTreeMap<[usize; 3], usize>,
    points: Vec<Point>,
    /// The grid field of each.
    fields: Vec<u32>,
}

impl Coupling {
    /// Finds the points of the body `n`.
    fn find_points(
        &mut self,
        grid: &Grid,
        bodies: &[CoupledBody<'_>],
        n: usize,
        input: &CouplingInput<'_>,
        watch: &mut Watch,
    ) {
        let (coupled, moves) = (&bodies[n], self.movers[n]);
        let speed = length(moves.velocity) + length(moves.spin) * coupled.shape.radius;
        let obstacle = RigidObstacle {
            shape: coupled.shape,
            body: coupled.body,
            moves,
        };
        let told = near(input, grid, &obstacle, speed, watch);
        for (block, nodes) in grid.nodes.iter().enumerate() {
            let meeting = BodyBlock {
                faced: FacedBlock {
                    input,
                    obstacle: &obstacle,
                    nodes,
                    nearest: told.get(block),
                },
                coupled,
                bonded: (input.bonded)(coupled.object, nodes.field),
            };
            if meeting.is_possible() {
                self.find_points_in(grid, block, n, &meeting);
            }
        }
    }

    /// Finds the points of the body `n` in a block of nodes.
    fn find_points_in(&mut self, grid: &Grid, block: usize, n: usize, meeting: &BodyBlock<'_>) {
        let BodyBlock {
            faced,
            coupled,
            bonded,
        } = meeting;
        let (input, nodes, bonded) = (faced.input, faced.nodes, *bonded);
        for at in 0..NODES {
            let Some((mass, velocity)) = input.node(grid, block, at) else {
                continue;
            };
            let Some((normal, target)) = meeting.at(at, velocity) else {
                continue;
            };
            let arm = sub(faced.place(faced.index(at)), coupled.body.com);
            let site = CoupledNode {
                at: [block, at / 4, 4 * (at % 4)],
                body: n,
                arm,
                velocity,
            };
            let mover = self.mover_of(site, mass);
            self.fields.push(nodes.field);
            self.points.push(Point {
                a: mover,
                b: Some(n),
                normal,
                arms: [[0.0; 3], arm],
                wall: [0.0; 3],
                friction: (input.friction)(coupled.object, nodes.field),
                restitution: 0.0,
                target,
                holds: bonded,
                sticks: bonded,
                normal_impulse: 0.0,
                friction_impulse: [0.0; 3],
                before: [0.0; 3],
            });
        }
    }

    /// The mover of a node of this mass [kg]: a new one where no body before met it.
    fn mover_of(&mut self, site: CoupledNode, mass: f64) -> usize {
        let (sites, movers) = (&mut self.sites, &mut self.movers);
        *self.known.entry(site.at).or_insert_with(|| {
            movers.push(Mover {
                inverse_mass: 1.0 / mass,
                inverse_inertia: Mat3::diagonal([0.0; 3]),
                velocity: site.velocity,
                spin: [0.0; 3],
            });
            sites.push(site);
            movers.len() - 1
        })
    }

    /// Whether there is anything to solve.
    fn presses(&self) -> bool {
        self.points.iter().any(|p| {
            let u = p.relative(&self.movers);
            p.holds || dot(u, p.normal) < p.target
        })
    }

    /// What objects received at the points, from which field.
    fn received(&self, bodies: &[CoupledBody<'_>]) -> Vec<(usize, u32, Received)> {
        let points = self.points.iter().zip(&self.fields);
        let received = points.filter_map(|(point, field)| {
            let body = &bodies[point.b?];
            let place = add(body.body.com, point.arms[1]);
            let (normal, impulse) = (scaled(point.normal, -1.0), scaled(point.impulse(), -1.0));
            let received = Received::at(place, normal, point.normal_impulse, impulse);
            Some((body.object, *field, received))
        });
        received.collect()
    }

    /// Gives impulses to bodies as loads, and velocities to nodes; returns their largest component [cells/s].
    fn give_back(&self, grid: &mut Grid, input: &CouplingInput<'_>, loads: &mut [Load]) -> f32 {
        for point in &self.points {
            let Some(body) = point.b else { continue };
            give(
                &mut loads[body],
                point.arms[1],
                scaled(point.impulse(), -1.0 / input.dt),
            );
        }
        let mut largest = 0.0_f32;
        for (site, mover) in self.sites.iter().zip(&self.movers[loads.len()..]) {
            if mover.velocity == site.velocity {
                continue;
            }
            let (left, speed) = input.give(grid, site.at, mover.velocity);
            largest = largest.max(speed);
            // What rounding takes from the node its first body gets.
            let rounded = scaled(left, 1.0 / mover.inverse_mass / input.dt);
            give(&mut loads[site.body], site.arm, rounded);
        }
        largest
    }
}

/// A body and a block of nodes.
struct BodyBlock<'a> {
    faced: FacedBlock<'a, RigidObstacle<'a>>,
    coupled: &'a CoupledBody<'a>,
    /// Whether both are one piece.
    bonded: bool,
}

impl BodyBlock<'_> {
    /// Depth that the body lacks to hold nodes of what is one piece with it [m].
    fn thicker(&self) -> f64 {
        (DEPTH * self.faced.input.dx - self.coupled.shape.depth).max(0.0)
    }

    /// Whether the body may meet some node.
    fn is_possible(&self) -> bool {
        if !self.bonded {
            return self.faced.nearest.is_some();
        }
        let [first, last] = [0, NODES - 1].map(|at| self.faced.place(self.faced.index(at)));
        let com = self.coupled.body.com;
        let reach = self.coupled.shape.radius + self.thicker();
        (0..3).all(|a| com[a] + reach >= first[a] && com[a] - reach <= last[a])
    }

    /// Normal out of the body at a node that meets it, and the least velocity along it that is left to the node [m/s], both
    /// relative to the body.
    fn at(&self, at: usize, velocity: Vec3) -> Option<(Vec3, f64)> {
        if !self.bonded {
            let (normal, target, ()) = self.faced.closing(at, velocity)?;
            return Some((normal, target));
        }
        let x = self.faced.place(self.faced.index(at));
        let seen = self.faced.obstacle.towards(x, self.thicker(), None).ok()?;
        Some((seen.normal, 0.0))
    }
}

/// Adds a force at a point.
fn give((force, torque): &mut (Vec3, Vec3), arm: Vec3, given: Vec3) {
    *force = add(*force, given);
    *torque = add(*torque, cross(arm, given));
}

/// Sweeps over all nodes.
const SWEEPS: usize = 30;

/// A body with the velocity that it will have at the end of the substep, like the nodes.
fn mover(coupled: &CoupledBody<'_>, input: &CouplingInput<'_>) -> Mover {
    let inertia = &coupled.shape.inertia;
    match coupled.drive {
        Drive::Free { force, torque } => {
            let mut body = coupled.body;
            let pushed = along(input.gravity, 1.0 / inertia.mass, force);
            body.velocity = along(body.velocity, input.dt, pushed);
            body.angular_momentum = along(body.angular_momentum, input.dt, torque);
            Mover {
                inverse_mass: 1.0 / inertia.mass,
                inverse_inertia: body.inverse_inertia(inertia),
                velocity: body.velocity,
                spin: body.spin(inertia),
            }
        }
        Drive::Kinematic { velocity, spin } => Mover {
            inverse_mass: 0.0,
            inverse_inertia: Mat3::diagonal([0.0; 3]),
            velocity,
            spin,
        },
    }
}
