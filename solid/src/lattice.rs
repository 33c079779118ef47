//! The lattice that the pieces of a solid's matter lie on at rest: its spacing, its axes, and a corner of pieces on it.
//!
//! Whole pieces tell it: they have one volume, and neighbours as far away as a cube of that volume is wide. An object that was
//! turned before it came to rest has its lattice turned; cells and surface follow it, so that a turned box has plane faces.

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

/// Sizes of boxes [widths of cubes of their volume], and how far what is next along an axis may be aside.
const SHORTEST: f64 = 0.5;
const LONGEST: f64 = 1.8;
const ASIDE: f64 = 0.3;
/// How far pieces may be off those of cells at the far end of an object [pieces], and standard deviations of their mean size that are
/// taken for nothing else.
const UNEVEN: f64 = 0.01;
const DEVIATIONS: f64 = 4.0;
/// How far the end of a row of boxes may be off a plane and be at it [pieces].
const UNCERTAIN: f64 = 0.02;
/// What rounding makes of a plane [pieces].
const ROUNDING: f64 = 1e-6;
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
    /// What pieces of matter are that have another lattice.
    boxes: Option<Boxes>,
}

/// Pieces of matter that are boxes of one size beside each other.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Boxes {
    /// Along the axes [m].
    size: [f64; 3],
    /// Volume from which on a piece is whole [m^3].
    whole: f64,
}

/// Pairs of neighbours among pieces of one volume.
struct Neighbours {
    /// From one to the other [m].
    pairs: Vec<[f64; 3]>,
    /// Mean distance [m].
    mean: f64,
}

/// Shows every place with those in its bin of some width [m] and in the bins around it, each with the way there [m].
fn for_near(places: &[[f64; 3]], width: f64, mut see: impl FnMut(usize, usize, [f64; 3])) {
    let bin = |x: &[f64; 3]| x.map(|x| (x / width).floor() as i64);
    let mut sorted: Vec<([i64; 3], usize)> =
        (0..places.len()).map(|n| (bin(&places[n]), n)).collect();
    sorted.sort_unstable();
    for (n, place) in places.iter().enumerate() {
        let [x, y, z] = bin(place);
        for o in 0..9 {
            // Three bins along z follow each other.
            let [first, last] = [-1, 1].map(|side| [x + o / 3 - 1, y + o % 3 - 1, z + side]);
            let start = sorted.partition_point(|one| one.0 < first);
            let near = sorted[start..].iter().take_while(|one| one.0 <= last);
            for &(_, other) in near {
                let d = std::array::from_fn(|a| places[other][a] - place[a]);
                see(n, other, d);
            }
        }
    }
}

