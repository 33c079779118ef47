//! What matter loses as it vibrates: velocities relative to the solid's rigid motion decay at a rate that gives its first mode the loss
//! factor of its material.
//!
//! With `v' = -a v` a mode of angular frequency `w` shrinks by `e^(-a pi / w)` per period: `a = w_1 tan delta` makes the
//! logarithmic decrement of the first mode `pi tan delta`. Momentum and angular momentum stay what they are.

use rayon::prelude::*;

use super::{
    first_mode::FirstMode,
    kernel::SolidLaw,
    model::SolidModel,
    nodes::{Conditions, NODES, NodeBlock, Planes, read, slot},
    state::SolidState,
};
use crate::{
    motion::{RigidMotion, SUMS, add_to_sums},
    simd::{F32x16, LANES},
};

/// Largest phase of the first mode between two moments at which velocities decay [rad]: both decay and its energy are then exact to a
/// thousandth.
const PHASE: f64 = 0.2;
/// Blocks of nodes of a task.
const TASK: usize = 8;

/// What a solid loses, and what is known for that.
#[derive(Clone, Debug, Default)]
pub struct Dissipation {
    /// First mode, by what it follows from.
    known: Option<(Clamped, FirstMode)>,
    /// Parts of the surface that are held.
    faces: Faces,
    /// Mass of nodes that move freely, over that of the solid.
    mass: Vec<[F32x16; 4]>,
    /// Rest positions from the middle of the solid, along the axes of the world [cells].
    rest: Vec<Planes>,
    /// Time since velocities decayed [s].
    elapsed: f64,
    /// Energy lost in this span [J].
    pub lost: f64,
}

/// What a first mode follows from.
#[derive(Clone, Debug)]
struct Clamped {
    laws: Vec<SolidLaw>,
    held: Vec<usize>,
    places: Vec<[f64; 3]>,
}

/// Held parts of a surface.
#[derive(Clone, Debug, Default)]
pub(super) struct Faces {
    /// Places of their points at rest [m].
    pub places: Vec<[f64; 3]>,
    /// Velocity of the first of them [m/s].
    pub velocity: Option<[f64; 3]>,
}

impl Dissipation {
    /// Before a span in which parts of the surface are held.
    pub(super) fn begin(&mut self, faces: Faces) {
        self.faces = faces;
        (self.elapsed, self.lost) = (0.0, 0.0);
    }

    /// Takes note of nodes that are held now.
    fn hold(&mut self, model: &SolidModel, conditions: &Conditions) {
        self.mass.clear();
        let share = |mass: f64| (mass / model.total_mass) as f32;
        self.mass
            .extend(conditions.w.iter().enumerate().map(|(block, w)| {
                std::array::from_fn(|x| {
                    F32x16(std::array::from_fn(|lane| {
                        let moves = w[x].0[lane] > 0.0;
                        let mass = model.mass[slot(block, [x, lane])];
                        if moves { share(mass) } else { 0.0 }
                    }))
                })
            }));
    }

    fn place_nodes(&mut self, model: &SolidModel) {
        let inner = || model.nodes().filter(|&n| model.mass[n] > 0.0);
        let mut middle = [0.0; 3];
        for n in inner() {
            let x = model.node_in_world(n);
            for a in 0..3 {
                middle[a] += x[a] * model.mass[n] / model.total_mass;
            }
        }
        self.rest = vec![[[F32x16::ZERO; 4]; 3]; model.node_blocks.len()];
        for n in inner() {
            let x = model.node_in_world(n);
            for a in 0..3 {
                let place = ((x[a] - middle[a]) / model.dx) as f32;
                self.rest[n / NODES][a][n / 16 % 4].0[n % 16] = place;
            }
        }
    }

    /// First mode; one without a frequency where that is not known.
    fn mode(&self) -> FirstMode {
        self.known.as_ref().map_or(FirstMode::default(), |k| k.1)
    }
}

/// Sums over the nodes of a block about the middle of the solid. In double precision: an error of the spin would add up from one decay to
/// the next.
fn sums_of(node: &NodeBlock, mass: &[F32x16; 4], rest: &Planes) -> [f64; SUMS] {
    let mut sums = [0.0; SUMS];
    for x in 0..4 {
        for n in (0..LANES).filter(|&n| mass[x].0[n] > 0.0) {
            let r =
                std::array::from_fn(|a| f64::from(rest[a][x].0[n]) + f64::from(node.u[a][x].0[n]));
            let v = std::array::from_fn(|a| f64::from(node.v[a][x].0[n]));
            add_to_sums(&mut sums, f64::from(mass[x].0[n]), r, v);
        }
    }
    sums
}

/// Takes the share `taken` of the velocities relative to a rigid motion from a block; returns the sum of mass times squared velocity
/// that these had.
fn decay(
    node: &mut NodeBlock,
    (mass, rest): (&[F32x16; 4], &Planes),
    motion: &RigidMotion,
    taken: f32,
) -> f64 {
    let ([cx, cy, cz], [vx, vy, vz], [wx, wy, wz]) = (
        motion.com.map(|x| x as f32),
        motion.velocity.map(|v| v as f32),
        motion.spin.map(|w| w as f32),
    );
    let mut squares = [0.0_f32; LANES];
    for x in 0..4 {
        for n in 0..LANES {
            let m = mass[x].0[n];
            let rx = rest[0][x].0[n] + node.u[0][x].0[n] - cx;
            let ry = rest[1][x].0[n] + node.u[1][x].0[n] - cy;
            let rz = rest[2][x].0[n] + node.u[2][x].0[n] - cz;
            let a = node.v[0][x].0[n] - (vx + (wy * rz - wz * ry));
            let b = node.v[1][x].0[n] - (vy + (wz * rx - wx * rz));
            let c = node.v[2][x].0[n] - (vz + (wx * ry - wy * rx));
            squares[n] += m * (a * a + (b * b + c * c));
            let taken = if m > 0.0 { taken } else { 0.0 };
            node.v[0][x].0[n] -= taken * a;
            node.v[1][x].0[n] -= taken * b;
            node.v[2][x].0[n] -= taken * c;
        }
    }
    squares.into_iter().map(f64::from).sum()
}

