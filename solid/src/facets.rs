//! The surface of a solid at rest as facets, found from the volumes of its matter on their lattice.
//!
//! Where pieces are whole or absent they show their faces. Elsewhere the surface is a height over a plane of the lattice: sums of columns
//! of pieces across it (height functions, Hirt and Nichols 1981), fitted by a quadric over nine columns (Cummins, Francois and Kothe
//! 2005). Sums are true whichever piece of a column a sliver was joined to. Every piece that the surface goes through has its part of it.
//! Pieces at faces, edges and corners of a box that is cut at planes of the lattice have the parts of its faces.
//! Where none of this tells, at other edges and in thin matter, a cut piece has the plane that leaves its volume behind, across the gradient
//! of filling (piecewise linear reconstruction, Youngs 1982).

use std::collections::{BTreeMap, BTreeSet};

use super::lattice::{Lattice, Seed};
use crate::mat3::length;

/// Filling from which on a piece is whole.
const WHOLE: f64 = 0.999;
/// Filling up to which it has nothing joined to it.
const ALONE: f64 = 1.001;
/// Smallest area of a facet, in faces of a piece.
const SMALLEST: f64 = 0.02;
/// Smallest component of a normal that the volume behind a plane is worked out with.
const SLANT: f64 = 1e-4;
/// Pieces above and below that a column is looked at.
const REACH: i64 = 3;
/// Largest slope of a surface over the plane that it is looked at from: 1, and what is uncertain of it.
const STEEPEST: f64 = 1.5;
/// Largest second difference of heights: a ball of four pieces' radius has 0.25, an edge 1 and more.
const SHARPEST: f64 = 0.75;
/// How far fillings may be off those of a box that is cut at planes across the axes.
const FLAT: f64 = 1e-3;

/// Filling of the lattice, with the place of some matter in each piece along its axes [m].
type Filling = BTreeMap<[i64; 3], (f64, [f64; 3])>;

/// A part of the surface, along the axes of the lattice.
#[derive(Clone, Debug)]
pub(super) struct Facet {
    /// Piece of the lattice that it is in or at.
    pub index: [i64; 3],
    /// Its middle [m].
    pub center: [f64; 3],
    /// Unit normal outwards.
    pub normal: [f64; 3],
    /// Area [m^2].
    pub area: f64,
    /// The axis across a part of a face; none of a plane through a piece.
    pub face: Option<usize>,
    /// Half of what a part of a face is long along each axis [m].
    pub half: [f64; 3],
    /// Where matter behind it is [m].
    pub owner: [f64; 3],
}

/// The matter of a solid on its lattice, and its surface.
pub(super) struct Pieces<'a> {
    pub lattice: &'a Lattice,
    filling: Filling,
    pub facets: Vec<Facet>,
}

/// A plane through a piece.
struct Plane {
    /// Place from its middle [edges].
    at: [f64; 3],
    normal: [f64; 3],
    /// In faces of a piece.
    area: f64,
}

impl<'a> Pieces<'a> {
    /// Of some matter.
    pub fn new(lattice: &'a Lattice, seeds: &[Seed]) -> Self {
        let mut filling = Filling::new();
        for seed in &lattice.seeds(seeds) {
            let piece = filling.entry(lattice.index(seed.position));
            let piece = piece.or_insert((0.0, seed.position));
            piece.0 += seed.volume / lattice.edge.powi(3);
        }
        let mut pieces = Self {
            lattice,
            filling,
            facets: vec![],
        };
        pieces.facets = pieces.find_facets();
        pieces
    }

    /// Places of all pieces.
    pub fn places(&self) -> impl Iterator<Item = &[i64; 3]> {
        self.filling.keys()
    }

    /// Whether there is matter in a piece.
    pub fn has(&self, index: &[i64; 3]) -> bool {
        self.filling.contains_key(index)
    }

    fn filled(&self, index: &[i64; 3]) -> f64 {
        self.filling.get(index).map_or(0.0, |piece| piece.0)
    }

