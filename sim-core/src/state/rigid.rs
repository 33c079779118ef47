//! The rigid matter of one object.

use serde::{Deserialize, Serialize};

use crate::bodies::body::Body;

/// The rigid particles of an object as one body.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct RigidBody {
    pub body: Body,
    /// Inertia per mass beside that of its particles' places [m^2].
    pub own: f64,
    pub members: Vec<Member>,
}

impl RigidBody {
    /// Whether its particles are those of another state of the body, at the same places in it.
    pub(crate) fn has_shape_of(&self, other: &Self) -> bool {
        let place = |member: &Member| (member.id, member.place.map(f64::to_bits));
        let (these, those) = (
            self.members.iter().map(place),
            other.members.iter().map(place),
        );
        self.own.to_bits() == other.own.to_bits() && these.eq(those)
    }
}

/// A particle of a body.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub(crate) struct Member {
    /// Index into the scene's particles.
    pub id: u32,
    /// Place in the body's frame [m].
    pub place: [f64; 3],
    /// Visible and elastic deformation, turned into the body's frame, row-major.
    pub visible: [f32; 9],
    pub elastic: [f32; 9],
    pub memory: f32,
}
