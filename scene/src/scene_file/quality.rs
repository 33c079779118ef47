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
            // Smaller substeps would take more of what moves: every transfer damps.
            Self::Accurate => numbers(32.0, 8.0, 0.8, 0.001),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_better_quality_is_not_worse_in_anything() {
        let cells = |of: QualityNumbers| match of.resolution {
            Resolution::CellsPerObject(cells) => cells,
            Resolution::Dx(dx) => unreachable!("{dx} m in a preset"),
        };
        for two in Quality::ALL.windows(2) {
            let [cheap, dear] = [two[0].1.numbers(), two[1].1.numbers()];
            assert!(cells(cheap) < cells(dear));
            assert!(cheap.particles_per_cell <= dear.particles_per_cell);
            assert!(cheap.tolerance > dear.tolerance);
            // What a transfer takes it takes per substep: a bar 2 cells thick that swings loses 3.9 % of its way each period
            // at 0.8, 4.7 % at 0.5 and 6.9 % at 0.25, and a bounce 8.7, 11 and more of its height (docs/precision.md).
            assert!(cheap.cfl <= dear.cfl, "{cheap:?}, {dear:?}");
        }
    }
}
