//! Whether an object has room where it is to be put.
//!
//! Every particle stands for a cube as long as its half spacing to each side, along the axes of the world. Two objects overlap
//! where two cubes do by more than a part of their edge along every axis: so matter that is pressed together by its weight
//! does not, and neither do faces that are flush.

use std::collections::BTreeMap;

use super::World;
use crate::{
    colliders::Substep,
    command::{CommandError, Obstacle},
    scene::{Fidelity, Pose},
};

/// Part of the edges of two cubes, in the mean, by which they may overlap: in a filled body the cube that is nearest to any
/// point overlaps with another by a half at least.
const TOLERATED: f64 = 0.4;

/// A particle as a cube [m].
#[derive(Clone, Copy, Debug)]
struct Cube {
    x: [f64; 3],
    half: f64,
}

impl Cube {
    fn low(&self, a: usize) -> f64 {
        self.x[a] - self.half
    }

    fn high(&self, a: usize) -> f64 {
        self.x[a] + self.half
    }

    fn overlaps(&self, other: &Self) -> bool {
        let reach = (1.0 - TOLERATED) * (self.half + other.half);
        (0..3).all(|a| (self.x[a] - other.x[a]).abs() < reach)
    }
}

/// Box around cubes [m].
fn bounds(cubes: &[Cube]) -> [[f64; 3]; 2] {
    let mut found = [[f64::INFINITY; 3], [f64::NEG_INFINITY; 3]];
    for cube in cubes {
        for a in 0..3 {
            found[0][a] = found[0][a].min(cube.low(a));
            found[1][a] = found[1][a].max(cube.high(a));
        }
    }
    found
}

/// Whether a cube of one list overlaps with one of the other.
fn any_overlap(these: &[Cube], those: &[Cube]) -> bool {
    let all = these.iter().chain(those);
    let edge = 2.0 * all.map(|cube| cube.half).fold(0.0, f64::max);
    let cell = |x: [f64; 3]| x.map(|x| (x / edge).floor() as i64);
    let mut cells: BTreeMap<[i64; 3], Vec<Cube>> = BTreeMap::new();
    for cube in those {
        cells.entry(cell(cube.x)).or_default().push(*cube);
    }
    these.iter().any(|cube| {
        let [x, y, z] = cell(cube.x);
        (x - 1..=x + 1).any(|x| {
            (y - 1..=y + 1).any(|y| {
                let column = cells.range([x, y, z - 1]..=[x, y, z + 1]);
                column.flat_map(|(_, near)| near).any(|n| cube.overlaps(n))
            })
        })
    })
}

/// The shortest way along an axis of the world after which `these` are beside `those` [m].
fn way_out(these: &[Cube], those: &[Cube]) -> [f64; 3] {
    let all = these.iter().chain(those);
    let edge = 2.0 * all.map(|cube| cube.half).fold(0.0, f64::max);
    let mut best = [f64::INFINITY, 0.0, 0.0];
    let mut shortest = f64::INFINITY;
    for axis in 0..3 {
        let (p, q) = ((axis + 1) % 3, (axis + 2) % 3);
        // The columns that a cube is in.
        let columns = |cube: &Cube| {
            let span = |a: usize| {
                let shy = 0.5 * TOLERATED * cube.half;
                let cell = |x: f64| (x / edge).floor() as i64;
                cell(cube.low(a) + shy)..=cell(cube.high(a) - shy)
            };
            let (p, q) = (span(p), span(q));
            p.flat_map(move |i| q.clone().map(move |j| (i, j)))
        };
        let mut known: BTreeMap<(i64, i64), [f64; 2]> = BTreeMap::new();
        for cube in those {
            for column in columns(cube) {
                let open = [f64::INFINITY, f64::NEG_INFINITY];
                let extent = known.entry(column).or_insert(open);
                extent[0] = extent[0].min(cube.low(axis));
                extent[1] = extent[1].max(cube.high(axis));
            }
        }
        let (mut up, mut down) = (0.0_f64, 0.0_f64);
        for cube in these {
            for [low, high] in columns(cube).filter_map(|column| known.get(&column)) {
                up = up.max(high - cube.low(axis));
                down = down.max(cube.high(axis) - low);
            }
        }
        for (length, sign) in [(up, 1.0), (down, -1.0)] {
            if length < shortest {
                shortest = length;
                best = [0.0; 3];
                best[axis] = sign * length;
            }
        }
    }
    best
}

