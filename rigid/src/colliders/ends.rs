//! Where matter ends in front of colliders at a node that is about to move.

use super::{
    NodeConditions, Placed,
    approach::GapSample,
    attach::Attached,
    edge::{edge, gap},
    face::{Nodes, Owner},
};

impl Placed<'_> {
    /// Distance from the collider to where matter ends in front of or behind a node [cells]; `cell` is the cell size.
    pub(super) fn edge(&self, index: [i32; 3], nodes: &impl Nodes, cell: f64) -> f64 {
        let surface = |index: [i32; 3]| {
            let found = self.distance(index.map(|i| f64::from(i) * cell));
            (found.value / cell, found.normal)
        };
        edge(index, surface, |at| nodes.matter(at))
    }
}

impl NodeConditions<'_> {
    /// How near matter is to every collider at a node that is about to move with a velocity: where it ends, for those that
    /// it does not obey yet and would reach in a substep of `dt` as far as the nearest particle says; none where that is
    /// all there is to say.
    pub fn ends(
        &self,
        index: [i32; 3],
        nearest: &[GapSample],
        dt: f64,
        cell: f64,
        obeyed: &Attached,
        nodes: &impl Nodes,
    ) -> Option<Vec<GapSample>> {
        if !nodes.reconstructs_surface() {
            return None;
        }
        let mut ends: Option<Vec<GapSample>> = None;
        for (b, body) in self.bodies().iter().enumerate() {
            if body.holds() || obeyed.obeys(Owner::Body(body.id)) {
                continue;
            }
            let u = body.velocity(index.map(|i| f64::from(i) * cell));
            let way: f64 = (0..3).map(|a| (obeyed.velocity[a] - u[a]).abs()).sum();
            let seen = f64::from(nearest[b].gap);
            if seen < dt * way {
                let edge = body.edge(index, nodes, cell);
                let ends = ends.get_or_insert_with(|| nearest.to_vec());
                ends[b].gap = (gap(seen / cell, edge) * cell) as f32;
            }
        }
        ends
    }
}
