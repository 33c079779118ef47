//! What results of a scene's resolution were off by where the answer is known, and what a finer one costs.

use std::fmt::{self, Write as _};

use cosplat_sim_core::scene::Solver;
use serde::Serialize;

use super::SceneSummary;

/// Cases, cells along the smallest object, relative errors: written by `cosplat bench precision --write`.
const MEASURED: &str = include_str!("../../../docs/precision/resolution.csv");

/// A hint, not a bound: other scenes have other errors.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PrecisionHint {
    /// Cells along the longest side of the smallest object that deforms.
    cells: f64,
    /// The same of the smallest on the spatial grid; none where nothing is on it.
    cells_on_spatial_grid: Option<f64>,
    /// Measured relative errors of other scenes on that grid at that resolution, and at half the cell size.
    measured: Vec<CaseErrors>,
    /// Particle-substeps at half the cell size over those now.
    cost_of_half_dx: f64,
    /// Particle-substeps per simulated second at half the cell size.
    particle_updates_per_second_at_half_dx: f64,
}

#[derive(Clone, Debug, PartialEq, Serialize)]
struct CaseErrors {
    case: String,
    now: f64,
    /// Absent where nothing that fine was measured.
    at_half_dx: Option<f64>,
}

impl PrecisionHint {
    /// Of a scene with matter that deforms: rigid bodies have no cells.
    pub(super) fn new(summary: &SceneSummary) -> Option<Self> {
        let smallest = |is_meant: fn(&str) -> bool| {
            let objects = summary.objects.iter();
            let bodies =
                objects.filter_map(|o| o.body.as_ref().filter(|_| o.solver.is_some_and(is_meant)));
            let longest = bodies.map(|b| b.cells.iter().copied().fold(0.0, f64::max));
            longest.min_by(f64::total_cmp)
        };
        let cells_on_spatial_grid = smallest(|solver| solver == Solver::Spatial.name());
        // A substep is proportional to dx, particles to its inverse cube.
        let cost_of_half_dx = 16.0;
        let measured = cells_on_spatial_grid.map_or(vec![], errors_at);
        Some(Self {
            cells: smallest(|_| true)?,
            cells_on_spatial_grid,
            measured,
            cost_of_half_dx,
            particle_updates_per_second_at_half_dx: cost_of_half_dx
                * summary.particle_updates_per_second,
        })
    }
}

/// Errors of all cases with so many cells, and with twice as many.
fn errors_at(cells: f64) -> Vec<CaseErrors> {
    let errors = curves(MEASURED).into_iter().filter_map(|(case, curve)| {
        Some(CaseErrors {
            case,
            now: at(&curve, cells)?,
            at_half_dx: at(&curve, 2.0 * cells),
        })
    });
    errors.collect()
}

/// Cells and errors of each case, in the order of the table.
fn curves(table: &str) -> Vec<(String, Vec<[f64; 2]>)> {
    let mut curves: Vec<(String, Vec<[f64; 2]>)> = Vec::new();
    for line in table.lines().skip(1) {
        let mut fields = line.split(',');
        let (Some(case), Some(cells), Some(error)) = (fields.next(), fields.next(), fields.next())
        else {
            continue;
        };
        let (Ok(cells), Ok(error)) = (cells.parse(), error.parse()) else {
            continue;
        };
        match curves.last_mut() {
            Some((name, curve)) if name == case => curve.push([cells, error]),
            _ => curves.push((case.to_owned(), vec![[cells, error]])),
        }
    }
    curves
}

/// The error between two measured resolutions, on logarithmic axes; none outside of what was measured.
fn at(curve: &[[f64; 2]], cells: f64) -> Option<f64> {
    // The box of the particles is smaller than the object by about half a cell.
    let slack = 1.06;
    let two = curve
        .windows(2)
        .find(|two| (two[0][0] / slack..=two[1][0] * slack).contains(&cells))?;
    let [a, b] = [two[0], two[1]].map(|point| point.map(f64::ln));
    let t = ((cells.ln() - a[0]) / (b[0] - a[0])).clamp(0.0, 1.0);
    Some((a[1] + t * (b[1] - a[1])).exp())
}

fn percent(error: f64) -> String {
    match 100.0 * error {
        p if p >= 10.0 => format!("{p:.0} %"),
        p if p >= 0.1 => format!("{p:.1} %"),
        p => format!("{p:.0e} %"),
    }
}

impl fmt::Display for PrecisionHint {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let list = |of: fn(&CaseErrors) -> Option<f64>| {
            let errors = self.measured.iter().filter_map(|case| {
                let error = of(case)?;
                Some(format!("{} {}", case.case, percent(error)))
            });
            errors.collect::<Vec<_>>().join(", ")
        };
        writeln!(
            f,
            "precision  {:.1} cells along the smallest object",
            self.cells
        )?;
        let mut text = String::new();
        match (self.cells_on_spatial_grid, list(|case| Some(case.now))) {
            (None, _) => {}
            (Some(_), now) if now.is_empty() => {
                text.push_str("           nothing was measured at that resolution\n");
            }
            (Some(cells), now) => {
                let _ = writeln!(
                    text,
                    "           errors measured on the spatial grid with {cells:.1} cells, see docs/precision.md: {now}"
                );
            }
        }
        let _ = write!(
            text,
            "           half the dx: {} times the work, {:.1} million particle-substeps per simulated second",
            self.cost_of_half_dx,
            self.particle_updates_per_second_at_half_dx / 1e6
        );
        let finer = list(|case| case.at_half_dx);
        if !finer.is_empty() {
            let _ = write!(text, "; errors there: {finer}");
        }
        writeln!(f, "{text}")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TABLE: &str = "case,cells,error\nbar,8,0.04\nbar,16,0.01\nspin,8,0.5\nspin,32,0.125\n";

    #[test]
    fn errors_between_measured_resolutions_follow_the_power_law() {
        let curves = curves(TABLE);
        let near = |found: Option<f64>, expected: f64| {
            let found = found.expect("within the measured range");
            assert!((found / expected - 1.0).abs() < 1e-12, "{found}");
        };
        near(at(&curves[0].1, 8.0 * 2f64.sqrt()), 0.02);
        near(at(&curves[1].1, 16.0), 0.25);
        assert_eq!(at(&curves[0].1, 32.0), None);
        assert_eq!(at(&curves[0].1, 4.0), None);
    }

    #[test]
    fn the_committed_table_covers_the_default_resolution() {
        let covered = curves(MEASURED)
            .iter()
            .filter(|(_, curve)| at(curve, 16.0).is_some_and(|e| e > 0.0))
            .count();
        assert!(covered >= 5, "{covered}");
    }
}
