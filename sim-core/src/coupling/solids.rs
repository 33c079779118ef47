//! Solids on grids of their own and matter on the grid in space: impulses between nodes of both.
//!
//! A node of the grid meets a solid as it meets a rigid body. What it gives acts on the solid at the node's place, on the solid's
//! nodes around the material point there, through all of the substep.

use std::collections::BTreeMap;

use super::{
    CouplingInput,
    near::near,
    obstacle::{FacedBlock, Facing, Obstacle, Towards},
};
use crate::{
    bodies::vector::{Vec3, add, along, length, scaled, sub},
    grid::{Grid, NODES},
    ledger::Received,
    mat3::dot,
    solid::inverse::{LocalInverse, SeenSurface},
};

/// Sweeps over all nodes at most.
const SWEEPS: usize = 30;
/// Sweeps end when no impulse changes by more than this part of the largest.
const DONE: f64 = 1e-3;
/// Share of the latest substep in what nodes of a solid are expected to do. What is at rest needs the mean alone. With all of the latest,
/// impulses answered stress that had gone, and what met at a third of the speed of sound came away with up to 2.3 times its energy.
const FRESH: f64 = 0.1;

/// A solid among nodes of the grid.
pub(crate) struct CoupledSolid<'a> {
    pub object: usize,
    pub inverse: LocalInverse<'a>,
    /// Box around its surface [m], and the largest speed of it [m/s].
    pub bounds: [Vec3; 2],
    pub speed: f64,
    /// [m/s^2]
    pub gravity: Vec3,
    /// The substep [s].
    pub dt: f64,
    /// Nodes that nothing moves, ascending.
    pub held: Vec<usize>,
}

impl Obstacle for CoupledSolid<'_> {
    type Place = SeenSurface;

    fn ball(&self) -> (Vec3, f64) {
        let [min, max] = self.bounds;
        let half = scaled(sub(max, min), 0.5);
        (add(min, half), length(half))
    }

    fn towards(&self, x: Vec3, most: f64) -> Option<Towards> {
        let [min, max] = self.bounds;
        if (0..3).any(|a| x[a] < min[a] - most || x[a] > max[a] + most) {
            return None;
        }
        let found = match most < f64::INFINITY {
            true => self.inverse.surface_within(x, most),
            false => self.inverse.surface(x),
        };
        found.map(|found| (found.distance, found.normal))
    }

    fn facing(&self, x: Vec3) -> Option<Facing<SeenSurface>> {
        let seen = self.inverse.surface(x)?;
        Some(Facing {
            towards: (seen.distance, seen.normal),
            velocity: along(seen.velocity(&self.inverse), self.dt, self.gravity),
            place: seen,
        })
    }
}

/// An object with what its nodes get, by the numbers of these.
pub(crate) type NodeImpulses = (usize, Vec<NodeImpulse>);

/// What a node of a solid gets of matter on the grid in a substep.
#[derive(Clone, Copy, Debug)]
pub(crate) struct NodeImpulse {
    pub slot: usize,
    /// [N s]
    pub impulse: Vec3,
    /// Acceleration by all else that it was expected to have [m/s^2].
    pub expected: Vec3,
}

/// What came of solids at nodes of the grid.
#[derive(Clone, Debug, Default)]
pub(crate) struct CoupledSolids {
    /// Per object that there is.
    pub impulses: Vec<NodeImpulses>,
    /// What objects received from the matter of grid fields.
    pub received: Vec<(usize, u32, Received)>,
    /// Largest velocity component given to a node [cells/s].
    pub largest: f32,
}

/// A node of the grid that meets solids.
struct MetNode {
    /// Node block, row and first float of the node.
    at: [usize; 3],
    /// [kg]
    mass: f64,
    /// Before and now [m/s].
    velocity: [Vec3; 2],
}

/// Per node block which of the nodes that meet solids each of its nodes is.
type KnownSites = BTreeMap<usize, [Option<usize>; NODES]>;

/// A node of the grid against a solid.
struct NodeContact {
    site: usize,
    solid: usize,
    field: u32,
    /// Where [m].
    place: Vec3,
    normal: Vec3,
    /// Least normal velocity that is left.
    target: f64,
    friction: f64,
    /// Of the solid there, before [m/s].
    velocity: Vec3,
    bears: Vec<Bearer>,
    inverse_mass: f64,
    /// On the grid's node [N s].
    normal_impulse: f64,
    friction_impulse: Vec3,
}

