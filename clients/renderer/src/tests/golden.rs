//! Committed pictures of small scenes: unmeant changes of the rasteriser show here.
//!
//! `COSPLAT_BLESS=1 cargo test -p cosplat-renderer golden` writes them anew; look at them before committing.

use std::fs::File;
use std::io::BufReader;
use std::path::{Path, PathBuf};

use cosplat_ipc::schema::GaussianState;
use glam::{Quat, Vec3};

use super::scenes::{self, Scene, gaussian};
use crate::{Harmonics, Image, picture, png::write_png};

fn path(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("golden")
        .join(format!("{name}.png"))
}

fn read(path: &Path) -> Image {
    let file = File::open(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    let mut reader = png::Decoder::new(BufReader::new(file)).read_info().unwrap();
    let mut rgb = vec![0; reader.output_buffer_size().unwrap()];
    let info = reader.next_frame(&mut rgb).unwrap();
    Image {
        width: info.width,
        height: info.height,
        rgb,
    }
}

fn check(name: &str, image: &Image) {
    let path = path(name);
    if std::env::var_os("COSPLAT_BLESS").is_some() {
        write_png(&path, image).unwrap();
    }
    let golden = read(&path);
    assert_eq!((golden.width, golden.height), (image.width, image.height));
    let differences: Vec<u8> = golden
        .rgb
        .iter()
        .zip(&image.rgb)
        .map(|(a, b)| a.abs_diff(*b))
        .filter(|d| *d > 0)
        .collect();
    // Sine, cosine and logarithm may differ in the last bit between C libraries; nothing else may.
    let worst = differences.iter().max().copied().unwrap_or(0);
    assert!(
        worst <= 2 && differences.len() < image.rgb.len() / 200,
        "{name}: {} of {} values differ, by up to {worst} levels",
        differences.len(),
        image.rgb.len()
    );
}

/// Flat splats on a torus, lit from above.
fn torus() -> Scene {
    let (around, across) = (160, 64);
    let mut gaussians = Vec::new();
    for i in 0..around {
        for j in 0..across {
            let u = std::f32::consts::TAU * i as f32 / around as f32;
            let v = std::f32::consts::TAU * (j as f32 + 0.5 * (i % 2) as f32) / across as f32;
            let level = Vec3::new(u.cos(), u.sin(), 0.0);
            let normal = level * v.cos() + Vec3::Z * v.sin();
            let position = level + normal * 0.4;
            let light = 0.55 + 0.45 * normal.z;
            let tint = if (i / 10 + j / 8) % 2 == 0 {
                Vec3::new(0.95, 0.75, 0.3)
            } else {
                Vec3::new(0.25, 0.45, 0.8)
            };
            let [r, g, b] = (tint * light * 255.0).to_array().map(|c| c as u8);
            gaussians.push(GaussianState {
                index: gaussians.len() as u32,
                ..gaussian(
                    position,
                    Vec3::new(0.028, 0.028, 0.003),
                    Quat::from_rotation_arc(Vec3::Z, normal),
                    [r, g, b, 230],
                )
            });
        }
    }
    Scene {
        gaussians,
        bounds: [Vec3::new(-1.4, -1.4, -0.4), Vec3::new(1.4, 1.4, 0.4)],
    }
}

#[test]
fn golden_torus() {
    let scene = torus();
    let camera = scenes::camera(&scene, 0.6, 200, 150);
    check(
        "torus",
        &picture(&scene.gaussians, None, &camera, [0.93; 3]),
    );
}

#[test]
fn golden_lobes() {
    // One degree-3 pattern on a row of balls, each turned a little further: the pattern must turn with them.
    let mut block = vec![0.0; 48];
    for (coefficient, rgb) in [
        (3, [1.2, 0.0, 0.0]),
        (6, [0.0, 0.7, 0.0]),
        (12, [0.0, 0.0, 0.9]),
    ] {
        block[3 * coefficient..3 * coefficient + 3].copy_from_slice(&rgb);
    }
    let mut gaussians = Vec::new();
    for row in 0..3 {
        for column in 0..8 {
            let turn = Quat::from_axis_angle(Vec3::AXES[row], column as f32 * 0.45);
            let place = Vec3::new(column as f32 - 3.5, 0.0, 1.0 - row as f32);
            gaussians.push(GaussianState {
                rotation: turn.to_array(),
                ..gaussian(place, Vec3::splat(0.2), turn, [0, 0, 0, 250])
            });
        }
    }
    let scene = Scene {
        gaussians,
        bounds: [Vec3::new(-4.0, -0.5, -1.5), Vec3::new(4.0, 0.5, 1.5)],
    };
    let camera = scenes::camera(&scene, 0.0, 240, 100);
    let sh = Harmonics::new(3, &block);
    check("lobes", &picture(&scene.gaussians, sh, &camera, [0.0; 3]));
}

#[test]
fn golden_crowd() {
    let scene = scenes::crowd(42, 1500);
    let sh = scenes::harmonics(&scene, 2);
    let camera = scenes::camera(&scene, 3.9, 160, 120);
    let sh = Harmonics::new(2, &sh);
    check("crowd", &picture(&scene.gaussians, sh, &camera, [1.0; 3]));
}
