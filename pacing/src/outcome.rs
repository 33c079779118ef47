//! What happened in a step that a participant may wait for.

use cosplat_ipc::schema::{self as wire, StepRequest};

/// What a step came to.
#[derive(Clone, Debug, Default)]
pub struct StepOutcome<'a> {
    /// Pairs that touched; empty where nobody wants to know.
    pub contacts: Vec<wire::Contact>,
    /// Names of the objects, for sentences.
    pub objects: &'a [String],
    /// Names of the colliders.
    pub colliders: &'a [String],
    /// Events, in sentences.
    pub events: Vec<String>,
    /// Particles that were frozen.
    pub quarantined: usize,
}

/// Why a participant is answered before its last step.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Finding {
    /// `RETURN_*`.
    pub cause: u32,
    /// The pair.
    pub contact: [u32; 2],
    /// What its second is, `CONTACT_*`.
    pub contact_kind: u32,
    /// A sentence.
    pub reason: String,
}

impl StepOutcome<'_> {
    /// What of it a request waits for; what is worst comes first.
    pub fn finding(&self, header: &StepRequest) -> Option<Finding> {
        let found = |cause, reason| Finding {
            cause,
            contact: [0; 2],
            contact_kind: 0,
            reason,
        };
        let wants = |flag| header.until & flag != 0;
        if wants(wire::UNTIL_QUARANTINE) && self.quarantined > 0 {
            let reason = format!("{} particles were frozen", self.quarantined);
            return Some(found(wire::RETURN_QUARANTINE, reason));
        }
        if wants(wire::UNTIL_EVENT)
            && let Some(event) = self.events.first()
        {
            return Some(found(wire::RETURN_EVENT, event.clone()));
        }
        let contact = match wants(wire::UNTIL_CONTACT) {
            true => self
                .contacts
                .iter()
                .find(|contact| is_meant(header, contact))?,
            false => return None,
        };
        Some(Finding {
            contact: [contact.object, contact.other],
            contact_kind: contact.kind,
            ..found(wire::RETURN_CONTACT, self.sentence(contact))
        })
    }

    fn sentence(&self, contact: &wire::Contact) -> String {
        let name = |names: &[String], id: u32| match names.get(id as usize) {
            Some(name) => name.clone(),
            None => id.to_string(),
        };
        let others = match contact.kind {
            wire::CONTACT_COLLIDER => self.colliders,
            _ => self.objects,
        };
        let object = name(self.objects, contact.object);
        format!("{object} touches {}", name(others, contact.other))
    }
}

/// Whether a request waits for this contact. Two objects may be named in either order.
fn is_meant(header: &StepRequest, contact: &wire::Contact) -> bool {
    let fits = |wanted: u32, is: u32| wanted == wire::ANY || wanted == is;
    let is_kind = header.pair_kind == 0 || header.pair_kind == contact.kind;
    let [a, b] = header.pair;
    let ordered = fits(a, contact.object) && fits(b, contact.other);
    let swapped =
        contact.kind == wire::CONTACT_OBJECT && fits(a, contact.other) && fits(b, contact.object);
    is_kind && (ordered || swapped)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn finding(header: &StepRequest) -> Option<Finding> {
        let contact = |object, other, kind| wire::Contact {
            object,
            other,
            kind,
            ..Default::default()
        };
        let outcome = StepOutcome {
            contacts: vec![
                contact(0, 2, wire::CONTACT_OBJECT),
                contact(1, 2, wire::CONTACT_COLLIDER),
            ],
            objects: &["vase", "plant", "ball"].map(String::from),
            colliders: &["floor", "wall", "table"].map(String::from),
            events: vec!["`vase` fell apart".into()],
            quarantined: 3,
        };
        outcome.finding(header)
    }

    fn request(until: u32, pair_kind: u32, pair: [u32; 2]) -> StepRequest {
        StepRequest {
            until,
            pair_kind,
            pair,
            ..Default::default()
        }
    }

    #[test]
    fn a_named_pair_is_found_in_either_order() {
        let found = |kind, pair| {
            let found = finding(&request(wire::UNTIL_CONTACT, kind, pair));
            found.map(|found| (found.contact, found.reason))
        };
        let vase = Some(([0, 2], "vase touches ball".to_owned()));
        let plant = Some(([1, 2], "plant touches table".to_owned()));
        assert_eq!(found(wire::CONTACT_OBJECT, [0, 2]), vase);
        assert_eq!(found(wire::CONTACT_OBJECT, [2, 0]), vase);
        assert_eq!(found(wire::CONTACT_OBJECT, [2, wire::ANY]), vase);
        assert_eq!(found(wire::CONTACT_COLLIDER, [1, 2]), plant);
        assert_eq!(found(wire::CONTACT_COLLIDER, [2, 1]), None);
        assert_eq!(found(0, [1, wire::ANY]), plant);
        assert_eq!(found(0, [wire::ANY, wire::ANY]), vase);
        assert_eq!(found(wire::CONTACT_OBJECT, [0, 1]), None);
    }

    #[test]
    fn only_what_is_asked_for_brings_the_answer() {
        let cause = |until| {
            let found = finding(&request(until, 0, [wire::ANY; 2]));
            found.map(|found| found.cause)
        };
        assert_eq!(cause(0), None);
        assert_eq!(cause(wire::UNTIL_EVENT), Some(wire::RETURN_EVENT));
        let all = wire::UNTIL_CONTACT | wire::UNTIL_EVENT | wire::UNTIL_QUARANTINE;
        assert_eq!(cause(all), Some(wire::RETURN_QUARANTINE));
        let calm = StepOutcome::default();
        assert_eq!(calm.finding(&request(all, 0, [wire::ANY; 2])), None);
    }
}
