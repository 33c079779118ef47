//! Which node blocks boundaries reach, and the velocities they allow there.

use super::Velocities;
use crate::{colliders::NodeConditions, particles::BLOCK};

/// First and last node of a block [cells].
pub(super) fn corners(index: [i32; 3]) -> [[f64; 3]; 2] {
    let first = index.map(|i| f64::from(BLOCK * i));
    [first, first.map(|x| x + f64::from(BLOCK - 1))]
}

/// Whether any node of a block may be constrained.
pub(crate) fn covers_block(conditions: &NodeConditions<'_>, index: [i32; 3]) -> bool {
    let [first, last] = corners(index);
    conditions.cover(first, last)
}

/// Whether matter at the nodes of a block may be attached to flat boundaries.
pub(crate) fn attaches(conditions: &NodeConditions<'_>, index: [i32; 3]) -> bool {
    let [first, last] = corners(index);
    let mut faces = conditions.faces().iter();
    faces.any(|face| face.touches(first, last, 1.0))
}

/// What may act on the nodes of a block.
pub(crate) fn near_block<'a>(
    conditions: &NodeConditions<'a>,
    index: [i32; 3],
) -> NodeConditions<'a> {
    let [first, last] = corners(index);
    conditions.near(first, last)
}

/// Whether any node of a block has a mass.
pub(super) fn holds_matter(block: &Velocities) -> bool {
    let mut rows = block.0.iter().map(|row| row.0);
    rows.any(|row| row[3] != 0.0 || row[7] != 0.0 || row[11] != 0.0 || row[15] != 0.0)
}

/// Gives the nodes of a block, one by one, the velocity that boundaries allow at a place, where it has a mass, when it would be
/// another; returns the largest magnitude of a component as bits. Nodes without matter, which no particle reads, stay as they
/// are.
pub(super) fn constrain(
    out: &mut Velocities,
    frame_velocity: [f64; 3],
    mut allowed: impl FnMut(usize, f32, [f64; 3]) -> [f64; 3],
) -> u32 {
    let mut largest = 0;
    for at in 0..64 {
        let node = &mut out.0[at / 4].0[4 * (at % 4)..][..4];
        if node[3] == 0.0 {
            continue;
        }
        let v = std::array::from_fn(|a| f64::from(node[a]) + frame_velocity[a]);
        let v = allowed(at, node[3], v);
        for a in 0..3 {
            node[a] = (v[a] - frame_velocity[a]) as f32;
            largest = largest.max((v[a] as f32).abs().to_bits());
        }
    }
    largest
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        colliders::{Attached, Boundaries, GapSample, Substep},
        mat3::dot,
        scene::{Scene, Surface},
        test_scenes::{add_plane, empty},
    };

    fn planes(surface: Surface, normals: &[[f64; 3]]) -> Boundaries {
        let mut scene: Scene = empty(0.1);
        for &normal in normals {
            add_plane(&mut scene, [0.0; 3], normal, surface, 0.5);
        }
        Boundaries::new(&scene, scene.dx)
    }

    fn now(boundaries: &Boundaries) -> NodeConditions<'_> {
        let substep = Substep {
            time: 0.0,
            dt: 1e-3,
            kick: 1e-3,
            frame_start: 0.0,
            frame_length: 1e-2,
        };
        boundaries.on_nodes(&vec![], &substep)
    }

    /// Matter that touches all planes through the origin with these normals.
    fn touching(normals: &[[f64; 3]]) -> Vec<GapSample> {
        let of = |normal: &[f64; 3]| GapSample {
            gap: 0.0,
            normal: normal.map(|n| n as f32),
        };
        normals.iter().map(of).collect()
    }

    #[test]
    fn a_node_stops_what_touches_and_leaves_the_rest_alone() {
        let up = [0.0, 0.0, 1.0];
        let floor = planes(Surface::Separate, &[up]);
        let floor = now(&floor);
        let at = |z: f64, nearest: &[GapSample]| {
            floor.constrain(
                [0.0, 0.0, z],
                nearest,
                1e-3,
                1.0,
                &Attached::free([0.3, 0.4, -2.0]),
                &mut |_| (),
            )
        };
        for z in [-1.0, 0.0, 0.2] {
            assert_eq!(at(z, &touching(&[up])), [0.0; 3]);
            assert_eq!(at(z, &[GapSample::NONE]), [0.3, 0.4, -2.0]);
        }
        assert_eq!(at(1.0, &touching(&[up])), [0.3, 0.4, -2.0]);
    }

    #[test]
    fn a_node_in_a_corner_obeys_every_plane() {
        let (s, c) = 0.3_f64.sin_cos();
        let normals = [[s, 0.0, c], [-s, 0.0, c], [0.0, 1.0, 0.0]];
        let boundary = planes(Surface::Separate, &normals);
        let (x, v) = ([0.0, -1.0, -9.0], [1.0, -2.0, -3.0]);
        let (free, mut told) = (Attached::free(v), v);
        let v = now(&boundary).constrain(x, &touching(&normals), 1e-3, 1.0, &free, &mut |given| {
            assert_eq!(
                given.point,
                std::array::from_fn(|a| x[a] - dot(x, given.normal) * given.normal[a])
            );
            told = std::array::from_fn(|a| told[a] + given.change[a]);
        });
        for normal in normals {
            assert!(dot(v, normal) >= -1e-5, "{v:?} into {normal:?}");
        }
        // What is told adds up to all that changed.
        for a in 0..3 {
            assert!((told[a] - v[a]).abs() < 1e-14, "{told:?} and {v:?}");
        }
    }

    #[test]
    fn blocks_that_nothing_reaches_are_free() {
        let floor = planes(Surface::Separate, &[[0.0, 0.0, 1.0]]);
        let floor = now(&floor);
        assert!(covers_block(&floor, [5, 5, -1]));
        assert!(!covers_block(&floor, [5, 5, 1]));
    }
}
