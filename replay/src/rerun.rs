//! A recorded run, simulated again from the recording alone.

use std::{
    collections::{BTreeMap, VecDeque},
    convert::Infallible,
    path::{Path, PathBuf},
    sync::Arc,
};

use bytemuck::{Pod, cast_slice, pod_collect_to_vec};
use cosplat_ipc::{
    schema::{AppliedCommand, GaussianState, SceneHeader},
    server::SceneBlocks,
};
use cosplat_recorder::{
    chunks::Chunks,
    ply::PlyScene,
    reader::Event,
    runs::{FileKind, Lack, RunHeader},
    topics::{
        FILES_PREFIX, SCENE_FEATURES, SCENE_GAUSSIANS, SCENE_OBJECTS, SCENE_PLY, SCENE_SH,
        SCENE_TOML,
    },
};
use cosplat_scene::{
    load::{LoadedScene, load_held},
    sources::HeldFile,
};
use cosplat_server::{
    convert::{Order, order_from_wire},
    publish::{Output, SceneBuffers},
};
use cosplat_sim_core::{Command, Interruption, StepReport, World};
use xxhash_rust::xxh3::{Xxh3, xxh3_64};

use crate::{ReplayError, differences::differing_field, outlook::Start, walk::Walk};

/// Attachments that a scene's text and files make.
const BLOCKS: [&str; 5] = [
    SCENE_PLY,
    SCENE_GAUSSIANS,
    SCENE_SH,
    SCENE_FEATURES,
    SCENE_OBJECTS,
];

/// What a recording keeps to simulate its runs again.
#[derive(Default)]
pub struct Kept {
    /// Scene texts, by scene hash.
    texts: BTreeMap<u64, Vec<u8>>,
    /// Files, by attachment.
    files: BTreeMap<String, Arc<[u8]>>,
    /// Hashes of the blocks of scenes, by scene hash and attachment.
    blocks: BTreeMap<(u64, String), u64>,
}

impl Kept {
    /// Keeps an attachment that follows the metadata of a run, if it is one of those that are needed.
    pub fn attachment(&mut self, run: &RunHeader, name: String, data: Vec<u8>) {
        if name == SCENE_TOML {
            self.texts.insert(run.scene.scene_hash, data);
        } else if name.starts_with(FILES_PREFIX) {
            self.files.insert(name, data.into());
        } else if BLOCKS.contains(&&*name) {
            let key = (run.scene.scene_hash, name);
            self.blocks.insert(key, xxh3_64(&data));
        }
    }

    /// Compares what is recorded of a scene at rest, in blocks and in the metadata, with the scene as it is built now.
    fn compare_scene(&self, run: &RunHeader, blocks: &SceneBlocks) -> Result<(), ReplayError> {
        let mut ply = Xxh3::new();
        let scene = PlyScene {
            gaussians: blocks.gaussians,
            sh_degree: blocks.header.sh_degree,
            sh: blocks.sh,
        };
        let Ok(()) = scene.encode(|piece| {
            ply.update(piece);
            Ok::<_, Infallible>(())
        });
        let hashes = [
            ply.digest(),
            xxh3_64(cast_slice(blocks.gaussians)),
            xxh3_64(cast_slice(blocks.sh)),
            xxh3_64(cast_slice(blocks.features)),
            xxh3_64(cast_slice(blocks.objects)),
        ];
        for (name, hash) in BLOCKS.into_iter().zip(hashes) {
            let name = name.to_owned();
            let kept = self.blocks.get(&(run.scene.scene_hash, name.clone()));
            if kept.is_some_and(|kept| *kept != hash) {
                return Err(ReplayError::SceneBlock { name });
            }
        }
        let built = SceneHeader {
            epoch: run.scene.epoch,
            gaussian_count: blocks.gaussians.len() as u32,
            object_count: blocks.objects.len() as u32,
            ..blocks.header
        };
        match differing_field(&run.scene, &built) {
            None => Ok(()),
            Some((field, recorded, found)) => Err(ReplayError::SceneHeader {
                field,
                recorded,
                found,
            }),
        }
    }

    /// The text of a run's scene.
    pub fn text(&self, run: &RunHeader) -> Option<&[u8]> {
        self.texts.get(&run.scene.scene_hash).map(Vec::as_slice)
    }

