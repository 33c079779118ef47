//! Picking on real splats, against every Gaussian projected and blended one by one in double precision.

use std::path::{Path, PathBuf};

use cosplat_raster::{
    Projection, Splats,
    camera::{Camera, Orbit},
};
use glam::{DMat3, DVec3, Mat3, Quat, Vec3};
use rayon::prelude::*;

/// Pixels that are compared, per picture.
const PIXELS: usize = 10_000;
const SIZE: [u32; 2] = [640, 480];

/// What a `.splat` file has in 32 bytes each: position, scale, RGBA, rotation.
#[derive(Default)]
struct Splat {
    position: Vec<Vec3>,
    covariance: Vec<[f32; 6]>,
    opacity: Vec<f32>,
}

impl Splat {
    fn read(bytes: &[u8]) -> Self {
        let mut splat = Self::default();
        for record in bytes.chunks_exact(32) {
            let number = |n: usize| {
                let [a, b, c, d] = [0, 1, 2, 3].map(|byte| record[4 * n + byte]);
                f32::from_le_bytes([a, b, c, d])
            };
            let turn = |n: usize| f32::from(record[28 + n]) / 128.0 - 1.0;
            let rotation = Quat::from_xyzw(turn(1), turn(2), turn(3), turn(0)).normalize();
            let scale = Vec3::new(number(3), number(4), number(5));
            let half = Mat3::from_quat(rotation) * Mat3::from_diagonal(scale);
            let c = half * half.transpose();
            let (x, y, z) = (c.x_axis, c.y_axis, c.z_axis);
            splat
                .position
                .push(Vec3::new(number(0), number(1), number(2)));
            splat.covariance.push([x.x, x.y, x.z, y.y, y.z, z.z]);
            splat.opacity.push(f32::from(record[27]) / 255.0);
        }
        splat
    }

    fn bounds(&self) -> [Vec3; 2] {
        let all = || self.position.iter().copied();
        let low = all().fold(Vec3::INFINITY, Vec3::min);
        [low, all().fold(Vec3::NEG_INFINITY, Vec3::max)]
    }

    fn project(&self, camera: &Camera) -> Splats<u32> {
        let projection = Projection::new(camera);
        Splats::new(self.position.len(), camera, |n| {
            let of = (self.position[n].to_array(), self.covariance[n]);
            projection.ellipse(of.0, of.1, self.opacity[n], |_| n as u32)
        })
    }
}

/// An ellipse in pixels: index, depth, centre, inverse covariance, opacity.
struct Shown {
    index: u32,
    depth: f64,
    center: [f64; 2],
    conic: [f64; 3],
    opacity: f64,
}

/// The projection of Zwicker et al. 2001 with the low-pass filter and the frozen slopes of Kerbl et al. 2023.
fn shown(splat: &Splat, camera: &Camera, n: usize) -> Option<Shown> {
    let view = camera.world_from_camera.as_dmat3().transpose();
    let p = view * (splat.position[n].as_dvec3() - camera.position.as_dvec3());
    let focal = f64::from(camera.focal[0]);
    let center = camera.center.map(f64::from);
    if p.z < f64::from(camera.near) {
        return None;
    }
    let slope: [f64; 2] = std::array::from_fn(|a| {
        let limit = 1.3 * center[a] / focal;
        ([p.x, p.y][a] / p.z).clamp(-limit, limit)
    });
    let [xx, xy, xz, yy, yz, zz] = splat.covariance[n].map(f64::from);
    let world = DMat3::from_cols(
        DVec3::new(xx, xy, xz),
        DVec3::new(xy, yy, yz),
        DVec3::new(xz, yz, zz),
    );
    let rows = [0, 1].map(|a| {
        let mut row = DVec3::new(0.0, 0.0, -slope[a]);
        row[a] = 1.0;
        view.transpose() * (row * (focal / p.z))
    });
    let product = |a: usize, b: usize| rows[a].dot(world * rows[b]);
    let [a, b, c] = [product(0, 0) + 0.3, product(0, 1), product(1, 1) + 0.3];
    let det = a * c - b * b;
    Some(Shown {
        index: n as u32,
        depth: p.z,
        center: [center[0] + focal * p.x / p.z, center[1] + focal * p.y / p.z],
        conic: [c / det, -b / det, a / det],
        opacity: f64::from(splat.opacity[n]),
    })
}

/// The first of all, front to back, at which less than half of the light behind passes.
fn reference(sorted: &[Shown], at: [f64; 2]) -> Option<&Shown> {
    let mut passes = 1.0;
    sorted.iter().find(|one| {
        let (x, y) = (at[0] - one.center[0], at[1] - one.center[1]);
        let [a, b, c] = one.conic;
        let squared = a * x * x + 2.0 * b * x * y + c * y * y;
        // Beyond, no opacity comes to a level of 255.
        if squared > 11.1 {
            return false;
        }
        let alpha = one.opacity * (-0.5 * squared).exp();
        if alpha >= 1.0 / 255.0 {
            passes *= 1.0 - alpha.min(0.99);
        }
        passes < 0.5
    })
}

/// Share of pixels at which both see the same Gaussian, or none, and of those at which something is seen.
fn agreement(splat: &Splat, up: Vec3) -> [f64; 2] {
    let orbit = Orbit {
        azimuth: 0.6,
        elevation: 0.35,
        distance: None,
        target: None,
    };
    let camera = Camera::orbit(splat.bounds(), up, orbit, SIZE[0], SIZE[1]);
    let splats = splat.project(&camera);
    let all = 0..splat.position.len();
    let mut sorted: Vec<Shown> = all.filter_map(|n| shown(splat, &camera, n)).collect();
    sorted.sort_by(|one, other| one.depth.total_cmp(&other.depth));
    let stride = (SIZE[0] * SIZE[1]) as usize / PIXELS;
    let met: Vec<[bool; 2]> = (0..PIXELS)
        .into_par_iter()
        .map(|n| {
            let pixel = n * stride + n % stride;
            let at = [pixel as u32 % SIZE[0], pixel as u32 / SIZE[0]].map(|x| x as f32 + 0.5);
            let found = splats.pick(at).map(|ellipse| ellipse.payload);
            let expected = reference(&sorted, at.map(f64::from)).map(|one| one.index);
            [found == expected, expected.is_some()]
        })
        .collect();
    [0, 1].map(|n| met.iter().filter(|both| both[n]).count() as f64 / PIXELS as f64)
}

#[test]
fn picking_sees_what_double_precision_sees() {
    let data = std::env::var_os("COSPLAT_TEST_DATA");
    let beside = || Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/data");
    let folder = data.map_or_else(beside, PathBuf::from);
    for name in ["plant.splat", "torus_100k.splat"] {
        let path = folder.join(name);
        let Ok(bytes) = std::fs::read(&path) else {
            let said = format!("SKIPPED: picking: {} does not exist", path.display());
            assert!(std::env::var_os("COSPLAT_REQUIRE_ALL").is_none(), "{said}");
            eprintln!("{said}");
            continue;
        };
        let [same, seen] = agreement(&Splat::read(&bytes), Vec3::Y);
        eprintln!("{name}: {same} alike, {seen} of the pixels see something");
        assert!(same >= 0.999 && seen > 0.05, "{name}: {same}, {seen}");
    }
}
