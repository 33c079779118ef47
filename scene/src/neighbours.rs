//! Nearest neighbours of every Gaussian, by a k-d tree over the centres, and which of them touch.

use glam::Vec3;
use rayon::prelude::*;

/// Points of a leaf.
const LEAF: usize = 12;
/// Neighbours of every Gaussian that may touch it.
pub const TOUCHING: usize = 12;
/// Neighbour whose distance is a Gaussian's own spacing.
const OWN: usize = 5;
/// Distance up to which neighbours touch, over the larger spacing of the two.
const TOUCH: f32 = 3.0;
/// Largest spacing over the typical one: a floater far from everything has no spacing of its own.
const SPARSE: f32 = 4.0;

/// The `count` nearest other points of each point, nearest first: `[points][count]`.
#[derive(Clone, Debug)]
pub struct Neighbours {
    /// Neighbours per point; less than asked for where there are not so many points.
    pub count: usize,
    /// Their indices.
    pub index: Vec<u32>,
    /// Their distances [asset unit].
    pub distance: Vec<f32>,
}

/// A k-d tree: the points in an order in which every subtree is a range, with its splitting axis at its middle.
pub struct Tree<'a> {
    points: &'a [Vec3],
    order: Vec<u32>,
    /// Axis by which the range with this middle is split.
    axis: Vec<u8>,
}

impl<'a> Tree<'a> {
    /// Tree over `points`, all of them finite.
    pub fn new(points: &'a [Vec3]) -> Self {
        let mut order: Vec<u32> = (0..points.len() as u32).collect();
        let mut axis = vec![0; points.len()];
        split(points, &mut order, &mut axis);
        Self {
            points,
            order,
            axis,
        }
    }

    /// The `count` points nearest to `at` among those that `takes` takes: squared distance and index, nearest first,
    /// equal distances by index.
    pub fn nearest(&self, at: Vec3, count: usize, takes: &impl Fn(u32) -> bool) -> Vec<(f32, u32)> {
        let mut found = Vec::with_capacity(count + 1);
        if count > 0 {
            self.search(0, self.order.len(), at, count, takes, &mut found);
        }
        found
    }

    fn search(
        &self,
        first: usize,
        end: usize,
        at: Vec3,
        count: usize,
        takes: &impl Fn(u32) -> bool,
        found: &mut Vec<(f32, u32)>,
    ) {
        let visit = |index: u32, found: &mut Vec<(f32, u32)>| {
            if !takes(index) {
                return;
            }
            let entry = (self.points[index as usize].distance_squared(at), index);
            let place =
                found.partition_point(|f| f.0.total_cmp(&entry.0).then(f.1.cmp(&entry.1)).is_lt());
            if place < count {
                found.truncate(count - 1);
                found.insert(place, entry);
            }
        };
        if end - first <= LEAF {
            for &index in &self.order[first..end] {
                visit(index, found);
            }
            return;
        }
        let middle = first + (end - first) / 2;
        let axis = usize::from(self.axis[middle]);
        let index = self.order[middle];
        let offset = at[axis] - self.points[index as usize][axis];
        let halves = [(first, middle), (middle + 1, end)];
        let (near, far) = if offset <= 0.0 {
            (halves[0], halves[1])
        } else {
            (halves[1], halves[0])
        };
        self.search(near.0, near.1, at, count, takes, found);
        visit(index, found);
        let reach = match found.last() {
            Some((distance, _)) if found.len() == count => *distance,
            _ => f32::INFINITY,
        };
        if offset * offset <= reach {
            self.search(far.0, far.1, at, count, takes, found);
        }
    }
}

/// Puts the median along the widest axis into the middle, smaller ones before it, and so on in both halves.
fn split(points: &[Vec3], order: &mut [u32], axis: &mut [u8]) {
    if order.len() <= LEAF {
        return;
    }
    let (mut low, mut high) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
    for &index in order.iter() {
        low = low.min(points[index as usize]);
        high = high.max(points[index as usize]);
    }
    let widest = (high - low).max_position();
    let middle = order.len() / 2;
    order.select_nth_unstable_by(middle, |&a, &b| {
        let at = |index: u32| points[index as usize][widest];
        at(a).total_cmp(&at(b)).then(a.cmp(&b))
    });
    axis[middle] = widest as u8;
    let (left, right) = order.split_at_mut(middle);
    let (axis_left, axis_right) = axis.split_at_mut(middle);
    rayon::join(
        || split(points, left, axis_left),
        || split(points, &mut right[1..], &mut axis_right[1..]),
    );
}

