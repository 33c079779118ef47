//! Bodies and matter on the grid: impulses between a body and the nodes in it.
//!
//! A body meets matter as a collider of finite mass would: nodes inside it may not move further in, and rub. Impulses
//! act at the nodes, equal and opposite, so that linear and angular momentum stay.

use std::collections::BTreeMap;

use super::{
    body::Body,
    engine::Drive,
    shape::Shape,
    solve::{Mover, Point, sweep},
    vector::{Vec3, add, along, scaled, sub},
};
use crate::{
    colliders::pose::rotate,
    grid::Grid,
    mat3::{Mat3, cross, dot},
    particles::BLOCK,
};

/// Nodes lighter than this share of the heaviest particle meet nobody.
const LIGHTEST: f32 = 1e-12;
/// Depth that a body has for nodes at least [cells]: a thinner one might lie between all of them.
const DEPTH: f64 = 0.9;

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

/// A node in a body, the first of those that it is in.
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
        let thicker = (DEPTH * dx - wader.shape.depth).max(0.0);
        let reach = wader.shape.radius + thicker;
        for (block, nodes) in grid.nodes.iter().enumerate() {
            let first = nodes.index.map(|i| f64::from(BLOCK * i) * dx);
            let last = first.map(|x| x + f64::from(BLOCK - 1) * dx);
            let com = wader.body.com;
            if (0..3).any(|a| com[a] + reach < first[a] || com[a] - reach > last[a]) {
                continue;
            }
            for row in 0..16 {
                for k in 0..4 {
                    let node = &grid.velocities[block].0[row].0[4 * k..4 * k + 4];
                    if node[3].is_nan() || node[3] <= LIGHTEST {
                        continue;
                    }
                    let offset = [row / 4, row % 4, k];
                    let x = [0, 1, 2].map(|a| first[a] + offset[a] as f64 * dx);
                    let local = wader.body.inverse_point(x);
                    if wader.shape.distance(local) >= thicker {
                        continue;
                    }
                    let bonded = (water.bonded)(wader.object, nodes.field);
                    let at = [block, row, 4 * k];
                    let mover = *known.entry(at).or_insert_with(|| {
                        let velocity =
                            [0, 1, 2].map(|a| (f64::from(node[a]) + water.carrier[a]) * dx);
                        sites.push(Site {
                            at,
                            body: n,
                            arm: sub(x, com),
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
                        normal: rotate(wader.body.rotation, wader.shape.normal(local)),
                        arms: [[0.0; 3], sub(x, com)],
                        wall: [0.0; 3],
                        friction: (water.friction)(wader.object, nodes.field),
                        restitution: 0.0,
                        target: 0.0,
                        holds: bonded,
                        sticks: bonded,
                        pressed: 0.0,
                        rubbed: [0.0; 3],
                        before: [0.0; 3],
                    });
                }
            }
        }
    }
    let touched = points.iter().any(|p| {
        let u = p.relative(&movers);
        p.holds || dot(u, p.normal) < 0.0
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
