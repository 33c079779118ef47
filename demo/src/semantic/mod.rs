//! The paper's way from end to end: a splat of things that touch, views of it, damaged masks with vectors, objects, refinement, a
//! text that names two, materials by word, and a collision.
//!
//! Every step but the first two and the film is a command of `cosplat`, run as such; its files stay.

pub mod composed;
mod film;
mod masks;

use std::{
    path::{Path, PathBuf},
    sync::atomic::{AtomicBool, Ordering},
    time::Duration,
};

use anyhow::{Context, bail};
use cosplat_renderer::{Camera, Image, camera::Orbit, png::write_png};
use cosplat_scene::{
    assets::{self, Gaussians, ply},
    settings,
    sources::{SourceFile, SourceKind},
};
use cosplat_semantics::{
    Splat, View, neighbours::Tree, objects::Objects, refine, show, show::Picture, transforms,
};
use glam::Vec3;
use serde::Serialize;

use crate::{Progress, children::Process, run::whole_folder};
use composed::Composed;
use film::Collision;

/// Views of the splat.
const VIEWS: &str = "16";
/// Width of the pictures that refinement works on over that of the views: it takes no longer than the rest.
const REFINED_SHARE: f64 = 0.375;
/// Rounds of refinement over the views.
const ROUNDS: &str = "4";
/// A word for nothing that is there.
const ABSENT: &str = "piano";
/// Score above which an object is meant: what `docs/semantics.md` needs for made-up vectors.
const MEANT: &str = "0.8";
/// Velocity at which the first object is thrown at the second [m/s].
const THROW: [f64; 3] = [2.5, 0.6, 0.0];
/// How often the demo looks at a command.
const LOOK: Duration = Duration::from_millis(50);

/// What to show, and how.
pub struct Options<'a> {
    /// Folder for everything.
    pub folder: &'a Path,
    /// Simulated seconds of the collision.
    pub duration: f64,
    /// One round of refinement, and no Gaussian is split.
    pub is_draft: bool,
    /// Size of the views, the pictures and the video [pixel].
    pub size: (u32, u32),
}

/// Agreement of objects with what is known.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Agreement {
    /// Mean over the things of the best IoU that an object has, over all Gaussians.
    pub iou: f64,
    /// Objects found.
    pub objects: usize,
}

/// What came of the demo.
#[derive(Debug, Serialize)]
pub struct Outcome {
    /// Whether captures were found, or all is generated.
    pub captured: bool,
    /// Things in the splat.
    pub things: usize,
    /// Gaussians: of what the pictures show, of the splat at hand, and after refinement.
    pub gaussians: [usize; 3],
    /// After lifting.
    pub lifted: Agreement,
    /// After refinement.
    pub refined: Agreement,
    /// Words that were asked, with the object that has the highest score, and that score.
    pub words: Vec<(String, String, f64)>,
    /// Whether the word for nothing that is there meant an object.
    pub absent_means: bool,
    /// The collision.
    pub collision: Collision,
    /// Commands that were run, in their order.
    pub commands: Vec<String>,
    /// All pictures in one.
    pub sheet: PathBuf,
    /// The video.
    pub video: PathBuf,
    /// Folder of all files.
    pub folder: PathBuf,
}

/// A run of the demo.
struct Demo<'a> {
    folder: PathBuf,
    composed: Composed,
    camera: Camera,
    /// Gaussians of the splat at hand.
    coarse: usize,
    commands: Vec<String>,
    stop: &'a AtomicBool,
    progress: &'a Progress<'a>,
}

