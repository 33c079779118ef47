//! Symmetric positive definite matrices by rows, each from its first entry that is not zero up to the diagonal, and their Cholesky factors,
//! which have no entries elsewhere (Jennings 1966).

use std::ops::Range;

use crate::simd::{Isa, Lanes, on_isa};

/// Sums that a product of rows is gathered in: a fixed number, so that every instruction set has the same bits.
const SUMS: usize = 8;

/// The lower triangle of a matrix, or of its factor.
#[derive(Clone, Debug, Default)]
pub(super) struct Skyline {
    /// Columns of every row that are kept, the diagonal included.
    columns: Vec<Range<usize>>,
    /// Where every row begins among the entries.
    starts: Vec<usize>,
    entries: Vec<f64>,
}

impl Skyline {
    /// All zero, with the first column of every row.
    pub fn new(firsts: impl Iterator<Item = usize>) -> Self {
        let columns: Vec<_> = firsts.enumerate().map(|(r, first)| first..r + 1).collect();
        let mut starts = vec![];
        let mut count = 0;
        for row in &columns {
            starts.push(count);
            count += row.len();
        }
        Self {
            columns,
            starts,
            entries: vec![0.0; count],
        }
    }

    /// An entry on or below the diagonal that is kept.
    pub fn entry(&mut self, row: usize, column: usize) -> &mut f64 {
        let at = self.starts[row] + column - self.columns[row].start;
        &mut self.entries[at]
    }

    /// Columns of a row from `from` on, before `to`.
    fn part(&self, row: usize, columns: Range<usize>) -> &[f64] {
        let before = self.starts[row] - self.columns[row].start;
        &self.entries[before + columns.start..before + columns.end]
    }

    /// Replaces the matrix by its factor `L`, with one over the diagonal.
    pub fn factorise(&mut self, isa: Isa) {
        factorise_with_isa(isa, self);
    }

    /// Solves `L L^T x = b` in place, of a factor.
    pub fn solve(&self, isa: Isa, b: &mut [f64]) {
        solve_with_isa(isa, self, b);
    }
}

on_isa! {
    fn factorise_with_isa = factorise(matrix: &mut Skyline)
}

on_isa! {
    fn solve_with_isa = solve(factor: &Skyline, b: &mut [f64])
}

#[expect(
    clippy::extra_unused_type_parameters,
    reason = "compiled once per instruction set"
)]
#[inline(always)]
fn factorise<L: Lanes>(matrix: &mut Skyline) {
    for row in 0..matrix.columns.len() {
        let first = matrix.columns[row].start;
        for column in first..=row {
            let shared = first.max(matrix.columns[column].start)..column;
            let known = product(
                matrix.part(row, shared.clone()),
                matrix.part(column, shared.clone()),
            );
            let diagonal = *matrix.entry(column, column);
            let entry = matrix.entry(row, column);
            *entry = match column < row {
                true => (*entry - known) * diagonal,
                false => (*entry - known).sqrt().recip(),
            };
        }
    }
}

#[expect(
    clippy::extra_unused_type_parameters,
    reason = "compiled once per instruction set"
)]
#[inline(always)]
fn solve<L: Lanes>(factor: &Skyline, b: &mut [f64]) {
    for (row, columns) in factor.columns.iter().enumerate() {
        let before = columns.start..row;
        let known = product(factor.part(row, before.clone()), &b[before]);
        b[row] = (b[row] - known) * factor.part(row, row..row + 1)[0];
    }
    for (row, columns) in factor.columns.iter().enumerate().rev() {
        let before = columns.start..row;
        let x = b[row] * factor.part(row, row..row + 1)[0];
        b[row] = x;
        let factors = factor.part(row, before.clone());
        for (b, l) in b[before].iter_mut().zip(factors) {
            *b -= l * x;
        }
    }
}

#[inline(always)]
fn product(a: &[f64], b: &[f64]) -> f64 {
    let mut sums = [0.0; SUMS];
    let (a, b) = (a.chunks_exact(SUMS), b.chunks_exact(SUMS));
    let ends = a.remainder().iter().zip(b.remainder());
    let end: f64 = ends.map(|(a, b)| a * b).sum();
    for (a, b) in a.zip(b) {
        for n in 0..SUMS {
            sums[n] += a[n] * b[n];
        }
    }
    sums.iter().sum::<f64>() + end
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A membrane of `n` x `n` nodes, held at its edge.
    fn stiffness(n: usize, row: usize, column: usize) -> f64 {
        let at = |k: usize| [(k / n) as i64, (k % n) as i64];
        let ([a, b], [c, d]) = (at(row), at(column));
        match (a - c).abs() + (b - d).abs() {
            0 => 4.0,
            1 => -1.0,
            _ => 0.0,
        }
    }

    #[test]
    fn factor_solves_what_the_matrix_says() {
        let bits: Vec<Vec<u64>> = Isa::ALL
            .into_iter()
            .filter(|isa| isa.is_available())
            .map(factor_and_solve)
            .collect();
        assert!(bits.iter().all(|x| *x == bits[0]));
    }

    /// Bits of the answer.
    fn factor_and_solve(isa: Isa) -> Vec<u64> {
        let n = 12_usize;
        let mut factor = Skyline::new((0..n * n).map(|row| row.saturating_sub(n)));
        for row in 0..n * n {
            for column in row.saturating_sub(n)..=row {
                *factor.entry(row, column) = stiffness(n, row, column);
            }
        }
        factor.factorise(isa);
        let expected: Vec<f64> = (0..n * n).map(|k| (k as f64).sin()).collect();
        let row_of = |row| -> f64 {
            let terms = expected.iter().enumerate();
            terms.map(|(c, x)| stiffness(n, row, c) * x).sum()
        };
        let mut x: Vec<f64> = (0..n * n).map(row_of).collect();
        factor.solve(isa, &mut x);
        for (x, expected) in x.iter().zip(&expected) {
            // Rounding times the condition of the matrix, about n^2.
            assert!((x - expected).abs() < 1e-13, "{x} {expected}");
        }
        x.iter().map(|x| x.to_bits()).collect()
    }
}
