//! `scene`: what does not change from step to step, one service per block, kept for late joiners.

use bytemuck::{Pod, Zeroable};
use iceoryx2::prelude::ZeroCopySend;

use super::text::{TextError, padded, str_from_padded};

/// One Gaussian at rest (block `scene/gaussians`).
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable, ZeroCopySend)]
#[type_name("cosplat.v1.GaussianRest")]
#[repr(C)]
pub struct GaussianRest {
    /// Centre [m].
    pub position: [f32; 3],
    /// Opacity, 0..=1.
    pub opacity: f32,
    /// Standard deviations along the local axes [m].
    pub scale: [f32; 3],
    /// Object id.
    pub object: u32,
    /// World-from-local rotation, unit quaternion xyzw.
    pub rotation: [f32; 4],
}

/// One object (block `scene/objects`).
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable, ZeroCopySend)]
#[type_name("cosplat.v1.ObjectInfo")]
#[repr(C)]
pub struct ObjectInfo {
    /// Object id.
    pub id: u32,
    /// How the scene asks for it: 1 static, 2 MPM, 3 automatic, 4 rigid.
    pub fidelity: u32,
    /// Particles of the object.
    pub particle_count: u32,
    /// Index of its first Gaussian.
    pub gaussian_first: u32,
    /// Gaussians of the object.
    pub gaussian_count: u32,
    /// Constitutive law, as in [`MaterialSpec`](super::MaterialSpec).
    pub law: u32,
    /// Young's modulus [Pa].
    pub youngs_modulus: f64,
    /// Poisson's ratio.
    pub poisson_ratio: f64,
    /// Density [kg/m^3].
    pub density: f64,
    /// Name, UTF-8, zero-padded.
    pub name: [u8; 64],
    /// Material name, UTF-8, zero-padded.
    pub material: [u8; 32],
}

impl ObjectInfo {
    /// The object's name.
    pub fn name(&self) -> Result<&str, TextError> {
        str_from_padded(&self.name)
    }

    /// The name of the object's material.
    pub fn material(&self) -> Result<&str, TextError> {
        str_from_padded(&self.material)
    }
}

/// `SceneFile::kind`: a splat or mesh that the scene file names.
pub const SCENE_FILE_ASSET: u32 = 1;
/// `SceneFile::kind`: the checkpoint that the server began with.
pub const SCENE_FILE_CHECKPOINT: u32 = 2;

/// One file that the server read beside the scene file (block `scene/files`). With them the run can be simulated again.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable, ZeroCopySend)]
#[type_name("cosplat.v1.SceneFile")]
#[repr(C)]
pub struct SceneFile {
    /// `SCENE_FILE_*`.
    pub kind: u32,
    /// Zero.
    pub reserved: u32,
    /// Length of its content when the server read it [byte].
    pub length: u64,
    /// XXH3 of its content then, 64 bits, seed 0.
    pub hash: u64,
    /// As the scene file names it; the file name of a checkpoint. UTF-8, zero-padded.
    pub name: [u8; 4096],
    /// Absolute path on the server's machine, UTF-8, zero-padded.
    pub path: [u8; 4096],
}

impl SceneFile {
    /// A file of `kind` with this length [byte] and hash; names longer than 4096 bytes are cut, as no system opens them.
    pub fn new(kind: u32, name: &str, path: &str, length: u64, hash: u64) -> Self {
        Self {
            kind,
            reserved: 0,
            length,
            hash,
            name: padded(name),
            path: padded(path),
        }
    }

    /// The name by which the scene file asks for it.
    pub fn name(&self) -> Result<&str, TextError> {
        str_from_padded(&self.name)
    }

    /// Where it lies on the server's machine.
    pub fn path(&self) -> Result<&str, TextError> {
        str_from_padded(&self.path)
    }
}

/// User header of every `scene` block.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable, ZeroCopySend)]
#[type_name("cosplat.v1.SceneHeader")]
#[repr(C)]
pub struct SceneHeader {
    /// Identifies this publication of the scene.
    pub epoch: u64,
    /// Hash of the scene; equal for equal scenes, also after a restart.
    pub scene_hash: u64,
    /// Published frames per simulated second [1/s].
    pub frame_rate: f64,
    /// Grid cell size [m].
    pub dx: f64,
    /// Initial gravity [m/s^2].
    pub gravity: [f64; 3],
    /// Box to look at [m]: what moves, at rest, without outliers, down to a floor nearby; smallest corner.
    pub bounds_min: [f32; 3],
    /// Largest corner [m].
    pub bounds_max: [f32; 3],
    /// Gaussians in the scene.
    pub gaussian_count: u32,
    /// Particles in the scene.
    pub particle_count: u32,
    /// Objects in the scene.
    pub object_count: u32,
    /// Spherical-harmonics degree, 0..=3 (block `scene/sh`: `[gaussian][coefficient][rgb]` f32).
    pub sh_degree: u32,
    /// Semantic feature length, 0 = none (block `scene/features`: `[gaussian][feature_dim]` f32).
    pub feature_dim: u32,
    /// Zero.
    pub reserved: u32,
}