/// Runs the demo.
///
/// # Errors
/// When a step fails, a file cannot be read or written, or `stop` is set.
pub fn run(options: &Options, stop: &AtomicBool, progress: &Progress) -> anyhow::Result<Outcome> {
    let composed = Composed::new();
    let orbit = Orbit {
        azimuth: 0.35,
        elevation: 0.4,
        distance: Some(1.9),
        target: Some(Vec3::new(-0.05, 0.14, -0.05)),
    };
    let (width, height) = options.size;
    let everything = [Vec3::splat(-1.0), Vec3::ONE];
    let mut demo = Demo {
        folder: whole_folder(options.folder)?,
        composed,
        camera: Camera::orbit(everything, Vec3::Y, orbit, width, height),
        coarse: 0,
        commands: Vec::new(),
        stop,
        progress,
    };
    let first = demo.look_and_mask()?;
    let (lifted, lifted_picture) = demo.lift()?;
    let (refined, gaussians, refined_picture) = demo.refine(options.is_draft)?;
    let Asked {
        words,
        absent_means,
        picture: words_picture,
    } = demo.ask()?;
    let (collision, moments) = demo.collide(options.duration)?;
    let mut rows = vec![
        [first, vec![lifted_picture]].concat(),
        vec![refined_picture, words_picture],
    ];
    let mut last = Vec::new();
    for [colored, own] in moments {
        // The beginning in colours goes on with the second row.
        match rows[1].len() < 3 {
            true => rows[1].push(colored),
            false => last.extend([colored, own]),
        }
    }
    rows.push(last.into_iter().take(3).collect());
    let sheet = demo.path("sheet.png");
    let small = |row: &Vec<Image>| row.iter().map(Image::halved).collect();
    write_png(
        &sheet,
        &Image::mosaic(&rows.iter().map(small).collect::<Vec<_>>(), 2),
    )?;
    Ok(Outcome {
        captured: demo.composed.captured,
        things: demo.composed.words.len(),
        gaussians: [demo.composed.gaussians.len(), demo.coarse, gaussians],
        lifted,
        refined,
        words,
        absent_means,
        collision,
        commands: demo.commands,
        sheet,
        video: demo.folder.join("collision.mp4"),
        folder: demo.folder,
    })
}

/// What asking by words came to.
struct Asked {
    /// Word, name of the object that it means, score.
    words: Vec<(String, String, f64)>,
    /// Whether a word for nothing in the scene means an object.
    absent_means: bool,
    /// The objects that are meant, in colour.
    picture: Image,
}

