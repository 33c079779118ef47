//! Velocity conditions of colliders and pinned regions at grid nodes.

use crate::{
    particles::BLOCK,
    scene::{ColliderShape, Scene, Surface},
};

/// Distance from a plane or box face below which a node counts as on it [cells]: covers the round-off of scene
/// coordinates, so that a face meant to run through nodes does.
const ON_FACE: f64 = 1e-6;

/// Rounds of projection before a node that several planes squeeze is stopped altogether.
const ROUNDS: usize = 8;

/// A half-space in cells.
#[derive(Clone, Debug)]
struct Plane {
    normal: [f64; 3],
    /// `normal . point`.
    offset: f64,
    surface: Surface,
    friction: f64,
}

/// Everything that constrains grid nodes, in grid units.
#[derive(Clone, Debug, Default)]
pub(crate) struct Boundary {
    planes: Vec<Plane>,
    /// Pinned boxes, smallest and largest corner.
    pins: Vec<[[f64; 3]; 2]>,
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

impl Plane {
    /// Signed distance [cells], negative inside.
    fn distance(&self, x: [f64; 3]) -> f64 {
        dot(self.normal, x) - self.offset
    }

    /// Whether a node at `x` is inside.
    fn holds(&self, x: [f64; 3]) -> bool {
        self.distance(x) < -ON_FACE
    }

    /// Coulomb: the normal velocity change `|v_n|` takes at most `mu_f |v_n|` off the tangential speed and never
    /// turns it round.
    fn slide(&self, v: [f64; 3]) -> [f64; 3] {
        let v_n = dot(v, self.normal);
        if self.allows(v_n, 0.0) {
            return v;
        }
        let v_t = self.tangential(v, v_n);
        let speed = dot(v_t, v_t).sqrt();
        let kept = if speed > 0.0 {
            (1.0 - self.friction * v_n.abs() / speed).max(0.0)
        } else {
            0.0
        };
        v_t.map(|v| kept * v)
    }

    fn tangential(&self, v: [f64; 3], v_n: f64) -> [f64; 3] {
        std::array::from_fn(|a| v[a] - v_n * self.normal[a])
    }

    /// Whether the normal velocity `v_n` needs no change, up to `slack`.
    fn allows(&self, v_n: f64, slack: f64) -> bool {
        match self.surface {
            Surface::Sticky => false,
            Surface::Slip => v_n.abs() <= slack,
            Surface::Separate => v_n >= -slack,
        }
    }
}

impl Boundary {
    /// The colliders and pinned regions of a scene.
    pub fn new(scene: &Scene) -> Self {
        let planes = scene
            .colliders
            .iter()
            .filter_map(|collider| {
                let ColliderShape::HalfSpace { normal } = collider.shape else {
                    return None;
                };
                let length = dot(normal, normal).sqrt();
                let normal = normal.map(|n| n / length);
                Some(Plane {
                    normal,
                    offset: dot(normal, collider.pose.translation) / scene.dx,
                    surface: collider.surface,
                    friction: collider.friction,
                })
            })
            .collect();
        let pins = scene
            .pinned_regions
            .iter()
            .map(|region| {
                [
                    region.bounds.min.map(|x| x / scene.dx - ON_FACE),
                    region.bounds.max.map(|x| x / scene.dx + ON_FACE),
                ]
            })
            .collect();
        Self { planes, pins }
    }

    /// Whether any node of a block may be constrained.
    pub fn covers_block(&self, index: [i32; 3]) -> bool {
        let first = index.map(|i| f64::from(BLOCK * i));
        let last = first.map(|x| x + 3.0);
        let lowest = |plane: &Plane| {
            let corner = std::array::from_fn(|a| {
                if plane.normal[a] > 0.0 {
                    first[a]
                } else {
                    last[a]
                }
            });
            plane.holds(corner)
        };
        self.planes.iter().any(lowest)
            || self
                .pins
                .iter()
                .any(|[min, max]| (0..3).all(|a| last[a] >= min[a] && first[a] <= max[a]))
    }

    /// Velocity that a node at `x` [cells] may have when forces alone would give it `v`: every collider in
    /// order with its friction, then projections until all are obeyed at once.
    pub fn constrain(&self, x: [f64; 3], mut v: [f64; 3]) -> [f64; 3] {
        if self
            .pins
            .iter()
            .any(|[min, max]| (0..3).all(|a| (min[a]..=max[a]).contains(&x[a])))
        {
            return [0.0; 3];
        }
        let mut touched = 0;
        for plane in self.planes.iter().filter(|plane| plane.holds(x)) {
            if plane.surface == Surface::Sticky {
                return [0.0; 3];
            }
            v = plane.slide(v);
            touched += 1;
        }
        if touched < 2 {
            return v;
        }
        let slack = 1e-6 * dot(v, v).sqrt();
        for _ in 0..ROUNDS {
            let mut obeyed = true;
            for plane in self.planes.iter().filter(|plane| plane.holds(x)) {
                let v_n = dot(v, plane.normal);
                if !plane.allows(v_n, slack) {
                    v = plane.tangential(v, v_n);
                    obeyed = false;
                }
            }
            if obeyed {
                return v;
            }
        }
        [0.0; 3]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_scenes::{add_plane, empty};

    fn planes(surface: Surface, normals: &[[f64; 3]]) -> Boundary {
        let mut scene = empty(0.1);
        for &normal in normals {
            add_plane(&mut scene, [0.0; 3], normal, surface, 0.5);
        }
        Boundary::new(&scene)
    }

    #[test]
    fn friction_takes_its_share_and_never_reverses() {
        let floor = planes(Surface::Separate, &[[0.0, 0.0, 1.0]]);
        let x = [0.0, 0.0, -1.0];
        let near = |a: [f64; 3], b: [f64; 3]| (0..3).all(|i| (a[i] - b[i]).abs() < 1e-14);
        // The tangential speed 5 loses 0.5 x 2.
        assert!(near(floor.constrain(x, [3.0, 4.0, -2.0]), [2.4, 3.2, 0.0]));
        assert_eq!(floor.constrain(x, [0.3, 0.4, -2.0]), [0.0; 3]);
        assert_eq!(floor.constrain(x, [3.0, 4.0, 2.0]), [3.0, 4.0, 2.0]);
        // On the plane or above it nothing is constrained.
        assert_eq!(floor.constrain([0.0; 3], [0.0, 0.0, -1.0])[2], -1.0);
        let slip = planes(Surface::Slip, &[[0.0, 0.0, 1.0]]);
        assert!(near(slip.constrain(x, [3.0, 4.0, 2.0]), [2.4, 3.2, 0.0]));
    }

    #[test]
    fn a_node_in_a_corner_obeys_every_plane() {
        let (s, c) = 0.3_f64.sin_cos();
        let normals = [[s, 0.0, c], [-s, 0.0, c], [0.0, 1.0, 0.0]];
        let boundary = planes(Surface::Separate, &normals);
        let v = boundary.constrain([0.0, -1.0, -9.0], [1.0, -2.0, -3.0]);
        for normal in normals {
            assert!(dot(v, normal) >= -1e-5, "{v:?} into {normal:?}");
        }
    }

    #[test]
    fn blocks_that_nothing_reaches_are_free() {
        let floor = planes(Surface::Separate, &[[0.0, 0.0, 1.0]]);
        assert!(floor.covers_block([5, 5, -1]));
        assert!(!floor.covers_block([5, 5, 0]));
    }
}
