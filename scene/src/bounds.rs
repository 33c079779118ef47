//! The box about points.

use cosplat_sim_core::scene::Aabb;

/// Box of points; none for no points.
pub(crate) fn bounds_of(points: impl Iterator<Item = [f64; 3]>) -> Option<Aabb> {
    points.fold(None, |found, p| {
        let found = found.unwrap_or(Aabb { min: p, max: p });
        Some(Aabb {
            min: std::array::from_fn(|i| found.min[i].min(p[i])),
            max: std::array::from_fn(|i| found.max[i].max(p[i])),
        })
    })
}
