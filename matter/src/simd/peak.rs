//! Multiply-adds and nothing else: what a processor does at most.

use std::hint::black_box;

use super::{Isa, LANES, Lanes, on_isa};

/// Does `rounds` rounds of independent fused multiply-adds; how many floating-point operations these were, two each.
pub fn multiply_adds(isa: Isa, rounds: u32) -> f64 {
    // As many as fit in registers.
    let chains = match isa {
        Isa::Avx512 => 12,
        Isa::Avx2 | Isa::Portable => 6,
    };
    chains_with_isa(isa, chains, rounds);
    2.0 * (LANES * chains) as f64 * f64::from(rounds)
}

on_isa! {
    fn chains_with_isa = either(chains: usize, rounds: u32)
}

#[inline(always)]
fn either<V: Lanes>(chains: usize, rounds: u32) {
    match chains {
        12 => run::<V, 12>(rounds),
        _ => run::<V, 6>(rounds),
    }
}

#[inline(always)]
fn run<V: Lanes, const CHAINS: usize>(rounds: u32) {
    let (factor, term) = (
        V::broadcast(black_box(0.999)),
        V::broadcast(black_box(1e-3)),
    );
    let mut sums = [term; CHAINS];
    for _ in 0..rounds {
        for n in 0..CHAINS {
            sums[n] = sums[n].mul_add(factor, term);
        }
    }
    for sum in sums {
        black_box(sum.largest_magnitude_bits());
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn operations_are_counted() {
        assert_eq!(multiply_adds(Isa::Portable, 10), 2.0 * 16.0 * 6.0 * 10.0);
    }
}
