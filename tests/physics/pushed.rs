//! A plant that touches a cow is pushed, with objects from four sources: what they cost in motion (`docs/semantics.md`).

use std::{convert::Infallible, path::Path};

use cosplat_demo::semantic::composed::Composed;
use cosplat_scene::{
    assets::{self, ply},
    sources::{SourceFile, SourceKind},
};
use cosplat_semantics::{
    Evidence, MaskMap, Splat, View, evidence,
    grouping::group,
    objects::{Labels, Objects},
    stand_in::{damaged, mask},
    strokes::{Stroke, under},
    tree::Tree,
    views::spiral,
};
use glam::Vec3;

use super::{Run, distance, simulate, vector};

/// Views that masks are made of.
const VIEWS: usize = 16;

/// A line over the longest row of pixels that an object has in any of these masks: view, and ends [pixel].
fn line(maps: &[MaskMap], object: i32) -> (usize, [[f32; 2]; 2]) {
    let mut best = (0, 0, [[0.0; 2]; 2]);
    for (view, map) in maps.iter().enumerate() {
        for (y, row) in map.mask.chunks(map.width).enumerate() {
            let mut x = 0;
            for run in row.chunk_by(|a, b| a == b) {
                if run[0] == object && run.len() > best.0 {
                    let (x, y, w) = (x as f32, y as f32 + 0.5, run.len() as f32);
                    best = (run.len(), view, [[x + 0.15 * w, y], [x + 0.85 * w, y]]);
                }
                x += run.len();
            }
        }
    }
    (best.1, best.2)
}

/// The four sources of objects.
fn sources(composed: &Composed, splat: &Splat) -> [(&'static str, Labels); 4] {
    let things = composed.words.len();
    let views: Vec<View> = spiral(splat.bounds(), Vec3::Y, VIEWS, 480, 360);
    let maps: Vec<MaskMap> = views
        .iter()
        .map(|view| mask(splat, &composed.truth, things, &view.camera))
        .collect();
    let said: Vec<Vec<Evidence>> = maps
        .iter()
        .enumerate()
        .map(|(n, map)| evidence(splat, &views[n].camera, &damaged(map, things, n)))
        .collect();
    let Ok(masks) = group(splat, VIEWS, |n| Ok::<_, Infallible>(said[n].clone()));
    let tree = Tree::new(splat);
    let whole: Vec<usize> = tree.whole().into_iter().map(|w| w.0).collect();
    let strokes: Vec<Stroke> = (0..things)
        .map(|name| {
            let (view, line) = line(&maps, name as i32);
            let gaussians = under(splat, &views[view].camera, &line);
            Stroke { name, gaussians }
        })
        .collect();
    let truth = Labels {
        object: composed.truth.clone(),
        confidence: vec![1.0; splat.len()],
    };
    [
        ("truth", truth),
        ("splat alone", tree.labels(splat, &tree.of_nodes(&whole))),
        (
            "one stroke each",
            tree.labels(splat, &tree.stroked(&strokes)),
        ),
        ("damaged masks", masks),
    ]
}

/// What was found, each object as the thing that most of it is: what a person would call it.
fn called(labels: &Labels, truth: &[i32], things: usize) -> Vec<i32> {
    let found = labels.object.iter().max().map_or(0, |o| *o as usize + 1);
    let mut count = vec![vec![0usize; things]; found];
    for (object, thing) in labels.object.iter().zip(truth) {
        count[*object as usize][*thing as usize] += 1;
    }
    let most = |of: &Vec<usize>| (0..things).max_by_key(|t| of[*t]).expect("things") as i32;
    let name: Vec<i32> = count.iter().map(most).collect();
    labels.object.iter().map(|o| name[*o as usize]).collect()
}

/// The plant is pushed over the cow for a quarter of a second; a second in all. Foliage has a loss: what goes on vibrating lets any
/// difference of objects grow.
fn push(folder: &Path, objects: &Path) -> Run {
    let asset = folder.join("room.ply");
    let text = format!(
        "version = 1\ndx = 0.04\nframe_rate = 60\n\
         [materials.foliage]\nlaw = 'neo_hookean'\nyoungs_modulus_pa = 3e5\npoisson_ratio = 0.3\ndensity_kg_m3 = 600\nloss = 0.2\n\
         [[assets]]\nname = 'room'\npath = {asset:?}\nobjects = {objects:?}\n\
         [[objects]]\nname = 'plant'\nasset = 'room'\nselect = {{ names = ['plant'] }}\nmaterial = 'foliage'\n\
         [[objects]]\nname = 'cow'\nasset = 'room'\nselect = {{ names = ['cow'] }}\nmaterial = 'soft_rubber'\n\
         [[objects]]\nname = 'cube'\nasset = 'room'\nselect = {{ names = ['cube'] }}\nmaterial = 'wood'\nfidelity = 'rigid'\n\
         [[objects]]\nname = 'ground'\nasset = 'room'\nselect = {{ names = ['ground'] }}\nfidelity = 'static'\n\
         [[colliders]]\nname = 'floor'\npoint = [0, 0, 0]\nnormal = [0, 1, 0]\nsurface = 'separate'\nfriction = 0.5\n\
         [[impulses]]\nobject = 'plant'\nbox = {{ min = [-1, 0.45, -1], max = [1, 1.1, 1] }}\nforce = [-40, 0, 0]\n\
         start_time = 0.1\nduration = 0.25\n"
    );
    simulate(&text, 1.0, &[])
}

#[test]
fn a_plant_is_pushed_the_same_whatever_found_it() {
    let Some(composed) = Composed::plant() else {
        let why = "SKIPPED: the captures are not found; COSPLAT_TEST_DATA names their folder";
        assert!(std::env::var_os("COSPLAT_REQUIRE_ALL").is_none(), "{why}");
        eprintln!("{why}");
        return;
    };
    let folder = tempfile::tempdir().expect("a folder");
    let asset = folder.path().join("room.ply");
    let bytes = ply::write(&composed.gaussians);
    std::fs::write(&asset, &bytes).expect("written");
    let (read, _) = assets::read("room.ply", &bytes).expect("a splat");
    let splat = Splat::from(&read);
    let hash = SourceFile::of(SourceKind::Asset, "room.ply", &asset, &bytes).hash;
    let mut truth = Vec::new();
    for (source, labels) in sources(&composed, &splat) {
        let object = called(&labels, &composed.truth, composed.words.len());
        let right = object.iter().zip(&composed.truth).filter(|(a, b)| a == b);
        let share = right.count() as f64 / object.len() as f64;
        let file = folder.path().join(format!("{source}.safetensors"));
        let objects = Objects {
            asset_hash: hash,
            names: composed.words.iter().map(|w| (*w).to_owned()).collect(),
            labels: Labels { object, ..labels },
            made: source.to_owned(),
            ..Objects::default()
        };
        objects.write(&file).expect("written");
        let run = push(folder.path(), &file);
        let places: Vec<[f64; 3]> = (0..3)
            .map(|n| vector(&run.last()["objects"][n]["com"]))
            .collect();
        if truth.is_empty() {
            truth.clone_from(&places);
        }
        let off: Vec<f64> = truth
            .iter()
            .zip(&places)
            .map(|(a, b)| distance(*a, *b))
            .collect();
        println!("{source}: {share:.4} right, com {places:.3?}, off {off:.4?} m");
        // What was measured (docs/semantics.md), half as much again: a plant of a metre that tips.
        assert!(share > 0.99 && off[0] < 0.1, "{source}: {share} {off:?}");
        assert!(off[1] < 0.16 && off[2] < 0.005, "{source}: {off:?}");
    }
}
