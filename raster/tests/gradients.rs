//! Gradients against differences of a rasteriser in f64 that goes pixel by pixel and knows no tile.

use cosplat_raster::{
    Camera, Projection, Splats, adjoint, composite,
    ellipse::{ALPHA_MAX, ALPHA_MIN, LOW_PASS},
};
use glam::{DMat3, DQuat, DVec3, Mat3, Quat, Vec3};

const CHANNELS: usize = 5;
/// Step of the central differences. Their own error is its square, and rounding of f64 over it: 1e-9 in all.
const STEP: f64 = 1e-6;
/// What a gradient may differ by, relative to the larger of itself and a hundredth of the largest of its kind: the bar of
/// stage 1 for a picture in f32.
const TOLERANCE: f64 = 1e-3;

#[derive(Clone)]
struct Gaussian {
    position: DVec3,
    scale: DVec3,
    rotation: DQuat,
    opacity: f64,
    values: [f64; CHANNELS],
}

fn scene() -> Vec<Gaussian> {
    (0..60)
        .map(|k| {
            let f = f64::from(k);
            let wave = |a: f64, b: f64| (f * a + b).sin();
            Gaussian {
                position: DVec3::new(wave(0.7, 0.1), 0.8 * wave(1.3, 1.0), 3.0 + wave(2.1, 2.0)),
                scale: DVec3::new(0.12, 0.2, 0.05) * (1.2 + wave(3.3, 0.5)),
                rotation: DQuat::from_euler(glam::EulerRot::XYZ, f, 1.7 * f, 0.3 * f),
                // One in twenty is capped at its middle.
                opacity: if k % 20 == 0 {
                    0.998
                } else {
                    0.35 + 0.3 * wave(5.1, 0.0)
                },
                values: std::array::from_fn(|c| 0.5 + 0.5 * wave(1.9, c as f64)),
            }
        })
        .collect()
}

fn camera() -> Camera {
    Camera {
        position: Vec3::new(0.1, -0.2, -0.3),
        world_from_camera: Mat3::from_quat(Quat::from_euler(glam::EulerRot::XYZ, 0.05, -0.08, 0.3)),
        focal: [62.0, 55.0],
        center: [24.0, 19.0],
        width: 52,
        height: 37,
        near: 0.1,
    }
}

/// Ellipse in f64: centre, inverse covariance, opacity, depth.
fn ellipse(g: &Gaussian, camera: &Camera) -> ([f64; 2], [f64; 3], f64) {
    let world_from_camera = camera.world_from_camera.as_dmat3();
    let view = world_from_camera.transpose() * (g.position - camera.position.as_dvec3());
    let focal = camera.focal.map(f64::from);
    let size = [camera.width, camera.height];
    let row = |axis: usize| {
        let center = f64::from(camera.center[axis]);
        let limit = 1.3 * center.max(f64::from(size[axis]) - center) / focal[axis];
        let slope = (view[axis] / view.z).clamp(-limit, limit);
        (world_from_camera.col(axis) - world_from_camera.z_axis * slope) * focal[axis] / view.z
    };
    let half = DMat3::from_quat(g.rotation) * DMat3::from_diagonal(g.scale);
    let covariance = half * half.transpose();
    let [x, y] = [row(0), row(1)];
    let (xx, xy, yy) = (
        x.dot(covariance * x) + LOW_PASS,
        x.dot(covariance * y),
        y.dot(covariance * y) + LOW_PASS,
    );
    let determinant = xx * yy - xy * xy;
    let center = [0, 1].map(|a| f64::from(camera.center[a]) + focal[a] * view[a] / view.z);
    let conic = [yy / determinant, -xy / determinant, xx / determinant];
    (center, conic, view.z)
}

/// Planes of the picture in f64. `shown` says which Gaussians count at which pixel; where it is empty it is filled. It stays
/// for the differences: whether opacity is above the least that counts is a step, which has no derivative.
fn planes(scene: &[Gaussian], camera: &Camera, shown: &mut Vec<bool>) -> Vec<f64> {
    let (width, height) = (camera.width as usize, camera.height as usize);
    let ellipses: Vec<_> = scene.iter().map(|g| ellipse(g, camera)).collect();
    let mut order: Vec<usize> = (0..scene.len()).collect();
    order.sort_by(|&a, &b| ellipses[a].2.total_cmp(&ellipses[b].2));
    let first = shown.is_empty();
    shown.resize(width * height * scene.len(), true);
    let mut planes = vec![0.0; (CHANNELS + 1) * width * height];
    for pixel in 0..width * height {
        let at = [(pixel % width) as f64 + 0.5, (pixel / width) as f64 + 0.5];
        let mut passes = 1.0;
        for &n in &order {
            let (center, [a, b, c], _) = ellipses[n];
            let (x, y) = (at[0] - center[0], at[1] - center[1]);
            let q = a * x * x + 2.0 * b * x * y + c * y * y;
            let alpha = scene[n].opacity * (-0.5 * q).exp();
            let shown = &mut shown[pixel * scene.len() + n];
            if first {
                *shown = alpha >= f64::from(ALPHA_MIN);
            }
            if *shown {
                let weight = passes * alpha.min(f64::from(ALPHA_MAX));
                for channel in 0..CHANNELS {
                    planes[channel * width * height + pixel] += weight * scene[n].values[channel];
                }
                passes -= weight;
            }
        }
        planes[CHANNELS * width * height + pixel] = passes;
    }
    planes
}

