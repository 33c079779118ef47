//! Solids that a region holds at one end: mirror images have one answer, and energy stays.

use super::*;
use crate::scene::{Aabb, PinnedRegion, Solver};

const DX: f64 = 0.025;

/// A beam with so many free and held cells, its held end at the high end of an axis or at its low one, from whose border it hangs or
/// stands by a tenth of gravity across; its particles are off their places by a share of their spacing.
fn beam([free, held]: [usize; 2], axis: usize, high: bool, jitter: f64) -> Scene {
    let mut scene = empty(DX);
    scene.cfl = 0.8;
    scene.gravity[(axis + 1) % 3] = -1.0;
    let mut cells = [8; 3];
    cells[axis] = 2 * (free + held);
    let mut corner = [-2.0 * DX; 3];
    corner[axis] = -DX * if high { free } else { held } as f64;
    let material = elastic(Law::NeoHookean, 1e6, 0.3);
    add_box(&mut scene, material, corner, 0.5 * DX, cells);
    for (n, x) in scene.particles.position.iter_mut().enumerate() {
        for (a, x) in x.iter_mut().enumerate() {
            // The same on both sides of the border.
            *x += jitter * 0.5 * DX * (12.9 * (3 * n + a) as f64).sin();
        }
    }
    scene.objects[0].solver = Solver::Lagrangian;
    let (mut min, mut max) = ([-10.0; 3], [10.0; 3]);
    if high {
        min[axis] = 0.0;
    } else {
        max[axis] = 0.0;
    }
    scene
        .pinned_regions
        .push(PinnedRegion::fixed(Aabb { min, max }));
    scene
}

/// Largest sum of kinetic and elastic energy within the first and the last quarter of so many frames of a hundredth [J].
fn quarters(scene: Scene, frames: usize) -> [f64; 2] {
    let mut world = World::new(scene).expect("valid");
    let mut most = [0.0_f64; 2];
    for frame in 0..frames {
        let report = world.step(0.01, &[]);
        let energy = report.kinetic_energy + report.elastic_energy;
        match 4 * frame / frames {
            0 => most[0] = most[0].max(energy),
            3 => most[1] = most[1].max(energy),
            _ => {}
        }
    }
    most
}

/// At high ends it had 1e7 times the energy after 0.4 s, at low ones not.
#[test]
fn what_is_held_at_any_end_has_the_energy_of_its_mirror_image() {
    for (cells, jitter, frames) in [
        ([4, 2], 0.0, 40),
        ([4, 1], 0.0, 40),
        ([4, 4], 0.1, 40),
        ([7, 5], 0.0, 40),
        ([16, 2], 0.1, 80),
    ] {
        for axis in 0..3 {
            let ends = [false, true].map(|high| quarters(beam(cells, axis, high, jitter), frames));
            for [first, last] in ends {
                assert!(first > 0.0, "{cells:?} {axis}");
                assert!(last < 1.5 * first, "{cells:?} {axis}: {first} {last}");
            }
            // Places of particles that are off differ.
            let within = if jitter > 0.0 { 0.1 } else { 0.002 };
            for (low, high) in ends[0].iter().zip(ends[1]) {
                assert!(
                    (low / high - 1.0).abs() < within,
                    "{cells:?} {axis}: {ends:?}"
                );
            }
        }
    }
}
