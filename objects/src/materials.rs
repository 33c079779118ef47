//! `cosplat objects materials`: what objects are made of, by the words for them, shown before it is used.

use std::{
    collections::BTreeMap,
    fmt::Write,
    path::{Path, PathBuf},
};

use anyhow::{Context, bail, ensure};
use cosplat_files::reading;
use cosplat_matter::materials::Material;
use cosplat_scene::scene_file::{Axis, SceneFile, WORDS, WordTable, keeps_shape, material_text};
use cosplat_semantics::{ground::Ground, objects::Objects, tree::SURE};
use glam::{DQuat, DVec3, Vec3};

use crate::prepared::{Prepared, axis_name};
use cosplat_console::say;

use crate::lift::load;

/// Say what objects are made of, by the words for them: a table that may be edited. Nothing is used before it is shown; `--scene`
/// writes a scene file with these materials by name, to read and change before it runs.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// The splat (.ply or .splat); without one, the whole table is shown.
    splat: Option<PathBuf>,
    /// Its file of objects [default: beside the splat, `NAME.objects.safetensors`].
    #[arg(long, value_name = "FILE")]
    objects: Option<PathBuf>,
    /// Table of words in place of the one that comes with cosplat.
    #[arg(long, value_name = "FILE.toml")]
    table: Option<PathBuf>,
    /// The word for an object whose name is none: `NAME=WORD`.
    #[arg(long, value_name = "NAME=WORD", num_args = 1..)]
    word: Vec<String>,
    /// Scene file to write: objects with a material move, the rest stays as it is.
    #[arg(long, value_name = "OUT.toml", requires = "splat")]
    scene: Option<PathBuf>,
    /// Metres per unit of the splat, for the scene.
    #[arg(long, default_value_t = 1.0, value_name = "S")]
    scale: f64,
    /// Write the table that comes with cosplat, to edit.
    #[arg(long, value_name = "FILE.toml")]
    write_table: Option<PathBuf>,
    /// Print one JSON object.
    #[arg(long)]
    json: bool,
}

/// What an object is made of.
struct Made<'t> {
    object: String,
    word: &'t str,
    material: &'t Material,
}

/// Runs the command.
///
/// # Errors
/// When a file cannot be read or written, or a word is not in the table.
pub(crate) fn run(args: &Args) -> anyhow::Result<()> {
    ensure!(
        (1e-6..=1e6).contains(&args.scale),
        "--scale is {}, expected 1e-6 to 1e6",
        args.scale
    );
    if let Some(path) = &args.write_table {
        cosplat_files::write(path, WORDS)
            .with_context(|| format!("cannot write {}", path.display()))?;
        say!("the table of words is in {}", path.display())?;
    }
    let table = table(args.table.as_deref())?;
    let Some(splat) = &args.splat else {
        return match args.write_table {
            Some(_) => Ok(()),
            None => whole(&table, args.json),
        };
    };
    let (_, found, hash) = load(splat)?;
    let path = args.objects.clone();
    let path = path.unwrap_or_else(|| splat.with_extension("objects.safetensors"));
    let objects = Objects::read(&path, hash, found.count)?;
    let words = words(&args.word, &objects)?;
    let (mut made, mut unknown) = (Vec::new(), Vec::new());
    let is_whole = |n: &usize| objects.parent_of(*n).is_none() && !objects.names[*n].is_empty();
    for name in (0..objects.names.len())
        .filter(is_whole)
        .map(|n| &objects.names[n])
    {
        let said = words.get(name.as_str());
        match (table.of(said.unwrap_or(&name.as_str())), said) {
            (Some((word, material)), _) => made.push(Made {
                object: name.clone(),
                word,
                material,
            }),
            (None, Some(word)) => {
                bail!("the table has no word for {word:?}, which {name} is to be")
            }
            (None, None) => unknown.push(name.as_str()),
        }
    }
    show(&table, &made, &unknown, args.json)?;
    let Some(scene) = &args.scene else {
        return Ok(());
    };
    cosplat_files::keep_apart(scene, [splat, &path].into_iter().chain(&args.table))?;
    ensure!(
        !made.is_empty(),
        "no object has a material: name them by --word NAME=WORD"
    );
    let prepared = Prepared::read(splat)?;
    let text = scene_text(args, &prepared, &path, &made)?;
    // What is written is a scene file, whatever the names are.
    SceneFile::parse(&text).context("the scene would be none")?;
    cosplat_files::write(scene, text)
        .with_context(|| format!("cannot write {}", scene.display()))?;
    match args.json {
        true => Ok(()),
        false => say!("scene with these materials by name: {}", scene.display()),
    }
}

