//! Laws and stories of the fast solver.

mod afloat;
mod boundaries;
mod carried;
mod coherence;
mod contact_laws;
mod costs;
mod edits;
mod episodes;
mod fields;
mod flowing;
mod grab;
mod held;
mod holding;
mod inside;
mod interrupted;
mod laws;
mod losses;
mod materials;
mod paint;
mod proxy;
mod ragged;
mod resting;
mod rigid;
mod robustness;
mod rules;
mod settling;
mod sleep;
mod solids;
mod spheres;
mod stories;
mod together;
mod touching;
mod walls;

use super::*;
use crate::{
    materials::Law,
    scene::Surface,
    test_scenes::{add_box, add_plane, ball, elastic, empty, falling_block, spin},
};

fn norm(v: [f64; 3]) -> f64 {
    v.iter().map(|v| v * v).sum::<f64>().sqrt()
}

fn distance(a: [f64; 3], b: [f64; 3]) -> f64 {
    norm(std::array::from_fn(|i| a[i] - b[i]))
}

#[test]
fn free_fall_is_a_parabola_whatever_the_substeps() {
    let mut scene = falling_block(Law::FixedCorotated);
    scene.colliders.clear();
    scene.objects[0].linear_velocity = [0.0; 3];
    scene.objects[0].velocity_gradient = [[0.0; 3]; 3];
    let mut world = World::new(scene).expect("valid scene");
    let mut start = world.report().objects[0].com;
    // Frames of many lengths, so that substeps change by up to a half; in the middle a command throws it up.
    let (mut time, mut speed) = (0.0, 0.0);
    let mut sizes = vec![];
    for n in 0..80 {
        let thrown = Command {
            client: 1,
            sequence: 0,
            apply_at_step: 0,
            action: crate::Action::SetVelocity {
                object: 0,
                linear: [0.0, 0.0, 3.0],
                angular: [0.0; 3],
            },
        };
        let mut commands = vec![];
        if n == 40 {
            (start, time, speed) = (world.report().objects[0].com, 0.0, 3.0);
            commands.push(thrown);
        }
        let length = [1.0 / 60.0, 1.0 / 300.0, 1.0 / 900.0, 1.0 / 37.0][n % 4];
        let report = world.step(length, &commands);
        sizes.push(report.dt);
        time += length;
        let risen = report.objects[0].com[2] - start[2];
        let expected = speed * time - 0.5 * 9.81 * time * time;
        // Round-off of positions in single precision, which are within four cells of 0.1 m.
        assert!(
            (risen - expected).abs() < 1e-6,
            "{n}: {risen} {expected} {:e}",
            risen - expected
        );
        // Velocities are those of half a substep before.
        let v = report.objects[0].linear_velocity[2];
        let expected = speed - 9.81 * (time - 0.5 * report.dt);
        assert!((v - expected).abs() < 1e-5, "{n}: {v} {expected}");
        // Nothing is touched: as much as single precision takes of the momentum, of up to 8 m/s.
        let [contact, mass] = [report.objects[0].contact_impulse[2], report.objects[0].mass];
        assert!(contact.abs() < 1e-5 * mass, "{n}: {contact} N s");
    }
    let fold = |f: fn(f64, f64) -> f64| sizes.iter().copied().reduce(f).expect("frames");
    assert!(fold(f64::max) > 1.2 * fold(f64::min), "{sizes:?}");
}

/// Runs frames and returns the state hashes.
fn hashes(scene: &Scene, isa: Isa, threads: usize, frames: usize) -> (Vec<u64>, u32) {
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .build()
        .expect("a small pool");
    pool.install(|| {
        let mut world = World::with_isa(scene.clone(), isa).expect("valid scene");
        let mut substeps = 0;
        let hashes = (0..frames)
            .map(|_| {
                let report = world.step(1.0 / 60.0, &[]);
                substeps += report.substeps;
                report.state_hash
            })
            .collect();
        (hashes, substeps)
    })
}

#[test]
fn threads_and_instruction_sets_never_show_in_the_bits() {
    let scene = falling_block(Law::FixedCorotated);
    let (expected, substeps) = hashes(&scene, Isa::Portable, 1, 84);
    assert!(substeps >= 500, "{substeps}");
    for isa in Isa::ALL.into_iter().filter(|isa| isa.is_available()) {
        for threads in [1, 2, 3] {
            let (found, _) = hashes(&scene, isa, threads, 84);
            assert_eq!(found, expected, "{isa} on {threads} threads");
        }
    }
}
