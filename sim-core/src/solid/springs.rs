//! Springs that hold patches of a solid, at its nodes.

use std::collections::BTreeMap;

use super::{advance::Solid, nodes::NODES, object::SolidObject, state::SolidState};
use crate::{
    colliders::{
        Substep,
        springs::{Given, Spring},
    },
    mat3::dot,
};

/// A spring at nodes of a solid.
#[derive(Debug)]
pub(crate) struct NodeSpring<'a> {
    spring: &'a Spring,
    nodes: Vec<HeldNode>,
    /// What they were given in the span.
    pub given: Given,
}

/// A node of a patch.
#[derive(Debug)]
struct HeldNode {
    slot: usize,
    /// Its share of the patch.
    share: f64,
    /// Its place from the centre of the patch where the span begins [m].
    place: [f64; 3],
    /// Impulse of the kick at hand [N s].
    impulse: [f64; 3],
    /// Its velocity before that [m/s].
    before: [f64; 3],
}

impl<'a> NodeSpring<'a> {
    /// A spring on particles of a solid, which are the scene's from `first` on.
    pub fn new(spring: &'a Spring, solid: &SolidObject, state: &SolidState, first: usize) -> Self {
        let mut shares: BTreeMap<usize, f64> = BTreeMap::new();
        let mut centre = [0.0; 3];
        for (id, share) in spring.shares() {
            let site = &solid.particles[id as usize - first];
            let x = state.sample(&solid.grid, site).x;
            for a in 0..3 {
                centre[a] += share * x[a];
            }
            for (slot, weight) in solid.grid.stencil_at(site) {
                if solid.grid.mass[slot] > 0.0 {
                    *shares.entry(slot).or_default() += weight * share;
                }
            }
        }
        // Nodes without a mass bear none of it.
        let whole: f64 = shares.values().sum();
        shares.values_mut().for_each(|share| *share /= whole);
        let nodes = shares.into_iter().map(|(slot, share)| {
            let x = state.position(&solid.grid, slot);
            HeldNode {
                slot,
                share,
                place: std::array::from_fn(|a| x[a] - centre[a]),
                impulse: [0.0; 3],
                before: [0.0; 3],
            }
        });
        Self {
            spring,
            nodes: nodes.collect(),
            given: Given::default(),
        }
    }

    /// Pushes nodes by what the spring has in the kick of a substep, but those whose velocity is given.
    pub fn push(&mut self, solid: &mut Solid<'_>, now: &Substep) {
        let model = solid.model;
        for node in &mut self.nodes {
            let slot = node.slot;
            let w = solid.scratch.conditions.w[slot / NODES][slot / 16 % 4].0[slot % 16];
            if w == 0.0 || now.kick <= 0.0 {
                continue;
            }
            let (x, v) = (
                solid.state.position(model, slot),
                solid.state.velocity_of(model, slot),
            );
            let mass = model.mass[slot];
            let kick = self.spring.kick(now.time, now.kick, node.share / mass);
            let change = self.spring.change(&kick, node.place, x, v);
            node.impulse = change.map(|dv| mass * dv);
            node.before = v;
            let scale = (now.kick * model.dx * model.dx).recip();
            let force = node.impulse.map(|j| (scale * j) as f32);
            solid.scratch.conditions.add_force(slot, force);
        }
    }

    /// Takes note of the velocities after a kick.
    pub fn settle(&mut self, solid: &Solid<'_>) {
        for node in &mut self.nodes {
            let after = solid.state.velocity_of(solid.model, node.slot);
            let impulse = std::mem::take(&mut node.impulse);
            let mean = std::array::from_fn(|a| 0.5 * (node.before[a] + after[a]));
            self.given.add(&Given {
                impulse,
                work: dot(impulse, mean),
            });
        }
    }
}