fn table(path: Option<&Path>) -> anyhow::Result<WordTable> {
    let Some(path) = path else {
        return Ok(WordTable::builtin());
    };
    let text =
        reading::read_text(path).with_context(|| format!("cannot read {}", path.display()))?;
    WordTable::parse(&text).with_context(|| format!("{} is no table of words", path.display()))
}

/// Words that were given for objects, by name.
fn words<'a>(given: &'a [String], objects: &Objects) -> anyhow::Result<BTreeMap<&'a str, &'a str>> {
    let of = |text: &'a String| {
        let parts = text
            .rsplit_once('=')
            .filter(|(a, b)| !a.is_empty() && !b.is_empty());
        let (name, word) =
            parts.with_context(|| format!("--word is {text:?}, expected NAME=WORD"))?;
        ensure!(
            objects.names.iter().any(|n| n == name),
            "--word is {text:?}: object {name:?} does not exist, expected one of {}",
            objects.names.join(", ")
        );
        Ok((name, word))
    };
    given.iter().map(of).collect()
}

fn stiffness(material: &Material) -> String {
    match material.law.entry().elastic {
        true => format!(
            "E {:.1e} Pa, nu {:.2}",
            material.youngs_modulus, material.poisson_ratio
        ),
        false => material.law.entry().name.to_owned(),
    }
}

fn moves_as(material: &Material) -> &'static str {
    match keeps_shape(material) {
        true => "one body",
        false => "matter",
    }
}

fn whole(table: &WordTable, json: bool) -> anyhow::Result<()> {
    let made: Vec<Made> = table
        .words
        .iter()
        .map(|(word, material)| Made {
            object: String::new(),
            word,
            material,
        })
        .collect();
    show(table, &made, &[], json)
}

fn show(table: &WordTable, made: &[Made], unknown: &[&str], json: bool) -> anyhow::Result<()> {
    if json {
        let all = made.iter().map(|m| {
            serde_json::json!({
                "object": m.object, "word": m.word, "material": m.material.name, "law": m.material.law.entry().name,
                "density_kg_m3": m.material.density, "youngs_modulus_pa": m.material.youngs_modulus,
                "poisson_ratio": m.material.poisson_ratio, "moves_as": moves_as(m.material),
                "source": table.source(m.material),
            })
        });
        return say!(
            "{}",
            serde_json::json!({ "materials": all.collect::<Vec<_>>(), "without_word": unknown })
        );
    }
    for Made {
        object,
        word,
        material,
    } in made
    {
        let object = match object.is_empty() {
            true => String::new(),
            false => format!("{object:16}  "),
        };
        say!(
            "{object}{word:10} {:12} {:6.0} kg/m^3  {:22}  moves as {:8}  {}",
            material.name,
            material.density,
            stiffness(material),
            moves_as(material),
            table.source(material)
        )?;
    }
    for name in unknown {
        say!("{name:16}  no word of the table: --word {name}=WORD, or it stays as it is")?;
    }
    Ok(())
}

fn axis_of(up: Vec3) -> Axis {
    match axis_name(up).as_str() {
        "+x" => Axis::X,
        "-x" => Axis::NegX,
        "-y" => Axis::NegY,
        "+z" => Axis::Z,
        "-z" => Axis::NegZ,
        _ => Axis::Y,
    }
}

