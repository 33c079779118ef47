//! Projected Gauss-Seidel over all nodes of the grid that meet solids, from what they exchanged in the substep before.

use std::ops::Range;

use crate::{
    bodies::vector::{Vec3, along, length, scaled, sub},
    mat3::dot,
    simd::{Isa, Lanes, on_isa},
};

/// Sweeps over all nodes at most.
const SWEEPS: usize = 30;
/// Sweeps end when no impulse changes by more than this part of the largest.
const DONE: f64 = 1e-3;

/// A node of the grid that meets solids.
pub(super) struct MetNode {
    /// Node block, row and first float of the node.
    pub at: [usize; 3],
    /// [kg]
    pub mass: f64,
    /// Before and now [m/s].
    pub velocity: [Vec3; 2],
}

/// An object, a field of the grid, a block of that, and which of its nodes.
pub(super) type Pair = (usize, u32, [i32; 3], usize);

/// A node of the grid against a solid.
pub(super) struct NodeContact {
    pub pair: Pair,
    /// Place of the node among those that meet.
    pub site: usize,
    pub normal: Vec3,
    /// Least normal velocity that is left.
    pub target: f64,
    pub friction: f64,
    /// Of the solid there, before [m/s].
    pub velocity: Vec3,
    /// Its bearers, of all.
    pub bears: Range<usize>,
    pub inverse_mass: f64,
    /// On the grid's node [N s].
    pub normal_impulse: f64,
    pub friction_impulse: Vec3,
    /// What rounding left over of it, on the solid [N s].
    pub rest: Vec3,
}

/// A node of a solid that bears a point, or has mass together with one that does.
pub(super) struct Bearer {
    /// Its place among the nodes of all solids.
    pub place: usize,
    /// Its share in the motion of the point.
    pub share: f64,
    /// Its velocity per impulse on the point [1/kg].
    pub answer: f64,
}

/// All nodes that meet solids.
#[derive(Default)]
pub(super) struct Contacts {
    pub sites: Vec<MetNode>,
    /// By solids, then by nodes of the grid in their order.
    pub all: Vec<NodeContact>,
    pub bearers: Vec<Bearer>,
    /// Velocity changes of the nodes of all solids [m/s].
    pub changes: Vec<Vec3>,
}

/// Forces on nodes of the grid by solids in the substep before, in the order of their pairs [N]. Sweeps begin with them.
#[derive(Clone, Debug, Default)]
pub(crate) struct WarmStart(Vec<(Pair, Vec3)>);

impl WarmStart {
    /// Forgets what no substep may depend on that follows.
    pub fn clear(&mut self) {
        self.0.clear();
    }

    fn impulse(&self, pair: &Pair, dt: f64) -> Option<Vec3> {
        let known = self.0.binary_search_by_key(pair, |one| one.0).ok()?;
        Some(scaled(self.0[known].1, dt))
    }
}

impl NodeContact {
    /// On the grid's node, so far [N s].
    pub fn impulse(&self) -> Vec3 {
        along(self.friction_impulse, self.normal_impulse, self.normal)
    }

    /// Sets its impulse to what an impulse is within Coulomb's law [N s].
    fn begin(&mut self, impulse: Vec3) {
        let along_normal = dot(impulse, self.normal);
        self.normal_impulse = along_normal.max(0.0);
        self.friction_impulse = self.bounded(along(impulse, -along_normal, self.normal));
    }

    /// A tangential impulse as far as friction goes.
    #[inline(always)]
    fn bounded(&self, tangential: Vec3) -> Vec3 {
        let (most, size) = (self.friction * self.normal_impulse, length(tangential));
        match size > most {
            true => scaled(tangential, most / size),
            false => tangential,
        }
    }
}

impl Contacts {
    /// Finds impulses that leave velocities as they may be in a substep [s], from those before on, and keeps them.
    pub fn solve(&mut self, isa: Isa, dt: f64, before: &mut WarmStart) {
        for n in 0..self.all.len() {
            if let Some(impulse) = before.impulse(&self.all[n].pair, dt) {
                self.all[n].begin(impulse);
                self.give(n, self.all[n].impulse());
            }
        }
        sweep_with_isa(isa, self);
        let forces = self.all.iter().filter(|one| one.normal_impulse > 0.0);
        before.0.clear();
        let forces = forces.map(|one| (one.pair, scaled(one.impulse(), 1.0 / dt)));
        before.0.extend(forces);
    }

    /// Makes an impulse such that velocities are as they may be; returns the size of the change [N s].
    #[inline(always)]
    fn project(&mut self, n: usize) -> f64 {
        let one = &mut self.all[n];
        let mut other = one.velocity;
        for bearer in &self.bearers[one.bears.clone()] {
            other = along(other, bearer.share, self.changes[bearer.place]);
        }
        let u = sub(self.sites[one.site].velocity[1], other);
        let speed = dot(u, one.normal);
        let change = (one.target - speed) / one.inverse_mass;
        let change = change.max(-one.normal_impulse);
        one.normal_impulse += change;
        let tangent = along(u, -speed, one.normal);
        let wanted = along(one.friction_impulse, -1.0 / one.inverse_mass, tangent);
        let friction = one.bounded(wanted);
        let given = along(sub(friction, one.friction_impulse), change, one.normal);
        if given == [0.0; 3] {
            return 0.0;
        }
        one.friction_impulse = friction;
        self.give(n, given);
        length(given)
    }

    /// Gives the node of a contact an impulse, and the solid its opposite [N s].
    #[inline(always)]
    fn give(&mut self, n: usize, impulse: Vec3) {
        let site = &mut self.sites[self.all[n].site];
        site.velocity[1] = along(site.velocity[1], 1.0 / site.mass, impulse);
        self.push(n, scaled(impulse, -1.0));
    }

    /// Gives the solid of a contact an impulse [N s].
    #[inline(always)]
    fn push(&mut self, n: usize, impulse: Vec3) {
        for bearer in &self.bearers[self.all[n].bears.clone()] {
            let change = &mut self.changes[bearer.place];
            *change = along(*change, bearer.answer, impulse);
        }
    }
}

on_isa! {
    fn sweep_with_isa = sweep(contacts: &mut Contacts)
}

/// Sweeps over all until their impulses hardly change.
#[expect(
    clippy::extra_unused_type_parameters,
    reason = "compiled for each instruction set, without lanes of its own"
)]
#[inline(always)]
fn sweep<V: Lanes>(contacts: &mut Contacts) {
    for _ in 0..SWEEPS {
        let (mut changed, mut largest) = (0.0_f64, 0.0_f64);
        for n in 0..contacts.all.len() {
            changed = changed.max(contacts.project(n));
            largest = largest.max(contacts.all[n].normal_impulse);
        }
        if changed <= DONE * largest {
            break;
        }
    }
}
