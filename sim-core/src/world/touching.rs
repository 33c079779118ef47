//! The contacts of a frame.

use super::World;
use crate::report::Contact;

impl World {
    /// Pairs that touched during the latest frame, with the impulses that they exchanged: objects with each other, by
    /// their numbers, then objects with colliders. Impulses are summed where contact conditions are applied; what pins and
    /// held regions give is not among them. Objects glued by `single_field` contact and the paper's spheres exchange none
    /// that is known.
    pub fn contacts(&self) -> Vec<Contact> {
        let mut all = self.state.in_contact.ledger.clone();
        all.merge(&self.state.bodies.ledger);
        all.contacts()
    }
}
