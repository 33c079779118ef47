//! `cosplat objects`: objects from the splat alone, which a person lists and picks.

use std::{collections::BTreeMap, net::SocketAddr, path::PathBuf, time::Instant};

use anyhow::{Context, bail, ensure};
use cosplat_console::say;
use cosplat_semantics::{
    lift::Labels,
    neighbours::Tree as Places,
    strokes::{Stroke, under},
};
use glam::Vec3;

use crate::lift::cameras;
use crate::{
    find, materials, page,
    prepared::{Found, Output, Prepared},
};

/// Objects of a splat without pictures: what it stands on, what hangs together, and parts of it by stroke or by number.
#[derive(clap::Args)]
pub struct Args {
    #[command(subcommand)]
    command: Command,
}

#[derive(clap::Subcommand)]
enum Command {
    Tree(TreeArgs),
    List(ListArgs),
    Pick(PickArgs),
    Find(find::Args),
    Materials(materials::Args),
}

/// Prepare picking: writes `NAME.tree.safetensors`, and what hangs together as `NAME.objects.safetensors`; says which way is up.
#[derive(clap::Args)]
struct TreeArgs {
    /// The splat (.ply or .splat).
    splat: PathBuf,
    #[command(flatten)]
    output: Output,
}

/// List the nodes of the tree at a height, with what each is made of.
#[derive(clap::Args)]
struct ListArgs {
    /// The splat (.ply or .splat).
    splat: PathBuf,
    /// Height of the joins that are undone, 0 to 1 [default: none; what hangs together].
    #[arg(long, value_name = "H")]
    height: Option<f32>,
    /// The two nodes that this one joins, instead.
    #[arg(long, value_name = "NODE", conflicts_with = "height")]
    node: Option<usize>,
    /// Most nodes, largest first.
    #[arg(long, default_value_t = 20, value_name = "N")]
    most: usize,
    /// Picture of the nodes in colours with their numbers.
    #[arg(long, value_name = "FILE.png")]
    picture: Option<PathBuf>,
    /// Print one JSON object.
    #[arg(long)]
    json: bool,
}

/// Pick objects by number of their nodes, by strokes over what is seen, or all at a height.
#[derive(clap::Args)]
struct PickArgs {
    /// The splat (.ply or .splat).
    splat: PathBuf,
    /// Nodes of `cosplat objects list`; one inside another is a part of it.
    #[arg(long, value_name = "NODE=NAME", num_args = 1..)]
    node: Vec<String>,
    /// Line over an object: `NAME@VIEW:X,Y X,Y` in pixels of a view, or points `NAME:X,Y,Z` in the frame of the splat. Strokes of
    /// several names part what hangs together; what has none stays whole.
    #[arg(
        long,
        value_name = "STROKE",
        conflicts_with = "node",
        allow_hyphen_values = true
    )]
    stroke: Vec<String>,
    /// Cameras of strokes in pixels: a `transforms.json`, or the folder of a COLMAP model.
    #[arg(long, value_name = "PATH")]
    views: Option<PathBuf>,
    /// All nodes of this height, 0 to 1.
    #[arg(long, value_name = "H", conflicts_with_all = ["node", "stroke"])]
    height: Option<f32>,
    /// Serve a page that shows the splat in a browser and takes strokes by mouse, and print its link: at this address, on a free
    /// port of this machine without. Its button Save writes the file, and the command that does the same is printed.
    #[arg(
        long,
        value_name = "ADDR",
        num_args = 0..=1,
        default_missing_value = "127.0.0.1:0",
        conflicts_with_all = ["node", "stroke", "views", "height", "json"]
    )]
    web: Option<SocketAddr>,
    #[command(flatten)]
    output: Output,
}

/// Runs the command.
///
/// # Errors
/// When a file cannot be read or written, or what is picked does not exist.
pub fn run(args: &Args) -> anyhow::Result<()> {
    let since = Instant::now();
    match &args.command {
        Command::Tree(args) => {
            let prepared = Prepared::make(&args.splat)?;
            let found = whole(&prepared, "cosplat objects tree");
            prepared.finish(&args.output, found, since)
        }
        Command::List(args) => list(args),
        Command::Find(args) => find::run(args),
        Command::Materials(args) => materials::run(args),
        Command::Pick(args) => {
            let prepared = Prepared::read(&args.splat)?;
            if let Some(address) = args.web {
                return page::serve(address, prepared, args.output.clone());
            }
            let found = match (args.height, args.stroke.is_empty(), args.node.is_empty()) {
                (Some(height), ..) => at_height(&prepared, height)?,
                (None, false, _) => stroked(&prepared, args)?,
                (None, true, false) => by_number(&prepared, &args.node)?,
                (None, true, true) => whole(&prepared, "cosplat objects pick"),
            };
            prepared.finish(&args.output, found, since)
        }
    }
}

