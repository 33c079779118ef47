//! `contacts`: who touched whom during a step.

use bytemuck::{Pod, Zeroable};
use iceoryx2::prelude::ZeroCopySend;

/// A pair that touched during a step.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable, ZeroCopySend)]
#[type_name("cosplat.v1.Contact")]
#[repr(C)]
pub struct Contact {
    /// Object id; of two objects the lower one.
    pub object: u32,
    /// Object id or number of a collider.
    pub other: u32,
    /// What `other` is, `CONTACT_*`.
    pub kind: u32,
    /// Zero.
    pub reserved: u32,
    /// Where they touch [m], world frame: mean weighted by normal impulses.
    pub point: [f64; 3],
    /// Unit normal that points from `other` to `object`.
    pub normal: [f64; 3],
    /// Impulse that `object` received from `other` during the step [N s].
    pub impulse: [f64; 3],
}

/// `other` is an object.
pub const CONTACT_OBJECT: u32 = 1;
/// `other` is a collider.
pub const CONTACT_COLLIDER: u32 = 2;

/// User header of `contacts`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable, ZeroCopySend)]
#[type_name("cosplat.v1.ContactsHeader")]
#[repr(C)]
pub struct ContactsHeader {
    /// Step count, as in `frame`.
    pub step: u64,
    /// Simulated time [s].
    pub sim_time: f64,
    /// As in `frame`.
    pub epoch: u64,
    /// Contacts in this message.
    pub count: u32,
    /// Contacts in the step; more than `count` when the message holds only the strongest.
    pub total: u32,
}
