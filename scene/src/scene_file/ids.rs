//! Objects by name.

use std::collections::HashMap;

use cosplat_sim_core::scene::Object;

use super::error::{At, Finding, suggest};

/// Numbers of a scene's objects.
pub(super) struct ObjectIds<'s> {
    objects: &'s [Object],
    by_name: HashMap<&'s str, usize>,
}

impl<'s> ObjectIds<'s> {
    pub fn new(objects: &'s [Object]) -> Self {
        let names = objects.iter().enumerate();
        Self {
            objects,
            by_name: names.map(|(id, o)| (o.name.as_str(), id)).collect(),
        }
    }

    /// The number of an object; notes a name that there is not.
    pub fn find(&self, name: &str, at: &At, errors: &mut Vec<Finding>) -> Option<usize> {
        let found = self.by_name.get(name).copied();
        if found.is_none() {
            let hint = suggest(name, self.objects.iter().map(|o| o.name.as_str()));
            let message = format!("object `{name}` does not exist: {hint}");
            errors.push(Finding::new(at, message));
        }
        found
    }
}