impl Demo<'_> {
    fn path(&self, name: &str) -> PathBuf {
        self.folder.join(name)
    }

    /// Runs a command of this program in the folder; what it printed.
    fn command(&mut self, role: &'static str, arguments: &[&str]) -> anyhow::Result<String> {
        self.commands
            .push(format!("cosplat {}", arguments.join(" ")));
        let mut process = Process::start_in(role, &self.folder, arguments)?;
        while process.check()? {
            if self.stop.load(Ordering::Relaxed) {
                bail!("interrupted");
            }
            (self.progress)(role, 0, 0, "");
            std::thread::sleep(LOOK);
        }
        process.output()
    }

    /// The splat, its views, and masks in place of a network's; pictures of a view and of its masks.
    fn look_and_mask(&mut self) -> anyhow::Result<Vec<Image>> {
        let coarse = self.composed.coarse();
        self.coarse = coarse.len();
        for (name, gaussians) in [
            ("things.ply", &self.composed.gaussians),
            ("splat.ply", &coarse),
        ] {
            let path = self.path(name);
            cosplat_files::write(&path, ply::write(gaussians))
                .with_context(|| format!("cannot write {}", path.display()))?;
        }
        let views = [
            "views",
            "things.ply",
            "--out",
            "views",
            "--up=+y",
            "--count",
            VIEWS,
        ];
        let size = format!("{}x{}", self.camera.width, self.camera.height);
        self.command("views", &[&views[..], &["--size", &size]].concat())?;
        let views = transforms::read(&self.path("views/transforms.json"), None)?;
        let shown = masks::write(&self.composed, &views, &self.folder, |n| {
            (self.progress)("masks", n as u64, views.len() as u64, "");
        })?;
        let (width, height) = (self.camera.width, self.camera.height);
        let view = views.iter().find(|view| view.name == shown.0);
        let picture = self.seen(view.context("no view was made")?)?;
        Ok(vec![
            scaled(&picture, width, height),
            scaled(&shown.1, width, height),
        ])
    }

    /// The picture of a view.
    fn seen(&self, view: &View) -> anyhow::Result<Image> {
        let path = self.path(&format!("views/images/{}.png", view.name));
        let levels = refine::picture(&path, view, [1.0; 3])?;
        let pixels = levels.len() / 3;
        let byte = |n: usize| (levels[n % 3 * pixels + n / 3] * 255.0).round() as u8;
        Ok(Image {
            width: view.camera.width,
            height: view.camera.height,
            rgb: (0..levels.len()).map(byte).collect(),
        })
    }

    fn lift(&mut self) -> anyhow::Result<(Agreement, Image)> {
        let line = ["lift", "splat.ply", "--views", "views", "--masks", "masks"];
        self.command("lift", &line)?;
        let (gaussians, objects) = self.objects("splat")?;
        let agreement = self.agreement(&gaussians, &objects);
        let picture = self.picture("objects_lifted.png", &gaussians, &objects.labels.object)?;
        Ok((agreement, picture))
    }

    fn refine(&mut self, is_draft: bool) -> anyhow::Result<(Agreement, usize, Image)> {
        let line = [
            "refine",
            "splat.ply",
            "--views",
            "views",
            "--images",
            "views/images",
        ];
        let more = ["--masks", "masks", "--objects", "splat.objects.safetensors"];
        let size = ((REFINED_SHARE * f64::from(self.camera.width)) as u32).max(16);
        let size = size.to_string();
        let end = ["--size", &size, "--out", "refined.ply", "--rounds"];
        let rounds: &[&str] = if is_draft {
            &["1", "--no-split"]
        } else {
            &[ROUNDS]
        };
        self.command("refine", &[&line[..], &more, &end, rounds].concat())?;
        let (gaussians, objects) = self.objects("refined")?;
        let agreement = self.agreement(&gaussians, &objects);
        let picture = self.picture("objects_refined.png", &gaussians, &objects.labels.object)?;
        Ok((agreement, gaussians.len(), picture))
    }

    /// Which objects two words mean; these get them for names.
    fn ask(&mut self) -> anyhow::Result<Asked> {
        let [first, second] = self.composed.asked;
        let find = |word: &'static str| {
            let line = [
                "objects",
                "find",
                "refined.ply",
                "--words",
                "words.safetensors",
            ];
            [
                &line[..],
                &[
                    "--threshold",
                    MEANT,
                    "--contrast",
                    "0",
                    "--json",
                    "--word",
                    word,
                ],
            ]
            .concat()
        };
        let absent = self.command("find", &find(ABSENT))?;
        let absent: serde_json::Value = serde_json::from_str(&absent)?;
        let absent_means = absent["objects"][0]["meant"] == true;
        let mut words = Vec::new();
        for word in [first, second] {
            let told = self.command("find", &[&find(word)[..], &["--rename"]].concat())?;
            let told: serde_json::Value = serde_json::from_str(&told)?;
            let Some(name) = told["renamed"].as_str() else {
                bail!("no object is meant by {word:?}: {told}");
            };
            let mut scored = told["objects"].as_array().into_iter().flatten();
            let score = scored.find(|o| o["name"] == name);
            let score = score.and_then(|o| o["score"].as_f64()).unwrap_or(0.0);
            words.push((word.to_owned(), name.to_owned(), score));
        }
        let (gaussians, objects) = self.objects("refined")?;
        let number = |name: &String| [first, second].iter().position(|w| w == name);
        let asked = |object: usize| number(&objects.names[objects.root_of(object)]);
        let of = |o: &i32| {
            usize::try_from(*o)
                .ok()
                .and_then(asked)
                .map_or(-1, |n| n as i32)
        };
        let object: Vec<i32> = objects.labels.object.iter().map(of).collect();
        let picture = self.picture("objects_asked.png", &gaussians, &object)?;
        Ok(Asked {
            words,
            absent_means,
            picture,
        })
    }

    /// Materials by word make a scene; the first object is thrown at the second.
    fn collide(&mut self, duration: f64) -> anyhow::Result<(Collision, Vec<[Image; 2]>)> {
        let line = [
            "objects",
            "materials",
            "refined.ply",
            "--scene",
            "scene.toml",
        ];
        let shown = self.command("materials", &line)?;
        cosplat_files::write(&self.path("materials.txt"), shown)
            .context("cannot write materials.txt")?;
        let scene = self.path("scene.toml");
        let text = std::fs::read_to_string(&scene)
            .with_context(|| format!("cannot read {}", scene.display()))?;
        let first = format!("name = {:?}", self.composed.asked[0]);
        let before = text.split("[[objects]]").skip(1);
        let number = before.take_while(|part| !part.contains(&first)).count();
        let [x, y, z] = THROW;
        let throw = format!("objects.{number}.linear_velocity=[{x:?}, {y:?}, {z:?}]");
        let text = settings::apply(&text, &[throw])?;
        film::collide(
            text,
            &self.path("collision.toml"),
            &self.path("collision.mp4"),
            &self.camera,
            duration,
            self.stop,
            self.progress,
        )
    }

    /// A splat of the folder and its objects.
    fn objects(&self, name: &str) -> anyhow::Result<(Gaussians, Objects)> {
        let path = self.path(&format!("{name}.ply"));
        let bytes =
            std::fs::read(&path).with_context(|| format!("cannot read {}", path.display()))?;
        let file = format!("{name}.ply");
        let (gaussians, found) = assets::read(&file, &bytes)?;
        let hash = SourceFile::of(SourceKind::Asset, &file, &path, &bytes).hash;
        let objects = self.path(&format!("{name}.objects.safetensors"));
        let objects = Objects::read(&objects, hash, found.count)?;
        Ok((gaussians, objects.subset(&found.rows())))
    }

    /// How far objects are what is known; what was split is of what was nearest.
    fn agreement(&self, gaussians: &Gaussians, objects: &Objects) -> Agreement {
        let points: Vec<Vec3> = (self.composed.gaussians.position.iter())
            .map(|p| Vec3::from(*p))
            .collect();
        let tree = Tree::new(&points);
        let nearest = |p: &[f32; 3]| {
            let found = tree.nearest(Vec3::from(*p), 1, &|_| true);
            found
                .first()
                .map_or(-1, |f| self.composed.truth[f.1 as usize])
        };
        let truth: Vec<i32> = gaussians.position.iter().map(nearest).collect();
        let iou = |thing: i32, object: i32| {
            let pairs = truth.iter().zip(&objects.labels.object);
            let (both, either) = pairs.fold((0usize, 0usize), |(both, either), (t, o)| {
                let (t, o) = (*t == thing, *o == object);
                (both + usize::from(t && o), either + usize::from(t || o))
            });
            both as f64 / either.max(1) as f64
        };
        let count = objects.names.len() as i32;
        let best = |thing: i32| (0..count).map(|o| iou(thing, o)).fold(0.0, f64::max);
        let things = self.composed.words.len() as i32;
        Agreement {
            iou: (0..things).map(best).sum::<f64>() / f64::from(things),
            objects: objects.names.len(),
        }
    }

    fn picture(&self, name: &str, gaussians: &Gaussians, object: &[i32]) -> anyhow::Result<Image> {
        let drawn = show::picture(&Splat::from(gaussians), object, &self.camera);
        drawn.write(&self.path(name))?;
        Ok(image(drawn))
    }
}

