//! Small scenes whose pictures are known in closed form, and what must not change a picture.

use cosplat_ipc::schema::GaussianState;
use glam::{Mat3, Quat, Vec3};

use super::scenes::{self, Scene, ball, gaussian};
use crate::{Camera, Harmonics, Image, picture};

/// Camera at the origin that looks along +z with x right and y down: a focal length of `focal` pixels.
fn straight(width: u32, height: u32, focal: f32) -> Camera {
    Camera {
        position: Vec3::ZERO,
        world_from_camera: Mat3::IDENTITY,
        focal: [focal; 2],
        center: [0.5 * width as f32, 0.5 * height as f32],
        width,
        height,
        near: 0.1,
    }
}

fn largest_difference(a: &Image, b: &Image) -> u8 {
    assert_eq!((a.width, a.height), (b.width, b.height));
    a.rgb
        .iter()
        .zip(&b.rgb)
        .map(|(a, b)| a.abs_diff(*b))
        .max()
        .unwrap()
}

/// Pixel of the closed form, within rounding to 8 bits.
fn assert_level(image: &Image, x: u32, y: u32, channel: usize, value: f64) {
    let level = f64::from(image.pixel(x, y).unwrap()[channel]);
    assert!(
        (level - 255.0 * value).abs() < 0.51,
        "({x}, {y}) channel {channel}: {level}, expected {}",
        255.0 * value
    );
}

#[test]
fn a_round_gaussian_has_peak_and_falloff_of_the_closed_form() {
    // 101 pixels wide: the optical axis meets the centre of pixel 50.
    let camera = straight(101, 101, 200.0);
    let splat = ball(Vec3::new(0.0, 0.0, 4.0), 0.15, [255, 128, 0, 204]);
    let image = picture(&[splat], None, &camera, [0.0; 3]);
    let variance = (0.15f64 * 200.0 / 4.0).powi(2) + 0.3;
    for x in 0..101 {
        let d = f64::from(x) - 50.0;
        let alpha = 0.8 * (-d * d / (2.0 * variance)).exp();
        let alpha = if alpha < 1.0 / 255.0 { 0.0 } else { alpha };
        assert_level(&image, x, 50, 0, alpha);
        assert_level(&image, 50, x, 1, alpha * 128.0 / 255.0);
        assert_eq!(image.pixel(x, 50).unwrap()[2], 0);
    }
}

#[test]
fn the_nearer_of_two_covers_the_farther_in_either_order() {
    let camera = straight(33, 33, 50.0);
    let red = ball(Vec3::new(0.0, 0.0, 2.0), 0.5, [255, 0, 0, 153]);
    let blue = ball(Vec3::new(0.0, 0.0, 3.0), 0.5, [0, 0, 255, 204]);
    let behind = [0.0, 1.0, 0.0];
    let image = picture(&[red, blue], None, &camera, behind);
    assert_level(&image, 16, 16, 0, 0.6);
    assert_level(&image, 16, 16, 2, 0.4 * 0.8);
    assert_level(&image, 16, 16, 1, 0.4 * 0.2);
    assert_eq!(image, picture(&[blue, red], None, &camera, behind));
}

#[test]
fn an_opaque_wall_hides_what_is_behind_but_for_a_hundredth() {
    let camera = straight(33, 33, 50.0);
    let wall = ball(Vec3::new(0.0, 0.0, 2.0), 100.0, [0, 0, 0, 255]);
    let image = picture(&[wall], None, &camera, [1.0; 3]);
    assert_level(&image, 3, 30, 1, 0.01);
    let image = picture(&[wall; 3], None, &camera, [1.0; 3]);
    assert_level(&image, 3, 30, 1, 1e-6);
}

