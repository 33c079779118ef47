//! Laws of the weights: they are all the light there is, and each belongs to the Gaussian it came from.

use glam::{Mat3, Vec3};
use rayon::prelude::*;

use crate::{Camera, Ellipse, Projection, Row, SIZE, Sink, Splats};

/// Sums of weights, per Gaussian and per pixel, and what passes at each pixel.
struct Sums {
    width: usize,
    of_gaussian: Vec<f64>,
    of_pixel: Vec<f64>,
    passes: Vec<f64>,
    tile: [usize; 2],
}

impl Sink<u32> for Sums {
    fn begin_strip(&mut self, _: &[Ellipse<u32>]) {}

    fn begin_tile(&mut self, left: usize, top: usize) {
        self.tile = [left, top % SIZE];
    }

    fn row(&mut self, _: usize, index: u32, row: usize, weight: &Row) {
        for (lane, weight) in weight.iter().enumerate() {
            let x = self.tile[0] + lane;
            if x < self.width {
                self.of_gaussian[index as usize] += f64::from(*weight);
                self.of_pixel[row * self.width + x] += f64::from(*weight);
            }
        }
    }

    fn end_tile(&mut self, transmittance: &[Row; SIZE]) {
        for (row, line) in transmittance.iter().enumerate() {
            for (lane, passes) in line.iter().enumerate() {
                let x = self.tile[0] + lane;
                if x < self.width {
                    self.passes[row * self.width + x] = f64::from(*passes);
                }
            }
        }
    }
}

/// Round Gaussians of index, position, standard deviation and opacity.
fn sums(balls: &[(Vec3, f32, f32)], camera: &Camera) -> Vec<Sums> {
    let projection = Projection::new(camera);
    let splats = Splats::new(balls.len(), camera, |n| {
        let (position, size, opacity) = balls[n];
        let v = size * size;
        projection.ellipse(
            position.to_array(),
            [v, 0.0, 0.0, v, 0.0, v],
            opacity,
            |_| n as u32,
        )
    });
    let [width, height] = splats.size();
    let sink = |_| Sums {
        width,
        of_gaussian: vec![0.0; balls.len()],
        of_pixel: vec![0.0; width * SIZE],
        passes: vec![0.0; width * SIZE],
        tile: [0; 2],
    };
    splats.blend((0..height.div_ceil(SIZE)).into_par_iter().map(sink))
}

fn camera(width: u32, height: u32) -> Camera {
    Camera {
        position: Vec3::ZERO,
        world_from_camera: Mat3::IDENTITY,
        focal: [90.0, 70.0],
        center: [0.5 * width as f32, 0.5 * height as f32],
        width,
        height,
        near: 0.1,
    }
}

fn balls() -> Vec<(Vec3, f32, f32)> {
    (0..300)
        .map(|k| {
            let f = k as f32;
            // Slopes below 0.35, where no camera of these tests freezes the linearisation.
            let (x, y) = (0.6 * (f * 0.7).sin(), 0.6 * (f * 1.3).cos());
            let place = Vec3::new(x, y, 3.0 + (f * 0.31).sin());
            (place, 0.02 + 0.0005 * f, 0.05 + 0.003 * f)
        })
        .collect()
}

fn of_gaussians(strips: &[Sums]) -> Vec<f64> {
    let count = strips[0].of_gaussian.len();
    (0..count)
        .map(|n| strips.iter().map(|strip| strip.of_gaussian[n]).sum())
        .collect()
}

#[test]
fn weights_and_what_passes_are_all_the_light() {
    for strip in sums(&balls(), &camera(83, 61)) {
        for (weight, passes) in strip.of_pixel.iter().zip(&strip.passes) {
            // Some 50 roundings of f32.
            assert!((weight + passes - 1.0).abs() < 1e-5, "{weight} {passes}");
        }
    }
}

#[test]
fn the_weight_of_a_round_gaussian_is_its_integral() {
    let (size, opacity, depth) = (0.2f64, 0.6f64, 3.0f64);
    let ball = (Vec3::Z * depth as f32, size as f32, opacity as f32);
    let strips = sums(&[(Vec3::X * 50.0, 0.1, 0.9), ball], &camera(160, 120));
    let [hidden, weight] = of_gaussians(&strips)[..] else {
        panic!("two Gaussians");
    };
    assert_eq!(hidden, 0.0);
    let spread = |focal: f64| ((size * focal / depth).powi(2) + 0.3).sqrt();
    // Cut off at 1/255: that part of a plane integral is missing.
    let full = std::f64::consts::TAU * opacity * spread(90.0) * spread(70.0);
    let expected = full * (1.0 - 1.0 / (255.0 * opacity));
    assert!(
        (weight / expected - 1.0).abs() < 2e-3,
        "{weight} {expected}"
    );
}

#[test]
fn a_crop_of_a_picture_has_the_weights_of_the_whole() {
    let all = camera(96, 80);
    // Tiles of the crop begin at other pixels, and its axis is off its centre.
    let crop = Camera {
        center: [all.center[0] - 21.0, all.center[1] - 13.0],
        width: 40,
        height: 30,
        ..all
    };
    let (whole, part) = (sums(&balls(), &all), sums(&balls(), &crop));
    for y in 0..30 {
        for x in 0..40 {
            let at = |strips: &[Sums], x: usize, y: usize| {
                let strip = &strips[y / SIZE];
                strip.passes[(y % SIZE) * strip.width + x]
            };
            let (a, b) = (at(&whole, x + 21, y + 13), at(&part, x, y));
            // A tile is finished where a thousandth of the light passes.
            assert!((a - b).abs() < 1e-3, "({x}, {y}): {a} {b}");
        }
    }
}

#[test]
fn any_number_of_threads_gives_the_same_weights() {
    let with = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
        pool.unwrap()
            .install(|| of_gaussians(&sums(&balls(), &camera(83, 61))))
    };
    let one = with(1);
    assert_eq!(one, with(2));
    assert_eq!(one, with(5));
}

#[test]
fn broken_cameras_and_gaussians_show_nothing() {
    let mut broken = camera(20, 20);
    broken.position = Vec3::NAN;
    assert!(
        of_gaussians(&sums(&balls(), &broken))
            .iter()
            .all(|w| *w == 0.0)
    );
    broken = camera(20, 20);
    broken.center = [f32::NAN; 2];
    assert!(
        of_gaussians(&sums(&balls(), &broken))
            .iter()
            .all(|w| w.is_finite())
    );
    let bad = [
        (Vec3::Z, 0.1, f32::NAN),
        (Vec3::NAN, 0.1, 0.5),
        (Vec3::Z, f32::INFINITY, 0.5),
    ];
    assert_eq!(of_gaussians(&sums(&bad, &camera(20, 20))), [0.0; 3]);
}