/// A node of a solid that bears a point.
struct Bearer {
    slot: usize,
    /// Its share in the motion of the point.
    share: f64,
    /// Its velocity per impulse on the point [1/kg].
    answer: f64,
}

/// Lets solids and nodes of the grid meet.
pub(crate) fn couple_solids_to_grid(
    grid: &mut Grid,
    solids: &[CoupledSolid<'_>],
    input: &CouplingInput<'_>,
) -> CoupledSolids {
    let (mut sites, mut known, mut contacts) = (vec![], KnownSites::new(), vec![]);
    for (n, solid) in solids.iter().enumerate() {
        let sites = (&mut sites, &mut known);
        find_contacts(grid, solid, n, input, sites, &mut contacts);
    }
    let mut coupled = CoupledSolids::default();
    if contacts.is_empty() {
        return coupled;
    }
    // Velocity changes of nodes of the solids that are met [m/s].
    let mut changes: Vec<Vec<Vec3>> = vec![vec![]; solids.len()];
    for contact in &contacts {
        let (model, changes) = (
            solids[contact.solid].inverse.model,
            &mut changes[contact.solid],
        );
        changes.resize(model.mass.len(), [0.0; 3]);
    }
    for _ in 0..SWEEPS {
        let (mut changed, mut largest) = (0.0_f64, 0.0_f64);
        for contact in &mut contacts {
            changed = changed.max(contact.solve(&mut sites, &mut changes));
            largest = largest.max(contact.normal_impulse);
        }
        if changed <= DONE * largest {
            break;
        }
    }
    for site in 0..sites.len() {
        let MetNode { at, mass, velocity } = sites[site];
        if velocity[0] == velocity[1] {
            continue;
        }
        let (left, speed) = input.give(grid, at, velocity[1]);
        coupled.largest = coupled.largest.max(speed);
        // What rounding takes from the node its first solid gets.
        if let Some(contact) = contacts.iter().find(|contact| contact.site == site) {
            contact.push(&mut changes, scaled(left, mass));
        }
    }
    for contact in contacts.iter().filter(|c| c.normal_impulse > 0.0) {
        let (normal, impulse) = (
            scaled(contact.normal, -1.0),
            scaled(contact.impulse(), -1.0),
        );
        let received = Received::at(contact.place, normal, contact.normal_impulse, impulse);
        let object = solids[contact.solid].object;
        coupled.received.push((object, contact.field, received));
    }
    for (solid, changes) in solids.iter().zip(changes) {
        let moved = changes.into_iter().enumerate();
        let moved = moved.filter(|(_, change)| *change != [0.0; 3]);
        let mass = &solid.inverse.model.mass;
        let impulses = moved.map(|(slot, change)| NodeImpulse {
            slot,
            impulse: scaled(change, mass[slot]),
            expected: solid.expected(slot),
        });
        coupled.impulses.push((solid.object, impulses.collect()));
    }
    coupled
}

/// Finds where nodes meet the solid `n`.
fn find_contacts(
    grid: &Grid,
    solid: &CoupledSolid<'_>,
    n: usize,
    input: &CouplingInput<'_>,
    (sites, known): (&mut Vec<MetNode>, &mut KnownSites),
    contacts: &mut Vec<NodeContact>,
) {
    let told = near(input, grid, solid, solid.speed);
    let mut shares = vec![];
    for block in told.blocks() {
        let nodes = &grid.nodes[block];
        let faced = FacedBlock {
            grid,
            input,
            obstacle: solid,
            nodes,
            nearest: told.get(block),
        };
        for at in 0..NODES {
            let Some((mass, velocity)) = input.node(grid, block, at) else {
                continue;
            };
            let Some((normal, target, seen)) = faced.closing(at, velocity) else {
                continue;
            };
            let place = faced.place(faced.index(at));
            let of_block = known.entry(block).or_insert([None; NODES]);
            let site = *of_block[at].get_or_insert_with(|| {
                sites.push(MetNode {
                    at: [block, at / 4, 4 * (at % 4)],
                    mass,
                    velocity: [velocity; 2],
                });
                sites.len() - 1
            });
            let model = solid.inverse.model;
            let about = seen.bears(model);
            shares.resize(model.mass.len(), f32::NAN);
            let bears = solid.bearers(&model.borne_by(&about, &mut shares));
            let answers = bears.iter().map(|one| one.share * one.answer);
            contacts.push(NodeContact {
                site,
                solid: n,
                field: nodes.field,
                place,
                normal,
                target,
                friction: (input.friction)(solid.object, nodes.field),
                velocity: add(solid.inverse.velocity_of(&about), solid.gain(&bears)),
                inverse_mass: 1.0 / mass + answers.sum::<f64>(),
                bears,
                normal_impulse: 0.0,
                friction_impulse: [0.0; 3],
            });
        }
    }
}

impl CoupledSolid<'_> {
    /// Nodes with their shares, as they answer.
    fn bearers(&self, nodes: &[(u32, f32)]) -> Vec<Bearer> {
        let bearer = |&(slot, w): &(u32, f32)| {
            let (slot, share) = (slot as usize, f64::from(w));
            Bearer {
                slot,
                share,
                answer: share * self.velocity_per_impulse(slot),
            }
        };
        nodes.iter().map(bearer).collect()
    }

    /// Velocity that nodes get in the substep of all but matter on the grid, as far as is known [m/s]. Without it a node at rest on a
    /// solid would creep in, by as much as it is pushed per substep.
    fn gain(&self, bears: &[Bearer]) -> Vec3 {
        let gain =
            |sum, bearer: &Bearer| along(sum, bearer.share * self.dt, self.expected(bearer.slot));
        bears.iter().fold([0.0; 3], gain)
    }

    /// Acceleration of a node by all but matter on the grid [m/s^2]: a running mean where that acts on it, and gravity elsewhere.
    fn expected(&self, slot: usize) -> Vec3 {
        let state = self.inverse.state;
        let known = state
            .of_matter
            .binary_search_by_key(&slot, |load| load.slot as usize);
        let Some(load) = known.ok().filter(|_| state.span > 0.0) else {
            return self.gravity;
        };
        let load = &state.of_matter[load];
        let now = state.velocity_of(self.inverse.model, slot);
        let all = scaled(sub(now, load.before), 1.0 / state.span);
        let own = along(all, -self.velocity_per_impulse(slot), load.force);
        along(load.expected, FRESH, sub(own, load.expected))
    }

    /// One over the mass of a node [1/kg]; 0 of one that is held.
    fn velocity_per_impulse(&self, slot: usize) -> f64 {
        match self.held.binary_search(&slot) {
            Ok(_) => 0.0,
            Err(_) => self.inverse.model.mass[slot].recip(),
        }
    }
}