impl World {
    /// Whether there is room for an object after a rigid motion: in the domain, beside colliders and other objects.
    pub(super) fn check_room(&self, object: usize, way: &Pose) -> Result<(), CommandError> {
        let all = self.cubes(object);
        let moved = all.map(|cube| Cube {
            x: way.point(cube.x),
            ..cube
        });
        let moved: Vec<Cube> = moved.collect();
        if moved.is_empty() {
            return Ok(());
        }
        self.check_domain(object, &moved)?;
        self.check_colliders(object, &moved)?;
        let [low, high] = bounds(&moved);
        for other in (0..self.model.scene.objects.len()).filter(|&other| other != object) {
            if self.is_removed(other) {
                continue;
            }
            let near = |cube: &Cube| (0..3).all(|a| cube.high(a) > low[a] && cube.low(a) < high[a]);
            let those: Vec<Cube> = self.cubes(other).filter(near).collect();
            if !those.is_empty() && any_overlap(&moved, &those) {
                let those: Vec<Cube> = self.cubes(other).collect();
                return Err(CommandError::Overlap {
                    object,
                    with: Obstacle::Object(other),
                    way_out: way_out(&moved, &those),
                });
            }
        }
        Ok(())
    }

    fn check_domain(&self, object: usize, moved: &[Cube]) -> Result<(), CommandError> {
        let domain = self.model.scene.domain;
        if let Some(cube) = moved.iter().find(|cube| !domain.contains(cube.x)) {
            let outside = |a: &usize| !(domain.min[*a]..=domain.max[*a]).contains(&cube.x[*a]);
            let axis = (0..3).find(outside).unwrap_or(0);
            return Err(CommandError::Outside {
                object,
                axis: ['x', 'y', 'z'][axis],
                value: cube.x[axis],
                min: domain.min[axis],
                max: domain.max[axis],
            });
        }
        Ok(())
    }

    fn check_colliders(&self, object: usize, moved: &[Cube]) -> Result<(), CommandError> {
        let time = self.state.progress.sim_time;
        let now = Substep {
            time,
            dt: 0.0,
            kick: 0.0,
            frame_start: time,
            frame_length: 0.0,
        };
        for placed in self.model.solids.all(&self.state.commanded.paths, &now) {
            let (mut depth, mut normal) = (0.0, [0.0; 3]);
            for cube in moved {
                let near = placed.distance(cube.x);
                let inside = cube.half - near.value;
                if inside > 2.0 * TOLERATED * cube.half && inside > depth {
                    (depth, normal) = (inside, near.normal);
                }
            }
            if depth > 0.0 {
                return Err(CommandError::Overlap {
                    object,
                    with: Obstacle::Collider(placed.id),
                    way_out: normal.map(|n| depth * n),
                });
            }
        }
        Ok(())
    }

    /// What there is of an object, or was before it was removed; nothing of one that is only shown.
    fn cubes(&self, object: usize) -> impl Iterator<Item = Cube> + '_ {
        let scene = &self.model.scene;
        let range = match scene.objects[object].fidelity {
            Fidelity::Static => 0..0,
            _ => scene.objects[object].particles.clone(),
        };
        let away = self.state.commanded.away[object].as_ref();
        let own = range.clone();
        let gone = away
            .into_iter()
            .flat_map(move |away| away.lifted.ids(own.clone()));
        let there = range.filter(|&p| self.published.volume[p] > 0.0);
        let ids = there.chain(gone.map(|id| id as usize));
        ids.map(|p| Cube {
            x: self.published.cells[p].map(|x| x * scene.dx),
            half: self.model.half_spacings[p] * scene.dx,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn block(corner: [f64; 3], count: usize) -> Vec<Cube> {
        let place = |n: usize| [n / (count * count), n / count % count, n % count];
        let all = (0..count.pow(3)).map(place);
        all.map(|n| Cube {
            x: std::array::from_fn(|a| corner[a] + 0.1 * n[a] as f64 + 0.05),
            half: 0.05,
        })
        .collect()
    }

    #[test]
    fn blocks_overlap_from_two_fifths_of_a_spacing_on() {
        let floor = block([0.0; 3], 6);
        for aside in [0.0, 0.03, 0.05] {
            for (depth, overlaps) in [(0.0, false), (0.035, false), (0.055, true), (0.3, true)] {
                let above = block([aside, aside, 0.6 - depth], 6);
                assert_eq!(any_overlap(&above, &floor), overlaps, "{aside} {depth}");
                let out = way_out(&above, &floor);
                let expected = [0.0, 0.0, depth];
                let off = (0..3)
                    .map(|a| (out[a] - expected[a]).abs())
                    .fold(0.0, f64::max);
                assert!(off < 1e-9, "{out:?}");
            }
        }
    }
}