/// A solid whose velocities may decay.
pub(super) struct Vibration<'a> {
    pub model: &'a SolidModel,
    pub state: &'a mut SolidState,
    /// Nodes that are held.
    pub held: &'a [usize],
}

impl Dissipation {
    /// Finds the first mode, if that is not known for what holds the solid, and matter loses anything.
    pub(super) fn find_first_mode(
        &mut self,
        model: &SolidModel,
        laws: &[SolidLaw],
        (held, conditions): (&[usize], &Conditions),
    ) {
        let places = &self.faces.places;
        let is_same = |(known, _): &(Clamped, FirstMode)| {
            known.laws == laws && known.held == held && known.places == *places
        };
        if self.known.as_ref().is_some_and(is_same) {
            return;
        }
        let mut mode = FirstMode::default();
        if laws.iter().any(|law| law.loss > 0.0) {
            mode = FirstMode::new(model, laws, held, places.iter().copied());
            self.place_nodes(model);
            self.hold(model, conditions);
        }
        let clamped = Clamped {
            laws: laws.to_vec(),
            held: held.to_vec(),
            places: self.faces.places.clone(),
        };
        self.known = Some((clamped, mode));
    }

    /// Lets velocities decay after `kick` [s] more, if it is time to or a span `ends`.
    pub(super) fn act(&mut self, of: &mut Vibration<'_>, kick: f64, ends: bool) {
        let FirstMode { omega, loss } = self.mode();
        if omega * loss == 0.0 {
            return;
        }
        self.elapsed += kick;
        if omega * self.elapsed < PHASE && !ends || self.elapsed == 0.0 {
            return;
        }
        let keep = (-omega * loss * std::mem::take(&mut self.elapsed)).exp();
        let motion = self.reference_motion(of);
        let Self { mass, rest, .. } = &*self;
        let blocks = of.state.nodes.par_iter_mut().zip(mass).zip(rest);
        let taken = (1.0 - keep) as f32;
        let squares: Vec<f64> = blocks
            .with_min_len(TASK)
            .map(|((node, mass), rest)| decay(node, (mass, rest), &motion, taken))
            .collect();
        let squares: f64 = squares.into_iter().sum();
        let kinetic = 0.5 * of.model.total_mass * of.model.dx.powi(2) * squares;
        self.lost += (1.0 - keep * keep) * kinetic;
    }

    /// The motion that nothing is lost in, in cells and about the middle of the solid: its own rigid one, or that of what is held.
    fn reference_motion(&self, of: &Vibration<'_>) -> RigidMotion {
        if !of.held.is_empty() {
            return self.held_motion(of);
        }
        if let Some(velocity) = self.faces.velocity {
            let (dx, frame) = (of.model.dx, of.state.velocity);
            let velocity = std::array::from_fn(|a| (velocity[a] - frame[a]) / dx);
            return RigidMotion::of_wall([0.0; 3], velocity);
        }
        let blocks = of.state.nodes.par_iter().zip(&self.mass).zip(&self.rest);
        let sums: Vec<[f64; SUMS]> = blocks
            .with_min_len(TASK)
            .map(|((node, mass), rest)| sums_of(node, mass, rest))
            .collect();
        let mut all = [0.0; SUMS];
        for sums in sums {
            for (all, sum) in all.iter_mut().zip(sums) {
                *all += sum;
            }
        }
        let mean = [all[10] / all[0], all[11] / all[0], all[12] / all[0]];
        RigidMotion::from_sums(&all, [0.0; 3])
            .unwrap_or_else(|| RigidMotion::of_wall([0.0; 3], mean))
    }

    /// Motion of the held nodes.
    fn held_motion(&self, of: &Vibration<'_>) -> RigidMotion {
        let velocity = |n: usize| read(&of.state.nodes[n / NODES].v, n).map(f64::from);
        let first = velocity(of.held[0]);
        let moves_as_first = of.held.iter().all(|&n| velocity(n) == first);
        let mut sums = [0.0; SUMS];
        for &n in of.held {
            let fields = [&self.rest[n / NODES], &of.state.nodes[n / NODES].u];
            let [x, u] = fields.map(|field| read(field, n));
            let x = std::array::from_fn(|a| f64::from(x[a]) + f64::from(u[a]));
            add_to_sums(&mut sums, 1.0, x, velocity(n));
        }
        let count = of.held.len() as f64;
        let mean = [sums[10] / count, sums[11] / count, sums[12] / count];
        let turning = RigidMotion::from_sums(&sums, [0.0; 3]).filter(|_| !moves_as_first);
        turning.unwrap_or_else(|| RigidMotion::of_wall([0.0; 3], mean))
    }
}
