//! Presets of the numbers that trade accuracy for speed.

use super::spec::Resolution;

/// What a scene asks for as a whole; single keys of the file replace single numbers of it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Quality {
    /// To see whether a scene does what it should.
    Draft,
    /// For pictures and interaction.
    #[default]
    Balanced,
    /// For figures.
    Accurate,
}

/// The numbers of a preset.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct QualityNumbers {
    /// How fine the grid is: always cells per object.
    pub resolution: Resolution,
    /// Particles per filled grid cell.
    pub particles_per_cell: f64,
    /// Fraction of the stability limit.
    pub cfl: f64,
    /// What automatic fidelity may change, as a share of an object's radius.
    pub tolerance: f64,
}

impl Quality {
    /// All of them with the names of the scene format, from cheap to dear.
    pub const ALL: [(&'static str, Self); 3] = [
        ("draft", Self::Draft),
        ("balanced", Self::Balanced),
        ("accurate", Self::Accurate),
    ];

    /// Its numbers. `docs/precision.md` has what they cost and how far off their results are.
    pub fn numbers(self) -> QualityNumbers {
        let numbers = |cells, particles_per_cell, cfl, tolerance| QualityNumbers {
            resolution: Resolution::CellsPerObject(cells),
            particles_per_cell,
            cfl,
            tolerance,
        };
        match self {
            Self::Draft => numbers(10.0, 8.0, 0.8, 0.03),
            Self::Balanced => numbers(16.0, 8.0, 0.8, 0.01),
            Self::Accurate => numbers(32.0, 8.0, 0.5, 0.001),
        }
    }
}
