//! Laws of Gaussians in motion.

use super::*;
use crate::{
    materials::Law,
    scene::{BINDING_NEIGHBORS, Binding, Gaussians},
    test_scenes::{add_box, elastic, empty},
};

/// Binds every Gaussian to its nearest particles, the nearer the more.
fn nearest(scene: &Scene) -> Binding {
    let bound = scene.gaussians.position.iter().map(|center| {
        let squared =
            |p: &[f64; 3]| -> f64 { (0..3).map(|a| (p[a] - f64::from(center[a])).powi(2)).sum() };
        let mut order: Vec<(f64, u32)> = scene
            .particles
            .position
            .iter()
            .map(squared)
            .zip(0..)
            .collect();
        order.sort_by(|a, b| a.0.total_cmp(&b.0));
        let near: [(f64, u32); BINDING_NEIGHBORS] = std::array::from_fn(|n| order[n]);
        let weight = near.map(|(squared, _)| 1.0 / (1e-4 + squared));
        let sum: f64 = weight.iter().sum();
        (near.map(|(_, id)| id), weight.map(|w| (w / sum) as f32))
    });
    let (particle, weight) = bound.unzip();
    Binding { particle, weight }
}

/// A box of 4^3 particles away from the origin, with `gaussians` anisotropic Gaussians in and around it.
fn scene(gaussians: usize) -> Scene {
    let mut scene = empty(0.1);
    let material = elastic(Law::FixedCorotated, 1e5, 0.3);
    add_box(&mut scene, material, [3.0, -2.0, 5.0], 0.05, [4, 4, 4]);
    let place = |i: usize, k: f32| (i as f32 * k).fract() * 0.24 - 0.02;
    scene.gaussians = Gaussians {
        position: (0..gaussians)
            .map(|i| {
                [
                    3.0 + place(i, 0.618),
                    -2.0 + place(i, 0.755),
                    5.0 + place(i, 0.570),
                ]
            })
            .collect(),
        scale: (0..gaussians).map(|_| [0.02, 0.01, 0.0005]).collect(),
        rotation: (0..gaussians)
            .map(|i| {
                let half = i as f32 * 0.37;
                [0.6 * half.sin(), 0.0, 0.8 * half.sin(), half.cos()]
            })
            .collect(),
        opacity: vec![1.0; gaussians],
        sh: vec![0.0; 3 * gaussians],
        ..Gaussians::default()
    };
    scene.objects[0].gaussians = 0..gaussians;
    scene.binding = nearest(&scene);
    scene
}

/// Poses when every particle moves by `x -> m X + t` with deformation gradient `m`.
fn moved(scene: &Scene, m: &Mat3<f64>, t: [f64; 3]) -> Vec<GaussianPose> {
    let position: Vec<_> = scene
        .particles
        .position
        .iter()
        .map(|x| {
            let y = m.mul_vec(*x);
            [0, 1, 2].map(|a| (y[a] + t[a]) as f32)
        })
        .collect();
    let f = m.0.as_flattened().iter().map(|v| *v as f32);
    let f: Vec<f32> = f.collect();
    let deformation = vec![std::array::from_fn(|i| f[i]); position.len()];
    let mut out = vec![GaussianPose::default(); scene.gaussians.len()];
    Poses::new(scene, labels).write(&position, &deformation, &mut out);
    out
}

/// A rotation about (1, 2, 2) / 3.
fn turn(angle: f64) -> Mat3<f64> {
    let (s, c) = ((angle / 2.0).sin() / 3.0, (angle / 2.0).cos());
    Mat3::from_quaternion([s, 2.0 * s, 2.0 * s, c])
}

fn matrix(c: &[f32; 6]) -> Mat3<f64> {
    let [a, b, d, e, f, g] = c.map(f64::from);
    Mat3([[a, b, d], [b, e, f], [d, f, g]])
}

fn distance(a: &Mat3<f64>, b: &Mat3<f64>) -> f64 {
    (a.sub(b).norm_squared() / b.norm_squared()).sqrt()
}

#[test]
fn at_rest_gaussians_are_where_the_asset_has_them() {
    let scene = scene(200);
    let poses = moved(&scene, &Mat3::identity(), [0.0; 3]);
    for (pose, rest) in poses.iter().zip(&scene.gaussians.position) {
        for a in 0..3 {
            // Two roundings at coordinates below 8.
            assert!((pose.position[a] - rest[a]).abs() < 2e-6);
        }
        assert_eq!(pose.rotation, scene.objects[0].world_from_asset);
    }
}

#[test]
fn rigid_motion_turns_covariance_and_rotation() {
    let scene = scene(200);
    let rest = moved(&scene, &Mat3::identity(), [0.0; 3]);
    let r = turn(1.1);
    let poses = moved(&scene, &r, [1.0, -4.0, 2.0]);
    for (i, (pose, rest)) in poses.iter().zip(&rest).enumerate() {
        let expected = r.mul(&matrix(&rest.covariance)).mul_transposed(&r);
        // The gate of design section 6 on Gaussian kinematics: 1e-5.
        assert!(distance(&matrix(&pose.covariance), &expected) < 1e-5, "{i}");
        let x = r.mul_vec(rest.position.map(f64::from));
        for (a, t) in [1.0, -4.0, 2.0].into_iter().enumerate() {
            assert!((f64::from(pose.position[a]) - x[a] - t).abs() < 5e-6, "{i}");
        }
        let turned = Mat3::from_quaternion(pose.rotation);
        let turned = Mat3(turned.0.map(|row| row.map(f64::from)));
        assert!(distance(&turned, &r) < 1e-5, "{i}");
    }
}