/// What hangs together.
fn whole(prepared: &Prepared, made: &str) -> Found {
    let (nodes, names): (Vec<usize>, Vec<String>) = prepared.tree.whole().into_iter().unzip();
    Found {
        labels: prepared
            .tree
            .labels(&prepared.splat, &prepared.tree.of_nodes(&nodes)),
        names,
        parent: Vec::new(),
        made: format!("{made}, what hangs together"),
    }
}

fn check_height(height: f32) -> anyhow::Result<f32> {
    ensure!(
        (0.0..=1.0).contains(&height),
        "--height is {height}, expected 0 to 1"
    );
    Ok(height)
}

fn at_height(prepared: &Prepared, height: f32) -> anyhow::Result<Found> {
    let tree = &prepared.tree;
    let sizes = tree.sizes();
    let mut nodes = tree.level(check_height(height)?);
    nodes.sort_by_key(|n| (std::cmp::Reverse(sizes[*n]), *n));
    Ok(Found {
        labels: tree.labels(&prepared.splat, &tree.of_nodes(&nodes)),
        names: nodes.iter().map(|n| format!("node_{n}")).collect(),
        parent: Vec::new(),
        made: format!("cosplat objects pick, height {height}"),
    })
}

fn by_number(prepared: &Prepared, picks: &[String]) -> anyhow::Result<Found> {
    let tree = &prepared.tree;
    let mut nodes = Vec::new();
    let mut names = Vec::new();
    for pick in picks {
        let parts = pick.split_once('=').filter(|(_, name)| !name.is_empty());
        let parts = parts.and_then(|(node, name)| Some((node.parse::<usize>().ok()?, name)));
        let (node, name) =
            parts.with_context(|| format!("--node is {pick:?}, expected NODE=NAME"))?;
        ensure!(
            node < tree.nodes(),
            "node {node} does not exist, expected 0 to {}",
            tree.nodes() - 1
        );
        ensure!(!nodes.contains(&node), "node {node} is picked twice");
        ensure!(
            !names.contains(&name.to_owned()),
            "the name {name:?} is given twice"
        );
        nodes.push(node);
        names.push(name.to_owned());
    }
    let up = tree.parents();
    let parent = |&node: &usize| {
        let mut above = std::iter::successors(up[node], |n| up[*n]);
        above
            .find_map(|n| nodes.iter().position(|other| *other == n))
            .map_or(-1, |n| n as i32)
    };
    let parent: Vec<i32> = nodes.iter().map(parent).collect();
    let of = tree.of_nodes(&nodes);
    // What was not picked belongs to nothing: the rest of a scene may stay as it is.
    let object: Vec<i32> = tree.superpoint.iter().map(|s| of[*s as usize]).collect();
    let confidence = object
        .iter()
        .map(|o| if *o < 0 { 0.0 } else { 1.0 })
        .collect();
    Ok(Found {
        labels: Labels { object, confidence },
        names,
        parent: if parent.iter().all(|p| *p < 0) {
            Vec::new()
        } else {
            parent
        },
        made: "cosplat objects pick, nodes of the tree".to_owned(),
    })
}

/// Numbers of a point: `X,Y` or `X,Y,Z`.
fn point<const N: usize>(text: &str, stroke: &str) -> anyhow::Result<[f32; N]> {
    let numbers: Result<Vec<f32>, _> = text.split(',').map(str::parse).collect();
    let found = numbers.ok().and_then(|n| <[f32; N]>::try_from(n).ok());
    let found = found.filter(|n| n.iter().all(|x| x.is_finite()));
    found.with_context(|| format!("--stroke is {stroke:?}: {text:?} is no point of {N} numbers"))
}

/// A stroke: the name, and Gaussians under it.
pub(crate) type Marked = (String, Vec<u32>);

fn stroked(prepared: &Prepared, args: &PickArgs) -> anyhow::Result<Found> {
    let splat = &prepared.splat;
    let views = args
        .views
        .as_deref()
        .map(|path| cameras(path, None))
        .transpose()?
        .unwrap_or_default();
    let mut strokes: Vec<Marked> = Vec::new();
    let mut places = None;
    for text in &args.stroke {
        let parts = text.split_once(':').filter(|(name, _)| !name.is_empty());
        let (whose, points) = parts.with_context(|| {
            format!("--stroke is {text:?}, expected NAME@VIEW:X,Y or NAME:X,Y,Z")
        })?;
        let points = points.split_whitespace();
        let (name, gaussians) = match whose.rsplit_once('@') {
            Some((name, view)) => {
                let Some(found) = views.iter().find(|v| v.name == view) else {
                    bail!(
                        "--stroke is {text:?}: {view} is none of the {} views of --views",
                        views.len()
                    );
                };
                let line = points
                    .map(|p| point::<2>(p, text))
                    .collect::<Result<Vec<_>, _>>()?;
                (name, under(splat, &found.camera, &line))
            }
            None => {
                let places = places.get_or_insert_with(|| Places::new(&splat.position));
                let nearest = |p: &str| {
                    let found = places.nearest(Vec3::from(point::<3>(p, text)?), 1, &|_| true);
                    Ok::<_, anyhow::Error>(found.first().map(|f| f.1))
                };
                let found = points.map(nearest).collect::<Result<Vec<_>, _>>()?;
                (whose, found.into_iter().flatten().collect())
            }
        };
        ensure!(
            !gaussians.is_empty(),
            "--stroke is {text:?}: nothing is seen under it"
        );
        strokes.push((name.to_owned(), gaussians));
    }
    Ok(parted(prepared, &strokes))
}

