//! `cosplat refine`: splat and objects made better together, by gradient, on pictures and masks of it.

use std::path::{Path, PathBuf};

use anyhow::{Context, ensure};
use cosplat_console::{progress, say};
use cosplat_scene::{
    assets::{Gaussians, ply},
    sources::{SourceFile, SourceKind},
};
use cosplat_semantics::{
    Evidence, MaskMap, SemanticsError, Splat, View, evidence,
    lift::{Graph, Labels, agreement, fill_from_nearest, fill_unseen, lift, spread},
    masks,
    objects::Objects,
    refine::{Refined, Score, Settings, Straddling, is_held_out, observe, refine},
    tree::Tree,
};

use crate::lift::{load, map_of, masked_views};

/// Most objects that masks may name: a feature has a value for each.
const MOST_OBJECTS: usize = 64;

/// Refine a splat and its objects on pictures and their masks; parts Gaussians that straddle two objects. One view in eight
/// is held out, and nothing comes out that is worse there than what `cosplat lift` makes.
#[derive(clap::Args)]
pub struct Args {
    /// The splat (.ply or .splat).
    splat: PathBuf,
    /// Cameras, in the frame of the splat: a `transforms.json`, or the folder of a COLMAP model.
    #[arg(long, value_name = "PATH")]
    views: PathBuf,
    /// Folder of pictures: `PICTURE.png`.
    #[arg(long, value_name = "DIR")]
    images: PathBuf,
    /// Folder of masks, as for `cosplat lift`.
    #[arg(long, value_name = "DIR")]
    masks: PathBuf,
    /// File of objects that masks without names were lifted to: each mask counts as the object that most of it covers.
    #[arg(long, value_name = "FILE")]
    objects: Option<PathBuf>,
    /// Level of LangSplat's masks: 0 all, 1 small, 2 medium, 3 large.
    #[arg(long, default_value_t = 3, value_name = "N", requires = "objects")]
    level: usize,
    /// The refined splat; `OUT.objects.safetensors` is written beside it.
    #[arg(short, long, value_name = "OUT.ply")]
    out: PathBuf,
    /// Most rounds over the views.
    #[arg(long, default_value_t = 20, value_parser = clap::value_parser!(u16).range(1..=1000))]
    rounds: u16,
    /// Weight of the visual term, lambda_1 of equation (1).
    #[arg(long, default_value_t = 1.0)]
    lambda_visual: f32,
    /// Weight of the semantic term, lambda_2 of equation (1).
    #[arg(long, default_value_t = 0.1)]
    lambda_semantic: f32,
    /// Longer side of the pictures that it works on [pixel]; larger ones are made smaller.
    #[arg(long, default_value_t = 640, value_parser = clap::value_parser!(u32).range(16..=16_384))]
    size: u32,
    /// Split no Gaussian: rows stay those of the splat.
    #[arg(long)]
    no_split: bool,
    /// Print one JSON object.
    #[arg(long)]
    json: bool,
}

/// How labels came about where refinement made none better.
const AS_IT_WAS: &str = "the splat as it was, masks lifted";

/// Views with their masks, whose numbers are those of objects.
struct Masked {
    views: Vec<(View, PathBuf)>,
    /// Objects of the splat as it was, where masks have no names, and the masks by them.
    known: Option<(Objects, Vec<MaskMap>)>,
}

impl Masked {
    fn new(args: &Args) -> anyhow::Result<(Self, Gaussians)> {
        let (gaussians, found, hash) = load(&args.splat)?;
        let views: Vec<_> = masked_views(&args.views, &args.masks)?
            .into_iter()
            .map(|(view, path)| (view.scaled(args.size), path))
            .collect();
        let Some(path) = &args.objects else {
            return Ok((Self { views, known: None }, gaussians));
        };
        let objects = Objects::read(path, hash, found.count)?.subset(&found.rows());
        let splat = Splat::from(&gaussians);
        let named = views.iter().map(|(view, path)| {
            let camera = &view.camera;
            let map = map_of(path, args.level)?;
            let map = map.resized(camera.width as usize, camera.height as usize);
            let said = evidence(&splat, camera, &map);
            Ok(masks::with_objects(&map, &said, &objects.labels))
        });
        let named = named.collect::<Result<Vec<_>, SemanticsError>>()?;
        let known = Some((objects, named));
        Ok((Self { views, known }, gaussians))
    }

