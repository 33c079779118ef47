//! The local inverse of a solid's deformation: which material point is at a place, and where the surface is from there.

use super::{
    depth::DepthField,
    model::{Bears, CellPoint, SolidModel},
    state::SolidState,
};
use crate::mat3::{Mat3, length};

/// Steps of Newton's method at most.
const STEPS: usize = 12;
/// Distance from the place at which it ends [cells].
const CLOSE: f64 = 1e-6;
/// Distance from the place at which a place may be told to be outside [cells].
const ROUGH: f64 = 0.1;
/// How many times as far from the surface as it is off it must be for that.
const OUTSIDE: f64 = 3.0;
/// Share of a distance that is sure: it is one at rest, carried on by the deformation of one place.
pub(crate) const SURE: f64 = 0.7;
/// Volume ratios within which an inverse is trusted.
const TRUSTED: [f64; 2] = [0.1, 4.0];
/// Nodes that a search begins with, at least, where there are as many.
const FITTED: usize = 512;

/// A solid as what is at a place sees it.
#[derive(Clone, Debug)]
pub(crate) struct LocalInverse<'a> {
    pub model: &'a SolidModel,
    pub state: &'a SolidState,
    depth: &'a DepthField,
    start: Start,
}

/// Where a search for material points begins.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Start {
    /// Centre of mass now and at rest [m].
    pub centre: [[f64; 3]; 2],
    /// Affine map back to rest that fits best.
    back: Mat3<f64>,
}

/// Why there is no material point at a place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Missing {
    /// There is no matter near.
    NoMatter,
    /// An inverse is not to be trusted, or was not found.
    Lost,
}

/// The surface of a solid as seen from a place near it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct SeenSurface {
    /// The material point at the place, at rest [m].
    pub rest: [f64; 3],
    /// Signed distance, negative inside [m].
    pub distance: f64,
    /// Unit normal outwards.
    pub normal: [f64; 3],
    /// Change of the depth at rest per way along the normal, 0 to 1: less than 1 amid matter, where the nearest surface is on several sides.
    pub steepness: f64,
    /// Where that is on the grid.
    site: CellPoint,
}

impl SeenSurface {
    /// Velocity of the material point at the place, or of where matter would go on [m/s].
    pub fn velocity(&self, of: &LocalInverse<'_>) -> [f64; 3] {
        of.state.velocity_at(of.model, &self.site).0
    }

    /// Nodes of the solid that bear a force at the place.
    pub fn bears(&self, model: &SolidModel) -> Bears {
        model.bears(&self.site)
    }
}

impl<'a> LocalInverse<'a> {
    /// Of a solid at present.
    pub fn new(
        model: &'a SolidModel,
        state: &'a SolidState,
        depth: &'a DepthField,
        start: Start,
    ) -> Self {
        Self {
            model,
            state,
            depth,
            start,
        }
    }

    /// The surface as seen from a place [m]; none where it is far, or where the inverse is not to be trusted.
    pub fn surface(&self, x: [f64; 3]) -> Option<SeenSurface> {
        self.search(x, self.start.back(x), |_, _| false).ok()
    }

    /// The same, searched from near a material point [m] if one is known. Of a place that is outside for sure there is a distance that
    /// it has at least.
    #[inline(always)]
    pub fn surface_from(
        &self,
        x: [f64; 3],
        near: Option<[f64; 3]>,
    ) -> Result<SeenSurface, Missing> {
        let near = near.unwrap_or_else(|| self.start.back(x));
        self.search(x, near, |seen, off| {
            let is_outside = seen.distance > OUTSIDE * off;
            if is_outside {
                seen.distance -= off;
            }
            is_outside
        })
    }

