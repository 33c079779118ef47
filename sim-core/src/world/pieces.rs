//! Elastic objects that fell apart although nothing in their law tears: the grid lost sight of how their particles belong
//! together.
//!
//! Particles that are farther apart than about a cell share no node that both weigh much on, and what is between them
//! has no stress. An object has as many pieces as there are groups of its particles with an empty layer of cells around
//! them. That is looked for once per frame, in those objects only that were stretched by as much as tears them.

use rayon::prelude::*;

use super::World;
use crate::{
    report::{Level, Torn},
    scene::Object,
    solid::object::SolidObject,
};

/// What an object consists of.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Pieces {
    /// How many there are.
    pub count: usize,
    /// Part of the volume at rest that is not in the largest, 0..1.
    pub apart: f64,
}

/// Representative of a cell's group, with the way there halved.
fn root(parent: &mut [usize], mut at: usize) -> usize {
    while parent[at] != at {
        parent[at] = parent[parent[at]];
        at = parent[at];
    }
    at
}

/// Groups of particles, given by place [cells] and volume: those in the same cell and in cells that touch, edges and
/// corners included, belong together.
pub(super) fn pieces(particles: impl Iterator<Item = ([f64; 3], f64)>) -> Pieces {
    let cell = |x: f64| x.floor() as i32;
    let mut found: Vec<([i32; 3], f64)> = particles.map(|(x, v)| (x.map(cell), v)).collect();
    // Stable: volumes of a cell are added in the order of the particles.
    found.par_sort_by_key(|(cell, _)| *cell);
    found.dedup_by(|next, kept| {
        let same = next.0 == kept.0;
        if same {
            kept.1 += next.1;
        }
        same
    });
    let mut parent: Vec<usize> = (0..found.len()).collect();
    for n in 0..found.len() {
        // Half of the cells around: the others look for this one.
        for step in 14..27 {
            let offset = [step / 9, step / 3 % 3, step % 3].map(|s| s - 1);
            let near: [i32; 3] = std::array::from_fn(|a| found[n].0[a].saturating_add(offset[a]));
            if let Ok(m) = found.binary_search_by_key(&near, |(cell, _)| *cell) {
                let (a, b) = (root(&mut parent, n), root(&mut parent, m));
                parent[a.max(b)] = a.min(b);
            }
        }
    }
    let (mut volumes, mut count) = (vec![0.0; found.len()], 0);
    for n in 0..found.len() {
        let group = root(&mut parent, n);
        volumes[group] += found[n].1;
        count += usize::from(group == n);
    }
    let whole: f64 = volumes.iter().sum();
    let largest = volumes.iter().copied().fold(0.0, f64::max);
    Pieces {
        count,
        apart: if whole > 0.0 {
            1.0 - largest / whole
        } else {
            0.0
        },
    }
}

impl World {
    /// Lets [`torn`](Self::torn) look at every object: of what happened before nothing is known.
    pub(super) fn suspect_all(&mut self) {
        // Solids on grids of their own keep their neighbours.
        let tears = |(object, solid): (&Object, &Option<SolidObject>)| {
            object.yielding_matter().is_none() && solid.is_none()
        };
        let objects = self.model.scene.objects.iter();
        let objects = objects.zip(&self.model.lagrangian);
        self.workspace.strained = objects.map(tears).collect();
    }

    /// The objects that are in more pieces than at rest, in the order of their numbers.
    pub(super) fn torn(&mut self, levels: impl Fn(usize) -> Level) -> Vec<Torn> {
        let mut torn = Vec::new();
        for object in 0..self.workspace.strained.len() {
            if !self.workspace.strained[object]
                || matches!(levels(object), Level::Static | Level::Gone | Level::Removed)
            {
                continue;
            }
            let range = self.model.scene.objects[object].particles.clone();
            let left = range.clone().filter(|&p| self.published.volume[p] > 0.0);
            let now = pieces(left.map(|p| (self.published.cells[p], self.published.volume[p])));
            if now.count < 2 {
                continue;
            }
            let (dx, rest) = (self.model.scene.dx, &self.model.scene.particles);
            let at_rest = range.map(|p| (rest.position[p].map(|x| x / dx), rest.volume[p]));
            if now.count > pieces(at_rest).count {
                torn.push(Torn {
                    object,
                    pieces: now.count,
                    apart: now.apart,
                });
            }
        }
        torn
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pieces_are_what_an_empty_layer_of_cells_parts() {
        let line = |from: i32, to: i32| (from..to).map(|x| ([f64::from(x) + 0.5, 0.5, -0.5], 1.0));
        let of = |parts: &[(i32, i32)]| pieces(parts.iter().flat_map(|&(a, b)| line(a, b)));
        assert_eq!(
            of(&[(0, 10)]),
            Pieces {
                count: 1,
                apart: 0.0
            }
        );
        assert_eq!(of(&[(5, 10), (0, 5)]).count, 1);
        let two = of(&[(0, 6), (7, 10)]);
        assert_eq!(two.count, 2);
        assert!((two.apart - 1.0 / 3.0).abs() < 1e-12, "{two:?}");
        assert_eq!(
            of(&[]),
            Pieces {
                count: 0,
                apart: 0.0
            }
        );
        // Corner to corner holds together; far away numbers of cells do not run over.
        let corners = [[0.5; 3], [1.5; 3], [1e12; 3], [-1e12; 3]];
        assert_eq!(pieces(corners.into_iter().map(|x| (x, 1.0))).count, 3);
    }
}