/// The objects of strokes. What hangs together without one stays an object.
pub(crate) fn parted(prepared: &Prepared, marked: &[Marked]) -> Found {
    let Prepared { splat, tree, .. } = prepared;
    let mut names: Vec<String> = Vec::new();
    let mut strokes = Vec::new();
    for (name, gaussians) in marked {
        let number = names.iter().position(|n| n == name).unwrap_or(names.len());
        if number == names.len() {
            names.push(name.clone());
        }
        strokes.push(Stroke {
            name: number,
            gaussians: gaussians.clone(),
        });
    }
    let mut of = tree.stroked(&strokes);
    let is_free = |node: usize| tree.leaves(node).iter().all(|s| of[*s] < 0);
    let rest = tree.whole().into_iter();
    let rest: Vec<_> = rest
        .filter(|(node, name)| !names.contains(name) && is_free(*node))
        .collect();
    for (node, name) in rest {
        tree.leaves(node)
            .iter()
            .for_each(|s| of[*s] = names.len() as i32);
        names.push(name);
    }
    Found {
        labels: tree.labels(splat, &of),
        names,
        parent: Vec::new(),
        made: format!("cosplat objects pick, {} strokes", marked.len()),
    }
}

fn list(args: &ListArgs) -> anyhow::Result<()> {
    let prepared = Prepared::read(&args.splat)?;
    let Prepared { splat, tree, .. } = &prepared;
    let sizes = tree.sizes();
    let names: BTreeMap<usize, String> = tree.whole().into_iter().collect();
    let mut nodes = match (args.node, args.height) {
        (Some(node), _) => {
            ensure!(
                node < tree.nodes(),
                "node {node} does not exist, expected 0 to {}",
                tree.nodes() - 1
            );
            let parts = tree.children(node);
            parts
                .with_context(|| format!("node {node} is a superpoint: it has no parts"))?
                .to_vec()
        }
        (None, Some(height)) => tree.level(check_height(height)?),
        (None, None) => names.keys().copied().collect(),
    };
    nodes.sort_by_key(|n| (std::cmp::Reverse(sizes[*n]), *n));
    let left = nodes.len().saturating_sub(args.most);
    nodes.truncate(args.most);
    let of = tree.of_nodes(&nodes);
    let object: Vec<i32> = tree.superpoint.iter().map(|s| of[*s as usize]).collect();
    let mut sums = vec![(Vec3::ZERO, 0usize); nodes.len()];
    for (position, object) in splat.position.iter().zip(&object).filter(|(_, o)| **o >= 0) {
        let (sum, count) = &mut sums[*object as usize];
        *sum += *position;
        *count += 1;
    }
    let center = |n: usize| (sums[n].0 / sums[n].1.max(1) as f32).to_array();
    if let Some(path) = &args.picture {
        let words: Vec<String> = nodes.iter().map(|n| format!("node {n}")).collect();
        prepared.picture(path, &object, &words)?;
    }
    if args.json {
        let all = nodes.iter().enumerate().map(|(k, &n)| {
            serde_json::json!({
                "node": n, "gaussians": sizes[n], "height": tree.height_of(n), "center": center(k),
                "parts": tree.children(n), "name": names.get(&n),
            })
        });
        return say!(
            "{}",
            serde_json::json!({ "nodes": all.collect::<Vec<_>>(), "more": left })
        );
    }
    for (k, &n) in nodes.iter().enumerate() {
        let [x, y, z] = center(k);
        let parts = tree
            .children(n)
            .map_or(String::new(), |[a, b]| format!(", joins {a} and {b}"));
        let name = names.get(&n).map_or("", String::as_str);
        say!(
            "node {n:6}  {:9} Gaussians about [{x:.3}, {y:.3}, {z:.3}], height {:.3}{parts}  {name}",
            sizes[n],
            tree.height_of(n)
        )?;
    }
    match left {
        0 => Ok(()),
        _ => say!("and {left} smaller nodes: --most shows more"),
    }
}
