//! Checkpoints: the complete state as bytes, and back, bit for bit.

mod arrangement;
mod checks;
mod numbers;

use std::{borrow::Cow, ops::Range};

use serde::{Deserialize, Serialize};
use xxhash_rust::xxh3::{Xxh3, xxh3_64};

use super::{World, frame::Frame, published::Published};
use crate::{
    report::StepReport,
    state::{State, Workspace, sleep::SleepState},
};

/// First bytes of a checkpoint.
const MAGIC: &[u8; 18] = b"cosplat checkpoint";
/// Version of the layout; another one is refused.
const VERSION: u32 = 23;
/// Magic, version, digest of the scene, length of what follows.
const HEADER: usize = MAGIC.len() + 4 + 8 + 8;

/// Why a checkpoint cannot be restored. The world stays as it was.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum CheckpointError {
    /// It does not begin like one.
    #[error("this is no cosplat checkpoint: it begins with {found:?}")]
    NotACheckpoint {
        /// First bytes.
        found: String,
    },
    /// Another version of the layout.
    #[error("the checkpoint has version {found}, and this program reads version {expected}")]
    Version {
        /// Version of the checkpoint.
        found: u32,
        /// Version that can be read.
        expected: u32,
    },
    /// It was made from another scene.
    #[error(
        "the checkpoint belongs to another scene: its digest is {found:016x}, that of this scene {expected:016x}"
    )]
    OtherScene {
        /// Digest in the checkpoint.
        found: u64,
        /// Digest of the world's scene.
        expected: u64,
    },
    /// Bytes are missing.
    #[error("the checkpoint is cut short: it has {found} bytes, expected {expected}")]
    Short {
        /// Bytes there are.
        found: usize,
        /// Bytes there should be.
        expected: usize,
    },
    /// Some byte was changed.
    #[error("the checkpoint is damaged: its checksum is {found:016x}, expected {expected:016x}")]
    Damaged {
        /// Checksum of the bytes.
        found: u64,
        /// Checksum in the checkpoint.
        expected: u64,
    },
    /// The bytes are as they were written, and make no sense.
    #[error("the checkpoint cannot be used: {reason}")]
    Inconsistent {
        /// What is wrong.
        reason: String,
    },
}

/// What is written.
#[derive(Serialize, Deserialize)]
struct Snapshot<'a> {
    state: Cow<'a, State>,
    /// What is displayed of the particles that were taken out, in the order of their removal.
    frozen: Vec<Frozen>,
    /// Whether elastic and visible deformation are published apart.
    apart: bool,
}

/// The last state of a particle that was taken out.
#[derive(Serialize, Deserialize)]
struct Frozen {
    cells: [f64; 3],
    deformation: [f32; 9],
    elastic: [f32; 9],
    memory: f32,
}

impl World {
    /// The complete state as bytes: a world of the same scene that [`restore`](Self::restore)s them goes on with
    /// the same bits, on any thread count and instruction set.
    pub fn checkpoint(&self) -> Vec<u8> {
        let published = &self.published;
        let frozen = self.state.matter.removed.iter().map(|&id| {
            let p = id as usize;
            Frozen {
                cells: published.cells[p],
                deformation: published.deformation[p],
                elastic: *published
                    .elastic
                    .get(p)
                    .unwrap_or(&published.deformation[p]),
                memory: published.memory[p],
            }
        });
        let snapshot = Snapshot {
            state: Cow::Borrowed(&self.state),
            frozen: frozen.collect(),
            apart: !published.elastic.is_empty(),
        };
        let mut bytes = Vec::with_capacity(HEADER);
        bytes.extend(MAGIC);
        bytes.extend(VERSION.to_le_bytes());
        bytes.extend(self.scene_digest().to_le_bytes());
        bytes.extend([0; 8]);
        let mut bytes = postcard::to_extend(&snapshot, bytes)
            .expect("memory takes any bytes, and no field refuses to be written");
        let length = (bytes.len() - HEADER) as u64;
        bytes[HEADER - 8..HEADER].copy_from_slice(&length.to_le_bytes());
        let sum = xxh3_64(&bytes);
        bytes.extend(sum.to_le_bytes());
        bytes
    }

