//! The lattice that the pieces of a solid's matter lie on at rest: its spacing, its axes, and a corner of pieces on it.
//!
//! Whole pieces tell it: they have one volume, and neighbours as far away as a cube of that volume is wide. An object that was
//! turned before it came to rest has its lattice turned; cells and surface follow it, so that a turned box has plane faces.

use std::collections::BTreeMap;

use crate::mat3::{Mat3, cross, dot, length};

/// Share of the largest volume of equal pieces that each of them has at least.
const EQUAL: f64 = 0.999;
/// Distances of neighbours [spacings]: pieces are off their places by a tenth along each axis at most.
const NEIGHBOURS: [f64; 2] = [0.75, 1.2];
/// How far the mean distance of neighbours may be from the width of a piece, relative: what is cut or joined differs by more.
const EXACT: f64 = 0.03;
/// Cosine of the angle to an axis within which a neighbour lies along it.
const ALONG: f64 = 0.9;
/// Cosine of the angle between first guesses of two axes.
const ACROSS: f64 = 0.35;
/// Share of all neighbours that must lie along the axes: of pieces off their places a few diagonal ones are as near.
const SHARE_ALONG: f64 = 0.95;
/// Largest component across the world's axes of a lattice that is taken for aligned with them.
const ALIGNED: f64 = 0.01;

/// Pieces of one volume that are looked at, at most.
const LOOKED_AT: usize = 16_384;

/// Matter at a place, at rest.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Seed {
    /// Where [m].
    pub position: [f64; 3],
    /// Rest volume [m^3].
    pub volume: f64,
    /// Mass per rest volume [kg/m^3].
    pub density: f64,
    /// What it is made of: an index of the object's laws.
    pub part: u16,
}

/// A lattice of cubes.
#[derive(Clone, Debug, PartialEq)]
pub struct Lattice {
    /// Spacing [m].
    pub edge: f64,
    /// A corner of pieces, along the axes of the lattice [m].
    pub corner: [f64; 3],
    /// Its axes as columns.
    pub world_from_lattice: Mat3<f64>,
}

/// Pairs of neighbours among pieces of one volume.
struct Neighbours {
    /// From one to the other [m].
    pairs: Vec<[f64; 3]>,
    /// Mean distance [m].
    mean: f64,
}

impl Neighbours {
    fn of(pieces: &[&Seed]) -> Self {
        let edge = pieces[0].volume.cbrt();
        let bin = |x: [f64; 3]| x.map(|x| (x / (NEIGHBOURS[1] * edge)).floor() as i64);
        let mut bins: BTreeMap<[i64; 3], Vec<usize>> = BTreeMap::new();
        for (n, piece) in pieces.iter().enumerate() {
            bins.entry(bin(piece.position)).or_default().push(n);
        }
        let mut pairs = vec![];
        for (n, piece) in pieces.iter().enumerate() {
            let at = bin(piece.position);
            for o in 0..27 {
                let beside = [o / 9 - 1, o / 3 % 3 - 1, o % 3 - 1];
                let place = std::array::from_fn(|a| at[a] + beside[a]);
                for &other in bins.get(&place).into_iter().flatten().filter(|&&m| m > n) {
                    let d = std::array::from_fn(|a| pieces[other].position[a] - piece.position[a]);
                    if (NEIGHBOURS[0]..NEIGHBOURS[1]).contains(&(length(d) / edge)) {
                        pairs.push(d);
                    }
                }
            }
        }
        let sum: f64 = pairs.iter().map(|d| length(*d)).sum();
        Self {
            mean: sum / pairs.len() as f64,
            pairs,
        }
    }
}

impl Lattice {
    /// Of some matter, at least one piece, on a grid with cells of `dx` [m], which are no smaller than its own.
    pub fn of(dx: f64, seeds: &[Seed]) -> Self {
        let (whole, pairs) = whole_pieces(seeds);
        let mut lattice = Self {
            edge: whole[0].volume.cbrt().min(dx),
            corner: [0.0; 3],
            world_from_lattice: axes(&pairs).unwrap_or_else(Mat3::identity),
        };
        let places: Vec<[f64; 3]> = whole.iter().map(|s| lattice.place(s.position)).collect();
        lattice.corner = corner(lattice.edge, &places);
        lattice
    }

    /// A place [m] along the axes of the lattice [m].
    #[inline(always)]
    pub fn place(&self, x: [f64; 3]) -> [f64; 3] {
        let axes = &self.world_from_lattice.0;
        let mut out = [0.0; 3];
        for a in 0..3 {
            out[a] = axes[0][a] * x[0] + (axes[1][a] * x[1] + axes[2][a] * x[2]);
        }
        out
    }

    /// A place or direction along the axes of the lattice in the world.
    #[inline(always)]
    pub fn world(&self, x: [f64; 3]) -> [f64; 3] {
        self.world_from_lattice.mul_vec(x)
    }