    /// What is missing to begin a run.
    pub fn lacks(&self, run: &RunHeader) -> Vec<Lack> {
        let has_text = self.texts.contains_key(&run.scene.scene_hash);
        run.lacks(has_text, |name| self.files.contains_key(name))
    }

    /// The content of each file of a run that is there: kind, name as the scene says it, content.
    pub fn files<'a>(
        &'a self,
        run: &'a RunHeader,
    ) -> impl Iterator<Item = (FileKind, &'a str, &'a Arc<[u8]>)> {
        run.files.iter().flatten().filter_map(|file| {
            let content = self.files.get(file.attachment.as_ref().ok()?)?;
            Some((file.kind, file.name.as_str(), content))
        })
    }

    /// The scene of a run; `path_of` says where a copy of each asset lies, for messages and for those who record.
    ///
    /// # Errors
    /// When something is missing, or the scene cannot be built.
    pub fn scene(
        &self,
        run: &RunHeader,
        recording: &Path,
        path_of: impl Fn(&str) -> PathBuf,
    ) -> Result<LoadedScene, ReplayError> {
        if let Some(lack) = self.lacks(run).into_iter().next() {
            return Err(lack.into());
        }
        let text = &self.texts[&run.scene.scene_hash];
        let text = std::str::from_utf8(text).map_err(|cause| ReplayError::Text { cause })?;
        let held = self
            .files(run)
            .filter(|(kind, ..)| *kind == FileKind::Asset)
            .map(|(_, name, content)| {
                let file = HeldFile {
                    path: path_of(name),
                    content: content.clone(),
                };
                (name.to_owned(), file)
            })
            .collect();
        Ok(load_held(
            text.to_owned(),
            &recording.join(SCENE_TOML),
            &held,
        )?)
    }

    /// The checkpoint that a run began with.
    pub fn checkpoint<'a>(&'a self, run: &'a RunHeader) -> Option<&'a [u8]> {
        self.files(run)
            .find(|(kind, ..)| *kind == FileKind::Checkpoint)
            .map(|(.., content)| &content[..])
    }
}

/// A run as it stands in a recording.
pub struct Take {
    /// Its metadata.
    pub header: RunHeader,
    /// What it can be simulated from.
    pub kept: Kept,
    /// Its scene at rest, by the names of attachments.
    pub scene: BTreeMap<String, Vec<u8>>,
}

impl Take {
    /// The elements of an attachment of the scene; none where there is no such attachment.
    ///
    /// # Errors
    /// When its length is no multiple of an element's.
    pub fn items<T: Pod>(&self, name: &'static str) -> Result<Vec<T>, ReplayError> {
        let bytes = self.scene.get(name).map_or(&[][..], Vec::as_slice);
        let (length, size) = (bytes.len(), size_of::<T>());
        if !length.is_multiple_of(size) {
            return Err(ReplayError::Attachment {
                name,
                bytes: length,
                size,
            });
        }
        Ok(pod_collect_to_vec(bytes))
    }
}

/// Finds run number `number` of a recording, counted from 1, or the only one.
///
/// # Errors
/// When there is no such run, or several and none is named, or the recording cannot be read.
pub fn take(chunks: &mut Chunks, path: &Path, number: Option<usize>) -> Result<Take, ReplayError> {
    let mut headers: Vec<RunHeader> = Vec::new();
    let mut kept = Kept::default();
    // The scene of a run is attached where its hash is new.
    let mut scenes: BTreeMap<u64, BTreeMap<String, Vec<u8>>> = BTreeMap::new();
    let mut walk = Walk::default();
    for event in chunks.matter()? {
        if let Some(begun) = walk.next(&event) {
            headers.push(begun.header.map_err(ReplayError::Metadata)?);
        }
        let (Event::Attachment { name, data }, Some(header)) = (event, headers.last()) else {
            continue;
        };
        if name.starts_with("scene/") {
            let scene = scenes.entry(header.scene.scene_hash).or_default();
            scene.insert(name, data);
        } else {
            kept.attachment(header, name, data);
        }
    }
    let (path, count) = (path.to_owned(), headers.len());
    let number = match number {
        _ if count == 0 => return Err(ReplayError::NoRun { path }),
        None if count > 1 => return Err(ReplayError::ManyRuns { path, count }),
        number => number.unwrap_or(1),
    };
    if !(1..=count).contains(&number) {
        return Err(ReplayError::RunNumber {
            path,
            number,
            count,
        });
    }
    let header = headers.swap_remove(number - 1);
    let scene = scenes.remove(&header.scene.scene_hash).unwrap_or_default();
    Ok(Take {
        header,
        kept,
        scene,
    })
}