    /// Masks of a view.
    fn masks(&self, n: usize) -> Result<MaskMap, SemanticsError> {
        match &self.known {
            Some((_, named)) => Ok(named[n].clone()),
            None => masks::read(&self.views[n].1),
        }
    }

    /// Names of the objects that masks have.
    fn names(&self, folder: &Path) -> anyhow::Result<Vec<String>> {
        let names = match &self.known {
            Some((objects, _)) => objects.names.clone(),
            None => {
                let mut most = 0;
                for n in 0..self.views.len() {
                    let masks = self.masks(n)?.mask;
                    most = masks.iter().map(|m| m + 1).fold(most, i32::max);
                }
                ensure!(most > 0, "the masks name no object");
                masks::names(folder, most as usize)?
            }
        };
        ensure!(
            (1..=MOST_OBJECTS).contains(&names.len()),
            "the masks name {} objects, expected 1 to {MOST_OBJECTS}",
            names.len()
        );
        Ok(names)
    }
}

/// Labels of a splat from all masks, and how far they agree with those that were held out.
fn lifted(
    splat: &Splat,
    masked: &Masked,
    objects: usize,
) -> anyhow::Result<(Labels, f64, Vec<Vec<Evidence>>)> {
    let views = &masked.views;
    let said = |n: usize| {
        let camera = &views[n].0.camera;
        Ok::<_, SemanticsError>(evidence(splat, camera, &masked.masks(n)?))
    };
    let (_, labels) = lift(splat, objects, views.len(), said)?;
    let held = (0..views.len()).filter(|&n| is_held_out(n, views.len()));
    let held = held.map(said).collect::<Result<Vec<_>, _>>()?;
    let agreement = agreement(&labels, objects, &held);
    Ok((labels, agreement, held))
}

/// Runs `cosplat refine`.
///
/// # Errors
/// When a file cannot be read or written, no view has masks, or a view with a mask has no picture.
pub fn run(args: &Args) -> anyhow::Result<()> {
    let weights = [args.lambda_visual, args.lambda_semantic];
    ensure!(
        weights.iter().all(|w| w.is_finite() && *w >= 0.0) && weights != [0.0; 2],
        "weights {weights:?} of equation (1), expected finite ones of at least 0, and one above"
    );
    cosplat_files::keep_apart(&args.out, [&args.splat].into_iter().chain(&args.objects))?;
    let (masked, gaussians) = Masked::new(args)?;
    let views = &masked.views;
    ensure!(
        views.len() >= 3,
        "{} views have masks, expected at least 3: one is held out",
        views.len()
    );
    let names = masked.names(&args.masks)?;
    let objects = names.len();
    let settings = Settings {
        weights,
        rounds: args.rounds.into(),
        split: !args.no_split,
        ..Settings::default()
    };
    let bar = progress::bar("views", settings.most_views(views.len()));
    let cameras: Vec<View> = views.iter().map(|(view, _)| view.clone()).collect();
    let refined = refine(
        gaussians.clone(),
        &cameras,
        objects,
        &settings,
        |n| {
            let view = &views[n].0;
            let path = args.images.join(format!("{}.png", view.name));
            let masks = masked.masks(n)?;
            observe(view, &path, &masks, objects, settings.background)
        },
        |doing| {
            bar.inc(1);
            bar.set_message(doing.to_owned());
        },
    )?;
    bar.finish_and_clear();
    finish(args, gaussians, refined, &masked, names)
}

/// A splat with labels: how they came about, and how far they agree with held-out masks.
struct Labelled {
    gaussians: Gaussians,
    labels: Labels,
    how: &'static str,
    agreement: f64,
}

