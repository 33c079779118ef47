//! What holds an object together besides its matter.

/// Strength and goal of the coherence constraint of one object.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Coherence {
    /// Rate at which velocities approach the goal [1/s], > 0: after `dt` a part `1 - exp(-rate dt)` of the way is gone.
    pub rate: f64,
    /// The goal.
    pub mode: CoherentMode,
}

impl Coherence {
    /// Part of the way to the nearest motion that is gone in `dt` [s].
    pub fn part(&self, dt: f64) -> f64 {
        -(-self.rate * dt).exp_m1()
    }
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn strength_is_a_rate() {
        let coherence = Coherence {
            rate: 3.0,
            mode: CoherentMode::Affine,
        };
        let (once, twice) = (coherence.part(0.2), coherence.part(0.1));
        assert!((1.0 - once - (1.0 - twice).powi(2)).abs() < 1e-15);
        assert_eq!(coherence.part(0.0), 0.0);
    }
}
