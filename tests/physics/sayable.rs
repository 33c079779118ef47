//! What a scene file and the options of `cosplat simulate` and `cosplat explain` can say, from the text to the result.

use std::f64::consts::PI;

use serde_json::Value;

use crate::{cosplat, cosplat_simulate, number, simulate};

/// A ball of jelly in free fall.
const BALL: &str = r#"version = 1
dx = 0.05
[[objects]]
name = "ball"
shape = { kind = "sphere", radius = 0.1 }
material = "jelly"
"#;

/// What `cosplat explain` says of a scene, as JSON.
fn explain(scene: &str, options: &[&str]) -> Value {
    let output = cosplat("explain", scene, &[&["--json"], options].concat());
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "cosplat explain failed: {errors}");
    serde_json::from_slice(&output.stdout).expect("JSON")
}

#[test]
fn a_frame_may_last_longer_than_a_second() {
    let scene = BALL.replace(
        "dx = 0.05",
        "dx = 0.05\nframe_rate = 0.5\ngravity = [0, -0.1, 0]",
    );
    let run = simulate(&scene, 4.0, &["--threads", "1"]);
    assert_eq!(run.frames.len(), 2);
    assert_eq!(number(&run.last()["sim_time"]), 4.0);
    // Free fall; symplectic Euler is ahead by half a substep of the last speed, and substeps are shorter than 20 ms.
    let fallen = number(&run.last()["objects"][0]["com"][1]);
    assert!(
        (fallen + 0.5 * 0.1 * 16.0).abs() < 0.5 * 0.4 * 0.02,
        "{fallen}"
    );
}

#[test]
fn explain_says_no_substep_longer_than_a_frame() {
    let often = ["--set", "frame_rate=20000"];
    let said = explain(BALL, &often);
    assert_eq!(number(&said["dt"]), 5e-5);
    assert!(said["dt_object"].is_null(), "{said}");
    let run = simulate(BALL, 1e-4, &[&often[..], &["--threads", "1"]].concat());
    assert_eq!(number(&run.first()["dt"]), 5e-5);
    assert_eq!(run.first()["dt_limit"], "frame");
}

#[test]
fn the_reference_solver_takes_one_thread_and_no_more() {
    let run = simulate(BALL, 1.0 / 60.0, &["--f64", "--threads", "1"]);
    assert_eq!(run.frames.len(), 1);
    let refused = cosplat_simulate(BALL, 0.02, &["--f64", "--threads", "2"]);
    assert!(!refused.status.success());
    let reason = String::from_utf8_lossy(&refused.stderr);
    assert!(reason.contains("expected --threads 1 or none"), "{reason}");
}

#[test]
fn explain_says_which_grid_objects_are_on_and_why() {
    let cases = [
        (BALL.to_owned(), "lagrangian", None),
        (
            BALL.replace("jelly", "water"),
            "spatial",
            Some("the law fluid does not go with a grid of its own"),
        ),
        (
            format!("{BALL}solver = \"spatial\"\n"),
            "spatial",
            Some("its entry says so"),
        ),
    ];
    for (scene, solver, why) in cases {
        let said = explain(&scene, &[]);
        let ball = &said["objects"][0];
        assert_eq!(ball["solver"], solver, "{said}");
        assert_eq!(ball["why_spatial"].as_str(), why, "{said}");
        let text = cosplat("explain", &scene, &[]).stdout;
        let text = String::from_utf8_lossy(&text);
        let line = match why {
            Some(why) => format!("on the spatial grid: {why}\n"),
            None => format!(
                "on a grid of its own with {} quadrature points\n",
                ball["points"]
            ),
        };
        assert!(text.contains(&line), "{text}");
    }
    let said = explain(&BALL.replace("jelly", "rigid"), &[]);
    assert!(said["objects"][0]["solver"].is_null(), "a body has no grid");
    assert!(said["precision"].is_null(), "and no cells: {said}");
}

#[test]
fn the_reference_solver_takes_chosen_solids_for_spatial_matter() {
    let chosen = simulate(BALL, 0.05, &["--f64"]);
    let spatial = simulate(&format!("{BALL}solver = \"spatial\"\n"), 0.05, &["--f64"]);
    assert_eq!(chosen.last(), spatial.last());
    let stated = format!("{BALL}solver = \"lagrangian\"\n");
    let refused = cosplat_simulate(&stated, 0.05, &["--f64"]);
    assert!(!refused.status.success());
    let reason = String::from_utf8_lossy(&refused.stderr);
    assert!(reason.contains("object `ball` has"), "{reason}");
}

