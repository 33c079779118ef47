//! Checkpoints: the complete state as bytes, and back, bit for bit.

use std::{borrow::Cow, ops::Range};

use serde::{Deserialize, Serialize};
use xxhash_rust::xxh3::{Xxh3, xxh3_64};

use super::{World, frame::Frame, published::Published};
use crate::{
    particles::{Block, NO_PARTICLE, Particles},
    report::StepReport,
    simd::LANES,
    state::{State, Workspace, sleep::SleepState},
};

/// First bytes of a checkpoint.
const MAGIC: &[u8; 18] = b"cosplat checkpoint";
/// Version of the layout; another one is refused.
const VERSION: u32 = 8;
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
        self.check_state(&state, frozen.len())?;
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
        self.state = state;
        self.model.set_materials(&self.state.commanded.materials);
        self.published = published;
        self.reshape();
        self.publish_bodies();
        self.workspace = Workspace::default();
        self.fit_workspace();
        self.suspect_all();
        self.report = StepReport::default();
        self.report = self.measure(&Frame::new(0.0));
        Ok(())
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
                &self.model.parts,
                &scene.colliders,
                &scene.pinned_regions,
                &scene.conditions,
                &scene.contact,
                scene.objects.iter().map(|o| o.surface).collect::<Vec<_>>(),
            )
        );
        hash.update(rest.as_bytes());
        hash.digest()
    }

    /// Everything that the solver relies on without looking: a checkpoint is a file, and files come from anywhere.
    fn check_state(&self, state: &State, frozen: usize) -> Result<(), CheckpointError> {
        let (model, motion) = (&self.model, &state.motion);
        let (parts, objects) = (model.parts.len(), model.scene.objects.len());
        for (what, found, expected) in [
            ("materials", state.commanded.materials.len(), parts),
            ("shape marks", state.matter.shaped.len(), parts),
            ("extremes", state.matter.extremes.len(), parts),
            ("momenta", state.progress.momentum.len(), objects),
            ("rigid bodies", state.bodies.of.len(), objects),
            ("model levels", state.levels.len(), objects),
            ("pins", state.commanded.pins.len(), objects),
            ("velocity offsets", motion.velocity_offsets.len(), objects),
            (
                "colliders",
                state.commanded.paths.len(),
                model.scene.colliders.len(),
            ),
            ("frozen particles", frozen, state.matter.removed.len()),
        ] {
            count(what, found, expected)?;
        }
        for offset in std::iter::once(&motion.velocity_offset).chain(&motion.velocity_offsets) {
            if !(0.0..f64::INFINITY).contains(offset) {
                let reason = format!("velocities are {offset} s behind positions");
                return Err(inconsistent(reason));
            }
        }
        self.check_particles(state)?;
        for (object, rigid) in state.bodies.of.iter().enumerate() {
            if rigid.as_ref().is_some_and(|rigid| !rigid.is_sound()) {
                return Err(inconsistent(format!("the body of object {object} is none")));
            }
        }
        let fields = self.model.fields();
        for (object, level) in state.levels.iter().enumerate() {
            let Some(sleeping) = level.sleeping() else {
                continue;
            };
            check_arrangement(sleeping, &state.matter.shaped, &fields)?;
            let own = |block: &Block| block.field == object as u32;
            let parts = self.model.parts.iter().filter(|part| part.object == object);
            let is_whole = sleeping.blocks.iter().all(own)
                && !state.matter.particles.blocks.iter().any(own)
                && level.remembered_parts() == parts.count();
            if !is_whole {
                return Err(inconsistent(format!("object {object} sleeps in part")));
            }
        }
        check_arrangement(&state.matter.particles, &state.matter.shaped, &fields)
    }

    /// Every particle is in one place: in an array, in a sleeping object, in a rigid body, or taken out.
    fn check_particles(&self, state: &State) -> Result<(), CheckpointError> {
        let mut seen = vec![false; self.model.scene.particles.position.len()];
        let taken = state.matter.removed.iter().copied();
        let sleeping = state.levels.iter().filter_map(SleepState::sleeping);
        let all = std::iter::once(&state.matter.particles).chain(sleeping);
        let here = all.flat_map(|p| p.fixed.iter().flat_map(|fixed| fixed.id));
        let members = || state.bodies.of.iter().flatten().flat_map(|r| &r.members);
        let here = here.filter(|&id| id != NO_PARTICLE);
        for id in taken.chain(here).chain(members().map(|m| m.id)) {
            match seen.get_mut(id as usize) {
                Some(seen) if !*seen => *seen = true,
                Some(_) => return Err(inconsistent(format!("particle {id} is in it twice"))),
                None => return Err(inconsistent(format!("particle {id} is not in the scene"))),
            }
        }
        let live = seen.iter().filter(|&&seen| seen).count() - state.matter.removed.len();
        let live = live - members().count();
        count("live particles", state.matter.live, live)
    }
}

