//! Friction between colliders and objects: of two surfaces that state one the geometric mean, of one alone its own.

use std::borrow::Cow;

use super::{
    Boundaries, NodeConditions, Placed,
    contact::{Contact, coefficient},
    face::Face,
};
use crate::scene::{Aabb, Collider, ColliderShape, Fidelity, Pose, Scene, Surface};

/// What the surfaces of objects state.
#[derive(Clone, Debug, Default)]
pub(crate) struct Frictions {
    /// What all that move state alike; none where they differ.
    shared: Option<f64>,
    /// Per grid field; the shared one where objects share the grid.
    by_field: Vec<Option<f64>>,
    /// Per object.
    by_object: Vec<Option<f64>>,
}

impl Frictions {
    pub fn new(scene: &Scene) -> Self {
        let by_object: Vec<_> = scene.objects.iter().map(|o| o.surface.friction).collect();
        let moving = scene.objects.iter().zip(&by_object);
        let mut moving = moving.filter(|(o, _)| o.fidelity != Fidelity::Static);
        let first = moving.next().and_then(|(_, friction)| *friction);
        let shared = first.filter(|_| moving.all(|(_, friction)| *friction == first));
        Self {
            shared,
            by_field: match scene.contact.method.tells_apart() {
                true => by_object.clone(),
                false => vec![shared; by_object.len()],
            },
            by_object,
        }
    }

    /// Of the matter in a grid field.
    pub fn of_field(&self, field: u32) -> Option<f64> {
        self.by_field
            .get(field as usize)
            .copied()
            .unwrap_or(self.shared)
    }
}

/// The faces of the domain as walls without friction, whatever meets them.
pub(super) fn domain_walls(domain: &Aabb) -> impl Iterator<Item = Collider> {
    let Aabb { min, max } = *domain;
    (0..6).map(move |face| {
        let (axis, sign) = (face / 2, if face % 2 == 0 { 1.0 } else { -1.0 });
        let mut normal = [0.0; 3];
        normal[axis] = sign;
        let corner = if sign > 0.0 { min } else { max };
        let shape = ColliderShape::HalfSpace { normal };
        Collider {
            friction: Some(0.0),
            ..Collider::fixed("domain", shape, Pose::at(corner), Surface::Separate)
        }
    })
}

impl Boundaries {
    /// Coulomb coefficient of a collider against what all objects state alike.
    pub(super) fn shared_friction(&self, stated: Option<f64>) -> f64 {
        coefficient(stated, self.frictions.shared)
    }

    /// What an object's surface states.
    pub fn friction_of(&self, object: usize) -> Option<f64> {
        self.frictions.by_object.get(object).copied().flatten()
    }
}

impl Placed<'_> {
    /// What happens at its surface.
    pub fn contact(&self) -> Contact {
        Contact {
            friction: self.friction,
            ..self.body.contact
        }
    }

    /// The same collider for an object whose surface states this friction.
    pub fn against(self, object: Option<f64>) -> Self {
        Self {
            friction: coefficient(self.body.friction, object),
            ..self
        }
    }
}

impl NodeConditions<'_> {
    /// Makes the colliders those that matter in a field meets.
    pub fn meet(&mut self, field: u32) {
        let friction = self.frictions.and_then(|all| all.of_field(field));
        for body in &mut self.bodies {
            *body = body.against(friction);
        }
    }

    /// Flat boundaries that matter in a field may be attached to.
    pub fn faces_for(&self, field: u32) -> Cow<'_, [Face]> {
        match self.frictions {
            Some(all) if all.of_field(field) != all.shared => {
                let friction = all.of_field(field);
                self.faces
                    .iter()
                    .map(|face| face.against(friction))
                    .collect()
            }
            _ => Cow::Borrowed(&self.faces),
        }
    }
}
