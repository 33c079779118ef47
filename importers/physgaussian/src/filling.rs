//! `particle_filling`: how the original puts particles inside.

use crate::{
    fields::Fields,
    notes::{NoteKind, Notes},
};

/// The block `particle_filling`, as far as it says how dense.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Filling {
    /// Cells per axis of the filling grid.
    pub n_grid: u64,
    /// Random points per filled cell.
    pub per_cell: u64,
    /// Box of the filling grid; the whole domain when absent.
    pub boundary: Option<[f64; 6]>,
}

/// Reads the block; none when the object is simulated by its Gaussians alone.
pub(super) fn read(top: &mut Fields, n_grid: u64, notes: &mut Notes) -> Option<Filling> {
    let value = top.get("particle_filling")?;
    let mut fields = Fields::new("particle_filling", value, notes)?;
    let any = (1, 1 << 32);
    let misspelt = fields.count("max_partciels_per_cell", any, notes);
    let spelt = fields.count("max_particles_per_cell", any, notes);
    if let (None, Some(count)) = (misspelt, spelt) {
        notes.add(
            NoteKind::Corrected,
            fields.path("max_particles_per_cell"),
            count,
            count,
            "the original only reads the misspelt `max_partciels_per_cell`, and would use 1",
        );
    } else if let (Some(used), Some(other)) = (misspelt, spelt)
        && used != other
    {
        notes.warn(
            fields.path("max_particles_per_cell"),
            other,
            format!("the misspelt `max_partciels_per_cell` = {used} is what the original reads, and is used"),
        );
    }
    let filling = Filling {
        n_grid: fields
            .count("n_grid", (1, 1 << 16), notes)
            .unwrap_or(4 * n_grid),
        per_cell: misspelt.or(spelt).unwrap_or(1),
        boundary: fields.vector("boundary", notes),
    };
    fields.ignore(
        &[
            "density_threshold",
            "search_threshold",
            "search_exclude_direction",
            "ray_cast_direction",
            "smooth",
        ],
        "filling here needs no thresholds or directions: what the Gaussians enclose is inside, holes are closed, \
         and the particles sit on a lattice instead of at random",
        notes,
    );
    fields.ignore(
        &["max_particles_num"],
        "the number of particles follows from `dx` and `particles_per_cell`",
        notes,
    );
    fields.ignore(
        &["visualize"],
        "particles of the inside are not drawn: the Gaussians follow them",
        notes,
    );
    fields.finish(notes);
    Some(filling)
}

impl Filling {
    /// Random points per cell of the simulation grid inside the object; `dx` is its cell size, `grid_lim` the domain's.
    pub fn per_simulation_cell(&self, dx: f64, grid_lim: f64) -> f64 {
        let side = match &self.boundary {
            // The longest side over the cells, as the original sizes it.
            Some(b) => (0..3).map(|a| b[2 * a + 1] - b[2 * a]).fold(0.0, f64::max),
            None => grid_lim,
        };
        self.per_cell as f64 * (dx * self.n_grid as f64 / side).powi(3)
    }
}
