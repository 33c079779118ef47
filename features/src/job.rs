//! Many pictures: several at once, each on one thread. What is there already is not done again.

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
    sync::{
        Mutex,
        atomic::{AtomicBool, AtomicUsize, Ordering},
    },
    time::{Duration, Instant},
};

use cosplat_semantics::{dense, masks};

use crate::{
    FeaturesError,
    encoder::Encoder,
    network::Worker,
    picture::{Picture, is_picture},
    proposals::Proposer,
};

/// File of a folder of results that says which networks they are of.
const STAMP: &str = "networks.txt";
/// Folder for what is being written.
const PART: &str = ".part";

/// What is made of which pictures.
pub struct Job {
    /// Image encoders, each with the folder of its results.
    encoders: Vec<(Encoder, PathBuf)>,
    proposer: Option<Proposer>,
    /// Names of pictures, and their files.
    pictures: BTreeMap<String, PathBuf>,
}

/// How far a job is.
#[derive(Clone, Debug, PartialEq)]
pub enum Progress {
    /// One picture is done, alone; how long the others will take by that.
    Estimate {
        /// Pictures that are left.
        left: usize,
        /// How long they will take on all threads.
        time: Duration,
    },
    /// A picture is done.
    Done {
        /// Its name.
        name: String,
    },
}

/// What came of a job.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Summary {
    /// Pictures that were done now.
    pub done: usize,
    /// Pictures that had been done before.
    pub before: usize,
    /// Time of all networks, summed over pictures.
    pub busy: Duration,
}

impl Job {
    /// What `encoders` and `proposer`, TOML files, make of the pictures of a folder. Results of an encoder go to a folder of its
    /// file's name in `out`: maps, or masks with a vector for each where there is a proposer.
    ///
    /// # Errors
    /// When a network or the folder cannot be read, there is no picture, or two have one name.
    pub fn new(
        folder: &Path,
        encoders: &[PathBuf],
        proposer: Option<&Path>,
        out: &Path,
    ) -> Result<Self, FeaturesError> {
        let mut pictures = BTreeMap::<String, PathBuf>::new();
        let entries = std::fs::read_dir(folder).map_err(FeaturesError::read(folder))?;
        let mut files: Vec<PathBuf> = entries
            .filter_map(|entry| Some(entry.ok()?.path()))
            .filter(|path| is_picture(path))
            .collect();
        files.sort();
        for second in files {
            let name = stem(&second);
            if let Some(first) = pictures.get(&name) {
                return Err(FeaturesError::SameName {
                    first: first.clone(),
                    second,
                    name,
                });
            }
            pictures.insert(name, second);
        }
        if pictures.is_empty() {
            return Err(FeaturesError::NoPictures {
                folder: folder.to_owned(),
            });
        }
        let mut loaded = Vec::<(Encoder, PathBuf)>::new();
        for path in encoders {
            let into = out.join(stem(path));
            if loaded.iter().any(|(_, other)| *other == into) {
                let why = "another encoder has a file of this name: their results would mix";
                return Err(FeaturesError::config(path, why));
            }
            loaded.push((Encoder::load(path)?, into));
        }
        let proposer = proposer.map(Proposer::load).transpose()?;
        Ok(Self {
            encoders: loaded,
            proposer,
            pictures,
        })
    }

    /// Pictures of the job.
    pub fn len(&self) -> usize {
        self.pictures.len()
    }

    /// Whether it has none; there is no such job.
    pub fn is_empty(&self) -> bool {
        self.pictures.is_empty()
    }

    /// Does what is not done, on up to `threads` threads. `report` is told how far it is, from any of them.
    ///
    /// # Errors
    /// The first one of a picture, by time; or when results cannot be written, or the folder has those of other networks. Pictures
    /// that are done stay so.
    pub fn run(
        &self,
        threads: usize,
        report: &(impl Fn(Progress) + Sync),
    ) -> Result<Summary, FeaturesError> {
        self.prepare()?;
        let left: Vec<(&String, &PathBuf)> = self
            .pictures
            .iter()
            .filter(|(name, _)| !self.is_done(name))
            .collect();
        let mut summary = Summary {
            done: left.len(),
            before: self.pictures.len() - left.len(),
            busy: Duration::ZERO,
        };
        let Some((first, rest)) = left.split_first() else {
            return Ok(summary);
        };
        for (_, into) in &self.encoders {
            let part = into.join(PART);
            std::fs::create_dir_all(&part).map_err(FeaturesError::write(&part))?;
        }
        let one = self.one(&Worker::default(), first.0, first.1)?;
        summary.busy = one;
        report(Progress::Done {
            name: first.0.clone(),
        });
        let threads = threads.clamp(1, rest.len().max(1));
        report(Progress::Estimate {
            left: rest.len(),
            time: one.mul_f64(rest.len() as f64 / threads as f64),
        });
        summary.busy += self.others(rest, threads, report)?;
        for (_, into) in &self.encoders {
            // Empty by now.
            let part = into.join(PART);
            std::fs::remove_dir(&part).map_err(FeaturesError::write(&part))?;
        }
        Ok(summary)
    }

