//! Connected components of points: by cells of a given size, or by which neighbours touch.

use std::collections::HashMap;

use glam::Vec3;

use crate::{
    bounds::bounds_of,
    neighbours::{Neighbours, TOUCHING},
};

/// Indices of the points of each component, ascending, components in the order of their first point. Points are connected when
/// they lie in the same or in touching cells of this size [m].
pub(crate) fn by_cells(points: &[[f64; 3]], size: f64) -> Vec<Vec<usize>> {
    let cell = |point: &[f64; 3]| point.map(|x| (x / size).floor() as i64);
    // Cells are numbered in the order of their first point: the map's own order plays no part.
    let mut cells: HashMap<[i64; 3], usize> = HashMap::new();
    let mut keys = Vec::new();
    let cell_of: Vec<usize> = points
        .iter()
        .map(|point| {
            *cells.entry(cell(point)).or_insert_with_key(|key| {
                keys.push(*key);
                keys.len() - 1
            })
        })
        .collect();
    let near = |at: usize| {
        let cells = &cells;
        let key: [i64; 3] = keys[at];
        (0..27).filter_map(move |offset| {
            let step = [offset % 3, offset / 3 % 3, offset / 9].map(|s| s - 1);
            let near = std::array::from_fn(|a| key[a].saturating_add(step[a]));
            cells.get(&near).copied()
        })
    };
    gathered(&cell_of, &labelled(keys.len(), near))
}

/// As [`by_cells`], of points whose neighbours touch: a point far from all others changes nothing between these.
pub(crate) fn by_neighbours(points: &[[f64; 3]]) -> Vec<Vec<usize>> {
    let Some(bounds) = bounds_of(points.iter().copied()) else {
        return Vec::new();
    };
    // In single precision about their middle: they may be far from the origin.
    let middle = [0, 1, 2].map(|a| 0.5 * (bounds.min[a] + bounds.max[a]));
    let relative =
        |p: &[f64; 3]| Vec3::from_array(std::array::from_fn(|a| (p[a] - middle[a]) as f32));
    let points: &[Vec3] = &points.iter().map(relative).collect::<Vec<_>>();
    let pairs = Neighbours::new(points, TOUCHING).touching(points);
    let mut touching = vec![Vec::new(); points.len()];
    for (a, b) in pairs {
        touching[a as usize].push(b as usize);
        touching[b as usize].push(a as usize);
    }
    let label = labelled(points.len(), |at| touching[at].iter().copied());
    gathered(&(0..points.len()).collect::<Vec<_>>(), &label)
}

/// The component of each of `count` nodes; `near` says which nodes one is connected with.
fn labelled<N: Iterator<Item = usize>>(count: usize, near: impl Fn(usize) -> N) -> Vec<usize> {
    let mut label = vec![usize::MAX; count];
    let mut components = 0;
    for first in 0..count {
        if label[first] != usize::MAX {
            continue;
        }
        label[first] = components;
        let mut open = vec![first];
        while let Some(at) = open.pop() {
            for near in near(at) {
                if label[near] == usize::MAX {
                    label[near] = components;
                    open.push(near);
                }
            }
        }
        components += 1;
    }
    label
}

/// Points by the component of the node that each belongs to.
fn gathered(node: &[usize], label: &[usize]) -> Vec<Vec<usize>> {
    let count = label.iter().max().map_or(0, |last| last + 1);
    let mut parts = vec![Vec::new(); count];
    for (point, &node) in node.iter().enumerate() {
        parts[label[node]].push(point);
    }
    parts
}
