//! `cosplat views` and `cosplat lift`: from pictures of a splat and their masks to a label for every Gaussian.

use std::path::{Path, PathBuf};

use anyhow::{Context, ensure};
use cosplat_console::{output::plain, progress, say, size::size};
use cosplat_files::reading;
use cosplat_ipc::schema::GaussianState;
use cosplat_renderer::{Harmonics, drawing::BACKGROUND, picture, png::write_png};
use cosplat_scene::{
    assets::{Gaussians, ReadReport, ply, read},
    sources::{SourceFile, SourceKind},
};
use cosplat_semantics::{
    Evidence, MaskMap, SemanticsError, Splat, View, colmap, dense, evidence,
    grouping::group,
    lift::{Labels, lift},
    masks,
    objects::{Objects, Vectors},
    query::Means,
    transforms,
    views::spiral,
};
use glam::Vec3;

/// Draw pictures of a splat from all around, with their cameras, for a program that makes masks of pictures.
#[derive(clap::Args)]
pub struct ViewsArgs {
    /// The splat (.ply or .splat).
    splat: PathBuf,
    /// Folder for `transforms.json` and `images/`.
    #[arg(short, long, value_name = "DIR")]
    out: PathBuf,
    /// Pictures.
    #[arg(long, default_value_t = 24, value_parser = clap::value_parser!(u32).range(1..=10_000))]
    count: u32,
    /// Size of a picture.
    #[arg(long, default_value = "640x480", value_name = "WxH", value_parser = size)]
    size: (u32, u32),
    /// Up axis of the splat: +x -x +y -y +z -z.
    #[arg(long, default_value = "-y", value_name = "AXIS", allow_hyphen_values = true, value_parser = axis)]
    up: Vec3,
}

/// Lift masks of pictures to a splat: a label and a confidence for every Gaussian, also for those that no picture shows. Lift
/// maps of features too, or alone to objects that are there already.
#[derive(clap::Args)]
pub struct LiftArgs {
    /// The splat (.ply or .splat).
    splat: PathBuf,
    /// Cameras, in the frame of the splat: a `transforms.json`, or the folder of a COLMAP model.
    #[arg(long, value_name = "PATH")]
    views: PathBuf,
    /// Folder of masks: `PICTURE.png` or `PICTURE.npy` with the number of an object at every pixel, 0 for none; `names.json`
    /// says their names. Or LangSplat's `PICTURE_s.npy` and `PICTURE_f.npy`: objects get the vectors of their masks.
    #[arg(long, value_name = "DIR", required_unless_present = "maps")]
    masks: Option<PathBuf>,
    /// Folder of maps of features: `PICTURE.npy` or `PICTURE.safetensors`, `[rows][columns][values]`. Objects get their mean over
    /// pixels, in place of the vectors of masks. Without `--masks`, objects are those of the file that there is.
    #[arg(long, value_name = "DIR")]
    maps: Option<PathBuf>,
    /// Give every Gaussian the mean of the maps, not only every object.
    #[arg(long, requires = "maps")]
    every: bool,
    /// Level of LangSplat's masks: 0 all, 1 small, 2 medium, 3 large.
    #[arg(long, default_value_t = 3, value_name = "N")]
    level: usize,
    /// Numbers mean nothing beyond their picture, as those of proposals: objects are what the masks of many pictures have in common.
    #[arg(long)]
    unnamed: bool,
    /// File of objects [default: beside the splat, `NAME.objects.safetensors`].
    #[arg(short, long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// The splat with the number of its object, from 1, in every Gaussian's `f_sem_0`: scenes take it by `select = { ids = [1] }`
    /// and `split = "ids"`.
    #[arg(long, value_name = "OUT.ply")]
    ply: Option<PathBuf>,
    /// Print one JSON object.
    #[arg(long)]
    json: bool,
}

pub(crate) fn axis(text: &str) -> Result<Vec3, String> {
    let of = |letter: char| ['x', 'y', 'z'].into_iter().position(|axis| axis == letter);
    let mut letters = text.chars();
    let sign = match letters.next() {
        Some('+') => 1.0,
        Some('-') => -1.0,
        _ => 0.0,
    };
    match (sign, letters.next().and_then(of), letters.next()) {
        (sign, Some(axis), None) if sign != 0.0 => Ok(sign * Vec3::AXES[axis]),
        _ => Err(format!("expected one of +x -x +y -y +z -z, not {text:?}")),
    }
}

