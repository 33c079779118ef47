//! Bodies and matter on the grid: impulses between a body and the nodes in it.
//!
//! A body meets matter as a collider of finite mass would: nodes may come no nearer to it than the nearest of the particles
//! that reach them does, and rub. Impulses act at the nodes, equal and opposite, so that linear and angular momentum stay.

use std::collections::BTreeMap;

use super::{
    body::Body,
    engine::Drive,
    near::{Fields, NODES, Nearest, near},
    shape::Shape,
    solve::{Mover, Point, sweep},
    vector::{Vec3, add, along, length, scaled, sub},
};
use crate::{
    colliders::{edge, pose::rotate},
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
const SOON: f64 = 0.1;
/// Cosine of the angle beyond which a node's normal is that of the other side of a thin body.
const SAME_SIDE: f64 = 0.5;

/// A body among nodes.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Wader<'a> {
    /// Its object.
    pub object: usize,
    pub shape: &'a Shape,
    pub body: Body,
    pub drive: Drive,
}

/// What the grid is filled with, and how bodies meet it.
pub(crate) struct Water<'a> {
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
    pub carrier: Vec3,
    /// [m/s^2]
    pub gravity: Vec3,
    /// Substep [s].
    pub dt: f64,
    /// Friction of an object with the matter of a grid field.
    pub friction: &'a dyn Fn(usize, u32) -> f64,
    /// Whether an object's body is one piece with the matter of a grid field.
    pub bonded: &'a dyn Fn(usize, u32) -> bool,
}

/// A node that meets a body, the first of those that it meets.
struct Site {
    /// Node block, row and first float of the node.
    at: [usize; 3],
    body: usize,
    arm: Vec3,
    /// Before the meeting [m/s].
    velocity: Vec3,
}

/// Lets bodies and nodes meet; returns per body the force [N] and torque about its centre of mass [N m] in the substep,
/// and the largest velocity component given to a node [cells/s].
pub(crate) fn wade(
    grid: &mut Grid,
    bodies: &[Wader<'_>],
    water: &Water<'_>,
) -> (Vec<(Vec3, Vec3)>, f32) {
    let dx = water.dx;
    let mut loads = vec![([0.0; 3], [0.0; 3]); bodies.len()];
    let mut movers: Vec<Mover> = bodies.iter().map(|b| mover(b, water)).collect();
    let (mut sites, mut points): (Vec<Site>, Vec<Point>) = (Vec::new(), Vec::new());
    let mut known: BTreeMap<[usize; 3], usize> = BTreeMap::new();
    for (n, wader) in bodies.iter().enumerate() {
        let moves = movers[n];
        let speed = length(moves.velocity) + length(moves.spin) * wader.shape.radius;
        let most = SOON * dx + water.dt * (water.fastest + speed);
        let (shape, body) = (wader.shape, &wader.body);
        let (particles, volumes) = (water.particles, water.fields.cells_per_mass);
        let told = near(particles, volumes, grid, shape, body, most, dx);
        for (block, nodes) in grid.nodes.iter().enumerate() {
            let meeting = Meeting {
                grid,
                water,
                wader,
                moves: &moves,
                nodes,
                nearest: told.get(block),
                bonded: (water.bonded)(wader.object, nodes.field),
            };
            if !meeting.is_possible() {
                continue;
            }
            for at in 0..NODES {
                let node = &grid.velocities[block].0[at / 4].0[4 * (at % 4)..][..4];
                if node[3].is_nan() || node[3] <= LIGHTEST {
                    continue;
                }
                let velocity = [0, 1, 2].map(|a| (f64::from(node[a]) + water.carrier[a]) * dx);
                let Some((normal, target)) = meeting.at(at, velocity) else {
                    continue;
                };
                let arm = sub(meeting.place(meeting.index(at)), wader.body.com);
                let place = [block, at / 4, 4 * (at % 4)];
                let mover = *known.entry(place).or_insert_with(|| {
                    sites.push(Site {
                        at: place,
                        body: n,
                        arm,
                        velocity,
                    });
                    movers.push(Mover {
                        inverse_mass: 1.0 / (f64::from(node[3]) * water.mass_unit),
                        inverse_inertia: Mat3::diagonal([0.0; 3]),
                        velocity,
                        spin: [0.0; 3],
                    });
                    movers.len() - 1
                });
                points.push(Point {
                    a: mover,
                    b: Some(n),
                    normal,
                    arms: [[0.0; 3], arm],
                    wall: [0.0; 3],
                    friction: (water.friction)(wader.object, nodes.field),
                    restitution: 0.0,
                    target,
                    holds: meeting.bonded,
                    sticks: meeting.bonded,
                    pressed: 0.0,
                    rubbed: [0.0; 3],
                    before: [0.0; 3],
                });
            }
        }
    }
    let touched = points.iter().any(|p| {
        let u = p.relative(&movers);
        p.holds || dot(u, p.normal) < p.target
    });
    if !touched {
        return (loads, 0.0);
    }
    sweep(&mut points, &mut movers, SWEEPS);
    for point in &points {
        let Some(body) = point.b else { continue };
        give(
            &mut loads[body],
            point.arms[1],
            scaled(point.impulse(), -1.0 / water.dt),
        );
    }
    let mut largest = 0_u32;
    for (site, mover) in sites.iter().zip(&movers[bodies.len()..]) {
        if mover.velocity == site.velocity {
            continue;
        }
        let [block, row, first] = site.at;
        let node = &mut grid.velocities[block].0[row].0[first..first + 4];
        let mass = f64::from(node[3]) * water.mass_unit;
        // What rounding takes from the node its first body gets.
        let mut rounded = [0.0; 3];
        for a in 0..3 {
            let before = f64::from(node[a]);
            node[a] = (mover.velocity[a] / dx - water.carrier[a]) as f32;
            largest = largest.max(node[a].abs().to_bits());
            let taken = dx * (f64::from(node[a]) - before);
            rounded[a] = mass * (mover.velocity[a] - site.velocity[a] - taken);
        }
        give(
            &mut loads[site.body],
            site.arm,
            scaled(rounded, 1.0 / water.dt),
        );
    }
    (loads, f32::from_bits(largest))
}

/// A body and a block of nodes.
struct Meeting<'a> {
    grid: &'a Grid,
    water: &'a Water<'a>,
    wader: &'a Wader<'a>,
    /// The body at the end of the substep, as far as it is known.
    moves: &'a Mover,
    nodes: &'a NodeBlock,
    /// What particles may touch the body, if any.
    nearest: Option<&'a [Nearest; NODES]>,
    /// Whether both are one piece.
    bonded: bool,
}