impl Neighbours {
    /// The `count` nearest neighbours of every one of `points`, all of them finite.
    pub fn new(points: &[Vec3], count: usize) -> Self {
        let tree = Tree::new(points);
        let count = count.min(points.len().saturating_sub(1));
        let all: Vec<Vec<(f32, u32)>> = (0..points.len() as u32)
            .into_par_iter()
            .map(|n| tree.nearest(points[n as usize], count, &|other| other != n))
            .collect();
        Self {
            count,
            index: all.iter().flatten().map(|f| f.1).collect(),
            distance: all.iter().flatten().map(|f| f.0.sqrt()).collect(),
        }
    }

    /// Each pair of neighbours once, the smaller index first, in ascending order.
    pub fn pairs(&self) -> Vec<(u32, u32)> {
        let places = self.index.iter().enumerate();
        let mut pairs: Vec<(u32, u32)> = places
            .map(|(place, &m)| ((place / self.count) as u32, m))
            .map(|(n, m)| (n.min(m), n.max(m)))
            .collect();
        pairs.par_sort_unstable();
        pairs.dedup();
        pairs
    }

    /// The typical distance of neighbours in a surface: the median of the points' own spacing [asset unit]; 0 without points.
    pub fn spacing(&self) -> f32 {
        let own = OWN.min(self.count.saturating_sub(1));
        let distances = self.distance.iter().skip(own);
        let mut all: Vec<f32> = distances.step_by(self.count.max(1)).copied().collect();
        let middle = all.len() / 2;
        match all.is_empty() {
            true => 0.0,
            false => *all.select_nth_unstable_by(middle, f32::total_cmp).1,
        }
    }

    /// Pairs of neighbours that touch, as [`pairs`](Self::pairs) has them: no farther from each other than three times the
    /// larger spacing of the two. `points` are those that the neighbours were found for.
    pub fn touching(&self, points: &[Vec3]) -> Vec<(u32, u32)> {
        let largest = SPARSE * self.spacing();
        let own = OWN.min(self.count.saturating_sub(1));
        let own = |n: u32| self.distance[n as usize * self.count + own].min(largest);
        let touch = |&(a, b): &(u32, u32)| {
            let apart = points[a as usize].distance(points[b as usize]);
            apart <= TOUCH * own(a).max(own(b))
        };
        let pairs = self.pairs();
        pairs.into_par_iter().filter(touch).collect()
    }

    /// Neighbours of point `n`, with their distances.
    pub fn of(&self, n: usize) -> impl Iterator<Item = (usize, f32)> {
        let range = n * self.count..(n + 1) * self.count;
        let index = self.index[range.clone()].iter().map(|&i| i as usize);
        index.zip(self.distance[range].iter().copied())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_tree_finds_what_a_search_of_all_finds() {
        // Points on a coarse lattice: many equal distances and equal coordinates.
        let points: Vec<Vec3> = (0..700u32)
            .map(|k| {
                let hash = k.wrapping_mul(2_654_435_761);
                Vec3::new(
                    (hash >> 8 & 15) as f32,
                    (hash >> 14 & 7) as f32,
                    (hash >> 20 & 3) as f32,
                )
            })
            .collect();
        let found = Neighbours::new(&points, 9);
        for n in 0..points.len() {
            let mut all: Vec<(f32, usize)> = (0..points.len())
                .filter(|&m| m != n)
                .map(|m| (points[m].distance_squared(points[n]), m))
                .collect();
            all.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
            let expected: Vec<usize> = all[..9].iter().map(|a| a.1).collect();
            let actual: Vec<usize> = found.of(n).map(|f| f.0).collect();
            assert_eq!(actual, expected, "{n}");
        }
    }

    #[test]
    fn few_points_have_few_neighbours() {
        assert_eq!(Neighbours::new(&[], 5).count, 0);
        assert!(Neighbours::new(&[Vec3::ONE], 5).index.is_empty());
        let two = Neighbours::new(&[Vec3::ZERO, Vec3::X], 5);
        assert_eq!((two.index, two.distance), (vec![1, 0], vec![1.0, 1.0]));
    }
}
