//! Held regions that reach into a solid: matter in them has mass and no stress, and the border is held where it is.
//!
//! Nodes alone cannot hold a border between them: those behind it have to move for matter before it to strain, and what they drag along
//! there is rigid.

use super::{
    facets::beside,
    lattice::{Lattice, Seed},
};
use crate::scene::TurnedBox;

/// The part of matter that is held: it has no law.
pub(crate) const HELD_PART: u16 = u16::MAX;
/// Columns of a piece along each axis by which what is inside is measured.
const COLUMNS: usize = 8;
/// Halvings of a way to the border.
const HALVINGS: usize = 40;
/// Share of a piece from which on a part of it counts.
const SMALLEST: f64 = 1e-6;

/// A place of the border of a region amid matter.
#[derive(Clone, Copy, Debug)]
pub(super) struct BorderPoint {
    /// The region, by its place in the list.
    pub region: usize,
    /// Where [m].
    pub x: [f64; 3],
    /// Area that it stands for [m^2].
    pub area: f64,
    /// Where matter is at it [m].
    pub owner: [f64; 3],
}

/// Pieces of matter cut at the borders of regions.
#[derive(Debug, Default)]
pub(super) struct CutAtBorders {
    /// Along the axes of the lattice.
    pub pieces: Vec<Seed>,
    pub border: Vec<BorderPoint>,
}

/// What of a piece is in a region.
enum Inside {
    None,
    All,
    /// Share of its volume, and centroids of what is inside and of what is not, along the axes of the lattice [m].
    Part(f64, [[f64; 3]; 2]),
}

/// Cuts pieces [along the axes of the lattice] at the borders of regions.
pub(super) fn cut_at_borders(
    lattice: &Lattice,
    pieces: Vec<Seed>,
    regions: &[TurnedBox],
) -> CutAtBorders {
    let mut cut = CutAtBorders::default();
    if regions.is_empty() {
        cut.pieces = pieces;
        return cut;
    }
    let mut whole = std::collections::BTreeMap::new();
    for piece in &pieces {
        let found = regions.iter().enumerate().find_map(|(n, region)| {
            let inside = inside(lattice, piece, region);
            (!matches!(inside, Inside::None)).then_some((n, inside))
        });
        let Some((region, inside)) = found else {
            whole.insert(lattice.index(piece.position), (piece, None));
            cut.pieces.push(*piece);
            continue;
        };
        let held = Seed {
            part: HELD_PART,
            ..*piece
        };
        match inside {
            Inside::Part(share, [within, beyond]) => {
                for (part, position, share) in
                    [(held, within, share), (*piece, beyond, 1.0 - share)]
                {
                    cut.pieces.push(Seed {
                        position,
                        volume: share * piece.volume,
                        ..part
                    });
                }
                cut.border.push(border(
                    lattice,
                    region,
                    &regions[region],
                    [within, beyond],
                    piece,
                ));
            }
            _ => {
                whole.insert(lattice.index(piece.position), (piece, Some(region)));
                cut.pieces.push(held);
            }
        }
    }
    // Where the border is between pieces.
    for (index, (piece, region)) in &whole {
        let Some(region) = *region else { continue };
        for next in beside(index) {
            if let Some((other, None)) = whole.get(&next) {
                let ends = [piece.position, other.position];
                let least = if other.volume < piece.volume {
                    other
                } else {
                    piece
                };
                cut.border
                    .push(border(lattice, region, &regions[region], ends, least));
            }
        }
    }
    cut
}

/// Where the way from one place to another leaves a region, of matter like a piece.
fn border(
    lattice: &Lattice,
    number: usize,
    region: &TurnedBox,
    [mut within, mut beyond]: [[f64; 3]; 2],
    piece: &Seed,
) -> BorderPoint {
    for _ in 0..HALVINGS {
        let middle = std::array::from_fn(|a| 0.5 * (within[a] + beyond[a]));
        match region.contains(lattice.world(middle)) {
            true => within = middle,
            false => beyond = middle,
        }
    }
    BorderPoint {
        region: number,
        x: lattice.world(within),
        area: piece.volume / lattice.edge,
        owner: lattice.world(piece.position),
    }
}

/// What of a piece, which fills its place on the lattice about its centroid, is in a region.
fn inside(lattice: &Lattice, piece: &Seed, region: &TurnedBox) -> Inside {
    let center = piece.position;
    let half = lattice.room_about(center);
    let corner = |n: usize| {
        let side = [n / 4, n / 2 % 2, n % 2].map(|o| 2.0 * o as f64 - 1.0);
        lattice.world(std::array::from_fn(|a| center[a] + side[a] * half[a]))
    };
    let count = (0..8).filter(|&n| region.contains(corner(n))).count();
    if count == 8 {
        return Inside::All;
    }
    let radius = half.iter().map(|h| h * h).sum::<f64>().sqrt();
    if count == 0 && !region.grown(radius).contains(lattice.world(center)) {
        return Inside::None;
    }
    // Columns along the axis that the border is most across: ends of what is inside are exact there.
    let spans = |axis: usize| columns(lattice, center, half, axis, region);
    let across = |axis: usize| {
        let cut = spans(axis)
            .filter(|(_, [low, high])| high - low > 0.0 && high - low < 2.0 * half[axis]);
        cut.count()
    };
    let axis = (0..3).max_by_key(|&axis| across(axis)).unwrap_or(0);
    let all = (COLUMNS * COLUMNS) as f64 * 2.0 * half[axis];
    let (mut length, mut moment) = (0.0, [0.0; 3]);
    for (place, [low, high]) in spans(axis) {
        let part = (high - low).max(0.0);
        length += part;
        for a in 0..3 {
            let middle = if a == axis {
                0.5 * (low + high)
            } else {
                place[a]
            };
            moment[a] += part * middle;
        }
    }
    let share = length / all;
    if share < SMALLEST {
        return Inside::None;
    }
    if share > 1.0 - SMALLEST {
        return Inside::All;
    }
    let within: [f64; 3] = std::array::from_fn(|a| moment[a] / length);
    let beyond = std::array::from_fn(|a| (center[a] - share * within[a]) / (1.0 - share));
    Inside::Part(share, [within, beyond])
}

/// Columns of a box along an axis: where each is, and from where to where it is in a region, along the axes of the lattice [m].
fn columns(
    lattice: &Lattice,
    center: [f64; 3],
    half: [f64; 3],
    axis: usize,
    region: &TurnedBox,
) -> impl Iterator<Item = ([f64; 3], [f64; 2])> {
    (0..COLUMNS * COLUMNS).map(move |n| {
        let mut place = center;
        for (a, n) in [((axis + 1) % 3, n / COLUMNS), ((axis + 2) % 3, n % COLUMNS)] {
            place[a] += half[a] * ((2 * n + 1) as f64 / COLUMNS as f64 - 1.0);
        }
        let at = |s: f64| {
            let mut x = place;
            x[axis] = s;
            lattice.world(x)
        };
        let ends = [-1.0, 1.0].map(|side| center[axis] + side * half[axis]);
        (
            place,
            region
                .clip(ends.map(at))
                .map(|t| ends[0] + t * (ends[1] - ends[0])),
        )
    })
}