fn inconsistent(reason: String) -> CheckpointError {
    CheckpointError::Inconsistent { reason }
}

fn count(what: &str, found: usize, expected: usize) -> Result<(), CheckpointError> {
    if found == expected {
        return Ok(());
    }
    Err(inconsistent(format!("{found} {what}, expected {expected}")))
}

/// Blocks, runs, groups and shapes must follow each other without a gap.
fn check_arrangement(
    particles: &Particles,
    shaped: &[bool],
    fields: &[u32],
) -> Result<(), CheckpointError> {
    let groups = particles.groups.len();
    count("velocity groups", particles.motion.len(), groups)?;
    count("mass groups", particles.fixed.len(), groups)?;
    count("memory groups", particles.memory.len(), groups)?;
    count("flag groups", particles.flags.len(), groups)?;
    let (mut run_end, mut group_end, mut shape_end) = (0, 0, 0);
    let mut last = None;
    for block in &particles.blocks {
        let follows = block.runs.start == run_end
            && block.groups.start == group_end
            && block.shapes.start == shape_end
            && block.runs.end <= particles.runs.len()
            && last.is_none_or(|last| last < (block.field, block.index));
        if !follows {
            return Err(inconsistent(format!(
                "block {:?} is out of order",
                block.index
            )));
        }
        for run in particles.runs.get(block.runs.clone()).unwrap_or_default() {
            let shapes = run.shapes.len();
            let fits = run.groups.start == group_end
                && run.groups.end > run.groups.start
                && run.shapes.start == shape_end
                && (shapes == 0 || shapes == run.groups.len())
                && run.part < shaped.len()
                && fields[run.part] == block.field;
            if !fits {
                return Err(inconsistent(format!(
                    "a run of part {} is out of order",
                    run.part
                )));
            }
            (group_end, shape_end) = (run.groups.end, run.shapes.end.max(shape_end));
        }
        run_end = block.runs.end;
        if block.groups.end != group_end || block.shapes.end != shape_end {
            return Err(inconsistent(format!("block {:?} has a gap", block.index)));
        }
        last = Some((block.field, block.index));
    }
    count("runs in blocks", run_end, particles.runs.len())?;
    count("groups in blocks", group_end, groups)?;
    count("shapes in blocks", shape_end, particles.shapes.len())?;
    for g in &particles.groups {
        let near = |x: f32| x.abs() <= 4.0;
        if !g.x.iter().all(|x| (0..LANES).all(|lane| near(x.0[lane]))) {
            return Err(inconsistent("a particle is not near its block".into()));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        Isa, Scene,
        materials::Law,
        particles::Extremes,
        scene::{Aabb, Surface},
        test_scenes::{add_box, add_plane, elastic, empty, spin},
    };

    /// Two materials in one object and a rigid one, with contact, sorting and particles that leave.
    fn scene() -> Scene {
        let mut scene = empty(0.1);
        scene.gravity = [0.0, 0.0, -9.81];
        scene.domain = Aabb {
            min: [-1.0, -1.0, -1.0],
            max: [0.45, 1.0, 1.0],
        };
        let soft = elastic(Law::NeoHookean, 1e5, 0.3);
        add_box(&mut scene, soft, [-0.2, -0.1, 0.05], 0.05, [9, 6, 3]);
        let all = scene.objects[0].particles.clone();
        scene.objects[0].regions.push(crate::scene::MaterialRegion {
            particles: all.start + 90..all.end,
            material: elastic(Law::FixedCorotated, 2e5, 0.2),
        });
        let rigid = elastic(Law::Rigid, 0.0, 0.0);
        add_box(&mut scene, rigid, [-0.1, -0.1, 0.3], 0.05, [4; 3]);
        scene.objects[0].linear_velocity = [2.0, 0.0, 0.0];
        scene.objects[1].velocity_gradient = spin([1.0, 2.0, 3.0]);
        let up = [0.0, 0.0, 1.0];
        add_plane(&mut scene, [0.0; 3], up, Surface::Separate, 0.3);
        scene
    }

    fn run(world: &mut World, frames: usize) -> Vec<u64> {
        let steps = (0..frames).map(|_| world.step(1.0 / 60.0, &[]).state_hash);
        steps.collect()
    }

    #[test]
    fn a_restored_world_goes_on_with_the_same_bits() {
        let mut world = World::new(scene()).expect("valid scene");
        run(&mut world, 23);
        assert!(
            !world.state.matter.removed.is_empty(),
            "nothing left the domain"
        );
        let bytes = world.checkpoint();
        let report = world.report().clone();
        let expected = run(&mut world, 20);
        for isa in Isa::ALL.into_iter().filter(|isa| isa.is_available()) {
            let mut other = World::with_isa(scene(), isa).expect("valid scene");
            // Whatever it did before does not matter.
            run(&mut other, 5);
            other.restore(&bytes).expect("a checkpoint of this scene");
            assert_eq!(other.report().state_hash, report.state_hash);
            assert_eq!(other.report().step, report.step);
            assert_eq!(other.positions(), {
                let mut again = World::new(scene()).expect("valid scene");
                again.restore(&bytes).expect("again");
                again.positions().to_vec()
            });
            assert_eq!(run(&mut other, 20), expected, "{isa}");
        }
    }

    /// With the same bits.
    #[test]
    fn a_restored_world_goes_on_where_the_substep_changes() {
        let mut world = World::new(scene()).expect("valid scene");
        let long = world.step(1.0 / 60.0, &[]);
        let bytes = world.checkpoint();
        // Frames of less than a substep: the first kick is the mean of two.
        let lengths = [0.3 * long.dt, 0.4 * long.dt, 1.0 / 60.0];
        let go_on = |world: &mut World| lengths.map(|length| world.step(length, &[]).state_hash);
        assert!((world.state.motion.velocity_offset - 0.5 * long.dt).abs() < 1e-12);
        let expected = go_on(&mut world);
        let there = world.positions().to_vec();
        world.restore(&bytes).expect("a checkpoint of this scene");
        assert_eq!(go_on(&mut world), expected);
        // Without the substep before, it would go another way.
        world.restore(&bytes).expect("a checkpoint of this scene");
        world.state.motion.velocity_offset = 0.0;
        world.state.motion.velocity_offsets.fill(0.0);
        go_on(&mut world);
        assert_ne!(world.positions(), there);
        world.state.motion.velocity_offset = f64::NAN;
        let bytes = world.checkpoint();
        let error = world.restore(&bytes).expect_err("no number");
        assert!(error.to_string().contains("behind"), "{error}");
    }

    #[test]
    fn bad_checkpoints_are_refused_and_change_nothing() {
        let mut world = World::new(scene()).expect("valid scene");
        let bytes = world.checkpoint();
        run(&mut world, 3);
        let before = world.report().state_hash;
        let mut refuse = |bytes: &[u8]| {
            let error = world.restore(bytes).expect_err("bad bytes");
            assert_eq!(world.report().state_hash, before);
            error
        };
        let not_one = refuse(b"version = 1\nname = \"scene\"");
        assert!(matches!(not_one, CheckpointError::NotACheckpoint { .. }));
        let short = refuse(&bytes[..bytes.len() - 5]);
        assert!(matches!(short, CheckpointError::Short { .. }));
        for found in [VERSION - 1, VERSION + 1] {
            let mut foreign = bytes.clone();
            foreign[MAGIC.len()..MAGIC.len() + 4].copy_from_slice(&found.to_le_bytes());
            let expected = VERSION;
            assert_eq!(
                refuse(&foreign),
                CheckpointError::Version { found, expected }
            );
        }
        // Every single byte counts.
        for at in (HEADER..bytes.len()).step_by(997) {
            let mut damaged = bytes.clone();
            damaged[at] ^= 1;
            assert!(
                matches!(refuse(&damaged), CheckpointError::Damaged { .. }),
                "byte {at}"
            );
        }
        let mut other = scene();
        other.particles.position[7][1] += 1e-9;
        let mut other = World::new(other).expect("valid scene");
        let error = other.restore(&bytes).expect_err("another scene");
        assert!(
            matches!(error, CheckpointError::OtherScene { .. }),
            "{error}"
        );
    }

    #[test]
    fn a_checkpoint_with_a_right_sum_and_wrong_content_is_refused() {
        let world = World::new(scene()).expect("valid scene");
        let mut forged = World::new(scene()).expect("valid scene");
        forged.state.matter.particles.fixed[0].id[1] = forged.state.matter.particles.fixed[0].id[0];
        let twice = forged.checkpoint();
        let mut world = world;
        let error = world.restore(&twice).expect_err("one particle twice");
        assert!(error.to_string().contains("twice"), "{error}");
        let mut forged = World::new(scene()).expect("valid scene");
        forged.state.matter.particles.blocks.swap(0, 1);
        let error = world
            .restore(&forged.checkpoint())
            .expect_err("blocks swapped");
        assert!(error.to_string().contains("out of order"), "{error}");
        let mut forged = World::new(scene()).expect("valid scene");
        forged.state.matter.extremes.push(Extremes::NONE);
        let error = world
            .restore(&forged.checkpoint())
            .expect_err("one too many");
        assert!(error.to_string().contains("extremes"), "{error}");
    }
}
