//! Bodies and matter on the grid: impulses between a body and the nodes in it.
//!
//! A body meets matter as a collider of finite mass would: nodes may come no nearer to it than the nearest of the particles
//! that reach them does, and rub. Impulses act at the nodes, equal and opposite, so that linear and angular momentum stay.

use std::collections::BTreeMap;

use super::{
    actor::Drive,
    body::Body,
    near::{Fields, GapSample, NODES, near},
    shape::Shape,
    solve::{Mover, Point, sweep},
    vector::{Vec3, add, along, length, scaled, sub},
};
use crate::{
    colliders::{edge, pose::rotate},
    contact::ledger::Received,
    grid::{Grid, NodeBlock, anchors::Anchors},
    mat3::{Mat3, cross, dot},
    particles::{BLOCK, Particles},
};

/// Nodes lighter than this share of the heaviest particle meet nobody.
const LIGHTEST: f32 = 1e-12;
/// Depth that a body has at least for nodes of matter that is one piece with it [cells]: a thinner one might lie between all of
/// them.
const DEPTH: f64 = 0.9;
/// Gap up to which nodes count that would not close it by themselves [cells]: a body that others push may.
const GAP_LOOKAHEAD: f64 = 0.1;
/// Cosine of the angle beyond which a node's normal is that of the other side of a thin body.
const SAME_SIDE: f64 = 0.5;

/// A body among nodes.
#[derive(Clone, Copy, Debug)]
pub(crate) struct CoupledBody<'a> {
    /// Its object.
    pub object: usize,
    pub shape: &'a Shape,
    pub body: Body,
    pub drive: Drive,
}

/// What the grid is filled with, and how bodies meet it.
pub(crate) struct CouplingInput<'a> {
    /// What it is the grid of.
    pub particles: &'a Particles,
    pub fields: Fields<'a>,
    /// What of masses is not matter.
    pub anchors: &'a Anchors<'a>,
    /// How fast it moves at most, about [m/s].
    pub fastest: f64,
    /// Cell size [m].
    pub dx: f64,
    /// Unit of mass of nodes [kg].
    pub mass_unit: f64,
    /// Velocity that those of nodes are relative to [cells/s].
    pub frame_velocity: Vec3,
    /// [m/s^2]
    pub gravity: Vec3,
    /// Substep [s].
    pub dt: f64,
    /// Friction of an object with the matter of a grid field.
    pub friction: &'a dyn Fn(usize, u32) -> f64,
    /// Whether an object's body is one piece with the matter of a grid field.
    pub bonded: &'a dyn Fn(usize, u32) -> bool,
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
) -> Coupled {
    let mut coupling = Coupling {
        movers: bodies.iter().map(|b| mover(b, input)).collect(),
        ..Coupling::default()
    };
    for n in 0..bodies.len() {
        coupling.find_points(grid, bodies, n, input);
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
    ) {
        let (coupled, moves) = (&bodies[n], self.movers[n]);
        let speed = length(moves.velocity) + length(moves.spin) * coupled.shape.radius;
        let most = GAP_LOOKAHEAD * input.dx + input.dt * (input.fastest + speed);
        let (shape, body) = (coupled.shape, &coupled.body);
        let (particles, volumes) = (input.particles, input.fields.cells_per_mass);
        let told = near(particles, volumes, grid, shape, body, most, input.dx);
        for (block, nodes) in grid.nodes.iter().enumerate() {
            let meeting = BodyBlock {
                grid,
                input,
                coupled,
                moves: &moves,
                nodes,
                nearest: told.get(block),
                bonded: (input.bonded)(coupled.object, nodes.field),
            };
            if meeting.is_possible() {
                self.find_points_in(block, n, &meeting);
            }
        }
    }

    /// Finds the points of the body `n` in a block of nodes.
    fn find_points_in(&mut self, block: usize, n: usize, meeting: &BodyBlock<'_>) {
        let BodyBlock {
            grid,
            input,
            coupled,
            nodes,
            bonded,
            ..
        } = *meeting;
        for at in 0..NODES {
            let node = &grid.velocities[block].0[at / 4].0[4 * (at % 4)..][..4];
            if node[3].is_nan() || node[3] <= LIGHTEST {
                continue;
            }
            let velocity =
                [0, 1, 2].map(|a| (f64::from(node[a]) + input.frame_velocity[a]) * input.dx);
            let Some((normal, target)) = meeting.at(at, velocity) else {
                continue;
            };
            let arm = sub(meeting.place(meeting.index(at)), coupled.body.com);
            let site = CoupledNode {
                at: [block, at / 4, 4 * (at % 4)],
                body: n,
                arm,
                velocity,
            };
            let mover = self.mover_of(site, f64::from(node[3]) * input.mass_unit);
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
        let mut largest = 0_u32;
        for (site, mover) in self.sites.iter().zip(&self.movers[loads.len()..]) {
            if mover.velocity == site.velocity {
                continue;
            }
            let [block, row, first] = site.at;
            let node = &mut grid.velocities[block].0[row].0[first..first + 4];
            let mass = f64::from(node[3]) * input.mass_unit;
            // What rounding takes from the node its first body gets.
            let mut rounded = [0.0; 3];
            for a in 0..3 {
                let before = f64::from(node[a]);
                node[a] = (mover.velocity[a] / input.dx - input.frame_velocity[a]) as f32;
                largest = largest.max(node[a].abs().to_bits());
                let taken = input.dx * (f64::from(node[a]) - before);
                rounded[a] = mass * (mover.velocity[a] - site.velocity[a] - taken);
            }
            give(
                &mut loads[site.body],
                site.arm,
                scaled(rounded, 1.0 / input.dt),
            );
        }
        f32::from_bits(largest)
    }
}

/// A body and a block of nodes.
struct BodyBlock<'a> {
    grid: &'a Grid,
    input: &'a CouplingInput<'a>,
    coupled: &'a CoupledBody<'a>,
    /// The body at the end of the substep, as far as it is known.
    moves: &'a Mover,
    nodes: &'a NodeBlock,
    /// What particles may touch the body, if any.
    nearest: Option<&'a [GapSample; NODES]>,
    /// Whether both are one piece.
    bonded: bool,
}