    /// Its axes as columns, in single precision.
    pub fn axes(&self) -> Mat3<f32> {
        Mat3(self.world_from_lattice.0.map(|row| row.map(|x| x as f32)))
    }

    /// Matter with its places along the axes of the lattice.
    pub fn seeds(&self, seeds: &[Seed]) -> Vec<Seed> {
        let along = |seed: &Seed| Seed {
            position: self.place(seed.position),
            ..*seed
        };
        seeds.iter().map(along).collect()
    }
}

/// Whole pieces, at least one, and the ways from one to its neighbours [m]: of all volumes the one with most neighbours as far away as
/// a piece is wide, or else the largest.
fn whole_pieces(seeds: &[Seed]) -> (Vec<&Seed>, Vec<[f64; 3]>) {
    let mut order: Vec<&Seed> = seeds.iter().collect();
    // Equal ones stay in the order of the scene.
    order.sort_by(|a, b| b.volume.total_cmp(&a.volume));
    let (mut best, mut pairs) = (0..0, vec![]);
    let mut start = 0;
    while start < order.len() && order[start].volume > 0.0 {
        let least = EQUAL * order[start].volume;
        let end = start + order[start..].partition_point(|s| s.volume >= least);
        let here = Neighbours::of(&order[start..end.min(start + LOOKED_AT)]);
        let width = order[start].volume.cbrt();
        let is_lattice = (here.mean / width - 1.0).abs() < EXACT;
        if best.is_empty() || is_lattice && here.pairs.len() > pairs.len() {
            best = start..end;
            if is_lattice {
                pairs = here.pairs;
            }
        }
        start = end;
    }
    (order[best].to_vec(), pairs)
}

/// Axes of a lattice as columns, from the ways between neighbours: the mean of those along each. None of what lies along the world's
/// axes, or along none.
fn axes(pairs: &[[f64; 3]]) -> Option<Mat3<f64>> {
    let unit = |d: [f64; 3]| d.map(|x| x / length(d));
    let first = unit(*pairs.first()?);
    let across = |d: &&[f64; 3]| dot(unit(**d), first).abs() < ACROSS;
    let second = across_of(unit(*pairs.iter().find(across)?), first);
    let mut axes = [first, second, cross(first, second)];
    // Pieces are off their places, so the first axes are rough.
    let mut along = 0;
    for _ in 0..3 {
        let mut sums = [[0.0; 3]; 3];
        along = 0;
        for d in pairs {
            for (axis, sum) in axes.iter().zip(&mut sums) {
                let cosine = dot(unit(*d), *axis);
                if cosine.abs() > ALONG {
                    along += 1;
                    for a in 0..3 {
                        sum[a] += cosine.signum() * d[a];
                    }
                }
            }
        }
        let first = unit(sums[0]);
        let second = across_of(unit(sums[1]), first);
        axes = [first, second, cross(first, second)];
    }
    if (along as f64) < SHARE_ALONG * pairs.len() as f64 {
        return None;
    }
    in_order(axes)
}

/// What of a direction is across another, as a unit vector.
fn across_of(d: [f64; 3], other: [f64; 3]) -> [f64; 3] {
    let along = dot(d, other);
    let rest: [f64; 3] = std::array::from_fn(|a| d[a] - along * other[a]);
    rest.map(|x| x / length(rest))
}

/// Axes as columns, each beside the axis of the world that it is nearest to; none where they are aligned with those.
fn in_order(mut axes: [[f64; 3]; 3]) -> Option<Mat3<f64>> {
    for a in 0..2 {
        let nearest = (a..3).max_by(|&i, &j| axes[i][a].abs().total_cmp(&axes[j][a].abs()))?;
        axes.swap(a, nearest);
        if axes[a][a] < 0.0 {
            axes[a] = axes[a].map(|x| -x);
        }
    }
    axes[2] = cross(axes[0], axes[1]);
    let is_off = |a: usize| (0..3).any(|b| a != b && axes[a][b].abs() > ALIGNED);
    let [x, y, z] = axes;
    (0..3).any(is_off).then(|| Mat3::from_columns(x, y, z))
}

/// A corner of cubes around whole pieces at these places [m]: pieces may be off their places a little.
fn corner(edge: f64, places: &[[f64; 3]]) -> [f64; 3] {
    let first = places[0];
    std::array::from_fn(|a| {
        // Mean phase of places on a lattice of that spacing.
        let (mut s, mut c) = (0.0, 0.0);
        for place in places {
            let turn = std::f64::consts::TAU * (place[a] - first[a]) / edge;
            s += turn.sin();
            c += turn.cos();
        }
        let phase = s.atan2(c) / std::f64::consts::TAU * edge;
        let least = places.iter().map(|place| place[a]);
        let least = least.fold(f64::INFINITY, f64::min);
        let steps = ((least - first[a] - phase) / edge).round();
        first[a] + phase + (steps - 0.5) * edge
    })
}
