//! Solids against each other: surface points of one against the depth in the other, through its local inverse deformation.

use rayon::prelude::*;

use super::{
    advance::Solid,
    contact::{ContactSurface, Spring},
    depth::DepthField,
    grip::Grip,
    inverse::{LocalInverse, Missing, SURE, SeenSurface, Start},
    model::Bears,
    search::{Bounds, Candidate, CandidateList, FoundInCluster, TASK, find_near, squared_distance},
};
use crate::contact::ledger::Received;

/// Largest depth at which a point may begin to touch [cells]: what is deeper came by way of a false root.
const ENTRY: f64 = 1.0;
/// How far a place of a surface may be from the boxes around its points [cells]: they are half a cell apart at rest.
const COVER: f64 = 0.5;
/// Share of a surface's springs that each side of a pair has: both press.
const HALF: f64 = 0.5;

/// A solid where it is, as those see it that may be in it.
pub(crate) struct Presence<'a> {
    solid: &'a Solid<'a>,
    inverse: LocalInverse<'a>,
    surface: &'a ContactSurface,
    /// Tangent at rest [Pa].
    modulus: f64,
}

/// A point of one solid that another presses on.
pub(crate) struct PointContact {
    pub point: usize,
    pub grip: Grip,
    /// Force on the point [N]; its opposite is on the other's nodes.
    pub force: [f64; 3],
    /// Where, and the normal out of the other.
    pub at: [[f64; 3]; 2],
    pub pressure: f64,
    /// The other's nodes that bear it.
    pub bears: Option<Bears>,
}

impl PointContact {
    /// A point at `x` [m] that lets go.
    pub fn none(point: usize, x: [f64; 3]) -> Self {
        Self {
            point,
            grip: Grip::NONE,
            force: [0.0; 3],
            at: [x, [0.0; 3]],
            pressure: 0.0,
            bears: None,
        }
    }

    /// What its owner receives of forces that act for `kick` [s].
    pub fn received(&self, kick: f64) -> Received {
        let [at, normal] = self.at;
        Received::at(
            at,
            normal,
            kick * self.pressure,
            self.force.map(|f| kick * f),
        )
    }
}

impl<'a> Presence<'a> {
    /// Of a solid at present, after a look at where its clusters are, and where a search begins.
    pub fn new(
        solid: &'a Solid<'a>,
        surface: &'a ContactSurface,
        depth: &'a DepthField,
        start: Start,
    ) -> Self {
        Self {
            inverse: LocalInverse::new(solid.model, solid.state, depth, start),
            solid,
            surface,
            modulus: solid.modulus(),
        }
    }

    /// Points of the clusters of a surface that are due which may soon touch this one, or do by a grip that `number` tells.
    pub fn near(
        &self,
        solid: &Solid<'_>,
        surface: &ContactSurface,
        number: u32,
        due: &[usize],
    ) -> Vec<FoundInCluster> {
        let boxes: Vec<Bounds> = self.solid.scratch.search.grown().collect();
        find_near(due, |cluster| {
            self.find(solid, surface, number, &boxes, cluster)
        })
    }

    /// Points of a cluster that may soon touch this one, or do; boxes are around this one's clusters, in its frame.
    fn find(
        &self,
        solid: &Solid<'_>,
        surface: &ContactSurface,
        number: u32,
        boxes: &[Bounds],
        cluster: usize,
    ) -> FoundInCluster {
        let (cover, shift) = (COVER * self.inverse.model.dx, self.solid.state.shift);
        let (centre, radius) = solid.ball(cluster);
        let mut off = centre;
        for a in 0..3 {
            off[a] -= shift[a];
        }
        let reach = radius + solid.margin() + cover;
        let (mut near, mut least) = (vec![], f64::INFINITY);
        for bounds in boxes {
            let beyond = squared_distance(bounds, off);
            least = least.min(beyond);
            if beyond < reach * reach {
                near.push(bounds);
            }
        }
        let least = least.sqrt();
        let holds = |grip: &Grip| grip.with == number;
        let points = &surface.clusters[cluster].points;
        let is_far = least - cover - radius >= solid.margin();
        if is_far && !solid.state.springs[points.clone()].iter().any(holds) {
            return FoundInCluster::none(least - cover - radius);
        }
        FoundInCluster::of(points.clone(), solid.margin(), |n| {
            if holds(&solid.state.springs[n]) {
                return 0.0;
            }
            let mut off = solid.place(surface, n);
            for a in 0..3 {
                off[a] -= shift[a];
            }
            // What is not near is farther than the margin from all points.
            let mut least = (solid.margin() + cover).powi(2);
            for bounds in &near {
                least = least.min(squared_distance(bounds, off));
            }
            least.sqrt() - cover
        })
    }