#[test]
fn volume_of_a_gaussian_follows_the_determinant() {
    let scene = scene(50);
    let rest = moved(&scene, &Mat3::identity(), [0.0; 3]);
    let m = Mat3([[1.2, 0.3, 0.0], [-0.1, 0.9, 0.2], [0.05, 0.0, 1.4]]);
    let j = m.det();
    for (pose, rest) in moved(&scene, &m, [0.0; 3]).iter().zip(&rest) {
        // Determinants of discs of aspect 40: f32 keeps about three digits of them, so the reference is the
        // covariance that f64 makes of the same rest covariance.
        let expected = m.mul(&matrix(&rest.covariance)).mul_transposed(&m);
        assert!(distance(&matrix(&pose.covariance), &expected) < 1e-5);
        let ratio = expected.det() / matrix(&rest.covariance).det();
        assert!((ratio / (j * j) - 1.0).abs() < 1e-4);
    }
}

#[test]
fn needles_are_limited_and_nothing_becomes_nan() {
    let mut scene = scene(20);
    scene.gaussians.scale.fill([0.01; 3]);
    let cases = [
        Mat3::diagonal([100.0, 1.0, 0.1]),
        Mat3::diagonal([1.0, 1.0, 0.0]),
        Mat3::diagonal([1.0, 1.0, -1.0]),
        Mat3::diagonal([0.0, 0.0, 0.0]),
        Mat3([[1.0, 400.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]),
        Mat3::diagonal([f64::NAN, 1.0, 1.0]),
    ];
    for m in &cases {
        for pose in moved(&scene, m, [0.0; 3]) {
            let c = matrix(&pose.covariance);
            assert!(c.norm_squared().is_finite(), "{m:?}");
            let sigma = svd(&c).sigma;
            // Stretches are the roots of covariance ratios for a ball; the margin is round-off of the small one.
            let aspect = (sigma[0] / sigma[2]).sqrt();
            assert!(aspect < 1.01 * f64::from(MAX_ASPECT), "{m:?}: {aspect}");
            let length: f32 = pose.rotation.iter().map(|q| q * q).sum();
            assert!((length - 1.0).abs() < 1e-5, "{m:?}");
        }
    }
}

#[test]
fn static_gaussians_keep_their_rest_pose() {
    let mut scene = scene(10);
    scene.objects[0].fidelity = Fidelity::Static;
    let poses = moved(&scene, &turn(0.7), [5.0; 3]);
    for (pose, rest) in poses.iter().zip(&scene.gaussians.position) {
        assert_eq!(pose.position, *rest);
    }
}

/// Among others what is not a number as a float.
fn labels(index: usize) -> [u32; 3] {
    [u32::MAX - index as u32, 0x7f80_0001, index as u32]
}

/// To the bit.
#[test]
fn labels_come_back_and_nothing_is_written_beyond_the_scene() {
    // The larger one is written past the caches.
    for count in [100, STREAMED / size_of::<GaussianPose>() + 5] {
        let scene = scene(count);
        let position = scene.particles.position.iter();
        let position: Vec<_> = position.map(|x| x.map(|x| x as f32)).collect();
        let deformation = vec![[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]; position.len()];
        let mut out = vec![GaussianPose::default(); count + 3];
        Poses::new(&scene, labels).write(&position, &deformation, &mut out);
        for (i, pose) in out[..count].iter().enumerate() {
            assert_eq!([pose.label, pose.labels[0], pose.labels[1]], labels(i));
            assert_eq!(pose.rotation, scene.objects[0].world_from_asset, "{i}");
        }
        assert_eq!(out[count..], [GaussianPose::default(); 3]);
    }
}

#[test]
fn parts_of_a_frame_have_the_bits_of_the_whole() {
    let scene = scene(333);
    let position: Vec<_> = (0..64_u16).map(|i| [f32::from(i).sin(); 3]).collect();
    let deformation: Vec<[f32; 9]> = (0..64_u16)
        .map(|i| std::array::from_fn(|j| f32::from(i + 7 * j as u16).cos()))
        .collect();
    let poses = Poses::new(&scene, labels);
    let mut whole = vec![GaussianPose::default(); 333];
    poses.write(&position, &deformation, &mut whole);
    for range in [0..7, 7..8, 8..32, 32..48, 47..300, 300..333, 5..5, 0..333] {
        let mut part = vec![GaussianPose::default(); range.len()];
        poses.write_part(range.clone(), 0, &position, &deformation, &mut part);
        assert_eq!(part, whole[range.clone()], "{range:?}");
    }
}

#[test]
fn every_instruction_set_gives_the_same_bits() {
    // The last group is not full, and the larger scene is written past the caches.
    for count in [333, STREAMED / size_of::<GaussianPose>() + 5] {
        instruction_sets_agree(&scene(count));
    }
}

fn instruction_sets_agree(scene: &Scene) {
    let position: Vec<_> = (0..64_u16)
        .map(|i| [0.1, 0.07, 0.03].map(|k| (f32::from(i) * k).sin()))
        .collect();
    let deformation: Vec<[f32; 9]> = (0..64_u16)
        .map(|i| std::array::from_fn(|j| f32::from(i + 7 * j as u16).cos()))
        .collect();
    let run = |isa: Isa| {
        let mut out = vec![GaussianPose::default(); scene.gaussians.len()];
        Poses::with_isa(scene, labels, isa).write(&position, &deformation, &mut out);
        out
    };
    let expected = run(Isa::Portable);
    for isa in Isa::ALL.into_iter().filter(|isa| isa.is_available()) {
        assert_eq!(run(isa), expected, "{isa}");
    }
}