/// What is written, and how far labels of the splat as it was agree with held-out masks.
///
/// Where masks have names, that is what agrees most. Where they have none they got them by the objects that there are, and cannot
/// say better: rows stay what they were.
fn chosen(
    before: Gaussians,
    refined: Refined,
    masked: &Masked,
    objects: usize,
) -> anyhow::Result<(Labelled, f64)> {
    let splat = Splat::from(&refined.gaussians);
    let (closed, start, held_before) = lifted(&Splat::from(&before), masked, objects)?;
    let (lifted, by_masks, held) = lifted(&splat, masked, objects)?;
    if let Some((known, _)) = &masked.known {
        let start = agreement(&known.labels, objects, &held_before);
        let mut labels = known.labels.clone();
        // Second halves of what was split come after the rows.
        labels.object.resize(splat.len(), -1);
        labels.confidence.resize(splat.len(), 0.0);
        fill_from_nearest(&mut labels, &splat.position);
        let found = Labelled {
            agreement: agreement(&labels, objects, &held),
            gaussians: refined.gaussians,
            labels,
            how: "refined splat, objects as they were",
        };
        return Ok((found, start));
    }
    let (feature, seen) = (&refined.feature, &refined.seen);
    let mut learnt = spread(&splat, &Graph::new(&splat), feature, seen);
    let weight = feature.iter().zip(0..).map(|(f, n)| f * seen[n / objects]);
    let weight = weight.collect::<Vec<_>>();
    fill_unseen(&mut learnt, &Tree::new(&splat), &weight, objects);
    let by_features = agreement(&learnt, objects, &held);
    let (gaussians, labels, how, agreement) = if by_masks.max(by_features) < start {
        (before, closed, AS_IT_WAS, start)
    } else if by_features > by_masks {
        let how = "refined splat and features";
        (refined.gaussians, learnt, how, by_features)
    } else {
        let how = "refined splat, masks lifted to it";
        (refined.gaussians, lifted, how, by_masks)
    };
    let found = Labelled {
        gaussians,
        labels,
        how,
        agreement,
    };
    Ok((found, start))
}

/// Writes what is chosen and says what came of it.
fn finish(
    args: &Args,
    before: Gaussians,
    refined: Refined,
    masked: &Masked,
    names: Vec<String>,
) -> anyhow::Result<()> {
    let [first, mut last] = refined.score;
    let [straddled, mut straddles] = refined.straddling;
    let rounds = refined.rounds;
    let (found, start) = chosen(before, refined, masked, names.len())?;
    let Labelled {
        gaussians,
        labels,
        how,
        agreement: end,
    } = found;
    if how == AS_IT_WAS {
        // What is said below is of what is written.
        (last, straddles) = (first, straddled);
    }
    let bytes = ply::write(&gaussians);
    cosplat_files::write(&args.out, &bytes)
        .with_context(|| format!("cannot write {}", args.out.display()))?;
    let path = args.out.with_extension("objects.safetensors");
    let known = masked.known.as_ref().map(|(objects, _)| objects);
    Objects {
        asset_hash: hash(&args.out, &bytes),
        names,
        labels,
        parent: known.map_or_else(Vec::new, |known| known.parent.clone()),
        object_feature: known.and_then(|known| known.object_feature.clone()),
        made: format!("cosplat refine, {} views, {how}", masked.views.len()),
        ..Objects::default()
    }
    .write(&path)?;
    if args.json {
        let score = |of: &Score| serde_json::json!({ "psnr_db": of.psnr, "visual": of.visual, "semantic": of.semantic });
        let straddling = |of: &Straddling| serde_json::json!({ "gaussians": of.count, "opacity": of.opacity, "mass": of.mass });
        return say!(
            "{}",
            serde_json::json!({
                "before": score(&first), "after": score(&last), "iou_before": start, "iou_after": end, "made_of": how,
                "straddling_before": straddling(&straddled), "straddling_after": straddling(&straddles),
                "rounds": rounds, "gaussians": gaussians.len(), "file": args.out, "objects": path,
            })
        );
    }
    say!("held-out views   before    after")?;
    say!("PSNR [dB]      {:8.2} {:8.2}", first.psnr, last.psnr)?;
    say!("visual loss    {:8.5} {:8.5}", first.visual, last.visual)?;
    say!(
        "semantic loss  {:8.5} {:8.5}",
        first.semantic,
        last.semantic
    )?;
    say!("labels, IoU    {start:8.4} {end:8.4}  {how}")?;
    say!(
        "straddling     {:8} {:8}  opacity {:.1} {:.1}",
        straddled.count,
        straddles.count,
        straddled.opacity,
        straddles.opacity
    )?;
    say!(
        "{} rounds; {} Gaussians in {}, objects in {}",
        rounds,
        gaussians.len(),
        args.out.display(),
        path.display()
    )
}

fn hash(path: &Path, bytes: &[u8]) -> u64 {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    SourceFile::of(SourceKind::Asset, &name, path, bytes).hash
}