/// Placement that brings the ground to y = 0, level; `none` as in the file where no ground is sure.
fn placement(ground: Option<Ground>, scale: f64) -> String {
    let Some(ground) = ground.filter(|g| g.confidence >= SURE) else {
        return format!(
            "# No ground was found: which way is up is a guess.\nup = \"-y\"\nscale = {scale:?}\n"
        );
    };
    let axis = ground.axis().0;
    let up = axis_of(axis).to_world_up() * ground.up.as_dvec3();
    let [x, y, z, w] = DQuat::from_rotation_arc(up.normalize(), DVec3::Y).to_array();
    let lift = -scale * f64::from(ground.offset);
    format!(
        "# The ground, found with confidence {:.2}, lies in y = 0.\nup = \"{}\"\nscale = {scale:?}\n\
         rotation_xyzw = [{x:?}, {y:?}, {z:?}, {w:?}]\ntranslation = [0, {lift:?}, 0]\n",
        ground.confidence,
        axis_name(axis)
    )
}

/// A path as the scene file has it: relative to its folder where both are in one, else whole.
fn beside(scene: &Path, path: &Path) -> anyhow::Result<String> {
    let whole = path
        .canonicalize()
        .with_context(|| format!("cannot find {}", path.display()))?;
    let folder = match scene.parent() {
        Some(folder) if folder != Path::new("") => folder,
        _ => Path::new("."),
    };
    let folder = folder
        .canonicalize()
        .with_context(|| format!("cannot find {}", folder.display()))?;
    let shown = whole.strip_prefix(&folder).unwrap_or(&whole);
    let text = shown.to_str();
    Ok(text
        .with_context(|| format!("{} is not UTF-8, rename it", shown.display()))?
        .to_owned())
}

/// A basic string of TOML.
fn quoted(text: &str) -> String {
    let mut quoted = String::from("\"");
    for c in text.chars() {
        match c {
            '"' | '\\' => quoted.extend(['\\', c]),
            c if c.is_control() => {
                let _ = write!(quoted, "\\u{:04x}", u32::from(c));
            }
            c => quoted.push(c),
        }
    }
    quoted.push('"');
    quoted
}

fn scene_text(
    args: &Args,
    prepared: &Prepared,
    objects: &Path,
    made: &[Made],
) -> anyhow::Result<String> {
    let scene = args.scene.as_deref().unwrap_or(Path::new("scene.toml"));
    let path = quoted(&beside(scene, &prepared.path)?);
    let objects = quoted(&beside(scene, objects)?);
    let mut text = "# Written by `cosplat objects materials`: materials are guesses by word, to be read and changed.\n\
                    version = 1\nname = \"objects by word\"\n"
        .to_owned();
    let used: BTreeMap<&str, &Made> = made.iter().map(|m| (m.material.name.as_str(), m)).collect();
    let table = table(args.table.as_deref())?;
    for (name, made) in used {
        let source = table.source(made.material);
        let _ = write!(
            text,
            "\n# {source}\n[materials.{}]\n{}",
            quoted(name),
            material_text(made.material)
        );
    }
    let _ = write!(
        text,
        "\n[[assets]]\nname = \"splat\"\npath = {path}\nobjects = {objects}\n{}",
        placement(prepared.tree.ground, args.scale)
    );
    for Made {
        object,
        word,
        material,
    } in made
    {
        let (name, material_name) = (quoted(object), quoted(&material.name));
        let _ = write!(
            text,
            "\n# {word}\n[[objects]]\nname = {name}\nasset = \"splat\"\nselect = {{ names = [{name}] }}\n\
             material = {material_name}\n"
        );
        if keeps_shape(material) && !material.law.is_rigid() {
            text.push_str("fidelity = \"rigid\"\n");
        }
    }
    text.push_str(
        "\n[[objects]]\nname = \"rest of the splat\"\nasset = \"splat\"\nselect = { rest = true }\nfidelity = \"static\"\n\
         \n[[colliders]]\nname = \"floor\"\npoint = [0, 0, 0]\nnormal = [0, 1, 0]\nsurface = \"separate\"\nfriction = 0.5\n",
    );
    Ok(text)
}
