//! What matter loses as it is deformed: its stress relaxes by a Maxwell branch ([`Relaxing`]) beside the elastic law.
//!
//! Such a solid (Zener's) loses most at one frequency, where its loss factor is `gain / 2 sqrt(1 + gain)`: that of its first mode. At three
//! times or a third of that it is 0.6 of it. The elastic law is what is left when all has relaxed. Momentum stays what it is.

use rayon::prelude::*;

use super::{
    first_mode::FirstMode,
    kernel::{Relaxing, SolidLaw},
    model::SolidModel,
    nodes::{Conditions, NODES, NodeBlock, Planes, read, slot},
    state::SolidState,
};
use crate::{
    motion::{RigidMotion, SUMS, add_to_sums},
    simd::{F32x16, LANES},
};

/// Largest phase of the first mode between two looks at how the solid turns [rad].
const PHASE: f64 = 0.2;
/// Blocks of nodes of a task.
const TASK: usize = 8;

/// What a solid loses, and what is known for that.
#[derive(Clone, Debug, Default)]
pub struct Dissipation {
    /// First mode, by what it follows from.
    known: Option<(Clamped, FirstMode)>,
    /// Points of held parts of the surface, at rest [m].
    places: Vec<[f64; 3]>,
    /// Mass of nodes that move freely, over that of the solid.
    mass: Vec<[F32x16; 4]>,
    /// Rest positions from the middle of the solid, along the axes of the world [cells].
    rest: Vec<Planes>,
    /// How the solid turns [rad/s], and the time since that was looked at [s]; none where a span begins.
    spin: Option<([f64; 3], f64)>,
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

impl Dissipation {
    /// Before a span in which parts of the surface are held.
    pub(super) fn begin(&mut self, places: Vec<[f64; 3]>) {
        self.places = places;
        (self.spin, self.lost) = (None, 0.0);
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

/// A solid that vibrates.
pub(super) struct Vibration<'a> {
    pub state: &'a SolidState,
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
        let places = &self.places;
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
            places: self.places.clone(),
        };
        self.known = Some((clamped, mode));
    }

    /// Stiffness at once over that at rest.
    pub(super) fn at_once(&self) -> f64 {
        1.0 + self.gain()
    }

    /// Stiffness of the branch over that of the law, by the largest loss factor.
    fn gain(&self) -> f64 {
        let FirstMode { omega, loss } = self.mode();
        match omega > 0.0 {
            true => 2.0 * loss * (loss + (1.0 + loss * loss).sqrt()),
            false => 0.0,
        }
    }

    /// Looks at how the solid turns, if it is time to before forces act for `kick` [s] more.
    pub(super) fn look(&mut self, of: &Vibration<'_>, kick: f64) {
        if self.gain() == 0.0 {
            return;
        }
        let omega = self.mode().omega;
        self.spin = match self.spin {
            Some((spin, elapsed)) if omega * (elapsed + kick) < PHASE => {
                Some((spin, elapsed + kick))
            }
            _ => Some((self.reference_spin(of), kick)),
        };
    }

    /// What relaxes while forces act for `kick` [s]; none where matter loses nothing.
    pub(super) fn relaxing<'a>(
        &self,
        relaxed: &'a mut Vec<Planes>,
        blocks: usize,
        kick: f64,
    ) -> Option<Relaxing<'a>> {
        let gain = self.gain();
        if gain == 0.0 {
            relaxed.clear();
            return None;
        }
        // The branch loses most where `omega tau` is that.
        let rate = self.mode().omega * (1.0 + gain).sqrt();
        let mut share = -(-rate * kick).exp_m1();
        if relaxed.is_empty() {
            // At first all has relaxed.
            relaxed.resize(blocks, [[F32x16::ZERO; 4]; 3]);
            share = 1.0;
        }
        let (spin, _) = self.spin.unwrap_or_default();
        Some(Relaxing {
            relaxed,
            gain: gain as f32,
            share: share as f32,
            turn: spin.map(|w| (w * kick) as f32),
        })
    }

    /// Spin of what has relaxed [1/s]: that of the solid, or that of what is held.
    fn reference_spin(&self, of: &Vibration<'_>) -> [f64; 3] {
        if !of.held.is_empty() {
            return self.spin_of_held(of);
        }
        if !self.places.is_empty() {
            return [0.0; 3];
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
        spin_of(&all)
    }

    /// Spin of the held nodes [1/s].
    fn spin_of_held(&self, of: &Vibration<'_>) -> [f64; 3] {
        let velocity = |n: usize| read(&of.state.nodes[n / NODES].v, n).map(f64::from);
        let first = velocity(of.held[0]);
        if of.held.iter().all(|&n| velocity(n) == first) {
            return [0.0; 3];
        }
        let mut sums = [0.0; SUMS];
        for &n in of.held {
            let fields = [&self.rest[n / NODES], &of.state.nodes[n / NODES].u];
            let [x, u] = fields.map(|field| read(field, n));
            let x = std::array::from_fn(|a| f64::from(x[a]) + f64::from(u[a]));
            add_to_sums(&mut sums, 1.0, x, velocity(n));
        }
        spin_of(&sums)
    }
}

/// Spin by sums about an origin [1/s]; none of what has no extent to turn.
fn spin_of(sums: &[f64; SUMS]) -> [f64; 3] {
    RigidMotion::from_sums(sums, [0.0; 3]).map_or([0.0; 3], |motion| motion.spin)
}