/// A splat, and the hash of its file.
pub(crate) fn load(path: &Path) -> anyhow::Result<(Gaussians, ReadReport, u64)> {
    let content = reading::read(path, reading::LARGEST_DATA);
    let bytes = content.with_context(|| format!("cannot read {}", path.display()))?;
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let (gaussians, report) = read(&name, &bytes)?;
    let file = SourceFile::of(SourceKind::Asset, &name, path, &bytes);
    Ok((gaussians, report, file.hash))
}

/// Gaussians as they are drawn.
pub(crate) fn states(splat: &Splat) -> Vec<GaussianState> {
    (0..splat.len())
        .map(|n| GaussianState {
            position: splat.position[n].to_array(),
            color: splat.color[n]
                .extend(splat.opacity[n])
                .to_array()
                .map(|level| (level * 255.0).round() as u8),
            covariance: splat.covariance[n],
            index: n as u32,
            rotation: [0.0, 0.0, 0.0, 1.0],
            ..Default::default()
        })
        .collect()
}

/// Runs `cosplat views`.
///
/// # Errors
/// When the splat cannot be read or a file cannot be written.
pub fn run_views(args: &ViewsArgs) -> anyhow::Result<()> {
    let (gaussians, ..) = load(&args.splat)?;
    let splat = Splat::from(&gaussians);
    let images = args.out.join("images");
    std::fs::create_dir_all(&images)
        .with_context(|| format!("cannot make {}", images.display()))?;
    let (width, height) = args.size;
    let views = spiral(splat.bounds(), args.up, args.count as usize, width, height);
    let states = states(&splat);
    let degree = u32::from(gaussians.sh_degree);
    let bar = progress::bar("pictures", views.len() as u64);
    for view in &views {
        let sh = Harmonics::new(degree, &gaussians.sh).filter(|_| degree > 0);
        let image = picture(&states, sh, &view.camera, BACKGROUND);
        write_png(&images.join(format!("{}.png", view.name)), &image)?;
        bar.inc(1);
    }
    bar.finish_and_clear();
    let path = args.out.join("transforms.json");
    cosplat_files::write(&path, transforms::write(&views))
        .with_context(|| format!("cannot write {}", path.display()))?;
    say!("{} pictures, cameras in {}", views.len(), path.display())
}

/// Cameras of a `transforms.json`, of its folder, or of a COLMAP model; `size` is that of pictures where the file has none.
pub(crate) fn cameras(views: &Path, size: Option<[u32; 2]>) -> Result<Vec<View>, SemanticsError> {
    if colmap::is_model(views) {
        return colmap::read(views);
    }
    let path = match views.is_dir() {
        true => views.join("transforms.json"),
        false => views.to_owned(),
    };
    transforms::read(&path, size)
}

/// Views with masks: each with the file of its mask.
pub(crate) fn masked_views(views: &Path, folder: &Path) -> anyhow::Result<Vec<(View, PathBuf)>> {
    // Synthetic sets do not say how large their pictures are; their masks do.
    let views = cameras(views, first_size(folder)?)?;
    let count = views.len();
    let example = views
        .first()
        .map_or_else(String::new, |view| view.name.clone());
    let found: Vec<_> = views
        .into_iter()
        .filter_map(|view| Some((masks::find(folder, &view.name)?, view)))
        .map(|(path, view)| (view, path))
        .collect();
    match found.is_empty() {
        false => Ok(found),
        true => Err(SemanticsError::NoMasks {
            folder: folder.to_owned(),
            views: count,
            example,
        }
        .into()),
    }
}

/// Size of the first mask by name.
fn first_size(folder: &Path) -> anyhow::Result<Option<[u32; 2]>> {
    let entries = std::fs::read_dir(folder)
        .with_context(|| format!("cannot read the folder {}", folder.display()))?;
    let files = entries.filter_map(|entry| Some(entry.ok()?.path()));
    let first = files
        .filter(|path| {
            let is_array = path.extension().is_some_and(|e| e == "npy");
            path.extension().is_some_and(|e| e == "png")
                || (is_array && !path.to_string_lossy().ends_with("_f.npy"))
        })
        .min();
    let Some(first) = first else { return Ok(None) };
    let map = map_of(&first, 0)?;
    Ok(Some([map.width as u32, map.height as u32]))
}

/// Masks of a picture; `level` is that of LangSplat's.
pub(crate) fn map_of(path: &Path, level: usize) -> Result<MaskMap, SemanticsError> {
    match masks::is_proposals(path) {
        true => Ok(masks::read_proposals(path, level)?.0),
        false => masks::read(path),
    }
}