#[test]
fn a_report_says_how_much_of_each_object_there_is() {
    let exact = 4.0 / 3.0 * PI * 1e-3;
    let said = explain(BALL, &[]);
    let count = number(&said["objects"][0]["particles"]);
    assert!((number(&said["objects"][0]["volume"]) / exact - 1.0).abs() < 1e-9);
    for options in [&["--threads", "1"][..], &["--f64"]] {
        let run = simulate(BALL, 1.0 / 60.0, options);
        let ball = &run.last()["objects"][0];
        assert_eq!(number(&ball["particles"]), count);
        // Nothing deforms it: round-off of deformation gradients in f32.
        let volume = number(&ball["volume"]);
        assert!((volume / exact - 1.0).abs() < 1e-5, "{volume}");
    }
    // Twice the volume after a second of growth by ln 2, as far as its particles are free to.
    let growing = BALL.replace(
        "jelly\"\n",
        "jelly\"\nvelocity_gradient = [[2, 0, 0], [0, 2, 0], [0, 0, 2]]\n",
    );
    let run = simulate(
        &growing,
        1.0 / 60.0,
        &[
            "--threads",
            "1",
            "--set",
            "objects.0.material={preset=\"jelly\", youngs_modulus_pa=1}",
        ],
    );
    let grown = number(&run.last()["objects"][0]["volume"]) / exact;
    // (1 + 2 t)^3 without forces; those of 1 Pa change 2 m/s over a ball by less than 1 % in a frame.
    assert!(
        (grown / (1.0 + 2.0 / 60.0f64).powi(3) - 1.0).abs() < 0.01,
        "{grown}"
    );
}

#[test]
fn a_setting_adds_objects_and_colliders() {
    let second = "objects.1={name=\"second\", clone=\"ball\", translation=[1, 0, 0]}";
    let floor = "colliders.0={name=\"floor\", point=[0, -0.5, 0], normal=[0, 1, 0]}";
    let said = explain(
        BALL,
        &[
            "--set",
            second,
            "--set",
            floor,
            "--set",
            "colliders.1.name=wall",
            "--set",
            "colliders.1.normal=[1, 0, 0]",
            "--set",
            "colliders.1.point=[-3, 0, 0]",
        ],
    );
    assert_eq!(said["objects"][1]["name"], "second");
    let com = number(&said["objects"][1]["com"][0]);
    assert!((com - 1.0).abs() < 1e-12, "{com}");
    let names = [&said["colliders"][0]["name"], &said["colliders"][1]["name"]];
    assert_eq!(names, ["floor", "wall"]);
    let run = simulate(BALL, 0.02, &["--threads", "1", "--set", second]);
    assert_eq!(run.last()["objects"].as_array().map(Vec::len), Some(2));
}

#[test]
fn hollow_shapes_have_the_volume_and_inertia_of_their_wall() {
    let wall = 0.03;
    let cases = [
        (
            "kind = \"sphere\", radius = 0.1",
            4.0 / 3.0 * PI * (0.1f64.powi(3) - 0.07f64.powi(3)),
        ),
        (
            "kind = \"box\", size = [0.2, 0.3, 0.2]",
            0.2 * 0.3 * 0.2 - 0.14 * 0.24 * 0.14,
        ),
        (
            "kind = \"cylinder\", radius = 0.1, height = 0.2",
            PI * (0.01 * 0.2 - 0.0049 * 0.14),
        ),
    ];
    for (shape, volume) in cases {
        let scene = BALL
            .replace(
                "kind = \"sphere\", radius = 0.1",
                &format!("{shape}, wall = {wall}"),
            )
            .replace("dx = 0.05", "dx = 0.015");
        let said = explain(&scene, &[]);
        let found = number(&said["objects"][0]["volume"]);
        assert!((found / volume - 1.0).abs() < 1e-9, "{shape}: {found}");
        assert_eq!(said["warnings"].as_array().map(Vec::len), Some(0), "{said}");
    }
    let ball = BALL
        .replace("radius = 0.1", "radius = 0.1, wall = 0.03")
        .replace("dx = 0.05", "dx = 0.02")
        .replace("jelly", "rigid");
    let run = simulate(&ball, 0.01, &["--threads", "1"]);
    let state = &run.last()["objects"][0];
    let exact = 0.4 * (0.1f64.powi(5) - 0.07f64.powi(5)) / (0.1f64.powi(3) - 0.07f64.powi(3));
    let inertia = number(&state["inertia"][0]) / number(&state["mass"]);
    // Whole balls have theirs to 0.5 % at that resolution.
    assert!(
        (inertia / exact - 1.0).abs() < 0.01,
        "{inertia}, not {exact}"
    );
    let coarse = explain(&ball, &["--set", "dx=0.04"]);
    let warning = coarse["warnings"][0].as_str().unwrap_or_default();
    assert!(
        warning.contains("its wall is 0.03 m thick, less than 2 dx"),
        "{warning}"
    );
    let refused = cosplat("explain", &ball, &["--set", "objects.0.shape.wall=0.1"]);
    assert_eq!(refused.status.code(), Some(2));
    let reason = String::from_utf8_lossy(&refused.stderr);
    assert!(
        reason.contains("`wall` is 0.1 m, expected less than half"),
        "{reason}"
    );
}

