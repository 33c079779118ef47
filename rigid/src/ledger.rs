//! Who exchanged which impulse during a frame: sums over its substeps, per pair, and what springs gave.

use std::collections::BTreeMap;

use crate::{
    colliders::{VelocityChange, springs::Given},
    mat3::{dot, length},
};

/// A pair that touched during a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Contact {
    /// Object id; of two objects the lower one.
    pub object: usize,
    /// What it touched.
    pub other: ContactPartner,
    /// Where [m], world frame: mean weighted by normal impulses.
    pub point: [f64; 3],
    /// Unit normal from the other to the object.
    pub normal: [f64; 3],
    /// Impulse that the object received during the frame [N s].
    pub impulse: [f64; 3],
}

/// What an object touched.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum ContactPartner {
    /// The object of this id.
    Object(usize),
    /// The collider of this number.
    Collider(usize),
}

/// What one of a pair received from the other, once or in sum [N s, m].
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Received {
    /// The impulse.
    pub impulse: [f64; 3],
    /// Its normal part, along the normal from the other to it.
    pub normal_impulse: [f64; 3],
    /// Size of that; of sums the sum of sizes.
    pub weight: f64,
    /// Where, times `weight`.
    pub moment: [f64; 3],
}

impl Received {
    /// An impulse at a point.
    pub fn at(point: [f64; 3], normal: [f64; 3], normal_impulse: f64, impulse: [f64; 3]) -> Self {
        Self {
            impulse,
            normal_impulse: normal.map(|n| normal_impulse * n),
            weight: normal_impulse,
            moment: point.map(|x| normal_impulse * x),
        }
    }

    /// What a collider gave to a mass whose velocity it changed. Its weight is the size of the whole impulse: a surface that
    /// holds on to matter may give nothing along its normal.
    pub fn of_change(mass: f64, given: &VelocityChange) -> Self {
        let impulse = given.change.map(|v| mass * v);
        let normal_impulse = dot(impulse, given.normal);
        let weight = length(impulse);
        Self {
            impulse,
            normal_impulse: given.normal.map(|n| normal_impulse * n),
            weight,
            moment: given.point.map(|x| weight * x),
        }
    }

    /// The same where giver and receiver change places.
    pub fn opposite(&self) -> Self {
        Self {
            impulse: self.impulse.map(|j| -j),
            normal_impulse: self.normal_impulse.map(|j| -j),
            ..*self
        }
    }

    /// In SI units what is in units of `mass` [kg] and `length` [m].
    pub fn in_si(&self, mass: f64, length: f64) -> Self {
        Self {
            impulse: self.impulse.map(|j| j * mass * length),
            normal_impulse: self.normal_impulse.map(|j| j * mass * length),
            weight: self.weight * mass * length,
            moment: self.moment.map(|x| x * mass * length * length),
        }
    }

    /// So many times as much.
    pub fn times(&self, factor: f64) -> Self {
        Self {
            impulse: self.impulse.map(|j| factor * j),
            normal_impulse: self.normal_impulse.map(|j| factor * j),
            weight: factor * self.weight,
            moment: self.moment.map(|x| factor * x),
        }
    }

    /// Adds `sign` times another; sizes add up whatever that is.
    pub fn add(&mut self, more: &Self, sign: f64) {
        for a in 0..3 {
            self.impulse[a] += sign * more.impulse[a];
            self.normal_impulse[a] += sign * more.normal_impulse[a];
            self.moment[a] += more.moment[a];
        }
        self.weight += more.weight;
    }
}

/// What colliders gave to the matter of one block of nodes or particles; few do.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ColliderImpulses(Vec<(usize, Received)>);

impl ColliderImpulses {
    /// Forgets all.
    pub fn clear(&mut self) {
        self.0.clear();
    }

    /// Adds what a collider changed of the velocity of a mass.
    pub fn add(&mut self, mass: f64, given: &VelocityChange) {
        self.take(given.collider, &Received::of_change(mass, given));
    }

    /// Adds all of another.
    pub fn merge(&mut self, other: &Self) {
        for (collider, received) in &other.0 {
            self.take(*collider, received);
        }
    }

    fn take(&mut self, collider: usize, received: &Received) {
        match self.0.iter_mut().find(|(known, _)| *known == collider) {
            Some((_, sum)) => sum.add(received, 1.0),
            None => self.0.push((collider, *received)),
        }
    }

