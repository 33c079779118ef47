//! What nodes see of colliders, and when that matters.

use super::{
    flat::{AHEAD, approach_plane},
    *,
};
use crate::{
    colliders::{Boundaries, Substep},
    scene::{Pose, Surface},
    step::sort::{Newcomer, place},
    test_scenes::{add_plane, empty, random},
};

const NOW: Substep = Substep {
    time: 0.0,
    dt: 1e-3,
    kick: 1e-3,
    frame_start: 0.0,
    frame_length: 1e-2,
};

/// What particle blocks at all offsets see of one collider, in cells of about one in seven.
fn sights(normal: impl Fn(usize) -> [f32; 3]) -> Vec<([i32; 3], Vec<ClosestParticle>)> {
    let block = |(o, offset): (usize, &[i32; 3])| {
        let cells = (0..CUBE).filter(|n| (n * 31 + o * 17) % 7 == 0);
        let seen = cells.map(|n| ClosestParticle {
            body: 0,
            cell: [n / 36, n / 6 % 6, n % 6].map(|i| i as i32),
            nearest: GapSample {
                // Few different ones, so that many are equally near.
                gap: ((n * 37 + o * 11) % 23) as f32 - 9.0,
                normal: normal(n + 5 * o),
            },
        });
        (*offset, seen.collect())
    };
    OFFSETS.iter().enumerate().map(block).collect()
}

#[test]
fn a_node_sees_the_nearest_of_all_cells_around_it_and_no_other() {
    let normals: [fn(usize) -> [f32; 3]; 2] = [|_| [0.0, 1.0, 0.0], |n| [n as f32, 1.0, 2.0]];
    for normal in normals {
        let sights = sights(normal);
        let all = sights.iter();
        let reaching: Vec<_> = all
            .flat_map(|(offset, seen)| seen.iter().filter_map(|one| one.from(*offset)))
            .collect();
        let mut found = vec![GapSample::NONE; 2 * 64];
        spread(&reaching, &mut found, 1, 2);
        for at in 0..64 {
            let node = [at / 16, at / 4 % 4, at % 4].map(|i| i as i32);
            let mut expected = GapSample::NONE;
            for (offset, seen) in &sights {
                for one in seen {
                    // Cells -1..=4 of a block that lies four cells farther per offset.
                    let cell = |a: usize| one.cell[a] - 1 + 4 * offset[a];
                    if (0..3).all(|a| (cell(a) - node[a]).abs() <= 1) {
                        expected.take(&one.nearest);
                    }
                }
            }
            assert!(expected.gap < f32::INFINITY);
            assert_eq!(found[2 * at + 1], expected, "{node:?}");
            assert_eq!(found[2 * at], GapSample::NONE);
        }
    }
}

#[test]
fn what_nothing_is_near_to_is_near_to_nothing() {
    let mut found = vec![GapSample::NONE; 64];
    let far = GapSample {
        gap: 0.25,
        normal: [1.0, 0.0, 0.0],
    };
    // The last cell of the block reaches its last eight nodes.
    spread(&[(CUBE - 1 - 43, far)], &mut found, 0, 1);
    let near = found.iter().filter(|nearest| nearest.gap == 0.25).count();
    assert_eq!(near, 8);
    assert_eq!(found[63], far);
    assert_eq!(found[0], GapSample::NONE);
}

#[test]
fn what_is_clear_of_all_colliders_goes_on_as_it_was() {
    let mut scene = empty(0.1);
    for (normal, surface) in [
        ([0.0, 0.0, 1.0], Surface::Sticky),
        ([0.6, 0.0, 0.8], Surface::Slip),
        ([0.0, 1.0, 0.0], Surface::Separate),
    ] {
        add_plane(&mut scene, [0.0; 3], normal, surface, 0.5);
    }
    let boundaries = Boundaries::new(&scene, scene.dx);
    let conditions = boundaries.on_nodes(&vec![], &NOW);
    let bodies = conditions.bodies();
    let gaps = [0.26, 0.4, 0.9, f32::INFINITY];
    let nearest: Vec<GapSample> = (0..64 * bodies.len())
        .map(|n| GapSample {
            gap: gaps[n * 29 % 23 % 4],
            normal: bodies[n % bodies.len()]
                .distance([9.0; 3])
                .normal
                .map(|n| n as f32),
        })
        .collect();
    let allowed = BlockConstraints {
        nearest: nearest.clone(),
        is_outside: true,
        index: [0; 3],
        dt: NOW.dt,
        conditions: conditions.clone(),
    };
    let mut free = 0;
    for at in 0..64 {
        for n in 0..200 {
            // Up to three times as fast as what crosses the smallest gap.
            let turn = f64::from(n * 64 + at);
            let v = [1.3, 2.1, 3.7].map(|k| (k * turn).sin() * 2.6 * f64::from(n));
            let at = at as usize;
            let x = [at / 16, at / 4 % 4, at % 4].map(|i| i as f64);
            let near = &nearest[bodies.len() * at..][..bodies.len()];
            let obeyed = Attached::free(v);
            let expected = conditions.constrain(x, near, NOW.dt, 1.0, &obeyed, &mut |_| ());
            assert_eq!(
                allowed.constrain(at, &obeyed, &mut |_| ()),
                expected,
                "{near:?} {v:?}"
            );
            free += usize::from(is_clear(near, v, NOW.dt));
        }
    }
    assert!((1000..12_000).contains(&free), "{free} of 12800 are clear");
}