/// Triangles of a torus about the y axis: radii of the ring and of its tube. Its seams are off by round-off, as in files.
fn torus(ring: f64, tube: f64) -> Vec<[[f64; 3]; 3]> {
    let (around, across) = (64, 32);
    let point = |i: usize, j: usize| {
        let (s, c) = (2.0 * PI * i as f64 / around as f64).sin_cos();
        let (t, u) = (2.0 * PI * j as f64 / across as f64).sin_cos();
        let r = ring + tube * u;
        [r * c, tube * t, r * s]
    };
    let cells = (0..around).flat_map(|i| (0..across).map(move |j| (i, j)));
    let triangles = cells.flat_map(|(i, j)| {
        let [a, b, c, d] = [i, i + 1, j, j + 1];
        let [p, q, r, s] = [point(a, c), point(a, d), point(b, d), point(b, c)];
        [[p, q, r], [p, r, s]]
    });
    triangles.collect()
}

fn obj(triangles: &[[[f64; 3]; 3]]) -> String {
    let mut text = String::new();
    for [x, y, z] in triangles.iter().flatten() {
        text += &format!("v {x} {y} {z}\n");
    }
    for n in 0..triangles.len() {
        text += &format!("f {} {} {}\n", 3 * n + 1, 3 * n + 2, 3 * n + 3);
    }
    text
}

fn stl(triangles: &[[[f64; 3]; 3]]) -> String {
    let mut text = String::from("solid s\n");
    for triangle in triangles {
        text += "facet normal 0 0 0\nouter loop\n";
        for [x, y, z] in triangle {
            text += &format!("vertex {x} {y} {z}\n");
        }
        text += "endloop\nendfacet\n";
    }
    text + "endsolid s\n"
}

#[test]
fn a_closed_mesh_becomes_an_object_of_its_volume() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = |name: &str| folder.path().join(name).display().to_string();
    // In millimetres, standing on its edge: z becomes up.
    let triangles = torus(100.0, 40.0);
    let turned: Vec<_> = triangles.iter().map(|[a, b, c]| [*a, *c, *b]).collect();
    std::fs::write(path("ring.obj"), obj(&triangles)).expect("written");
    std::fs::write(path("ring.stl"), stl(&turned)).expect("written");
    std::fs::write(path("open.obj"), obj(&triangles[1..])).expect("written");
    let scene = |name: &str| {
        format!(
            "version = 1\ndx = 0.02\n[[objects]]\nname = \"ring\"\nmaterial = \"rigid\"\nup = \"z\"\n\
             scale = 1e-3\ntranslation = [0, 1, 0]\nshape = {{ kind = \"mesh\", path = {:?}, color = [0.8, 0.3, 0.1] }}\n",
            path(name)
        )
    };
    for name in ["ring.obj", "ring.stl"] {
        let said = explain(&scene(name), &[]);
        let ring = &said["objects"][0];
        let volume = number(&ring["volume"]);
        let exact = 2.0 * PI * PI * 0.1 * 0.04 * 0.04;
        // A polygon of 32 sides has 0.64 % less than its circle, the ring of 64 pieces 0.2 %.
        assert!(
            (volume / exact - 0.992).abs() < 2e-3,
            "{name}: {volume} of {exact}"
        );
        assert_eq!(said["warnings"].as_array().map(Vec::len), Some(0), "{said}");
        let gaussians = number(&ring["gaussians"]);
        assert!((4500.0..5500.0).contains(&gaussians), "{gaussians}");
        let run = simulate(&scene(name), 0.01, &["--threads", "1"]);
        let state = &run.last()["objects"][0];
        // m (R^2 + 3/4 r^2) about the axis, which lies along z now, and m (R^2 / 2 + 5/8 r^2) across; 1 % less for polygons.
        let mass = number(&state["mass"]);
        for (n, exact) in [(5, 0.01 + 0.75 * 0.0016), (0, 0.005 + 0.625 * 0.0016)] {
            let inertia = number(&state["inertia"][n]) / mass;
            assert!(
                (inertia / exact - 0.995).abs() < 0.01,
                "{name}: {inertia}, not {exact}"
            );
        }
    }
    let hollow = ["--set", "objects.0.shape.wall=0.02"];
    let less = number(&explain(&scene("ring.obj"), &hollow)["objects"][0]["volume"]);
    // Half the radius of the tube leaves three quarters; no exact volume is known, particles find it to 1 %.
    assert!(
        (less / (2.0 * PI * PI * 0.1 * 0.0012) - 0.992).abs() < 0.015,
        "{less}"
    );
    let refused = cosplat("explain", &scene("open.obj"), &[]);
    assert_eq!(refused.status.code(), Some(2));
    let reason = String::from_utf8_lossy(&refused.stderr);
    assert!(reason.contains("open.obj is no closed surface"), "{reason}");
    let shown = explain(&scene("open.obj"), &["--set", "objects.0.fidelity=static"]);
    assert!(number(&shown["objects"][0]["gaussians"]) > 4500.0);
}

