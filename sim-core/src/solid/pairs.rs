//! Solids against each other: surface points of one against the depth in the other, through its local inverse deformation.

use rayon::prelude::*;

use super::{
    advance::Solid,
    contact::{ContactSurface, Spring},
    depth::DepthField,
    grip::Grip,
    inverse::{LocalInverse, SURE, SeenSurface, Start},
    model::Bears,
    search::{Bounds, CandidateList, FoundInCluster, TASK, find_near},
};
use crate::{contact::ledger::Received, mat3::length, simd::fused};

/// Largest depth at which a point may begin to touch [cells]: what is deeper came by way of a false root.
const ENTRY: f64 = 1.0;
/// Share of a surface's springs that each side of a pair has: both press.
const HALF: f64 = 0.5;

/// A solid where it is, as those see it that may be in it.
pub(crate) struct Presence<'a> {
    solid: &'a Solid<'a>,
    inverse: LocalInverse<'a>,
    surface: &'a ContactSurface,
    /// Tangent at rest [Pa].
    modulus: f64,
    /// Box around its points [m].
    bounds: Bounds,
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
    /// Of a solid at present, with the box around its points [m] and where a search begins.
    pub fn new(
        solid: &'a Solid<'a>,
        surface: &'a ContactSurface,
        depth: &'a DepthField,
        (bounds, start): (Bounds, Start),
    ) -> Self {
        Self {
            inverse: LocalInverse::new(solid.model, solid.state, depth, start),
            solid,
            surface,
            modulus: solid.modulus(),
            bounds,
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
        let margin = solid.margin();
        let [min, max] = self.bounds;
        find_near(due, surface.points.len(), margin, |n| {
            fused(|| {
                if solid.state.springs[n].with == number {
                    return 0.0;
                }
                let x = solid.point(surface, n)[0];
                let mut beyond = [0.0; 3];
                for a in 0..3 {
                    beyond[a] = (min[a] - x[a]).max(x[a] - max[a]).max(0.0);
                }
                let beyond = length(beyond);
                match beyond < margin {
                    true => self.inverse.clearance(x),
                    false => beyond,
                }
            })
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
        let way = list.way;
        let points = list.points.par_iter_mut().with_min_len(TASK);
        let watched = points.filter(|watched| watched.until <= way);
        let met = watched.filter_map(|watched| {
            fused(|| {
                let n = watched.point as usize;
                let [x, v] = self.solid.point(self.surface, n);
                let before = self.inverse.state.springs[n];
                let known = before.with == number;
                let before = known.then_some(before);
                let seen = other.inverse.surface(x);
                let clear = seen.map_or(0.0, |seen| SURE * seen.distance.max(0.0));
                watched.until = way + clear;
                let met = seen.and_then(|seen| {
                    self.press(other, n, (&seen, x, v), before, [friction, moved])
                });
                match met {
                    Some(met) => Some(PointContact {
                        grip: Grip {
                            with: number,
                            ..met.grip
                        },
                        ..met
                    }),
                    None => known.then(|| PointContact::none(n, x)),
                }
            })
        });
        met.collect()
    }

    #[inline(always)]
    fn press(
        &self,
        other: &Self,
        n: usize,
        (found, x, v): (&SeenSurface, [f64; 3], [f64; 3]),
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
        let spring = Spring {
            stiffness,
            pressure: stiffness * depth,
            normal,
            most: friction * depth,
        };
        let relative = std::array::from_fn(|a| v[a] - found.sample.v[a]);
        let (force, stretch) = spring.pull(before.map(|grip| grip.stretch), relative, moved);
        Some(PointContact {
            point: n,
            grip: Grip { with: 0, stretch },
            force,
            at: [x, normal],
            pressure: spring.pressure,
            bears: Some(other.inverse.bears(found)),
        })
    }
}