impl Meeting<'_> {
    /// Which node of the grid one of the block is.
    fn index(&self, at: usize) -> [i32; 3] {
        let local = [at / 16, at / 4 % 4, at % 4];
        std::array::from_fn(|a| BLOCK * self.nodes.index[a] + local[a] as i32)
    }

    /// Where a node of the grid is [m].
    fn place(&self, index: [i32; 3]) -> Vec3 {
        index.map(|i| f64::from(i) * self.water.dx)
    }

    /// Depth that the body lacks to hold nodes of what is one piece with it [m].
    fn thicker(&self) -> f64 {
        (DEPTH * self.water.dx - self.wader.shape.depth).max(0.0)
    }

    /// Whether the body may meet some node.
    fn is_possible(&self) -> bool {
        if !self.bonded {
            return self.nearest.is_some();
        }
        let [first, last] = [0, NODES - 1].map(|at| self.place(self.index(at)));
        let com = self.wader.body.com;
        let reach = self.wader.shape.radius + self.thicker();
        (0..3).all(|a| com[a] + reach >= first[a] && com[a] - reach <= last[a])
    }

    /// Normal out of the body at a node that meets it, and the least velocity along it that is left to the node [m/s], both
    /// relative to the body.
    fn at(&self, at: usize, velocity: Vec3) -> Option<(Vec3, f64)> {
        let (shape, body, water) = (self.wader.shape, &self.wader.body, self.water);
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
        let way = water.dt * dot(moves, normal);
        // What is on its way since it came to the grid is farther than where it was.
        let clock = &water.fields.clocks[self.nodes.field as usize];
        let mut gap = nearest.gap + clock.passed * dot(velocity, normal);
        if gap + way > SOON * water.dx {
            return None;
        }
        if water.fields.tell_edges[self.nodes.field as usize] && gap + way < 0.0 {
            gap = water.dx * edge::gap(gap / water.dx, self.edge(at));
        }
        Some((normal, -gap.max(0.0) / water.dt))
    }

    /// Gap in front of a node by where masses say that matter ends [cells].
    fn edge(&self, at: usize) -> f64 {
        let (shape, body, dx) = (self.wader.shape, &self.wader.body, self.water.dx);
        let surface = |index: [i32; 3]| {
            let local = body.inverse_point(self.place(index));
            let normal = rotate(body.rotation, shape.normal(local));
            (shape.distance(local) / dx, normal)
        };
        edge::edge(self.index(at), surface, |index| {
            matter(self.grid, self.water.anchors, self.nodes.field, index)
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
fn mover(wader: &Wader<'_>, water: &Water<'_>) -> Mover {
    let inertia = &wader.shape.inertia;
    match wader.drive {
        Drive::Free { force, torque } => {
            let mut body = wader.body;
            let pushed = along(water.gravity, 1.0 / inertia.mass, force);
            body.velocity = along(body.velocity, water.dt, pushed);
            body.angular_momentum = along(body.angular_momentum, water.dt, torque);
            Mover {
                inverse_mass: 1.0 / inertia.mass,
                inverse_inertia: body.inverse_inertia(inertia),
                velocity: body.velocity,
                spin: body.spin(inertia),
            }
        }
        Drive::Held { velocity, spin } => Mover {
            inverse_mass: 0.0,
            inverse_inertia: Mat3::diagonal([0.0; 3]),
            velocity,
            spin,
        },
    }
}