impl Neighbours {
    fn of(pieces: &[&Seed]) -> Self {
        let edge = pieces[0].volume.cbrt();
        let places: Vec<[f64; 3]> = pieces.iter().map(|piece| piece.position).collect();
        let mut pairs = vec![];
        for_near(&places, NEIGHBOURS[1] * edge, |n, other, d| {
            if other > n && (NEIGHBOURS[0]..NEIGHBOURS[1]).contains(&(length(d) / edge)) {
                pairs.push(d);
            }
        });
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
        let edge = whole[0].volume.cbrt().min(dx);
        let mut lattice = Self {
            edge,
            corner: [0.0; 3],
            world_from_lattice: axes(&pairs).unwrap_or_else(Mat3::identity),
            boxes: None,
        };
        let places: Vec<[f64; 3]> = whole.iter().map(|s| lattice.place(s.position)).collect();
        let mut size = [edge; 3];
        // Octants of cells are whole numbers of pieces wide.
        let fitting = 0.5 * dx / (0.5 * dx / edge).round().max(1.0);
        if let Some(found) = spacings(whole[0].volume, fitting, &places) {
            size = found;
            lattice.edge = fitting;
            lattice.boxes = Some(Boxes {
                size,
                whole: EQUAL * whole[0].volume,
            });
        }
        lattice.corner = std::array::from_fn(|a| corner(size[a], a, &places));
        if let Some(boxes) = &mut lattice.boxes {
            for a in 0..3 {
                (lattice.corner[a], boxes.size[a]) =
                    line([lattice.corner[a], size[a], lattice.edge], a, &places);
            }
        }
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

    /// The piece that a place along its axes is in [m].
    pub fn index(&self, place: [f64; 3]) -> [i64; 3] {
        std::array::from_fn(|a| ((place[a] - self.corner[a]) / self.edge).floor() as i64)
    }

    /// Half of the largest box about a place along its axes that is in one piece [m].
    pub fn room_about(&self, place: [f64; 3]) -> [f64; 3] {
        let index = self.index(place);
        std::array::from_fn(|a| {
            let low = place[a] - (self.corner[a] + self.edge * index[a] as f64);
            low.min(self.edge - low)
        })
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

    /// Matter with its places along the axes of the lattice, what has a lattice of its own cut at the planes of this one.
    pub fn seeds(&self, seeds: &[Seed]) -> Vec<Seed> {
        let along = |seed: &Seed| Seed {
            position: self.place(seed.position),
            ..*seed
        };
        let placed = seeds.iter().map(along);
        match &self.boxes {
            None => placed.collect(),
            Some(boxes) => placed.flat_map(|seed| self.cut(boxes, &seed)).collect(),
        }
    }

    /// Parts of a box of matter, one in each piece of the lattice that it reaches.
    fn cut(&self, boxes: &Boxes, seed: &Seed) -> Vec<Seed> {
        let is_whole = seed.volume >= boxes.whole;
        let share = (seed.volume * EQUAL / boxes.whole).cbrt();
        // Per axis its parts: where, and how long.
        let parts: [Vec<[f64; 2]>; 3] = std::array::from_fn(|a| {
            let (corner, size) = (self.corner[a], boxes.size[a]);
            let x = seed.position[a];
            let [low, high] = match is_whole {
                // Whole ones are beside each other, wherever they were put.
                true => {
                    let low = corner + size * ((x - corner) / size).floor();
                    [low, low + size]
                }
                false => [x - 0.5 * share * size, x + 0.5 * share * size],
            };
            let first = ((low - corner) / self.edge + ROUNDING).floor() as i64;
            let last = ((high - corner) / self.edge - ROUNDING).floor() as i64;
            let part = |k: i64| {
                let plane = |k: i64| corner + self.edge * k as f64;
                let (from, to) = (low.max(plane(k)), high.min(plane(k + 1)));
                [0.5 * (from + to), to - from]
            };
            (first..=last.max(first)).map(part).collect()
        });
        let all: f64 = parts
            .iter()
            .map(|parts| parts.iter().map(|p| p[1]).sum::<f64>())
            .product();
        let mut cut = vec![];
        for x in &parts[0] {
            for y in &parts[1] {
                for z in &parts[2] {
                    cut.push(Seed {
                        position: [x[0], y[0], z[0]],
                        volume: seed.volume * (x[1] * y[1] * z[1] / all),
                        ..*seed
                    });
                }
            }
        }
        cut
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

/// A corner along an axis of pieces of that width around these places [m]: pieces may be off their places a little.
fn corner(edge: f64, a: usize, places: &[[f64; 3]]) -> f64 {
    let first = places[0][a];
    // Mean phase of places on a lattice of that spacing.
    let (mut s, mut c) = (0.0, 0.0);
    for place in places {
        let turn = std::f64::consts::TAU * (place[a] - first) / edge;
        s += turn.sin();
        c += turn.cos();
    }
    let phase = s.atan2(c) / std::f64::consts::TAU * edge;
    let least = places.iter().map(|place| place[a]);
    let least = least.fold(f64::INFINITY, f64::min);
    let steps = ((least - first - phase) / edge).round();
    first + phase + (steps - 0.5) * edge
}

/// A corner along an axis and the width of pieces that fit places best [m], from a first guess of both, and of the width of pieces of
/// cells. The mean of places is exact.
fn line([corner, width, edge]: [f64; 3], a: usize, places: &[[f64; 3]]) -> (f64, f64) {
    let count = places.len() as f64;
    let middle = |place: &[f64; 3]| ((place[a] - corner) / width).floor() + 0.5;
    let [x, k] = [
        places.iter().map(|place| place[a]).sum::<f64>() / count,
        places.iter().map(middle).sum::<f64>() / count,
    ];
    let (mut mixed, mut own) = (0.0, 0.0);
    for place in places {
        let off = middle(place) - k;
        mixed += off * (place[a] - x);
        own += off * off;
    }
    let width = if own > 0.0 { mixed / own } else { width };
    let middles = || places.iter().map(middle);
    let [least, most] = [
        middles().fold(f64::INFINITY, f64::min),
        middles().fold(f64::NEG_INFINITY, f64::max),
    ];
    // What ends at a plane of cells but for what places are uncertain by ends there.
    let all = most - least + 1.0;
    let planes = (all * width / edge).round();
    let width = match (all * width / edge - planes).abs() < UNCERTAIN {
        true => planes * edge / all,
        false => width,
    };
    (x - width * k, width)
}

/// Spacings of boxes of one volume beside each other at these places [m], if they do not fit a lattice of cubes of some width [m].
fn spacings(volume: f64, fitting: f64, places: &[[f64; 3]]) -> Option<[f64; 3]> {
    let width = volume.cbrt();
    let looked = &places[..places.len().min(LOOKED_AT)];
    // Per place and axis the way to the next one up it.
    let mut nearest = vec![[f64::INFINITY; 3]; looked.len()];
    for_near(looked, LONGEST * width, |n, _, d| {
        for (a, least) in nearest[n].iter_mut().enumerate() {
            let across = (0..3).filter(|b| *b != a).map(|b| d[b].abs());
            if d[a] > SHORTEST * width && across.fold(0.0, f64::max) < ASIDE * width {
                *least = least.min(d[a]);
            }
        }
    });
    // Per axis their sum, that of their squares, and how many there are.
    let mut ways = [[0.0; 3]; 3];
    for least in &nearest {
        for (way, &least) in ways.iter_mut().zip(least) {
            if least < LONGEST * width {
                let off = least - width;
                way[0] += off;
                way[1] += off * off;
                way[2] += 1.0;
            }
        }
    }
    let known = ways.map(|[sum, _, count]| (count > 0.0).then(|| width + sum / count));
    let product: f64 = known.iter().flatten().product();
    let unknown = known.iter().filter(|size| size.is_none()).count();
    // One layer is as thick as is left; a row of boxes is square.
    let rest = (volume / product).powf(1.0 / unknown.max(1) as f64);
    let size = known.map(|size| size.unwrap_or(rest));
    let fills = (size.iter().product::<f64>() / volume - 1.0).abs() < EXACT;
    let is_off = |a: usize| {
        let [sum, squares, count] = ways[a];
        let off = (size[a] - fitting).abs();
        let [least, most] = [f64::min, f64::max].map(|of| {
            places
                .iter()
                .map(|place| place[a])
                .reduce(of)
                .unwrap_or(0.0)
        });
        let all = (most - least) / size[a] + 1.0;
        let count = count.max(1.0);
        let variance = (squares / count - (sum / count).powi(2)).max(0.0);
        off > UNEVEN * fitting / all + DEVIATIONS * (variance / count).sqrt()
    };
    (fills && unknown < 3 && (0..3).any(is_off)).then_some(size)
}
