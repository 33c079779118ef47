//! Placement: up axis, size, anchor, rotation, translation, in this order.

use cosplat_sim_core::scene::Aabb;
use glam::{DMat3, DQuat, DVec3, EulerRot};

use super::{
    limits as l,
    reader::Table,
    spec::{Anchor, Axis, Placement, Size},
};

/// Reads the placement keys of a table; what cannot be read is noted and left at its default.
pub(super) fn read(table: &Table) -> Placement {
    let mut placement = Placement::default();
    let up = table.get("up").and_then(|e| {
        e.choice(&[
            ("y", Axis::Y),
            ("+y", Axis::Y),
            ("-y", Axis::NegY),
            ("z", Axis::Z),
            ("+z", Axis::Z),
            ("-z", Axis::NegZ),
            ("x", Axis::X),
            ("+x", Axis::X),
            ("-x", Axis::NegX),
        ])
    });
    placement.up = up.unwrap_or(placement.up);
    let size = match table.one_of(&["scale", "height"]) {
        Some(("scale", entry)) => entry.number(l::SCALE).map(Size::Factor),
        Some((_, entry)) => entry.number(l::LENGTH).map(Size::Height),
        None => None,
    };
    placement.size = size.unwrap_or(placement.size);
    let anchor = table.get("anchor").and_then(|e| {
        e.choice(&[
            ("origin", Anchor::Origin),
            ("center", Anchor::Center),
            ("bottom", Anchor::Bottom),
        ])
    });
    placement.anchor = anchor.unwrap_or(placement.anchor);
    placement.rotation = rotation(table).unwrap_or(placement.rotation);
    let translation = table
        .get("translation")
        .and_then(|e| e.numbers(l::POSITION));
    placement.translation = translation.unwrap_or_default();
    placement
}

/// The rotation keys, `rotation_deg` or `rotation_xyzw`; none when neither is given.
pub(super) fn rotation(table: &Table) -> Option<[f64; 4]> {
    match table.one_of(&["rotation_deg", "rotation_xyzw"]) {
        Some(("rotation_deg", entry)) => entry.numbers(l::ANGLE).map(|degrees| {
            let [x, y, z] = degrees.map(f64::to_radians);
            DQuat::from_euler(EulerRot::XYZEx, x, y, z).to_array()
        }),
        Some((_, entry)) => entry.numbers::<4>(l::DIRECTION).and_then(|q| {
            let q = DQuat::from_array(q);
            if q.length() < 1e-6 {
                entry.error("has no direction, expected a quaternion that is not zero");
                return None;
            }
            Some(q.normalize().to_array())
        }),
        None => None,
    }
}

impl Axis {
    /// Rotation that turns this axis to +y.
    pub fn to_world_up(self) -> DQuat {
        // Columns are the images of x, y, z; exact, where quaternions from angles would leave 1e-17 dust.
        let (x, y, z) = (DVec3::X, DVec3::Y, DVec3::Z);
        let columns = match self {
            Self::Y => (x, y, z),
            Self::NegY => (x, -y, -z),
            Self::Z => (x, -z, y),
            Self::NegZ => (x, z, -y),
            Self::X => (y, -x, z),
            Self::NegX => (-y, x, z),
        };
        DQuat::from_mat3(&DMat3::from_cols(columns.0, columns.1, columns.2))
    }
}

/// Rotation about the origin followed by a translation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rigid {
    /// Rotation.
    pub rotation: DQuat,
    /// Translation [m].
    pub translation: DVec3,
}

impl Rigid {
    /// Where a point lands.
    pub fn point(&self, p: [f64; 3]) -> [f64; 3] {
        (self.rotation * DVec3::from_array(p) + self.translation).to_array()
    }

    /// This motion after another one.
    pub fn after(&self, first: &Self) -> Self {
        Self {
            rotation: (self.rotation * first.rotation).normalize(),
            translation: self.rotation * first.translation + self.translation,
        }
    }
}

impl Placement {
    /// The part after the anchor.
    pub fn rigid(&self) -> Rigid {
        Rigid {
            rotation: DQuat::from_array(self.rotation),
            translation: DVec3::from_array(self.translation),
        }
    }

    /// Whether where geometry lands depends on its box.
    pub(super) fn depends_on_box(&self) -> bool {
        matches!(self.size, Size::Height(_)) || self.anchor != Anchor::Origin
    }

    /// Factor from units to metres for geometry with this box.
    pub fn factor(&self, bounds: &Aabb) -> f64 {
        let height = match self.size {
            Size::Factor(factor) => return factor,
            Size::Height(height) => height,
        };
        let axis = match self.up {
            Axis::X | Axis::NegX => 0,
            Axis::Y | Axis::NegY => 1,
            Axis::Z | Axis::NegZ => 2,
        };
        height / (bounds.max[axis] - bounds.min[axis])
    }

    /// The anchor of geometry with this box, which is turned and scaled already.
    pub fn anchor_of(&self, bounds: &Aabb) -> DVec3 {
        let (min, max) = (DVec3::from(bounds.min), DVec3::from(bounds.max));
        let center = (min + max) * 0.5;
        match self.anchor {
            Anchor::Origin => DVec3::ZERO,
            Anchor::Center => center,
            Anchor::Bottom => DVec3::new(center.x, min.y, center.z),
        }
    }
}
