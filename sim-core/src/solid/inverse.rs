//! The local inverse of a solid's deformation: which material point is at a place, and where the surface is from there.

use super::{
    depth::DepthField,
    model::{Bears, CellPoint, SolidModel},
    search::MARGIN,
    state::{Sample, SolidState},
    surface::bearing,
};
use crate::mat3::{Mat3, length};

/// Steps of Newton's method at most.
const STEPS: usize = 12;
/// Distance from the place at which it ends [cells].
const CLOSE: f64 = 1e-6;
/// The same where it is only asked what is near [cells].
const ROUGH: f64 = 0.05;
/// Share of a distance that is sure: it is one at rest, carried on by the deformation of one place.
pub(crate) const SURE: f64 = 0.7;
/// Volume ratios within which an inverse is trusted.
const TRUSTED: [f64; 2] = [0.1, 4.0];
/// Nodes that a search begins with, at least, where there are as many.
const FITTED: usize = 512;
/// Share of a full node's mass below which the nodes of a cell do not bear by their weights alone.
const LIGHT: f64 = 0.004;

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

/// A material point: where it is at rest [m], its site, and its motion.
type MaterialPoint = ([f64; 3], CellPoint, Sample);

/// Why there is no material point at a place.
enum Missing {
    /// There is no matter near.
    NoMatter,
    /// An inverse is not to be trusted, or was not found.
    Lost,
}

/// The surface of a solid as seen from a place near it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct SeenSurface {
    /// Signed distance, negative inside [m].
    pub distance: f64,
    /// Unit normal outwards.
    pub normal: [f64; 3],
    /// Motion of the material point at the place, or of where matter would go on.
    pub sample: Sample,
    /// Where that is on the grid.
    site: CellPoint,
}

impl LocalInverse<'_> {
    /// Nodes that bear a force at the place of a surface: by their weights, but where some are light. Its moment is exact.
    pub fn bears(&self, seen: &SeenSurface) -> Bears {
        let (model, state) = (self.model, self.state);
        let stencil = model.stencil_at(&seen.site);
        let full = model.full_node_mass;
        if stencil
            .iter()
            .all(|&(slot, _)| model.mass[slot] > LIGHT * full)
        {
            return stencil.map(|(slot, w)| (slot as u32, w as f32));
        }
        let place = |slot| state.position(model, slot);
        bearing(model, &seen.site, seen.sample.x, place)
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
    #[inline(always)]
    pub fn surface(&self, x: [f64; 3]) -> Option<SeenSurface> {
        let (rest, site, sample) = self.material_point(x, CLOSE).ok()?;
        let (distance, slope) = self.depth.at(rest)?;
        let f = Mat3(sample.f);
        let (mut slope, j) = (f.cofactor().mul_vec(slope), f.det());
        for s in &mut slope {
            *s /= j;
        }
        let size = length(slope);
        let distance = distance / size;
        for s in &mut slope {
            *s /= size;
        }
        distance.is_finite().then_some(SeenSurface {
            distance,
            normal: slope,
            sample,
            site,
        })
    }

    /// How far a place is from the solid at least [m]: 0 where that is not known, no more than the margin of searches where it is
    /// farther than cells beside matter.
    #[inline(always)]
    pub fn clearance(&self, x: [f64; 3]) -> f64 {
        match self.material_point(x, ROUGH) {
            Ok((rest, _, sample)) => {
                let f = Mat3(sample.f);
                let Some((distance, slope)) = self.depth.at(rest) else {
                    return MARGIN * self.model.dx;
                };
                let size = length(f.cofactor().mul_vec(slope)) / f.det();
                let distance = distance - ROUGH * self.model.dx * size;
                if distance <= 0.0 {
                    return 0.0;
                }
                SURE * distance / size
            }
            Err(Missing::NoMatter) => MARGIN * self.model.dx,
            Err(Missing::Lost) => 0.0,
        }
    }

    /// The material point at a place [m] now, to some cells.
    #[inline(always)]
    fn material_point(&self, x: [f64; 3], close: f64) -> Result<MaterialPoint, Missing> {
        let Start { centre, back } = &self.start;
        let (mut rest, mut arm) = (centre[1], x);
        for a in 0..3 {
            arm[a] -= centre[0][a];
        }
        let turned = back.mul_vec(arm);
        for a in 0..3 {
            rest[a] += turned[a];
        }
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
            let j = f.det();
            if !(TRUSTED[0]..=TRUSTED[1]).contains(&j) {
                return Err(Missing::Lost);
            }
            if length(off) < close * self.model.dx {
                return Ok((rest, site, sample));
            }
            let step = f.cofactor().transpose().mul_vec(off);
            let longest = (length(step) / (j * self.model.dx)).max(1.0);
            for a in 0..3 {
                rest[a] += step[a] / (j * longest);
            }
        }
        Err(Missing::Lost)
    }
}

impl Start {
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