/// A run that is being simulated again.
pub struct Rerun {
    world: World,
    output: Output,
    pool: rayon::ThreadPool,
    frame_dt: f64,
    /// Commands that were not applied yet, in their order.
    due: VecDeque<AppliedCommand>,
    gaussians: Vec<GaussianState>,
}

impl Rerun {
    /// The run at its beginning or after the step of `start`, on `threads` threads, 0 for one per core.
    ///
    /// # Errors
    /// When the recording lacks something, or what it has makes no scene, or another one than was recorded.
    pub fn begin(
        kept: &Kept,
        run: &RunHeader,
        recording: &Path,
        start: Option<&Start>,
        threads: usize,
    ) -> Result<Rerun, ReplayError> {
        let loaded = kept.scene(run, recording, |name| recording.join(name))?;
        let buffers = SceneBuffers::new(&loaded);
        let blocks = buffers.blocks(&loaded);
        let (found, expected) = (blocks.header.scene_hash, run.scene.scene_hash);
        if found != expected {
            return Err(ReplayError::OtherScene { found, expected });
        }
        kept.compare_scene(run, &blocks)?;
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .map_err(|cause| ReplayError::Threads { threads, cause })?;
        let frame_dt = 1.0 / loaded.scene.frame_rate;
        let output = Output::new(&loaded.scene);
        let gaussians = vec![GaussianState::default(); loaded.scene.gaussians.len()];
        let mut world = pool
            .install(|| World::new(loaded.scene))
            .map_err(ReplayError::World)?;
        let begin = start.map(|start| &start.data[..]);
        if let Some(bytes) = begin.or(kept.checkpoint(run)) {
            pool.install(|| world.restore(bytes))
                .map_err(ReplayError::Checkpoint)?;
        }
        let found = world.report().step;
        if let Some(expected) = start.map(|start| start.step).filter(|step| *step != found) {
            return Err(ReplayError::CheckpointStep { found, expected });
        }
        Ok(Rerun {
            world,
            output,
            pool,
            frame_dt,
            due: VecDeque::new(),
            gaussians,
        })
    }

    /// Takes the next command of the journal.
    pub fn expect(&mut self, command: AppliedCommand) {
        self.due.push_back(command);
    }

    /// Steps made since the run's server was started.
    pub fn step(&self) -> u64 {
        self.world.report().step
    }

    /// Makes the next step, unless it is interrupted; then there is no other.
    ///
    /// # Errors
    /// When a command of it is one that this program cannot apply.
    pub fn advance(&mut self, interruption: &Interruption<'_>) -> Result<(), ReplayError> {
        let step = self.step() + 1;
        let mut commands = Vec::new();
        while let Some(applied) = self.due.pop_front_if(|c| c.step <= step) {
            commands.push(action(&applied, step)?);
        }
        let (world, frame_dt) = (&mut self.world, self.frame_dt);
        self.pool
            .install(|| world.step_unless(interruption, frame_dt, &commands));
        Ok(())
    }

    /// Report of the newest step.
    pub fn report(&self) -> &StepReport {
        self.world.report()
    }

    /// The Gaussians after the newest step, as a server would publish them.
    pub fn gaussians(&mut self) -> &[GaussianState] {
        let (world, writer, slots) = (&self.world, &mut self.output.gaussians, &mut self.gaussians);
        self.pool.install(|| {
            writer.prepare(world);
            writer.update(world, 0, slots);
        });
        &self.gaussians
    }

    /// The complete state, for a server that goes on from here.
    pub fn checkpoint(&self) -> Vec<u8> {
        self.world.checkpoint()
    }
}

/// A command of the journal as the world takes it at the start of `step`.
pub(crate) fn action(applied: &AppliedCommand, step: u64) -> Result<Command, ReplayError> {
    let command = &applied.command;
    if applied.step != step {
        let command = applied.step;
        return Err(ReplayError::LateCommand { command, step });
    }
    match order_from_wire(applied.client, command)
        .map_err(|cause| ReplayError::Command { step, cause })?
    {
        Order::World(action) => Ok(Command {
            client: applied.client,
            sequence: command.sequence,
            apply_at_step: applied.step,
            action,
        }),
        _ => Err(ReplayError::NoAction {
            step,
            kind: command.kind,
        }),
    }
}