impl BodyBlock<'_> {
    /// Which node of the grid one of the block is.
    fn index(&self, at: usize) -> [i32; 3] {
        let local = [at / 16, at / 4 % 4, at % 4];
        std::array::from_fn(|a| BLOCK * self.nodes.index[a] + local[a] as i32)
    }

    /// Where a node of the grid is [m].
    fn place(&self, index: [i32; 3]) -> Vec3 {
        index.map(|i| f64::from(i) * self.input.dx)
    }

    /// Depth that the body lacks to hold nodes of what is one piece with it [m].
    fn thicker(&self) -> f64 {
        (DEPTH * self.input.dx - self.coupled.shape.depth).max(0.0)
    }

    /// Whether the body may meet some node.
    fn is_possible(&self) -> bool {
        if !self.bonded {
            return self.nearest.is_some();
        }
        let [first, last] = [0, NODES - 1].map(|at| self.place(self.index(at)));
        let com = self.coupled.body.com;
        let reach = self.coupled.shape.radius + self.thicker();
        (0..3).all(|a| com[a] + reach >= first[a] && com[a] - reach <= last[a])
    }

    /// Normal out of the body at a node that meets it, and the least velocity along it that is left to the node [m/s], both
    /// relative to the body.
    fn at(&self, at: usize, velocity: Vec3) -> Option<(Vec3, f64)> {
        let (shape, body, input) = (self.coupled.shape, &self.coupled.body, self.input);
        let x = self.place(self.index(at));
        let local = body.inverse_point(x);
        if self.bonded {
            let inside = shape.distance(local) < self.thicker();
            return inside.then(|| (rotate(body.rotation, shape.normal(local)), 0.0));
        }
        let nearest = self.nearest?[at];
        if nearest.gap == f64::INFINITY {
            return None;
        }
        // That of the surface near the node, if it is on the side of the particle.
        let [own, its] = [local, nearest.place].map(|x| shape.normal(x));
        let outward = if dot(own, its) > SAME_SIDE { own } else { its };
        let normal = rotate(body.rotation, outward);
        let turns = cross(self.moves.spin, sub(x, body.com));
        let moves = sub(velocity, add(self.moves.velocity, turns));
        let way = input.dt * dot(moves, normal);
        // What is on its way since it came to the grid is farther than where it was.
        let pass = &input.fields.passes[self.nodes.field as usize];
        let mut gap = nearest.gap + pass.elapsed * dot(velocity, normal);
        if gap + way > GAP_LOOKAHEAD * input.dx {
            return None;
        }
        if input.fields.reconstructs_surface[self.nodes.field as usize] && gap + way < 0.0 {
            gap = input.dx * edge::gap(gap / input.dx, self.edge(at));
        }
        Some((normal, -gap.max(0.0) / input.dt))
    }

    /// Gap in front of a node by where masses say that matter ends [cells].
    fn edge(&self, at: usize) -> f64 {
        let (shape, body, dx) = (self.coupled.shape, &self.coupled.body, self.input.dx);
        let surface = |index: [i32; 3]| {
            let local = body.inverse_point(self.place(index));
            let normal = rotate(body.rotation, shape.normal(local));
            (shape.distance(local) / dx, normal)
        };
        edge::edge(self.index(at), surface, |index| {
            matter(self.grid, self.input.anchors, self.nodes.field, index)
        })
    }
}

/// Mass of the matter of a field at a node by its place in the grid.
fn matter(grid: &Grid, anchors: &Anchors<'_>, field: u32, index: [i32; 3]) -> f64 {
    let block = index.map(|i| i.div_euclid(BLOCK));
    let nodes = &grid.nodes;
    let Ok(found) = nodes.binary_search_by_key(&(field, block), |n| (n.field, n.index)) else {
        return 0.0;
    };
    let [i, j, k] = index.map(|i| i.rem_euclid(BLOCK) as usize);
    let mass = f64::from(grid.velocities[found].0[4 * i + j].0[4 * k + 3]);
    anchors.matter(found, &nodes[found], 16 * i + 4 * j + k, mass)
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