/// A bar at 45 degrees about z, with probes in its lower half and at its upper end: boxes of the same attitude.
const BAR: &str = r#"version = 1
dx = 0.025
jitter = 0
gravity = [0, 0, 0]
frame_rate = 600
[[objects]]
name = "bar"
shape = { kind = "box", size = [0.4, 0.1, 0.1] }
rotation_deg = [0, 0, 45]
material = "jelly"
[[probes]]
name = "held"
kind = "deviation"
object = "bar"
position = ["X", "Y", "Z + 0.1*t"]
box = { min = [-0.2134, -0.1384, -0.1], max = [0.0366, -0.0384, 0.1], rotation_deg = [0, 0, 45] }
[[probes]]
name = "free"
kind = "deviation"
object = "bar"
position = ["X", "Y", "Z"]
box = { min = [0.083, 0.088, -0.1], max = [0.193, 0.188, 0.1], rotation_deg = [0, 0, 45] }
"#;

#[test]
fn turned_boxes_clamp_and_select() {
    let prescribed = "[[prescribed]]\nlinear_velocity = [0, 0, 0.1]\n\
        box = { min = [-0.2134, -0.1884, -0.1], max = [0.0366, 0.0116, 0.1], rotation_deg = [0, 0, 45] }\n";
    let pinned = "[[pinned_regions]]\nvelocity = [0, 0, 0.1]\nmin = [-0.2884, -0.1884, -0.1]\n\
        max = [0.1116, 0.0116, 0.1]\nrotation_xyzw = [0, 0, 0.38268343, 0.92387953]\n";
    for clamp in [prescribed, pinned] {
        let run = simulate(&format!("{BAR}{clamp}"), 1.0 / 600.0, &["--threads", "1"]);
        let probes = &run.last()["probes"];
        assert_eq!(number(&probes["held"]["particles"]), 1024.0, "{probes}");
        // Positions are f32. What is free has hardly heard of it: held, it would be off by 1.7e-4 m.
        assert!(number(&probes["held"]["largest"]) < 1e-6, "{probes}");
        assert!(number(&probes["free"]["particles"]) > 250.0, "{probes}");
        assert!(number(&probes["free"]["largest"]) < 2e-5, "{probes}");
    }
    let said = explain(&format!("{BAR}{pinned}"), &[]);
    assert_eq!(said["warnings"].as_array().map(Vec::len), Some(0), "{said}");
    assert!(number(&said["pinned_regions"][0]["rotation"][2]) > 0.38);
}

#[test]
fn turned_boxes_choose_gaussians_and_materials() {
    let heavy = BAR.replace(
        "[[probes]]\nname = \"held\"",
        "[[objects.regions]]\nmaterial = { preset = \"jelly\", density_kg_m3 = 3060 }\n\
         box = { min = [-0.2134, -0.1384, -0.1], max = [0.0366, -0.0384, 0.1], rotation_deg = [0, 0, 45] }\n\
         [[probes]]\nname = \"held\"",
    );
    // Half of it three times as dense as jelly's 1020 kg/m^3, and its middle there a quarter of its length down the slope.
    let mass = 0.004 * 1020.0 * 2.0;
    let said = explain(&heavy, &[]);
    let run = simulate(&heavy, 1.0 / 600.0, &["--threads", "1"]);
    for bar in [&said["objects"][0], &run.last()["objects"][0]] {
        assert!((number(&bar["mass"]) / mass - 1.0).abs() < 1e-6, "{bar}");
        let com = number(&bar["com"][0]);
        assert!((com + 0.05 * 0.5f64.sqrt()).abs() < 1e-5, "{com}");
    }
    let slice = "version = 1\n[[objects]]\nname = \"slice\"\nbuiltin = \"vase\"\nfidelity = \"static\"\n\
        select = { boxes = [{ min = [-1, 0, -0.01], max = [1, 1, 0.01], rotation_deg = [0, 90, 0] }] }\n";
    let size = &explain(slice, &[])["objects"][0]["gaussian_box"]["size"];
    assert!(number(&size[0]) < 0.02 && number(&size[2]) > 0.1, "{size}");
}
