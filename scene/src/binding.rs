//! Binding: which particles a Gaussian follows, and how much.

use std::ops::Range;

use cosplat_sim_core::scene::{BINDING_NEIGHBORS, Binding};
use rayon::prelude::*;

/// Binds every Gaussian to its nearest particles, at most [`BINDING_NEIGHBORS`] of them.
///
/// `gaussians` are centres and `particles` positions at rest, in the same frame and unit; `spacing` is the mean
/// distance of particles, > 0. Indices in the result start at `first`, the index of the first particle in the
/// scene. Weights fall smoothly to zero at the distance of the farthest neighbour, so that neighbouring Gaussians
/// follow nearly the same motion. Without particles every weight is 0.
///
/// Work grows with the number of Gaussians times the particles within about one spacing of each.
pub fn bind(gaussians: &[[f32; 3]], particles: &[[f64; 3]], spacing: f64, first: usize) -> Binding {
    let cells = Cells::new(particles, spacing);
    let bound: Vec<_> = gaussians
        .par_iter()
        .map(|center| bind_one(center.map(f64::from), particles, &cells))
        .map(|(ids, weights)| (ids.map(|id| id + first as u32), weights))
        .collect();
    let (particle, weight) = bound.into_iter().unzip();
    Binding { particle, weight }
}

fn bind_one(
    center: [f64; 3],
    particles: &[[f64; 3]],
    cells: &Cells,
) -> ([u32; BINDING_NEIGHBORS], [f32; BINDING_NEIGHBORS]) {
    // One more than needed: the distance of the first that is left out is where weights end.
    let mut near = cells.nearest(center, particles, BINDING_NEIGHBORS + 1);
    let Some(&(nearest, _)) = near.first() else {
        return ([0; BINDING_NEIGHBORS], [0.0; BINDING_NEIGHBORS]);
    };
    let reach = match near.len() {
        n if n > BINDING_NEIGHBORS => near[n - 1].0,
        // Fewer particles than slots: all of them count.
        n => 4.0 * near[n - 1].0,
    };
    near.truncate(BINDING_NEIGHBORS);
    let mut ids = [near[0].1; BINDING_NEIGHBORS];
    let mut weights = [0.0; BINDING_NEIGHBORS];
    // On equal distances nothing would be left: then the nearest ones share.
    let flat = nearest >= reach;
    for (slot, &(distance, id)) in near.iter().enumerate() {
        let falloff = if flat { 1.0 } else { 1.0 - distance / reach };
        ids[slot] = id;
        weights[slot] = falloff * falloff;
    }
    let sum: f64 = weights.iter().sum();
    (ids, weights.map(|w| (w / sum) as f32))
}

/// Particles sorted by cubic cell, rows of cells along x contiguous.
struct Cells {
    size: f64,
    min: [i64; 3],
    max: [i64; 3],
    /// `(z, y, x)` of the cell and the particle in it, ascending.
    sorted: Vec<([i64; 3], u32)>,
}

impl Cells {
    fn new(particles: &[[f64; 3]], size: f64) -> Cells {
        let mut sorted: Vec<_> = particles
            .iter()
            .enumerate()
            .map(|(id, p)| (cell(*p, size), id as u32))
            .collect();
        sorted.sort_unstable();
        let mut min = [i64::MAX; 3];
        let mut max = [i64::MIN; 3];
        for (cell, _) in &sorted {
            for a in 0..3 {
                min[a] = min[a].min(cell[a]);
                max[a] = max[a].max(cell[a]);
            }
        }
        Cells {
            size,
            min,
            max,
            sorted,
        }
    }

    /// The `count` nearest particles as `(squared distance, id)`, nearest first; ties by id.
    fn nearest(&self, x: [f64; 3], particles: &[[f64; 3]], count: usize) -> Vec<(f64, u32)> {
        if self.sorted.is_empty() {
            return vec![];
        }
        let home = cell(x, self.size);
        // A Gaussian far outside starts with the ring that reaches the nearest particles.
        let outside = (0..3).map(|a| (self.min[a] - home[a]).max(home[a] - self.max[a]).max(0));
        let mut ring = outside.max().unwrap_or(0).saturating_add(1);
        loop {
            let low: [i64; 3] = std::array::from_fn(|a| (home[a] - ring).max(self.min[a]));
            let high: [i64; 3] = std::array::from_fn(|a| (home[a] + ring).min(self.max[a]));
            let all = low == self.min && high == self.max;
            let mut found = self.within(low, high, x, particles);
            found.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
            // Whatever is farther away than this may have a nearer rival outside the ring.
            let certain = (ring as f64 * self.size).powi(2);
            let complete = found.len() >= count && found[count - 1].0 <= certain;
            if all || complete {
                found.truncate(count);
                return found;
            }
            ring = ring.saturating_mul(2);
        }
    }

