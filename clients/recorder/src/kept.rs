//! What a recording has told of every object: enough to tell all of it again.

use std::collections::BTreeMap;

use cosplat_ipc::assembly::change_gaussians;
use cosplat_ipc::schema::{CHANGE_GAUSSIANS, CHANGE_PLACED, ChangeSlot, ObjectChange, ObjectState};

use crate::point_cloud;

/// An object as it was told last.
pub(crate) struct KeptObject {
    /// Its row; of an object that was placed, with the kind of its form.
    pub(crate) row: ObjectChange,
    /// Its Gaussians as the first part of a message.
    pub(crate) points: Vec<u8>,
}

/// All objects as they were told last.
#[derive(Default)]
pub(crate) struct Kept {
    of: BTreeMap<u32, KeptObject>,
    states: Vec<ObjectState>,
}

impl Kept {
    /// Takes note of a row of a message.
    pub(crate) fn take(&mut self, row: &ObjectChange, slots: &[ChangeSlot]) {
        if row.kind == CHANGE_PLACED {
            if let Some(kept) = self.of.get_mut(&row.object) {
                (kept.row.position, kept.row.rotation) = (row.position, row.rotation);
            }
            return;
        }
        let kept = self.of.entry(row.object).or_insert_with(|| KeptObject {
            row: *row,
            points: Vec::new(),
        });
        kept.row = *row;
        kept.points.clear();
        let gaussians = change_gaussians(row, slots).unwrap_or_default();
        point_cloud::encode_points(gaussians, &mut kept.points);
    }

    /// Forgets the objects that are not among these.
    pub(crate) fn retain(&mut self, rows: &[ObjectChange]) {
        let is_told = |object: u32| rows.iter().any(|row| row.object == object);
        self.of.retain(|object, _| is_told(*object));
    }

    /// Ids of all objects.
    pub(crate) fn ids(&self) -> Vec<u32> {
        self.of.keys().copied().collect()
    }

    /// One of them.
    pub(crate) fn get_mut(&mut self, object: u32) -> Option<&mut KeptObject> {
        self.of.get_mut(&object)
    }

    /// The states that are not as they were; all where their number is another one, or `all` are wanted.
    pub(crate) fn changed(&mut self, states: &[ObjectState], all: bool) -> Vec<ObjectState> {
        let all = all || self.states.len() != states.len();
        let before = std::mem::replace(&mut self.states, states.to_vec());
        let is_new = |(n, state): &(usize, &ObjectState)| {
            all || bytemuck::bytes_of(&before[*n]) != bytemuck::bytes_of(*state)
        };
        let changed = states.iter().enumerate().filter(is_new);
        changed.map(|(_, state)| *state).collect()
    }
}

/// Whether the Gaussians of a row are in the world frame.
pub(crate) fn is_in_world(row: &ObjectChange) -> bool {
    row.kind == CHANGE_GAUSSIANS
}
