//! Deterministic scenes the tests draw.

use cosplat_ipc::schema::GaussianState;
use glam::{Mat3, Quat, Vec3};

use crate::Camera;
use crate::camera::Orbit;

/// Gaussians and the box they lie in.
pub struct Scene {
    pub gaussians: Vec<GaussianState>,
    pub bounds: [Vec3; 2],
}

/// Uniform numbers in 0..1 (SplitMix64).
pub struct Dice(pub u64);

impl Dice {
    pub fn roll(&mut self) -> f32 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 40) as f32 / (1u64 << 24) as f32
    }

    pub fn vector(&mut self) -> Vec3 {
        Vec3::new(self.roll(), self.roll(), self.roll())
    }

    pub fn rotation(&mut self) -> Quat {
        let [x, y, z, w] = [0; 4].map(|_| self.roll() - 0.5);
        Quat::from_xyzw(x, y, z, w + 1e-3).normalize()
    }
}

/// One Gaussian with standard deviations `scale` along the axes of `rotation`.
pub fn gaussian(position: Vec3, scale: Vec3, rotation: Quat, color: [u8; 4]) -> GaussianState {
    let axes = Mat3::from_quat(rotation) * Mat3::from_diagonal(scale);
    let s = axes * axes.transpose();
    GaussianState {
        position: position.to_array(),
        color,
        covariance: [
            s.x_axis.x, s.x_axis.y, s.x_axis.z, s.y_axis.y, s.y_axis.z, s.z_axis.z,
        ],
        rotation: [0.0, 0.0, 0.0, 1.0],
        ..GaussianState::default()
    }
}

/// Round Gaussian.
pub fn ball(position: Vec3, scale: f32, color: [u8; 4]) -> GaussianState {
    gaussian(position, Vec3::splat(scale), Quat::IDENTITY, color)
}

fn scatter(seed: u64, count: u32, scale: impl Fn(&mut Dice) -> Vec3) -> Scene {
    let mut dice = Dice(seed);
    let gaussians = (0..count)
        .map(|index| {
            let position = dice.vector() * 2.0 - Vec3::ONE;
            let (scale, rotation) = (scale(&mut dice), dice.rotation());
            let color = [0; 4].map(|_| (dice.roll() * 256.0) as u8);
            GaussianState {
                index,
                rotation: dice.rotation().to_array(),
                ..gaussian(position, scale, rotation, color)
            }
        })
        .collect();
    Scene {
        gaussians,
        bounds: [-Vec3::ONE, Vec3::ONE],
    }
}

/// `count` Gaussians of all sizes, shapes, colours and opacities in the cube -1..1.
pub fn crowd(seed: u64, count: u32) -> Scene {
    scatter(seed, count, |dice| {
        let size = 0.005 * 60f32.powf(dice.roll());
        (dice.vector() + 0.05) * size
    })
}

/// `count` Gaussians a hundred to a thousand times longer than thick.
pub fn needles(count: u32) -> Scene {
    scatter(77, count, |dice| {
        let flat = if dice.roll() < 0.5 { 1e-3 } else { 0.3 };
        Vec3::new(0.4 * dice.roll() + 0.1, flat, 1e-3)
    })
}

/// Random coefficients of degree `degree` for every Gaussian of `scene`.
pub fn harmonics(scene: &Scene, degree: u32) -> Vec<f32> {
    let mut dice = Dice(5);
    let count = 3 * (degree + 1) * (degree + 1);
    (0..scene.gaussians.len() as u32 * count)
        .map(|_| dice.roll() - 0.5)
        .collect()
}

/// Camera around `scene` with z up.
pub fn camera(scene: &Scene, azimuth: f32, width: u32, height: u32) -> Camera {
    let orbit = Orbit {
        azimuth,
        ..Orbit::default()
    };
    Camera::orbit(scene.bounds, Vec3::Z, orbit, width, height)
}
