//! The fastest motion of a solid at rest, measured: what bounds its substep.
//!
//! The bound that holds wherever boundaries cut, `4.5 M / dx^2` with `M = 3 lambda + 2 mu`, is one and a half times what solids have, and
//! light nodes that follow others may make it more. So the largest eigenvalue of `M^-1 K` is found by Lanczos's method, with
//! the kernel's own forces at small displacements.

use super::{
    kernel::{Moving, SolidLaw, Step, Tiles, substep},
    model::SolidModel,
    nodes::{Conditions, NODES, NodeBlock, read, write},
};
use crate::simd::Isa;

/// Largest share of `3 lambda + 2 mu` over `rho dx^2` that contact may add to the squared frequency of a node.
pub(super) const CONTACT: f64 = 1.5;
/// Steps of Lanczos's method: its largest value is within 2 % then.
const STEPS: usize = 24;
/// Largest displacement [cells]: strains of a few thousandths, of which single precision knows four digits.
const SIZE: f64 = 1e-3;
/// What the method may miss.
const MISSED: f64 = 1.02;

/// Largest squared frequency of any motion about rest [1/s^2], if nothing is held.
pub(super) fn largest_squared_frequency(
    isa: Isa,
    model: &SolidModel,
    laws: &[SolidLaw],
    conditions: &Conditions,
    tiles: &mut Tiles,
) -> f64 {
    let inner: Vec<usize> = (0..model.mass.len())
        .filter(|&n| model.mass[n] > 0.0)
        .collect();
    let dot = |a: &[[f64; 3]], b: &[[f64; 3]]| -> f64 {
        let nodes = inner.iter().zip(a).zip(b);
        nodes
            .map(|((&n, a), b)| model.mass[n] * crate::mat3::dot(*a, *b))
            .sum()
    };
    // Neighbours move against each other, and not all by as much.
    let mut x: Vec<[f64; 3]> = inner
        .iter()
        .map(|&n| {
            let at = model.node_position(n);
            let sign = if at.iter().sum::<f64>().rem_euclid(2.0) < 0.5 {
                1.0
            } else {
                -1.0
            };
            let phase = at[0] + 1.7 * at[1] + 2.3 * at[2];
            [0.0, 1.0, 2.0].map(|a| sign * (1.0 + 0.5 * (phase + a).sin()))
        })
        .collect();
    let norm = dot(&x, &x).sqrt();
    x.iter_mut().flatten().for_each(|x| *x /= norm);
    let mut before = vec![[0.0; 3]; x.len()];
    let (mut diagonal, mut beside) = (vec![], vec![]);
    for step in 0..STEPS {
        let mut next = accelerations(isa, model, laws, (conditions, tiles), (&inner, &x));
        let alpha = dot(&x, &next);
        let beta = beside.last().copied().unwrap_or(0.0);
        for ((next, x), before) in next.iter_mut().zip(&x).zip(&before) {
            for a in 0..3 {
                next[a] -= alpha * x[a] + beta * before[a];
            }
        }
        diagonal.push(alpha);
        let norm = dot(&next, &next).sqrt();
        // Nothing is left to look at, but for round-off.
        if step + 1 == STEPS || norm <= 1e-6 * alpha.abs() {
            break;
        }
        beside.push(norm);
        next.iter_mut().flatten().for_each(|x| *x /= norm);
        before = std::mem::replace(&mut x, next);
    }
    MISSED * largest_eigenvalue(&diagonal, &beside)
}

/// `M^-1 K x` of inner nodes.
fn accelerations(
    isa: Isa,
    model: &SolidModel,
    laws: &[SolidLaw],
    (conditions, tiles): (&Conditions, &mut Tiles),
    (inner, x): (&[usize], &[[f64; 3]]),
) -> Vec<[f64; 3]> {
    let largest = x.as_flattened().iter().fold(0.0_f64, |m, x| m.max(x.abs()));
    let scale = SIZE / largest;
    let mut nodes = vec![NodeBlock::REST; model.node_blocks.len()];
    for (&n, x) in inner.iter().zip(x) {
        write(&mut nodes[n / NODES].u, n, x.map(|x| (scale * x) as f32));
    }
    model.extension.follow_displacements(&mut nodes);
    let step = Step {
        kick: 1.0,
        drift: 0.0,
        keep: 1.0,
        gravity: [0.0; 3],
        viscosity: 0.0,
        wants_extremes: false,
    };
    // Without memory matter is elastic, whatever it does beyond that.
    let moving = Moving {
        nodes: &mut nodes,
        memory: &mut vec![vec![]; model.point_blocks.len()],
    };
    substep(isa, model, laws, conditions, moving, tiles, &step);
    let of = |&n: &usize| read(&nodes[n / NODES].v, n).map(|v| -f64::from(v) / scale);
    inner.iter().map(of).collect()
}

/// Largest eigenvalue of a symmetric tridiagonal matrix, by bisection with Sturm's sequence.
fn largest_eigenvalue(diagonal: &[f64], beside: &[f64]) -> f64 {
    let at = |n: usize| beside.get(n).map_or(0.0, |b| b.abs());
    let reach = |n: usize| at(n) + if n > 0 { at(n - 1) } else { 0.0 };
    let bounds = diagonal.iter().enumerate();
    let mut high = bounds.fold(0.0_f64, |most, (n, d)| most.max(d + reach(n)));
    let mut low = diagonal.iter().copied().fold(0.0, f64::max);
    // Whether all eigenvalues are below a value: all pivots of the matrix less that are negative.
    let all_below = |value: f64| {
        let mut pivot = -1.0;
        diagonal.iter().enumerate().all(|(n, d)| {
            let before = if n > 0 {
                beside[n - 1].powi(2) / pivot
            } else {
                0.0
            };
            pivot = d - value - before;
            pivot < 0.0
        })
    };
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        match all_below(middle) {
            true => high = middle,
            false => low = middle,
        }
    }
    high
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn largest_eigenvalue_of_a_chain_is_known() {
        // 2 - 2 cos(k pi / (n + 1)), the largest at k = n.
        let n = 12;
        let exact = 2.0 - 2.0 * (std::f64::consts::PI * n as f64 / (n + 1) as f64).cos();
        let found = largest_eigenvalue(&vec![2.0; n], &vec![-1.0; n - 1]);
        assert!((found - exact).abs() < 1e-12, "{found} {exact}");
    }
}