#[test]
fn second_moments_of_the_picture_are_the_projected_covariance() {
    let (focal, depth) = (300.0, 5.0);
    let camera = straight(201, 151, focal);
    let turn = Quat::from_euler(glam::EulerRot::ZYX, 0.6, -0.4, 0.9);
    let scale = Vec3::new(0.3, 0.08, 0.15);
    let opacity = 230.0 / 255.0;
    let splat = gaussian(Vec3::Z * depth, scale, turn, [255, 255, 255, 230]);
    let image = picture(&[splat], None, &camera, [0.0; 3]);
    let (mut mass, mut moments) = (0.0, [0.0; 3]);
    for y in 0..151 {
        for x in 0..201 {
            let level = f64::from(image.pixel(x, y).unwrap()[0]);
            let (dx, dy) = (f64::from(x) - 100.0, f64::from(y) - 75.0);
            mass += level;
            moments[0] += level * dx * dx;
            moments[1] += level * dx * dy;
            moments[2] += level * dy * dy;
        }
    }
    // On the axis the projection is plain scaling: the xy block of the covariance, plus the low-pass. A Gaussian cut off
    // at 1/255 = opacity * exp(-k) keeps this part of its second moments.
    let k = f64::ln(opacity * 255.0);
    let kept = 1.0 - k * (-k).exp() / (1.0 - (-k).exp());
    let pixels = f64::from(focal / depth).powi(2);
    for (moment, (entry, low_pass)) in moments.iter().zip([(0, 0.3), (1, 0.0), (3, 0.3)]) {
        let expected = f64::from(splat.covariance[entry]) * pixels + low_pass;
        // 1 % of the largest entry: the tails are one or two levels high and rounded.
        let error = moment / mass / kept - expected;
        assert!(error.abs() < 2.0, "entry {entry}: {} off {expected}", error);
    }
    let largest = f64::from(splat.covariance[0]) * pixels;
    assert!(
        largest > 200.0,
        "the bound above assumes this size: {largest}"
    );
}

#[test]
fn a_spherical_harmonics_lobe_turns_with_its_gaussian() {
    // Degree 1, m = 0: bright red where the asset's own +z points away from the eye.
    let block = [
        -1.0, -1.0, -1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0,
    ];
    let camera = straight(33, 33, 50.0);
    let shade = |turn: Quat| {
        let splat = GaussianState {
            rotation: turn.to_array(),
            ..ball(Vec3::Z * 2.0, 0.5, [9, 9, 9, 204])
        };
        let image = picture(&[splat], Harmonics::new(1, &block), &camera, [0.0; 3]);
        image.pixel(16, 16).unwrap()[0]
    };
    let red = |cosine: f64| {
        let color = 0.5 - 0.282_094_79 + 0.488_602_51 * cosine;
        (255.0 * 0.8 * color.max(0.0)).round() as u8
    };
    assert_eq!(shade(Quat::IDENTITY), red(1.0));
    assert_eq!(
        shade(Quat::from_rotation_x(std::f32::consts::PI)),
        red(-1.0)
    );
    let half = std::f32::consts::FRAC_PI_3;
    assert_eq!(shade(Quat::from_rotation_y(half)), red(0.5));
    assert_eq!(shade(Quat::from_rotation_z(half)), red(1.0));
}

#[test]
fn turning_the_scene_and_the_camera_together_changes_nothing() {
    let scene = scenes::crowd(3, 500);
    let sh = scenes::harmonics(&scene, 3);
    let camera = scenes::camera(&scene, 0.4, 128, 96);
    let turn = Quat::from_euler(glam::EulerRot::XYZ, 0.8, 2.0, -0.5);
    let matrix = Mat3::from_quat(turn);
    let turned: Vec<GaussianState> = scene
        .gaussians
        .iter()
        .map(|g| {
            let [xx, xy, xz, yy, yz, zz] = g.covariance;
            let s = matrix
                * Mat3::from_cols(
                    Vec3::new(xx, xy, xz),
                    Vec3::new(xy, yy, yz),
                    Vec3::new(xz, yz, zz),
                )
                * matrix.transpose();
            GaussianState {
                position: (turn * Vec3::from_array(g.position)).to_array(),
                covariance: [
                    s.x_axis.x, s.x_axis.y, s.x_axis.z, s.y_axis.y, s.y_axis.z, s.z_axis.z,
                ],
                rotation: (turn * Quat::from_array(g.rotation)).to_array(),
                ..*g
            }
        })
        .collect();
    let moved = Camera {
        position: turn * camera.position,
        world_from_camera: matrix * camera.world_from_camera,
        ..camera
    };
    let plain = picture(&scene.gaussians, Harmonics::new(3, &sh), &camera, [0.5; 3]);
    let both = picture(&turned, Harmonics::new(3, &sh), &moved, [0.5; 3]);
    // f32 rounding of the turned scene; a splat on the edge of 1/255 may add a level.
    let difference = largest_difference(&plain, &both);
    assert!(difference <= 2, "{difference}");
}