#[test]
fn gaps_to_a_half_space_are_those_of_its_particles_one_by_one() {
    let spacings = [0.5, 0.25, 0.4, 0.05];
    for (normal, turn) in [
        ([0.0, 0.0, 1.0], [0.0; 3]),
        ([0.6, 0.0, -0.8], [0.0; 3]),
        ([0.0, 1.0, 0.0], [0.4, 0.3, -0.2]),
    ] {
        let mut scene = empty(1.0);
        add_plane(&mut scene, [5.6, -2.3, 1.1], normal, Surface::Slip, 0.0);
        let centre = scene.colliders[0].pose.translation;
        scene.colliders[0].pose = Pose::turned(centre, turn);
        let boundaries = Boundaries::new(&scene, scene.dx);
        let conditions = boundaries.on_nodes(&vec![], &NOW);
        let body = &conditions.bodies()[0];
        // More groups than are looked at together, the last one not full, on both sides of the plane.
        let mut seed = 7;
        let newcomers: Vec<Newcomer> = (0..(AHEAD * LANES + 37) as u32)
            .map(|id| Newcomer {
                id,
                part: 0,
                x: [5.5, -2.5, 1.5].map(|x| x + 1.9 * random(&mut seed)),
                v: [0.0; 3],
                c: [0.0; 9],
                mass: 1.0,
            })
            .collect();
        let particles = place(&newcomers, &[0]);
        let half_spacings: Vec<f64> = (0..newcomers.len()).map(|n| spacings[n * 29 % 4]).collect();
        let mut seen = 0;
        for block in &particles.blocks {
            let mut expected = [GapSample::NONE; CUBE];
            for g in block.groups.clone() {
                let (fixed, x) = (&particles.fixed[g], &particles.groups[g].x);
                for lane in (0..LANES).filter(|&lane| fixed.id[lane] != NO_PARTICLE) {
                    let local = [x[0].0[lane], x[1].0[lane], x[2].0[lane]];
                    let at = position_in_cells(block.index, local);
                    let half_spacing = half_spacings[fixed.id[lane] as usize];
                    if let Some(nearest) = body.nearest_of(at, half_spacing, 1.0) {
                        let [i, j, k] = local.map(|x| (f64::from(x) + 3.0) as usize);
                        expected[(i * CELLS + j) * CELLS + k].take(&nearest);
                    }
                }
            }
            let found = approach_plane(block, &particles, &half_spacings, body);
            let gaps = found.map_or([f32::INFINITY; CUBE], |flat| flat.gaps);
            assert_eq!(gaps, expected.map(|nearest| nearest.gap), "{normal:?}");
            let with_more_lanes = see_plane(block, &particles, &half_spacings, body);
            assert_eq!(
                with_more_lanes.map(|flat| flat.gaps),
                found.map(|flat| flat.gaps)
            );
            let found = expected.iter().filter(|one| one.gap < f32::INFINITY);
            seen += found.count();
        }
        assert!(seen > 20, "{seen} cells");
    }
}

#[test]
fn a_node_block_takes_over_cells_shared_with_particle_blocks() {
    let from: [f32; CUBE] = std::array::from_fn(|n| ((n * 37) % 23) as f32);
    for offset in OFFSETS {
        let before: [f32; CUBE] = std::array::from_fn(|n| ((n * 31) % 29) as f32);
        let mut expected = before;
        for (n, gap) in from.iter().enumerate() {
            let seen = ClosestParticle {
                body: 0,
                cell: [n / 36, n / 6 % 6, n % 6].map(|i| i as i32),
                nearest: GapSample {
                    gap: *gap,
                    normal: [0.0; 3],
                },
            };
            if let Some((cell, nearest)) = seen.from(offset) {
                expected[cell] = expected[cell].min(nearest.gap);
            }
        }
        let mut found = before;
        merge(&from, offset, &mut found);
        assert_eq!(found, expected, "{offset:?}");
    }
}
