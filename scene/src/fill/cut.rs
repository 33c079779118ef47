//! Surface voxels cut at the mid-surface of the Gaussians.

use glam::Vec3;

use super::{FillReport, classify::Class, grid::Grid, surfels::Surfel};

/// Furthest that orientation looks for a voxel off the surface [voxels].
const LOOK: usize = 10;
/// Standard deviation along the normal that planes are blended with [voxels]: wide enough that every surface
/// voxel sees its own plane, narrow enough that it does not see the other side of a wall.
const BLEND: f32 = 0.7;
/// Sum of weights below which there is no plane to cut with.
const MIN_WEIGHT: f32 = 1e-3;

/// Weighted sums over the planes near one voxel; `d` is the vector from a plane's point to the voxel centre.
#[derive(Clone, Copy, Default)]
struct Planes {
    weight: f32,
    normal: Vec3,
    offset: Vec3,
    /// Sum of `normal . d`.
    height: f32,
}

impl Planes {
    /// Signed distance of the voxel centre from the surface [voxels], positive outside.
    ///
    /// The mean over the distances from the planes errs outwards on a round surface, the distance from the mean
    /// point along the mean normal errs inwards by as much: on a sphere, `(n_i + n_j) . (x_i - x_j) = 0`.
    fn distance(&self) -> Option<f32> {
        let normal = self.normal.try_normalize()?;
        (self.weight > MIN_WEIGHT)
            .then(|| 0.5 * (self.height + normal.dot(self.offset)) / self.weight)
    }
}

/// What of each voxel is filled.
pub struct Cut {
    /// Filled part, 0..=1.
    pub inside: Vec<f32>,
    /// Surface that is not the skin of a solid.
    pub thin: Vec<bool>,
}

/// Cuts the surface voxels by the planes of the Gaussians that part inside from outside.
pub fn cut(grid: &Grid, class: &[Class], mut surfels: Vec<Surfel>, report: &mut FillReport) -> Cut {
    let mut buried = vec![false; grid.len()];
    surfels.retain_mut(|surfel| match orient(grid, class, surfel) {
        Sides::Parted => true,
        Sides::Inside => {
            // Stray Gaussians within a solid; it goes through them.
            let mark = |i: usize, _, _| buried[i] = true;
            report.operations += surfel.visit(grid, surfel.thickness, mark);
            false
        }
        Sides::Other => false,
    });
    report.oriented = surfels.len();
    // Sums are kept only where a plane reaches.
    let mut slot = vec![u32::MAX; grid.len()];
    let mut planes: Vec<Planes> = Vec::new();
    for surfel in &surfels {
        let normal = surfel.normal;
        let opacity = surfel.opacity;
        let thickness = surfel.thickness.max(BLEND);
        report.operations += surfel.visit(grid, thickness, |i, kernel, d| {
            if slot[i] == u32::MAX {
                slot[i] = planes.len() as u32;
                planes.push(Planes::default());
            }
            let sums = &mut planes[slot[i] as usize];
            let weight = opacity * kernel;
            sums.weight += weight;
            sums.normal += normal * weight;
            sums.offset += d * weight;
            sums.height += normal.dot(d) * weight;
        });
    }
    let distance = |i: usize| planes.get(slot[i] as usize)?.distance();
    let mut inside = vec![0.0; grid.len()];
    let mut thin = vec![false; grid.len()];
    for i in 0..grid.len() {
        match (distance(i), class[i]) {
            (Some(distance), _) => inside[i] = (0.5 - distance).clamp(0.0, 1.0),
            (None, Class::Inside) => inside[i] = 1.0,
            (None, Class::Surface) if buried[i] => inside[i] = 1.0,
            (None, Class::Surface) => thin[i] = true,
            (None, Class::Outside) => {}
        }
    }
    Cut { inside, thin }
}

/// What the two faces of a Gaussian look at.
enum Sides {
    /// One at the inside, one at the outside.
    Parted,
    /// Both at the inside.
    Inside,
    /// Anything else: a sheet, or deep in a thick crust.
    Other,
}

/// Turns the normal outwards where that has a meaning.
fn orient(grid: &Grid, class: &[Class], surfel: &mut Surfel) -> Sides {
    let side = |sign: f32| {
        (1..=LOOK).find_map(|step| {
            let p = surfel.center + surfel.normal * (sign * step as f32);
            match grid
                .voxel_at(p.to_array())
                .map_or(Class::Outside, |i| class[i])
            {
                Class::Surface => None,
                class => Some(class),
            }
        })
    };
    match (side(1.0), side(-1.0)) {
        (Some(Class::Outside), Some(Class::Inside)) => Sides::Parted,
        (Some(Class::Inside), Some(Class::Outside)) => {
            surfel.normal = -surfel.normal;
            Sides::Parted
        }
        (Some(Class::Inside), Some(Class::Inside)) => Sides::Inside,
        _ => Sides::Other,
    }
}
