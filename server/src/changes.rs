//! What a message of `changes` has to tell: what is another version than in the one before.

use cosplat_ipc::schema::{
    CHANGE_FORM, CHANGE_GAUSSIANS, CHANGE_PLACED, GaussianState, ObjectChange, row_slots,
};
use cosplat_sim_core::World;

use crate::gaussians::GaussianWriter;

/// What was told.
#[derive(Default)]
pub struct Told {
    /// Version of every object; none of a world is 0.
    versions: Vec<u64>,
    /// Form of every object; none of a world is 0.
    forms: Vec<u64>,
    /// Step of the message; `None` where the next one has to be complete.
    step: Option<u64>,
}

/// A message that is to be written.
pub struct ChangesPlan {
    /// Its rows.
    pub rows: Vec<ObjectChange>,
    /// Gaussians behind them.
    pub gaussians: usize,
    /// The step that it builds on; its own where it is complete.
    pub since: u64,
}

impl Told {
    /// Forgets all, so that the next message is complete.
    pub fn forget(&mut self) {
        *self = Self::default();
    }

    /// Whether the next message has to be complete.
    pub fn is_empty(&self) -> bool {
        self.step.is_none()
    }

    /// The message after that which was sent last.
    pub fn plan(&mut self, world: &World, writer: &GaussianWriter) -> ChangesPlan {
        let step = world.report().step;
        // Who sends a step once more says all of it.
        if self.step == Some(step) {
            self.forget();
        }
        let count = world.scene().objects.len();
        self.versions.resize(count, 0);
        self.forms.resize(count, 0);
        let mut rows = Vec::new();
        for object in 0..count {
            let (range, seen) = (writer.range(object), world.visible(object));
            if range.is_empty() || seen.version == self.versions[object] {
                continue;
            }
            let kind = match seen.placed {
                None => CHANGE_GAUSSIANS,
                Some(placed) if placed.form == self.forms[object] => CHANGE_PLACED,
                Some(_) => CHANGE_FORM,
            };
            rows.push(ObjectChange {
                object: object as u32,
                kind,
                first: range.start as u32,
                count: range.len() as u32,
                position: seen.placed.map_or([0.0; 3], |placed| placed.position),
                rotation: seen.placed.map_or([0.0; 4], |placed| placed.rotation),
                ..ObjectChange::default()
            });
        }
        let begin = row_slots(rows.len());
        let mut gaussians = 0;
        for row in rows.iter_mut().filter(|row| row.kind != CHANGE_PLACED) {
            row.slot = (begin + gaussians) as u32;
            gaussians += row.count as usize;
        }
        ChangesPlan {
            rows,
            gaussians,
            since: self.step.unwrap_or(step),
        }
    }

    /// Takes note of a message that was sent.
    pub fn sent(&mut self, world: &World) {
        self.step = Some(world.report().step);
        for object in 0..self.versions.len() {
            let seen = world.visible(object);
            self.versions[object] = seen.version;
            self.forms[object] = seen.placed.map_or(0, |placed| placed.form);
        }
    }
}

impl ChangesPlan {
    /// Writes the Gaussians of the message; `frame` is the frame of the same step, where there is one.
    pub fn write(
        &self,
        world: &World,
        writer: &GaussianWriter,
        frame: Option<&[GaussianState]>,
        mut out: &mut [GaussianState],
    ) {
        for row in self.rows.iter().filter(|row| row.kind != CHANGE_PLACED) {
            let object = row.object as usize;
            let (mine, rest) = out.split_at_mut(row.count as usize);
            out = rest;
            let placed = world.visible(object).placed;
            let form = placed.and_then(|placed| writer.form(object, &placed));
            match (form, frame) {
                (Some(form), _) => mine.copy_from_slice(form),
                (None, Some(frame)) => mine.copy_from_slice(&frame[writer.range(object)]),
                (None, None) => writer.write(world, object, mine),
            }
        }
    }
}

#[cfg(test)]
mod tests;
