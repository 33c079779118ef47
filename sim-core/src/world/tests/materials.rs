//! Every material: the same bits on any number of threads, any instruction set, and from a checkpoint on.

use super::*;
use crate::{scene::MaterialRegion, test_scenes::one_of_each};

/// A visible block of the material, one corner of it rubber, that a second one hits while it slides over a floor
/// into a wall.
fn pile_up(material: &Material) -> Scene {
    let mut scene = empty(0.1);
    scene.gravity = [0.0, 0.0, -9.81];
    add_box(
        &mut scene,
        material.clone(),
        [-0.2, -0.07, 0.02],
        0.05,
        [5, 4, 4],
    );
    add_box(
        &mut scene,
        material.clone(),
        [-0.23, -0.1, 0.33],
        0.05,
        [4, 5, 4],
    );
    let first = &mut scene.objects[0];
    first.gaussians = 0..1;
    first.regions.push(MaterialRegion {
        particles: first.particles.end - 16..first.particles.end,
        material: elastic(Law::NeoHookean, 3e5, 0.3),
    });
    first.linear_velocity = [1.5, 0.2, 0.0];
    scene.objects[1].velocity_gradient = spin([1.0, -2.0, 3.0]);
    for (point, normal) in [
        ([0.0; 3], [0.0, 0.0, 1.0]),
        ([0.4, 0.0, 0.0], [-1.0, 0.0, 0.0]),
    ] {
        add_plane(&mut scene, point, normal, Surface::Separate, 0.3);
    }
    scene
}

/// Enough substeps for the gate even where the law limits no substep.
const FRAME_DT: f64 = 1.0 / 1500.0;

struct Run {
    isa: Isa,
    threads: usize,
    /// Frames to skip by starting from this checkpoint.
    from: Option<Vec<u8>>,
}

/// Hash after every frame from `first` to `last`, the checkpoint at `first` and the substeps taken.
fn run(scene: &Scene, setup: &Run, frames: std::ops::Range<usize>) -> (Vec<u64>, Vec<u8>, u32) {
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(setup.threads)
        .build()
        .expect("a small pool");
    pool.install(|| {
        let mut world = World::with_isa(scene.clone(), setup.isa).expect("valid scene");
        let start = match &setup.from {
            Some(bytes) => {
                world.restore(bytes).expect("a checkpoint of this scene");
                frames.start
            }
            None => 0,
        };
        let (mut hashes, mut checkpoint, mut substeps) = (vec![], vec![], 0);
        for frame in start..frames.end {
            if frame == frames.start {
                checkpoint = world.checkpoint();
            }
            let report = world.step(FRAME_DT, &[]);
            substeps += report.substeps;
            assert!(report.quarantined.is_empty(), "{:?}", report.quarantined);
            if frame >= frames.start {
                hashes.push(report.state_hash);
            }
        }
        (hashes, checkpoint, substeps)
    })
}

#[test]
fn no_material_shows_threads_isa_or_a_restart_in_its_bits() {
    for material in one_of_each() {
        let scene = pile_up(&material);
        let plain = |isa, threads| Run {
            isa,
            threads,
            from: None,
        };
        let frames = 600..2000;
        let best = Isa::detect();
        let (expected, checkpoint, substeps) = run(&scene, &plain(best, 1), frames.clone());
        let law = material.law;
        assert!(substeps >= 2000, "{law:?}: only {substeps} substeps");
        for threads in [2, 3, 8] {
            let (found, _, _) = run(&scene, &plain(best, threads), frames.clone());
            assert!(found == expected, "{law:?} on {threads} threads");
        }
        for isa in Isa::ALL.into_iter().filter(|isa| isa.is_available()) {
            if isa != best {
                let (found, _, _) = run(&scene, &plain(isa, 2), frames.clone());
                assert!(found == expected, "{law:?} on {isa}");
            }
            let restarted = Run {
                isa,
                threads: 2,
                from: Some(checkpoint.clone()),
            };
            let (found, again, _) = run(&scene, &restarted, frames.clone());
            assert!(found == expected, "{law:?} restored on {isa}");
            assert!(again == checkpoint, "{law:?}: another checkpoint on {isa}");
        }
    }
}

#[test]
fn flowing_matter_shows_its_flow_and_little_elastic_strain() {
    for material in one_of_each() {
        let law = material.law;
        if !law.is_plastic() {
            continue;
        }
        let mut world = World::new(pile_up(&material)).expect("valid scene");
        for _ in 0..900 {
            world.step(FRAME_DT, &[]);
        }
        let arrays = world.arrays();
        let strain = |f: &[[f32; 3]; 3]| {
            let f = crate::mat3::Mat3(f.map(|row| row.map(f64::from)));
            let green = f.transpose().mul(&f).sub(&crate::mat3::Mat3::identity());
            0.5 * green.norm_squared().sqrt()
        };
        let plastic = world.model.scene.parts()[0].particles.clone();
        let of = |f: &[[[f32; 3]; 3]]| plastic.clone().map(|p| strain(&f[p])).fold(0.0, f64::max);
        let (visible, hidden) = (of(arrays.deformation), of(arrays.elastic));
        assert!(
            visible > 2.0 * hidden && visible > 0.05,
            "{law:?}: visible {visible}, elastic {hidden}"
        );
    }
}
