//! Matter that flows: a tension test, a crushed block, and vibration of what has flowed.

use super::{super::memory::largest_strain, DENSITY, Owned, lattice, law, nodes_where};
use crate::{
    mat3::{Mat3, length},
    materials::Law,
    model::CellPoint,
    nodes::write,
};

const METAL: Law = Law::VonMises {
    yield_stress: 2e4,
    hardening: 2e5,
};
const E: f64 = 1e6;

fn block(which: Law, cells: [usize; 3]) -> Owned {
    let seeds = lattice(0.1, [0.0; 3], cells, |_| true);
    Owned::new(0.1, &seeds, law(which, E, 0.3, DENSITY))
}

/// Pulls the ends of a bar apart, or lets them come back, by a strain in a span [s].
fn pull(bar: &mut Owned, length: f64, strain: f64, span: f64) {
    let speed = 0.5 * strain * length / span;
    let held = bar.scratch.held.clone();
    let steps = (span / 0.05).round().max(1.0) as usize;
    for _ in 0..steps {
        let given = |n: usize| {
            let x = bar.model.node_in_world(held[n])[0];
            [if x < 0.5 * length { -speed } else { speed }, 0.0, 0.0]
        };
        let given: Vec<[f64; 3]> = (0..held.len()).map(given).collect();
        let outside = bar.outside;
        assert!(super::advance_alone(
            &mut bar.solid(),
            &outside,
            span / steps as f64,
            &given
        ));
    }
}

/// Tension along x is uniaxial in the middle of a long bar: `E (total - alpha) = yield_stress + hardening alpha`.
#[test]
fn pulled_bar_flows_as_a_tension_test_says() {
    let mut bar = block(METAL, [20, 3, 3]);
    bar.outside.damping = 10.0;
    let held = nodes_where(&bar.model, |x| !(0.1..=1.9).contains(&x[0]));
    bar.scratch.hold(&bar.model, held);
    let middle = [1.0 - 1e-6, 0.15, 0.15];
    let site = bar.model.site(middle, middle).expect("in the bar");
    let total = |bar: &Owned| {
        let f = Mat3(bar.state.sample(&bar.model, &site).f);
        0.5 * f.mul_transposed_sym(&f)[0].ln()
    };
    pull(&mut bar, 2.0, 0.2, 2.0);
    pull(&mut bar, 2.0, 0.0, 1.0);
    let (strain, alpha) = (total(&bar), flowed(&bar, &site));
    let expected = (strain - 2e4 / E) / (1.0 + 2e5 / E);
    // Waves of the ends' motion, a hundredth of the yield strain, and the ends' own constraint.
    assert!((alpha / expected - 1.0).abs() < 0.02, "{alpha} {expected}");
    // Half of the elastic strain back: nothing flows.
    let elastic = strain - alpha;
    pull(&mut bar, 2.0, -0.5 * elastic, 1.0);
    assert!((flowed(&bar, &site) - alpha).abs() < 1e-5);
    assert!(total(&bar) < strain - 0.3 * elastic);
}

/// Equivalent plastic strain of the cell at a site.
fn flowed(bar: &Owned, site: &CellPoint) -> f64 {
    let memory = &bar.state.memory[site.block as usize][0];
    let points = (0..8).map(|n| memory.point(site.number, n).memory);
    points.sum::<f64>() / 8.0
}

/// Volume of all points [m^3].
fn volume(solid: &Owned) -> f64 {
    let mut sum = 0.0;
    for (n, block) in solid.model.point_blocks.iter().enumerate() {
        for cell in &solid.model.cells[block.cells.clone()] {
            for (point, volume) in cell.volumes.into_iter().enumerate() {
                let site = CellPoint {
                    block: n as u32,
                    number: cell.number,
                    d: super::super::model::gauss_point(point),
                };
                let f = Mat3(solid.state.sample(&solid.model, &site).f);
                sum += f64::from(volume) * f.det();
            }
        }
    }
    sum * solid.model.dx.powi(3)
}

