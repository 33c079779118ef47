//! A recorded run, simulated again from the recording alone.

use std::{
    collections::{BTreeMap, VecDeque},
    path::{Path, PathBuf},
    sync::Arc,
};

use anyhow::{Context, anyhow, bail, ensure};
use cosplat_ipc::schema::{AppliedCommand, GaussianState};
use cosplat_recorder::{
    chunks::Chunks,
    reader::Event,
    runs::{FileKind, Lack, RunHeader},
    topics::{FILES_PREFIX, RUN_METADATA, SCENE_TOML},
};
use cosplat_scene::{
    load::{LoadedScene, load_held},
    sources::HeldFile,
};
use cosplat_server::{
    convert::{Order, order_from_wire},
    publish::{Output, SceneBuffers},
};
use cosplat_sim_core::{Command, StepReport, World};

/// What a recording keeps to simulate its runs again.
#[derive(Default)]
pub struct Kept {
    /// Scene texts, by scene hash.
    texts: BTreeMap<u64, Vec<u8>>,
    /// Files, by attachment.
    files: BTreeMap<String, Arc<[u8]>>,
}

impl Kept {
    /// Keeps an attachment that follows the metadata of a run, if it is one of those that are needed.
    pub fn attachment(&mut self, run: &RunHeader, name: String, data: Vec<u8>) {
        if name == SCENE_TOML {
            self.texts.insert(run.scene.scene_hash, data);
        } else if name.starts_with(FILES_PREFIX) {
            self.files.insert(name, data.into());
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
    ) -> anyhow::Result<LoadedScene> {
        if let Some(lack) = self.lacks(run).into_iter().next() {
            return Err(lack.into());
        }
        let text = &self.texts[&run.scene.scene_hash];
        let text = String::from_utf8(text.clone()).context("its scene.toml is no text")?;
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
        Ok(load_held(text, &recording.join(SCENE_TOML), &held)?)
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

/// Finds run number `number` of a recording, counted from 1, or the only one.
///
/// # Errors
/// When there is no such run, or several and none is named, or the recording cannot be read.
pub fn take(chunks: &mut Chunks, path: &Path, number: Option<usize>) -> anyhow::Result<Take> {
    let mut headers = Vec::new();
    let mut kept = Kept::default();
    // The scene of a run is attached where its hash is new.
    let mut scenes: BTreeMap<u64, BTreeMap<String, Vec<u8>>> = BTreeMap::new();
    for event in chunks.matter()? {
        match event {
            Event::Metadata { name, values } if name == RUN_METADATA => {
                let header = RunHeader::parse(&values).map_err(|reason| anyhow!(reason))?;
                headers.push(header);
            }
            Event::Attachment { name, data } => {
                let Some(header) = headers.last() else {
                    continue;
                };
                if name.starts_with("scene/") {
                    let scene = scenes.entry(header.scene.scene_hash).or_default();
                    scene.insert(name, data);
                } else {
                    kept.attachment(header, name, data);
                }
            }
            _ => {}
        }
    }
    let (path, count) = (path.display(), headers.len());
    ensure!(count > 0, "{path} holds no run of a server");
    let number = match number {
        None if count > 1 => bail!("{path} holds {count} runs, choose one with --run 1 to {count}"),
        number => number.unwrap_or(1),
    };
    ensure!(
        (1..=count).contains(&number),
        "{path} has no run {number}, expected 1 to {count}"
    );
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
    /// The run at its start, on `threads` threads, 0 for one per core.
    ///
    /// # Errors
    /// When the recording lacks something, or what it has makes no scene, or another one than was recorded.
    pub fn begin(
        kept: &Kept,
        run: &RunHeader,
        recording: &Path,
        threads: usize,
    ) -> anyhow::Result<Rerun> {
        let loaded = kept.scene(run, recording, |name| recording.join(name))?;
        let built = SceneBuffers::new(&loaded).blocks(&loaded).header.scene_hash;
        ensure!(
            built == run.scene.scene_hash,
            "its scene makes another one now: hash {built:016x}, expected {:016x}",
            run.scene.scene_hash
        );
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .with_context(|| format!("cannot start {threads} threads"))?;
        let frame_dt = 1.0 / loaded.scene.frame_rate;
        let output = Output::new(&loaded.scene);
        let gaussians = vec![GaussianState::default(); loaded.scene.gaussians.len()];
        let mut world = pool
            .install(|| World::new(loaded.scene))
            .context("its scene cannot be simulated")?;
        if let Some(bytes) = kept.checkpoint(run) {
            pool.install(|| world.restore(bytes))
                .context("the checkpoint that it began with cannot be restored")?;
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

    /// Makes the next step.
    ///
    /// # Errors
    /// When a command of it is one that this program cannot apply.
    pub fn advance(&mut self) -> anyhow::Result<()> {
        let step = self.step() + 1;
        let mut commands = Vec::new();
        while let Some(applied) = self.due.pop_front_if(|c| c.step <= step) {
            commands.push(action(&applied, step)?);
        }
        let (world, frame_dt) = (&mut self.world, self.frame_dt);
        self.pool.install(|| world.step(frame_dt, &commands));
        Ok(())
    }

    /// Report of the newest step.
    pub fn report(&self) -> &StepReport {
        self.world.report()
    }

    /// The Gaussians after the newest step, as a server would publish them.
    pub fn gaussians(&mut self) -> &[GaussianState] {
        let (world, output, slots) = (&self.world, &self.output, &mut self.gaussians);
        self.pool.install(|| output.write_frame(world, slots));
        &self.gaussians
    }

    /// The complete state, for a server that goes on from here.
    pub fn checkpoint(&self) -> Vec<u8> {
        self.world.checkpoint()
    }
}

/// A command of the journal as the world takes it at the start of `step`.
fn action(applied: &AppliedCommand, step: u64) -> anyhow::Result<Command> {
    let command = &applied.command;
    ensure!(
        applied.step == step,
        "a command of step {} comes after that step in the journal",
        applied.step
    );
    match order_from_wire(command).with_context(|| format!("in the journal of step {step}"))? {
        Order::World(action) => Ok(Command {
            client: applied.client,
            sequence: command.sequence,
            apply_at_step: applied.step,
            action,
        }),
        _ => bail!(
            "the journal of step {step} has a command of kind {}, which changes no world",
            command.kind
        ),
    }
}
