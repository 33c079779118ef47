//! Solids on grids of their own and matter on the grid in space: impulses between nodes of both.
//!
//! A node of the grid meets a solid as it meets a rigid body. What it gives acts on the solid at the node's place, on the solid's
//! nodes around the material point there, through all of the substep.

use std::{collections::BTreeMap, ops::Range, sync::OnceLock};

use super::{
    CouplingInput,
    near::{ClosestParticles, Watch, near},
    obstacle::{FacedBlock, Facing, Obstacle, Towards},
    sweeps::{Bearer, Contacts, MetNode, NodeContact, WarmStart},
};
use crate::{
    bodies::vector::{Vec3, add, along, length, scaled, sub},
    grid::{Grid, NODES, place_of},
    ledger::Received,
    simd::{Isa, LANES},
    solid::{
        inverse::{Known, SeenSurface},
        model::SolidModel,
        outline::{Outline, Unseen},
        state::NodeLoad,
    },
};

/// Share of the latest substep in what nodes of a solid are expected to do. What is at rest needs the mean alone. With all of the latest,
/// impulses answered stress that had gone, and what met at a third of the speed of sound came away with up to 2.3 times its energy.
const FRESH: f64 = 0.1;

/// A solid among nodes of the grid.
pub(crate) struct CoupledSolid<'a> {
    pub object: usize,
    pub outline: Outline<'a>,
    /// Largest speed of its surface [m/s].
    pub speed: f64,
    /// [m/s^2]
    pub gravity: Vec3,
    /// The substep [s].
    pub dt: f64,
    /// Nodes that nothing moves, ascending.
    pub held: Vec<usize>,
    /// How its nodes answer, once that was asked for.
    pub answers: OnceLock<Answers>,
}

impl Obstacle for CoupledSolid<'_> {
    type Place = SeenSurface;

    fn ball(&self) -> (Vec3, f64) {
        let [min, max] = self.outline.bounds();
        let half = scaled(sub(max, min), 0.5);
        (add(min, half), length(half))
    }

    fn around(
        &self,
        places: &[Vec3; LANES],
        most: f64,
        beyond: &mut [f64; LANES],
    ) -> Option<Known> {
        self.outline.around(places, most, beyond)
    }

    fn is_outside(&self, x: Vec3) -> bool {
        self.outline.is_outside(x)
    }

    fn towards(&self, x: Vec3, most: f64, known: Option<Known>) -> Result<Towards, Unseen> {
        let seen = self.outline.within(x, most, known)?;
        Ok(towards(x, &seen))
    }

    fn facing(&self, x: Vec3, known: Known) -> Option<Facing<SeenSurface>> {
        let inverse = &self.outline.inverse;
        let seen = inverse.surface(x, Some(known)).ok()?;
        Some(Facing {
            towards: towards(x, &seen),
            velocity: along(seen.velocity(inverse), self.dt, self.gravity),
            place: seen,
        })
    }
}