#[test]
fn tile_borders_are_invisible() {
    let scene = scenes::crowd(8, 600);
    let camera = scenes::camera(&scene, 1.0, 120, 90);
    // Seven more pixels on every side at the same focal length: every splat meets other tiles at other places.
    let border = 7;
    let wide = Camera {
        width: 120 + 2 * border,
        height: 90 + 2 * border,
        center: camera.center.map(|c| c + border as f32),
        ..camera
    };
    let inner = picture(&scene.gaussians, None, &camera, [0.1; 3]);
    let outer = picture(&scene.gaussians, None, &wide, [0.1; 3]);
    let mut worst = 0;
    for y in 0..90 {
        for x in 0..120 {
            let (a, b) = (
                inner.pixel(x, y).unwrap(),
                outer.pixel(x + border, y + border).unwrap(),
            );
            worst = worst.max((0..3).map(|c| a[c].abs_diff(b[c])).max().unwrap());
        }
    }
    // A quarter of a level from finished tiles and rounding; a splat on the edge of 1/255 may add a level.
    assert!(worst <= 2, "{worst}");
}

#[test]
fn what_cannot_be_drawn_leaves_the_picture_as_it_was() {
    let scene = scenes::crowd(4, 200);
    let camera = scenes::camera(&scene, 0.0, 64, 48);
    let good = picture(&scene.gaussians, None, &camera, [0.3; 3]);
    let g = ball(Vec3::ZERO, 0.1, [255; 4]);
    let mut bad = Vec::new();
    for value in [
        f32::NAN,
        f32::INFINITY,
        f32::NEG_INFINITY,
        f32::MAX,
        -f32::MAX,
    ] {
        for axis in 0..3 {
            let mut position = g.position;
            position[axis] = value;
            // A finite place, however far, is a dot.
            if !value.is_finite() {
                bad.push(GaussianState { position, ..g });
            }
        }
        for entry in 0..6 {
            let mut covariance = g.covariance;
            covariance[entry] = value;
            // A large variance alone is a legitimate, if useless, splat.
            if value != f32::MAX || ![0, 3, 5].contains(&entry) {
                bad.push(GaussianState { covariance, ..g });
            }
        }
    }
    let [xx, xy, xz, yy, yz, zz] = g.covariance;
    bad.push(GaussianState {
        covariance: [-xx, xy, xz, -yy, yz, -zz],
        ..g
    });
    // Correlation above 1.
    bad.push(GaussianState {
        covariance: [xx, 2.0 * xx, 2.0 * xx, yy, 2.0 * yy, zz],
        ..g
    });
    bad.push(GaussianState {
        position: (camera.position * 2.0).to_array(),
        ..g
    });
    bad.push(GaussianState {
        position: camera.position.to_array(),
        ..g
    });
    bad.push(GaussianState {
        color: [255, 255, 255, 0],
        ..g
    });
    for g in &bad {
        let mut mixed = scene.gaussians.clone();
        mixed.insert(100, *g);
        assert!(picture(&mixed, None, &camera, [0.3; 3]) == good, "{g:?}");
    }
}

#[test]
fn extreme_but_finite_input_never_panics() {
    let mut gaussians = Vec::new();
    for size in [0.0, 1e-30, 1e-6, 1.0, 1e6, 1e15, f32::MAX] {
        for place in [0.0, 1e-3, 1.0, 1e6, 1e30] {
            for axis in [Vec3::X, Vec3::Y, Vec3::ONE] {
                gaussians.push(GaussianState {
                    position: (axis * place).to_array(),
                    covariance: [size, 0.0, 0.0, size, 0.0, size],
                    color: [200, 100, 50, 255],
                    index: u32::MAX,
                    ..GaussianState::default()
                });
            }
        }
    }
    let sh = [0.0; 27];
    for (width, height) in [(1, 1), (15, 17), (64, 1)] {
        let camera = scenes::camera(&scenes::crowd(0, 1), 0.0, width, height);
        let image = picture(&gaussians, Harmonics::new(2, &sh), &camera, [f32::NAN; 3]);
        assert_eq!(image.rgb.len(), (3 * width * height) as usize);
    }
    let mut camera = straight(16, 16, 20.0);
    camera.position = Vec3::NAN;
    picture(&gaussians, None, &camera, [0.0; 3]);
    camera = straight(0, 0, 20.0);
    assert!(picture(&gaussians, None, &camera, [0.0; 3]).rgb.is_empty());
}

#[test]
fn any_number_of_threads_gives_the_same_bytes() {
    let Scene { gaussians, bounds } = scenes::crowd(6, 20_000);
    // Equal depths: ties are broken by the place in the frame.
    let doubled: Vec<GaussianState> = gaussians.iter().flat_map(|g| [*g, *g]).collect();
    let scene = Scene { gaussians, bounds };
    let camera = scenes::camera(&scene, 0.7, 160, 120);
    let with_threads = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
        pool.unwrap()
            .install(|| picture(&doubled, None, &camera, [0.0; 3]))
    };
    let one = with_threads(1);
    for threads in [2, 5] {
        assert!(one == with_threads(threads), "{threads} threads");
    }
}