    /// Newton's method from a material point on, which ends close to the place [m], or where `enough` says so of what is seen from
    /// roughly there, so far off [m].
    #[inline(always)]
    fn search(
        &self,
        x: [f64; 3],
        mut rest: [f64; 3],
        enough: impl Fn(&mut SeenSurface, f64) -> bool,
    ) -> Result<SeenSurface, Missing> {
        for _ in 0..STEPS {
            let Some(site) = self.model.site_near(rest) else {
                return Err(Missing::NoMatter);
            };
            let sample = self.state.sample(self.model, &site);
            let mut off = x;
            for a in 0..3 {
                off[a] -= sample.x[a];
            }
            let f = Mat3(sample.f);
            let (cofactor, j) = (f.cofactor(), f.det());
            if !(TRUSTED[0]..=TRUSTED[1]).contains(&j) {
                return Err(Missing::Lost);
            }
            let far = length(off);
            let is_close = far < CLOSE * self.model.dx;
            if is_close || far < ROUGH * self.model.dx {
                let mut seen = self.seen(rest, site, (&cofactor, j));
                if is_close {
                    return seen;
                }
                if let Ok(seen) = &mut seen
                    && enough(seen, far)
                {
                    return Ok(*seen);
                }
            }
            let step = cofactor.transpose().mul_vec(off);
            let longest = (length(step) / (j * self.model.dx)).max(1.0);
            for a in 0..3 {
                rest[a] += step[a] / (j * longest);
            }
        }
        Err(Missing::Lost)
    }

    /// The surface as seen from a material point, with the cofactor and determinant of its deformation gradient.
    #[inline(always)]
    fn seen(
        &self,
        rest: [f64; 3],
        site: CellPoint,
        (cofactor, j): (&Mat3<f64>, f64),
    ) -> Result<SeenSurface, Missing> {
        let (distance, slope) = self.depth.at(rest).ok_or(Missing::NoMatter)?;
        let steepness = length(slope);
        let mut normal = cofactor.mul_vec(slope);
        for n in &mut normal {
            *n /= j * steepness;
        }
        let size = length(normal);
        let distance = distance / size;
        for n in &mut normal {
            *n /= size;
        }
        match distance.is_finite() {
            true => Ok(SeenSurface {
                rest,
                distance,
                normal,
                steepness: steepness.min(1.0),
                site,
            }),
            false => Err(Missing::Lost),
        }
    }
}

impl Start {
    /// About where a place [m] is at rest [m].
    #[inline(always)]
    fn back(&self, x: [f64; 3]) -> [f64; 3] {
        let (mut rest, mut arm) = (self.centre[1], x);
        for a in 0..3 {
            arm[a] -= self.centre[0][a];
        }
        let turned = self.back.mul_vec(arm);
        for a in 0..3 {
            rest[a] += turned[a];
        }
        rest
    }

    /// Of a solid at present.
    pub fn of(model: &SolidModel, state: &SolidState) -> Self {
        let (centre, back) = affine(model, state);
        Self { centre, back }
    }
}

/// Centre of mass now and at rest, and the affine map back to rest that fits best: of nodes all over the solid, as many as tell.
fn affine(model: &SolidModel, state: &SolidState) -> ([[f64; 3]; 2], Mat3<f64>) {
    // Odd, so that nodes are of all rows of their blocks.
    let stride = (model.mass.len() / FITTED) | 1;
    let nodes = (0..model.mass.len()).step_by(stride);
    let nodes: Vec<(f64, [f64; 3], [f64; 3])> = nodes
        .filter(|&slot| model.mass[slot] > 0.0)
        .map(|slot| {
            let (x, r) = (state.position(model, slot), model.node_in_world(slot));
            (model.mass[slot], x, r)
        })
        .collect();
    let total: f64 = nodes.iter().map(|node| node.0).sum();
    let (mut now, mut rest) = ([0.0; 3], [0.0; 3]);
    for (m, x, r) in &nodes {
        for a in 0..3 {
            now[a] += m / total * x[a];
            rest[a] += m / total * r[a];
        }
    }
    let (mut mixed, mut own) = (Mat3([[0.0; 3]; 3]), Mat3([[0.0; 3]; 3]));
    for (m, x, r) in &nodes {
        for i in 0..3 {
            for j in 0..3 {
                mixed.0[i][j] += m * (x[i] - now[i]) * (r[j] - rest[j]);
                own.0[i][j] += m * (r[i] - rest[i]) * (r[j] - rest[j]);
            }
        }
    }
    // F = mixed own^-1, so its inverse is own mixed^-1.
    let det = mixed.det();
    let inverse = mixed.cofactor().transpose();
    let inverse = Mat3(inverse.0.map(|row| row.map(|v| v / det)));
    ([now, rest], own.mul(&inverse))
}