impl NodeContact {
    /// On the grid's node, so far [N s].
    fn impulse(&self) -> Vec3 {
        along(self.friction_impulse, self.normal_impulse, self.normal)
    }

    /// Makes its impulse such that velocities are as they may be; returns the size of the change [N s].
    fn solve(&mut self, sites: &mut [MetNode], changes: &mut [Vec<Vec3>]) -> f64 {
        let (mut other, known) = (self.velocity, &changes[self.solid]);
        for bearer in &self.bears {
            other = along(other, bearer.share, known[bearer.slot]);
        }
        let u = sub(sites[self.site].velocity[1], other);
        let speed = dot(u, self.normal);
        let change = (self.target - speed) / self.inverse_mass;
        let change = change.max(-self.normal_impulse);
        self.normal_impulse += change;
        let tangent = along(u, -speed, self.normal);
        let mut friction = along(self.friction_impulse, -1.0 / self.inverse_mass, tangent);
        let most = self.friction * self.normal_impulse;
        let size = length(friction);
        if size > most {
            friction = scaled(friction, most / size);
        }
        let given = along(sub(friction, self.friction_impulse), change, self.normal);
        if given == [0.0; 3] {
            return 0.0;
        }
        self.friction_impulse = friction;
        let site = &mut sites[self.site];
        site.velocity[1] = along(site.velocity[1], 1.0 / site.mass, given);
        self.push(changes, scaled(given, -1.0));
        length(given)
    }

    /// Gives the solid an impulse [N s].
    fn push(&self, changes: &mut [Vec<Vec3>], impulse: Vec3) {
        let changes = &mut changes[self.solid];
        for bearer in &self.bears {
            let change = &mut changes[bearer.slot];
            *change = along(*change, bearer.answer, impulse);
        }
    }
}