    fn find_facets(&self) -> Vec<Facet> {
        let mut seen = BTreeSet::new();
        for index in self.filling.keys() {
            let open = beside(index).any(|next| !self.has(&next) || self.filled(&next) < WHOLE);
            if open || self.filled(index) < WHOLE {
                seen.insert(*index);
                seen.extend(beside(index).filter(|next| !self.has(next)));
            }
        }
        // Which of them have parts of the surface of their own.
        let mut crossed = BTreeSet::new();
        let mut out = vec![];
        let is_cut = |index: &&[i64; 3]| !self.is_plain(index);
        let (filled, open): (Vec<_>, Vec<_>) = seen
            .iter()
            .filter(is_cut)
            .partition(|index| self.has(index));
        for index in filled.into_iter().chain(open) {
            if crossed.contains(index) {
                continue;
            }
            if let Some(ends) = self.ends_in(index) {
                crossed.insert(*index);
                let at_end = (0..3).filter(|&axis| ends[axis].1 != 0);
                out.extend(
                    at_end
                        .clone()
                        .map(|axis| self.part_of_face(index, axis, &ends)),
                );
                // The surface does not go through what is beyond.
                crossed.extend(at_end.map(|axis| step(index, axis, ends[axis].1)));
            } else if let Some(plane) = self.plane_in(index) {
                crossed.insert(*index);
                out.push(self.facet(index, &plane));
            }
        }
        for (index, piece) in &self.filling {
            // Cut ones that have no plane are not at the surface.
            if piece.0 < WHOLE || crossed.contains(index) {
                continue;
            }
            for (n, next) in beside(index).enumerate() {
                if !self.has(&next) && !crossed.contains(&next) {
                    out.push(self.face(index, n));
                }
            }
        }
        out
    }

    /// Whether it and all pieces around it are whole or absent.
    fn is_plain(&self, index: &[i64; 3]) -> bool {
        around(index).all(|(_, there)| {
            let filled = self.filled(&there);
            filled == 0.0 || (WHOLE..ALONE).contains(&filled)
        })
    }

    /// Face `2 axis + side` of a whole piece.
    fn face(&self, index: &[i64; 3], n: usize) -> Facet {
        let axis = n / 2;
        let mut ends = [(1.0, 0); 3];
        ends[axis].1 = 2 * (n as i64 % 2) - 1;
        self.part_of_face(index, axis, &ends)
    }

    /// How far a box that is cut at planes across the axes goes into a piece along each [edges], and at which side it ends there: -1, 1
    /// or 0 where it goes on. None of other matter.
    fn ends_in(&self, index: &[i64; 3]) -> Option<[(f64, i64); 3]> {
        let filled = self.filled(index);
        let mut ends = [(1.0, 0); 3];
        let mut profiles = [[1.0; 3]; 3];
        for axis in 0..3 {
            let [low, high] = [-1, 1].map(|side| self.filled(&step(index, axis, side)));
            profiles[axis] = [low / filled, 1.0, high / filled];
            let (inner, side) = match (low > 0.0, high > 0.0) {
                (true, true) => continue,
                (true, false) => (low, 1),
                (false, true) => (high, -1),
                (false, false) => return None,
            };
            // Of two layers the inner one may be that which is cut.
            ends[axis] = ((filled / inner).min(1.0), side);
        }
        let all: f64 = ends.iter().map(|end| end.0).product();
        let is_like_it = |(o, there): ([i64; 3], [i64; 3])| {
            let shares = (0..3).map(|a| profiles[a][(o[a] + 1) as usize]);
            (self.filled(&there) - filled * shares.product::<f64>()).abs() < FLAT
        };
        let is_box = filled > 0.0 && (all - filled).abs() < FLAT;
        (is_box && around(index).all(is_like_it)).then_some(ends)
    }

    /// The part in a piece of a box's face across an axis.
    fn part_of_face(&self, index: &[i64; 3], axis: usize, ends: &[(f64, i64); 3]) -> Facet {
        let (edge, mut center) = (self.lattice.edge, self.middle(index));
        let mut half = [0.0; 3];
        let mut normal = [0.0; 3];
        for a in 0..3 {
            let (share, side) = ends[a];
            // From the side where it goes on.
            let end = side as f64 * edge * (share - 0.5);
            if a == axis {
                center[a] += end;
                normal[a] = side as f64;
            } else {
                half[a] = 0.5 * edge * share;
                center[a] += side as f64 * edge * 0.5 * (share - 1.0);
            }
        }
        Facet {
            index: *index,
            center,
            normal,
            area: half.iter().filter(|h| **h > 0.0).map(|h| 2.0 * h).product(),
            face: Some(axis),
            half,
            owner: self.filling[index].1,
        }
    }

