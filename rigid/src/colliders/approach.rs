//! How near matter has come to a collider, and how much farther a grid node may carry it.
//!
//! A node inside a collider that stopped all that moves inwards would stop matter up to a cell and a half too early, or,
//! where the surface runs through nodes, let it sink in, so that heights of rest would depend on the place of the grid.
//! Instead a node lets matter go on until the outermost of the particles that reach it touches the surface: until it
//! is as far from it as half the spacing of particles. Nodes up to `BAND` in front of the surface stop what touches,
//! those farther out only what is too deep (`STEEPNESS`).

use super::{ON_FACE, Placed, contact::Contact, shape::Shape};
use crate::{
    mat3::dot,
    scene::{Pose, Surface},
};

/// How far in front of the surface nodes stop matter that touches it [cells]. With it the last node that stops is
/// between 0.5 cells below and 0.5 above the centres of the particles that touch (8 per cell).
const BAND: f64 = 0.25;
/// Depth of matter per distance of a node in front of the band, from which on that node stops it too: matter that
/// flows, and resists no deformation, could otherwise sink between the nodes that stop and those that do not.
const STEEPNESS: f64 = 0.1;
/// Particles farther away than this cannot touch within a substep, however fast both sides move [cells].
pub const RANGE: f64 = 1.0;
/// Largest radius of a particle [cells].
pub const RADIUS_MAX: f64 = 0.5;
/// Gap up to which nodes in front of a surface that holds on to matter do so [cells].
pub(super) const TOUCHING: f64 = 0.1;
/// Smallest cosine between the normals at particle and node: matter on the top of a box does not touch its side.
const FACING: f64 = 0.7;

/// The nearest to a collider of the particles that reach a node.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GapSample {
    /// Its distance, less half the spacing of particles; negative when it is too deep [units].
    pub gap: f32,
    /// Normal of the collider there.
    pub normal: [f32; 3],
}

impl GapSample {
    /// No particle in range.
    pub const NONE: Self = Self {
        gap: f32::INFINITY,
        normal: [0.0; 3],
    };

    /// Keeps the nearer one, the earlier of two that are equally near.
    pub fn take(&mut self, other: &Self) {
        if other.gap < self.gap {
            *self = *other;
        }
    }
}

/// What a collider does at a node.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Reaction {
    pub contact: Contact,
    pub normal: [f64; 3],
    /// How much farther matter may go against the normal [units].
    pub clearance: f64,
    /// Point of the surface that is nearest to the node [units].
    pub point: [f64; 3],
}

/// Half the spacing of particles of a rest volume, as far as it counts.
pub fn half_spacing(volume: f64, cell: f64) -> f64 {
    (0.5 * volume.cbrt()).min(RADIUS_MAX * cell)
}