#[test]
fn crushed_block_keeps_its_volume_and_its_momentum() {
    let laws = [
        METAL,
        Law::Plasticine {
            yield_stress: 2e4,
            softening: 1e3,
        },
        Law::Foam {
            yield_stress: 1e4,
            viscosity: 200.0,
            exponent: 0.8,
        },
    ];
    for which in laws {
        let mut block = block(which, [6, 6, 6]);
        // Inwards along x as fast as bends it to plastic strains of some tenths, and a drift and a spin.
        block.state.change_velocities(&block.model, |slot, _| {
            let x = block.model.node_in_world(slot).map(|x| x - 0.3);
            [-40.0 * x[0] + 2.0 * x[1] + 3.0, -2.0 * x[0] + 1.0, -2.0]
        });
        let before = block.sums();
        let mut kept = 0.0;
        for n in 0..40 {
            block.advance(0.005);
            if n >= 20 {
                kept += volume(&block) / 0.216 / 20.0;
            }
        }
        let after = block.sums();
        let strain = largest_strain(&block.state.memory);
        assert!((0.1..3.0).contains(&strain), "{which:?}: {strain}");
        // Round-off of displacements of a few cells in single precision.
        for a in 0..3 {
            let gained = (after.momentum[a] - before.momentum[a]).abs();
            assert!(gained < 1e-6 * length(before.momentum), "{which:?}");
            let turned = (after.angular[a] - before.angular[a]).abs();
            assert!(
                turned < 2e-6 * length(before.angular),
                "{which:?}: {turned}"
            );
        }
        // Flow keeps the volume; what swings about it is elastic, some kPa of a bulk modulus of 0.8 MPa.
        assert!((kept - 1.0).abs() < 0.01, "{which:?}: {kept}");
        let energy = |s: &super::Sums| s.kinetic + s.elastic;
        assert!(energy(&after) < 0.9 * energy(&before), "{which:?}");
    }
}

#[test]
fn what_has_flowed_keeps_its_new_shape_and_vibrates() {
    let mut bar = block(METAL, [12, 3, 3]);
    let f = Mat3::diagonal([1.3_f64, 1.3_f64.powf(-0.5), 1.3_f64.powf(-0.5)]);
    for slot in bar.model.nodes().collect::<Vec<_>>() {
        let x = bar.model.node_in_world(slot);
        let y = f.mul_vec(x);
        let u = std::array::from_fn(|a| ((y[a] - x[a]) / 0.1) as f32);
        write(&mut bar.state.nodes[slot / 64].u, slot, u);
    }
    // The stretch flows at once but for the elastic strain, which vibrates then.
    bar.advance(1e-3);
    let start = bar.sums();
    let (start, alpha) = (
        start.kinetic + start.elastic,
        largest_strain(&bar.state.memory),
    );
    // 3 mu (total - alpha) = yield_stress + hardening alpha
    let three_mu = 3.0 * E / 2.6;
    let expected = (three_mu * 1.3_f64.ln() - 2e4) / (three_mu + 2e5);
    // Round-off of one substep, and what the next flow.
    assert!((alpha / expected - 1.0).abs() < 1e-3, "{alpha} {expected}");
    for _ in 0..50 {
        bar.advance(0.02);
    }
    let end = bar.sums();
    let kept = (end.kinetic + end.elastic) / start;
    // It yields a little more where waves meet, and is elastic otherwise.
    assert!((0.3..1.001).contains(&kept), "{kept}");
    // Leapfrog's energy swings where much of it is in fast motions: by 3 %, so it is averaged.
    let mut mean = || {
        let mut sum = 0.0;
        for _ in 0..20 {
            bar.advance(0.013);
            let sums = bar.sums();
            sum += 0.05 * (sums.kinetic + sums.elastic);
        }
        sum
    };
    let means: [f64; 4] = std::array::from_fn(|_| mean());
    let most = means.into_iter().fold(0.0, f64::max);
    assert!(most < 1.02 * means[0], "{means:?} {kept}");
    bar.outside.damping = 20.0;
    bar.advance(1.0);
    let middle = [0.6 - 1e-6, 0.15, 0.15];
    let site = bar.model.site(middle, middle).expect("in the bar");
    let now = bar.state.sample(&bar.model, &site).f[0][0];
    // At rest it is as long as it has flowed.
    assert!((now / expected.exp() - 1.0).abs() < 0.03, "{now}");
}