/// A vector for each object, where masks have some.
fn vectors(
    splat: &Splat,
    views: &[(View, PathBuf)],
    level: usize,
    labels: &Labels,
    objects: usize,
) -> anyhow::Result<Option<Vectors>> {
    let mut means = Means::new(objects);
    let proposals = views.iter().filter(|(_, path)| masks::is_proposals(path));
    let mut any = false;
    for (view, path) in proposals {
        let (map, vectors) = masks::read_proposals(path, level)?;
        let said = evidence(splat, &view.camera, &map);
        let added = means.add(&said, labels, &vectors);
        added.map_err(|why| anyhow::anyhow!("{}: {why}", path.display()))?;
        any = true;
    }
    Ok(any.then(|| means.finish()))
}

/// Objects of masks, without their vectors for each Gaussian, and how many Gaussians no mask shows.
fn from_masks(
    args: &LiftArgs,
    folder: &Path,
    splat: &Splat,
    asset_hash: u64,
) -> anyhow::Result<(Objects, usize, usize)> {
    let views = masked_views(&args.views, folder)?;
    let count = views.len();
    let is_unnamed = args.unnamed || views.iter().any(|(_, path)| masks::is_proposals(path));
    // How often every view is asked.
    let passes = if is_unnamed { 2 } else { 3 };
    let bar = progress::bar("masks", (1 + passes) * count as u64);
    let mut most = 0;
    for (_, path) in &views {
        let map = map_of(path, args.level)?;
        most = most.max(map.mask.iter().map(|mask| mask + 1).max().unwrap_or(0) as usize);
        bar.inc(1);
    }
    ensure!(most > 0, "the masks name no object: all their pixels are 0");
    let mut seen = vec![0.0; splat.len()];
    let said = |n: usize| {
        let (view, path) = &views[n];
        bar.inc(1);
        bar.set_message(plain(&view.name).into_owned());
        let said = evidence(splat, &view.camera, &map_of(path, args.level)?);
        for e in said.iter().filter(|e| e.mask >= 0) {
            seen[e.gaussian as usize] += e.weight;
        }
        Ok::<_, SemanticsError>(said)
    };
    let (names, labels): (Vec<String>, Labels) = match is_unnamed {
        true => {
            let labels = group(splat, count, said)?;
            let objects = labels.object.iter().max().map_or(0, |last| last + 1);
            let names = (1..=objects).map(|n| format!("object_{n}"));
            (names.collect(), labels)
        }
        false => {
            let names = masks::names(folder, most)?;
            let (_, labels) = lift(splat, names.len(), count, said)?;
            (names, labels)
        }
    };
    bar.finish_and_clear();
    let object_feature = match args.maps {
        None => vectors(splat, &views, args.level, &labels, names.len())?,
        Some(_) => None,
    };
    let least = passes as f32;
    let unseen = seen.iter().filter(|weight| **weight <= least).count();
    let objects = Objects {
        asset_hash,
        names,
        labels,
        object_feature,
        made: format!("cosplat lift, masks of {count} views"),
        ..Objects::default()
    };
    Ok((objects, count, unseen))
}

/// Gives objects the vectors of maps, and every Gaussian where that is asked for; how many views have maps, and how many Gaussians
/// none of them shows.
fn add_maps(
    args: &LiftArgs,
    folder: &Path,
    splat: &Splat,
    objects: &mut Objects,
) -> anyhow::Result<(usize, usize)> {
    let views = cameras(&args.views, masks_size(args)?)?;
    let (all, example) = (views.len(), views.first().map(|view| view.name.clone()));
    let found = views
        .into_iter()
        .filter_map(|view| Some((dense::find(folder, &view.name)?, view)));
    let views: Vec<(PathBuf, View)> = found.collect();
    ensure!(
        !views.is_empty(),
        "{} has maps for none of the {all} views: expected files such as {}.npy",
        folder.display(),
        example.unwrap_or_default()
    );
    let said = |n: usize| {
        let (path, view) = &views[n];
        let map = dense::read(path)?;
        let said = evidence(splat, &view.camera, &map.cells());
        Ok::<(Vec<Evidence>, Vectors), SemanticsError>((said, map.vectors))
    };
    let bar = progress::bar("maps", views.len() as u64);
    let mut means = Means::new(objects.names.len());
    let mut seen = vec![0.0; splat.len()];
    for (n, (path, view)) in views.iter().enumerate() {
        bar.set_message(plain(&view.name).into_owned());
        let (said, vectors) = said(n)?;
        let added = means.add(&said, &objects.labels, &vectors);
        added.map_err(|why| anyhow::anyhow!("{}: {why}", path.display()))?;
        for e in &said {
            seen[e.gaussian as usize] += e.weight;
        }
        bar.inc(1);
    }
    bar.finish_and_clear();
    let of_objects = means.finish();
    if args.every {
        let labels = &objects.labels;
        let (len, dim) = (splat.len(), of_objects.dim);
        let every = dense::of_gaussians(len, dim, views.len(), said, labels, &of_objects)?;
        objects.feature = Some(every);
    }
    objects.object_feature = Some(of_objects);
    objects.made = format!("{}; maps of {} views", objects.made, views.len());
    Ok((views.len(), seen.iter().filter(|w| **w <= 1.0).count()))
}

