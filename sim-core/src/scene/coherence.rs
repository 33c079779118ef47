//! What holds an object together besides its matter.

/// Strength and goal of the coherence constraint of one object.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Coherence {
    /// Rate at which velocities approach the goal [1/s], > 0: after `dt` a part `1 - exp(-rate dt)` of the way is gone.
    pub rate: f64,
    /// The goal.
    pub mode: CoherentMode,
}

/// Motion that a coherent object approaches.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum CoherentMode {
    /// Translation and spin.
    Rigid,
    /// Those, and stretch and shear that are the same everywhere in the object.
    #[default]
    Affine,
}

impl CoherentMode {
    /// Names in scene files.
    pub const NAMES: [(&'static str, Self); 2] = [("rigid", Self::Rigid), ("affine", Self::Affine)];
}
