//! Objects that are lifted out of the world, and those that stay out of it until they are brought in.

use serde::{Deserialize, Serialize};

use super::rigid::RigidBody;
use crate::solid::state::SolidState;

/// A particle on its way into a body or out of it, in the world [m, s].
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Loose {
    pub id: u32,
    pub x: [f64; 3],
    pub v: [f64; 3],
    pub c: [f64; 9],
    pub visible: [f32; 9],
    pub elastic: [f32; 9],
    pub memory: f32,
}

/// All that there is of an object, at rest.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub(crate) struct Lifted {
    /// Particles that deform, in scene order.
    pub loose: Vec<Loose>,
    /// Its rigid matter.
    pub body: Option<RigidBody>,
    /// Its nodes, where it is a solid on a grid of its own.
    pub solid: Option<SolidState>,
}

impl Lifted {
    /// Its particles, of which `all` belong to the solid.
    pub fn ids(&self, all: std::ops::Range<usize>) -> impl Iterator<Item = u32> {
        let members = self.body.iter().flat_map(|rigid| &rigid.members);
        let of_solid = self.solid.iter().flat_map(move |_| all.clone());
        let loose = self.loose.iter().map(|p| p.id);
        loose
            .chain(members.map(|member| member.id))
            .chain(of_solid.map(|p| p as u32))
    }
}

/// An object that was removed, or that nobody has brought in yet.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct Away {
    pub lifted: Lifted,
    /// Where its centre of mass was [m].
    pub com: [f64; 3],
    /// Its rotation since rest.
    pub rotation: [f64; 4],
}