    /// Does the pictures after the first one; the time that they took, summed.
    fn others(
        &self,
        rest: &[(&String, &PathBuf)],
        threads: usize,
        report: &(impl Fn(Progress) + Sync),
    ) -> Result<Duration, FeaturesError> {
        let next = AtomicUsize::new(0);
        let is_over = AtomicBool::new(false);
        let busy = Mutex::new(Ok(Duration::ZERO));
        let work = || {
            let worker = Worker::default();
            while !is_over.load(Ordering::Relaxed) {
                let Some((name, path)) = rest.get(next.fetch_add(1, Ordering::Relaxed)) else {
                    return;
                };
                let outcome = self.one(&worker, name, path);
                let mut busy = busy.lock().unwrap_or_else(|poison| poison.into_inner());
                match (outcome, &mut *busy) {
                    (Ok(time), Ok(sum)) => {
                        *sum += time;
                        report(Progress::Done {
                            name: (*name).clone(),
                        });
                    }
                    (Err(error), found @ Ok(_)) => {
                        is_over.store(true, Ordering::Relaxed);
                        *found = Err(error);
                    }
                    (_, Err(_)) => {}
                }
            }
        };
        std::thread::scope(|scope| {
            for _ in 0..threads {
                scope.spawn(work);
            }
        });
        busy.into_inner()
            .unwrap_or_else(|poison| poison.into_inner())
    }

    /// Makes the folders of results; refuses those with results of other networks.
    fn prepare(&self) -> Result<(), FeaturesError> {
        for (encoder, into) in &self.encoders {
            let masks = match &self.proposer {
                Some(proposer) => format!(" with masks {:016x}", proposer.network.hash),
                None => String::new(),
            };
            let expected = format!("{:016x}{masks}", encoder.network.hash);
            std::fs::create_dir_all(into).map_err(FeaturesError::write(into))?;
            let stamp = into.join(STAMP);
            match std::fs::read_to_string(&stamp) {
                Ok(found) if found == expected => {}
                Ok(found) => {
                    return Err(FeaturesError::OtherNetwork {
                        folder: into.clone(),
                        found,
                        expected,
                    });
                }
                Err(error) if error.kind() == std::io::ErrorKind::NotFound => {
                    cosplat_files::write(&stamp, expected).map_err(FeaturesError::write(&stamp))?;
                }
                Err(error) => return Err(FeaturesError::read(&stamp)(error)),
            }
        }
        Ok(())
    }

    /// Files of a picture's results, the last one last.
    fn results(&self, name: &str) -> Vec<String> {
        match self.proposer {
            Some(_) => vec![format!("{name}_f.npy"), format!("{name}_s.npy")],
            None => vec![format!("{name}.npy")],
        }
    }

    fn is_done(&self, name: &str) -> bool {
        let files = self.results(name);
        let mut folders = self.encoders.iter();
        folders.all(|(_, into)| files.iter().all(|file| into.join(file).is_file()))
    }

    /// Does one picture: how long it took.
    fn one(&self, worker: &Worker, name: &str, path: &Path) -> Result<Duration, FeaturesError> {
        let start = Instant::now();
        let picture = Picture::read(path)?;
        let masks = self.proposer.as_ref();
        let masks = masks.map(|p| p.masks(worker, &picture)).transpose()?;
        for (encoder, into) in &self.encoders {
            let map = encoder.map(worker, &picture)?;
            let part = into.join(PART);
            match &masks {
                Some(masks) => {
                    masks::write_levels(&part, name, &masks.levels(), &masks.pooled(&map))?;
                }
                None => dense::write(&part, name, &map)?,
            }
            // Half a file of a job that was ended is not taken for a whole one.
            for file in self.results(name) {
                let to = into.join(&file);
                std::fs::rename(part.join(&file), &to).map_err(FeaturesError::write(&to))?;
            }
        }
        Ok(start.elapsed())
    }
}

fn stem(path: &Path) -> String {
    let stem = path.file_stem().unwrap_or_default();
    stem.to_string_lossy().into_owned()
}