/// Size of pictures where cameras do not say it: that of the masks, if there are any.
fn masks_size(args: &LiftArgs) -> anyhow::Result<Option<[u32; 2]>> {
    args.masks.as_deref().map_or(Ok(None), first_size)
}

/// Runs `cosplat lift`.
///
/// # Errors
/// When a file cannot be read or written, or no view has masks or maps.
pub fn run(args: &LiftArgs) -> anyhow::Result<()> {
    let (mut gaussians, found, asset_hash) = load(&args.splat)?;
    let splat = Splat::from(&gaussians);
    let rows = found.rows();
    let out = args
        .out
        .clone()
        .unwrap_or_else(|| args.splat.with_extension("objects.safetensors"));
    for output in std::iter::once(&out).chain(&args.ply) {
        cosplat_files::keep_apart(output, [&args.splat])?;
    }
    let (mut objects, mut views, mut unseen) = match &args.masks {
        Some(folder) => from_masks(args, folder, &splat, asset_hash)?,
        None => {
            let there = Objects::read(&out, asset_hash, found.count)
                .context("maps without masks need objects that are there")?;
            (there.subset(&rows), 0, 0)
        }
    };
    if let Some(folder) = &args.maps {
        let (mapped, unmapped) = add_maps(args, folder, &splat, &mut objects)?;
        if args.masks.is_none() {
            (views, unseen) = (mapped, unmapped);
        }
    }
    let whole = objects.clone().spread(&rows, found.count);
    whole.write(&out)?;
    if let Some(path) = &args.ply {
        gaussians.feature_dim = 1;
        gaussians.feature = objects
            .labels
            .object
            .iter()
            .map(|object| (object + 1) as f32)
            .collect();
        cosplat_files::write(path, ply::write(&gaussians))
            .with_context(|| format!("cannot write {}", path.display()))?;
    }
    report(args, &objects, &out, views, unseen)
}

fn report(
    args: &LiftArgs,
    objects: &Objects,
    out: &Path,
    views: usize,
    unseen: usize,
) -> anyhow::Result<()> {
    let of = |id: usize| {
        let mine = objects.labels.object.iter().zip(&objects.labels.confidence);
        let mine: Vec<f32> = mine
            .filter(|(o, _)| **o == id as i32)
            .map(|(_, c)| *c)
            .collect();
        let sum = mine.iter().fold(0.0, |sum, c| sum + c);
        (mine.len(), sum / mine.len().max(1) as f32)
    };
    let all: Vec<_> = objects
        .names
        .iter()
        .enumerate()
        .map(|(id, name)| (id + 1, name, of(id)))
        .collect();
    if args.json {
        let all = all.iter().map(|(id, name, (gaussians, confidence))| {
            serde_json::json!({ "id": id, "name": name, "gaussians": gaussians, "confidence": confidence })
        });
        let found = serde_json::json!({
            "file": out, "views": views, "unseen": unseen, "objects": all.collect::<Vec<_>>(),
            "values": objects.object_feature.as_ref().map(|f| f.dim),
        });
        return say!("{found}");
    }
    for (id, name, (gaussians, confidence)) in &all {
        say!("{id:4}  {gaussians:9} Gaussians, mean confidence {confidence:.3}  {name}")?;
    }
    say!(
        "{views} views; {unseen} Gaussians seen by none have the label of what is near; {}",
        out.display()
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn axes_are_read_or_refused_in_a_sentence() {
        assert_eq!((axis("+x"), axis("-z")), (Ok(Vec3::X), Ok(-Vec3::Z)));
        for bad in ["x", "", "+w", "+xy"] {
            assert!(axis(bad).unwrap_err().contains("expected"), "{bad}");
        }
    }
}