    fn within(
        &self,
        low: [i64; 3],
        high: [i64; 3],
        x: [f64; 3],
        particles: &[[f64; 3]],
    ) -> Vec<(f64, u32)> {
        let mut found = Vec::new();
        for z in low[0]..=high[0] {
            for y in low[1]..=high[1] {
                for &(_, id) in &self.sorted[self.row(z, y, low[2]..high[2] + 1)] {
                    let p = particles[id as usize];
                    let squared = (0..3).map(|a| (p[a] - x[a]).powi(2)).sum();
                    found.push((squared, id));
                }
            }
        }
        found
    }

    fn row(&self, z: i64, y: i64, x: Range<i64>) -> Range<usize> {
        let at = |cell: [i64; 3]| self.sorted.partition_point(|(c, _)| *c < cell);
        at([z, y, x.start])..at([z, y, x.end])
    }
}

/// Cell of a point as `(z, y, x)`; points beyond any sane scene share the outermost cells.
fn cell(x: [f64; 3], size: f64) -> [i64; 3] {
    let index = |v: f64| (v / size).floor().clamp(-1e9, 1e9) as i64;
    [index(x[2]), index(x[1]), index(x[0])]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A lattice of `n^3` particles with unit spacing.
    fn lattice(n: usize) -> Vec<[f64; 3]> {
        let axis = || 0..n;
        axis()
            .flat_map(|x| axis().flat_map(move |y| axis().map(move |z| [x, y, z])))
            .map(|p| p.map(|c| c as f64))
            .collect()
    }

    #[test]
    fn neighbours_are_those_of_a_brute_force_search() {
        let particles = lattice(6);
        let cells = Cells::new(&particles, 1.0);
        for x in [
            [2.3, 2.1, 3.4],
            [-4.0, 2.2, 9.1],
            [0.1, 0.2, 0.3],
            [40.0, 1.1, 2.0],
        ] {
            let mut expected: Vec<(f64, u32)> = particles
                .iter()
                .enumerate()
                .map(|(id, p)| ((0..3).map(|a| (p[a] - x[a]).powi(2)).sum(), id as u32))
                .collect();
            expected.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
            expected.truncate(9);
            assert_eq!(cells.nearest(x, &particles, 9), expected, "{x:?}");
        }
    }

    #[test]
    fn weights_sum_to_one_and_indices_start_at_first() {
        let particles = lattice(4);
        let gaussians = [
            [1.2, 1.3, 1.4],
            [1.5, 1.5, 1.5],
            [1.0, 1.0, 1.0],
            [-7.0, 0.0, 0.0],
        ];
        let binding = bind(&gaussians, &particles, 1.0, 100);
        for (ids, weights) in binding.particle.iter().zip(&binding.weight) {
            // Eight roundings of numbers up to 1.
            assert!((weights.iter().sum::<f32>() - 1.0).abs() < 8.0 * f32::EPSILON);
            assert!(weights.iter().all(|w| *w >= 0.0));
            assert!(ids.iter().all(|id| (100..164).contains(id)));
        }
    }

    #[test]
    fn few_particles_and_none_are_bound_too() {
        let one = bind(&[[3.0, 0.0, 0.0]], &[[0.0; 3]], 1.0, 5);
        assert_eq!(one.particle[0], [5; BINDING_NEIGHBORS]);
        assert_eq!(one.weight[0].iter().sum::<f32>(), 1.0);
        let none = bind(&[[3.0, 0.0, 0.0]], &[], 1.0, 5);
        assert_eq!(none.weight[0], [0.0; BINDING_NEIGHBORS]);
    }

    #[test]
    fn weights_change_little_between_neighbouring_gaussians() {
        let particles = lattice(6);
        let step = 1e-4_f32;
        let total = |binding: &Binding, i: usize| {
            let mut all = vec![0.0; particles.len()];
            for (id, w) in binding.particle[i].iter().zip(&binding.weight[i]) {
                all[*id as usize] += w;
            }
            all
        };
        let line: Vec<_> = (0..20_000)
            .map(|i| [1.5 + i as f32 * step, 2.31, 2.77])
            .collect();
        let binding = bind(&line, &particles, 1.0, 0);
        for i in 1..line.len() {
            let change: f32 = total(&binding, i - 1)
                .iter()
                .zip(total(&binding, i))
                .map(|(a, b)| (a - b).abs())
                .sum();
            // Smooth: no weight jumps when a neighbour is exchanged for another.
            assert!(change < 100.0 * step, "{change} at {i}");
        }
    }
}
