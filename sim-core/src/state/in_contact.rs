//! Objects in contact, from first touch to parting.

use serde::{Deserialize, Serialize};

use crate::{
    episodes::{Episodes, PairExchange},
    ledger::{ColliderImpulses, ContactPartner, Ledger},
};

/// Pairs in contact, by what lets them meet, and what fields of the grid gave each other.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct InContact {
    /// Fields of the grid [mass units, cells, s].
    pub at_nodes: Episodes,
    /// Solids with each other, with rigid bodies and with colliders [kg, m, s].
    pub of_solids: Episodes,
    /// Impulses at nodes in the latest frame; not part of a checkpoint.
    #[serde(skip)]
    pub ledger: Ledger,
}

impl InContact {
    fn all(&self) -> [&Episodes; 2] {
        [&self.at_nodes, &self.of_solids]
    }

    /// Numbers that tell one state from another.
    pub fn bits(&self) -> Vec<u64> {
        self.all().map(Episodes::bits).concat()
    }

    /// Whatever is in contact.
    pub fn fields(&self) -> impl Iterator<Item = u32> {
        self.all().into_iter().flat_map(Episodes::fields)
    }

    /// Books what objects exchanged on the grid, in units of `mass` [kg] and `dx` [m].
    pub fn book(&mut self, exchanged: &[PairExchange], mass: f64, dx: f64) {
        for (fields, exchange) in exchanged {
            let [a, b] = fields.map(|field| field as usize);
            let received = exchange.in_si(mass, dx);
            self.ledger.add(b, ContactPartner::Object(a), &received);
        }
    }

    /// Books what colliders gave to the matter of a grid field in a substep, in units of `mass` [kg] and `dx` [m].
    pub fn book_colliders(&mut self, field: u32, given: &ColliderImpulses, mass: f64, dx: f64) {
        for (collider, received) in given.iter() {
            let collider = ContactPartner::Collider(*collider);
            let received = received.in_si(mass, dx);
            self.ledger.add(field as usize, collider, &received);
        }
    }
}
