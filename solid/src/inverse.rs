//! The local inverse of a solid's deformation: which material point is at a place, and where the surface is from there.

use super::{
    basis::weights_f64,
    depth::DepthField,
    model::{CellPoint, SolidModel, cell_of_number},
    nodes::{Bears, NodeRow, place, slot},
    state::SolidState,
    surface::SurfacePoint,
};
use crate::mat3::{Mat3, dot, length};

/// Steps of Newton's method at most.
const STEPS: usize = 12;
/// Distance from the place at which the next step is the last [cells]: it ends closer than by half the square of that, which is less than
/// what single precision tells of displacements by tens of cells.
const CLOSE: f64 = 2e-3;
/// Distance from the place at which a place may be told to be outside [cells].
const ROUGH: f64 = 0.1;
/// How many times as far from the surface as it is off it must be for that.
const OUTSIDE: f64 = 3.0;
/// Share of a distance that is sure: it is one at rest, carried on by the deformation of one place.
pub const SURE: f64 = 0.7;
/// Share of a distance at rest that is sure of a place where no matter tells of the deformation.
pub(crate) const HALF_SURE: f64 = 0.5;
/// Volume ratios within which an inverse is trusted.
const TRUSTED: [f64; 2] = [0.1, 4.0];
/// Least cosine between the normal of a surface and the opposite of that of a point which it faces.
pub(crate) const FACING: f64 = 0.5;
/// Shortest way between looks for the surface [pieces of the lattice].
const STRIDE: f64 = 0.25;
/// Nodes that a search begins with, at least, where there are as many.
const FITTED: usize = 512;

/// A solid as what is at a place sees it.
#[derive(Clone, Debug)]
pub struct LocalInverse<'a> {
    /// What never changes of it.
    pub model: &'a SolidModel,
    /// Its nodes.
    pub state: &'a SolidState,
    /// Its nodes, by their numbers.
    rows: &'a [NodeRow],
    depth: &'a DepthField,
    start: Start,
}

/// A material point that a place was near when it was looked at.
#[derive(Clone, Copy, Debug)]
pub struct KnownPlace {
    /// At rest [m], and where that is on the grid.
    rest: [f64; 3],
    site: CellPoint,
    /// Distance from the surface then [m].
    distance: f64,
}

/// What is known of a place: where a search for others near it begins.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Known {
    /// The place [m].
    pub now: [f64; 3],
    /// The material point there [m].
    pub rest: [f64; 3],
    /// Linear map from about that place back to rest.
    pub back: Mat3<f64>,
}

/// Where a search for material points begins.
#[derive(Clone, Copy, Debug)]
pub struct Start {
    /// Centre of mass now and at rest [m].
    pub centre: [[f64; 3]; 2],
    /// Affine map back to rest that fits best.
    back: Mat3<f64>,
}

/// Why there is no material point at a place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Missing {
    /// There is no matter near: its surface is so far away at rest at least [m].
    NoMatter(f64),
    /// An inverse is not to be trusted, or was not found.
    Lost,
}

/// The surface of a solid as seen from a place near it.
#[derive(Clone, Copy, Debug)]
pub struct SeenSurface {
    /// The material point at the place, at rest [m].
    pub rest: [f64; 3],
    /// Signed distance, negative inside [m].
    pub distance: f64,
    /// Unit normal outwards.
    pub normal: [f64; 3],
    /// Change of the depth at rest per way along the normal, 0 to 1: less than 1 amid matter, where the nearest surface is on several sides.
    pub steepness: f64,
    /// Linear map from about the place back to rest.
    pub back: Mat3<f64>,
    /// Where that is on the grid.
    site: CellPoint,
}

impl KnownPlace {
    /// The material point at rest [m].
    pub fn rest(&self) -> [f64; 3] {
        self.rest
    }
}

impl SeenSurface {
    /// Velocity of the material point at the place, or of where matter would go on [m/s].
    pub fn velocity(&self, of: &LocalInverse<'_>) -> [f64; 3] {
        of.velocity_of(&self.bears(of.model))
    }

    /// What is to be known of it later.
    pub fn known(&self) -> KnownPlace {
        KnownPlace {
            rest: self.rest,
            site: self.site,
            distance: self.distance,
        }
    }

    /// Nodes of the solid that bear a force at the place.
    pub fn bears(&self, model: &SolidModel) -> Bears {
        model.bears(&self.site)
    }
}

impl<'a> LocalInverse<'a> {
    /// Of a solid at present, whose nodes `rows` are.
    pub fn new(
        (model, state): (&'a SolidModel, &'a SolidState),
        rows: &'a [NodeRow],
        depth: &'a DepthField,
        start: Start,
    ) -> Self {
        Self {
            model,
            state,
            rows,
            depth,
            start,
        }
    }

