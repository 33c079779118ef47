//! The kernel of solids against the oracle.

use super::*;
use cosplat_sim_core::{Isa, materials::Coefficients};
use cosplat_solid::{
    advance::Scratch,
    kernel::{Moving, Step, substep},
    lattice::Seed,
    nodes::{NodeBlock, write},
};

const DX: f64 = 0.1;
const DENSITY: f64 = 1000.0;
const LAWS: [Law; 3] = [Law::NeoHookean, Law::FixedCorotated, Law::Hencky];

fn law(law: Law) -> SolidLaw {
    let k = Coefficients::<f64>::of_law(law, 4e5, 2e5);
    SolidLaw {
        law,
        lambda: k.lambda,
        mu: k.mu,
        density: DENSITY,
        loss: 0.0,
    }
}

/// Half cells of matter as far as `inside` says, of a box of cells, turned about z.
fn seeds(cells: [usize; 3], turn: f64, inside: impl Fn([f64; 3]) -> bool) -> Vec<Seed> {
    let (sin, cos) = turn.sin_cos();
    let mut seeds = Vec::new();
    for n in 0..8 * cells.iter().product::<usize>() {
        let [_, high, deep] = cells.map(|c| 2 * c);
        let n = [n / (high * deep), n / deep % high, n % deep];
        let [x, y, z] = n.map(|n| 0.5 * DX * (n as f64 + 0.5));
        if inside([x, y, z]) {
            seeds.push(Seed {
                position: [cos * x - sin * y, sin * x + cos * y, z],
                volume: (0.5 * DX).powi(3),
                density: DENSITY,
                part: 0,
            });
        }
    }
    seeds
}

/// Both solvers with the same smooth strain and velocity, of some 0.05 and 0.3 m/s.
struct Pair {
    model: SolidModel,
    laws: [SolidLaw; 1],
    nodes: Vec<NodeBlock>,
    scratch: Scratch,
    oracle: ReferenceSolid,
    /// Slots of the model's nodes that have matter, with their indices in the oracle.
    matched: Vec<(usize, usize)>,
}

impl Pair {
    fn new(which: Law, seeds: &[Seed]) -> Self {
        let model = SolidModel::new(DX, seeds);
        let mut oracle = ReferenceSolid::new(&model, law(which));
        let mut nodes = vec![NodeBlock::REST; model.node_blocks.len()];
        let matched: Vec<(usize, usize)> = model
            .nodes()
            .map(|slot| (slot, oracle.index_of(&model, slot)))
            .collect();
        for &(slot, index) in &matched {
            let x = model.node_in_world(slot);
            let wave =
                |phase: f64| (7.0 * x[0] + phase).sin() + (9.0 * x[1] - phase).cos() + 4.0 * x[2];
            let u = [0.0, 1.0, 2.0].map(|phase| (0.005 * wave(phase) / DX) as f32);
            let v = [3.0, 4.0, 5.0].map(|phase| (0.1 * wave(phase) / DX) as f32);
            write(&mut nodes[slot / NODES].u, slot, u);
            write(&mut nodes[slot / NODES].p, slot, v);
            oracle.displacement[index] = u.map(|u| DX * f64::from(u));
            oracle.momentum[index] = v.map(|v| DX * f64::from(v));
        }
        model.extension.follow_displacements(&mut nodes);
        oracle.follow();
        Self {
            scratch: Scratch::new(&model),
            laws: [law(which)],
            nodes,
            oracle,
            matched,
            model,
        }
    }

    fn substep(&mut self, kick: f64, drift: f64) {
        let gravity = [0.3, -9.81, 0.1];
        self.oracle.substep(kick, drift, gravity);
        let found = substep(
            Isa::detect(),
            &self.model,
            &self.laws,
            &self.scratch.conditions,
            Moving {
                nodes: &mut self.nodes,
                memory: &mut vec![vec![]; self.model.point_blocks.len()],
                relaxing: None,
            },
            &mut self.scratch.tiles,
            &Step {
                kick: kick as f32,
                drift: drift as f32,
                keep: 1.0,
                gravity: gravity.map(|g| (g / DX) as f32),
                viscosity: 0.0,
                wants_extremes: false,
                wants_rate: false,
                knows_forces: false,
            },
        );
        assert!(!found.bad);
    }

    /// Largest difference of displacements, and of velocities, over the largest of these.
    fn differences(&self) -> [f64; 2] {
        use cosplat_solid::nodes::read;
        let mut off = [0.0_f64; 2];
        let mut largest = [0.0_f64; 2];
        for &(slot, index) in &self.matched {
            let block = &self.nodes[slot / NODES];
            let fast = [read(&block.u, slot), read(&block.v, slot)];
            let slow = [self.oracle.displacement[index], self.oracle.velocity[index]];
            for n in 0..2 {
                for a in 0..3 {
                    off[n] = off[n].max((DX * f64::from(fast[n][a]) - slow[n][a]).abs());
                    largest[n] = largest[n].max(slow[n][a].abs());
                }
            }
        }
        [off[0] / largest[0], off[1] / largest[1]]
    }
}

/// A box, a turned one, and a ball whose light nodes follow others.
fn shapes() -> [Vec<Seed>; 3] {
    let ball = |x: [f64; 3]| x.iter().map(|x| (x - 0.25).powi(2)).sum::<f64>() < 0.21_f64.powi(2);
    [
        seeds([5, 4, 3], 0.0, |_| true),
        seeds([4, 3, 3], 0.4, |_| true),
        seeds([5, 5, 5], 0.0, ball),
    ]
}

#[test]
fn masses_of_nodes_are_those_of_the_oracle() {
    for seeds in shapes() {
        let pair = Pair::new(Law::NeoHookean, &seeds);
        let total: f64 = pair.oracle.mass.iter().sum();
        // Volumes are stored in single precision.
        assert!((total / pair.model.total_mass - 1.0).abs() < 1e-6);
        let full = DENSITY * DX.powi(3);
        for &(slot, index) in &pair.matched {
            let (fast, slow) = (pair.model.mass[slot], pair.oracle.mass[index]);
            assert!((fast - slow).abs() < 1e-6 * full, "{fast} for {slow}");
        }
    }
}

/// Fifty substeps of half the limit are some twelve radians of the fastest motion: round-off in single precision grows by what they add
/// up to, `50 * 2^-24 = 3e-6` of the largest displacement, and as velocities by the frequency times that.
#[test]
fn nodes_move_as_in_the_oracle() {
    for which in LAWS {
        for seeds in shapes() {
            let mut pair = Pair::new(which, &seeds);
            let dt = 0.5 * DX * (DENSITY / law(which).tangent_at_rest()).sqrt();
            pair.substep(0.5 * dt, dt);
            for _ in 1..50 {
                pair.substep(dt, dt);
            }
            let [displacement, velocity] = pair.differences();
            assert!(displacement < 2e-5, "{which:?}: {displacement}");
            assert!(velocity < 1e-4, "{which:?}: {velocity}");
        }
    }
}

#[test]
fn an_oracle_with_another_law_is_seen() {
    let seeds = seeds([4, 3, 3], 0.0, |_| true);
    let mut pair = Pair::new(Law::NeoHookean, &seeds);
    pair.oracle.law = law(Law::Hencky);
    let dt = 0.5 * DX * (DENSITY / law(Law::Hencky).tangent_at_rest()).sqrt();
    for _ in 0..50 {
        pair.substep(dt, dt);
    }
    assert!(pair.differences()[0] > 1e-3);
}
