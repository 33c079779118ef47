//! A block that vibrates, and nothing else: what the kernel of solids is measured with.

use super::{
    advance::Scratch,
    kernel::{Moving, SolidLaw, Step, substep},
    lattice::Seed,
    memory::{BlockMemory, remember},
    model::SolidModel,
    nodes::{NODES, NodeBlock, write},
};
use crate::{materials::Material, simd::Isa};

/// Largest strain at the start, about.
const STRAIN: f64 = 0.05;
/// Share of `dx sqrt(rho / (3 lambda + 2 mu))` that a substep takes.
const CFL: f64 = 0.5;
/// Volume of the points that a boundary cuts, over that of full ones.
const CUT: f64 = 0.7;

/// A cube of matter on a grid of its own, touched by nothing.
pub struct VibratingBlock {
    isa: Isa,
    model: SolidModel,
    laws: [SolidLaw; 1],
    nodes: Vec<NodeBlock>,
    memory: Vec<BlockMemory>,
    scratch: Scratch,
    step: Step,
}

impl VibratingBlock {
    /// A cube of a material that solids on grids of their own may have, with `edge` cells along each axis, at least 1. `cut` is the share of
    /// its cells, 0 to 1, that count as cut: one of their eight points has less volume.
    pub fn new(isa: Isa, material: &Material, edge: u32, cut: f64) -> Self {
        let edge = edge as usize;
        let mut seeds = Vec::with_capacity(8 * edge.pow(3));
        for n in 0..8 * edge.pow(3) {
            let at = [
                n / (4 * edge * edge),
                n / (2 * edge) % (2 * edge),
                n % (2 * edge),
            ];
            // Cut cells lie anywhere; multiples of the golden section are spread evenly.
            let cell = at.map(|n| n / 2);
            let number = ((cell[0] * edge + cell[1]) * edge + cell[2]) as f64;
            let is_cut = (number * 0.618_033_988_749_895).fract() < cut;
            let less = is_cut && at.iter().all(|n| n % 2 == 0);
            seeds.push(Seed {
                position: at.map(|n| 0.5 * (n as f64 + 0.5)),
                volume: 0.125 * if less { CUT } else { 1.0 },
                density: material.density,
                part: 0,
            });
        }
        let model = SolidModel::new(1.0, &seeds);
        let law = SolidLaw {
            law: material.law,
            lambda: material.lambda(),
            mu: material.mu(),
            density: material.density,
            loss: 0.0,
        };
        let mut nodes = vec![NodeBlock::REST; model.node_blocks.len()];
        let wave = std::f64::consts::TAU / edge as f64;
        let moving: Vec<usize> = model.nodes().collect();
        for n in moving {
            let x = model.node_position(n).map(|x| wave * x);
            let u = [0.0, 1.0, 2.0].map(|phase: f64| {
                let u = (x[0] + phase).sin() * x[1].cos() + (x[2] + phase).sin();
                (0.5 * STRAIN / wave * u) as f32
            });
            write(&mut nodes[n / NODES].u, n, u);
        }
        let mut memory = vec![vec![]; model.point_blocks.len()];
        remember(&model, &[law], &mut memory);
        let dt = CFL * (law.density / law.tangent_at_rest()).sqrt();
        Self {
            isa,
            laws: [law],
            scratch: Scratch::new(&model),
            nodes,
            memory,
            model,
            step: Step {
                kick: dt as f32,
                drift: dt as f32,
                keep: 1.0,
                gravity: [0.0; 3],
                viscosity: 0.0,
                wants_extremes: false,
                wants_rate: false,
                knows_forces: false,
            },
        }
    }

    /// Quadrature points.
    pub fn points(&self) -> usize {
        8 * self.model.cells.len()
    }

    /// Takes substeps; whether every node is still somewhere.
    pub fn advance(&mut self, substeps: u32) -> bool {
        let mut good = true;
        for _ in 0..substeps {
            let found = substep(
                self.isa,
                &self.model,
                &self.laws,
                &self.scratch.conditions,
                Moving {
                    nodes: &mut self.nodes,
                    memory: &mut self.memory,
                    relaxing: None,
                },
                &mut self.scratch.tiles,
                &self.step,
            );
            good &= !found.bad;
        }
        good
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::materials::Law;

    #[test]
    fn a_block_goes_on_vibrating() {
        let metal = Law::VonMises {
            yield_stress: 1e4,
            hardening: 1e4,
        };
        for law in [Law::NeoHookean, Law::FixedCorotated, Law::Hencky, metal] {
            let material = Material {
                name: "tested".into(),
                law,
                youngs_modulus: 5e5,
                poisson_ratio: 0.3,
                density: 1000.0,
                loss: 0.0,
            };
            for cut in [0.0, 0.5, 1.0] {
                let mut block = VibratingBlock::new(Isa::detect(), &material, 5, cut);
                assert_eq!(block.points(), 1000);
                assert!(block.advance(200));
            }
        }
    }
}
