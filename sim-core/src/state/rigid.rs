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
    /// Whether it has particles, in places, and a rotation.
    pub fn is_sound(&self) -> bool {
        let finite = |x: &[f64; 3]| x.iter().all(|x| x.is_finite());
        let turn = self.body.rotation.iter().map(|x| x * x).sum::<f64>();
        !self.members.is_empty()
            && self.members.iter().all(|member| finite(&member.place))
            && (turn - 1.0).abs() < 1e-6
            && self.own.is_finite()
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
