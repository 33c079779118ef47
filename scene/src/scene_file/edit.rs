//! Small operations on sets of Gaussians: subset, append, move, box.
//!
//! On the way to their places positions are in double precision: what is far from the origin in its file may be near it in the scene.

use cosplat_sim_core::scene::Aabb;
use glam::{DQuat, DVec3};

use crate::{assets::Gaussians, bounds::bounds_of};

/// Box of Gaussian centres; none for no Gaussians.
pub(super) fn bounds(gaussians: &Gaussians) -> Option<Aabb> {
    bounds_of(gaussians.position.iter().map(|p| p.map(f64::from)))
}

/// Gaussians on the way from their file to their place.
#[derive(Clone, Debug)]
pub(super) struct Unplaced {
    /// All but where they are: their positions are not to be read.
    rest: Gaussians,
    /// Where they are.
    pub position: Vec<[f64; 3]>,
    /// Whether their file has them in double precision.
    pub is_exact: bool,
}

impl Unplaced {
    /// As they were read, with their positions in double precision where a file has them so.
    pub fn new(gaussians: Gaussians, exact: Vec<[f64; 3]>) -> Self {
        let is_exact = !exact.is_empty() && exact.len() == gaussians.len();
        let position = match is_exact {
            true => exact,
            false => gaussians
                .position
                .iter()
                .map(|p| p.map(f64::from))
                .collect(),
        };
        Self {
            rest: gaussians,
            position,
            is_exact,
        }
    }

    /// How many.
    pub fn len(&self) -> usize {
        self.position.len()
    }

    /// All of them but where they are.
    pub fn looks(&self) -> &Gaussians {
        &self.rest
    }

    /// Those at these indices.
    pub fn subset(&self, indices: &[usize]) -> Self {
        Self {
            rest: subset(&self.rest, indices),
            position: indices.iter().map(|&i| self.position[i]).collect(),
            is_exact: self.is_exact,
        }
    }

    /// Rotates, scales, then translates them. Spherical harmonics stay in the frame they were captured in.
    pub fn transform(&mut self, rotation: DQuat, factor: f64, translation: DVec3) {
        for p in &mut self.position {
            *p = (rotation * (DVec3::from(*p) * factor) + translation).to_array();
        }
        stretch(&mut self.rest, factor);
        turn(&mut self.rest, rotation);
    }

    /// Where they are for good, rounded to single precision.
    pub fn placed(mut self) -> Gaussians {
        let rounded = self.position.iter().map(|p| p.map(|x| x as f32));
        self.rest.position = rounded.collect();
        self.rest
    }
}

/// Rotates, then translates Gaussians. Spherical harmonics stay in the frame they were captured in.
pub(super) fn move_rigidly(g: &mut Gaussians, rotation: DQuat, translation: DVec3) {
    for p in &mut g.position {
        let world = rotation * DVec3::from(p.map(f64::from)) + translation;
        *p = world.as_vec3().to_array();
    }
    turn(g, rotation);
}

fn stretch(g: &mut Gaussians, factor: f64) {
    for s in &mut g.scale {
        *s = s.map(|s| (f64::from(s) * factor) as f32);
    }
}

fn turn(g: &mut Gaussians, rotation: DQuat) {
    for q in &mut g.rotation {
        let local = DQuat::from_array(q.map(f64::from));
        *q = (rotation * local).normalize().as_quat().to_array();
    }
}

/// The Gaussians at these indices.
pub(super) fn subset(g: &Gaussians, indices: &[usize]) -> Gaussians {
    let rows = |values: &[f32], stride: usize| -> Vec<f32> {
        let row = |&i: &usize| &values[i * stride..(i + 1) * stride];
        indices.iter().flat_map(row).copied().collect()
    };
    Gaussians {
        position: indices.iter().map(|&i| g.position[i]).collect(),
        scale: indices.iter().map(|&i| g.scale[i]).collect(),
        rotation: indices.iter().map(|&i| g.rotation[i]).collect(),
        opacity: indices.iter().map(|&i| g.opacity[i]).collect(),
        sh: rows(&g.sh, g.sh_stride()),
        sh_degree: g.sh_degree,
        feature: rows(&g.feature, g.feature_dim as usize),
        feature_dim: g.feature_dim,
    }
}

/// Appends `more`, whose spherical harmonics and features are not longer than those of `all`; what is missing
/// is zero.
pub(crate) fn append(all: &mut Gaussians, more: &Gaussians) {
    let padded = |values: &[f32], from: usize, to: usize| -> Vec<f32> {
        let mut padded = Vec::with_capacity(more.len() * to);
        for i in 0..more.len() {
            padded.extend_from_slice(&values[i * from..(i + 1) * from]);
            padded.resize((i + 1) * to, 0.0);
        }
        padded
    };
    all.sh
        .extend(padded(&more.sh, more.sh_stride(), all.sh_stride()));
    let (from, to) = (more.feature_dim as usize, all.feature_dim as usize);
    all.feature.extend(padded(&more.feature, from, to));
    all.position.extend_from_slice(&more.position);
    all.scale.extend_from_slice(&more.scale);
    all.rotation.extend_from_slice(&more.rotation);
    all.opacity.extend_from_slice(&more.opacity);
}