    /// Goes back, or forth, to the state of a [`checkpoint`](Self::checkpoint) of the same scene.
    ///
    /// # Errors
    /// [`CheckpointError`], and nothing is changed, when the bytes are not a checkpoint of this scene and version
    /// or are damaged.
    pub fn restore(&mut self, bytes: &[u8]) -> Result<(), CheckpointError> {
        let payload = self.payload(bytes)?;
        let Snapshot {
            state,
            frozen,
            apart,
        } = postcard::from_bytes(payload).map_err(|error| inconsistent(error.to_string()))?;
        let state = state.into_owned();
        // Parts and solids are those of the checkpoint from here on, or again those of now.
        if let Err(error) = self.fit_model(&state, &frozen) {
            self.model.paint(&self.state.commanded.painted);
            self.model.set_gone_over(&self.state.gone_over);
            return Err(error);
        }
        let mut published = Published::new(&self.model.scene);
        if apart {
            published.elastic.clone_from(&published.deformation);
        }
        for (&id, frozen) in state.matter.removed.iter().zip(&frozen) {
            let p = id as usize;
            published.cells[p] = frozen.cells;
            published.position[p] = frozen.cells.map(|x| (x * self.model.scene.dx) as f32);
            published.deformation[p] = frozen.deformation;
            published.memory[p] = frozen.memory;
            if apart {
                published.elastic[p] = frozen.elastic;
            }
            published.freeze(id);
        }
        published.update(
            &state.matter.particles,
            state.motion.frame_velocity,
            self.model.scene.dx,
        );
        for sleeping in state.levels.iter().filter_map(SleepState::sleeping) {
            published.update(sleeping, [0.0; 3], self.model.scene.dx);
        }
        let before = std::mem::replace(&mut self.state, state);
        let commanded = &self.state.commanded;
        self.model.set_materials(&commanded.materials);
        self.published = published;
        self.reshape(before.bodies);
        self.publish_bodies();
        self.publish_solids();
        self.publish_sleeping_solids();
        for object in 0..self.model.scene.objects.len() {
            self.publish_away(object);
        }
        self.workspace = Workspace::default();
        self.fit_workspace();
        self.report = StepReport::default();
        self.report = self.measure(&Frame::new(0.0));
        self.sight.forget();
        self.update_sight();
        Ok(())
    }

    /// Makes the model that of a state, which is checked.
    fn fit_model(&mut self, state: &State, frozen: &[Frozen]) -> Result<(), CheckpointError> {
        self.model.set_gone_over(&state.gone_over);
        self.check_painted(&state.commanded.painted)?;
        self.model.paint(&state.commanded.painted);
        self.check_snapshot(state, frozen)
    }

    /// The bytes behind the header, once header and checksum are right.
    fn payload<'b>(&self, bytes: &'b [u8]) -> Result<&'b [u8], CheckpointError> {
        if !bytes.starts_with(MAGIC) {
            let first = &bytes[..bytes.len().min(MAGIC.len())];
            return Err(CheckpointError::NotACheckpoint {
                found: String::from_utf8_lossy(first).into_owned(),
            });
        }
        if bytes.len() < HEADER {
            return Err(CheckpointError::Short {
                found: bytes.len(),
                expected: HEADER,
            });
        }
        let number = |range: Range<usize>| {
            let mut value = [0; 8];
            value[..range.len()].copy_from_slice(&bytes[range]);
            u64::from_le_bytes(value)
        };
        let start = MAGIC.len();
        let version = number(start..start + 4) as u32;
        if version != VERSION {
            return Err(CheckpointError::Version {
                found: version,
                expected: VERSION,
            });
        }
        let length = number(HEADER - 8..HEADER) as usize;
        let expected = length.saturating_add(HEADER + 8);
        if bytes.len() != expected {
            return Err(CheckpointError::Short {
                found: bytes.len(),
                expected,
            });
        }
        let (found, expected) = (
            xxh3_64(&bytes[..HEADER + length]),
            number(HEADER + length..HEADER + length + 8),
        );
        if found != expected {
            return Err(CheckpointError::Damaged { found, expected });
        }
        let (found, expected) = (number(start + 4..start + 12), self.scene_digest());
        if found != expected {
            return Err(CheckpointError::OtherScene { found, expected });
        }
        Ok(&bytes[HEADER..HEADER + length])
    }

    /// Hash of all of the scene that the state depends on.
    fn scene_digest(&self) -> u64 {
        let scene = &self.model.scene;
        let mut hash = Xxh3::new();
        hash.update(bytemuck::cast_slice(&scene.particles.position));
        hash.update(bytemuck::cast_slice(&scene.particles.volume));
        // Debug text of floating-point numbers is exact.
        let rest = format!(
            "{:?}",
            (
                scene.dx,
                scene.cfl,
                &scene.domain,
                &self.model.parts[..self.model.scene_parts],
                &scene.colliders,
                &scene.pinned_regions,
                &scene.conditions,
                &scene.contact,
                scene
                    .objects
                    .iter()
                    .map(|o| (o.surface, o.solver, o.present))
                    .collect::<Vec<_>>(),
            )
        );
        hash.update(rest.as_bytes());
        hash.digest()
    }
}

fn inconsistent(reason: String) -> CheckpointError {
    CheckpointError::Inconsistent { reason }
}

/// Refuses another number of something.
fn count(what: &str, found: usize, expected: usize) -> Result<(), CheckpointError> {
    if found == expected {
        return Ok(());
    }
    Err(inconsistent(format!("{found} {what}, expected {expected}")))
}

#[cfg(test)]
mod tests;