    /// Velocity of where nodes with these weights are [m/s].
    #[inline(always)]
    pub fn velocity_of(&self, bears: &Bears) -> [f64; 3] {
        let row: [f32; 8] = NodeRow::about(self.rows, bears);
        let mut v = self.state.velocity;
        for a in 0..3 {
            v[a] += self.model.dx * f64::from(row[3 + a]);
        }
        v
    }

    /// How far a place [m] is from the surface at least, if what was known of it tells that it is outside [m]: it and that material
    /// point have moved apart by little.
    #[inline(always)]
    pub fn clear(&self, x: [f64; 3], known: &KnownPlace) -> Option<f64> {
        let u = self.displacement_alone(&known.site);
        let mut off = x;
        for a in 0..3 {
            off[a] -= known.rest[a] + self.state.shift[a] + self.model.dx * u[a];
        }
        let off = length(off);
        (known.distance > OUTSIDE * off).then_some(SURE * (known.distance - off))
    }

    /// About where a place [m] is at rest [m], from a point of which it is known where it is now and at rest [m].
    pub fn back(&self, x: [f64; 3], [now, rest]: [[f64; 3]; 2]) -> [f64; 3] {
        self.known(now, rest).back_to_rest(x)
    }

    /// What is known of a place from where its material point is at rest alone [m].
    #[inline(always)]
    pub fn known(&self, now: [f64; 3], rest: [f64; 3]) -> Known {
        let back = self.start.back;
        Known { now, rest, back }
    }