    /// What the other presses on points of this one with, `moved` [s] since they were looked at, by Coulomb's law; `number`
    /// tells the other's springs.
    pub fn pressed_by(
        &self,
        other: &Self,
        list: &mut CandidateList,
        [friction, moved]: [f64; 2],
        number: u32,
    ) -> Vec<PointContact> {
        let (way, own) = (list.way, &self.solid.scratch.search.own);
        let points = list.points.par_iter_mut().with_min_len(TASK);
        let met = points.filter_map(|watched| {
            let way = way + own[watched.cluster()];
            if watched.until > way {
                return None;
            }
            let (clear, met) = self.meet(other, watched, [friction, moved], number);
            watched.until = way + clear;
            met
        });
        met.collect()
    }

    /// How far a point is from the other at least [m], and what that presses on it with, or that it lets go.
    fn meet(
        &self,
        other: &Self,
        watched: &mut Candidate,
        [friction, moved]: [f64; 2],
        number: u32,
    ) -> (f64, Option<PointContact>) {
        let n = watched.point as usize;
        let x = self.solid.place(self.surface, n);
        let before = self.inverse.state.springs[n];
        let before = (before.with == number).then_some(before);
        let mut seen = Err(Missing::Lost);
        for near in [watched.rest, None] {
            seen = other.inverse.surface_from(x, near);
            if seen.is_ok() || near.is_none() {
                break;
            }
        }
        watched.rest = seen.ok().map(|seen| seen.rest);
        let clear = match &seen {
            Ok(seen) => SURE * seen.distance.max(0.0),
            // It is farther than cells beside matter.
            Err(Missing::NoMatter) => self.solid.margin(),
            Err(Missing::Lost) => 0.0,
        };
        let met = seen
            .ok()
            .and_then(|seen| self.press(other, n, (&seen, x), before, [friction, moved]));
        let met = match met {
            Some(met) => Some(PointContact {
                grip: Grip {
                    with: number,
                    ..met.grip
                },
                ..met
            }),
            None => before.map(|_| PointContact::none(n, x)),
        };
        (clear, met)
    }

    fn press(
        &self,
        other: &Self,
        n: usize,
        (found, x): (&SeenSurface, [f64; 3]),
        before: Option<Grip>,
        [friction, moved]: [f64; 2],
    ) -> Option<PointContact> {
        if found.distance >= 0.0 {
            return None;
        }
        let (depth, normal) = (-found.distance, found.normal);
        if before.is_none() && depth > ENTRY * other.inverse.model.dx {
            return None;
        }
        let stiffness = HALF * self.modulus.min(other.modulus) * self.surface.stiffness[n];
        // The force is the slope of a potential, of half the squared depth: amid matter, where the depth is at its largest, it ends.
        let effective_depth = depth * found.steepness;
        let spring = Spring {
            stiffness,
            depth,
            pressure: stiffness * effective_depth,
            normal,
            most: friction * effective_depth,
        };
        let (v, u) = (
            self.solid.velocity(self.surface, n),
            found.velocity(&other.inverse),
        );
        let relative = std::array::from_fn(|a| v[a] - u[a]);
        let (force, stretch) = spring.pull(before.map(|grip| grip.stretch), relative, moved);
        Some(PointContact {
            point: n,
            grip: Grip {
                with: 0,
                stretch,
                energy: spring.energy(stretch),
            },
            force,
            at: [x, normal],
            pressure: spring.pressure,
            bears: Some(found.bears(other.inverse.model)),
        })
    }
}
