//! The size of cells: stated, or told by the smallest object.

use cosplat_sim_core::scene::Fidelity;

use super::{
    assembly::Part,
    error::{Finding, SceneErrors},
    sampling::{Body, MAX_CELLS},
    select::longest_side,
    spec::{Resolution, SceneFile},
};

/// Grid cell size [m].
pub(super) fn size(
    file: &SceneFile,
    parts: &[Part<'_>],
    bodies: &[Body],
) -> Result<f64, SceneErrors> {
    let simulated = |part: &&Part| part.spec.fidelity != Fidelity::Static;
    let sides = parts.iter().filter(simulated);
    let smallest = sides
        .map(|p| longest_side(&bodies[p.body].bounds))
        .fold(f64::INFINITY, f64::min);
    if let (Resolution::CellsPerObject(_), true) = (file.resolution, smallest == 0.0) {
        let point = |part: &&Part| longest_side(&bodies[part.body].bounds) == 0.0;
        let points = parts.iter().filter(simulated).filter(point);
        let finding = |part: &Part| {
            let message = format!(
                "object `{}`: its Gaussians are all at one place, and no size of cells follows from that: \
                 expected Gaussians at two places, or a `dx`",
                part.name
            );
            Finding::new(&part.spec.at, message)
        };
        return Err(SceneErrors(points.map(finding).collect()));
    }
    let dx = match file.resolution {
        Resolution::Dx(dx) => dx,
        // A scene without simulated objects has a grid that nothing uses.
        Resolution::CellsPerObject(_) if smallest == f64::INFINITY => 0.01,
        Resolution::CellsPerObject(cells) => smallest / cells,
    };
    let mut cells = 0.0;
    for part in parts.iter().filter(simulated) {
        let b = &bodies[part.body].bounds;
        cells += (0..3)
            .map(|a| (b.max[a] - b.min[a]) / dx + 1.0)
            .product::<f64>();
    }
    if !(dx > 0.0 && cells < MAX_CELLS) {
        let message = format!(
            "cells of {dx:.3e} m make {cells:.3e} cells in the boxes of the simulated objects, \
             expected less than {MAX_CELLS:.0e}: make them larger"
        );
        let at = &file.resolution_at;
        return Err(SceneErrors(vec![Finding::new(at, message)]));
    }
    Ok(dx)
}
