//! Points that flow: the closed form, an elastic way back, bits, and blocks that pay nothing.

use super::*;
use crate::{
    materials::testing::extension,
    memory::{PartMemory, largest_strain, remember},
};

const METAL: Law = Law::VonMises {
    yield_stress: 5e3,
    hardening: 1e5,
};
const FLOWING: [Law; 4] = [
    METAL,
    Law::Plasticine {
        yield_stress: 1e4,
        softening: 2e4,
    },
    Law::Foam {
        yield_stress: 3e3,
        viscosity: 100.0,
        exponent: 1.0,
    },
    Law::Foam {
        yield_stress: 3e3,
        viscosity: 100.0,
        exponent: 0.5,
    },
];

/// A substep that moves nothing, in which matter flows.
const STANDING: Step = Step {
    kick: 1e-6,
    wants_extremes: true,
    ..PLAIN
};

fn flowing(law: Law, cells: [usize; 3]) -> Solid {
    let mut solid = Solid::full(law, cells);
    remember(&solid.model, &solid.laws, &mut solid.memory);
    solid
}

/// Stretches a solid along x at constant volume.
fn stretch(solid: &mut Solid, strain: f64) {
    let f = extension(strain).sub(&Mat3::identity());
    solid.displace(|x| f.mul_vec(x));
}

fn energy_of(solid: &Solid) -> f64 {
    let Solid {
        model,
        laws,
        nodes,
        memory,
        ..
    } = solid;
    elastic_energy(Isa::detect(), model, laws, nodes, memory)
}

#[test]
fn metal_flows_along_its_line_and_unloads_elastically() {
    let mut solid = flowing(METAL, [4, 3, 5]);
    let three_mu = 3.0 * MU;
    let alpha = |total: f64| ((three_mu * total - 5e3) / (three_mu + 1e5)).max(0.0);
    let mut strain = 0.0;
    for _ in 0..50 {
        strain += 0.01;
        stretch(&mut solid, strain);
        solid.substep(Isa::detect(), &STANDING);
        // Round-off of fifty steps in single precision.
        assert!((largest_strain(&solid.memory) - alpha(strain)).abs() < 1e-5);
    }
    // Back by less than twice the elastic strain: nothing flows, and the energy is that of what is left.
    let after = solid.memory.clone();
    let elastic = strain - alpha(strain);
    for back in [0.5, 1.0, 1.5] {
        stretch(&mut solid, strain - back * elastic);
        solid.substep(Isa::detect(), &STANDING);
        assert!(solid.memory == after);
        let left = (1.0 - back) * elastic;
        let expected = 0.5 * three_mu * left * left * 60.0;
        let scale = 0.5 * three_mu * elastic * elastic * 60.0;
        // Strains to 1e-6 of which the energy is quadratic.
        assert!((energy_of(&solid) - expected).abs() < 1e-4 * scale);
    }
}

#[test]
fn looking_and_measuring_flow_nothing() {
    for law in FLOWING {
        let mut solid = flowing(law, [4, 4, 4]);
        solid.displace(bent);
        let look = Step {
            wants_extremes: true,
            ..PLAIN
        };
        solid.substep(Isa::detect(), &look);
        assert!(solid.largest_tangent() > 0.0);
        let _ = (solid.squared_frequency(), energy_of(&solid));
        assert_eq!(largest_strain(&solid.memory), 0.0);
        let slow = Step {
            kick: 1e-2,
            ..STANDING
        };
        solid.substep(Isa::detect(), &slow);
        assert!(largest_strain(&solid.memory) > 0.01);
    }
}

#[test]
fn frequency_about_rest_is_that_of_elastic_matter() {
    let elastic = Solid::full(Law::Hencky, [5, 4, 4]).squared_frequency();
    for law in FLOWING {
        // Strains of the measurement are beyond the yield of many metals: they do not matter.
        assert_eq!(flowing(law, [5, 4, 4]).squared_frequency(), elastic);
    }
}

#[test]
fn bits_of_flow_do_not_depend_on_isa_or_threads() {
    for law in FLOWING {
        let mut solid = Solid::new(&[law, Law::NeoHookean], [9, 7, 6], random_volumes(9), |c| {
            u16::from(c[0] > 6)
        });
        remember(&solid.model, &solid.laws, &mut solid.memory);
        solid.displace(bent);
        let run = |isa: Isa, threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
            let mut solid = solid.clone();
            pool.expect("threads").install(|| {
                for n in 0..12 {
                    let step = Step {
                        kick: 8e-3,
                        drift: 8e-3,
                        viscosity: if n % 3 == 2 { 1e-3 } else { 0.0 },
                        wants_extremes: n % 4 == 0,
                        ..PLAIN
                    };
                    solid.substep(isa, &step);
                }
            });
            let nodes = bytemuck::cast_slice::<_, u32>(&solid.nodes).to_vec();
            let points: Vec<PartMemory> = solid.memory.into_iter().flatten().collect();
            (nodes, bytemuck::cast_slice::<_, u32>(&points).to_vec())
        };
        let expected = run(Isa::Portable, 1);
        assert!(expected.1.iter().any(|&bits| bits != 0));
        for isa in Isa::ALL.into_iter().filter(|isa| isa.is_available()) {
            for threads in [1, 3] {
                assert!(run(isa, threads) == expected, "{law:?} {isa} {threads}");
            }
        }
    }
}

#[test]
fn elastic_blocks_remember_nothing_beside_flow() {
    let mut solid = Solid::new(
        &[Law::NeoHookean, METAL],
        [8, 4, 4],
        || 0.125,
        |c| u16::from(c[0] > 3),
    );
    remember(&solid.model, &solid.laws, &mut solid.memory);
    let parts: Vec<usize> = solid.memory.iter().map(Vec::len).collect();
    assert_eq!(parts, [0, 1]);
}

#[test]
fn forces_of_flow_sum_to_nothing_and_are_finite() {
    for law in FLOWING {
        let mut solid = flowing(law, [6, 5, 4]);
        for size in [1.0, -4.0] {
            solid.displace(|x| bent(x).map(|u| size * u));
            let (forces, [tangent, _]) = solid.forces(Isa::detect(), 0.1);
            assert!(tangent.is_finite() && tangent > 0.0);
            for a in 0..3 {
                let sum: f64 = forces.iter().map(|f| f64::from(f[a])).sum();
                let all: f64 = forces.iter().map(|f| f64::from(f[a]).abs()).sum();
                // Round-off of single forces, 6e-8, which mostly cancels.
                assert!(sum.abs() < 1e-6 * all, "{sum:e} of {all:e}");
            }
        }
    }
}
