//! What stands around the objects of a scene: colliders, pinned regions, probes.

use cosplat_sim_core::scene::{Collider, ColliderShape, Probe, ProbeKind, Scene, Surface};
use serde::Serialize;

use super::Extent;

/// A region whose matter is held.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PinnedSummary {
    /// Before it is turned.
    #[serde(flatten)]
    pub extent: Extent,
    /// About its middle, a quaternion `x y z w`.
    pub rotation: [f64; 4],
}

/// A collider.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ColliderSummary {
    /// Name.
    pub name: String,
    /// Kind of shape.
    pub shape: &'static str,
    /// Where its origin is; a point of the surface of a half-space [m].
    pub point: [f64; 3],
    /// Of a half-space.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub normal: Option<[f64; 3]>,
    /// `sticky`, `slip` or `separate`.
    pub surface: &'static str,
    /// That of what meets it when absent.
    pub friction: Option<f64>,
    /// Speed of separation over closing speed.
    pub restitution: f64,
}

pub(super) fn pinned_regions(scene: &Scene) -> Vec<PinnedSummary> {
    let regions = scene.pinned_regions.iter();
    let summary = regions.map(|region| PinnedSummary {
        extent: region.bounds.bounds.into(),
        rotation: region.bounds.rotation,
    });
    summary.collect()
}

pub(super) fn colliders(scene: &Scene) -> Vec<ColliderSummary> {
    let collider = |c: &Collider| ColliderSummary {
        name: c.name.clone(),
        shape: match c.shape {
            ColliderShape::HalfSpace { .. } => "half-space",
            ColliderShape::Box { .. } => "box",
            ColliderShape::Sphere { .. } => "sphere",
            ColliderShape::Cylinder { .. } => "cylinder",
            ColliderShape::Capsule { .. } => "capsule",
            ColliderShape::Mesh(_) => "mesh",
        },
        point: c.pose.translation,
        normal: match c.shape {
            ColliderShape::HalfSpace { normal } => Some(normal),
            _ => None,
        },
        surface: match c.surface {
            Surface::Sticky => "sticky",
            Surface::Slip => "slip",
            Surface::Separate => "separate",
        },
        friction: c.friction,
        restitution: c.restitution,
    };
    scene.colliders.iter().map(collider).collect()
}

pub(super) fn probes(scene: &Scene) -> Vec<String> {
    let name = |object: usize| scene.objects.get(object).map_or("?", |o| o.name.as_str());
    let probe = |p: &Probe| {
        let what = match p.kind {
            ProbeKind::Extent { object, share } if share < 1.0 => {
                format!("extent of {share} of {}", name(object))
            }
            ProbeKind::Extent { object, .. } => format!("extent of {}", name(object)),
            ProbeKind::Point { position } => format!("point {}", vector(position)),
            ProbeKind::Deviation { object, bounds, .. } => match bounds {
                Some(b) => format!(
                    "deviation of {} between {} and {}{}",
                    name(object),
                    vector(b.bounds.min),
                    vector(b.bounds.max),
                    turned(b.rotation)
                ),
                None => format!("deviation of {}", name(object)),
            },
            ProbeKind::MaterialPoint { object, position } => {
                format!("material point of {} at {}", name(object), vector(position))
            }
        };
        format!("{}: {what}", p.name)
    };
    scene.probes.iter().map(probe).collect()
}

/// A vector with five significant digits or so, without the dust of rounding.
pub fn vector(v: [f64; 3]) -> String {
    let number = |x: f64| {
        let rounded = (x * 1e5).round() / 1e5;
        // Also turns -0 to 0.
        format!("{}", rounded + 0.0)
    };
    format!("({})", v.map(number).join(", "))
}

/// How a box is turned about its middle; nothing where it is not.
pub fn turned(rotation: [f64; 4]) -> String {
    let [x, y, z, w] = rotation;
    let sine = (x * x + y * y + z * z).sqrt();
    if sine == 0.0 {
        return String::new();
    }
    let angle = 2.0 * sine.atan2(w).to_degrees();
    let axis = [x, y, z].map(|n| n / sine);
    format!(", turned by {angle:.1} degrees about {}", vector(axis))
}
