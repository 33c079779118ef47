//! What matter loses: the decrement of first modes, rigid motion, and the account of energy.

use super::{DENSITY, Owned, lattice, law, nodes_where};
use crate::{
    first_mode::FirstMode,
    mat3::{cross, length},
    materials::Law,
};

const LOSS: f64 = 0.05;

/// A bar 16 times as long as it is thick, of matter that loses energy.
fn bar(cells: usize, length: usize) -> Owned {
    let dx = 0.1 / cells as f64;
    let seeds = lattice(dx, [0.0; 3], [length * cells, cells, cells], |_| true);
    let mut law = law(Law::NeoHookean, 1e6, 0.3, DENSITY);
    law.loss = LOSS;
    Owned::new(dx, &seeds, law)
}

/// Frequency of a first mode and its logarithmic decrement, by the largest deflections of the tip over some periods; the motion begins
/// with deflection velocities of the shape `w`, of frequency `omega` [rad/s].
fn ring(bar: &mut Owned, omega: f64, w: impl Fn(f64) -> f64) -> (f64, f64) {
    let held = bar.scratch.held.clone();
    bar.state.change_velocities(&bar.model, |slot, _| {
        let x = bar.model.node_in_world(slot);
        let moves = if held.contains(&slot) { 0.0 } else { 1.0 };
        [0.0, moves * 0.002 * omega * w(x[0]), 0.0]
    });
    let end = bar.model.nodes().map(|n| bar.model.node_in_world(n)[0]);
    let end = end.fold(0.0, f64::max) - 1.5 * bar.model.dx;
    let at = [end + bar.model.dx - 1e-9, 0.05 - 1e-9, 0.05 - 1e-9];
    let tip = bar.model.site_near(at).expect("in the bar");
    let rest = bar.state.sample(&bar.model, &tip).x[1];
    let step = std::f64::consts::TAU / omega / 64.0;
    let mut way = vec![];
    for _ in 0..8 * 64 {
        bar.advance(step);
        way.push(bar.state.sample(&bar.model, &tip).x[1] - rest);
    }
    // Turning points, of which higher modes may make several close to each other: each from the middle of its neighbours, so that drift
    // does not count.
    let mut turns: Vec<(f64, f64)> = vec![];
    for n in 1..way.len() - 1 {
        let (a, b, c) = (way[n - 1], way[n], way[n + 1]);
        let is_near = turns.last().is_some_and(|turn| n as f64 - turn.0 < 8.0);
        if (b - a) * (c - b) <= 0.0 && b != a && !is_near {
            let off = 0.5 * (a - c) / (a - 2.0 * b + c);
            turns.push((n as f64 + off, b - 0.25 * (a - c) * off));
        }
    }
    let sizes = turns
        .windows(3)
        .map(|t| (t[1].1 - 0.5 * (t[0].1 + t[2].1)).abs());
    let sizes: Vec<f64> = sizes.collect();
    let (first, last) = (turns[1].0, turns[turns.len() - 2].0);
    let count = 0.5 * (sizes.len() - 1) as f64;
    let period = step * (last - first) / count;
    let decrement = (sizes[0] / sizes[sizes.len() - 1]).ln() / count;
    (std::f64::consts::TAU / period, decrement)
}

/// Euler's shape of the first mode of a free bar over its length.
fn free_shape(s: f64) -> (f64, f64) {
    let beta = 4.730_040_74_f64;
    let r = (beta.cos() - beta.cosh()) / (beta.sin() - beta.sinh());
    let x = beta * s;
    (x.cosh() + x.cos() - r * (x.sinh() + x.sin()), beta)
}

fn clamped_shape(s: f64) -> (f64, f64) {
    let beta = 1.875_104_07_f64;
    let r = (beta.cos() + beta.cosh()) / (beta.sin() + beta.sinh());
    let x = beta * s;
    (x.cosh() - x.cos() - r * (x.sinh() - x.sin()), beta)
}

fn euler(beta: f64, length: f64) -> f64 {
    (beta / length).powi(2) * (1e6 * 0.01 / 12.0 / DENSITY).sqrt()
}

#[test]
fn first_modes_shrink_by_pi_times_the_loss_factor() {
    let asked = std::f64::consts::PI * LOSS;
    for (cells, slenderness) in [(2, 16), (4, 8)] {
        let length = 0.1 * slenderness as f64;
        let mut free = bar(cells, slenderness);
        let (_, beta) = free_shape(0.0);
        let (omega, decrement) = ring(&mut free, euler(beta, length), |x| free_shape(x / length).0);
        let found = FirstMode::new(&free.model, &free.laws, &[], [].into_iter());
        let mut clamped = bar(cells, slenderness);
        let dx = clamped.model.dx;
        let held = nodes_where(&clamped.model, |x| x[0] < 0.6 * dx);
        clamped.scratch.hold(&clamped.model, held.clone());
        let (_, beta) = clamped_shape(0.0);
        let (omega2, decrement2) = ring(&mut clamped, euler(beta, length), |x| {
            clamped_shape(x / length).0
        });
        let found2 = FirstMode::new(&clamped.model, &clamped.laws, &held, [].into_iter());
        for (found, omega, decrement) in [(found, omega, decrement), (found2, omega2, decrement2)] {
            assert!(
                (found.omega / omega - 1.0).abs() < 0.03,
                "{} {omega}",
                found.omega
            );
            assert!(
                (decrement / asked - 1.0).abs() < 0.03,
                "{decrement} {asked}"
            );
        }
    }
}

#[test]
fn rigid_motion_goes_on() {
    let (v, spin) = ([0.3, -0.2, 0.5], [1.0, -2.0, 0.5]);
    let mut cube = bar(4, 1);
    cube.state.change_velocities(&cube.model, |slot, _| {
        let x = cube.model.node_in_world(slot);
        let turn = cross(spin, std::array::from_fn(|a| x[a] - 0.05));
        std::array::from_fn(|a| v[a] + turn[a])
    });
    let momenta = |cube: &Owned| {
        let sums = cube.sums();
        let com = sums.moment.map(|m| m / cube.model.total_mass);
        let orbit = cross(com, sums.momentum);
        let own = std::array::from_fn(|a| sums.angular[a] - orbit[a]);
        [sums.momentum, own]
    };
    let before = momenta(&cube);
    for _ in 0..100 {
        cube.advance(0.01);
    }
    // A turn of 130 degrees, in single precision.
    for (then, now) in before.into_iter().zip(momenta(&cube)) {
        let change = length(std::array::from_fn(|a| now[a] - then[a]));
        assert!(change < 5e-6 * length(then), "{then:?} {now:?}");
    }
}

#[test]
fn what_is_lost_is_booked() {
    let mut bar = bar(2, 16);
    let (_, beta) = free_shape(0.0);
    let period = std::f64::consts::TAU / euler(beta, 1.6);
    bar.state.change_velocities(&bar.model, |slot, _| {
        let x = bar.model.node_in_world(slot);
        [0.0, 0.05 * free_shape(x[0] / 1.6).0, 0.0]
    });
    let before = bar.sums();
    let mut lost = 0.0;
    for _ in 0..300 {
        bar.scratch.dissipation.lost = 0.0;
        bar.advance(0.1 * period);
        lost += bar.scratch.dissipation.lost;
    }
    let after = bar.sums();
    let gap = before.kinetic - (after.kinetic + after.elastic + lost);
    assert!(lost > 0.9 * before.kinetic, "{lost} {}", before.kinetic);
    assert!(
        gap.abs() < 0.005 * before.kinetic,
        "{gap} {}",
        before.kinetic
    );
}
