//! What a summary says that a scene takes is what it takes.

use std::path::Path;

use cosplat_scene::{
    load::{load_scene, load_text},
    summary::SceneSummary,
};
use cosplat_sim_core::{Scene, World};

/// How far the cost that is said may be from that of a world, either way: bodies that bounce change shape, and their substeps with it. What is
/// cut raggedly has faster motions than blocks, which is not told before its grid is made: 0.58 of the cost of `fig4` is said.
const FACTOR: f64 = 1.8;

/// Substeps times points per simulated second that a world takes in so many frames, and the most substeps in one.
fn taken(scene: &Scene, frames: u32) -> (f64, u32) {
    let mut world = World::new(scene.clone()).expect("valid scene");
    let (mut updates, mut substeps) = (0, 0);
    for _ in 0..frames {
        let report = world.step(1.0 / scene.frame_rate, &[]);
        updates += report.particle_updates;
        substeps = substeps.max(report.substeps);
    }
    (
        updates as f64 * scene.frame_rate / f64::from(frames),
        substeps,
    )
}

fn check(name: &str, scene: &Scene, frames: u32) {
    let said = SceneSummary::new(scene);
    let (updates, substeps) = taken(scene, frames);
    let ratio = said.particle_updates_per_second / updates;
    let counts = f64::from(substeps) / said.substeps_per_frame as f64;
    println!(
        "{name}: said {:.3e}, taken {updates:.3e}, {ratio:.2}; substeps {} and {substeps}",
        said.particle_updates_per_second, said.substeps_per_frame
    );
    for off in [ratio, counts] {
        assert!((1.0 / FACTOR..FACTOR).contains(&off), "{name}: {off}");
    }
}

#[test]
fn shipped_scenes_take_what_is_said_of_them() {
    for (name, frames) in [
        ("falling_block", 6),
        ("two_vases", 2),
        ("box_of_fifty", 1),
        ("materials", 1),
        ("paper/rods", 4),
        ("paper/fig4", 1),
    ] {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("../scenes/{name}.toml"));
        let loaded = load_scene(&path).unwrap_or_else(|e| panic!("{e}"));
        check(name, &loaded.scene, frames);
    }
}

const BLOCK: &str = "[[objects]]\nname = \"block\"\nshape = { kind = \"box\", size = [0.2, 0.2, 0.2] }\nmaterial = \"jelly\"\n";

fn scene(rest: &str) -> Scene {
    of_cells(0.04, rest)
}

fn of_cells(dx: f64, rest: &str) -> Scene {
    let text = format!("version = 1\ndx = {dx}\nframe_rate = 500\n{BLOCK}{rest}");
    let loaded = load_text(text, Path::new("scene.toml"));
    loaded.unwrap_or_else(|e| panic!("{e}")).scene
}

fn other(words: &str) -> String {
    format!("[[objects]]\nname = \"other\"\nclone = \"block\"\ntranslation = [1, 0, 0]\n{words}\n")
}

#[test]
fn each_object_takes_the_substeps_of_its_own_solver() {
    let alone = SceneSummary::new(&scene(""));
    let stiff = scene(&other("material = \"polyethylene\""));
    check("jelly beside polyethylene", &stiff, 2);
    // What touches shares its substeps: the jelly takes those of the stiff one too.
    let apart = SceneSummary::new(&stiff);
    let touching = other("material = \"polyethylene\"").replace("[1, 0, 0]", "[0.2, 0, 0]");
    let together = SceneSummary::new(&scene(&touching));
    let ratio = together.particle_updates_per_second / apart.particle_updates_per_second;
    assert!((1.8..2.1).contains(&ratio), "{ratio}");
    assert_eq!(together.substeps_per_frame, apart.substeps_per_frame);
    // On one grid all matter does.
    check(
        "jelly and sand",
        &scene(&other("material = \"dry_sand\"")),
        2,
    );
    // A rigid body takes none, whatever it is made of.
    for words in [
        "fidelity = \"rigid\"\nmaterial = \"polyethylene\"",
        "fidelity = \"static\"",
    ] {
        let said = SceneSummary::new(&scene(&other(words)));
        let (now, before) = (
            said.particle_updates_per_second,
            alone.particle_updates_per_second,
        );
        assert_eq!(
            (now, said.dt_object),
            (before, alone.dt_object.clone()),
            "{words}"
        );
        let body = said.objects[1].body.as_ref();
        assert_eq!(body.and_then(|body| body.dt), None, "{words}");
    }
    check(
        "jelly and a body",
        &scene(&other("material = \"rigid\"")),
        5,
    );
}

#[test]
fn precision_is_said_of_the_grid_that_there_is() {
    let said = |rest: &str| SceneSummary::new(&of_cells(0.02, rest)).precision;
    let own = said("").expect("matter that deforms").to_string();
    assert!(own.contains("cells along the smallest object"), "{own}");
    assert!(!own.contains("spatial grid"), "{own}");
    let spatial = said("solver = \"spatial\"\n")
        .expect("matter that deforms")
        .to_string();
    assert!(
        spatial.contains("measured on the spatial grid with 9."),
        "{spatial}"
    );
    assert_eq!(said("fidelity = \"rigid\"\n"), None);
    // A body that is smaller than all matter has no cells.
    let small = "[[objects]]\nname = \"pea\"\nshape = { kind = \"sphere\", radius = 0.02 }\nmaterial = \"rigid\"\ntranslation = [1, 0, 0]\n";
    assert_eq!(
        said(small)
            .expect("matter that deforms")
            .to_string()
            .lines()
            .next(),
        own.lines().next()
    );
}
