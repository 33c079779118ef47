//! Velocity conditions at colliders and pinned regions.

use super::contains;
use crate::scene::{Aabb, ColliderShape, PinnedRegion, Scene, Surface};

/// Distance from a plane or box face below which a node counts as on it [cells]: scene coordinates are rounded,
/// and a face meant to run through nodes shall do so.
const ON_FACE: f64 = 1e-6;

/// Velocity of the node at `x` after every collider, in order, and the pinned regions.
pub(super) fn constrain(scene: &Scene, x: [f64; 3], mut v: [f64; 3]) -> [f64; 3] {
    for collider in &scene.colliders {
        let ColliderShape::HalfSpace { normal } = collider.shape else {
            continue;
        };
        let point = collider.pose.translation;
        let r = std::array::from_fn(|i| x[i] - point[i]);
        if dot(r, normal) < -ON_FACE * scene.dx {
            v = slide(v, normal, collider.surface, collider.friction);
        }
    }
    let pinned = |region: &PinnedRegion| {
        let region = Aabb {
            min: region.bounds.min.map(|x| x - ON_FACE * scene.dx),
            max: region.bounds.max.map(|x| x + ON_FACE * scene.dx),
        };
        contains(&region, x)
    };
    if scene.pinned_regions.iter().any(pinned) {
        v = [0.0; 3];
    }
    v
}

/// Velocity allowed at a surface. Coulomb: the normal velocity change `|v_n|` takes at most `mu_f |v_n|` off the
/// tangential speed, and never turns it round.
fn slide(v: [f64; 3], normal: [f64; 3], surface: Surface, friction: f64) -> [f64; 3] {
    let v_n = dot(v, normal);
    match surface {
        Surface::Sticky => return [0.0; 3],
        Surface::Separate if v_n >= 0.0 => return v,
        Surface::Separate | Surface::Slip => {}
    }
    let v_t: [f64; 3] = std::array::from_fn(|i| v[i] - v_n * normal[i]);
    let speed = dot(v_t, v_t).sqrt();
    let kept = if speed > 0.0 {
        (1.0 - friction * v_n.abs() / speed).max(0.0)
    } else {
        0.0
    };
    v_t.map(|v| kept * v)
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}