fn towards(x: Vec3, seen: &SeenSurface) -> Towards {
    Towards {
        distance: seen.distance,
        normal: seen.normal,
        known: Known {
            now: x,
            rest: seen.rest,
            back: seen.back,
        },
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

/// How the nodes of a solid answer, by their numbers.
pub(crate) struct Answers {
    /// One over its mass [1/kg], of an impulse on it alone but for mass between nodes; 0 of one that is held.
    velocity_per_impulse: Vec<f64>,
    /// Its acceleration by all but matter on the grid, as far as is known: a running mean where that acts on it, and gravity elsewhere
    /// [m/s^2]. Without it a node at rest on a solid would creep in, by as much as it is pushed per substep.
    expected: Vec<Vec3>,
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

/// Per node block which of the nodes that meet solids each of its nodes is.
type KnownSites = BTreeMap<usize, [Option<usize>; NODES]>;

/// Lets solids and nodes of the grid meet.
pub(crate) fn couple_solids_to_grid(
    grid: &mut Grid,
    solids: &[CoupledSolid<'_>],
    input: &CouplingInput<'_>,
    isa: Isa,
    (warm_start, watches): (&mut WarmStart, &mut [Watch]),
) -> CoupledSolids {
    let (mut contacts, mut known) = (Contacts::default(), KnownSites::new());
    // Where the nodes of each solid are among those of all that are met.
    let mut places: Vec<Range<usize>> = vec![];
    for solid in solids {
        let (first, before) = (contacts.changes.len(), contacts.all.len());
        let watch = &mut watches[solid.object];
        let told = near(input, grid, solid, solid.speed, watch);
        find_contacts(
            grid,
            (solid, &told),
            first,
            input,
            &mut known,
            &mut contacts,
        );
        let count = match contacts.all.len() > before {
            true => solid.outline.inverse.model.mass.len(),
            false => 0,
        };
        contacts.changes.resize(first + count, [0.0; 3]);
        places.push(first..first + count);
    }
    let mut coupled = CoupledSolids::default();
    contacts.solve(isa, input.dt, warm_start);
    for site in 0..contacts.sites.len() {
        let MetNode { at, mass, velocity } = contacts.sites[site];
        if velocity[0] == velocity[1] {
            continue;
        }
        let (left, speed) = input.give(grid, at, velocity[1]);
        coupled.largest = coupled.largest.max(speed);
        // What rounding takes from the node its first solid gets.
        if let Some(contact) = contacts.all.iter().position(|c| c.site == site) {
            let one = &mut contacts.all[contact];
            one.rest = along(one.rest, mass, left);
        }
    }
    let mut impulses = vec![[0.0; 3]; contacts.changes.len()];
    for contact in &contacts.all {
        let given = sub(contact.rest, contact.impulse());
        for bearer in &contacts.bearers[contact.bears.clone()] {
            impulses[bearer.place] = along(impulses[bearer.place], bearer.share, given);
        }
    }
    for contact in contacts.all.iter().filter(|c| c.normal_impulse > 0.0) {
        let (normal, impulse) = (
            scaled(contact.normal, -1.0),
            scaled(contact.impulse(), -1.0),
        );
        let (object, field, block, at) = contact.pair;
        let place = place_of(block, at).map(|i| f64::from(i) * input.dx);
        let received = Received::at(place, normal, contact.normal_impulse, impulse);
        coupled.received.push((object, field, received));
    }
    for (solid, places) in solids.iter().zip(places) {
        let pushed = impulses[places].iter().enumerate();
        let pushed = pushed.filter(|(_, impulse)| **impulse != [0.0; 3]);
        let pushed = pushed.map(|(slot, &impulse)| NodeImpulse {
            slot,
            impulse,
            expected: solid.answers().expected[slot],
        });
        coupled.impulses.push((solid.object, pushed.collect()));
    }
    coupled
}

/// Finds where nodes meet a solid, the first of whose nodes is at a place among those of all solids.
fn find_contacts(
    grid: &Grid,
    (solid, told): (&CoupledSolid<'_>, &ClosestParticles),
    first: usize,
    input: &CouplingInput<'_>,
    known: &mut KnownSites,
    contacts: &mut Contacts,
) {
    let inverse = &solid.outline.inverse;
    let (model, mut shares, mut answers) = (inverse.model, vec![], AnswersOfPoint::new(solid));
    for block in told.blocks() {
        let nodes = &grid.nodes[block];
        let faced = FacedBlock {
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
            let Contacts {
                sites,
                all,
                bearers,
                ..
            } = contacts;
            let of_block = known.entry(block).or_insert([None; NODES]);
            let site = *of_block[at].get_or_insert_with(|| {
                sites.push(MetNode {
                    at: [block, at / 4, 4 * (at % 4)],
                    mass,
                    velocity: [velocity; 2],
                });
                sites.len() - 1
            });
            let about = seen.bears(model);
            shares.resize(model.mass.len(), f32::NAN);
            let (from, mut own) = (bearers.len(), inverse.velocity_of(&about));
            let borne = model.borne_by(&about, &mut shares);
            for (slot, share) in &borne {
                let expected = solid.answers().expected[*slot as usize];
                own = along(own, f64::from(*share) * solid.dt, expected);
            }
            let own_answer = answers.find(&borne, first, bearers);
            all.push(NodeContact {
                pair: (solid.object, nodes.field, nodes.index, at),
                site,
                normal,
                target,
                friction: (input.friction)(solid.object, nodes.field),
                velocity: own,
                bears: from..bearers.len(),
                inverse_mass: 1.0 / mass + own_answer,
                normal_impulse: 0.0,
                friction_impulse: [0.0; 3],
                rest: [0.0; 3],
            });
        }
    }
}

/// How nodes of a solid answer impulses on points, one after the other.
struct AnswersOfPoint<'a> {
    solid: &'a CoupledSolid<'a>,
    /// Per node its place among the answers at hand; the largest number where it has none.
    places: Vec<u32>,
    /// Node, its share in the motion of the point, and its velocity per impulse on that [1/kg].
    all: Vec<(usize, f64, f64)>,
}

impl<'a> AnswersOfPoint<'a> {
    fn new(solid: &'a CoupledSolid<'a>) -> Self {
        Self {
            solid,
            places: vec![],
            all: vec![],
        }
    }

    fn add(&mut self, slot: usize, share: f64, answer: f64) {
        let place = &mut self.places[slot];
        if *place == u32::MAX {
            *place = self.all.len() as u32;
            self.all.push((slot, 0.0, 0.0));
        }
        let one = &mut self.all[*place as usize];
        one.1 += share;
        one.2 += answer;
    }

    /// Adds those of a point that nodes bear with these shares to `bearers`, the solid's first node being at a place; returns the point's
    /// own velocity per impulse [1/kg].
    fn find(&mut self, borne: &[(u32, f32)], first: usize, bearers: &mut Vec<Bearer>) -> f64 {
        let solid = self.solid;
        let (model, answers) = (solid.outline.inverse.model, solid.answers());
        self.places.resize(model.mass.len(), u32::MAX);
        for &(slot, share) in borne {
            let (slot, share) = (slot as usize, f64::from(share));
            let own = answers.velocity_per_impulse[slot];
            self.add(slot, share, share * own);
            let inverse = |n: usize| answers.velocity_per_impulse[n];
            for (node, inverse, shared) in model.off_diagonal.moved_by(slot, inverse) {
                self.add(node, 0.0, inverse * (model.dx * shared * share * own));
            }
        }
        let mut own = 0.0;
        for (slot, share, answer) in self.all.drain(..) {
            self.places[slot] = u32::MAX;
            own += share * answer;
            bearers.push(Bearer {
                place: first + slot,
                share,
                answer,
            });
        }
        own
    }
}

impl CoupledSolid<'_> {
    fn answers(&self) -> &Answers {
        self.answers.get_or_init(|| {
            let Outline { inverse, .. } = &self.outline;
            let (state, model) = (inverse.state, inverse.model);
            let mut velocity_per_impulse: Vec<f64> =
                model.mass.iter().map(|mass| mass.recip()).collect();
            for &slot in &self.held {
                velocity_per_impulse[slot] = 0.0;
            }
            let mut expected = vec![self.gravity; model.mass.len()];
            let given = accelerations(model, &velocity_per_impulse, &state.of_matter);
            let loads = state.of_matter.iter().zip(given);
            for (load, given) in loads.filter(|_| state.span > 0.0) {
                let slot = load.slot as usize;
                let now = state.velocity_of(model, slot);
                let all = scaled(sub(now, load.before), 1.0 / state.span);
                let own = sub(all, given);
                expected[slot] = along(load.expected, FRESH, sub(own, load.expected));
            }
            Answers {
                velocity_per_impulse,
                expected,
            }
        })
    }
}

/// Accelerations of nodes by what matter on the grid does to them, in the order of their numbers [m/s^2]; `velocity_per_impulse` is one over
/// the mass of every node [1/kg].
fn accelerations(
    model: &SolidModel,
    velocity_per_impulse: &[f64],
    loads: &[NodeLoad],
) -> Vec<Vec3> {
    let mut all = vec![[0.0; 3]; loads.len()];
    for (n, load) in loads.iter().enumerate() {
        let slot = load.slot as usize;
        let pushed = scaled(load.force, velocity_per_impulse[slot]);
        all[n] = along(all[n], 1.0, pushed);
        let inverse = |n: usize| velocity_per_impulse[n];
        for (node, inverse, shared) in model.off_diagonal.moved_by(slot, inverse) {
            if let Ok(at) = loads.binary_search_by_key(&node, |load| load.slot as usize) {
                all[at] = along(all[at], inverse * (model.dx * shared), pushed);
            }
        }
    }
    all
}