/// A function of the picture: its planes times fixed numbers.
fn slopes(camera: &Camera) -> Vec<f32> {
    let count = (CHANNELS + 1) * (camera.width * camera.height) as usize;
    (0..count)
        .map(|k| (k as f32 * 0.37).sin() + (k as f32 * 0.011).cos())
        .collect()
}

/// Largest difference over a kind of parameter, as [`TOLERANCE`] measures it.
fn worst(kind: &str, pairs: &[(f64, f64)]) -> f64 {
    let largest = pairs
        .iter()
        .fold(0.0f64, |l, (_, exact)| l.max(exact.abs()));
    let relative =
        |(found, exact): &(f64, f64)| (found - exact).abs() / exact.abs().max(0.01 * largest);
    let worst = pairs.iter().map(relative).fold(0.0, f64::max);
    println!(
        "{kind}: {worst:.1e} of {} gradients, the largest {largest:.3}",
        pairs.len()
    );
    worst
}

fn splats(scene: &[Gaussian], camera: &Camera) -> Splats<u32> {
    let projection = Projection::new(camera);
    Splats::new(scene.len(), camera, |n| {
        let g = &scene[n];
        let half = DMat3::from_quat(g.rotation) * DMat3::from_diagonal(g.scale);
        let s = half * half.transpose();
        let covariance = [
            s.x_axis.x, s.x_axis.y, s.x_axis.z, s.y_axis.y, s.y_axis.z, s.z_axis.z,
        ];
        projection.ellipse(
            g.position.as_vec3().to_array(),
            covariance.map(|x| x as f32),
            g.opacity as f32,
            |_| n as u32,
        )
    })
}

fn values(scene: &[Gaussian]) -> Vec<f32> {
    scene
        .iter()
        .flat_map(|g| g.values.map(|v| v as f32))
        .collect()
}

#[test]
fn the_picture_is_that_of_the_scalar_rasteriser() {
    let (scene, camera) = (scene(), camera());
    let picture = composite(&splats(&scene, &camera), &values(&scene), CHANNELS);
    let exact = planes(&scene, &camera, &mut Vec::new());
    let off = picture.planes.iter().zip(&exact);
    let off = off
        .map(|(a, b)| (f64::from(*a) - b).abs())
        .fold(0.0, f64::max);
    // A Gaussian at the rim of its reach may count in one and not in the other: 1/255 of a value below 1.
    assert!(off < 4e-3, "{off}");
}

#[test]
fn gradients_are_those_of_differences_in_f64() {
    let (scene, camera) = (scene(), camera());
    let slopes = slopes(&camera);
    let splats = splats(&scene, &camera);
    let picture = composite(&splats, &values(&scene), CHANNELS);
    let found = adjoint(&splats, scene.len(), &values(&scene), &picture, &slopes);
    let mut shown = Vec::new();
    planes(&scene, &camera, &mut shown);
    let mut difference = |n: usize, change: &dyn Fn(&mut Gaussian, f64)| {
        let mut value = |step: f64| {
            let mut other = scene.clone();
            change(&mut other[n], step);
            let planes = planes(&other, &camera, &mut shown);
            let of = planes.iter().zip(&slopes).map(|(v, s)| v * f64::from(*s));
            of.sum::<f64>()
        };
        (value(STEP) - value(-STEP)) / (2.0 * STEP)
    };
    let projection = Projection::new(&camera);
    let mut kinds: [Vec<(f64, f64)>; 5] = Default::default();
    for n in 0..scene.len() {
        let g = &scene[n];
        let spatial = projection.adjoint(
            g.position.as_vec3(),
            g.scale.as_vec3(),
            Mat3::from_quat(g.rotation.as_quat()),
            &found.screen[n],
        );
        for k in 0..3 {
            let axis = DVec3::AXES[k];
            let by_position = difference(n, &|g, step| g.position[k] += step);
            let by_scale = difference(n, &|g, step| g.scale[k] += step);
            let by_rotation = difference(n, &|g, step| {
                g.rotation = DQuat::from_scaled_axis(axis * step) * g.rotation;
            });
            kinds[0].push((spatial.position[k], by_position));
            kinds[1].push((spatial.scale[k], by_scale));
            kinds[2].push((spatial.rotation[k], by_rotation));
        }
        let by_opacity = difference(n, &|g, step| g.opacity += step);
        kinds[3].push((found.screen[n].opacity.into(), by_opacity));
        for channel in 0..CHANNELS {
            let by_value = difference(n, &|g, step| g.values[channel] += step);
            kinds[4].push((found.values[n * CHANNELS + channel].into(), by_value));
        }
    }
    let names = [
        "position",
        "scale",
        "rotation",
        "opacity",
        "colour and feature",
    ];
    for (name, pairs) in names.into_iter().zip(&kinds) {
        assert!(worst(name, pairs) < TOLERANCE, "{name}");
    }
}

#[test]
fn gradients_are_the_same_bits_on_any_number_of_threads() {
    let (scene, camera) = (scene(), camera());
    let run = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
        pool.expect("threads").install(|| {
            let splats = splats(&scene, &camera);
            let picture = composite(&splats, &values(&scene), CHANNELS);
            adjoint(
                &splats,
                scene.len(),
                &values(&scene),
                &picture,
                &slopes(&camera),
            )
        })
    };
    let one = run(1);
    assert_eq!(one, run(2));
    assert_eq!(one, run(5));
}
