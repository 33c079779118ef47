//! What building a scene found out.

use cosplat_sim_core::scene::{Aabb, Solver};

use super::{error::Finding, spec::AssetSource};
use crate::fill::FillReport;

/// What building a scene found out besides the scene.
#[derive(Clone, Debug, Default)]
pub struct BuildReport {
    /// What is valid but suspicious.
    pub warnings: Vec<Finding>,
    /// One entry per asset.
    pub assets: Vec<AssetReport>,
    /// One entry per object of the scene: what filling found, for simulated splat objects.
    pub fills: Vec<Option<FillReport>>,
    /// One entry per entry of [`SceneFile::objects`](super::SceneFile::objects): the grid that was chosen where it does not say.
    pub chosen: Vec<Option<Solver>>,
    /// One entry per object of the scene: why its matter is on the spatial grid, where it is.
    pub why_spatial: Vec<Option<String>>,
}

/// An asset as it was read and placed.
#[derive(Clone, Debug, PartialEq)]
pub struct AssetReport {
    /// Name in the scene file; empty when written at its object.
    pub name: String,
    /// Where the Gaussians came from.
    pub source: AssetSource,
    /// Gaussians read.
    pub gaussians: usize,
    /// Gaussians left out because of `min_opacity`.
    pub transparent: usize,
    /// Box of the centres in the asset's own frame and unit.
    pub raw_bounds: Aabb,
    /// Box of the centres after the asset's placement, world frame [m]: the frame of `select` boxes.
    pub placed_bounds: Aabb,
}
