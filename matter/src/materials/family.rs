//! What laws have in common: how stress comes about. Whoever treats laws alike asks for the family, so that a new law has to say its own.

use super::{Law, piola::PiolaLaw};

/// How stress comes about.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Family {
    /// Elastic, with a first Piola-Kirchhoff stress of its own: [`piola`](super::piola).
    Piola(PiolaLaw),
    /// On Hencky strain over a shape at rest, with flow or without: [`hencky_piola`](super::hencky_piola).
    Hencky,
    /// Without a shape at rest that lasts: on the spatial grid alone.
    Spatial,
    /// No stress.
    Rigid,
}

impl Law {
    /// Its family.
    #[inline(always)]
    pub fn family(self) -> Family {
        match self {
            Self::FixedCorotated => Family::Piola(PiolaLaw::FixedCorotated),
            Self::NeoHookean => Family::Piola(PiolaLaw::NeoHookean),
            Self::Hencky | Self::VonMises { .. } | Self::Foam { .. } | Self::Plasticine { .. } => {
                Family::Hencky
            }
            Self::DruckerPrager { .. } | Self::Snow { .. } | Self::Fluid { .. } => Family::Spatial,
            Self::Rigid => Family::Rigid,
        }
    }

    /// Whether matter of it may have a grid of its own: it keeps its shape, or flows from there.
    pub fn may_be_solid(self) -> bool {
        match self.family() {
            Family::Piola(_) | Family::Hencky => true,
            Family::Spatial | Family::Rigid => false,
        }
    }

    /// The law of what it is before it flows; itself where that is no law of solids.
    #[inline(always)]
    pub fn without_flow(self) -> Self {
        match self.family() {
            Family::Hencky => Self::Hencky,
            Family::Piola(_) | Family::Spatial | Family::Rigid => self,
        }
    }
}
