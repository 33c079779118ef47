//! The targets, with the inputs that a search begins with.

mod assets;
mod checkpoint;
mod command;
mod recording;
mod semantics;
mod text;
mod world;

/// What kind of bytes a target reads.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Shape {
    /// Lines and words.
    Text,
    /// Fields.
    Binary,
}

/// A reader of what somebody else wrote.
pub struct Target {
    /// Its name.
    pub name: &'static str,
    /// What it reads.
    pub shape: Shape,
    /// Reads an input; panics where that did harm.
    pub(crate) read: fn(&[u8]),
    /// Inputs that are right, or nearly so.
    pub seeds: fn() -> Vec<Vec<u8>>,
}

/// All targets.
pub const TARGETS: &[Target] = &[
    Target {
        name: "ply",
        shape: Shape::Text,
        read: assets::ply,
        seeds: assets::ply_seeds,
    },
    Target {
        name: "splat",
        shape: Shape::Binary,
        read: assets::splat,
        seeds: assets::splat_seeds,
    },
    Target {
        name: "mesh",
        shape: Shape::Text,
        read: assets::mesh,
        seeds: assets::mesh_seeds,
    },
    Target {
        name: "scene",
        shape: Shape::Text,
        read: text::scene,
        seeds: text::scene_seeds,
    },
    Target {
        name: "physgaussian",
        shape: Shape::Text,
        read: text::physgaussian,
        seeds: text::physgaussian_seeds,
    },
    Target {
        name: "command",
        shape: Shape::Binary,
        read: command::read,
        seeds: command::seeds,
    },
    Target {
        name: "checkpoint",
        shape: Shape::Binary,
        read: checkpoint::read,
        seeds: checkpoint::seeds,
    },
    Target {
        name: "recording",
        shape: Shape::Binary,
        read: recording::read,
        seeds: recording::seeds,
    },
    Target {
        name: "npy",
        shape: Shape::Text,
        read: semantics::array,
        seeds: semantics::array_seeds,
    },
    Target {
        name: "mask",
        shape: Shape::Binary,
        read: semantics::mask,
        seeds: semantics::mask_seeds,
    },
    Target {
        name: "objects",
        shape: Shape::Text,
        read: semantics::objects,
        seeds: semantics::objects_seeds,
    },
    Target {
        name: "tree",
        shape: Shape::Text,
        read: semantics::tree,
        seeds: semantics::tree_seeds,
    },
    Target {
        name: "colmap_text",
        shape: Shape::Text,
        read: semantics::colmap_text,
        seeds: semantics::colmap_text_seeds,
    },
    Target {
        name: "colmap_binary",
        shape: Shape::Binary,
        read: semantics::colmap_binary,
        seeds: semantics::colmap_binary_seeds,
    },
    Target {
        name: "transforms",
        shape: Shape::Text,
        read: semantics::cameras,
        seeds: semantics::cameras_seeds,
    },
];