    /// Colliders by their numbers, and what they gave.
    pub fn iter(&self) -> impl Iterator<Item = &(usize, Received)> {
        self.0.iter()
    }
}

/// The sums of a frame, by pairs: of two objects the lower one comes first.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Ledger {
    pairs: BTreeMap<(ContactPartner, usize), Received>,
    /// Per object what springs gave it.
    springs: BTreeMap<usize, Given>,
    /// Energy that matter lost as it vibrated [J].
    pub lost: f64,
}

impl Ledger {
    /// Forgets all.
    pub fn clear(&mut self) {
        *self = Self::default();
    }

    /// Adds what an object received from another, or from a collider.
    pub fn add(&mut self, object: usize, other: ContactPartner, received: &Received) {
        let normal_impulse = received.weight > 0.0;
        if !normal_impulse || other == ContactPartner::Object(object) {
            return;
        }
        let (key, sign) = match other {
            ContactPartner::Object(lower) if lower < object => {
                ((ContactPartner::Object(object), lower), -1.0)
            }
            other => ((other, object), 1.0),
        };
        self.pairs.entry(key).or_default().add(received, sign);
    }

    /// What objects received, and from whom.
    pub fn pairs(&self) -> impl Iterator<Item = (usize, ContactPartner, &Received)> {
        let pairs = self.pairs.iter();
        pairs.map(|(&(other, object), received)| (object, other, received))
    }

    /// Adds what a spring gave to an object.
    pub fn add_spring(&mut self, object: usize, given: &Given) {
        self.springs.entry(object).or_default().add(given);
    }

    /// What springs gave, by the numbers of objects.
    pub fn springs(&self) -> impl Iterator<Item = (usize, Given)> + '_ {
        self.springs.iter().map(|(object, given)| (*object, *given))
    }

    /// So many times what pairs exchanged.
    pub fn times(&self, factor: f64) -> Self {
        let pairs = self.pairs.iter();
        Self {
            pairs: pairs
                .map(|(key, received)| (*key, received.times(factor)))
                .collect(),
            springs: BTreeMap::new(),
            lost: 0.0,
        }
    }

    /// Adds all of another.
    pub fn merge(&mut self, other: &Self) {
        for (key, received) in &other.pairs {
            self.pairs.entry(*key).or_default().add(received, 1.0);
        }
        for (object, given) in &other.springs {
            self.add_spring(*object, given);
        }
        self.lost += other.lost;
    }

    /// The pairs: of objects, then with colliders.
    pub fn contacts(&self) -> Vec<Contact> {
        let contacts = self.pairs.iter().map(|(&(other, object), sum)| {
            let size = length(sum.normal_impulse);
            Contact {
                object,
                other,
                point: sum.moment.map(|x| x / sum.weight),
                normal: match size > 0.0 {
                    true => sum.normal_impulse.map(|n| n / size),
                    // Pressed from both sides alike.
                    false => [0.0, 0.0, 1.0],
                },
                impulse: sum.impulse,
            }
        });
        let mut contacts: Vec<Contact> = contacts.collect();
        contacts.sort_by_key(|c| match c.other {
            ContactPartner::Object(other) => (0, c.object, other),
            ContactPartner::Collider(other) => (1, c.object, other),
        });
        contacts
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_one_receives_the_other_gives() {
        let mut ledger = Ledger::default();
        let up = [0.0, 1.0, 0.0];
        let some = Received::at([1.0, 2.0, 3.0], up, 2.0, [0.5, 2.0, 0.0]);
        ledger.add(3, ContactPartner::Object(1), &some);
        ledger.add(
            1,
            ContactPartner::Object(3),
            &Received::at([3.0, 2.0, 3.0], up.map(|n| -n), 1.0, [0.0, -1.0, 0.0]),
        );
        ledger.add(1, ContactPartner::Collider(0), &some);
        let contacts = ledger.contacts();
        assert_eq!(contacts.len(), 2);
        assert_eq!(
            (contacts[0].object, contacts[0].other),
            (1, ContactPartner::Object(3))
        );
        assert_eq!(contacts[0].impulse, [-0.5, -3.0, 0.0]);
        assert_eq!(contacts[1].impulse, some.impulse);
        assert_eq!(contacts[0].normal, [0.0, -1.0, 0.0]);
        assert_eq!(contacts[0].point, [5.0 / 3.0, 2.0, 3.0]);
        assert_eq!(contacts[1].other, ContactPartner::Collider(0));
    }
}
