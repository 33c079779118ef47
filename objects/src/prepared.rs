//! A splat with its tree, and objects of it as they are written and told.

use std::{
    path::{Path, PathBuf},
    time::Instant,
};

use anyhow::Context;
use cosplat_console::say;
use cosplat_renderer::camera::{Camera, Orbit};
use cosplat_semantics::{Splat, lift::Labels, objects::Objects, show, tree::Tree};
use glam::Vec3;

use crate::lift::load;

#[derive(Clone, clap::Args)]
pub(crate) struct Output {
    /// File of objects [default: beside the splat, `NAME.objects.safetensors`].
    #[arg(short, long, value_name = "FILE")]
    pub(crate) out: Option<PathBuf>,
    /// Picture of the objects in colours with their names.
    #[arg(long, value_name = "FILE.png")]
    pub(crate) picture: Option<PathBuf>,
    /// Print one JSON object.
    #[arg(long)]
    pub(crate) json: bool,
}

/// A splat with its tree.
pub(crate) struct Prepared {
    pub(crate) path: PathBuf,
    pub(crate) splat: Splat,
    pub(crate) hash: u64,
    rows: Vec<usize>,
    count: usize,
    pub(crate) tree: Tree,
    /// Degree of the harmonics, and these.
    pub(crate) sh: (u32, Vec<f32>),
    /// When all of it was there.
    ready: Instant,
}

fn tree_file(splat: &Path) -> PathBuf {
    splat.with_extension("tree.safetensors")
}

impl Prepared {
    /// The splat, with the tree that `tree` makes or reads of it and its hash.
    fn with(
        path: &Path,
        tree: impl FnOnce(&Splat, u64) -> anyhow::Result<Tree>,
    ) -> anyhow::Result<Self> {
        let (gaussians, found, hash) = load(path)?;
        let splat = Splat::from(&gaussians);
        let tree = tree(&splat, hash)?;
        Ok(Prepared {
            path: path.to_owned(),
            splat,
            hash,
            rows: found.rows(),
            count: found.count,
            tree,
            sh: (gaussians.sh_degree.into(), gaussians.sh),
            ready: Instant::now(),
        })
    }

    /// The splat and a tree made anew, which is kept beside it.
    pub(crate) fn make(path: &Path) -> anyhow::Result<Self> {
        Self::with(path, |splat, hash| {
            let tree = Tree::new(splat);
            tree.write(&tree_file(path), hash)?;
            Ok(tree)
        })
    }

    /// The splat and the tree that `cosplat objects tree` kept; makes it where there is none.
    pub(crate) fn read(path: &Path) -> anyhow::Result<Self> {
        let kept = tree_file(path);
        if !kept.is_file() {
            return Self::make(path);
        }
        Self::with(path, |splat, hash| {
            Tree::read(&kept, hash, splat.len())
                .context("a splat that has changed needs `cosplat objects tree` again")
        })
    }

    /// The axis that points up in pictures.
    pub(crate) fn up(&self) -> Vec3 {
        self.tree.ground.map_or(Vec3::NEG_Y, |g| g.axis().0)
    }

    pub(crate) fn picture(
        &self,
        path: &Path,
        object: &[i32],
        names: &[String],
    ) -> anyhow::Result<()> {
        cosplat_files::keep_apart(path, [&self.path])?;
        let camera = Camera::orbit(self.splat.bounds(), self.up(), Orbit::default(), 960, 720);
        let mut picture = show::picture(&self.splat, object, &camera);
        let entries = names.iter().enumerate();
        let entries: Vec<_> = entries
            .map(|(n, name)| (show::color(n as i32), name.clone()))
            .collect();
        picture.add_legend(&entries);
        Ok(picture.write(path)?)
    }

    /// Writes objects: the file, what is in it, and how many Gaussians each has.
    pub(crate) fn write(
        &self,
        output: &Output,
        found: Found,
    ) -> anyhow::Result<(PathBuf, Objects, Vec<usize>)> {
        let out = output
            .out
            .clone()
            .unwrap_or_else(|| self.path.with_extension("objects.safetensors"));
        cosplat_files::keep_apart(&out, [&self.path])?;
        if let Some(path) = &output.picture {
            self.picture(path, &found.labels.object, &found.names)?;
        }
        let sizes = found.sizes();
        let objects = Objects {
            asset_hash: self.hash,
            names: found.names,
            parent: found.parent,
            labels: found.labels,
            made: found.made,
            ..Objects::default()
        };
        objects.clone().spread(&self.rows, self.count).write(&out)?;
        Ok((out, objects, sizes))
    }

    /// Writes objects and says what they are.
    pub(crate) fn finish(
        &self,
        output: &Output,
        found: Found,
        since: Instant,
    ) -> anyhow::Result<()> {
        let (out, objects, sizes) = self.write(output, found)?;
        let seconds = since.elapsed().as_secs_f64();
        let answer = self.ready.elapsed().as_secs_f64();
        if output.json {
            let all = objects.names.iter().zip(&sizes);
            let all: Vec<_> = all
                .map(|(name, size)| serde_json::json!({ "name": name, "gaussians": size }))
                .collect();
            let ground = self.tree.ground.map(|g| {
                serde_json::json!({
                    "up": g.up.to_array(), "gravity": (-9.81 * g.up).to_array(), "axis": axis_name(g.axis().0),
                    "tilt_deg": g.axis().1.to_degrees(), "offset": g.offset, "confidence": g.confidence,
                })
            });
            return say!(
                "{}",
                serde_json::json!({
                    "file": out, "objects": all, "ground": ground, "superpoints": self.tree.size.len(), "seconds": seconds,
                    "answer_seconds": answer,
                })
            );
        }
        for (name, size) in objects.names.iter().zip(&sizes) {
            say!("{size:9} Gaussians  {name}")?;
        }
        say!("{}", self.ground_sentence())?;
        say!(
            "{} superpoints; {seconds:.2} s, of which {answer:.2} s after the splat and its tree were there; {}",
            self.tree.size.len(),
            out.display()
        )
    }

    fn ground_sentence(&self) -> String {
        let Some(ground) = self.tree.ground else {
            return "no ground was found".to_owned();
        };
        let (axis, tilt) = ground.axis();
        let [x, y, z] = (-9.81 * ground.up).to_array();
        format!(
            "ground with confidence {:.2}: up = \"{}\" (off by {:.1} degrees), gravity = [{x:.3}, {y:.3}, {z:.3}] m/s^2 in the frame of the splat",
            ground.confidence,
            axis_name(axis),
            tilt.to_degrees()
        )
    }
}

/// Objects as they are written.
pub(crate) struct Found {
    pub(crate) names: Vec<String>,
    pub(crate) parent: Vec<i32>,
    pub(crate) labels: Labels,
    pub(crate) made: String,
}

impl Found {
    /// Gaussians of each object.
    pub(crate) fn sizes(&self) -> Vec<usize> {
        let mut sizes = vec![0; self.names.len()];
        for object in &self.labels.object {
            if let Some(size) = usize::try_from(*object).ok().and_then(|n| sizes.get_mut(n)) {
                *size += 1;
            }
        }
        sizes
    }
}

pub(crate) fn axis_name(axis: Vec3) -> String {
    let most = axis.abs().max_position();
    let sign = if axis[most] < 0.0 { '-' } else { '+' };
    format!("{sign}{}", ['x', 'y', 'z'][most])
}
