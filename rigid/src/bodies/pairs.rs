//! Pairs that meet: what happens at their surface, and what one of them received.

use super::actor::Setting;
use crate::{colliders::Placed, ledger::Received, scene};

/// The impulse that a body received at a contact.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ExchangedImpulse {
    /// The body.
    pub body: usize,
    /// The other side.
    pub other: Partner,
    /// Point, normal and impulse.
    pub received: Received,
}

/// The other side of a contact.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Partner {
    /// Another body.
    Body(usize),
    /// A collider, by its number in the scene.
    Wall(usize),
}

/// What happens at the surface of a pair.
#[derive(Clone, Copy)]
pub(super) struct SurfaceOfPair {
    pub restitution: f64,
    pub friction: f64,
    /// Whether it holds what would leave.
    pub holds: bool,
    /// Whether it holds what would slide.
    pub sticks: bool,
}

/// Surface of a pair by its places among bodies and colliders.
pub(super) fn surface_of(
    bodies: usize,
    walls: &[Placed<'_>],
    [a, b]: [u32; 2],
    setting: &Setting<'_>,
) -> SurfaceOfPair {
    let (a, b) = (a as usize, b as usize);
    let Some(wall) = b.checked_sub(bodies) else {
        let (restitution, friction) = (setting.surface)(a, b);
        return SurfaceOfPair {
            restitution,
            friction,
            holds: false,
            sticks: false,
        };
    };
    let contact = walls[wall].against((setting.friction)(a)).contact();
    let sticks = contact.surface == scene::Surface::Sticky;
    let holds = contact.surface != scene::Surface::Separate;
    SurfaceOfPair {
        restitution: if holds { 0.0 } else { contact.restitution },
        friction: contact.friction,
        holds,
        sticks,
    }
}

/// What is meant by a place among bodies and colliders.
pub(super) fn partner(bodies: usize, walls: &[Placed<'_>], n: u32) -> Partner {
    match (n as usize).checked_sub(bodies) {
        None => Partner::Body(n as usize),
        Some(wall) => Partner::Wall(walls[wall].id),
    }
}