    /// Nodes about a site, by their places along each axis.
    #[inline(always)]
    fn about(&self, site: &CellPoint) -> impl Fn([usize; 3]) -> &'a [f32; 8] {
        let blocks = &self.model.point_blocks[site.block as usize].nodes;
        let (cell, rows) = (cell_of_number(site.number), self.rows);
        move |at: [usize; 3]| {
            let [i, j, k]: [usize; 3] = std::array::from_fn(|a| cell[a] + at[a]);
            let block = blocks[4 * (i / 4) + 2 * (j / 4) + k / 4] as usize;
            &rows[slot(block, place(i % 4, j % 4, k % 4))].0
        }
    }

    /// Displacement at a site [cells], summed along z, then y, then x.
    #[inline(always)]
    fn displacement_alone(&self, site: &CellPoint) -> [f64; 3] {
        let (row, [[x, _], [y, _], [z, _]]) = (self.about(site), axes(site));
        let mut sum = [0.0_f32; 4];
        for i in 0..3 {
            let mut plane = [0.0_f32; 4];
            for j in 0..3 {
                let mut line = [0.0_f32; 4];
                for k in 0..3 {
                    let row = row([i, j, k]);
                    for a in 0..4 {
                        line[a] += z[k] * row[a];
                    }
                }
                for a in 0..4 {
                    plane[a] += y[j] * line[a];
                }
            }
            for a in 0..4 {
                sum[a] += x[i] * plane[a];
            }
        }
        [sum[0], sum[1], sum[2]].map(f64::from)
    }

    /// The same, and its slopes along each axis.
    #[inline(always)]
    fn displacement(&self, site: &CellPoint) -> [[f64; 3]; 4] {
        let (row, axes) = (self.about(site), axes(site));
        let mut sums = [[0.0_f32; 4]; 4];
        for x in 0..3 {
            let mut planes = [[0.0_f32; 4]; 3];
            for y in 0..3 {
                let (mut value, mut slope) = ([0.0_f32; 4], [0.0_f32; 4]);
                for z in 0..3 {
                    let row = row([x, y, z]);
                    let [w, g] = axes[2].map(|of| of[z]);
                    for a in 0..4 {
                        value[a] += w * row[a];
                        slope[a] += g * row[a];
                    }
                }
                let [w, g] = axes[1].map(|of| of[y]);
                for a in 0..4 {
                    planes[0][a] += w * value[a];
                    planes[1][a] += g * value[a];
                    planes[2][a] += w * slope[a];
                }
            }
            let [w, g] = axes[0].map(|of| of[x]);
            for a in 0..4 {
                sums[0][a] += w * planes[0][a];
                sums[1][a] += g * planes[0][a];
                sums[2][a] += w * planes[1][a];
                sums[3][a] += w * planes[2][a];
            }
        }
        sums.map(|[x, y, z, _]| [x, y, z].map(f64::from))
    }

    /// The surface as seen from a place [m], searched from what is known of another on, or from all over the solid.
    #[inline(always)]
    pub fn surface(&self, x: [f64; 3], known: Option<Known>) -> Result<SeenSurface, Missing> {
        self.search(x, self.begin(x, known), |_, _| false)
    }

    /// The same of a place that is nearer to it than `most` [m]. Of one that is farther for sure there is a distance that it has at
    /// least.
    #[inline(always)]
    pub fn surface_within(
        &self,
        x: [f64; 3],
        most: f64,
        known: Option<Known>,
    ) -> Result<SeenSurface, Missing> {
        self.search(x, self.begin(x, known), |seen, off| {
            let (is_outside, least) = (seen.distance > OUTSIDE * off, seen.distance - off);
            let is_beyond = is_outside && SURE * least > most;
            if is_beyond {
                seen.distance = least;
            }
            is_beyond
        })
    }

    /// About where a place [m] is at rest [m].
    #[inline(always)]
    fn begin(&self, x: [f64; 3], known: Option<Known>) -> [f64; 3] {
        let [now, rest] = self.start.centre;
        known.unwrap_or(self.known(now, rest)).back_to_rest(x)
    }

    /// The same, searched from a material point [m] on. Of a place that is outside for sure there is a distance that
    /// it has at least.
    #[inline(always)]
    pub fn surface_from(&self, x: [f64; 3], near: [f64; 3]) -> Result<SeenSurface, Missing> {
        self.search(x, near, |seen, off| {
            let is_outside = seen.distance > OUTSIDE * off;
            if is_outside {
                seen.distance -= off;
            }
            is_outside
        })
    }

    /// Unit normal outwards of its own surface at a point of that, where it is now.
    pub fn normal_now(&self, point: &SurfacePoint) -> Option<[f64; 3]> {
        let site = self.model.site_near(point.x)?;
        unit(self.cofactor(&site).0.mul_vec(point.normal))
    }

    /// Depth under the surface that a point inside with unit normal `own` faces, and the normal of that, where it is less than `most` [m]:
    /// what is met against `own`, by the deformation of one place.
    pub fn faced(&self, seen: &SeenSurface, own: [f64; 3], most: f64) -> Option<(f64, [f64; 3])> {
        let (cofactor, j) = self.cofactor(&seen.site);
        let way = cofactor.transpose().mul_vec(own).map(|w| -w / j);
        let (speed, least) = (length(way), STRIDE * self.depth.edge());
        let (mut at, mut before) = (0.0, seen.distance);
        // What faces obliquely is nearer than the way to it.
        while at < most / FACING {
            let next = at + (SURE * -before).max(least) / speed;
            let mut rest = seen.rest;
            for a in 0..3 {
                rest[a] += next * way[a];
            }
            let (value, slope) = self.depth.at(rest)?;
            if value >= 0.0 {
                let normal = unit(cofactor.mul_vec(slope))?;
                let facing = -dot(normal, own);
                let depth = facing * (at + (next - at) * before / (before - value));
                return (facing > FACING && depth < most).then_some((depth, normal));
            }
            (at, before) = (next, value);
        }
        None
    }

    /// Cofactor and determinant of the deformation gradient at a site.
    fn cofactor(&self, site: &CellPoint) -> (Mat3<f64>, f64) {
        let displacement = self.displacement(site);
        let f = Mat3(self.state.sample_of(self.model, site, &displacement).f);
        (f.cofactor(), f.det())
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
                let far = self.depth.at(rest).map(|(distance, _)| distance);
                return Err(Missing::NoMatter(far.unwrap_or(self.depth.far())));
            };
            let displacement = self.displacement(&site);
            let sample = self.state.sample_of(self.model, &site, &displacement);
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
            let is_last = far < CLOSE * self.model.dx;
            if !is_last
                && far < ROUGH * self.model.dx
                && let Ok(mut seen) = self.seen(rest, site, (&cofactor, j))
                && enough(&mut seen, far)
            {
                return Ok(seen);
            }
            let step = cofactor.transpose().mul_vec(off);
            let longest = (length(step) / (j * self.model.dx)).max(1.0);
            for a in 0..3 {
                rest[a] += step[a] / (j * longest);
            }
            if is_last {
                let site = self.model.site_near(rest).unwrap_or(site);
                return self.seen(rest, site, (&cofactor, j));
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
        let depth = self.depth.at(rest);
        let (distance, slope) = depth.ok_or(Missing::NoMatter(self.depth.far()))?;
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
                back: Mat3(cofactor.transpose().0.map(|row| row.map(|v| v / j))),
                site,
            }),
            false => Err(Missing::Lost),
        }
    }
}

/// Weights of the nodes about a site along each axis, and their slopes.
#[inline(always)]
fn axes(site: &CellPoint) -> [[[f32; 3]; 2]; 3] {
    site.d.map(|d| {
        let (w, g) = weights_f64(d);
        [w.map(|w| w as f32), g.map(|g| g as f32)]
    })
}

/// A vector of length 1; none of none.
fn unit(v: [f64; 3]) -> Option<[f64; 3]> {
    let size = length(v);
    (size > 0.0 && size.is_finite()).then(|| v.map(|v| v / size))
}

impl Known {
    /// About where a place near it is at rest [m].
    #[inline(always)]
    fn back_to_rest(&self, x: [f64; 3]) -> [f64; 3] {
        let (mut arm, mut rest) = (x, self.rest);
        for a in 0..3 {
            arm[a] -= self.now[a];
        }
        let turned = self.back.mul_vec(arm);
        for a in 0..3 {
            rest[a] += turned[a];
        }
        rest
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