impl Placed<'_> {
    /// A particle of this rest volume at `x` as nodes see it, when it is in range; `cell` is the cell size.
    pub fn nearest(&self, x: [f64; 3], volume: f64, cell: f64) -> Option<GapSample> {
        self.nearest_of(x, half_spacing(volume, cell), cell)
    }

    /// The same for a particle of this `half_spacing`.
    pub fn nearest_of(&self, x: [f64; 3], half_spacing: f64, cell: f64) -> Option<GapSample> {
        let found = self.distance(x);
        if found.value >= (RANGE + RADIUS_MAX) * cell {
            return None;
        }
        let gap = found.value - half_spacing;
        (gap < RANGE * cell).then(|| GapSample {
            gap: gap as f32,
            normal: found.normal.map(|n| n as f32),
        })
    }

    /// Normal of a half-space.
    pub fn flat_normal(&self) -> Option<[f64; 3]> {
        let is_flat = matches!(self.body.shape, Shape::HalfSpace { .. });
        is_flat.then(|| self.distance(self.start.translation).normal)
    }

    /// Signed distances of points, given axis by axis, from a half-space that is not turned, as `distance`
    /// has them, but many at once; none for other colliders.
    #[inline(always)]
    pub fn heights<const N: usize>(&self, x: &[[f64; N]; 3]) -> Option<[f64; N]> {
        let Shape::HalfSpace { normal } = self.body.shape else {
            return None;
        };
        let at = self.start.translation;
        if self.start.rotation != Pose::IDENTITY.rotation {
            return None;
        }
        let mut heights = [0.0; N];
        for n in 0..N {
            heights[n] = (x[0][n] - at[0]) * normal[0]
                + (x[1][n] - at[1]) * normal[1]
                + (x[2][n] - at[2]) * normal[2];
        }
        Some(heights)
    }

    /// What happens at a node at `x` that `nearest` reaches; none when nothing does.
    pub(super) fn reaction(&self, x: [f64; 3], nearest: &GapSample, cell: f64) -> Option<Reaction> {
        let found = self.distance(x);
        let mut reaction = Reaction {
            contact: self.contact(),
            normal: found.normal,
            clearance: f64::INFINITY,
            point: std::array::from_fn(|a| x[a] - found.value * found.normal[a]),
        };
        let gap = f64::from(nearest.gap);
        let normal = nearest.normal.map(f64::from);
        let faces = dot(normal, found.normal) > FACING;
        if found.value < -ON_FACE * cell {
            if gap < RANGE * cell {
                reaction.clearance = gap.max(0.0);
                if !faces {
                    reaction.normal = normal;
                }
            } else if self.body.contact.surface == Surface::Separate {
                return None;
            }
            return Some(reaction);
        }
        let beyond = (found.value - BAND * cell).max(0.0);
        reaction.clearance = (gap + STEEPNESS * beyond).max(0.0);
        if beyond > 0.0 || gap > TOUCHING * cell {
            reaction.contact.surface = Surface::Separate;
        }
        (faces && reaction.clearance < RANGE * cell).then_some(reaction)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        colliders::{Boundaries, Substep},
        scene::ColliderShape,
        test_scenes::{add_collider, empty},
    };

    /// What a collider at the origin, with the cell as unit, does at a node at `x`.
    fn at(
        shape: ColliderShape,
        surface: Surface,
        x: [f64; 3],
        particle: [f64; 3],
    ) -> Option<Reaction> {
        let mut scene = empty(1.0);
        add_collider(&mut scene, shape, surface);
        let boundaries = Boundaries::new(&scene, 1.0);
        let now = Substep {
            time: 0.0,
            dt: 1e-3,
            kick: 1e-3,
            frame_start: 0.0,
            frame_length: 1.0,
        };
        let conditions = boundaries.on_nodes(&vec![], &now);
        let body = &conditions.bodies()[0];
        let nearest = body
            .nearest(particle, 0.125, 1.0)
            .unwrap_or(GapSample::NONE);
        body.reaction(x, &nearest, 1.0)
    }

    fn floor() -> ColliderShape {
        let normal = [0.0, 0.0, 1.0];
        ColliderShape::HalfSpace { normal }
    }

    #[test]
    fn matter_may_go_on_until_it_touches() {
        let clearance = |x: f64, particle: f64| {
            let (x, particle) = ([0.0, 0.0, x], [0.3, 0.2, particle]);
            at(floor(), Surface::Separate, x, particle).map(|reaction| reaction.clearance)
        };
        // Eight per cell: half their spacing is a quarter of a cell.
        assert_eq!(clearance(-0.5, 0.75), Some(0.5));
        assert_eq!(clearance(0.2, 0.75), Some(0.5));
        assert_eq!(clearance(-0.5, 0.25), Some(0.0));
        assert_eq!(clearance(-0.5, 1.5), None);
        // Nodes farther out stop what is too deep.
        let outside = clearance(0.75, 0.25).expect("it touches");
        assert!((outside - 0.05).abs() < 1e-7, "{outside}");
        assert_eq!(clearance(0.75, 0.15), Some(0.0));
    }

    #[test]
    fn what_lies_on_a_box_does_not_touch_its_side() {
        let cube = || ColliderShape::Box {
            half_extents: [3.0; 3],
        };
        let top = [2.9, 0.0, 3.25];
        let beside = at(cube(), Surface::Separate, [3.1, 0.0, 2.2], top);
        assert_eq!(beside, None);
        let inside = at(cube(), Surface::Separate, [2.9, 0.0, 2.2], top);
        assert_eq!(inside.expect("inside").normal, [0.0, 0.0, 1.0]);
    }

    #[test]
    fn a_surface_that_holds_does_so_inside_and_where_it_is_touched() {
        let of = |surface, x: f64, particle: f64| {
            let reaction = at(floor(), surface, [0.0, 0.0, x], [0.0, 0.0, particle]);
            reaction.map(|reaction| reaction.contact.surface)
        };
        for surface in [Surface::Sticky, Surface::Slip] {
            assert_eq!(of(surface, -0.2, 9.0), Some(surface));
            assert_eq!(of(surface, 0.2, 0.3), Some(surface));
            assert_eq!(of(surface, 0.2, 0.7), Some(Surface::Separate));
            assert_eq!(of(surface, 0.2, 9.0), None);
        }
    }
}