    fn facet(&self, index: &[i64; 3], plane: &Plane) -> Facet {
        let (edge, middle) = (self.lattice.edge, self.middle(index));
        let near = std::iter::once(*index).chain(beside(index));
        let fullest = near.max_by(|a, b| self.filled(a).total_cmp(&self.filled(b)));
        let owner = fullest.and_then(|index| self.filling.get(&index));
        Facet {
            index: *index,
            center: std::array::from_fn(|a| middle[a] + edge * plane.at[a]),
            normal: plane.normal,
            area: edge * edge * plane.area,
            face: None,
            half: [0.0; 3],
            owner: owner.map_or(middle, |piece| piece.1),
        }
    }

    /// Middle of a piece [m].
    fn middle(&self, index: &[i64; 3]) -> [f64; 3] {
        let &Lattice { edge, corner, .. } = self.lattice;
        std::array::from_fn(|a| corner[a] + edge * (index[a] as f64 + 0.5))
    }

    /// The plane of the surface in a piece; none where it has next to no area.
    fn plane_in(&self, index: &[i64; 3]) -> Option<Plane> {
        let slope = self.slope(index)?;
        let filled = self.filled(index);
        let plane = match self.quadric(index, slope) {
            Some(plane) => plane,
            None if filled > 0.0 && filled < WHOLE => plane_behind(slope, filled),
            None => return None,
        };
        (plane.area > SMALLEST).then_some(plane)
    }

    /// Unit vector along which filling falls; none where it does not.
    fn slope(&self, index: &[i64; 3]) -> Option<[f64; 3]> {
        let mut slope = [0.0; 3];
        for (o, there) in around(index) {
            let steps: u64 = o.iter().map(|o| o.unsigned_abs()).sum();
            let weight = [4.0, 2.0, 1.0, 0.5][steps as usize];
            let filled = self.filled(&there).min(1.0);
            for a in 0..3 {
                slope[a] -= weight * o[a] as f64 * filled;
            }
        }
        let size = length(slope);
        (size > 1e-6).then(|| slope.map(|n| n / size))
    }

    /// Height of the surface over the middle of a piece, up an axis [edges]; none where the column is not whole below.
    fn height(&self, mut at: [i64; 3], axis: usize, up: i64) -> Option<f64> {
        let middle = at[axis];
        let mut of = |k: i64| {
            at[axis] = middle + k * up;
            self.filled(&at)
        };
        if of(REACH + 1) > 0.0 {
            return None;
        }
        let top = (-REACH..=REACH).rev().find(|&k| of(k) > 0.0)?;
        let mut sum = 0.0;
        for k in (top - REACH..=top).rev() {
            let filled = of(k);
            if filled == 0.0 {
                return None;
            }
            sum += filled;
            if filled >= WHOLE {
                return Some(k as f64 - 0.5 + sum);
            }
        }
        None
    }

    /// The part of the quadric over nine columns that is nearest to the middle of a piece.
    fn quadric(&self, index: &[i64; 3], slope: [f64; 3]) -> Option<Plane> {
        let steepest = (0..3).max_by(|&a, &b| slope[a].abs().total_cmp(&slope[b].abs()));
        let axis = steepest?;
        let up = slope[axis].signum() as i64;
        let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
        let heights: [[Option<f64>; 3]; 3] = std::array::from_fn(|i| {
            std::array::from_fn(|j| {
                let mut at = *index;
                at[u] += i as i64 - 1;
                at[v] += j as i64 - 1;
                self.height(at, axis, up)
            })
        });
        let transposed = std::array::from_fn(|j| std::array::from_fn(|i| heights[i][j]));
        let middle = heights[1][1]?;
        let ([first, second], [other, second_other]) = (along(&heights), along(&transposed));
        let is_smooth =
            |[first, second]: [f64; 2]| first.abs() <= STEEPEST && second.abs() <= SHARPEST;
        if !is_smooth([first, second]) || !is_smooth([other, second_other]) {
            return None;
        }
        let all: Option<f64> = (0..9).try_fold(0.0, |sum, n| {
            let (i, j) = (n / 3, n % 3);
            let sign = [1.0, -2.0, 1.0];
            Some(sum + sign[i] * sign[j] * heights[i][j]?)
        });
        // Least squares over all nine; sums of columns are means over their faces.
        let middle = middle - all.unwrap_or(0.0) / 9.0 - (second + second_other) / 24.0;
        let squared = 1.0 + first * first + other * other;
        // Where the plane there is nearest to the middle of the piece, and the quadric over it.
        let [x, y] = [first, other].map(|s| -s * middle / squared);
        let z = middle + first * x + other * y + 0.5 * (second * x * x + second_other * y * y);
        let (first, other) = (first + second * x, other + second_other * y);
        let size = (1.0 + first * first + other * other).sqrt();
        let (mut at, mut normal) = ([0.0; 3], [0.0; 3]);
        (at[u], at[v], at[axis]) = (x, y, z * up as f64);
        (normal[u], normal[v], normal[axis]) = (-first / size, -other / size, up as f64 / size);
        let height: f64 = (0..3).map(|a| at[a] * normal[a]).sum();
        Some(Plane {
            at,
            normal,
            area: area(normal, height),
        })
    }
}

