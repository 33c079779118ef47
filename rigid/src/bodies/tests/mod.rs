//! Bodies alone: shapes, flight, impacts, resting contact.

mod cylinders;
mod flight;
mod heaps;
mod impacts;
mod narrow;
mod resting;
mod shapes;
mod uneven;

use super::{
    actor::{Actor, Drive, Setting},
    body::Body,
    engine::step,
    grain::{Grain, of_cubes},
    shape::{Shape, frame},
    vector::{Vec3, add, along, length, scaled, sub},
    warm_start::CachedImpulse,
};
use crate::{
    Scene,
    colliders::{Boundaries, Substep},
    interruption::Interruption,
    mat3::{cross, dot},
    scene::Surface,
    test_scenes::{add_plane, empty},
};

const DX: f64 = 0.1;

/// A box of particles with spacing `h` about `center`, 1000 kg/m^3.
fn block(center: Vec3, h: f64, cells: [usize; 3]) -> Vec<Grain> {
    let mut grains = Vec::new();
    for i in 0..cells[0] {
        for j in 0..cells[1] {
            for k in 0..cells[2] {
                let at = [i, j, k];
                grains.push(Grain {
                    x: [0, 1, 2]
                        .map(|a| center[a] + h * (at[a] as f64 + 0.5 - 0.5 * cells[a] as f64)),
                    mass: 1000.0 * h.powi(3),
                    volume: h.powi(3),
                });
            }
        }
    }
    grains
}

/// The part of a block that a condition on the offset from its centre keeps.
fn carved(center: Vec3, h: f64, cells: [usize; 3], keep: impl Fn(Vec3) -> bool) -> Vec<Grain> {
    let mut grains = block(center, h, cells);
    grains.retain(|g| keep(sub(g.x, center)));
    grains
}

fn ball(center: Vec3, radius: f64, h: f64) -> Vec<Grain> {
    let n = (2.0 * radius / h).ceil() as usize + 1;
    carved(center, h, [n; 3], |r| length(r) < radius)
}

/// A cylinder along z.
fn drum(center: Vec3, radius: f64, half: f64, h: f64) -> Vec<Grain> {
    let n = 2 * (radius / h).ceil() as usize + 2;
    let layers = (2.0 * half / h).round() as usize;
    carved(center, h, [n, n, layers], |r| r[0].hypot(r[1]) < radius)
}

/// The body that particles form.
fn formed(grains: &[Grain]) -> Option<(Shape, Body)> {
    let body = frame(grains, [0.0, 0.0, 0.0, 1.0])?;
    let inside = |g: &Grain| Grain {
        x: body.inverse_point(g.x),
        ..*g
    };
    let local: Vec<Grain> = grains.iter().map(inside).collect();
    Some((Shape::new(&local, of_cubes(grains)), body))
}

/// Bodies and what they meet.
struct Stage {
    scene: Scene,
    shapes: Vec<Shape>,
    bodies: Vec<Body>,
    drives: Vec<Drive>,
    memory: Vec<CachedImpulse>,
    surface: (f64, f64),
    time: f64,
}

const FREE: Drive = Drive::Free {
    force: [0.0; 3],
    torque: [0.0; 3],
};

impl Stage {
    fn new(gravity: Vec3) -> Self {
        let mut scene = empty(DX);
        scene.gravity = gravity;
        Self {
            scene,
            shapes: vec![],
            bodies: vec![],
            drives: vec![],
            memory: vec![],
            surface: (0.0, 0.0),
            time: 0.0,
        }
    }

    fn add(&mut self, grains: &[Grain]) -> usize {
        let (shape, body) = formed(grains).expect("has mass");
        self.shapes.push(shape);
        self.bodies.push(body);
        self.drives.push(FREE);
        self.bodies.len() - 1
    }

    fn plane(&mut self, normal: Vec3, friction: f64, restitution: f64) {
        add_plane(
            &mut self.scene,
            [0.0; 3],
            normal,
            Surface::Separate,
            friction,
        );
        let last = self.scene.colliders.last_mut().expect("just added");
        last.restitution = restitution;
    }

    fn step(&mut self, dt: f64) {
        let boundaries = Boundaries::new(&self.scene, 1.0);
        let paths = vec![None; self.scene.colliders.len()];
        let start = self.time;
        let walls = |from: f64, length: f64| {
            let substep = Substep {
                time: start + from,
                dt: length,
                kick: length,
                frame_start: start,
                frame_length: dt,
            };
            boundaries.all(&paths, &substep)
        };
        let surface = self.surface;
        let setting = Setting {
            gravity: self.scene.gravity,
            dx: DX,
            damping: 0.0,
            walls: &walls,
            surface: &|_, _| surface,
            friction: &|_| None,
            interruption: Interruption::never(),
        };
        let mut actors: Vec<Actor<'_>> = (0..self.bodies.len())
            .map(|n| Actor {
                shape: &self.shapes[n],
                body: self.bodies[n],
                drive: self.drives[n],
            })
            .collect();
        step(&mut actors, &mut self.memory, &setting, dt);
        self.bodies = actors.iter().map(|actor| actor.body).collect();
        self.time += dt;
    }

    fn energy(&self) -> f64 {
        let all = self.shapes.iter().zip(&self.bodies);
        let g = self.scene.gravity;
        all.map(|(s, b)| b.kinetic_energy(&s.inertia) - s.inertia.mass * dot(g, b.com))
            .sum()
    }

    /// Linear, and angular momentum about the origin.
    fn momentum(&self) -> (Vec3, Vec3) {
        let (mut p, mut l) = ([0.0; 3], [0.0; 3]);
        for (shape, body) in self.shapes.iter().zip(&self.bodies) {
            let own = scaled(body.velocity, shape.inertia.mass);
            p = add(p, own);
            l = add(l, add(cross(body.com, own), body.angular_momentum));
        }
        (p, l)
    }
}

/// Numbers in -1..1 that look random (Weyl sequence through a bijection).
struct Dice(u64);

impl Dice {
    fn roll(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
    }

    fn vector(&mut self) -> Vec3 {
        [self.roll(), self.roll(), self.roll()]
    }
}