fn image(picture: Picture) -> Image {
    Image {
        width: picture.width as u32,
        height: picture.height as u32,
        rgb: picture.rgb.into_flattened(),
    }
}

/// The picture at another size: the pixel that each centre falls into.
fn scaled(picture: &Image, width: u32, height: u32) -> Image {
    let at = |k: u32, from: u32, to: u32| (2 * k + 1) * from / (2 * to);
    let pixel = |n: u32| {
        let (x, y) = (
            at(n % width, picture.width, width),
            at(n / width, picture.height, height),
        );
        picture.pixel(x, y).unwrap_or([255; 3])
    };
    Image {
        width,
        height,
        rgb: (0..width * height).flat_map(pixel).collect(),
    }
}

impl Outcome {
    /// The same for people.
    pub fn sentence(&self) -> String {
        let mut text = String::new();
        for command in &self.commands {
            text.push_str(&format!("{command}\n"));
        }
        let kind = if self.captured {
            "captures"
        } else {
            "generated"
        };
        text.push_str(&format!(
            "{} things that touch ({kind}), {} Gaussians in the pictures, {} in the splat, {} after refinement\n",
            self.things, self.gaussians[0], self.gaussians[1], self.gaussians[2]
        ));
        for (what, found) in [("lifted", &self.lifted), ("refined", &self.refined)] {
            text.push_str(&format!(
                "{what}: {} objects, mean IoU {:.4} with what is known\n",
                found.objects, found.iou
            ));
        }
        for (word, object, score) in &self.words {
            text.push_str(&format!("{word:?} means {object}, score {score:.3}\n"));
        }
        let meaning = if self.absent_means {
            "an object"
        } else {
            "none"
        };
        text.push_str(&format!(
            "{ABSENT:?}, which is not there, means {meaning}\n"
        ));
        let shown = |v: &[f64; 3]| v.map(|x| format!("{x:.2}")).join(" ");
        for moved in &self.collision.objects {
            text.push_str(&format!(
                "{} of {}: {} -> {} m/s, came {:.3} m\n",
                moved.name,
                moved.material,
                shown(&moved.velocity[0]),
                shown(&moved.velocity[1]),
                moved.distance,
            ));
        }
        for impact in &self.collision.impacts {
            let [a, b] = &impact.names;
            text.push_str(&format!(
                "{a} against {b}: {:.2} N s, {:.2} -> {:.2} m/s\n",
                impact.impulse, impact.speed[0], impact.speed[1]
            ));
        }
        text + &format!(
            "all files {}\nsheet {}\nvideo {}",
            self.folder.display(),
            self.sheet.display(),
            self.video.display()
        )
    }
}