/// Slope and second difference along the first index, means over those of the second by 1, 2 and 1; from one side where there is
/// nothing on the other, and none where there is nothing on either.
fn along(heights: &[[Option<f64>; 3]; 3]) -> [f64; 2] {
    let [mut both, mut one] = [[0.0; 3]; 2];
    for j in 0..3 {
        let weight = [1.0, 2.0, 1.0][j];
        let [low, middle, high] = [0, 1, 2].map(|i| heights[i][j]);
        let Some(middle) = middle else { continue };
        if let (Some(low), Some(high)) = (low, high) {
            both[0] += weight;
            both[1] += weight * 0.5 * (high - low);
            both[2] += weight * (high - 2.0 * middle + low);
        } else if let Some(step) = high.map(|h| h - middle).or(low.map(|l| middle - l)) {
            one[0] += weight;
            one[1] += weight * step;
        }
    }
    let [weight, first, second] = if both[0] > 0.0 { both } else { one };
    match weight > 0.0 {
        true => [first / weight, second / weight],
        false => [0.0; 2],
    }
}

/// The six places beside one, `2 axis + side`.
pub(super) fn beside(index: &[i64; 3]) -> impl Iterator<Item = [i64; 3]> + use<> {
    let index = *index;
    (0..6).map(move |n| step(&index, n / 2, 2 * (n as i64 % 2) - 1))
}

/// The place some steps along an axis from one.
fn step(index: &[i64; 3], axis: usize, steps: i64) -> [i64; 3] {
    let mut next = *index;
    next[axis] += steps;
    next
}

/// The 27 places in and around one, with the way to them.
fn around(index: &[i64; 3]) -> impl Iterator<Item = ([i64; 3], [i64; 3])> + use<> {
    let index = *index;
    (0..27).map(move |n| {
        let o: [i64; 3] = [n / 9 - 1, n / 3 % 3 - 1, n % 3 - 1];
        (o, std::array::from_fn(|a| index[a] + o[a]))
    })
}

/// The plane across `normal` that leaves a volume of a unit cube behind.
fn plane_behind(normal: [f64; 3], volume: f64) -> Plane {
    let n = normal.map(|n| n.abs().max(SLANT));
    let all = n[0] + n[1] + n[2];
    let (mut low, mut high) = (0.0, all);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        match behind(n, middle) < volume {
            true => low = middle,
            false => high = middle,
        }
    }
    let height = (low - 0.5 * all) / length(n);
    Plane {
        at: normal.map(|n| n * height),
        normal,
        area: area(normal, height),
    }
}

/// Area in a unit cube of the plane across `normal` at a height over its middle.
fn area(normal: [f64; 3], height: f64) -> f64 {
    let n = normal.map(|n| n.abs().max(SLANT));
    let all = n[0] + n[1] + n[2];
    let alpha = height * length(n) + 0.5 * all;
    if !(0.0..=all).contains(&alpha) {
        return 0.0;
    }
    let step = 1e-3 * all;
    let (a, b) = ((alpha - step).max(0.0), (alpha + step).min(all));
    (behind(n, b) - behind(n, a)) / (b - a) * length(n)
}

/// Volume of the unit cube where `n . x < alpha` (Scardovelli and Zaleski 2000).
fn behind(n: [f64; 3], alpha: f64) -> f64 {
    let cube = |x: f64| x.max(0.0).powi(3);
    let single: f64 = n.iter().map(|n| cube(alpha - n)).sum();
    let pairs = cube(alpha - n[0] - n[1]) + cube(alpha - n[0] - n[2]) + cube(alpha - n[1] - n[2]);
    let all = cube(alpha - n[0] - n[1] - n[2]);
    (cube(alpha) - single + pairs - all) / (6.0 * n[0] * n[1] * n[2])
}
